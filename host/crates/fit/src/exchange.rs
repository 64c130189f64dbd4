//! Noise models of other programs, as values of a camera file and back.
//!
//! | form | what it has | source |
//! |---|---|---|
//! | noise profile | per gain (S, O): variance S x + O of a signal x, 0 at black and 1 at white; Noise Flow's β₁, β₂ | DNG 1.4, NoiseProfile; Abdelhamed et al. 2019 |
//! | ELD, PMN | σ = exp(k ln K + b) of a Gaussian or Tukey lambda read noise and of rows, in DN, over the system gain K, DN/e⁻ | Wei et al. 2020; Feng et al. 2022 |
//! | libcamera | `rpi.noise`: standard deviation over the root of the mean, and `rpi.black_level`, on 16 bits | libcamera, Raspberry Pi tuning guide |
//!
//! With R = white − black and K = R S: `full_well_e` = (2^bits − 1) g/K, read noise √(O R² − 1/12)/K
//! at gain g. A power of K is a power of the gain: `gain_exponent` k − 1 of the effects, and a
//! straight line in logarithms between two places of `[sensor.gains]`.

use camrig_base::{Error, Result};
use camrig_camera::draft::{Basis, Known};
use camrig_camera::typical::rounded;
use camrig_camera::{Camera, Change, Value};
use camrig_formats::Facts;
use camrig_linear::{LeastSquares, Matrix, Vector};
use camrig_sensor_core::effects::Effect;
use serde_json::{Value as Json, json};
use std::path::Path;

/// Least shape of Tukey's law that a camera file takes.
const MIN_LAMBDA: f64 = -0.22;
/// Largest sample of the numbers in a tuning file of libcamera.
const TUNING_TOP: f64 = 65_535.0;
/// Digits of values that follow from others, beyond which they are rounding.
const DIGITS: usize = 9;
/// Gains at which a camera is described for ELD.
const PLACES: usize = 9;

/// What a file says of a camera.
#[derive(Default)]
pub struct Imported {
    /// Values for its file.
    pub known: Vec<Known>,
    /// What it does not say, or what a camera file cannot have.
    pub notes: Vec<String>,
}

impl Imported {
    fn add(&mut self, key: &str, value: impl Into<Value>, from: &str) {
        let change = Change::new(key, value);
        self.known.push(Known { change, basis: Basis::given(from) });
    }
}

/// Reads what files say: DNGs of one camera at one or several ISOs, or one table of noise profiles
/// (CSV), parameters of ELD or PMN (JSON), or tuning file of libcamera (JSON). `bits` are those of
/// the converter, for files that do not have them; `prnu` is the camera's, where it is known.
///
/// # Errors
/// Files that cannot be read or say nothing of noise.
pub fn read(files: &[impl AsRef<Path>], bits: Option<u8>, prnu: Option<f64>) -> Result<Imported> {
    let [first, others @ ..] = files else { return Err(Error::input("no file")) };
    let first = first.as_ref();
    let extension = first
        .extension()
        .map_or_else(String::new, |e| e.to_ascii_lowercase().to_string_lossy().into());
    if extension == "dng" {
        return of_dngs(files);
    }
    if !others.is_empty() {
        return Err(Error::input("several files that are no DNGs").help("give one of them"));
    }
    let text = std::fs::read_to_string(first).map_err(|e| Error::io("read", first, e))?;
    let place = |e: Error| e.at(first.display());
    if extension == "csv" {
        return profiles(&table(&text).map_err(place)?, "the noise profile").map_err(place);
    }
    let json: Json =
        serde_json::from_str(&text).map_err(|e| place(Error::input(e.to_string())))?;
    let known = match json.get("algorithms") {
        Some(algorithms) => of_tuning(algorithms, bits, prnu),
        None => of_lines(&json, bits),
    };
    known.map_err(place)
}

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

fn table(text: &str) -> Result<Vec<Profile>> {
    let wrong = || Error::input("no table of noise profiles").help(format!("columns {COLUMNS}"));
    let mut lines = text.lines().filter(|line| !line.trim().is_empty());
    if lines.next().map(str::trim) != Some(COLUMNS) {
        return Err(wrong());
    }
    let of = |line: &str| {
        let numbers: Vec<f64> =
            line.split(',').map(|v| v.trim().parse().ok()).collect::<Option<_>>()?;
        let [gain, shot, offset, black_level_dn, white_level_dn] = numbers[..] else {
            return None;
        };
        Some(Profile { gain, shot, offset, black_level_dn, white_level_dn })
    };
    lines.map(|line| of(line).ok_or_else(wrong)).collect()
}

/// The tags of DNG files of one camera: gain 1 is the lowest ISO among them.
fn of_dngs(files: &[impl AsRef<Path>]) -> Result<Imported> {
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

/// Gain, read noise and levels that profiles give.
fn profiles(all: &[Profile], from: &str) -> Result<Imported> {
    let wrong =
        |p: &Profile| !(p.gain > 0.0 && p.shot > 0.0 && p.white_level_dn > p.black_level_dn);
    if let Some(p) = all.iter().find(|p| wrong(p)) {
        return Err(
            Error::input(format!("{p:?}")).help("gain and shot are above 0, white above black")
        );
    }
    let Some(first) = all.first() else { return Err(Error::input("no noise profile")) };
    let bits = libm::ceil(libm::log2(first.white_level_dn + 1.0));
    let top = libm::exp2(bits) - 1.0;
    let range = |p: &Profile| p.white_level_dn - p.black_level_dn;
    let n = all.len() as f64;
    let unity = all.iter().map(|p| p.shot * range(p) / p.gain).sum::<f64>() / n;
    let read_e2 = |p: &Profile| {
        let r = range(p);
        ((p.offset - 1.0 / (12.0 * r * r)) / (p.shot * p.shot)).max(0.0)
    };
    let mut found = Imported::default();
    found.add("sensor.bits", bits as i64, from);
    found.add("sensor.black_level_dn", first.black_level_dn, from);
    found.add("sensor.full_well_e", rounded(top / unity, DIGITS), from);
    let distinct = all.iter().any(|p| p.gain != first.gain);
    let (read, post) = match distinct {
        true => {
            let design = Matrix::from_fn(all.len(), 2, |i, j| {
                if j == 0 { 1.0 } else { all[i].gain.powi(2).recip() }
            });
            let target = Vector::from_fn(all.len(), |i, _| read_e2(&all[i]));
            let parts = LeastSquares::of(&design, &target)
                .ok_or_else(|| Error::input("profiles of gains that are alike"))?;
            let [pre, post] = [0, 1].map(|i| f64::max(parts.coefficients[i], 0.0));
            ((pre + post).sqrt(), post.sqrt())
        }
        false => {
            found.notes.push(
                "one gain: which part of the read noise lies behind the gain stage is not known; \
                 read_e holds at this gain"
                    .into(),
            );
            (read_e2(first).sqrt(), 0.0)
        }
    };
    found.add("sensor.noise.read_e", rounded(read, DIGITS), from);
    found.add("sensor.noise.read_e_post", rounded(post, DIGITS), from);
    Ok(found)
}

/// A standard deviation in DN over the system gain: ln σ = slope ln K + offset, with a scatter.
#[derive(Clone, Copy, Debug)]
struct Line {
    slope: f64,
    offset: f64,
    scatter: f64,
}

impl Line {
    fn at(&self, k: f64) -> f64 {
        libm::exp(self.slope * libm::log(k) + self.offset)
    }
}

/// A number, or the only one of a list.
fn number(json: &Json) -> Option<f64> {
    json.as_f64().or_else(|| number(json.as_array()?.first()?))
}

/// ELD (`Profile-1` with `g_scale`, `G_scale`, `R_scale`, and `G_shape`; Kmin in DN/e⁻) or PMN
/// (`sigGsk`, `sigGsb`, ...; Kmin is ln K).
fn of_lines(json: &Json, bits: Option<u8>) -> Result<Imported> {
    let get = |key: &str| number(json.get(key)?);
    let eld = json.get("Profile-1");
    let line = |eld_key: &str, pmn_key: &str| match eld {
        Some(profile) => {
            let own = profile.get(eld_key)?;
            let of = |key: &str| number(own.get(key)?);
            Some(Line {
                slope: of("slope")?,
                offset: of("bias")?,
                scatter: of("sigma").unwrap_or(0.0),
            })
        }
        None => {
            let of = |end: &str| get(&format!("{pmn_key}{end}"));
            Some(Line { slope: of("k")?, offset: of("b")?, scatter: of("sig").unwrap_or(0.0) })
        }
    };
    let ends = get("Kmin").zip(get("Kmax")).ok_or_else(|| {
        Error::input("neither parameters of ELD or PMN nor a tuning file of libcamera")
            .help("a JSON object with Kmin, Kmax and Profile-1 or sigTLk, or with algorithms")
    })?;
    let [low, high] = match eld {
        Some(_) => [ends.0, ends.1],
        None => [libm::exp(ends.0), libm::exp(ends.1)],
    };
    let shape = match json.get("G_shape").and_then(Json::as_array) {
        Some(all) => all.get(all.len() / 2).and_then(number),
        None => get("lam"),
    };
    let own_bits = get("wp").map(|white| libm::ceil(libm::log2(white + 1.0)));
    let bits = own_bits.or(bits.map(f64::from)).ok_or_else(|| {
        Error::input("no white level (wp)").help("give the bits of the converter")
    })?;
    let from = if eld.is_some() { "ELD" } else { "PMN" };
    let mut found = Imported::default();
    found.add("sensor.bits", bits as i64, from);
    found.add("sensor.full_well_e", (libm::exp2(bits) - 1.0) / low, from);
    if let Some(black) = get("bl") {
        found.add("sensor.black_level_dn", black, from);
    }
    found.add("sensor.noise.read_e_post", 0.0, from);
    let gains = vec![1.0, high / low];
    let mut lines = Vec::new();
    match (line("G_scale", "sigTL"), shape, line("g_scale", "sigGs")) {
        (Some(tail), Some(lambda), _) => {
            let kept = lambda.max(MIN_LAMBDA);
            if kept != lambda {
                found.notes.push(format!(
                    "lambda {lambda} is beyond {MIN_LAMBDA}: that is written, with the standard \
                     deviation of the former; the farthest tails are lighter"
                ));
            }
            let sd = tukey_sd(lambda)?;
            found.add("sensor.noise.read_e", 0.0, from);
            let effect = "effect.heavy-tailed-read-noise";
            found.add(&format!("{effect}.sigma_e"), tail.at(low) * sd / low, from);
            found.add(&format!("{effect}.lambda"), kept, from);
            found.add(&format!("{effect}.gain_exponent"), tail.slope - 1.0, from);
            lines.push(tail);
        }
        (_, _, Some(read)) => {
            let read_e = |k: f64| read.at(k) / k;
            found.add("sensor.noise.read_e", read_e(low), from);
            found.add("sensor.gains.at", gains, from);
            found.add("sensor.gains.read_e", vec![read_e(low), read_e(high)], from);
            lines.push(read);
        }
        _ => {
            return Err(Error::input("no line of the read noise")
                .help("sigTLk, sigTLb and lam, or sigGsk and sigGsb"));
        }
    }
    if let Some(rows) = line("R_scale", "sigR") {
        let effect = "effect.row-temporal-noise";
        found.add(&format!("{effect}.sigma_e"), rows.at(low) / low, from);
        found.add(&format!("{effect}.gain_exponent"), rows.slope - 1.0, from);
        lines.push(rows);
    }
    let scatter = lines.iter().map(|l| l.scatter).fold(0.0, f64::max);
    if scatter > 0.0 {
        found.notes.push(format!(
            "noise scatters about its lines over the gain by up to {:.0} %: a camera file has none \
             of that",
            100.0 * scatter
        ));
    }
    Ok(found)
}

/// Standard deviation of Tukey's lambda law of scale 1: √(2/λ² (1/(1 + 2λ) − B(1 + λ, 1 + λ))).
///
/// # Errors
/// λ up to −½, of which there is none.
pub fn tukey_sd(lambda: f64) -> Result<f64> {
    if lambda <= -0.5 {
        return Err(
            Error::input(format!("lambda {lambda}")).help("noise has a variance above -0.5")
        );
    }
    // Near 0 it is the logistic law.
    if lambda.abs() < 1e-4 {
        return Ok(std::f64::consts::PI / 3f64.sqrt());
    }
    let gamma = libm::tgamma(1.0 + lambda);
    let beta = gamma * gamma / libm::tgamma(2.0 + 2.0 * lambda);
    Ok((2.0 / (lambda * lambda) * (1.0 / (1.0 + 2.0 * lambda) - beta)).sqrt())
}

/// Parameters of PMN (JSON): lines of read noise and rows through a camera's values at gains from 1
/// to `most`.
///
/// # Errors
/// A camera without noise.
pub fn to_lines(camera: &Camera, most: f64) -> Result<Json> {
    let sensor = &camera.sensor;
    let gains: Vec<f64> =
        (0..PLACES).map(|i| libm::pow(most.max(1.1), i as f64 / (PLACES - 1) as f64)).collect();
    let k: Vec<f64> = gains.iter().map(|g| sensor.at_gain(*g).dn_per_e).collect();
    let line = |sigma_e: &dyn Fn(f64) -> f64| -> Option<Line> {
        let dn: Vec<f64> = gains.iter().zip(&k).map(|(g, k)| sigma_e(*g) * k).collect();
        if dn.iter().any(|v| *v <= 0.0) {
            return None;
        }
        let design =
            Matrix::from_fn(dn.len(), 2, |i, j| if j == 0 { libm::log(k[i]) } else { 1.0 });
        let target = Vector::from_fn(dn.len(), |i, _| libm::log(dn[i]));
        let fit = LeastSquares::of(&design, &target)?;
        let scatter = (fit.chi2 / (dn.len() as f64 - 2.0)).sqrt();
        Some(Line { slope: fit.coefficients[0], offset: fit.coefficients[1], scatter })
    };
    let power = |sigma: f32, exponent: f32| {
        move |g: f64| f64::from(sigma) * libm::pow(g, f64::from(exponent))
    };
    let top = (1u32 << sensor.bits) - 1;
    let mut out = json!({
        "Kmin": libm::log(k[0]), "Kmax": libm::log(k[PLACES - 1]), "wp": top,
        "q": 1.0 / f64::from(top + 1), "bl": sensor.black_level_dn,
    });
    let mut add = |name: &str, line: Option<Line>| {
        let Some(Line { slope, offset, scatter }) = line else { return };
        for (end, value) in [("k", slope), ("b", offset), ("sig", scatter)] {
            out[format!("{name}{end}")] = json!(value);
        }
    };
    add("sigGs", line(&|g| sensor.at_gain(g).read_variance_e2.sqrt()));
    let mut shape = None;
    for effect in &camera.effects {
        match effect {
            Effect::HeavyTailedReadNoise(e) => {
                let lambda = f64::from(e.lambda);
                let (sd, sigma) = (tukey_sd(lambda)?, power(e.sigma_e, e.gain_exponent));
                add("sigTL", line(&|g| sigma(g) / sd));
                shape = Some(lambda);
            }
            Effect::RowTemporalNoise(e) => add("sigR", line(&power(e.sigma_e, e.gain_exponent))),
            _ => (),
        }
    }
    if let Some(lambda) = shape {
        out["lam"] = json!(lambda);
    }
    Ok(out)
}

/// What PRNU adds to the slope of noise over the root of the mean, by which pixels of even patches
/// differ: of a patch at half of the range, (1 + p² W/2) for a full well of W.
fn with_prnu(full_well_e: f64, prnu: f64) -> f64 {
    1.0 + 0.5 * prnu * prnu * full_well_e
}

fn of_tuning(algorithms: &Json, bits: Option<u8>, prnu: Option<f64>) -> Result<Imported> {
    let of = |name: &str, key: &str| {
        let own = algorithms.as_array()?.iter().find_map(|a| a.get(name))?;
        number(own.get(key)?)
    };
    let mut found = Imported::default();
    let from = "libcamera";
    let slope = of("rpi.noise", "reference_slope").filter(|slope| *slope > 0.0);
    let black = of("rpi.black_level", "black_level");
    if slope.is_none() && black.is_none() {
        return Err(Error::input("a tuning file without rpi.noise and rpi.black_level"));
    }
    if let Some(slope) = slope {
        let apparent = TUNING_TOP / (slope * slope);
        let full = match prnu {
            // W = A (1 + p² W/2).
            Some(p) => apparent / (1.0 - 0.5 * p * p * apparent).max(0.1),
            None => {
                found.notes.push(
                    "rpi.noise holds PRNU too, which is not known: of 0.8 % the full well is some \
                     15 % too low; give sensor.noise.prnu"
                        .into(),
                );
                apparent
            }
        };
        found.add("sensor.full_well_e", full, from);
    }
    if let Some(black) = black {
        let bits = bits.ok_or_else(|| {
            Error::input("a black level on 16 bits").help("give the bits of the converter")
        })?;
        found.add("sensor.black_level_dn", black * libm::exp2(f64::from(bits) - 16.0), from);
    }
    Ok(found)
}

/// A tuning file of libcamera (JSON) with `rpi.black_level` and `rpi.noise`, for `camera`.
pub fn to_tuning(camera: &Camera) -> Json {
    let sensor = &camera.sensor;
    let full = f64::from((1u32 << sensor.bits) - 1) / sensor.at_gain(1.0).dn_per_e;
    let slope = (TUNING_TOP / full * with_prnu(full, sensor.noise.prnu)).sqrt();
    let black = sensor.black_level_dn * libm::exp2(16.0 - f64::from(sensor.bits));
    json!({ "version": 2.0, "target": "bcm2835", "algorithms": [
        { "rpi.black_level": { "black_level": black.round() } },
        { "rpi.noise": { "reference_constant": 0, "reference_slope": slope } },
    ] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::draft::{Draft, Request};

    /// The camera that a file's values make.
    fn camera(found: Imported) -> Camera {
        let keys = ["sensor.width=64", "sensor.height=48", "sensor.pitch_um=2", "sensor.cfa=mono"];
        let given = keys.iter().chain(&["sensor.noise.prnu=0.008"]).map(|k| k.parse().unwrap());
        let bits = found.known.iter().any(|k| k.change.key == "sensor.bits");
        let bits = (!bits).then(|| "sensor.bits=12".parse().unwrap());
        let request = Request {
            given: given.chain(bits).collect(),
            known: found.known,
            ..Request::default()
        };
        let folder = tempfile::tempdir().unwrap();
        let draft = Draft::of(&request).unwrap();
        let path = folder.path().join("c.toml");
        std::fs::write(&path, draft.text()).unwrap();
        for (name, table) in draft.tables() {
            std::fs::write(folder.path().join(name), table).unwrap();
        }
        Camera::load(path.to_str().unwrap()).unwrap()
    }

    fn from_text(name: &str, text: &str) -> Imported {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read(&[path], Some(12), Some(0.008)).unwrap()
    }

    /// Two profiles give gain, read noise and its part behind the gain stage to the last digits;
    /// one gives all but the latter.
    #[test]
    fn profiles_come_back() {
        let (range, k, read, post) = (4031.0, 4095.0 / 11_000.0, 5.0f64, 4.2f64);
        let profile = |gain: f64| {
            let r2 = read * read - post * post + (post / gain).powi(2);
            let k = k * gain;
            let offset = (r2 * k * k + 1.0 / 12.0) / (range * range);
            Profile { gain, shot: k / range, offset, black_level_dn: 64.0, white_level_dn: 4095.0 }
        };
        let two = camera(from_text("n.csv", &to_table(&[profile(1.0), profile(8.0)])));
        let sensor = &two.sensor;
        assert!((sensor.full_well_e / 11_000.0 - 1.0).abs() < 1e-6, "{}", sensor.full_well_e);
        assert!((sensor.noise.read_e / read - 1.0).abs() < 1e-6);
        assert!((sensor.noise.read_e_post / post - 1.0).abs() < 1e-6);
        assert_eq!((sensor.bits, sensor.black_level_dn), (12, 64.0));
        let found = from_text("n.csv", &to_table(&[profile(1.0)]));
        assert!(found.notes[0].contains("one gain"));
        let one = camera(found);
        assert!((one.sensor.noise.read_e / read - 1.0).abs() < 1e-6);
    }

    /// Figures of ELD's Sony A7S2 at K = 1.1388 DN/e⁻ (golden/twin): standard deviation 3.9755 DN,
    /// rows 0.5927 DN; the lines come back.
    #[test]
    fn lines_over_the_gain_come_back() {
        let text = r#"{"Kmin": -1.6, "Kmax": 0.7, "wp": 16383, "bl": 512, "lam": -0.12,
            "sigTLk": 0.75, "sigTLb": 0.2, "sigTLsig": 0.03,
            "sigRk": 0.65, "sigRb": -0.6, "sigRsig": 0.02}"#;
        let found = from_text("a7s2.json", text);
        assert!(found.notes[0].contains("3 %"), "{:?}", found.notes);
        let camera = camera(found);
        let back = to_lines(&camera, libm::exp(0.7 + 1.6)).unwrap();
        let given: Json = serde_json::from_str(text).unwrap();
        for key in ["Kmin", "Kmax", "wp", "bl", "lam", "sigTLk", "sigTLb", "sigRk", "sigRb"] {
            let (got, wanted) = (number(&back[key]).unwrap(), number(&given[key]).unwrap());
            assert!((got - wanted).abs() < 1e-5 * wanted.abs().max(1.0), "{key}: {got} {wanted}");
        }
        // A Gaussian read noise on a line, of ELD's own form.
        let text = r#"{"Kmin": [0.2], "Kmax": 3.0, "G_shape": [], "wp": 16383,
            "Profile-1": {"g_scale": {"slope": [[0.68]], "bias": 0.95, "sigma": 0.0}}}"#;
        let camera = super::tests::camera(from_text("eld.json", text));
        for k in [0.2f64, 0.9, 3.0] {
            let got = camera.sensor.at_gain(k / 0.2).read_variance_e2.sqrt();
            let wanted = libm::exp(0.68 * libm::log(k) + 0.95) / k;
            assert!((got / wanted - 1.0).abs() < 1e-5, "{k}: {got} {wanted}");
        }
    }

    #[test]
    fn shapes_beyond_that_of_a_camera_file_keep_their_deviation() {
        let text = r#"{"Kmin": 0.0, "Kmax": 2.0, "wp": 16383, "lam": -0.26,
            "sigTLk": 0.9, "sigTLb": -0.6}"#;
        let found = from_text("d850.json", text);
        assert!(found.notes[0].contains("-0.26"), "{:?}", found.notes);
        let camera = camera(found);
        let [Effect::HeavyTailedReadNoise(e)] = camera.effects[..] else { panic!() };
        let wanted = libm::exp(-0.6) * tukey_sd(-0.26).unwrap();
        assert!((f64::from(e.sigma_e) / wanted - 1.0).abs() < 1e-5);
        assert!(tukey_sd(-0.5).is_err());
        // The logistic law, and the uniform one between -1 and 1.
        assert!((tukey_sd(1e-5).unwrap() - tukey_sd(2e-4).unwrap()).abs() < 1e-3);
        assert!((tukey_sd(1.0).unwrap() - 3f64.sqrt().recip()).abs() < 1e-9);
    }

    #[test]
    fn tuning_files_come_back() {
        let text = r#"{"version": 2.0, "target": "bcm2835", "algorithms": [
            {"rpi.black_level": {"black_level": 4096}},
            {"rpi.noise": {"reference_constant": 0, "reference_slope": 3.67}}]}"#;
        let camera = camera(from_text("imx219.json", text));
        assert_eq!(camera.sensor.black_level_dn, 256.0);
        let full = camera.sensor.full_well_e;
        assert!((full / 4866.0 - 1.0).abs() < 0.3 && full > 4866.0, "{full}");
        let back = to_tuning(&camera);
        let noise = &back["algorithms"][1]["rpi.noise"]["reference_slope"];
        assert!((noise.as_f64().unwrap() / 3.67 - 1.0).abs() < 1e-4, "{noise}");
        assert_eq!(back["algorithms"][0]["rpi.black_level"]["black_level"], 4096.0);
    }
}
