//! How much making errors cost: the MTF of many lenses that depart from their prescription.
//!
//! Each departure is drawn evenly between ± its tolerance (of what has a direction: evenly over a
//! disc), by a generator that depends on seed, lens and departure alone, so that any number of
//! threads gives the same lenses. The stop keeps its radius in mm. The MTF is that of diffraction
//! from real rays through the departing surfaces, in the weighted mean over the design wavelengths,
//! lateral colour included.

mod displaced;
mod otf;
mod perturbation;
#[cfg(test)]
mod tests;

pub use perturbation::{Kind, Perturbation, Tolerances};

use crate::prescription::Conditions;
use crate::prescription::Prescription;
use crate::system::System;
use camrig_base::{Error, Result};
use displaced::Displacement;
use otf::{Azimuth, Waves};
use perturbation::Departing;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Steps of frequency up to the prescription's lowest MTF50: the curve between two is nearly
/// straight.
const STEPS_TO_MTF50: f64 = 6.0;
/// Fewest and most steps of frequency up to the cut-off. The rim of the pupil makes the MTF err by
/// some 1e-3 with the fewest.
const STEPS_TO_CUT_OFF: [f64; 2] = [48.0, 96.0];
/// Percentiles of the report.
pub const PERCENTILES: [f64; 5] = [2.0, 10.0, 50.0, 90.0, 98.0];

/// What is asked.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Largest departures.
    pub tolerances: Tolerances,
    /// Number of lenses.
    pub lenses: usize,
    /// Seed of their departures.
    pub seed: u64,
    /// Whether each lens is focused again: its sensor follows the paraxial image.
    pub refocus: bool,
    /// Frequency at which the MTF is wanted, cycles/mm; `None`: the mean MTF50 of the
    /// prescription.
    pub frequency_per_mm: Option<f64>,
    /// Fields, degrees.
    pub fields_deg: Vec<f64>,
}

/// A figure of the prescription and its percentiles over the lenses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Of the prescription.
    pub nominal: f64,
    /// At [`PERCENTILES`]: so many percent of the lenses have less.
    pub percentiles: [f64; 5],
}

/// Figures of one field and azimuth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contrast {
    /// Frequency at which the MTF first falls to 1/2, cycles/mm.
    pub mtf50_per_mm: Spread,
    /// MTF at the report's frequency.
    pub mtf: Spread,
}

/// Figures of one field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Bars along y, radially.
    pub tangential: Contrast,
    /// Bars along x.
    pub sagittal: Contrast,
}

/// What one departure costs, alone and at its tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensitivity {
    /// The departure.
    pub perturbation: Perturbation,
    /// Largest loss of the MTF at the report's frequency, in the mean over fields and azimuths:
    /// positive where the picture gets worse.
    pub loss: f64,
}

/// What comes out.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Frequency of the MTF figures, cycles/mm.
    pub frequency_per_mm: f64,
    /// Figures per field.
    pub fields: Vec<Field>,
    /// What each departure costs, the dearest first.
    pub sensitivities: Vec<Sensitivity>,
}

/// MTF50 and MTF of one lens: per field, tangential and sagittal.
type Figures = Vec<[[f64; 2]; 2]>;

/// Computes the report; `progress(done, total)` is called after each lens, from any thread.
///
/// # Errors
/// A plan without lenses or fields, tolerances that have no meaning, a departing lens whose rays
/// are lost (the error names it).
pub fn report(
    system: &System,
    plan: &Plan,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Report> {
    if plan.lenses == 0 || plan.fields_deg.is_empty() {
        return Err(Error::input(format!(
            "{} lenses at {} fields",
            plan.lenses,
            plan.fields_deg.len()
        ))
        .help("give at least one of each"));
    }
    let perturbations = plan.tolerances.perturbations(&system.prescription)?;
    let study = Study::new(system, plan)?;
    let nominal = study.figures(&Departing::new(&system.prescription))?;
    let (done, all) = (AtomicUsize::new(0), plan.lenses + perturbations.len());
    let count = || progress(done.fetch_add(1, Ordering::Relaxed) + 1, all);
    let lenses: Result<Vec<Figures>> = (0..plan.lenses)
        .into_par_iter()
        .map(|number| {
            let mut departing = Departing::new(&system.prescription);
            for (i, perturbation) in perturbations.iter().enumerate() {
                let amount = draw(plan.seed, number, i, perturbation.kind.turns());
                perturbation.apply(&mut departing, amount);
            }
            let figures = study.figures(&departing).map_err(|e| e.at(format!("lens {number}")));
            count();
            figures
        })
        .collect();
    let lenses = lenses?;
    let sensitivities: Result<Vec<Sensitivity>> = perturbations
        .par_iter()
        .map(|perturbation| {
            let loss = study.loss(perturbation, &nominal).map_err(|e| e.at(perturbation.place()));
            count();
            Ok(Sensitivity { perturbation: *perturbation, loss: loss? })
        })
        .collect();
    let mut sensitivities = sensitivities?;
    sensitivities.sort_by(|a, b| b.loss.total_cmp(&a.loss));
    let field = |(f, field_deg): (usize, &f64)| {
        let spread = |azimuth: usize, figure: usize| {
            let of = |figures: &Figures| figures[f][azimuth][figure];
            Spread {
                nominal: of(&nominal),
                percentiles: percentiles(lenses.iter().map(of).collect()),
            }
        };
        let contrast =
            |azimuth| Contrast { mtf50_per_mm: spread(azimuth, 0), mtf: spread(azimuth, 1) };
        Field { field_deg: *field_deg, tangential: contrast(0), sagittal: contrast(1) }
    };
    Ok(Report {
        frequency_per_mm: study.frequency_per_mm,
        fields: plan.fields_deg.iter().enumerate().map(field).collect(),
        sensitivities,
    })
}

/// The prescription and the frequencies at which departing lenses are examined.
struct Study<'a> {
    system: &'a System,
    plan: &'a Plan,
    step_per_mm: f64,
    frequency_per_mm: f64,
    /// Of `frequency_per_mm`.
    steps: usize,
}

impl<'a> Study<'a> {
    fn new(system: &'a System, plan: &'a Plan) -> Result<Self> {
        if system.paraxial.telecentric {
            return Err(Error::unsupported(
                "tolerances of a lens that is telecentric in object space",
            )
            .help("lenses with an entrance pupil at a finite distance are studied"));
        }
        let cut_off = otf::cut_off_per_mm(system)?;
        let [fewest, most] = STEPS_TO_CUT_OFF;
        let coarse = cut_off / most;
        let still = vec![Displacement::default(); system.prescription.surfaces.len()];
        let mut mtf50 = Vec::new();
        for deg in &plan.fields_deg {
            let waves = Waves::trace(system, &still, *deg, coarse)?;
            mtf50.extend([Azimuth::Tangential, Azimuth::Sagittal].map(|a| waves.mtf50(a)));
        }
        let mean = mtf50.iter().sum::<f64>() / mtf50.len() as f64;
        let lowest = mtf50.iter().copied().fold(f64::INFINITY, f64::min);
        let frequency_per_mm = plan.frequency_per_mm.unwrap_or(mean);
        if !(frequency_per_mm > 0.0 && frequency_per_mm < cut_off) {
            return Err(Error::input(format!("frequency {frequency_per_mm} cycles/mm"))
                .help(format!("give one above 0 and below the cut-off, {cut_off:.4} cycles/mm")));
        }
        let wanted = (lowest / STEPS_TO_MTF50).clamp(cut_off / most, cut_off / fewest);
        let steps = (frequency_per_mm / wanted).ceil().max(1.0);
        let step_per_mm = frequency_per_mm / steps;
        Ok(Self { system, plan, step_per_mm, frequency_per_mm, steps: steps as usize })
    }

    /// The departing lens, focused again where that is asked for.
    fn lens(&self, departing: &Departing) -> Result<System> {
        let conditions = Conditions {
            stop_radius_mm: Some(self.system.stop_radius_mm),
            ..Conditions::default()
        };
        let build = |lens: Prescription| System::new(lens, conditions);
        let mut system = build(departing.lens.clone())?;
        if self.plan.refocus {
            let image = |s: &System| s.paraxial.image_distance_mm;
            let mut lens = departing.lens.clone();
            if let Some(last) = lens.surfaces.last_mut() {
                last.thickness += image(&system) - image(self.system);
            }
            system = build(lens)?;
        }
        Ok(system)
    }

    fn figures(&self, departing: &Departing) -> Result<Figures> {
        let system = self.lens(departing)?;
        let field = |deg: &f64| {
            let waves = Waves::trace(&system, &departing.displacements, *deg, self.step_per_mm)?;
            Ok([Azimuth::Tangential, Azimuth::Sagittal]
                .map(|azimuth| [waves.mtf50(azimuth), waves.mtf(azimuth, self.steps)]))
        };
        self.plan.fields_deg.iter().map(field).collect()
    }

    /// The largest loss of mean MTF by one departure, on either side (of what has a direction:
    /// along ±y and x).
    fn loss(&self, perturbation: &Perturbation, nominal: &Figures) -> Result<f64> {
        let ways: &[[f64; 2]] = match perturbation.kind.turns() {
            true => &[[0.0, 1.0], [0.0, -1.0], [1.0, 0.0]],
            false => &[[1.0, 0.0], [-1.0, 0.0]],
        };
        let mut largest = f64::NEG_INFINITY;
        for way in ways {
            let mut departing = Departing::new(&self.system.prescription);
            perturbation.apply(&mut departing, *way);
            let loss = mean_mtf(nominal) - mean_mtf(&self.figures(&departing)?);
            largest = largest.max(loss);
        }
        Ok(largest)
    }
}

fn mean_mtf(figures: &Figures) -> f64 {
    let all = figures.iter().flatten().map(|[_, mtf]| mtf);
    all.sum::<f64>() / (2 * figures.len()) as f64
}

/// A departure's amount: from −1 to 1, or a place in the unit disc.
fn draw(seed: u64, lens: usize, departure: usize, disc: bool) -> [f64; 2] {
    let key = mixed(seed ^ mixed(lens as u64 ^ mixed(departure as u64)));
    let even = |i: u64| (mixed(key.wrapping_add(i)) >> 11) as f64 / (1_u64 << 53) as f64;
    if !disc {
        return [2.0 * even(0) - 1.0, 0.0];
    }
    let (s, c) = libm::sincos(std::f64::consts::TAU * even(1));
    [c, s].map(|v| v * even(0).sqrt())
}

/// One step of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): all bits of the input reach all
/// bits of the output.
fn mixed(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// [`PERCENTILES`] of the values, in straight lines between them.
fn percentiles(mut values: Vec<f64>) -> [f64; 5] {
    values.sort_by(f64::total_cmp);
    PERCENTILES.map(|percent| {
        let place = percent / 100.0 * (values.len() - 1) as f64;
        let (below, part) = (place.floor() as usize, place.fract());
        let above = (below + 1).min(values.len() - 1);
        values[below] + part * (values[above] - values[below])
    })
}
