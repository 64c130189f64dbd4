//! Photon transfer at several analog gains: ratios of the gains, and read noise before and after
//! the gain stage.
//!
//! Referred to the input, noise from before the gain stage is the same at every gain; noise from
//! after it falls as 1/g: σ²(g) = σ_pre² + σ_post²/g² (Janesick, *Photon Transfer*,
//! 2007, ch. 11). The camera file's `read_e` is σ(1), its `read_e_post` is σ_post.

use super::fit::Fit;
use super::ladder::Selection;
use super::ptc::{self, Ptc};
use camrig_base::tails::misfit;
use camrig_base::{Error, ErrorKind, Result, Value};
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
    /// Read noise, input-referred, e⁻: without the dark charge's shot noise, if any gain shows that.
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
    /// Why there are no figures over the gains, and what to use, where their law does not hold.
    pub note: Option<String>,
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
    let charge = charge_in_darks(&each);
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
                read_noise_e: without(p, charge),
                full_well_e: p.figures.full_well_e,
            }
        })
        .collect();
    Ok(Some(over(gains)))
}

/// Dark charge of the mean pixel, hot ones included, over the gains that show it, e⁻/s.
fn charge_in_darks(each: &[Ptc]) -> Option<Value> {
    let rate = |p: &Ptc| {
        let f = &p.figures;
        let hot = f.hot_pixel_fraction.zip(f.hot_pixel_mean_e_per_s);
        let hot = hot.map_or(0.0, |(share, mean)| share.value * mean.value);
        f.dark_current_e_per_s.map(|v| Value::new(v.value + hot, v.std_error))
    };
    Value::combine(each.iter().filter_map(rate))
}

/// Read noise at a gain without the shot noise of the dark charge, which is in it where the darks
/// have one exposure.
fn without(p: &Ptc, charge: Option<Value>) -> Option<Value> {
    let read = p.figures.read_noise_e?;
    let Some(charge) = charge.filter(|_| p.figures.dark_current_e_per_s.is_none()) else {
        return Some(read);
    };
    let variance = read.value * read.value - charge.value.max(0.0) * p.dsnu_exposure_s;
    let error =
        libm::hypot(2.0 * read.value * read.std_error, charge.std_error * p.dsnu_exposure_s);
    Value::new(variance, error).sqrt()
}

/// `[sensor.gains]` of a camera file from what was measured at each gain.
fn table(gains: &[AtGain]) -> Option<String> {
    let column = |of: fn(&AtGain) -> Option<f64>| -> Option<String> {
        let values: Option<Vec<String>> =
            gains.iter().map(|at| of(at).map(|v| format!("{v:.5}"))).collect();
        Some(values?.join(", "))
    };
    Some(format!(
        "[sensor.gains]\nat = [{}]\nread_e = [{}]\ndn_per_e = [{}]",
        column(|at| Some(at.analog_gain))?,
        column(|at| Some(at.read_noise_e?.value))?,
        column(|at| Some(at.system_gain_dn_per_e?.value))?,
    ))
}

/// Read noise over the gains by its parts before and after the gain stage.
#[derive(Clone, Copy, Debug)]
pub struct ReadLaw {
    /// Read noise at unity gain, e⁻; `None` where the fit has no positive variance, as below.
    pub read_e: Option<Value>,
    /// Read noise from after the gain stage, e⁻ at unity gain.
    pub read_e_post: Option<Value>,
}

/// The law through the variances of the read noise, e⁻², each with its gain: a weighted line over
/// 1/g².
///
/// # Errors
/// Fewer than two gains; variances that do not lie on one line, by χ².
pub fn read_law(variances: &[(f64, Value)]) -> Result<ReadLaw> {
    let datum = |&(g, v): &(f64, Value)| (vec![1.0, 1.0 / (g * g)], v);
    let fit = Fit::new(&variances.iter().map(datum).collect::<Vec<_>>())?;
    if fit.freedom > 0 && misfit(fit.chi2, fit.freedom as f64).is_some() {
        return Err(Error::disagreement(format!(
            "the read noise over the gains is no law of a part before and a part after the gain \
             stage (chi2 {:.0} of {} degrees of freedom), as with two conversion gains or a \
             digital gain",
            fit.chi2, fit.freedom
        )));
    }
    let at_one = fit.covariance(0, 0) + 2.0 * fit.covariance(0, 1) + fit.covariance(1, 1);
    let unity = Value::new(fit.coefficients[0] + fit.coefficients[1], at_one.sqrt());
    let read_e_post = Value::new(fit.coefficients[1], fit.covariance(1, 1).sqrt()).sqrt();
    Ok(ReadLaw { read_e: unity.sqrt(), read_e_post })
}

/// The figures with read noise at unity gain and from after the gain stage, where the gains lie on
/// one law.
fn over(gains: Vec<AtGain>) -> Gains {
    let variance = |at: &AtGain| {
        let s = at.read_noise_e?;
        Some((at.analog_gain, Value::new(s.value * s.value, 2.0 * s.value * s.std_error)))
    };
    let variances: Vec<_> = gains.iter().filter_map(variance).collect();
    match read_law(&variances) {
        Ok(law) => Gains { gains, read_e: law.read_e, read_e_post: law.read_e_post, note: None },
        Err(error) => {
            let no_law = error.kind() == ErrorKind::Disagreement;
            let table = table(&gains).map_or(String::new(), |table| format!("; use\n{table}"));
            let note = format!("{error}: no read_e and read_e_post over the gains{table}");
            Gains { gains, read_e: None, read_e_post: None, note: no_law.then_some(note) }
        }
    }
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
        // Far enough above 0 that no dark pixel is cut at the highest gain.
        (camera.sensor.bits, camera.sensor.black_level_dn) = (12, 200.0);
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

    /// Beyond gain 2, codes are multiplied: system gains grow, and the read noise in electrons stays
    /// that of gain 2, as rounding before and after the multiplication is subtracted.
    #[test]
    fn a_digital_gain_leaves_the_read_noise_in_electrons() {
        const FULL_WELL_E: f64 = 20_000.0;
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name);
        std::fs::write(
            path("camera.toml"),
            format!(
                "name = \"digital\"\n[lens]\nkind = \"diffraction-limited\"\nf_number = 4\n\
                 focal_length_mm = 8\nrelative_illumination = \"none\"\n[sensor]\nwidth = 128\n\
                 height = 96\npitch_um = 5\nfill_factor = 1\ncfa = \"mono\"\nqe = 0.6\n\
                 full_well_e = {FULL_WELL_E}\nbits = 12\nblack_level_dn = 64\n[sensor.noise]\n\
                 read_e = 4\ndark_current_e_per_s = 0\nprnu = 0.005\n[sensor.gains]\n\
                 at = [1, 2]\nread_e = [4, 3]\ndigital_above = 2\n"
            ),
        )
        .unwrap();
        let plan = PLAN
            .replace("[1, 2, 4, 8]", "[2, 3, 4, 5]")
            .replace("exposure_s = [0.0001, 0.2]", "exposure_s = 0.001");
        std::fs::write(path("plan.toml"), plan.replace("0.4, 0.5, 0.6", "0.35")).unwrap();
        let camera = Camera::load(path("camera.toml").to_str().unwrap()).unwrap();
        let shots = plan::load(path("plan.toml").to_str().unwrap()).unwrap();
        let out = path("set");
        take::take(&camera, &shots, &out, &take::TakeOptions::default(), || ()).unwrap();
        let found = measure(&CaptureSet::load(&out).unwrap()).unwrap().unwrap();
        for at in &found.gains {
            for (name, value, truth, worst) in [
                ("read noise", at.read_noise_e, 3.0, 0.01),
                ("gain", at.system_gain_dn_per_e, 4095.0 / FULL_WELL_E * at.analog_gain, 0.01),
            ] {
                let v = value.unwrap();
                let gain = at.analog_gain;
                assert!((v.value - truth).abs() < 4.0 * v.std_error, "{name}, {gain}: {v:?}");
                assert!(v.std_error < worst * truth, "{name}, {gain}: {v:?}");
            }
        }
    }

    /// Darks of several exposures at one of two gains: their dark charge is no read noise of the
    /// other. Hot pixels stand apart from the ordinary ones.
    #[test]
    fn dark_charge_is_no_read_noise_and_hot_pixels_are_no_spread() {
        const PLAN: &str = "format = \"plan/1\"
[[stack]]
id = \"dark\"
role = \"dark\"
frames = 16
exposure_s = [0.05, 0.5]
analog_gain = 1
[[stack]]
id = \"short\"
role = \"dark\"
frames = 16
exposure_s = 0.05
analog_gain = 8
[[stack]]
id = \"flat\"
role = \"flat\"
frames = 8
exposure_s = 0.05
analog_gain = [1, 8]
fill = [0.2, 0.4, 0.6]
light = { wavelength_nm = 550.0 }
";
        let directory = tempfile::tempdir().unwrap();
        let mut camera = Camera::load("mt9v024").unwrap();
        (camera.sensor.width, camera.sensor.height) = (128, 96);
        (camera.sensor.bits, camera.sensor.black_level_dn) = (12, 200.0);
        let noise = &mut camera.sensor.noise;
        (noise.dark_current_e_per_s, noise.dsnu_e_per_s) = (200.0, 30.0);
        (noise.read_e, noise.read_e_post, noise.row_fpn_e) = (6.0, 0.0, 0.0);
        camera.sensor.temperature_c = noise.temperature_ref_c;
        let at_c = noise.temperature_ref_c as f32;
        let hot = camrig_camera::AnyEffect::new("hot-pixels", &[0.006, 3000.0, 7.0, at_c]);
        let Some(camrig_camera::AnyEffect::Sensor(hot)) = hot else { panic!() };
        camera.effects.push(hot);
        let file = directory.path().join("plan.toml");
        std::fs::write(&file, PLAN).unwrap();
        let shots = plan::load(file.to_str().unwrap()).unwrap();
        let out = directory.path().join("set");
        take::take(&camera, &shots, &out, &take::TakeOptions::default(), || ()).unwrap();
        let set = CaptureSet::load(&out).unwrap();
        let near = |v: Option<Value>, truth: f64, part: f64| {
            let v = v.unwrap();
            assert!((v.value / truth - 1.0).abs() < part, "{v:?} for {truth}");
        };
        let gains = measure(&set).unwrap().unwrap();
        for at in &gains.gains {
            // Without it, the charge of hot and ordinary pixels would add 10 e-².
            near(at.read_noise_e, 6.0, 0.03);
        }
        let selections = Selection::all(&set);
        let at_one = selections.iter().find(|s| s.analog_gain == 1.0).unwrap();
        let found = ptc::of_selection(&set, at_one).unwrap().figures;
        near(found.dark_current_e_per_s, 200.0, 0.01);
        near(found.dsnu_e_per_s, 30.0, 0.05);
        near(found.hot_pixel_fraction, 0.006, 0.4);
        near(found.hot_pixel_mean_e_per_s, 3000.0, 0.4);
    }

    /// Two conversion gains, the second from 3.333 on, and a digital gain of 2 above 6.667: read
    /// noises that no part before and after one gain stage gives. The table of a camera file is
    /// proposed.
    #[test]
    fn two_conversion_gains_are_no_law_of_two_parts() {
        let at = |analog_gain, read_e, dn_per_e| AtGain {
            analog_gain,
            system_gain_dn_per_e: Some(Value::new(dn_per_e, 0.002)),
            gain_ratio: None,
            read_noise_e: Some(Value::new(read_e, 0.004 * read_e)),
            full_well_e: None,
        };
        let law = |g: f64| (33.0 + 3.0 / (g * g)).sqrt();
        let one = over([1.0, 2.0, 4.0].map(|g| at(g, law(g), 0.2 * g)).to_vec());
        assert!((one.read_e.unwrap().value - 6.0).abs() < 1e-6 && one.note.is_none());
        let two = [(1.0, 6.0), (2.0, 4.153), (3.333, 2.2), (6.667, 1.461), (13.333, 1.461)];
        let two = over(two.map(|(g, read_e)| at(g, read_e, 0.2047 * g)).to_vec());
        assert!(two.read_e.is_none() && two.read_e_post.is_none());
        let note = two.note.unwrap();
        let (said, table) = note.split_once("use\n").unwrap();
        assert!(said.contains("no law of a part before"), "{said}");
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines[1], "at = [1.00000, 2.00000, 3.33300, 6.66700, 13.33300]");
        assert_eq!(lines[2], "read_e = [6.00000, 4.15300, 2.20000, 1.46100, 1.46100]");
        assert!(lines[3].starts_with("dn_per_e = [0.20470, 0.40940, "), "{table}");
    }
}
