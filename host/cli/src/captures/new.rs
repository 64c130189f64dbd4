//! `camrig captures new`: drafts a manifest from the frames of a folder.

use crate::arguments::{duration, gain, positive, progress};
use camrig_base::output::OutputFile;
use camrig_base::{Cfa, Error, Result};
use camrig_captures::Role;
use camrig_captures::draft::{Draft, Known};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Write captures.toml for the frames in a folder and below: stacks, exposure, gain, temperature
/// and levels from the files, role from names and levels; unknown values are marked "?"
#[derive(clap::Args, Debug)]
#[command(after_help = "\
    Frames are DNG, TIFF, FITS, NPY, PGM, grey PNG, CSI-2, MCAP, or headerless pixels named like\n\
    NAME_640x480_SGRBG10P.raw; NAME.json is libcamera's metadata of NAME.raw. Words in names are \
    used:\n\
    dark, bias, flat, edge, chart, dots, and exposures like 10ms. The source of each value is in a\n\
    comment. Options supply values that the files lack.\n\n\
    Examples:\n  \
    camrig captures new frames\n  \
    camrig captures new frames --gain 1 --bits 12 --cfa mono --force\n  \
    camrig captures check frames\n  \
    camrig measure ptc frames --report ptc.html")]
pub struct NewArgs {
    /// Folder of the frames, which becomes a capture set
    folder: PathBuf,
    /// Integration time, where neither the files nor NAME.json have it: 20ms, 1.5s, 300us
    #[arg(long, value_parser = duration, value_name = "TIME")]
    exposure: Option<f64>,
    /// Analog gain, where the files have none
    #[arg(long, value_parser = gain, value_name = "G")]
    gain: Option<f64>,
    /// Temperature of the sensor, where the files have none
    #[arg(long, value_name = "C", allow_negative_numbers = true)]
    temperature_c: Option<f64>,
    /// Bits of a sample, where the files have none
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16))]
    bits: Option<u32>,
    /// Colour filter pattern, where the files have none
    #[arg(long, value_name = "PATTERN")]
    cfa: Option<String>,
    /// Black level, where the files have none
    #[arg(long, value_name = "DN")]
    black: Option<f64>,
    /// Saturated level, where the files have none
    #[arg(long, value_name = "DN")]
    white: Option<u16>,
    /// Pixel pitch, µm, where the files have none
    #[arg(long, value_name = "UM", value_parser = positive)]
    pitch_um: Option<f64>,
    /// Replace an existing captures.toml
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(args: &NewArgs) -> Result<ExitCode> {
    let path = args.folder.join("captures.toml");
    // Opened first, so that an existing set is reported at once.
    if !args.folder.is_dir() {
        return Err(Error::input(format!("{} is not a folder", args.folder.display()))
            .help("give the folder of the frames"));
    }
    let mut output = OutputFile::create(&path, args.force)?;
    let bar = progress("files", 0);
    let draft = Draft::of(&args.folder, &args.known()?, &|files| {
        bar.set_length(files as u64);
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    let head = [
        "Written by `camrig captures new`, with the source of each value in a comment. Replace each",
        "\"?\" by its value; `camrig captures check` lists those that remain. docs/reference.md has \
         all",
        "keys, including those of light and scenes.",
    ];
    let text = draft.text(&head);
    output.write_all(text.as_bytes()).map_err(|e| Error::io("write", &path, e))?;
    output.finish()?;
    summarise(&draft, &args.folder, &path);
    Ok(ExitCode::SUCCESS)
}

impl NewArgs {
    fn known(&self) -> Result<Known> {
        Ok(Known {
            exposure_s: self.exposure,
            analog_gain: self.gain,
            temperature_c: self.temperature_c,
            bits: self.bits,
            cfa: self.cfa.as_deref().map(Cfa::parse).transpose()?,
            black_level_dn: self.black,
            white_level_dn: self.white,
            pitch_um: self.pitch_um,
        })
    }
}

/// Prints a summary: what was found and skipped, which values are missing, and the next command.
fn summarise(draft: &Draft, folder: &Path, path: &Path) {
    for note in &draft.notes {
        eprintln!("note: {note}");
    }
    for file in &draft.skipped {
        eprintln!("note: skipped {}: {}", file.name.display(), file.reason);
    }
    let [stacks, frames] = draft.count();
    eprintln!("wrote {}: {stacks} stacks of {frames} frames", path.display());
    let folder = folder.display();
    let check = format!("camrig captures check {folder}");
    let unknown = draft.unknown();
    if !unknown.is_empty() {
        let each = unknown.iter().map(|(key, count)| match count {
            1 => (*key).to_string(),
            count => format!("{key} of {count} captures"),
        });
        let all: Vec<String> = each.collect();
        eprintln!(
            "not in the files: {}. Replace each \"?\", or set a value for all stacks (--exposure, \
             --gain, --bits, --cfa, with --force)\nnext: {check}",
            all.join(", ")
        );
        return;
    }
    let measure = match (draft.has(Role::Dark), draft.has(Role::Flat)) {
        (true, true) => Some("ptc"),
        (true, false) => Some("dark"),
        _ => None,
    };
    let measure = measure.map(|what| format!("; then camrig measure {what} {folder}"));
    eprintln!("next: {check}{}", measure.unwrap_or_default());
}
