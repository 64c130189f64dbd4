//! `camrig measure`: figures from captures or frames.

mod captures;
mod dark;
mod frames;
mod mtf;

pub use frames::{corners, roi};

use camrig_base::Result;
use camrig_base::output::write_file;
use camrig_measure::Value;
use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `camrig measure`.
#[derive(ClapArgs)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Photon transfer: gain, read noise, full well, fixed patterns, dark current, non-linearity
    #[command(after_help = "Examples:\n  camrig measure ptc captures/ --json --report ptc.html")]
    Ptc(captures::WithPage),
    /// EMVA 1288 release 4.0 linear, with warnings where its assumptions are violated
    #[command(after_help = "Examples:\n  camrig measure emva captures/ --report emva.html")]
    Emva(captures::WithPage),
    /// Read noise, offset, noise of rows and columns and hot pixels of a stack of dark frames
    #[command(after_help = "Examples:\n  camrig measure dark dark-*.dng --dn-per-e 0.25\n  \
        camrig rig stream tcp://127.0.0.1:7420 --camera mt9v024 --scene uniform:0 \
        --exposure 5ms \\\n    \
            --frames 16 -o - | camrig measure dark -")]
    Dark(dark::DarkArgs),
    /// Slanted-edge response (ISO 12233:2023 e-SFR) on raw channels, without demosaic
    #[command(after_help = "\
        Several frames of the same edges are averaged, each relative to its own edge. \
        Uncertainties\n\
        are standard errors from blocks of rows, or from the spread between frames if that is \
        larger.\n\n\
        Examples:\n  \
        camrig measure mtf edge.dng --roi 200,100,80,120 --pitch-um 2.2\n  \
        camrig measure mtf shots/*.dng --roi 200,100,80,120 --roi 500,100,80,120 \
        --report mtf.html\n  \
        camrig measure mtf shots/*.dng --channel g")]
    Mtf(mtf::MtfArgs),
    /// Signal-to-noise ratio of an even area of one frame, per channel
    #[command(after_help = "\
        Noise from pixel to pixel, temporal and fixed, from differences of neighbours of one \
        colour, so\n\
        that shading does not count. camrig batch gives the same figure of its uniform scenes.\n\n\
        Examples:\n  camrig measure snr grey.dng\n  \
        camrig measure snr grey.dng --roi 8,8,64,48 --json")]
    Snr(frames::SnrArgs),
    /// Means and standard deviations of ColorChecker patches
    #[command(after_help = "Examples:\n  camrig measure patches chart.dng --json\n\
        Corners: centres of patches 1, 6, 24 and 19 (clockwise from dark skin)")]
    Patches(frames::PatchesArgs),
    /// Contrast transfer accuracy (IEEE 2020): how often two pixels show the contrast of two patches
    #[command(after_help = "\
        Counts all pairs of pixels, one of each patch, whose contrast lies within the tolerance of \
        that of\n\
        the patches, and gives beside it what means and noise predict.\n\n\
        Examples:\n  camrig measure contrast a.dng --bright 60,20,20,20 --dark 20,20,20,20")]
    Contrast(frames::ContrastArgs),
    /// Row or column profile, compared with another frame, and relative illumination
    #[command(after_help = "Examples:\n  \
            camrig measure profile a.dng --row 60 --against b.dng --channel g")]
    Profile(frames::ProfileArgs),
    /// Signal rates per position of the filter pattern under each light, from exposure series
    #[command(after_help = "Examples:\n  camrig measure rates captures/ --json")]
    Rates(captures::OnCaptures),
    /// Compare two capture sets; exit status 1 where they differ significantly
    #[command(after_help = "Examples:\n  camrig measure compare captures-a captures-b")]
    Compare(captures::CompareArgs),
}

/// A page about a measurement.
#[derive(ClapArgs)]
struct PageArgs {
    /// Also write a page with figures and plots (HTML)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Replace an existing page
    #[arg(long)]
    force: bool,
}

impl PageArgs {
    /// Whether a page was requested.
    fn is_wanted(&self) -> bool {
        self.report.is_some()
    }

    /// Writes the page if requested.
    fn write(&self, page: impl FnOnce() -> String) -> Result<()> {
        match &self.report {
            Some(path) => write_file(path, self.force, page().as_bytes()),
            None => Ok(()),
        }
    }
}

/// Runs `camrig measure`.
pub fn run(args: Args) -> Result<ExitCode> {
    match args.what {
        What::Ptc(args) => captures::ptc_of(&args),
        What::Emva(args) => captures::emva_of(&args),
        What::Dark(args) => dark::dark_of(&args),
        What::Mtf(args) => mtf::mtf_of(&args),
        What::Snr(args) => frames::snr_of(&args),
        What::Patches(args) => frames::patches_of(&args),
        What::Contrast(args) => frames::contrast_of(&args),
        What::Profile(args) => frames::profile_of(&args),
        What::Rates(args) => captures::rates_of(&args),
        What::Compare(args) => captures::compare_of(&args),
    }
}

/// A value to the two leading digits of its error, or to six without one.
pub fn plus_minus(v: Value) -> String {
    if v.std_error.is_nan() {
        return format!("{:.6}", v.value);
    }
    let digits = if v.std_error > 0.0 { 1 - libm::log10(v.std_error).floor() as i32 } else { 6 };
    let digits = digits.clamp(0, 9) as usize;
    format!("{:.digits$} ± {:.digits$}", v.value, v.std_error)
}
