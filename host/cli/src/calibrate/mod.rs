//! `camrig scene response`, `hdr`, `spectral`: scenes from a real camera.

mod hdr;
mod response;
mod spectral;

pub use hdr::{HdrArgs, hdr};
pub use response::{ResponseArgs, response};
pub use spectral::{SpectralArgs, spectral};

use super::captures::opened;
use camrig_base::Cfa;
use camrig_base::Result;
use camrig_base::output::OutputDir;
use camrig_calibrate::ceiling;
use camrig_calibrate::exposures::{self, Series};
use std::path::PathBuf;

/// The frames, and what is known about the sensor.
#[derive(clap::Args, Debug)]
struct Source {
    /// Capture set: a directory with captures.toml
    captures: PathBuf,
    /// Captures to use [default: all that are not darks]
    #[arg(long, value_delimiter = ',', value_name = "ID,...")]
    only: Vec<String>,
    /// Colour filter pattern, if missing in the capture set
    #[arg(long, value_name = "PATTERN")]
    cfa: Option<String>,
}

impl Source {
    fn read(&self) -> Result<(Vec<Series>, Cfa, f64)> {
        let set = opened(&self.captures)?;
        let cfa = match &self.cfa {
            Some(text) => Cfa::parse(text).map_err(|e| e.at("--cfa"))?,
            None => set.cfa(),
        };
        let black = set.sensor.black_level_dn.unwrap_or(0.0);
        let full_scale = f64::from(set.sensor.white_level_dn) - black;
        let series =
            exposures::read(&set, &self.only).map_err(|e| e.at(self.captures.display()))?;
        let ends = series.iter().map(|s| ceiling::full_scale(s, &cfa, full_scale));
        let ends = ends.fold(full_scale, f64::min);
        if ends < full_scale {
            eprintln!(
                "note: signals end at {ends:.0} DN above black, below the white level \
                 ({full_scale:.0}): saturation is taken from there"
            );
        }
        Ok((series, cfa, ends))
    }
}

/// Output directory and what to print.
#[derive(clap::Args, Debug)]
struct Output {
    /// Output directory
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace existing output
    #[arg(long)]
    force: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

impl Output {
    fn create(&self) -> Result<OutputDir> {
        OutputDir::create(&self.output, self.force)
    }

    fn say_written(&self) {
        eprintln!("wrote {}", self.output.display());
    }
}
