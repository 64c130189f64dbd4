//! Photon transfer at several analog gains: ratios of the gains, and read noise before and after
//! the gain stage.
//!
//! Referred to the input, noise from before the gain stage is the same at every gain; noise from
//! after it falls as 1/g: σ²(g) = σ_pre² + σ_post²/g² (Janesick, *Photon Transfer*,
//! 2007, ch. 11). The camera file's `read_e` is σ(1), its `read_e_post` is σ_post.

use super::fit::Fit;
use super::ladder::Selection;
use super::ptc::{self, Ptc};
use camrig_base::Result;
use camrig_base::Value;
use camrig_captures::CaptureSet;
use serde::Serialize;

/// Figures at one gain.
#[derive(Clone, Debug, Serialize)]
pub struct AtGain {
    /// Analog gain of the captures.
    pub analog_gain: f64,
    /// System gain K, DN/e⁻.
    pub system_gain_dn_per_e: Option<Value>,
    /// K relative to that of the lowest gain, over the ratio of the nominal gains: 1 where the
    /// nominal gain is right.
    pub gain_ratio: Option<Value>,
    /// Read noise, input-referred, e⁻.
    pub read_noise_e: Option<Value>,
    /// Saturation capacity, e⁻.
    pub full_well_e: Option<Value>,
}

/// Figures over all gains.
#[derive(Clone, Debug, Serialize)]
pub struct Gains {
    /// Figures at each gain, by rising gain.
    pub gains: Vec<AtGain>,
    /// Read noise at unity gain, e⁻.
    pub read_e: Option<Value>,
    /// Read noise from after the gain stage, e⁻ at unity gain; `None` where the fit has no
    /// positive variance.
    pub read_e_post: Option<Value>,
}

/// Measures every analog gain that has flats and darks, each at the wavelength with most flats;
/// `None` with fewer than two gains.
///
/// # Errors
/// Those of the photon transfer at any of the gains.
pub fn measure(set: &CaptureSet) -> Result<Option<Gains>> {
    let mut chosen: Vec<Selection<'_>> = Vec::new();
    for selection in Selection::all(set).into_iter().filter(|s| !s.darks.is_empty()) {
        match chosen.iter_mut().find(|c| c.analog_gain == selection.analog_gain) {
            Some(same) if same.flats.len() < selection.flats.len() => *same = selection,
            Some(_) => {}
            None => chosen.push(selection),
        }
    }
    if chosen.len() < 2 {
        return Ok(None);
    }
    chosen.sort_by(|a, b| a.analog_gain.total_cmp(&b.analog_gain));
    let each: Vec<Ptc> = chosen
        .iter()
        .map(|s| {
            ptc::of_selection(set, s).map_err(|e| e.at(format!("analog gain {}", s.analog_gain)))
        })
        .collect::<Result<_>>()?;
    let lowest = &each[0];
    let gains: Vec<AtGain> = each
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let k = p.figures.system_gain_dn_per_e;
            let named = p.analog_gain / lowest.analog_gain;
            let ratio = k.zip(lowest.figures.system_gain_dn_per_e).map(|(k, k0)| match i {
                0 => Value::new(1.0, 0.0),
                _ => k.over(k0).scaled(1.0 / named),
            });
            AtGain {
                analog_gain: p.analog_gain,
                system_gain_dn_per_e: k,
                gain_ratio: ratio,
                read_noise_e: p.figures.read_noise_e,
                full_well_e: p.figures.full_well_e,
            }
        })
        .collect();
    let (read_e, read_e_post) = parts(&gains);
    Ok(Some(Gains { gains, read_e, read_e_post }))
}

/// Read noise at unity gain and from after the gain stage, by a weighted line of σ² over 1/g².
fn parts(gains: &[AtGain]) -> (Option<Value>, Option<Value>) {
    let variance = |at: &AtGain| {
        let (g, s) = (at.analog_gain, at.read_noise_e?);
        let variance = Value::new(s.value * s.value, 2.0 * s.value * s.std_error);
        Some((vec![1.0, 1.0 / (g * g)], variance))
    };
    let variances: Vec<_> = gains.iter().filter_map(variance).collect();
    let Ok(fit) = Fit::new(&variances) else { return (None, None) };
    let at_one = fit.covariance(0, 0) + 2.0 * fit.covariance(0, 1) + fit.covariance(1, 1);
    let unity = Value::new(fit.coefficients[0] + fit.coefficients[1], at_one.sqrt()).sqrt();
    (unity, Value::new(fit.coefficients[1], fit.covariance(1, 1).sqrt()).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::Camera;
    use camrig_capture::{plan, take};

    const PLAN: &str = "format = \"plan/1\"
[[stack]]
id = \"dark\"
role = \"dark\"
frames = 16
exposure_s = [0.0001, 0.2]
analog_gain = [1, 2, 4, 8]
[[stack]]
id = \"flat\"
role = \"flat\"
frames = 8
exposure_s = 0.01
analog_gain = [1, 2, 4, 8]
fill = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
light = { wavelength_nm = 550.0 }
";

    #[test]
    fn the_parts_before_and_after_the_gain_stage_come_back() {
        let directory = tempfile::tempdir().unwrap();
        let mut camera = Camera::load("mt9v024").unwrap();
        (camera.sensor.width, camera.sensor.height) = (128, 96);
        camera.sensor.bits = 12;
        let file = directory.path().join("plan.toml");
        std::fs::write(&file, PLAN).unwrap();
        let shots = plan::load(file.to_str().unwrap()).unwrap();
        let out = directory.path().join("set");
        take::take(&camera, &shots, &out, &take::TakeOptions::default(), || ()).unwrap();
        let found = measure(&CaptureSet::load(&out).unwrap()).unwrap().unwrap();
        assert_eq!(found.gains.len(), 4);
        let near = |v: Option<Value>, truth: f64, name: &str| {
            let v = v.unwrap_or_else(|| panic!("{name} not determined"));
            assert!((v.value - truth).abs() < 4.0 * v.std_error, "{name}: {v:?}, truth {truth}");
            assert!(v.std_error < 0.03 * truth, "{name}: {v:?}");
        };
        near(found.read_e, camera.sensor.noise.read_e, "read noise");
        near(found.read_e_post, camera.sensor.noise.read_e_post, "read noise after the gain");
        for g in &found.gains[1..] {
            near(g.gain_ratio, 1.0, "gain ratio");
        }
    }
}
