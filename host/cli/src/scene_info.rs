//! `camrig scene info`: shows on one screen how a scene was read, what was assumed and ignored, and
//! the range of its bands.

use super::{arguments, screen};
use camrig_base::Result;
use camrig_base::numbers::counted;
use camrig_scene as scene;
use camrig_scene::cube::Cube;
use camrig_scene::{Grid, Quantity, Scene, chart};
use serde_json::json;
use std::io::Write;

/// Show the contents of a scene: size, bands, range of values
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig scene info cube.hdr --json")]
pub struct InfoArgs {
    /// Chart, spectral cube, picture or scene directory
    scene: String,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn info(args: &InfoArgs) -> Result<()> {
    let Opened { scene, size, understood } = open(&args.scene)?;
    let grid = whole(&*scene, size.map_or(CHART_WIDTH, |(width, _)| width));
    let figures = figures(&*scene, &grid)?;
    let quantity = scene.quantity().name();
    let mut notes = scene.notes();
    let above = figures.iter().filter(|f| f.3 > 1.0).count();
    if scene.quantity() == Quantity::Reflectance && above > 0 {
        notes.push(format!(
            "reflectance above 1 in {}: highlights, or a wrong scale",
            counted(above, "band")
        ));
    }
    let mut out = std::io::stdout();
    if args.json {
        let per_band: Vec<_> = figures
            .iter()
            .map(|(nm, min, mean, max)| {
                json!({ "wavelength_nm": nm, "min": min, "mean": mean, "max": max })
            })
            .collect();
        let bands = scene.bands();
        let object = json!({
            "scene": args.scene, "quantity": quantity,
            "width": size.map(|s| s.0), "height": size.map(|s| s.1),
            "start_nm": bands.start_nm, "step_nm": bands.step_nm, "bands": per_band,
            "understood": understood, "notes": notes,
        });
        // A closed pipe (`| head`) is not an error.
        let _ = writeln!(out, "{object}");
        return Ok(());
    }
    let name = &args.scene;
    let mut lines = screen::wrapped(&match size {
        Some((width, height)) => format!("{name}: {width} x {height} pixels, {quantity}"),
        None => format!("{name}: chart, any size, {quantity}"),
    });
    lines.extend(understood.iter().flat_map(|line| screen::wrapped(&format!("read as: {line}"))));
    let notes: Vec<String> =
        notes.iter().flat_map(|note| screen::wrapped(&format!("note: {note}"))).collect();
    lines.push("wavelength_nm      min     mean      max".into());
    let step = screen::one_in(figures.len(), lines.len() + notes.len());
    lines.extend(figures.iter().step_by(step).map(|(nm, min, mean, max)| {
        // Radiance in W m⁻² sr⁻¹ nm⁻¹ may have any magnitude.
        match (1e-3..1e5).contains(max) || *max == 0.0 {
            true => format!("{nm:13} {min:8.4} {mean:8.4} {max:8.4}"),
            false => format!("{nm:13} {min:8.1e} {mean:8.1e} {max:8.1e}"),
        }
    }));
    if step > 1 {
        lines.push(format!("(one in {step} of {} bands; --json has all)", figures.len()));
    }
    lines.iter().for_each(|line| drop(writeln!(out, "{line}")));
    notes.iter().for_each(|note| eprintln!("{note}"));
    Ok(())
}

/// A scene with its size in pixels, if it has one, and how it was read.
struct Opened {
    scene: Box<dyn Scene>,
    size: Option<(usize, usize)>,
    understood: Vec<String>,
}

fn open(spec: &str) -> Result<Opened> {
    if scene::is_file(spec) {
        let cube: Cube = camrig_scene_files::open_file(spec)?;
        let (size, understood) = (Some(cube.size()), cube.understood().to_vec());
        return Ok(Opened { scene: Box::new(cube), size, understood });
    }
    let (name, options) = spec.split_once(':').unwrap_or((spec, ""));
    match chart::open_told(name, options) {
        Some(told) => {
            let (scene, understood) = told.map_err(|e| e.at(format!("scene {spec:?}")))?;
            Ok(Opened { scene, size: None, understood })
        }
        None => Ok(Opened {
            scene: camrig_scene_files::open(spec)?,
            size: None,
            understood: Vec::new(),
        }),
    }
}

/// Wavelength in nm, and minimum, mean and maximum of each band.
fn figures(scene: &dyn Scene, grid: &Grid) -> Result<Vec<(f64, f32, f64, f32)>> {
    let bands = scene.bands();
    let bar = arguments::progress("bands", bands.count as u64);
    let mut figures = Vec::new();
    for band in 0..bands.count {
        let plane = scene.plane(band, grid)?;
        let least = plane.data.iter().fold(f32::INFINITY, |a, &b| a.min(b));
        let most = plane.data.iter().fold(0.0, |a: f32, &b| a.max(b));
        let sum: f64 = plane.data.iter().map(|&v| f64::from(v)).sum();
        figures.push((bands.nm(band), least, sum / plane.data.len() as f64, most));
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(figures)
}

/// Width in cells of the grid on which charts are sampled. A trade-off: a chart's figures hardly
/// change with more cells, and it is drawn quickly.
pub const CHART_WIDTH: usize = 640;

/// Aspect ratio of the grid for scenes of any size.
pub const ANY_ASPECT: f64 = 4.0 / 3.0;

/// A grid over the whole scene, `width` cells across.
pub fn whole(scene: &dyn Scene, width: usize) -> Grid {
    let cell = 1.0 / width as f64;
    let height = (width as f64 / scene.aspect().unwrap_or(ANY_ASPECT)).round().max(1.0) as usize;
    Grid { width, height, left: -0.5, top: -0.5 * height as f64 * cell, cell }
}
