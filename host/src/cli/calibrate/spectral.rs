//! `camrig scene spectral`.

use super::hdr::HdrFile;
use super::{Output, read_toml};
use camrig_base::Bands;
use camrig_base::Cfa;
use camrig_base::table::SpectralTable;
use camrig_base::{Error, Plane, Result};
use camrig_calibrate::spectral::{self, Channels, Estimator, Method};
use camrig_calibrate::view::{Region, View, fit_chart};
use camrig_calibrate::{hdr, response};
use camrig_camera::Camera;
use camrig_scene::chart::colorchecker;
use camrig_scene::numpy;
use camrig_scene::stored::{self, Description};
use camrig_scene::{Illuminant, Quantity};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Reflectance spectra from a camera's channels, with the light taken out
///
/// Writes the directory of a stored scene.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig scene spectral merged/ --camera cam.toml --illuminant D65 --chart 120,80,900,590 -o scene/\n  \
    camrig scene spectral frame.dng --camera mt9v024 --illuminant A --white 40,40,30,30 -o scene/")]
pub struct SpectralArgs {
    /// Directory of `scene hdr`, or a raw frame that says its black level and pattern
    frame: PathBuf,
    /// Camera file or preset: whose quantum efficiency saw it
    #[arg(long, value_name = "C")]
    camera: String,
    /// Light of the view, or auto: the one that fits the chart best
    #[arg(long, default_value = "D65", value_name = "I")]
    illuminant: String,
    /// Rectangle around the 24 patches of a ColorChecker in view, raw pixels
    #[arg(long, value_name = "X,Y,W,H", required_unless_present = "white")]
    chart: Option<Region>,
    /// Rectangle of a white of 90 % in view
    #[arg(long, value_name = "X,Y,W,H", conflicts_with = "chart")]
    white: Option<Region>,
    /// Principal components, or auto: of least error by cross-validation
    #[arg(long, default_value = "6", value_name = "K")]
    components: String,
    /// Further training reflectances: CSV of wavelength_nm,NAME,...
    #[arg(long, value_name = "CSV")]
    training: Vec<PathBuf>,
    /// Relative noise that the estimate allows for
    #[arg(long, default_value_t = spectral::NOISE, value_parser = crate::cli::arguments::positive)]
    noise: f64,
    #[command(flatten)]
    to: Output,
}

/// Reflectance of the white that `--white` points at.
const WHITE: f64 = 0.9;

/// Runs `scene spectral`.
pub fn spectral(args: &SpectralArgs) -> Result<()> {
    let output = args.to.create()?;
    let bands = Bands::VISIBLE;
    let (frame, cfa) = linear_frame(&args.frame)?;
    let view = View::new(&frame, &cfa);
    let camera = Camera::load(&args.camera)?;
    let sensitivity = sensitivity(&camera, &view.letters, &bands)?;
    let lights = match args.illuminant.as_str() {
        "auto" if args.chart.is_none() => {
            return Err(Error::input("--illuminant auto without a chart")
                .help("give --chart, or name the light"));
        }
        "auto" => {
            Illuminant::names().iter().map(|n| Illuminant::parse(n)).collect::<Result<_>>()?
        }
        name => vec![Illuminant::parse(name)?],
    };
    let mut measured = None;
    let (light, white, residual) = match (&args.chart, &args.white) {
        (Some(region), _) => {
            let patches = view.patches(region)?;
            let fit = fit_chart(&patches, &sensitivity, &bands, &lights)?;
            let relative = patches
                .iter()
                .map(|p| p.iter().zip(&fit.white).map(|(m, w)| m / w).collect::<Vec<f64>>());
            measured = Some(relative.collect::<Vec<_>>());
            (Illuminant::parse(&fit.illuminant)?, fit.white, Some(fit.residual))
        }
        (None, Some(region)) => {
            let white = view.mean(region, "the white")?.into_iter().map(|v| v / WHITE).collect();
            (lights[0].clone(), white, None)
        }
        (None, None) => return Err(Error::input("neither --chart nor --white")),
    };

    let channels = Channels::new(&sensitivity, &light.in_bands(&bands))?;
    let patches = spectra(&colorchecker::reflectances(), &bands)?;
    let mut more = Vec::new();
    for path in &args.training {
        let table = SpectralTable::read(path)?;
        more.extend(spectra(&table, &bands).map_err(|e| e.at(path.display()))?);
    }
    let components = match args.components.as_str() {
        "auto" => spectral::choose_components(&channels, &bands, &patches, &more, args.noise)?,
        text => text.parse().map_err(|_| {
            Error::input(format!("--components {text}")).help("give a number or auto")
        })?,
    };
    let score = |method| {
        let estimates = spectral::leave_one_out(
            &channels,
            &patches,
            &more,
            components,
            method,
            measured.as_deref(),
        )?;
        spectral::report(&bands, &patches, &estimates)
    };
    let ours = score(Method::Regularised(args.noise))?;
    let plain = score(Method::PseudoInverse)?;

    let training: Vec<Vec<f64>> = patches.iter().chain(&more).cloned().collect();
    let estimator = Estimator::regularised(&channels, &training, components, args.noise)?;
    let planes: Vec<Vec<f32>> = view
        .planes
        .iter()
        .zip(&white)
        .map(|(plane, white)| plane.data.iter().map(|v| v / *white as f32).collect())
        .collect();
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    let (width, height) = (view.planes[0].width, view.planes[0].height);
    let name = args.to.output.file_name().and_then(|n| n.to_str()).unwrap_or("scene");
    let mut about = Description::new(name, Quantity::Reflectance, (width, height), &bands);
    about.source = format!("{} seen by {} under {}", args.frame.display(), camera.name, light.name);
    about.description = format!("reflectance estimated from {} channels", view.letters.len());
    stored::write(output.path(), &about, |band, plane| {
        estimator.band(band, &planes, &mut plane.data);
        Ok(())
    })?;
    output.finish()?;

    let mean = |report: &spectral::Report, light: usize| {
        let list = &report.delta_e[light].1;
        list.iter().sum::<f64>() / list.len() as f64
    };
    if args.to.json {
        let object = json!({
            "illuminant": light.name, "components": components, "white": white,
            "chart_residual": residual, "leave_one_out": ours, "pseudo_inverse": plain,
        });
        println!("{object}");
    } else {
        println!("light {}, {components} components", light.name);
        println!(
            "left-one-out error of the patches: {:.4} (plain pseudo-inverse {:.4})",
            ours.rmse, plain.rmse
        );
        for (index, (name, _)) in ours.delta_e.iter().enumerate() {
            println!(
                "mean ΔE00 under {name}: {:.2} ({:.2})",
                mean(&ours, index),
                mean(&plain, index)
            );
        }
    }
    args.to.say_written();
    Ok(())
}

/// The frame, linear above black, not finite where saturated.
fn linear_frame(path: &Path) -> Result<(Plane<f32>, Cfa)> {
    if path.is_dir() {
        let about: HdrFile = read_toml(&path.join("hdr.toml"))?;
        let mut frame = numpy::read_plane(&path.join("radiance.npy"))?;
        let flags = numpy::read_plane(&path.join("flags.npy"))?;
        for (value, flag) in frame.data.iter_mut().zip(&flags.data) {
            if *flag == f32::from(hdr::Flag::Saturated as u8) {
                *value = f32::INFINITY;
            }
        }
        return Ok((frame, Cfa::parse(&about.cfa)?));
    }
    let raw = camrig_formats::read(path)?.raw(0)?;
    let limit = raw.black_level_dn
        + response::SATURATION * (f64::from(raw.white_level_dn) - raw.black_level_dn);
    let linear = raw.data.iter().map(|&dn| match f64::from(dn) {
        dn if dn > limit => f32::INFINITY,
        dn => (dn - raw.black_level_dn) as f32,
    });
    let frame = Plane { width: raw.width, height: raw.height, data: linear.collect() };
    Ok((frame, raw.cfa))
}

/// Electrons per energy of the view's channels; `gr` and `gb` apart are averaged.
fn sensitivity(camera: &Camera, letters: &[char], bands: &Bands) -> Result<Vec<Vec<f64>>> {
    let all = camera.sensor.response(bands);
    let of_letter = |&letter: &char| {
        let letter = letter.to_lowercase().to_string();
        let own: Vec<&Vec<f64>> = camera
            .sensor
            .channel_names
            .iter()
            .zip(&all)
            .filter(|(name, _)| {
                **name == letter || (letter == "g" && matches!(name.as_str(), "gr" | "gb"))
            })
            .map(|(_, curve)| curve)
            .collect();
        if own.is_empty() {
            return Err(Error::input(format!("camera {} has no channel {letter}", camera.name))
                .help("use the camera file of the camera that took the frame"));
        }
        let lens = |b: usize| camera.lens.transmittance.at(bands.nm(b));
        Ok((0..bands.count)
            .map(|b| lens(b) * own.iter().map(|c| c[b]).sum::<f64>() / own.len() as f64)
            .collect())
    };
    letters.iter().map(of_letter).collect()
}

fn spectra(table: &SpectralTable, bands: &Bands) -> Result<Vec<Vec<f64>>> {
    let spectra = (0..table.curves.len()).map(|i| Ok(table.spectrum(i)?.in_bands(bands)));
    spectra.collect()
}
