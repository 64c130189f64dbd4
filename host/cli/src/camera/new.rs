//! `camrig camera new`: writes a camera file from data-sheet figures or a built-in sensor.

use super::files;
use camrig_base::Result;
use camrig_camera::Change;
use camrig_camera::draft::{Draft, Request};
use camrig_fit::exchange::{self, Beside};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Write a complete, commented camera file from data-sheet figures or a built-in sensor; unknown
/// values get usual ones, marked typical
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig camera new --like imx219 -o my-camera.toml\n  \
    camrig camera new --like imx296 --cfa RGGB --f-number 1.8 -o colour.toml\n  \
    camrig camera new --pixels 3280x2464 --pitch-um 1.12 --bits 10 --cfa RGGB -o mine.toml\n  \
    camrig camera new --pixels 4000x3000 --pitch-um 1.4 --noise iso100.dng iso800.dng -o phone.toml\n  \
    camrig camera new --pixels 2464x2056 --pitch-um 3.45 --bits 12 --cfa mono \\\n    \
    --full-well-e 10400 --read-noise-e 2.1 --qe 450:0.56,529:0.64,650:0.5 -o mono.toml\n\n\
    `camrig presets` lists the built-in sensors, `camrig explain KEY` explains a key.")]
pub struct NewArgs {
    /// Output; the tables that it refers to are written to the same folder
    #[arg(short, long, value_name = "FILE.toml")]
    output: PathBuf,
    /// Built-in sensor to start from
    #[arg(long, visible_alias = "sensor", value_name = "NAME")]
    like: Option<String>,
    /// Columns and rows
    #[arg(long, value_name = "WxH")]
    pixels: Option<String>,
    /// Pixel pitch, µm
    #[arg(long, value_name = "UM")]
    pitch_um: Option<String>,
    /// Bits of the converter
    #[arg(long, value_name = "N")]
    bits: Option<String>,
    /// Colour filters: RGGB, GRBG, GBRG, BGGR, mono, or rows of letters parted by slashes
    #[arg(long, value_name = "PATTERN")]
    cfa: Option<String>,
    /// Quantum efficiency: its peak, points of a data sheet (nm:value,... or channel:nm:value,...),
    /// or a table in the folder of FILE.toml
    #[arg(long, value_name = "PEAK|POINTS|FILE.csv")]
    qe: Option<String>,
    /// Linear full well, e-: electrons per DN at unity gain x (2^bits - 1)
    #[arg(long, value_name = "E")]
    full_well_e: Option<String>,
    /// Read noise at unity gain, e-
    #[arg(long, value_name = "E")]
    read_noise_e: Option<String>,
    /// Black level, DN
    #[arg(long, value_name = "DN")]
    black_level_dn: Option<String>,
    /// Noise, gain and levels from another program: DNGs of one camera with a NoiseProfile, a table
    /// of such profiles or of Noise Flow's betas (CSV, the columns of `camera export`), noise
    /// profiles of darktable, parameters of ELD or PMN (JSON), a tuning file of libcamera, which
    /// also tells the fall-off. What is in the file tells its form
    #[arg(long, value_name = "FILE", num_args = 1..)]
    noise: Vec<PathBuf>,
    /// The camera's name in noise profiles of darktable, which are of many
    #[arg(long, value_name = "MODEL", requires = "noise")]
    noise_model: Option<String>,
    /// F-number of the lens
    #[arg(long, value_name = "N")]
    f_number: Option<String>,
    /// Focal length of the lens, mm
    #[arg(long, value_name = "MM")]
    focal_length_mm: Option<String>,
    /// Any other key of the file: sensor.noise.prnu=0.008; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<Change>,
    /// Name of the camera in raw files and reports [default: that of the file]
    #[arg(long)]
    name: Option<String>,
    /// Replace existing files
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(args: &NewArgs) -> Result<ExitCode> {
    files::check_name(&args.output)?;
    let mut request = args.request();
    let mut tables = Vec::new();
    if !args.noise.is_empty() {
        let found = exchange::read(&args.noise, &args.beside(&request))?;
        found.notes.iter().for_each(|note| eprintln!("note: {note}"));
        (request.known, tables) = (found.known, found.tables);
    }
    let mut draft = Draft::of(&request)?;
    draft.made.extend(tables);
    let files = files::write(&draft, &args.output, args.force)?;
    tell(&draft, &args.output, &files);
    Ok(ExitCode::SUCCESS)
}

impl NewArgs {
    /// What the arguments say that a noise model may leave open.
    fn beside(&self, request: &Request) -> Beside {
        let number = |key: &str| {
            let own = request.given.iter().find(|change| change.key == key)?;
            own.value.as_f64()
        };
        Beside {
            name: request.name.clone(),
            bits: number("sensor.bits").map(|bits| bits as u8),
            size: number("sensor.width").zip(number("sensor.height")).map(|(w, h)| [w, h]),
            black_level_dn: number("sensor.black_level_dn"),
            prnu: number("sensor.noise.prnu"),
            full_well_e: number("sensor.full_well_e"),
            model: self.noise_model.clone(),
        }
    }

    fn request(&self) -> Request {
        let (width, height) = match &self.pixels {
            Some(pixels) => match pixels.split_once(['x', 'X', '×']) {
                Some((width, height)) => (Some(width), Some(height)),
                None => (Some(&pixels[..]), None),
            },
            None => (None, None),
        };
        let mut given: Vec<Change> = Vec::new();
        for (key, text) in [
            ("sensor.width", width),
            ("sensor.height", height),
            ("sensor.pitch_um", self.pitch_um.as_deref()),
            ("sensor.bits", self.bits.as_deref()),
            ("sensor.cfa", self.cfa.as_deref()),
            ("sensor.full_well_e", self.full_well_e.as_deref()),
            ("sensor.noise.read_e", self.read_noise_e.as_deref()),
            ("sensor.black_level_dn", self.black_level_dn.as_deref()),
            ("lens.f_number", self.f_number.as_deref()),
            ("lens.focal_length_mm", self.focal_length_mm.as_deref()),
        ] {
            given.extend(text.and_then(|text| format!("{key}={text}").parse::<Change>().ok()));
        }
        let mut efficiency = Vec::new();
        match self.qe.as_deref() {
            Some(points) if points.contains(':') => {
                efficiency = points.split(',').map(str::to_string).collect();
            }
            Some(peak) if peak.parse::<f64>().is_ok() => {
                given.extend(format!("sensor.qe_peak={peak}").parse::<Change>());
            }
            Some(table) => given.push(Change::new("sensor.qe", table)),
            None => (),
        }
        given.extend(self.set.iter().cloned());
        let stem =
            self.output.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
        let name = self.name.clone().unwrap_or(stem);
        let like = self.like.as_ref().map(|like| like.to_ascii_lowercase());
        Request { name, like, given, efficiency, ..Request::default() }
    }
}

/// Prints what was written, and what to type next.
fn tell(draft: &Draft, output: &Path, files: &[PathBuf]) {
    files::tell(draft, output, files);
    let dot = if output.is_absolute() { "" } else { "./" };
    eprintln!(
        "next: camrig simulate --camera {dot}{} --scene colorchecker --exposure auto:0.18 -o first.dng",
        output.display()
    );
}
