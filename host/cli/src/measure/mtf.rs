//! `camrig measure mtf`: the response over slanted edges of frames.

use super::frames::{Given, Opened, note_assumed_mono, roi};
use super::{PageArgs, plus_minus};
use crate::arguments::positive;
use camrig_base::{Error, Plane, Result};
use camrig_measure::figure;
use camrig_measure::mtf::{self, Edge, Excluded, Roi};
use camrig_report as report;
use clap::Args as ClapArgs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// A frame, and its white level where that is known.
type Frame = (Plane<u16>, Option<u16>);

#[derive(ClapArgs)]
pub struct MtfArgs {
    /// Raw frames of the same edges: files or stacks
    #[arg(required = true, value_name = "FRAME")]
    frames: Vec<PathBuf>,
    #[command(flatten)]
    given: Given,
    /// Region of an edge in pixels; repeatable; by default, slanted edges are searched for
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    roi: Vec<Roi>,
    #[command(flatten)]
    page: PageArgs,
    /// Pixel pitch, µm, for cycles per millimetre
    #[arg(long, value_name = "UM", value_parser = positive, allow_negative_numbers = true)]
    pitch_um: Option<f64>,
    /// Channel letter, or all
    #[arg(long, default_value = "all", value_name = "r|g|b|all")]
    channel: String,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn mtf_of(args: &MtfArgs) -> Result<ExitCode> {
    let (first, planes) = args.open()?;
    let letters = first.letters(&args.channel)?;
    let found = mtf::edges(&planes, &first.cfa, &letters, &args.roi, args.pitch_um)
        .map_err(|e| match args.roi.is_empty() {
            true => e.help("with --roi X,Y,WIDTH,HEIGHT, the reason is reported"),
            false => e,
        })
        .map_err(|e| e.at(args.frames[0].display()))?;
    let files = args.frames.len();
    let more = if files > 1 { format!(" and {} more", files - 1) } else { String::new() };
    let name = format!("{}{more}", args.frames[0].display());
    args.page.write(|| report::measurement::mtf(&name, &found).html())?;
    for Excluded { channel, roi: Roi { x, y, width, height }, reason } in &found.excluded {
        eprintln!("note: channel {channel} at {x},{y},{width},{height} is excluded: {reason}");
    }
    if args.json {
        println!("{}", serde_json::Value::Object(figure::object(&found)?));
    } else {
        found.edges.iter().for_each(|edge| args.print(edge));
    }
    Ok(ExitCode::SUCCESS)
}

impl MtfArgs {
    /// All frames of all files; the pattern is that of the first file.
    fn open(&self) -> Result<(Opened, Vec<Frame>)> {
        let (mut first, others) = self.given.open(&self.frames[0])?;
        let plane = std::mem::replace(&mut first.plane, Plane::filled(0, 0, 0));
        let all = |first, others: Vec<_>, white| {
            std::iter::once(first).chain(others).map(move |plane| (plane, white))
        };
        let mut planes: Vec<Frame> = all(plane, others, first.white).collect();
        let mut assumed_mono: Vec<&Path> = Vec::new();
        assumed_mono.extend(first.assumed_mono.then_some(&*self.frames[0]));
        for path in &self.frames[1..] {
            let (one, others) = self.given.open(path)?;
            assumed_mono.extend(one.assumed_mono.then_some(&**path));
            if one.cfa != first.cfa {
                note_assumed_mono(&assumed_mono);
                return Err(Error::disagreement(format!(
                    "patterns {} and {}",
                    first.cfa, one.cfa
                ))
                .at(path.display())
                .help("provide frames of one camera"));
            }
            planes.extend(all(one.plane, others, one.white));
        }
        note_assumed_mono(&assumed_mono);
        Ok((first, planes))
    }

    /// Prints a line about an edge, with its position where there are several.
    fn print(&self, e: &Edge) {
        let per_mm = e
            .mtf50_cycles_per_mm
            .map_or(String::new(), |v| format!(" ({} cycles/mm)", plus_minus(v)));
        let place = if self.roi.len() == 1 {
            String::new()
        } else {
            let Roi { x, y, width, height } = e.roi;
            let direction = e.direction.name();
            format!(" at {x},{y},{width},{height} (field {:.2}, {direction})", e.field)
        };
        let frames = e
            .mtf50_frame_spread
            .map_or(String::new(), |spread| format!("; {} frames, spread {spread:.4}", e.frames));
        println!(
            "{}{place}: MTF50 {} cycles/pixel{per_mm}, at Nyquist {}, edge at {:.2} degrees\
             {frames}",
            e.channel,
            plus_minus(e.mtf50_cycles_per_pixel),
            e.mtf_at_nyquist.map_or("not determined".into(), plus_minus),
            e.angle_deg
        );
    }
}
