//! Noise profiles: the variance of a pixel over its signal, per gain.

use super::imported::{Beside, Imported, numbers};
use camrig_base::{Error, Result};
use camrig_camera::Change;
use camrig_camera::draft::{Basis, Known};
use camrig_camera::typical::rounded;
use camrig_formats::Facts;
use camrig_linear::{LeastSquares, Matrix, Vector};
use camrig_sensor_core::config::AtGain;
use serde_json::{Value as Json, json};
use std::path::Path;

/// Digits of values that follow from others, beyond which they are rounding.
const DIGITS: usize = 9;
/// Part by which figures may lie beside a law over the gains that stands for them: a tenth of what
/// the gains of a sensor are stated to.
const MAX_OFF: f64 = 0.001;

/// Variance of the noise at a gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Analog gain.
    pub gain: f64,
    /// S, or β₁.
    pub shot: f64,
    /// O, or β₂.
    pub offset: f64,
    /// Black level, DN.
    pub black_level_dn: f64,
    /// White level, DN.
    pub white_level_dn: f64,
}

/// Columns of the table of profiles.
const COLUMNS: &str = "gain,shot,offset,black_level_dn,white_level_dn";

/// Profiles as a table (CSV), with the columns `gain,shot,offset,black_level_dn,white_level_dn`.
pub fn to_table(profiles: &[Profile]) -> String {
    let line = |p: &Profile| {
        let Profile { gain, shot, offset, black_level_dn, white_level_dn } = p;
        format!("{gain},{shot:e},{offset:e},{black_level_dn},{white_level_dn}\n")
    };
    format!("{COLUMNS}\n{}", profiles.iter().map(line).collect::<String>())
}

/// What a table says; none without its head.
pub(super) fn of_table(text: &str) -> Option<Result<Imported>> {
    let mut lines = text.lines().filter(|line| !line.trim().is_empty());
    let head = lines.next().map(str::trim) == Some(COLUMNS);
    head.then(|| profiles(&rows(lines)?, "the noise profile"))
}

fn rows<'a>(mut lines: impl Iterator<Item = &'a str>) -> Result<Vec<Profile>> {
    let wrong = |line: &str| {
        Error::input(format!("{line:?} in a table of noise profiles"))
            .help(format!("a number in each of the columns {COLUMNS}"))
    };
    let of = |line: &str| {
        let numbers: Vec<f64> =
            line.split(',').map(|v| v.trim().parse().ok()).collect::<Option<_>>()?;
        let [gain, shot, offset, black_level_dn, white_level_dn] = numbers[..] else {
            return None;
        };
        Some(Profile { gain, shot, offset, black_level_dn, white_level_dn })
    };
    lines.try_fold(Vec::new(), |mut all, line| {
        all.push(of(line).ok_or_else(|| wrong(line))?);
        Ok(all)
    })
}

/// The tags of DNG files of one camera: gain 1 is the lowest ISO among them.
pub(super) fn of_dngs(files: &[impl AsRef<Path>]) -> Result<Imported> {
    let mut all: Vec<(u32, Profile, Facts)> = Vec::new();
    let mut size = None;
    for file in files.iter().map(AsRef::as_ref) {
        let frames = camrig_formats::read(file).map_err(|e| e.at(file.display()))?;
        size = size.or(frames.planes.first().map(|plane| [plane.width, plane.height]));
        let facts = frames.facts;
        let profile = || {
            let dng = facts.dng.as_ref()?;
            let n = dng.noise_profile.len() as f64;
            let (shot, offset) =
                dng.noise_profile.iter().fold((0.0, 0.0), |(s, o), p| (s + p.0 / n, o + p.1 / n));
            let (black_level_dn, white) = (facts.black_level_dn?, facts.white_level_dn?);
            let profile =
                Profile { gain: 1.0, shot, offset, black_level_dn, white_level_dn: white.into() };
            (n > 0.0).then_some((dng.iso?, profile))
        };
        let (iso, profile) = profile().ok_or_else(|| {
            Error::input("a DNG without ISO, NoiseProfile, black or white level")
                .at(file.display())
                .help("take dark and flat frames with the camera: camrig camera fit")
        })?;
        all.push((iso, profile, facts));
    }
    all.sort_by_key(|(iso, ..)| *iso);
    let Some((lowest, _, facts)) = all.first() else { return Err(Error::input("no file")) };
    let with_gain = |(iso, p, _): &(u32, Profile, Facts)| Profile {
        gain: f64::from(*iso) / f64::from(*lowest),
        ..*p
    };
    let mut found = profiles(&all.iter().map(with_gain).collect::<Vec<_>>(), "DNG NoiseProfile")?;
    found.notes.push(format!("gain 1 is ISO {lowest}, the lowest of the files"));
    let from = "DNG";
    if let Some([width, height]) = size {
        found.add("sensor.width", width as i64, from);
        found.add("sensor.height", height as i64, from);
    }
    if let Some(cfa) = &facts.cfa {
        found.add("sensor.cfa", cfa.to_string(), from);
    }
    if let Some(dng) = &facts.dng {
        let lens =
            [("lens.f_number", dng.f_number), ("lens.focal_length_mm", dng.focal_length_mm)];
        lens.into_iter()
            .filter_map(|(key, v)| Some((key, v?)))
            .for_each(|(k, v)| found.add(k, v, from));
        found.known.extend(dng.pitch_um.map(|pitch| Known {
            change: Change::new("sensor.pitch_um", pitch),
            basis: Basis::given(from),
        }));
    }
    Ok(found)
}

/// Gain, read noise and levels that profiles give: by the two laws of a camera file where all
/// profiles are on them, else by `[sensor.gains]`.
fn profiles(all: &[Profile], from: &str) -> Result<Imported> {
    let wrong =
        |p: &Profile| !(p.gain > 0.0 && p.shot > 0.0 && p.white_level_dn > p.black_level_dn);
    if let Some(p) = all.iter().find(|p| wrong(p)) {
        return Err(
            Error::input(format!("{p:?}")).help("gain and shot are above 0, white above black")
        );
    }
    let mut all = all.to_vec();
    all.sort_by(|a, b| a.gain.total_cmp(&b.gain));
    let Some(first) = all.first() else { return Err(Error::input("no noise profile")) };
    if let Some(two) = all.windows(2).find(|two| two[0].gain == two[1].gain) {
        return Err(Error::input(format!("two profiles of gain {}", two[0].gain)));
    }
    let bits = libm::ceil(libm::log2(first.white_level_dn + 1.0));
    let top = libm::exp2(bits) - 1.0;
    let range = |p: &Profile| p.white_level_dn - p.black_level_dn;
    let n = all.len() as f64;
    let dn_per_e = |p: &Profile| p.shot * range(p);
    let unity = all.iter().map(|p| dn_per_e(p) / p.gain).sum::<f64>() / n;
    let read_e2 = |p: &Profile| {
        let r = range(p);
        ((p.offset - 1.0 / (12.0 * r * r)) / (p.shot * p.shot)).max(0.0)
    };
    let read_e = |p: &Profile| read_e2(p).sqrt();
    let mut found = Imported::default();
    found.add("sensor.bits", bits as i64, from);
    found.add("sensor.black_level_dn", first.black_level_dn, from);
    found.add("sensor.full_well_e", rounded(top / unity, DIGITS), from);
    let [pre, post] = match all.len() {
        1 => {
            found.notes.push(
                "one gain: which part of the read noise lies behind the gain stage is not known; \
                 read_e holds at this gain"
                    .into(),
            );
            [read_e2(first), 0.0]
        }
        _ => {
            let design = Matrix::from_fn(all.len(), 2, |i, j| {
                if j == 0 { 1.0 } else { all[i].gain.powi(2).recip() }
            });
            let target = Vector::from_fn(all.len(), |i, _| read_e2(&all[i]));
            let parts = LeastSquares::of(&design, &target)
                .ok_or_else(|| Error::input("profiles of gains that are alike"))?;
            [0, 1].map(|i| f64::max(parts.coefficients[i], 0.0))
        }
    };
    found.add("sensor.noise.read_e", rounded((pre + post).sqrt(), DIGITS), from);
    found.add("sensor.noise.read_e_post", rounded(post.sqrt(), DIGITS), from);
    let off = |of: &dyn Fn(&Profile) -> [f64; 2]| {
        all.iter().any(|p| {
            let [own, law] = of(p);
            (own - law).abs() > MAX_OFF * law
        })
    };
    let gain_off = off(&|p| [dn_per_e(p), unity * p.gain]);
    let read_off = off(&|p| [read_e(p), (pre + post / p.gain.powi(2)).sqrt()]);
    let black_off = off(&|p| [p.black_level_dn, first.black_level_dn]);
    if gain_off || read_off || black_off {
        if all.len() > AtGain::MAX_PLACES {
            return Err(Error::unsupported(format!(
                "profiles of {} gains, on no law over them",
                all.len()
            ))
            .help(format!("give those of up to {} gains", AtGain::MAX_PLACES)));
        }
        let column = |of: &dyn Fn(&Profile) -> f64| -> Vec<f64> {
            all.iter().map(|p| rounded(of(p), DIGITS)).collect()
        };
        found.add("sensor.gains.at", column(&|p| p.gain), from);
        let mut add = |key: &str, of: &dyn Fn(&Profile) -> f64| {
            found.add(&format!("sensor.gains.{key}"), column(of), from);
            found.notes.push(format!(
                "{key} over the gains is on no law: [sensor.gains] has that of each gain, and \
                 straight lines in logarithms between them"
            ));
        };
        if read_off {
            add("read_e", &read_e);
        }
        if gain_off {
            add("dn_per_e", &dn_per_e);
        }
        if black_off {
            add("black_level_dn", &|p| p.black_level_dn);
        }
    }
    if all.iter().any(|p| p.white_level_dn != first.white_level_dn) {
        found.notes.push(
            "white levels differ between the gains, which a camera file cannot have: it ends at \
             the converter's range"
                .into(),
        );
    }
    Ok(found)
}

/// darktable's profiles of one model. They are of demosaiced pictures, whose noise is smaller by a
/// factor that depends on the demosaicing and is the same for a and b; the full well tells it. Of
/// the channels green has the most pixels.
///
/// # Errors
/// Several models and none chosen, no full well, no bits.
pub(super) fn of_darktable(json: &Json, beside: &Beside) -> Result<Imported> {
    const GREEN: usize = 1;
    let from = "darktable";
    let makers = json["noiseprofiles"].as_array().into_iter().flatten();
    let models: Vec<&Json> =
        makers.flat_map(|maker| maker["models"].as_array().into_iter().flatten()).collect();
    let name = |model: &Json| model["model"].as_str().unwrap_or_default().to_string();
    let chosen: Vec<&Json> = match &beside.model {
        Some(wanted) => models.iter().copied().filter(|model| name(model) == *wanted).collect(),
        None => models.clone(),
    };
    let [model] = chosen[..] else {
        let names: Vec<String> = models.iter().take(5).map(|model| name(model)).collect();
        let found = format!("{} of the {} models are meant", chosen.len(), models.len());
        return Err(Error::input(found).help(format!("name one: {}, ...", names.join(", "))));
    };
    let full_well_e = beside.full_well_e.ok_or_else(|| {
        Error::input(
            "noise profiles of demosaiced pictures, whose noise is smaller than that of \
                      raw frames by an unknown factor",
        )
        .help("give sensor.full_well_e, which tells it")
    })?;
    let white_level_dn = libm::exp2(beside.bits("noise profiles without levels")?) - 1.0;
    let mut of_iso: Vec<(f64, Vec<[f64; 2]>)> = Vec::new();
    for profile in model["profiles"].as_array().into_iter().flatten() {
        let green = |key: &str| numbers(&profile[key])?.get(GREEN).copied();
        let all = profile["iso"].as_f64().zip(green("a")).zip(green("b"));
        let ((iso, a), b) = all.ok_or_else(|| {
            Error::input(format!("{profile}")).help("a profile has iso, and three numbers a and b")
        })?;
        match of_iso.iter_mut().find(|(own, _)| *own == iso) {
            Some((_, all)) => all.push([a, b]),
            None => of_iso.push((iso, vec![[a, b]])),
        }
    }
    of_iso.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(lowest) = of_iso.first().map(|(iso, _)| *iso) else {
        return Err(Error::input(format!("no noise profile of {}", name(model))));
    };
    let mean = |all: &[[f64; 2]], i: usize| {
        all.iter().map(|pair| pair[i]).sum::<f64>() / all.len() as f64
    };
    let unity = of_iso.iter().map(|(iso, all)| mean(all, 0) * lowest / iso).sum::<f64>();
    let black_level_dn = beside.black_level_dn.unwrap_or(0.0);
    let range = (white_level_dn - black_level_dn) / white_level_dn;
    let smaller = full_well_e * range * unity / of_iso.len() as f64;
    let profile = |(iso, all): &(f64, Vec<[f64; 2]>)| Profile {
        gain: iso / lowest,
        shot: mean(all, 0) / smaller,
        offset: mean(all, 1) / smaller,
        black_level_dn,
        white_level_dn,
    };
    let mut found = profiles(&of_iso.iter().map(profile).collect::<Vec<_>>(), from)?;
    found.known.retain(|known| {
        !["sensor.black_level_dn", "sensor.bits"].contains(&&known.change.key[..])
    });
    found.notes.push(format!(
        "gain 1 is ISO {lowest}; {} has {smaller:.3} of the variance that the full well gives, so \
         much is taken for demosaicing",
        name(model)
    ));
    Ok(found)
}

/// Profiles as darktable's noise profiles of a model (JSON), with gain 1 at ISO 100.
pub fn to_darktable(profiles: &[Profile], model: &str) -> Json {
    let profile = |p: &Profile| {
        let iso = (100.0 * p.gain).round();
        json!({
            "name": format!("{model} iso {iso}"), "iso": iso,
            "a": vec![p.shot; 3], "b": vec![p.offset; 3],
        })
    };
    let profiles: Vec<Json> = profiles.iter().map(profile).collect();
    let models = json!([{ "comment": "camrig", "model": model, "profiles": profiles }]);
    json!({ "version": 0, "noiseprofiles": [{ "maker": "camrig", "models": models }] })
}
