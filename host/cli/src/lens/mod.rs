//! `camrig lens`: characterises lenses from prescriptions or exported files, shows their figures.

mod show;
mod tolerance;

use super::arguments;
use camrig_base::output::OutputDir;
use camrig_base::{Bands, Error, Result};
use camrig_lens::characterise::{self, Plan, PsfMethod};
use camrig_lens::field::PlanePlan;
use camrig_lens::heights::Density;
use camrig_lens::prescription::{Conditions, FieldKind, Focus, Glass, Setup};
use camrig_lens::{System, field};
use camrig_optics::{Between, Characterisation, Options};
use camrig_report::lens as report;
use clap::builder::TypedValueParser;
use show::{
    figures, info, info_of_directory, map_json, place_json, plane_summary, point_json,
    print_places, print_points, summary,
};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Characterise a lens from its prescription or from exported files
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand, Debug)]
enum Command {
    Trace(TraceArgs),
    Import(ImportArgs),
    Tolerance(tolerance::ToleranceArgs),
    Info(InfoArgs),
    Plot(PlotArgs),
}

/// Trace a prescription (.zmx, .seq, .toml): figures per field and wavelength, or a whole
/// characterisation
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig lens trace triplet.zmx --fields 0,5,10 --wavelengths 450,550,650 --json\n  \
    camrig lens trace freeform.zmx --fields 0:0,3:4,-3:4\n  \
    camrig lens trace phone.toml --wavelengths 400:10:700 -o phone-lens")]
struct TraceArgs {
    #[command(flatten)]
    lens: LensArgs,
    /// Fields, degrees, or X:Y off the y axis [default: those of the file]
    #[arg(
        long,
        value_name = "DEG,...",
        value_delimiter = ',',
        allow_hyphen_values = true,
        value_parser = field_angles
    )]
    fields: Option<Vec<[f64; 2]>>,
    /// Wavelengths, nm, or first:step:last [default: those of the file; 400:10:700 with -o]
    #[arg(long, value_name = "NM,...", value_delimiter = ',', value_parser = wavelengths)]
    wavelengths: Option<Vec<Wavelengths>>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
    /// Write a characterisation into this directory
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Initial number of image heights of the characterisation; a lens without rotational symmetry
    /// has a grid of places instead
    #[arg(
        long,
        default_value_t = 21,
        value_name = "N",
        value_parser = clap::value_parser!(u16).range(2..=512)
    )]
    heights: u16,
    /// Largest field of the characterisation, degrees [default: that of the file]
    #[arg(long, value_name = "DEG", value_parser = arguments::positive)]
    max_field: Option<f64>,
    /// PSF samples per side
    #[arg(
        long,
        default_value_t = 128,
        value_name = "N",
        value_parser = clap::value_parser!(u16).range(8..=512)
    )]
    psf_size: u16,
    /// Spacing of PSF samples, µm [default: chosen to fit the spots]
    #[arg(long, value_name = "UM", value_parser = arguments::positive)]
    psf_spacing: Option<f64>,
    /// How PSFs are computed
    #[arg(long, value_parser = psf_method(), default_value_t)]
    psf: PsfMethod,
    /// Add heights until PSFs interpolated halfway between two heights misplace at most this
    /// fraction of their light, on average over the field
    #[arg(
        long,
        default_value_t = Options::default().misplaced_light,
        value_name = "PART",
        value_parser = arguments::positive
    )]
    psf_tolerance: f64,
    /// Pixel pitch for that tolerance, µm
    #[arg(long, default_value_t = 1.4, value_name = "UM", value_parser = arguments::positive)]
    pixel: f64,
    /// Replace an existing characterisation
    #[arg(long)]
    force: bool,
}

/// A prescription and the settings of its use.
#[derive(clap::Args, Debug)]
struct LensArgs {
    /// Lens prescription: .zmx, .seq or .toml
    file: PathBuf,
    /// Object distance in front of the first surface, mm, or inf [default: that of the file]
    #[arg(long, value_name = "MM")]
    object_distance: Option<f64>,
    /// Focus at this distance by moving the sensor, mm, or inf
    #[arg(long, value_name = "MM", conflicts_with = "focus_mtf")]
    focus_distance: Option<f64>,
    /// Focus where the MTF on the axis at this frequency is largest, cycles per mm
    #[arg(long, value_name = "PER_MM", value_parser = arguments::positive)]
    focus_mtf: Option<f64>,
    /// Move the sensor away from the lens by this much, mm
    #[arg(long, default_value_t = 0.0, value_name = "MM", allow_negative_numbers = true)]
    sensor_shift: f64,
    /// Radius of the stop, mm [default: from the file's aperture]
    #[arg(long, value_name = "MM", value_parser = arguments::positive)]
    stop_radius: Option<f64>,
    /// Wavelength of paraxial figures and of the stop's radius, nm [default: that of the file]
    #[arg(long, value_name = "NM", value_parser = arguments::positive)]
    reference: Option<f64>,
    /// Configuration of a file with several, by number or title [default: the active one]
    #[arg(long, value_name = "NAME")]
    configuration: Option<String>,
    /// Glass catalogue (.agf) or a folder of them; repeatable
    #[arg(long, value_name = "PATH")]
    glass_catalogue: Vec<PathBuf>,
    /// Unknown glass, as NAME=n_d:V_d; repeatable
    #[arg(long, value_name = "NAME=ND:VD", value_parser = glass)]
    glass: Vec<(String, Glass)>,
}

impl LensArgs {
    fn setup(&self) -> Setup {
        let focus = match (self.focus_distance, self.focus_mtf) {
            (Some(mm), _) => Focus::At(mm),
            (None, Some(per_mm)) => Focus::BestMtf(per_mm),
            (None, None) => Focus::AsDesigned,
        };
        Setup {
            file: self.file.clone(),
            glasses: self.glass.clone(),
            catalogues: self.glass_catalogue.clone(),
            configuration: self.configuration.clone(),
            conditions: Conditions {
                object_distance_mm: self.object_distance,
                focus,
                sensor_shift_mm: self.sensor_shift,
                stop_radius_mm: self.stop_radius,
                reference_nm: self.reference,
            },
        }
    }

    /// Refuses the settings of a prescription if the lens is a directory of tables.
    fn check_tables(&self) -> Result<()> {
        let given = [
            ("--object-distance", self.object_distance.is_some()),
            ("--focus-distance", self.focus_distance.is_some()),
            ("--focus-mtf", self.focus_mtf.is_some()),
            ("--sensor-shift", self.sensor_shift != 0.0),
            ("--stop-radius", self.stop_radius.is_some()),
            ("--reference", self.reference.is_some()),
            ("--configuration", self.configuration.is_some()),
            ("--glass-catalogue", !self.glass_catalogue.is_empty()),
            ("--glass", !self.glass.is_empty()),
        ];
        match given.into_iter().find(|(_, given)| *given) {
            None => Ok(()),
            Some((flag, _)) => Err(Error::input(format!("{flag} for a lens directory"))
                .at(self.file.display())
                .help("its tables are fixed once traced; give the prescription instead")),
        }
    }

    fn system(&self) -> Result<System> {
        let system = camrig_lens_files::system(&self.setup())?;
        for note in &system.prescription.notes {
            eprintln!("note: {note}");
        }
        Ok(system)
    }
}

fn psf_method() -> impl TypedValueParser<Value = PsfMethod> {
    arguments::choice(&PsfMethod::ALL, PsfMethod::name, |method| match method {
        PsfMethod::Auto => "Diffraction; geometric where the wavefront error is too large for it",
        PsfMethod::Diffraction => "Sum of plane waves",
        PsfMethod::Geometric => "Ray positions",
    })
}

fn glass(text: &str) -> Result<(String, Glass), String> {
    Glass::named(text).map_err(|e| e.to_string())
}

/// A field angle, or two as x:y, degrees.
fn field_angles(text: &str) -> Result<[f64; 2], String> {
    let (x, y) = text.split_once(':').unwrap_or(("0", text));
    let degrees = |text: &str| text.trim().parse::<f64>().ok().filter(|deg| deg.is_finite());
    degrees(x)
        .zip(degrees(y))
        .map(|(x, y)| [x, y])
        .ok_or_else(|| format!("{text:?}: give an angle in degrees, or two as x:y"))
}

/// A field of a rotationally symmetric lens: on y with its sign, elsewhere the distance from the
/// axis.
fn radial(&[x, y]: &[f64; 2]) -> f64 {
    if x == 0.0 { y } else { FieldKind::Angle.off_axis(x, y) }
}

/// Maximum number of steps of a wavelength range: 0.3 nm over the visible.
const MAX_STEPS: f64 = 1000.0;
/// Fraction of a step by which rounding may miss the end of a range.
const STEP_ROUNDING: f64 = 1e-9;
/// Image heights and PSF samples per side of the drawings: enough for curves without corners.
const DRAWN_HEIGHTS: usize = 11;
const DRAWN_PSF_SIZE: usize = 128;
/// Fields whose spots are drawn, as parts of the largest: axis, half the area, corner.
const DRAWN_FIELDS: [f64; 3] = [0.0, 0.7, 1.0];

/// One wavelength or a range of them.
#[derive(Clone, Debug)]
struct Wavelengths(Vec<f64>);

fn wavelengths(text: &str) -> Result<Wavelengths, String> {
    let parts: Result<Vec<f64>, String> = text.split(':').map(arguments::positive).collect();
    match parts?[..] {
        [nm] => Ok(Wavelengths(vec![nm])),
        [first, step, last] if last >= first && (last - first) / step <= MAX_STEPS => {
            let count = ((last - first) / step + STEP_ROUNDING).floor() as usize;
            Ok(Wavelengths((0..=count).map(|i| first + step * i as f64).collect()))
        }
        _ => Err(format!("{text:?}: give a wavelength in nm, or first:step:last")),
    }
}

/// All wavelengths of a list, each once, ascending.
fn rising(list: &[Wavelengths]) -> Vec<f64> {
    let mut all: Vec<f64> = list.iter().flat_map(|w| w.0.iter().copied()).collect();
    all.sort_by(f64::total_cmp);
    all.dedup();
    all
}

/// Show paraxial figures and surfaces of a prescription, or the contents of a characterisation
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig lens info triplet.zmx\n  \
    camrig lens info zoom.seq --surfaces\n  camrig lens info phone-lens --json")]
struct InfoArgs {
    #[command(flatten)]
    lens: LensArgs,
    /// List the surfaces of a prescription even if they do not fit on the screen
    #[arg(long, conflicts_with = "json")]
    surfaces: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Import the export of another lens program: an ISETCam ray-trace set, or a manifest of files
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig lens import exports/ISETPARMS.TXT -o my-lens\n  \
    camrig lens import listings.toml -o my-lens\n\n\
    A manifest names tables (CSV or Zemax listings) and PSFs (Zemax or CODE V listings, CSV, \
    NPY):\n  \
    format = \"camrig-lens-import/1\"\n  name = \"lens\"\n  efl_mm = 4.4\n  f_number = 2.0\n  \
    distortion = [\"real_height.csv\"]\n  relative_illumination = [\"illumination.csv\"]\n  \
    [[psf]]\n  height_mm = 0.0\n  wavelength_nm = 550.0\n  file = \"psf.txt\"\n  \
    spacing_um = 0.25")]
struct ImportArgs {
    /// Directory of an ISETCam set, its ISETPARMS.TXT, or a manifest (.toml)
    source: PathBuf,
    /// Write the characterisation into this directory
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace an existing characterisation
    #[arg(long)]
    force: bool,
}

/// Draw distortion, lateral colour, illumination, chief-ray angle, MTF, PSFs and (from a
/// prescription) spots as SVG files, and an HTML page with all of them
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig lens plot triplet.zmx -o plots\n  \
    camrig lens plot phone-lens -o plots --pixel 1.4")]
struct PlotArgs {
    #[command(flatten)]
    lens: LensArgs,
    /// Write the drawings into this directory
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Largest field, degrees [default: that of the file]
    #[arg(long, value_name = "DEG", value_parser = arguments::positive)]
    max_field: Option<f64>,
    /// Pixel pitch of the sensor, µm: adds Nyquist, and lateral colour in pixels
    #[arg(long, value_name = "UM", value_parser = arguments::positive)]
    pixel: Option<f64>,
    /// Replace an existing directory of drawings
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    match &args.command {
        Command::Trace(args) => trace(args)?,
        Command::Import(args) => import_files(args)?,
        Command::Tolerance(args) => tolerance::run(args)?,
        Command::Plot(args) => plot(args)?,
        Command::Info(args) if args.lens.file.is_dir() => {
            args.lens.check_tables()?;
            info_of_directory(args)?;
        }
        Command::Info(args) => info(args)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn trace(args: &TraceArgs) -> Result<()> {
    let place = |e: Error| e.at(args.lens.file.display());
    let system = args.lens.system()?;
    let given = args.wavelengths.as_deref().map(rising);
    if let Some(dir) = &args.output {
        write_characterisation(args, &system, given.clone(), dir).map_err(place)?;
        if !args.json {
            return Ok(());
        }
    }
    let wavelengths = given.unwrap_or_else(|| {
        let mut own = system.prescription.wavelengths_nm.clone();
        own.sort_by(f64::total_cmp);
        own.dedup();
        own
    });
    if system.prescription.asymmetry().is_some() {
        return trace_over_places(args, &system, &wavelengths).map_err(place);
    }
    let fields = match &args.fields {
        Some(fields) => fields.iter().map(radial).collect(),
        None => system.fields_deg().map_err(place)?,
    };
    let points = characterise::field_points(&system, &fields, &wavelengths).map_err(place)?;
    if args.json {
        let mut object = figures(&system);
        object["points"] = points.iter().map(point_json).collect();
        println!("{object}");
    } else {
        print_points(&system, &points);
    }
    Ok(())
}

/// Figures over the two-dimensional field of a lens that is not rotationally symmetric.
fn trace_over_places(args: &TraceArgs, system: &System, wavelengths: &[f64]) -> Result<()> {
    let fields = match &args.fields {
        Some(fields) => fields.clone(),
        None => system.field_places_deg()?,
    };
    let map = field::Map::of(system)?;
    let points = field::points(system, &map, &fields, wavelengths)?;
    let line = points.iter().any(|p| p.relative_illumination.is_nan()).then_some(
        "relative illumination is undefined: the image of a point is a line, as rays are parallel \
         in one plane",
    );
    line.iter().for_each(|note| eprintln!("note: {note}"));
    if args.json {
        let mut object = figures(system);
        object["efl_x_mm"] = system.efl_x_mm()?.into();
        object["map"] = map_json(&map);
        if let (Some(note), Some(notes)) = (line, object["notes"].as_array_mut()) {
            notes.push(note.into());
        }
        object["points"] = points.iter().map(|p| place_json(p, &map)).collect();
        println!("{object}");
    } else {
        print_places(system, &map, &points);
    }
    Ok(())
}

fn import_files(args: &ImportArgs) -> Result<()> {
    let lens = camrig_lens_files::import::import(&args.source)?;
    lens.write(&args.output, args.force)?;
    eprintln!("wrote {}: {}", args.output.display(), summary(&lens));
    Ok(())
}

fn plot(args: &PlotArgs) -> Result<()> {
    let dir = OutputDir::create(&args.output, args.force)?;
    let mut drawings = Vec::new();
    let (lens, page) = if args.lens.file.is_dir() {
        args.lens.check_tables()?;
        let lens = Characterisation::read(&args.lens.file)?;
        let page = report::page(&lens, None, args.pixel)?;
        (lens, page)
    } else {
        let place = |e: Error| e.at(args.lens.file.display());
        let system = args.lens.system()?;
        let mut wavelengths_nm = system.prescription.wavelengths_nm.clone();
        wavelengths_nm.sort_by(f64::total_cmp);
        wavelengths_nm.dedup();
        let max_field_deg = max_field(&system, args.max_field)?;
        let fields = DRAWN_FIELDS.map(|part| part * max_field_deg);
        drawings = report::spots(&system, &fields, &wavelengths_nm).map_err(place)?;
        let plan = Plan {
            heights: DRAWN_HEIGHTS,
            density: None,
            max_field_deg,
            wavelengths_nm,
            psf_size: DRAWN_PSF_SIZE,
            psf_spacing_um: None,
            method: PsfMethod::Auto,
        };
        let lens = characterise::characterise(&system, &plan, &|_, _| ()).map_err(place)?;
        let traced = report::Traced { system: &system, max_field_deg };
        let page = report::page(&lens, Some(traced), args.pixel).map_err(place)?;
        (lens, page)
    };
    drawings.extend(report::drawings(&lens, args.pixel));
    dir.write("lens.html", page.html().as_bytes())?;
    for report::Drawing { name, svg } in &drawings {
        dir.write(format!("{name}.svg"), svg.as_bytes())?;
    }
    dir.finish()?;
    eprintln!("wrote lens.html and {} drawings into {}", drawings.len(), args.output.display());
    Ok(())
}

/// The largest field: the option's, or the file's.
fn max_field(system: &System, given: Option<f64>) -> Result<f64> {
    let own = system.fields_deg()?.into_iter().fold(0.0, f64::max);
    match given.unwrap_or(own) {
        deg if deg > 0.0 => Ok(deg),
        _ => Err(Error::input("the file has no off-axis field")
            .help("give the largest field in use: --max-field DEG")),
    }
}

fn write_characterisation(
    args: &TraceArgs,
    system: &System,
    wavelengths: Option<Vec<f64>>,
    dir: &Path,
) -> Result<()> {
    if dir.exists() && !args.force {
        return Err(Error::input(format!("{} exists already", dir.display()))
            .help("choose another name, or replace it with --force"));
    }
    let wavelengths_nm = wavelengths.unwrap_or_else(|| Bands::VISIBLE.centres().collect());
    for note in system.prescription.beyond_data(&wavelengths_nm) {
        eprintln!("note: {note}");
    }
    if system.prescription.asymmetry().is_some() {
        return write_plane(args, system, wavelengths_nm, dir);
    }
    let max_field_deg = max_field(system, args.max_field)?;
    let plan = Plan {
        heights: usize::from(args.heights),
        density: Some(Density { tolerance: args.psf_tolerance, pixel_um: args.pixel }),
        max_field_deg,
        wavelengths_nm,
        psf_size: usize::from(args.psf_size),
        psf_spacing_um: args.psf_spacing,
        method: args.psf,
    };
    let mut lens = with_bar(|told| characterise::characterise(system, &plan, told))?;
    lens.source = args.traced_from(&lens.source);
    lens.write(dir, args.force)?;
    eprintln!("wrote {}: {}", dir.display(), summary(&lens));
    let most = ("even 16 times the heights misplace", "start with more --heights");
    args.warn_between(lens.psf.between, most);
    Ok(())
}

/// Characterises a lens that is not rotationally symmetric, over a square frame whose corners are
/// at the largest field.
fn write_plane(
    args: &TraceArgs,
    system: &System,
    wavelengths_nm: Vec<f64>,
    dir: &Path,
) -> Result<()> {
    let max_field_deg = match args.max_field {
        Some(deg) => deg,
        None => {
            let fields = system.field_places_deg()?;
            fields.iter().map(radial).map(f64::abs).fold(0.0, f64::max)
        }
    };
    if !(max_field_deg > 0.0 && max_field_deg < 90.0) {
        return Err(Error::input(format!("a largest field of {max_field_deg}°"))
            .help("give the largest field in use, below 90 degrees: --max-field DEG"));
    }
    let plan = PlanePlan {
        frame_mm: field::Map::of(system)?.square_frame_mm(max_field_deg),
        density: Some(Density { tolerance: args.psf_tolerance, pixel_um: args.pixel }),
        wavelengths_nm,
        psf_size: usize::from(args.psf_size),
        psf_spacing_um: args.psf_spacing,
        method: args.psf,
    };
    let mut lens = with_bar(|told| field::characterise(system, &plan, told))?;
    lens.source = args.traced_from(&lens.source);
    lens.write(dir, args.force)?;
    eprintln!("wrote {}: {}", dir.display(), plane_summary(&lens));
    let remedy = "ask for fewer wavelengths or a smaller --psf-size to make room for more places";
    args.warn_between(lens.between, ("the closest places misplace", remedy));
    Ok(())
}

impl TraceArgs {
    /// The source of a characterisation: its file, and the program that traced it.
    fn traced_from(&self, tracer: &str) -> String {
        let file = self.lens.file.file_name().unwrap_or_default().to_string_lossy();
        format!("{file}, {tracer}")
    }

    /// Warns if interpolated PSFs miss the tolerance with the maximum number of PSFs. `misplace`
    /// begins the message, `remedy` is its advice.
    fn warn_between(&self, between: Option<Between>, (misplace, remedy): (&str, &str)) {
        let Some(between) = between.filter(|b| b.misplaced_mean > self.psf_tolerance) else {
            return;
        };
        eprintln!(
            "warning: PSFs change so fast over the field that {misplace} {:.2} % of the light on \
             average, more than the {:.2} % of --psf-tolerance; {remedy}",
            100.0 * between.misplaced_mean,
            100.0 * self.psf_tolerance
        );
    }
}

/// Traces with a progress bar.
fn with_bar<T>(trace: impl FnOnce(&(dyn Fn(usize, usize) + Sync)) -> Result<T>) -> Result<T> {
    let bar = arguments::progress("tracing", 0);
    let traced = trace(&|done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    Ok(traced)
}
