//! `camrig scene`: lists, shows, stores and exports scenes.

use super::scene_info::{ANY_ASPECT, CHART_WIDTH, InfoArgs, info, whole};
use super::{arguments, calibrate};
use camrig_base::numbers::counted;
use camrig_base::output;
use camrig_base::output::OutputDir;
use camrig_base::{Error, Result};
use camrig_formats::png;
use camrig_light::photometry::white_radiance;
use camrig_light::{Illuminant, LightLevel};
use camrig_render::{DEFAULT_ILLUMINANT, radiance_at};
use camrig_scene::level::check_absolute;
use camrig_scene::{Quantity, Scene, chart, preview};
use camrig_scene_files::library::{Library, describe};
use camrig_scene_files::{envi, isetcam};
use clap::Subcommand;
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Prints a line; a closed pipe (`| head`) is not an error.
macro_rules! say {
    ($($text:tt)*) => {{
        let _ = writeln!(std::io::stdout(), $($text)*);
    }};
}

/// List, show, store and export scenes; make scenes from raw frames
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand, Debug)]
enum Verb {
    List(ListArgs),
    Info(InfoArgs),
    Show(ShowArgs),
    Add(AddArgs),
    Export(ExportArgs),
    Response(calibrate::ResponseArgs),
    Hdr(calibrate::HdrArgs),
    Spectral(calibrate::SpectralArgs),
}

/// List charts, illuminants and the scenes of a library
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig scene list my-scenes")]
struct ListArgs {
    /// Library directory
    library: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Write an sRGB picture of a scene in a given light
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig scene show colorchecker --illuminant A -o chart.png")]
struct ShowArgs {
    /// Chart, spectral cube, picture or scene directory
    scene: String,
    /// Light on a reflectance scene [default: D65]
    #[arg(long, value_name = "I")]
    illuminant: Option<String>,
    /// Longer side, pixels
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=65_535))]
    size: u32,
    /// Output .png
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Replace existing output
    #[arg(long)]
    force: bool,
}

/// Store a spectral cube in a library
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig scene add cube.mat --library my-scenes --name street")]
struct AddArgs {
    /// Spectral cube: .npy, .npz, .hdr, .mat, .h5, .exr, .tif, a folder of pictures, one per band;
    /// a picture: .png, .jpg, .tif, .exr, .hdr; or a scene directory
    scene: String,
    /// Library directory; created if it does not exist
    #[arg(long, value_name = "DIR")]
    library: PathBuf,
    /// Name in the library
    #[arg(long)]
    name: String,
    /// What the scene shows
    #[arg(long, default_value = "")]
    description: String,
    /// Source of the scene
    #[arg(long, default_value = "")]
    source: String,
    /// Terms of use
    #[arg(long, default_value = "")]
    licence: String,
    /// Replace a scene of that name
    #[arg(long)]
    force: bool,
}

/// Write a scene for other programs: ENVI (.hdr with .img) or ISETCam (.mat); of a ColorChecker
/// also its reflectances as a table (-patches.csv)
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig scene export my-scenes/street -o envi/\n  \
                        camrig scene export colorchecker --format mat --width 640 -o chart/")]
struct ExportArgs {
    /// Chart, spectral cube, picture or scene directory
    scene: String,
    /// File format
    #[arg(long, value_enum, default_value_t)]
    format: ExportFormat,
    /// Columns [default: those of a cube, 640 for charts]
    #[arg(long)]
    width: Option<usize>,
    /// Light of an exported ISETCam scene of reflectances [default: D65]
    #[arg(long, value_name = "I")]
    illuminant: Option<String>,
    /// Luminance of a perfect white, cd/m² [default: 100]; a radiance picture is scaled so that its
    /// white has it, other radiance scenes so that their mean is 18 % grey
    #[arg(long, value_parser = arguments::positive, value_name = "L")]
    luminance: Option<f64>,
    /// Output directory
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace existing output
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
enum ExportFormat {
    /// ENVI header and band-sequential float data
    #[default]
    Envi,
    /// ISETCam scene, MATLAB version 5
    Mat,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    match &args.verb {
        Verb::List(args) => list(args),
        Verb::Info(args) => info(args),
        Verb::Show(args) => show(args),
        Verb::Add(args) => add(args),
        Verb::Export(args) => export(args),
        Verb::Response(args) => calibrate::response(args),
        Verb::Hdr(args) => calibrate::hdr(args),
        Verb::Spectral(args) => calibrate::spectral(args),
    }?;
    Ok(ExitCode::SUCCESS)
}

fn list(args: &ListArgs) -> Result<()> {
    let stored = match &args.library {
        Some(directory) => Library::open(directory)?.scenes()?,
        None => Vec::new(),
    };
    if args.json {
        let scenes: Vec<_> = stored
            .iter()
            .map(|(path, about)| json!({ "path": path.display().to_string(), "about": about }))
            .collect();
        let illuminants = Illuminant::names();
        let object =
            json!({ "charts": chart::NAMES, "illuminants": illuminants, "scenes": scenes });
        say!("{object}");
        return Ok(());
    }
    say!("charts: {}", chart::NAMES.join(", "));
    say!("illuminants: {}, D4000K to D25000K, blackbody:KELVIN", Illuminant::names().join(", "));
    for (path, about) in stored {
        say!(
            "{}: {} x {} pixels, {}, {}{}{}",
            path.display(),
            about.width,
            about.height,
            counted(about.bands, "band"),
            about.quantity,
            if about.description.is_empty() { "" } else { "; " },
            about.description
        );
    }
    Ok(())
}

fn show(args: &ShowArgs) -> Result<()> {
    let scene = camrig_scene_files::open(&args.scene)?;
    if args.illuminant.is_some() {
        takes_illuminant(&*scene)?;
    }
    let light = Illuminant::parse(args.illuminant.as_deref().unwrap_or(DEFAULT_ILLUMINANT))?;
    let picture = preview::render(&*scene, &light, args.size as usize)?;
    for note in scene.notes() {
        eprintln!("note: {note}");
    }
    output::write_file(&args.output, args.force, &png::encode_rgb(&picture)?)?;
    eprintln!("wrote {}", args.output.display());
    Ok(())
}

/// Refuses an illuminant for a scene that includes its light.
fn takes_illuminant(scene: &dyn Scene) -> Result<()> {
    match scene.quantity() {
        Quantity::Reflectance => Ok(()),
        Quantity::Radiance => Err(Error::input("--illuminant for a radiance scene")
            .help("it includes its light; omit --illuminant")),
    }
}

fn add(args: &AddArgs) -> Result<()> {
    let cube = camrig_scene_files::open_file(&args.scene)?;
    let mut about = describe(&cube, &args.name);
    about.description.clone_from(&args.description);
    about.source.clone_from(&args.source);
    about.licence.clone_from(&args.licence);
    let bar = arguments::progress("bands", about.bands as u64);
    let mut library = Library::open_or_new(&args.library)?;
    let place = library.add(&cube, &about, args.force, |band| bar.set_position(band as u64))?;
    bar.finish_and_clear();
    for note in cube.notes() {
        eprintln!("note: {note}");
    }
    eprintln!("wrote {}", place.display());
    Ok(())
}

fn export(args: &ExportArgs) -> Result<()> {
    let output = OutputDir::create(&args.output, args.force)?;
    let (scene, size) = camrig_scene_files::open_with_size(&args.scene)?;
    let width = args.width.or(size.map(|s| s.0)).unwrap_or(CHART_WIDTH);
    if !(1..=100_000).contains(&width) {
        return Err(Error::limit(format!("--width {width}")).help("give 1 to 100000 pixels"));
    }
    let grid = whole(&*scene, width);
    let bands = scene.bands();
    let (factor, scaled) = level(args, &*scene)?;
    let bar = arguments::progress("bands", bands.count as u64);
    let band = |index: usize| {
        bar.set_position(index as u64);
        let mut plane = scene.plane(index, &grid)?;
        if factor != 1.0 {
            plane.data.iter_mut().for_each(|v| *v *= factor);
        }
        Ok(plane)
    };
    let name = args.scene.split(':').next().unwrap_or(&args.scene);
    let name = Path::new(name).file_stem().and_then(|s| s.to_str()).unwrap_or("scene");
    match args.format {
        ExportFormat::Envi => {
            let path = output.path().join(format!("{name}.hdr"));
            envi::write(&path, (grid.width, grid.height), &bands, scene.quantity(), band)?;
        }
        ExportFormat::Mat => {
            let white = match scene.quantity() {
                Quantity::Reflectance => {
                    let light = args.illuminant.as_deref().unwrap_or(DEFAULT_ILLUMINANT);
                    let level = args.luminance.unwrap_or(EXPORT_LUMINANCE);
                    let light = Illuminant::parse(light)?;
                    Some(white_radiance(&light, LightLevel::Luminance(level), &bands)?)
                }
                Quantity::Radiance => None,
            };
            let path = output.path().join(format!("{name}.mat"));
            isetcam::write(&path, name, &bands, white.as_deref(), band)?;
        }
    }
    if let Some(patches) = chart::colorchecker::file(name) {
        output::write_file(
            &output.path().join(format!("{name}-patches.csv")),
            false,
            patches.as_bytes(),
        )?;
    }
    bar.finish_and_clear();
    for note in scene.notes().into_iter().chain(scaled) {
        eprintln!("note: {note}");
    }
    output.finish()?;
    eprintln!("wrote {}", args.output.display());
    Ok(())
}

/// Luminance of a perfect white in an exported ISETCam scene, cd/m²: that of ISETCam's own.
const EXPORT_LUMINANCE: f64 = 100.0;

/// The factor that scales an exported radiance scene to the requested level, with a note. Refuses
/// light that would not be applied.
fn level(args: &ExportArgs, scene: &dyn Scene) -> Result<(f32, Option<String>)> {
    if args.illuminant.is_some() {
        takes_illuminant(scene)?;
    }
    if scene.quantity() == Quantity::Radiance {
        let Some(level) = args.luminance.map(LightLevel::Luminance) else {
            check_absolute(scene)?;
            return Ok((1.0, None));
        };
        let aspect = scene.aspect().unwrap_or(ANY_ASPECT);
        let (factor, note) = radiance_at(scene, &args.scene, aspect, level)?;
        return Ok((factor as f32, Some(note)));
    }
    let mat = matches!(args.format, ExportFormat::Mat);
    if !mat && (args.illuminant.is_some() || args.luminance.is_some()) {
        return Err(Error::input("light for an ENVI file of reflectances")
            .help("it stores no light; omit --illuminant and --luminance, or use --format mat"));
    }
    Ok((1.0, None))
}
