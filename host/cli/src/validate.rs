//! `camrig validate`: compares a model with captures.

use super::arguments::{ChangeArgs, progress};
use super::measure::{corners, roi};
use super::notes::Notes;
use camrig_base::output::OutputFile;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_light::Illuminant;
use camrig_measure::mtf::Roi;
use camrig_measure::patches::Corners;
use camrig_render as render;
use camrig_report::paper::{Side, page};
use camrig_validate::comparison::{Comparison, Measured, Sides};
use camrig_validate::paper::{Captured, Differences, Level, Places, REPORTED};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Validate a camera model against captures, as Chen et al. 2009 did
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig validate paper -o paper.html")]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand, Debug)]
enum What {
    /// Section VI of the paper: MTF, Table I, row 510 and image pairs at 300 lx and 10 lx
    #[command(after_help = "Examples:\n  \
        camrig validate paper -o paper.html\n  \
        camrig validate paper --model my.toml --captured captures/ --json\n\n\
        Without --captured, a camera with the causes named in the paper (focus, lens \
        transmittance, subject distance, defects) stands in for the real one, and a second model \
        has them too. The exit status is 1 if the differences do not have the sizes of the paper \
        or do not vanish with their causes; with --captured, if any difference is left.")]
    Paper(PaperArgs),
}

#[derive(clap::Args, Debug)]
struct PaperArgs {
    /// The model: a camera file or preset
    #[arg(long, default_value = "mt9t012", value_name = "C")]
    model: String,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Capture set with an edge and charts at two light levels, or a camera that stands in for it
    #[arg(long, value_name = "SET|C")]
    captured: Option<String>,
    /// Improved model, to compare as well
    #[arg(long, value_name = "C")]
    improved: Option<String>,
    /// Report with tables, plots and pictures (HTML)
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Captured charts: centres of patches 1, 6, 24 and 19 [default: those of the built-in chart]
    #[arg(long, value_name = "X1,Y1,...,X4,Y4", value_parser = corners)]
    corners: Option<Corners>,
    /// Captured edge: its region [default: the centre of the frame]
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    roi: Option<Roi>,
    /// Replace an existing page
    #[arg(long)]
    force: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    match &args.what {
        What::Paper(args) => run_paper(args),
    }
}

fn run_paper(args: &PaperArgs) -> Result<ExitCode> {
    let output = match &args.output {
        Some(path) => Some((OutputFile::create(path, args.force)?, path)),
        None => None,
    };
    let model = args.changes.load(&args.model)?;
    let load = |path: &str| render::with_filter_angles(Camera::load(path)?);
    let sides = Sides {
        captured: args.captured.as_deref().map(Captured::open).transpose()?,
        improved: args.improved.as_deref().map(load).transpose()?,
        places: Places { corners: args.corners, roi: args.roi },
    };
    let bar = progress("cameras", 0);
    let comparison = Comparison::of(&model, sides, |done, cameras| {
        bar.set_length(cameras as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    let mut notes = Notes::default();
    notes.tell(comparison.notes().cloned());
    if let Some((mut file, path)) = output {
        let html = page_of(&comparison, &model)?;
        file.write_all(html.as_bytes()).map_err(|e| Error::io("write", path, e))?;
        file.finish()?;
        eprintln!("wrote {}", path.display());
    }
    let Comparison { levels, captured, model, improved, before, after, .. } = &comparison;
    if args.json {
        let object = json!({
            "reported": REPORTED,
            "levels": levels,
            "before": before,
            "after": after,
            "as_reported": before.as_reported(),
            "vanish": after.as_ref().map(Differences::vanish),
            "failures": comparison.failures(),
            "captured": captured.figures,
            "model": model.figures,
            "improved": improved.as_ref().map(|b| &b.figures),
            "notes": notes.all(),
        });
        println!("{object}");
    } else {
        print(before, after.as_ref(), levels);
    }
    for failure in comparison.failures() {
        eprintln!("difference: {failure}");
    }
    Ok(if comparison.holds() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn page_of(comparison: &Comparison, model: &Camera) -> Result<String> {
    let Comparison { levels, before, after, .. } = comparison;
    let mut sides = vec![
        side("captured", &comparison.captured, None),
        side("model", &comparison.model, Some(before)),
    ];
    let improved = comparison.improved.as_ref();
    sides.extend(improved.map(|better| side("improved model", better, after.as_ref())));
    let light = Illuminant::parse("D65")?;
    let settings = model.settings(0, levels[0].exposure_s, None);
    let info = render::dng_info(model, &settings, Some(&light), "validate paper")?;
    page(&sides, levels, &info, &comparison.causes)
}

fn side<'a>(
    name: &'a str,
    Measured { taken, figures }: &'a Measured,
    differences: Option<&'a Differences>,
) -> Side<'a> {
    Side { name, taken, figures, differences }
}

fn print(before: &Differences, after: Option<&Differences>, levels: &[Level; 2]) {
    let line = |name: &str, of: &dyn Fn(&Differences) -> String| {
        println!("{name:44} {:>22} {:>22}", of(before), after.map_or(String::new(), of));
    };
    println!("{:44} {:>22} {:>22}", "captured against", "model", "improved model");
    line("MTF50 of the edge", &|d| format!("{:+.1} %", d.mtf50_percent));
    let scatter = |level: usize| {
        move |d: &Differences| {
            let s = d.luminance_std[level];
            format!("{:.1} % ({:.1} %)", s.all_percent, s.without_dark_percent)
        }
    };
    for (i, level) in levels.iter().enumerate() {
        line(&format!("std of luminance, {} lx (without dark)", level.lux), &scatter(i));
    }
    line("brightness", &|d| format!("{:.3}", d.brightness_ratio));
    line("image displaced at the frame's side", &|d| {
        format!("{:+.2} pixels", d.displacement_at_edge_px)
    });
    line("defects per million (model, captured)", &|d| {
        format!("{:.0}, {:.0}", d.defects_per_million[0], d.defects_per_million[1])
    });
    println!(
        "the paper reports {} % ({} %) for the standard deviation of the luminance, and does not \
         say at which light",
        REPORTED.all_percent, REPORTED.without_dark_percent
    );
}
