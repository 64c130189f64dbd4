//! Coupling of collected charge into neighbouring pixels, from the correlation of a flat's shot
//! noise.
//!
//! The crosstalk experiment ([`super::crosstalk`]) measures optical and electrical crosstalk
//! together, and only their low spatial frequencies. Electrical coupling acts after the shot noise
//! and correlates the noise of neighbours; optical crosstalk and diffusion of single carriers act
//! before it and do not. So this fit separates the two (Moore, Ninkov and Forrest 2004).

use super::copies;
use super::correlation::NoiseCorrelation;
use super::moments::SATURATED_SHARE;
use super::stack::Stack;
use camrig_base::Value;
use camrig_base::{Error, Result};
use camrig_captures::{Capture, CaptureSet, Role};
use serde::Serialize;

/// Smallest share of a flat's temporal variance that has to be shot noise. Below a tenth, the
/// correlation is divided by so small a share that its error exceeds usual couplings.
const MIN_SHOT_SHARE: f64 = 0.1;
/// Steps of the fixed-point iteration for the shares; each multiplies the error by about
/// 2 (a + b), so that 50 reach f64 precision for shares up to 0.1.
const ITERATIONS: usize = 50;

/// Shares of a pixel's charge that couple into its neighbours.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Coupling {
    /// Share that each of the left and right neighbours gets.
    pub horizontal: Value,
    /// Share to the neighbours above and below, each.
    pub vertical: Value,
}

/// Fits the shares to the unsaturated flat with the most temporal noise.
///
/// With shares a and b to the left and right, above and below, the noise of neighbours in a row
/// has the correlation ρ = 2 a c / (c² + 2 a² + 2 b²), c = 1 - 2 a - 2 b (products of two shares
/// that share no third pixel are neglected). Read noise is added after the coupling: it lowers
/// the correlation by the share of the variance that is not shot noise, which is measured on the
/// dark of the same gain and nearest exposure.
///
/// # Errors
/// No unsaturated flat with two frames, the same frame twice, no dark to take the read noise from,
/// a flat without shot noise.
pub fn fit(set: &CaptureSet) -> Result<Coupling> {
    let channels = set.cfa().channels().len();
    let variance = |stack: &Stack| {
        (0..channels).map(|c| stack.channel_moments(c).temporal).sum::<f64>() / channels as f64
    };
    let mut flat: Option<(&Capture, Stack, f64)> = None;
    for capture in set.with_role(Role::Flat) {
        let stack = Stack::read_moments(set, capture)?;
        copies::refuse(set, capture, &stack)?;
        let whites = (0..channels).map(|c| stack.channel_moments(c).whites).fold(0.0, f64::max);
        let total = variance(&stack);
        if stack.frames > 1
            && whites < SATURATED_SHARE
            && flat.as_ref().is_none_or(|f| total > f.2)
        {
            flat = Some((capture, stack, total));
        }
    }
    let (flat, flat_stack, total) = flat.ok_or_else(|| {
        Error::input("no unsaturated flat capture of several frames")
            .help("coupling is measured from the noise of flats: add one at half saturation")
    })?;
    let apart = |c: &&Capture| libm::log(c.exposure_s / flat.exposure_s).abs();
    let dark = set
        .with_role(Role::Dark)
        .filter(|c| c.analog_gain == flat.analog_gain)
        .min_by(|a, b| apart(a).total_cmp(&apart(b)))
        .ok_or_else(|| {
            Error::input(format!("no dark captures at analog gain {}", flat.analog_gain))
                .help("the read noise must be known")
        })?;
    let shot_share = 1.0 - variance(&Stack::read_moments(set, dark)?) / total;
    if shot_share.is_nan() || shot_share < MIN_SHOT_SHARE {
        return Err(Error::input("the flat's noise is not shot noise")
            .at(format!("capture {:?}", flat.id))
            .help("use a flat at half saturation"));
    }
    let correlation = NoiseCorrelation::of(set, flat, &flat_stack, 0.0)?;
    let (h, v) =
        (correlation.right.scaled(1.0 / shot_share), correlation.below.scaled(1.0 / shot_share));
    let (mut a, mut b) = (0.5 * h.value, 0.5 * v.value);
    for _ in 0..ITERATIONS {
        let c = 1.0 - 2.0 * a - 2.0 * b;
        let norm = c * c + 2.0 * a * a + 2.0 * b * b;
        (a, b) = (0.5 * h.value * norm / c, 0.5 * v.value * norm / c);
    }
    // dρ/da of the formula above, c = 1 - 2 a - 2 b.
    let c = 1.0 - 2.0 * a - 2.0 * b;
    let norm = c * c + 2.0 * a * a + 2.0 * b * b;
    let slope = |share: f64| {
        (2.0 * c - 4.0 * share) / norm + 8.0 * share * c * (c - share) / (norm * norm)
    };
    Ok(Coupling {
        horizontal: Value::new(a, h.std_error / slope(a)),
        vertical: Value::new(b, v.std_error / slope(b)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Hits, Sensor, Shot};
    use camrig_camera::Camera;
    use camrig_capture::{plan, take};
    use camrig_sensor_core::effects::charge_coupling::ChargeCoupling;
    use camrig_sensor_core::effects::optical_crosstalk::OpticalCrosstalk;
    use rand_xoshiro::rand_core::{Rng, SeedableRng};

    const PLAN: &str = "format = \"plan/1\"
[[stack]]
id = \"dark\"
role = \"dark\"
frames = 16
exposure_s = 0.01
[[stack]]
id = \"flat\"
role = \"flat\"
frames = 16
exposure_s = 0.01
fill = [0.1, 0.6]
light = { wavelength_nm = 550.0 }
[[stack]]
id = \"saturated\"
role = \"flat\"
frames = 4
exposure_s = 0.01
fill = 1.5
light = { wavelength_nm = 550.0 }
saturates = true
";

    fn measured(change: impl Fn(&mut Camera)) -> Coupling {
        let directory = tempfile::tempdir().unwrap();
        let mut camera = Camera::load("mt9t012").unwrap();
        (camera.sensor.width, camera.sensor.height) = (256, 192);
        camera.sensor.cfa = camrig_base::Cfa::parse("GRBG").unwrap();
        change(&mut camera);
        let file = directory.path().join("plan.toml");
        std::fs::write(&file, PLAN).unwrap();
        let shots = plan::load(file.to_str().unwrap()).unwrap();
        let out = directory.path().join("set");
        take::take(&camera, &shots, &out, &take::TakeOptions::default(), || ()).unwrap();
        fit(&CaptureSet::load(&out).unwrap()).unwrap()
    }

    fn near(found: Value, truth: f64) {
        // Four standard errors; the formula neglects terms of third order in the shares.
        let tolerance = 4.0 * found.std_error + 10.0 * truth.powi(3);
        assert!((found.value - truth).abs() < tolerance, "{found:?} instead of {truth}");
    }

    /// Sixty random cameras of an independent sensor: with twenty, the rate of deviations would be
    /// too uncertain.
    #[test]
    fn random_couplings_are_recovered() {
        let mut hits = Hits::default();
        for seed in 0..60 {
            let mut rng = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(3000 + seed);
            let mut between = |low: f64, high: f64| {
                low + (high - low) * (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
            };
            let sensor = Sensor {
                read_e: between(2.0, 20.0),
                prnu: between(0.005, 0.02),
                cfa: if seed % 2 == 0 { "mono" } else { "GRBG" },
                coupling: [between(0.001, 0.02), between(0.001, 0.02)],
                seed: 100 * seed + 1,
                ..Sensor::default()
            };
            let shot = |electrons: f64| Shot {
                exposure_s: 0.02,
                rate: electrons / sensor.qe[0] / 0.02,
                frames: 16,
                temperature_c: 25.0,
                analog_gain: 1.0,
            };
            let directory = tempfile::tempdir().unwrap();
            sensor.write(directory.path(), &[shot(0.0), shot(0.5 * sensor.full_well_e)]);
            let found = fit(&CaptureSet::load(directory.path()).unwrap()).unwrap();
            hits.add("horizontal", Some(found.horizontal), sensor.coupling[0]);
            hits.add("vertical", Some(found.vertical), sensor.coupling[1]);
        }
        hits.check();
    }

    /// Electrical coupling comes back; optical crosstalk, before the shot noise, does not show.
    #[test]
    fn electrical_and_optical_parts_come_apart() {
        let side = ChargeCoupling { side: 0.02, vertical: 0.008, diagonal: 0.0 };
        let found = measured(|c| c.effects.push(side.into()));
        near(found.horizontal, 0.02);
        near(found.vertical, 0.008);
        let values = [0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let optical =
            OpticalCrosstalk::from_values(&values[..OpticalCrosstalk::ENTRY.parameters.len()]);
        let found = measured(|c| c.effects.push(optical.into()));
        near(found.horizontal, 0.0);
        near(found.vertical, 0.0);
    }
}
