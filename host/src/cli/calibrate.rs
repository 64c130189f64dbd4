//! `camrig scene response`, `hdr`, `spectral`: scenes from a real camera.

use crate::camera::{Camera, Cfa};
use crate::captures::CaptureSet;
use crate::formats::output::OutputDir;
use crate::report::plot::{Mark, Plot};
use crate::scene::calibrate::exposures::{self, Series};
use crate::scene::calibrate::hdr;
use crate::scene::calibrate::response::{self, Response};
use crate::scene::calibrate::spectral::{self, Channels, Estimator, Method};
use crate::scene::calibrate::view::{Region, View, fit_chart};
use crate::scene::chart::colorchecker;
use crate::scene::numpy;
use crate::scene::stored::{self, Description};
use crate::scene::table::SpectralTable;
use crate::scene::{Bands, Illuminant, Quantity};
use crate::{Error, Plane, Result};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Which frames, and what is known of the sensor.
#[derive(clap::Args, Debug)]
struct Source {
    /// Capture set: directory with captures.toml
    captures: PathBuf,
    /// Captures to use; all that show something unless given
    #[arg(long, value_delimiter = ',', value_name = "ID,...")]
    only: Vec<String>,
    /// Colour filter pattern, where the capture set does not say it
    #[arg(long, value_name = "PATTERN")]
    cfa: Option<String>,
}

impl Source {
    fn read(&self) -> Result<(Vec<Series>, Cfa, f64)> {
        let set = CaptureSet::load(&self.captures)?;
        let cfa = match &self.cfa {
            Some(text) => Cfa::parse(text).map_err(|e| e.at("--cfa"))?,
            None => set.cfa(),
        };
        let black = set.sensor.black_level_dn.unwrap_or(0.0);
        let full_scale = f64::from(set.sensor.white_level_dn) - black;
        let series =
            exposures::read(&set, &self.only).map_err(|e| e.at(self.captures.display()))?;
        Ok((series, cfa, full_scale))
    }
}

/// Find the response curve of each channel from a view at several exposures (Debevec and Malik)
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  camrig scene response chart-at-seven-exposures -o response/")]
pub struct ResponseArgs {
    #[command(flatten)]
    source: Source,
    /// Output directory: response.toml for `scene hdr`, response.svg
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace existing output
    #[arg(long)]
    force: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ResponseFile {
    format: String,
    response: Vec<Response>,
}

/// Runs `scene response`.
pub fn response(args: &ResponseArgs) -> Result<()> {
    let output = OutputDir::create(&args.output, args.force)?;
    let (series, cfa, full_scale) = args.source.read()?;
    let responses = response::fit(&series, &cfa, full_scale)?;
    let spread = response::spread(&responses);
    let file = ResponseFile { format: "response/1".into(), response: responses.clone() };
    let text = toml::to_string(&file).map_err(|e| Error::input(format!("response.toml: {e}")))?;
    output.write("response.toml", text.as_bytes())?;
    let mut plot =
        Plot::new("Camera response", "log10 exposure (DN of a linear camera)", "DN above black");
    for r in &responses {
        let [first, last] = r.range_dn;
        let points = (0..=200).map(|i| first * (last / first).powf(f64::from(i) / 200.0));
        let points = points.map(|dn| [r.linear_dn(dn).log10(), dn]).collect();
        plot.coloured(channel_name(r.channel), Mark::Line, points, channel_colour(r.channel));
    }
    let svg = plot.svg();
    output.write("response.svg", svg.as_bytes())?;
    output.finish()?;
    if args.json {
        let channels: serde_json::Map<String, serde_json::Value> = responses
            .iter()
            .map(|r| {
                let figures = json!({
                    "samples": r.samples,
                    "range_dn": r.range_dn,
                    "residual_percent": r.residual_percent,
                    "departure_from_linear_percent": 100.0 * r.departure_from_linear(),
                });
                (r.channel.to_lowercase().to_string(), figures)
            })
            .collect();
        println!("{}", json!({ "channels": channels, "curve_spread_percent": 100.0 * spread }));
    } else {
        for r in &responses {
            println!(
                "{}: {} samples from {:.1} to {:.1} DN, residual {:.2} %, departs from linear by {:.2} %",
                channel_name(r.channel),
                r.samples,
                r.range_dn[0],
                r.range_dn[1],
                r.residual_percent,
                100.0 * r.departure_from_linear()
            );
        }
        println!("curves lie within {:.2} % of each other", 100.0 * spread);
    }
    eprintln!("wrote {}", args.output.display());
    Ok(())
}

fn channel_name(letter: char) -> &'static str {
    match letter {
        'R' => "red",
        'G' => "green",
        'B' => "blue",
        _ => "channel",
    }
}

fn channel_colour(letter: char) -> &'static str {
    match letter {
        'R' => "#c22",
        'G' => "#282",
        'B' => "#22c",
        _ => "#222",
    }
}

/// Merge several exposures of a still view to one linear frame
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  camrig scene hdr exposures/ -o merged/")]
pub struct HdrArgs {
    #[command(flatten)]
    source: Source,
    /// response.toml of `scene response`, for a camera that is not linear
    #[arg(long, value_name = "FILE")]
    response: Option<PathBuf>,
    /// Luminance meter reading of a region, X,Y,W,H=CD: makes the scale absolute
    #[arg(long, value_name = "X,Y,W,H=CD")]
    luminance: Option<String>,
    /// Output directory: radiance.npy (DN/s), sigma.npy, flags.npy, hdr.toml
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace existing output
    #[arg(long)]
    force: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct HdrFile {
    format: String,
    cfa: String,
    view: String,
    exposures: Vec<String>,
    shifts: Vec<[i64; 2]>,
    noise_gain_dn: f64,
    noise_read_dn2: f64,
    dynamic_range_db: f64,
    moved_fraction: f64,
    saturated_fraction: f64,
    /// cd/m² per DN/s of green, where a reading was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    luminance_per_dn_s: Option<f64>,
}

/// Runs `scene hdr`.
pub fn hdr(args: &HdrArgs) -> Result<()> {
    let output = OutputDir::create(&args.output, args.force)?;
    let (series, cfa, full_scale) = args.source.read()?;
    let [series] = &series[..] else {
        let names: Vec<&str> = series.iter().map(|s| s.name.as_str()).collect();
        return Err(Error::input(format!("{} views in the capture set", series.len())).help(
            format!("choose the captures of one with --only; there are {}", names.join("; ")),
        ));
    };
    let responses = match &args.response {
        Some(path) => read_toml::<ResponseFile>(path)?.response,
        None => Vec::new(),
    };
    let merged = hdr::merge(series, &cfa, full_scale, &responses)?;
    let luminance_per_dn_s = args
        .luminance
        .as_deref()
        .map(|text| absolute_scale(text, &merged.radiance, &cfa))
        .transpose()?;
    let fraction = |flag: hdr::Flag| {
        let count = merged.flags.data.iter().filter(|&&f| f == flag as u8).count();
        count as f64 / merged.flags.data.len() as f64
    };
    let about = HdrFile {
        format: "hdr/1".into(),
        cfa: cfa.to_string(),
        view: series.name.clone(),
        exposures: series.exposures.iter().map(|e| e.id.clone()).collect(),
        shifts: merged.shifts.iter().map(|s| s.map(|v| v as i64)).collect(),
        noise_gain_dn: merged.noise.gain_dn,
        noise_read_dn2: merged.noise.read_dn2,
        dynamic_range_db: merged.dynamic_range_db,
        moved_fraction: fraction(hdr::Flag::Moved),
        saturated_fraction: fraction(hdr::Flag::Saturated),
        luminance_per_dn_s,
    };
    output.write("radiance.npy", &numpy::encode(&merged.radiance, "<f4", f32::to_le_bytes))?;
    output.write("sigma.npy", &numpy::encode(&merged.sigma, "<f4", f32::to_le_bytes))?;
    output.write("flags.npy", &numpy::encode(&merged.flags, "|u1", u8::to_le_bytes))?;
    let text = toml::to_string(&about).map_err(|e| Error::input(format!("hdr.toml: {e}")))?;
    output.write("hdr.toml", text.as_bytes())?;
    output.finish()?;
    for (id, shift) in about.exposures.iter().zip(&about.shifts).filter(|(_, s)| **s != [0, 0]) {
        eprintln!("note: capture {id} was shifted by {shift:?} pixels, corrected");
    }
    if about.moved_fraction > 0.0 {
        eprintln!(
            "note: {:.2} % of the pixels show movement and come from one exposure (flags.npy = 1)",
            100.0 * about.moved_fraction
        );
    }
    if args.json {
        println!("{}", json!(about));
    } else {
        println!(
            "{}: {} exposures, {:.1} dB; noise {:.3} DN²/DN, {:.2} DN² read",
            about.view,
            about.exposures.len(),
            about.dynamic_range_db,
            about.noise_gain_dn,
            about.noise_read_dn2
        );
    }
    eprintln!("wrote {}", args.output.display());
    Ok(())
}

fn read_toml<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io("read", path, e))?;
    toml::from_str(&text)
        .map_err(|e| Error::input(e.to_string().trim_end().to_string()).at(path.display()))
}

/// cd/m² per DN/s from `X,Y,W,H=CD`, by the green channel (the only one of a mono camera).
fn absolute_scale(text: &str, radiance: &Plane<f32>, cfa: &Cfa) -> Result<f64> {
    let wrong = || {
        Error::input(format!("--luminance {text}"))
            .help("give X,Y,W,H=CD, for instance 10,10,50,50=80")
    };
    let (region, reading) = text.split_once('=').ok_or_else(wrong)?;
    let region: Region = region.parse().map_err(|_| wrong())?;
    let reading: f64 = reading.parse().ok().filter(|v| *v > 0.0).ok_or_else(wrong)?;
    let view = View::new(radiance, cfa);
    let green = view.letters.iter().position(|&l| l == 'G').unwrap_or(0);
    Ok(reading / view.mean(&region, "the reading's region")?[green])
}

/// Reflectance spectra from a camera's channels, with the light taken out
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
    #[arg(long, default_value_t = spectral::NOISE, value_parser = super::arguments::positive)]
    noise: f64,
    /// Output: directory of a stored scene
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace existing output
    #[arg(long)]
    force: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Reflectance of the white that `--white` points at.
const WHITE: f64 = 0.9;

/// Runs `scene spectral`.
pub fn spectral(args: &SpectralArgs) -> Result<()> {
    let output = OutputDir::create(&args.output, args.force)?;
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
    let name = args.output.file_name().and_then(|n| n.to_str()).unwrap_or("scene");
    let mut about = Description::new(name, Quantity::Reflectance, (width, height), &bands);
    about.source = format!("{} seen by {} under {}", args.frame.display(), camera.name, light.name);
    about.description = format!("reflectance estimated from {} channels", view.letters.len());
    stored::write(output.path(), &about, |band| {
        Ok(Plane { width, height, data: estimator.band(band, &planes) })
    })?;
    output.finish()?;

    let mean = |report: &spectral::Report, light: usize| {
        let list = &report.delta_e[light].1;
        list.iter().sum::<f64>() / list.len() as f64
    };
    if args.json {
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
    eprintln!("wrote {}", args.output.display());
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
    let raw = crate::formats::read(path)?.raw(0)?;
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
