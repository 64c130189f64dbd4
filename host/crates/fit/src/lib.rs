//! A camera file from a folder of captures.
//!
//! [`fit()`] takes dark and flat stacks of one sensor, with two frames each or more, and returns
//! [`Fitted`]: the draft of a camera file in which every value has its basis. What the frames show
//! is measured, with its standard error and the frames that show it; the rest is that of a built-in
//! sensor, or typical. Nothing is searched for and no model is simulated, so it takes about as long
//! as reading the frames; [`camrig-diagnose`] goes on from the file.
//!
//! 1. [`camrig_clean`] removes what is not the sensor's steady behaviour and mends labels of light.
//! 2. [`camrig_measure::ptc`] tells the flats below saturation, [`camrig_estimates`] the figures of
//!    each gain.
//! 3. [`response`]: system gain, loss and exponent of the response and quantum efficiency from
//!    variances and means together.
//! 4. [`gains`]: which part of a gain is analog, and the law of the read noise over it, with a step
//!    of the conversion gain where there is one.
//! 5. [`noise`]: black level, read noise and its law over the gains, dark current, hot pixels,
//!    noise and patterns of rows, columns, pixels and frames, pixels that blink, the strongest wave
//!    ([`waves`]), channels of columns ([`channels`]), wrong bits of the converter. What is over
//!    three errors and 3 % of the read noise becomes an effect.
//!
//! Limits: one temperature, that of most stacks; the dark current's doubling only where darks of
//! several temperatures tell it.
//!
//! [`camrig-diagnose`]: https://docs.rs/camrig-diagnose
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod channels;
pub mod exchange;
mod file;
pub mod gains;
pub mod noise;
pub mod response;
mod scenes;
pub mod stacks;
pub mod waves;

pub use camrig_base as base;
pub use camrig_captures as captures;

use camrig_base::{Error, Result, Value, tails};
use camrig_camera::draft::{Basis, Draft};
use camrig_camera::{Change, EffectKind};
use camrig_captures::CaptureSet;
use camrig_clean::Cleaned;
use gains::Place;
use noise::Noise;
use response::{Datum, Response};
use serde_json::{Map, Value as Json, json};
use stacks::AtGain;

/// What is known beside the captures.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Options {
    /// Name of the camera; that of the set if empty.
    pub name: String,
    /// Built-in sensor whose values stand where the captures tell nothing.
    pub like: Option<String>,
    /// Keys of the camera file with values, which stand whatever the captures tell.
    pub given: Vec<Change>,
    /// DN per electron at unity gain, for sets without flats.
    pub dn_per_e: Option<f64>,
}

/// A camera file that follows from captures.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Fitted {
    /// The file, with the basis of every value.
    pub draft: Draft,
    /// What a person should know: what was found and corrected in the frames, what does not fit,
    /// what is not known.
    pub notes: Vec<String>,
}

impl Fitted {
    /// Every value of the file by its path (`effect.KIND.KEY` of effects): an object with `value`,
    /// `std_error`, `unit`, `grade` and `basis`, which says what it was measured on or where it
    /// comes from.
    #[must_use]
    pub fn values(&self) -> Map<String, Json> {
        let plain = self.draft.entries.iter().map(|e| {
            let unit = e.key.unit().to_string();
            (e.key.path().to_string(), entry(json!(e.value), &e.basis, &unit))
        });
        let more = self.draft.more.iter().map(|known| {
            let unit = unit_of(&known.change.key);
            (known.change.key.clone(), entry(json!(known.change.value), &known.basis, unit))
        });
        plain.chain(more).collect()
    }
}

fn entry(value: Json, basis: &Basis, unit: &str) -> Json {
    let told = [&basis.note, &basis.source];
    let told: Vec<&str> = told.into_iter().map(|s| &s[..]).filter(|s| !s.is_empty()).collect();
    json!({
        "value": value, "std_error": basis.std_error, "unit": unit, "grade": basis.grade.name(),
        "basis": told.join("; "),
    })
}

/// Unit of a parameter of an effect, or of a column of `[sensor.gains]`.
fn unit_of(path: &str) -> &'static str {
    match path.split('.').collect::<Vec<_>>()[..] {
        ["effect", kind, key] => {
            let effect = EffectKind::all().find(|effect| effect.kind == kind);
            let parameters = effect.map_or(&[][..], |effect| effect.parameters);
            parameters.iter().find(|p| p.key == key).map_or("", |p| p.unit)
        }
        [.., "read_e"] => "e-",
        [.., "dn_per_e"] => "DN/e-",
        [.., "black_level_dn"] => "DN",
        _ => "1",
    }
}

/// What stands for a value that only the user can give.
pub const OPEN: &str = "?";

/// Makes questions of all figures in electrons of a draft whose electrons are DN.
fn ask(draft: &mut Draft) {
    let open = |value: &mut camrig_camera::Value, basis: &mut Basis, unit: &str| {
        if !unit.starts_with("e-") {
            return;
        }
        let reason = match (basis.std_error, &*value) {
            (Some(error), figure) => format!(
                "{figure} ± {error:.2e} {} over the DN per electron at unity gain; {}",
                unit.replace("e-", "DN"),
                basis.note
            ),
            (None, _) => "unknown: darks alone tell no gain".into(),
        };
        (*value, *basis) = (OPEN.into(), Basis::typical(&reason));
    };
    for entry in &mut draft.entries {
        open(&mut entry.value, &mut entry.basis, entry.key.unit());
    }
    for known in &mut draft.more {
        let unit = unit_of(&known.change.key);
        open(&mut known.change.value, &mut known.basis, unit);
    }
}

/// Fits a camera file to a set of dark and flat captures. Of frames without flats, static scenes
/// tell the gain. Darks alone do not: what is in electrons is then [`OPEN`], unless the gain is
/// given.
///
/// # Errors
/// Files that cannot be read; sets from which nothing can be measured, such as copied, scaled or
/// processed frames; no darks; flats of which none is below saturation; wrong keys or values in the
/// options.
pub fn fit(set: &CaptureSet, options: &Options) -> Result<Fitted> {
    let cleaned = Cleaned::new(set.clone(), &camrig_clean::Options::default())?;
    if cleaned.is_processed() {
        let told = cleaned.findings().iter().map(|f| f.line()).collect::<Vec<_>>();
        return Err(Error::input(format!("a camera processed these frames: {}", told.join("; ")))
            .help("noise of the sensor is in raw frames only: switch processing off"));
    }
    let gains = stacks::measure(set, &cleaned, options.dn_per_e)?;
    let lit: Vec<usize> = (0..gains.len()).filter(|g| gains[*g].tells_gain()).collect();
    let (response, wavelengths) = match lit.is_empty() {
        true => (None, Vec::new()),
        false => respond(&cleaned, &gains, &lit).map(|(r, nm)| (Some(r), nm))?,
    };
    let unity = response.as_ref().map(|r| Unity::of(r, &gains, &lit));
    let k = |i: usize| match (&response, lit.iter().position(|g| *g == i), &unity) {
        (Some(response), Some(place), _) => response.gains[place],
        (_, _, Some(unity)) => unity.dn_per_e.scaled(gains[i].gain),
        _ => {
            // Without a gain, electrons are DN at unity gain.
            Value::new(options.dn_per_e.unwrap_or(1.0) * gains[i].gain, 0.0)
        }
    };
    let per_gain: Vec<Value> = (0..gains.len()).map(k).collect();
    let places = Place::all(&gains);
    let noise = Noise::of(&gains, &per_gain, &places);
    let found = file::Found {
        set: cleaned.set(),
        gains: &gains,
        places: &places,
        lit: &lit,
        response,
        wavelengths,
        unity,
        noise,
        per_gain,
    };
    let (mut draft, mut notes) = found.draft(options)?;
    if lit.is_empty() && options.dn_per_e.is_none() {
        ask(&mut draft);
    }
    notes.splice(0..0, cleaned.findings().iter().map(|f| f.line()));
    Ok(Fitted { draft, notes })
}

/// DN per electron at unity gain over all gains with flats.
pub(crate) struct Unity {
    /// The mean, by the covariance of the gains.
    pub dn_per_e: Value,
    /// χ² of gains in proportion to the stated ones over its degrees of freedom, where that does
    /// not fit.
    pub misfit: Option<f64>,
}

impl Unity {
    fn of(response: &Response, gains: &[AtGain], lit: &[usize]) -> Self {
        let stated = |i: usize| gains[lit[i]].gain;
        let n = lit.len();
        let each: Vec<f64> = (0..n).map(|i| response.gains[i].value / stated(i)).collect();
        let covariance = camrig_linear::Matrix::from_fn(n, n, |i, j| {
            response.covariance[(i, j)] / (stated(i) * stated(j))
        });
        let Some(weight) = camrig_linear::inverse(covariance) else {
            let dn_per_e = response.gains[0].scaled(1.0 / stated(0));
            return Self { dn_per_e, misfit: None };
        };
        let rows: Vec<f64> = (0..n).map(|i| (0..n).map(|j| weight[(i, j)]).sum()).collect();
        let total: f64 = rows.iter().sum();
        let mean = rows.iter().zip(&each).map(|(w, k)| w * k).sum::<f64>() / total;
        let rest = camrig_linear::Vector::from_fn(n, |i, _| each[i] - mean);
        let chi2 = camrig_linear::quadratic(&weight, &rest);
        let misfit = tails::misfit(chi2, n as f64 - 1.0);
        Self { dn_per_e: Value::new(mean, total.sqrt().recip()), misfit }
    }
}

/// The response that the flats of the gains in `lit` show, and the wavelengths of its efficiencies.
fn respond(
    cleaned: &Cleaned,
    gains: &[AtGain],
    lit: &[usize],
) -> Result<(Response, Vec<Option<f64>>)> {
    let sites = stacks::sites(&cleaned.set().cfa()).count();
    let mut wavelengths: Vec<Option<f64>> = Vec::new();
    let mut data = Vec::new();
    for (place, g) in lit.iter().map(|i| &gains[*i]).enumerate() {
        let bias = &g.found.bias;
        let (width, height) = g.found.size();
        let of_rows = bias.row_variance.value.max(0.0) / height as f64;
        let pixels = (width * height / sites) as f64;
        if !g.scenes.is_empty() && !wavelengths.contains(&None) {
            wavelengths.push(None);
        }
        let unlit = wavelengths.iter().position(Option::is_none).unwrap_or_default();
        data.extend(g.scenes.iter().map(|bin| bin.datum(place, unlit * sites + bin.site)));
        let dark_dn_per_s = g.found.dark_current.as_ref().map_or(0.0, |d| d.clipped_mean.value);
        for flat in &g.flats {
            let known = wavelengths.iter().position(|w| *w == flat.wavelength_nm);
            let wavelength = known.unwrap_or_else(|| {
                wavelengths.push(flat.wavelength_nm);
                wavelengths.len() - 1
            });
            for (site, found) in g.found.flats[flat.index].sites.iter().enumerate() {
                let read = bias.read_noise_variance_by_site[site];
                let level = found.level.value;
                // The read noise that was taken off is known to its own error.
                let of_read = read.std_error / level;
                // Of the mean: noise of pixels and rows, in the flat and in the darks taken off.
                let per_pixel = |signal: f64| (found.gain.value * signal + read.value) / pixels;
                let of_mean = (per_pixel(level) + of_rows) / flat.frames as f64
                    + (per_pixel(0.0) + of_rows) / bias.frames() as f64;
                data.push(Datum {
                    gain: place,
                    light_of: wavelength * sites + site,
                    photons: flat.photons,
                    level: Value::new(level, of_mean.max(0.0).sqrt()),
                    dark_dn: dark_dn_per_s * (flat.exposure_s - g.shortest_s),
                    ratio: Value::new(
                        found.gain.value,
                        libm::hypot(found.gain.std_error, of_read),
                    ),
                });
            }
        }
    }
    let stated: Vec<f64> = lit.iter().map(|i| gains[*i].gain).collect();
    let top_dn = f64::from((1u32 << cleaned.set().sensor.bits) - 1);
    Ok((response::fit(&data, &stated, top_dn)?, wavelengths))
}

#[cfg(test)]
mod tests;
