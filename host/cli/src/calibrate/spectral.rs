//! `camrig scene spectral`.

use super::Output;
use crate::notes::Notes;
use camrig_base::{Bands, Error, Result};
use camrig_calibrate::reflectance::{
    LinearFrame, MeasuredChart, Reference, Reflectance, Settings, read_training,
};
use camrig_calibrate::spectral::{self, Report};
use camrig_calibrate::view::Region;
use camrig_camera::Camera;
use camrig_light::Illuminant;
use serde_json::json;
use std::path::PathBuf;

/// Estimate reflectance spectra from a camera's channels, with the light divided out
///
/// Writes the directory of a stored scene.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig scene spectral merged/ --camera cam.toml --illuminant D65 --chart 120,80,900,590 \
    -o scene/\n  \
    camrig scene spectral frame.dng --camera mt9v024 --illuminant A --white 40,40,30,30 \
    -o scene/")]
pub struct SpectralArgs {
    /// Directory from `scene hdr`, or a raw frame that states its black level and pattern
    frame: PathBuf,
    /// Camera file or preset, for its quantum efficiency
    #[arg(long, value_name = "C")]
    camera: String,
    /// Light on the scene, or auto: the one that fits the chart best
    #[arg(long, default_value = "D65", value_name = "I")]
    illuminant: String,
    /// Rectangle around the 24 patches of a ColorChecker, raw pixels
    #[arg(long, value_name = "X,Y,W,H", required_unless_present = "white")]
    chart: Option<Region>,
    /// Rectangle of a 90 % white, raw pixels
    #[arg(long, value_name = "X,Y,W,H", conflicts_with = "chart")]
    white: Option<Region>,
    /// Number of principal components, or auto: the number with the least cross-validation error
    #[arg(long, default_value = "6", value_name = "K")]
    components: String,
    /// Further training reflectances, fractions or per cent: CSV of wavelength_nm,NAME,...
    #[arg(long, value_name = "CSV")]
    training: Vec<PathBuf>,
    /// Relative noise assumed by the estimate
    #[arg(long, default_value_t = spectral::NOISE, value_parser = crate::arguments::positive)]
    noise: f64,
    /// A ColorChecker measured under one of several lights, the paper's own calibration: exitances
    /// of its 24 patches (CSV of wavelength_nm,NAME,...), a frame of it, and the rectangle around the
    /// patches. All lights on one scale, frames of one exposure and gain or from `scene hdr`; they
    /// replace the camera's quantum efficiency
    #[arg(long, value_name = "CSV,FRAME,X,Y,W,H", value_parser = exitance)]
    exitance: Vec<Exitance>,
    #[command(flatten)]
    to: Output,
}

/// What `--exitance` names.
#[derive(Clone, Debug)]
struct Exitance {
    csv: PathBuf,
    frame: PathBuf,
    chart: Region,
}

fn exitance(text: &str) -> Result<Exitance, String> {
    let parts: Vec<&str> = text.splitn(3, ',').collect();
    let [csv, frame, chart] = parts[..] else {
        return Err("give CSV,FRAME,X,Y,W,H".into());
    };
    let chart = chart.parse()?;
    Ok(Exitance { csv: csv.into(), frame: frame.into(), chart })
}

/// Runs `scene spectral`.
pub fn spectral(args: &SpectralArgs) -> Result<()> {
    let output = args.to.create()?;
    let frame = LinearFrame::read(&args.frame)?;
    let camera = camrig_render::with_filter_angles(Camera::load(&args.camera)?)?;
    let mut training = Vec::new();
    for path in &args.training {
        let (spectra, notes) = read_training(path)?;
        notes.iter().for_each(|note| eprintln!("note: {note}"));
        training.extend(spectra);
    }
    let measured = |e: &Exitance| MeasuredChart::read(&e.csv, &e.frame, &e.chart);
    let exitances = args.exitance.iter().map(measured).collect::<Result<Vec<_>>>()?;
    let settings = Settings {
        exitances: &exitances,
        reference: args.reference()?,
        lights: args.lights()?,
        components: args.components()?,
        training: &training,
        noise: args.noise,
    };
    let estimate = Reflectance::estimate(&frame, &camera, &settings)?;
    let [first, last] = [0, Bands::VISIBLE.count - 1].map(|band| Bands::VISIBLE.edges_nm(band));
    let known = [first[0], last[1]];
    let beyond = camrig_render::light_beyond_a_chart(&camera, &estimate.light, known);
    Notes::default().tell(beyond);
    let name = args.to.output.file_name().and_then(|n| n.to_str()).unwrap_or("scene");
    let light = &estimate.light.name;
    let source = format!("{} seen by {} under {light}", args.frame.display(), camera.name);
    estimate.write(output.path(), name, source)?;
    output.finish()?;
    let (ours, plain) = (&estimate.leave_one_out, &estimate.pseudo_inverse);
    if args.to.json {
        let object = json!({
            "illuminant": light, "components": estimate.components, "white": estimate.white,
            "chart_residual": estimate.chart_residual, "leave_one_out": ours,
            "pseudo_inverse": plain,
        });
        println!("{object}");
    } else {
        println!("light {light}, {} components", estimate.components);
        println!(
            "leave-one-out error of the patches: {:.4} (plain pseudo-inverse {:.4})",
            ours.rmse, plain.rmse
        );
        for (index, (name, _)) in ours.delta_e.iter().enumerate() {
            println!(
                "mean ΔE00 under {name}: {:.2} ({:.2})",
                mean_delta_e(ours, index),
                mean_delta_e(plain, index)
            );
        }
    }
    args.to.say_written();
    Ok(())
}

impl SpectralArgs {
    fn reference(&self) -> Result<Reference> {
        match (self.chart, self.white) {
            (Some(region), _) => Ok(Reference::Chart(region)),
            (None, Some(region)) => Ok(Reference::White(region)),
            (None, None) => Err(Error::input("neither --chart nor --white")),
        }
    }

    fn lights(&self) -> Result<Vec<Illuminant>> {
        match self.illuminant.as_str() {
            "auto" if self.chart.is_none() => {
                Err(Error::input("--illuminant auto without a chart")
                    .help("give --chart, or name the light"))
            }
            "auto" => Illuminant::names().iter().map(|n| Illuminant::parse(n)).collect(),
            name => Ok(vec![Illuminant::parse(name)?]),
        }
    }

    /// `None` for the number with the least error.
    fn components(&self) -> Result<Option<usize>> {
        match self.components.as_str() {
            "auto" => Ok(None),
            text => text.parse().map(Some).map_err(|_| {
                Error::input(format!("--components {text}")).help("give a number or auto")
            }),
        }
    }
}

fn mean_delta_e(report: &Report, light: usize) -> f64 {
    let list = &report.delta_e[light].1;
    list.iter().sum::<f64>() / list.len() as f64
}
