//! `camrig lens tolerance`: the effect of manufacturing errors.

use super::LensArgs;
use crate::arguments;
use camrig_base::numbers::counted;
use camrig_base::{Error, Result};
use camrig_lens::prescription::{Medium, Surface};
use camrig_lens::tolerance::{self, Contrast, PERCENTILES, Plan, Report, Spread, Tolerances};
use serde_json::{Value, json};

/// Show the MTF of many lenses that depart from a prescription within tolerances, and which
/// departure costs most
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig lens tolerance triplet.zmx --lenses 100 --decentre 0.02 --tilt 1.5 --json\n  \
    camrig lens tolerance phone.toml --thickness 0.005 --radius 0 --decentre 0.003 --refocus")]
pub(super) struct ToleranceArgs {
    #[command(flatten)]
    lens: LensArgs,
    /// Fields, degrees [default: those of the file]
    #[arg(long, value_name = "DEG,...", value_delimiter = ',')]
    fields: Option<Vec<f64>>,
    /// Number of lenses
    #[arg(long, default_value_t = 200, value_name = "N")]
    lenses: u32,
    /// Seed of the random departures
    #[arg(long, default_value_t = 1, value_name = "K")]
    seed: u64,
    /// Tolerance of glass thicknesses and air spaces, ± mm; 0 disables a kind of departure
    #[arg(long, default_value_t = 0.02, value_name = "MM")]
    thickness: f64,
    /// Tolerance of the index of each glass, ±
    #[arg(long, default_value_t = 0.0005, value_name = "N")]
    index: f64,
    /// Tolerance of each radius of curvature, ± percent
    #[arg(long, default_value_t = 0.1, value_name = "PERCENT")]
    radius: f64,
    /// Tolerance of each element's decentre, mm
    #[arg(long, default_value_t = 0.01, value_name = "MM")]
    decentre: f64,
    /// Tolerance of each element's tilt, arc minutes
    #[arg(long, default_value_t = 1.0, value_name = "ARCMIN")]
    tilt: f64,
    /// Refocus each lens: its sensor follows the paraxial image
    #[arg(long)]
    refocus: bool,
    /// Frequency of the MTF figures, cycles/mm [default: the mean MTF50 of the prescription]
    #[arg(long, value_name = "PER_MM", value_parser = arguments::positive)]
    frequency: Option<f64>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Departures listed, the costliest first; `--json` has all.
const LISTED: usize = 12;

pub(super) fn run(args: &ToleranceArgs) -> Result<()> {
    let place = |e: Error| e.at(args.lens.file.display());
    let system = args.lens.system()?;
    let passed_twice = |pair: &[Surface]| {
        matches!(pair[0].medium, Medium::Glass(_)) && pair[1].medium == Medium::Mirror
    };
    if system.prescription.surfaces.windows(2).any(passed_twice) {
        eprintln!(
            "note: light passes the glass in front of a mirror twice: radii, spaces and indices \
             vary independently in the two passes, though it is one piece of glass"
        );
    }
    let fields_deg = match &args.fields {
        Some(fields) => fields.clone(),
        None => system.fields_deg().map_err(place)?,
    };
    let plan = Plan {
        tolerances: Tolerances {
            thickness_mm: args.thickness,
            index: args.index,
            radius_percent: args.radius,
            decentre_mm: args.decentre,
            tilt_arcmin: args.tilt,
        },
        lenses: args.lenses as usize,
        seed: args.seed,
        refocus: args.refocus,
        frequency_per_mm: args.frequency,
        fields_deg,
    };
    let bar = arguments::progress("lenses", 0);
    let report = tolerance::report(&system, &plan, &|done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let report = report.map_err(place)?;
    match args.json {
        true => println!("{}", object(&plan, &report)),
        false => print(&plan, &report),
    }
    Ok(())
}

fn object(plan: &Plan, report: &Report) -> Value {
    let spread = |s: &Spread| {
        let percentiles = PERCENTILES.iter().zip(s.percentiles);
        let named = percentiles.map(|(p, v)| (format!("p{p:02}"), v.into()));
        let mut object: serde_json::Map<String, Value> = named.collect();
        object.insert("nominal".into(), s.nominal.into());
        Value::Object(object)
    };
    let contrast = |c: &Contrast| {
        let mtf50 = spread(&c.mtf50_per_mm);
        json!({ "mtf50_cycles_per_mm": mtf50, "mtf": spread(&c.mtf) })
    };
    let fields = report.fields.iter().map(|f| {
        json!({
            "field_deg": f.field_deg,
            "tangential": contrast(&f.tangential),
            "sagittal": contrast(&f.sagittal),
        })
    });
    let sensitivities = report.sensitivities.iter().map(|s| {
        json!({
            "kind": s.perturbation.kind.name(),
            "place": s.perturbation.place(),
            "surfaces": [s.perturbation.first + 1, s.perturbation.last + 1],
            "tolerance": s.perturbation.tolerance,
            "unit": s.perturbation.kind.unit(),
            "mtf_loss": s.loss,
        })
    });
    json!({
        "lenses": plan.lenses,
        "seed": plan.seed,
        "refocus": plan.refocus,
        "frequency_cycles_per_mm": report.frequency_per_mm,
        "fields": fields.collect::<Value>(),
        "sensitivities": sensitivities.collect::<Value>(),
    })
}

fn print(plan: &Plan, report: &Report) {
    let focus = if plan.refocus { ", each refocused" } else { "" };
    let lenses = counted(plan.lenses, "lens");
    println!("{lenses}{focus}; MTF50 in cycles/mm, T tangential, S sagittal");
    let head: String = PERCENTILES.iter().map(|p| format!("{:>9}", format!("{p} %"))).collect();
    println!("{:>9}   {:>9}{head}", "field deg", "nominal");
    for field in &report.fields {
        for (name, contrast) in [("T", &field.tangential), ("S", &field.sagittal)] {
            let s = &contrast.mtf50_per_mm;
            let values: String = s.percentiles.iter().map(|v| format!("{v:>9.2}")).collect();
            println!("{:>9.3} {name} {:>9.2}{values}", field.field_deg, s.nominal);
        }
    }
    println!(
        "loss of MTF at {:.2} cycles/mm by one departure alone, mean over the fields:",
        report.frequency_per_mm
    );
    for s in report.sensitivities.iter().take(LISTED) {
        let (p, unit) = (&s.perturbation, s.perturbation.kind.unit());
        let tolerance = format!("{}{unit}", p.tolerance);
        println!("{:>9.4}  {:<10} ±{tolerance:<10} {}", s.loss, p.kind.name(), p.place());
    }
    let more = report.sensitivities.len().saturating_sub(LISTED);
    if more > 0 {
        println!("           and {more} with a smaller loss (--json)");
    }
}
