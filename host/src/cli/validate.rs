//! `camrig validate`: a model beside captures.

use super::arguments::progress;
use super::measure::{corners, roi};
use camrig_base::output::OutputFile;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_measure::mtf::Roi;
use camrig_measure::patches::Corners;
use camrig_render as render;
use camrig_report::paper::{Side, page};
use camrig_validate::paper::{
    self, Captured, Differences, Figures, LEVELS, Level, Places, REPORTED, Taken,
};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Validate a camera model against captures, as Chen et al. 2009 did
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  camrig validate paper -o paper.html")]
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
        Without --captured, a camera with the causes that the paper names (focus, lens transmittance, \
        subject distance, defects) stands for the real one, and a second model has them too. Exit status 1 \
        where the differences have not the sizes of the paper or do not go with their causes; with \
        --captured, where any is left.")]
    Paper(PaperArgs),
}

#[derive(clap::Args, Debug)]
struct PaperArgs {
    /// The model: a camera file or preset
    #[arg(long, default_value = "mt9t012", value_name = "C")]
    model: String,
    /// A capture set with an edge and charts at two light levels, or a camera that stands for it
    #[arg(long, value_name = "SET|C")]
    captured: Option<String>,
    /// A better model, to compare too
    #[arg(long, value_name = "C")]
    improved: Option<String>,
    /// Page with tables, plots and pictures (HTML)
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Captured charts: centres of patches 1, 6, 24 and 19; the built-in chart's place unless given
    #[arg(long, value_name = "X1,Y1,...,X4,Y4", value_parser = corners)]
    corners: Option<Corners>,
    /// Captured edge: its region; the middle of the frame unless given
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

/// Frames and figures of one side.
struct Measured {
    taken: Taken,
    figures: Figures,
}

fn run_paper(args: &PaperArgs) -> Result<ExitCode> {
    let output = match &args.output {
        Some(path) => Some(OutputFile::create(path, args.force)?),
        None => None,
    };
    let model = Camera::load(&args.model)?;
    let captured = match &args.captured {
        Some(spec) => Captured::open(spec)?,
        None => Captured::Camera(Box::new(paper::captured_camera(&model)?)),
    };
    let improved = match (&args.improved, &args.captured) {
        (Some(spec), _) => Some(Camera::load(spec)?),
        (None, None) => Some(paper::with_causes(&model)?),
        (None, Some(_)) => None,
    };
    let mut cameras = vec![&model];
    cameras.extend(&improved);
    if let Captured::Camera(camera) = &captured {
        cameras.push(camera);
    }
    let from_set = match &captured {
        Captured::Set(set) => Some(paper::of_captures(set)?),
        Captured::Camera(_) => None,
    };
    let levels = from_set.as_ref().map_or(LEVELS, |(_, levels)| *levels);
    let bar = progress("cameras", cameras.len() as u64);
    let mut taken = paper::take(&cameras, &levels, || bar.inc(1))?.into_iter();
    bar.finish_and_clear();
    // One for each camera, in their order.
    let nothing = || Error::input("no frames were taken");
    let modelled = taken.next().ok_or_else(nothing)?;
    let better = improved.as_ref().and_then(|_| taken.next());
    let captured = match from_set {
        Some((taken, _)) => taken,
        None => taken.next().ok_or_else(nothing)?,
    };
    for simulated in [Some(&modelled), better.as_ref()].into_iter().flatten() {
        paper::comparable(&simulated.chart, &captured.chart)?;
    }
    let places = Places { corners: args.corners, roi: args.roi };
    let captured = measured(captured, &places).map_err(|e| e.at("captured"))?;
    // The places given are those of the captured frames; simulated ones of the same chart have their own.
    let modelled = measured(modelled, &Places::default()).map_err(|e| e.at("model"))?;
    let better = better.map(|t| measured(t, &Places::default())).transpose()?;
    let before = captured.figures.against(&modelled.figures)?;
    let after = better.as_ref().map(|b| captured.figures.against(&b.figures)).transpose()?;

    if let Some(mut file) = output {
        let mut sides = vec![
            Side {
                name: "captured",
                taken: &captured.taken,
                figures: &captured.figures,
                differences: None,
            },
            Side {
                name: "model",
                taken: &modelled.taken,
                figures: &modelled.figures,
                differences: Some(&before),
            },
        ];
        if let Some(b) = &better {
            let (taken, figures) = (&b.taken, &b.figures);
            sides.push(Side {
                name: "improved model",
                taken,
                figures,
                differences: after.as_ref(),
            });
        }
        let light = camrig_scene::Illuminant::parse("D65")?;
        let settings = model.settings(0, levels[0].exposure_s, None);
        let info = render::dng_info(&model, &settings, Some(&light), "validate paper")?;
        let causes = match (&args.captured, &args.improved) {
            (None, None) => paper::CAPTURED.to_owned(),
            _ => improved.map_or_else(|| model.text.clone(), |c| c.text),
        };
        let html = page(&sides, &levels, &info, &causes)?;
        let path = args.output.clone().unwrap_or_default();
        file.write_all(html.as_bytes()).map_err(|e| Error::io("write", &path, e))?;
        file.finish()?;
        eprintln!("wrote {}", path.display());
    }
    let stands_in = args.captured.is_none() && args.improved.is_none();
    let well = match &after {
        Some(after) if stands_in => before.as_reported() && after.vanish(),
        Some(after) => after.vanish(),
        None => before.vanish(),
    };
    if args.json {
        let object = json!({
            "reported": REPORTED,
            "levels": levels,
            "before": before,
            "after": after,
            "as_reported": before.as_reported(),
            "vanish": after.as_ref().map(Differences::vanish),
            "captured": captured.figures,
            "model": modelled.figures,
            "improved": better.as_ref().map(|b| &b.figures),
        });
        println!("{object}");
    } else {
        print(&before, after.as_ref(), &levels);
    }
    Ok(if well { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn measured(taken: Taken, places: &Places) -> Result<Measured> {
    Ok(Measured { figures: Figures::of(&taken, places)?, taken })
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
        "the paper reports {} % ({} %) for the standard deviation of the luminance, and does not say at which light",
        REPORTED.all_percent, REPORTED.without_dark_percent
    );
}
