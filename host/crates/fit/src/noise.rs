//! Black level, noise, patterns and dark current at each gain in electrons, and what they are over
//! the gains.

use super::gains::{Law, Place, law};
use super::response::Response;
use super::stacks::AtGain;
use camrig_base::Value;
use camrig_base::tails::{self, median_of_squares, quantile_of_squares};
use camrig_estimates::bias::Bias;
use camrig_estimates::converter::{Codes, KEYS, significant_errors};
use camrig_estimates::dark::MIN_SPAN;
use camrig_estimates::flat::SQUARE;
use camrig_estimates::prnu::Prnu;
use camrig_estimates::robust::trigamma;
use camrig_estimates::rows::RowNoise;

/// Standard errors, and share of the read noise, from which an effect is written.
const MIN_DEVIATION: f64 = 3.0;
pub(crate) const MIN_SHARE: f64 = 0.03;
/// Hot pixels from which their law is written.
const MIN_HOT: f64 = 5.0;
/// Frames of the bias from which the spread of the read noise is judged: of fewer, the law of their
/// variance is not known well enough for a spread of [`MIN_SHARE`].
const MIN_SPREAD_FRAMES: usize = 12;

/// Dark current of the ordinary pixels, and of hot ones.
#[derive(Clone, Debug)]
pub struct Dark {
    /// Of the ordinary pixels, e⁻/s.
    pub rate: Value,
    /// Standard deviation over the ordinary pixels, e⁻/s.
    pub spread: Option<Value>,
    /// Fraction of hot pixels, and mean of their exponential law, e⁻/s.
    pub hot: Option<[Value; 2]>,
    /// Which of the gains show it.
    pub gains: Vec<usize>,
}

/// A noise or pattern that is an effect of the catalogue.
#[derive(Clone, Debug)]
pub struct Effect {
    /// Its kind.
    pub kind: &'static str,
    /// Its parameters by their keys.
    pub parameters: Vec<(&'static str, Value)>,
    /// χ² of one strength at all gains over its degrees of freedom, where that does not fit.
    pub misfit: Option<f64>,
}

/// What the darks of all gains show.
pub struct Noise {
    /// Mean of no light at exposure 0 at each place, DN.
    pub black: Vec<Value>,
    /// Read noise of the median pixel at each place, e⁻: without rows, rounding and dark current.
    pub read: Vec<Value>,
    /// Its law over the gains; none of one gain, or where none fits.
    pub law: Option<Law>,
    /// Dark current; none where the darks have one exposure.
    pub dark: Option<Dark>,
    /// Standard deviation of the rows' offsets, e⁻.
    pub rows: Option<Value>,
    /// Effects that stand out.
    pub effects: Vec<Effect>,
}

impl Noise {
    /// Of all gains, with their DN per electron, which lie at these places.
    pub fn of(gains: &[AtGain], response: &[Value], places: &[Place]) -> Self {
        let dark = dark(gains, response);
        let charge = |g: &AtGain| dark.as_ref().map_or(0.0, |d| d.rate.value * g.shortest_s);
        let each = || gains.iter().zip(response);
        let blacks: Vec<Value> = each().map(|(g, k)| black(g, k.value * charge(g))).collect();
        let variances: Vec<Value> = each().map(|(g, k)| read_variance(g, *k, charge(g))).collect();
        let black = places.iter().map(|place| place.mean(&blacks)).collect();
        let variances: Vec<Value> = places.iter().map(|place| place.mean(&variances)).collect();
        let read: Vec<Value> = variances
            .iter()
            // Of no noise above rounding, the upper limit is its error.
            .map(|v| v.sqrt().unwrap_or(Value::new(0.0, v.std_error.sqrt())))
            .collect();
        let law = law(places, &variances);
        let mut all = Self { black, read, law, dark, rows: None, effects: Vec::new() };
        all.add_effects(gains, response);
        all
    }

    fn add_effects(&mut self, gains: &[AtGain], response: &[Value]) {
        let part = |of: &dyn Fn(&AtGain) -> (Value, f64)| {
            let of_gain = |(g, k): (&AtGain, &Value)| {
                let (variance, null) = of(g);
                (variance.scaled(k.value.powi(2).recip()), null * k.value.powi(2).recip())
            };
            Part::of(gains.iter().zip(response).map(of_gain).collect())
        };
        let pattern = |of: &dyn Fn(&AtGain) -> (Value, f64)| part(of).of_one_pattern();
        let least = MIN_SHARE * self.read.first().map_or(0.0, |r| r.value);
        let stands_out =
            |part: &Part| part.sigma.filter(|s| part.deviation > MIN_DEVIATION && s.value > least);
        let frame = |g: &AtGain| {
            let Some(offsets) = g.found.frame_offsets else { return (Value::new(0.0, 1.0), 1.0) };
            let variance = offsets.sd.value * offsets.sd.value;
            let null = variance / offsets.deviation.max(1e-9);
            (Value::new(variance, null), null)
        };
        // Where no gain has darks of two exposures, pixels of more dark current have offsets.
        let at_0 = gains.iter().any(|g| g.found.pixel_offsets.is_some());
        let pixels = gains.iter().zip(response).filter_map(|(g, k)| {
            let variance = if at_0 { g.found.pixel_offsets? } else { g.found.bias.pattern.pixels };
            let variance = variance.scaled(k.value.powi(2).recip());
            Some((variance, variance.std_error))
        });
        let pixels = Part::of(pixels.collect()).of_one_pattern();
        let sites = |g: &AtGain| {
            let v = g.found.bias.frame_site_variance.unwrap_or(Value::new(0.0, 1.0));
            (v, v.std_error)
        };
        let of_rows = |variance: fn(&Bias) -> Value| {
            part(&|g| (variance(&g.found.bias), g.found.bias.row_variance_null))
        };
        let opposite = of_rows(|bias| bias.opposite_row_variance);
        let rows = of_rows(|bias| bias.row_variance);
        // Where the gains differ, that of the lowest is written.
        let alike = if rows.misfit.is_some() { 1 } else { gains.len() };
        let spectra = gains.iter().zip(response).take(alike);
        let spectra = spectra.map(|(g, k)| g.found.bias.row_spectrum.over(k.value.powi(2)));
        let law = RowNoise::of(&spectra.collect::<Vec<_>>());
        let of_law = |variance: Value| {
            variance.sqrt().filter(|s| variance.z() > MIN_DEVIATION && s.value > least)
        };
        let law = law.and_then(|law| Some((law, of_law(law.correlated)?)));
        let parts: [(&str, Part); 6] = [
            ("row-temporal-noise", rows),
            (
                "column-temporal-noise",
                part(&|g| (g.found.bias.column_variance, g.found.bias.column_variance.std_error)),
            ),
            (
                "column-offset-fpn",
                pattern(&|g| (g.found.bias.pattern.columns, g.found.bias.pattern.line_nulls[0])),
            ),
            ("frame-offset-noise", part(&frame)),
            ("frame-offset-by-site", part(&sites)),
            ("pixel-offset-fpn", pixels),
        ];
        for (kind, part) in parts {
            let sigma = match law {
                Some((law, _)) if kind == "row-temporal-noise" => of_law(law.white),
                _ => stands_out(&part),
            };
            let sigma = sigma.map(|value| ("sigma_e", value));
            let parameters: Vec<_> = match kind {
                "row-temporal-noise" => {
                    let opposite = stands_out(&opposite).map(|value| ("opposite_e", value));
                    let none = opposite.map(|_| ("sigma_e", Value::new(0.0, part.null.sqrt())));
                    sigma.or(none).into_iter().chain(opposite).collect()
                }
                _ => sigma.into_iter().collect(),
            };
            if !parameters.is_empty() {
                self.effects.push(Effect { kind, parameters, misfit: part.misfit });
            }
        }
        if let Some((law, sigma)) = law {
            self.add("row-correlated-noise", vec![("sigma_e", sigma), ("exponent", law.exponent)]);
        }
        let rows = pattern(&|g| (g.found.bias.pattern.rows, g.found.bias.pattern.line_nulls[1]));
        self.rows = stands_out(&rows).or(Some(Value::new(0.0, rows.null.sqrt())));
        // Spreads are roots, never below 0: their squares are combined.
        let many = gains.iter().filter(|g| g.found.bias.frames() >= MIN_SPREAD_FRAMES);
        let squares = many.map(|g| {
            let s = g.found.bias.read_noise_spread;
            let square = s.value * s.value - lean(g.found.bias.frames() as f64 - 1.0);
            Value::new(square, s.std_error * (2.0 * s.value + s.std_error))
        });
        let square = Value::combine(squares).filter(|s| s.z() > MIN_DEVIATION);
        if let Some(value) = square.and_then(Value::sqrt).filter(|s| s.value > MIN_SHARE) {
            self.add("read-noise-spread", vec![("spread", value)]);
        }
        let each = || gains.iter().zip(response);
        if let Some((blinking, k)) = each().find_map(|(g, k)| Some((g.blinking?, *k))) {
            let chosen = |value: f64| Value::new(value, 0.0);
            let parameters = vec![
                ("fraction", blinking.share),
                ("amplitude_e", blinking.amplitude.over(k)),
                ("renewal", chosen(blinking.renewal)),
                ("duty", chosen(blinking.duty)),
                ("between_samples", chosen(blinking.between_samples)),
            ];
            self.add("random-telegraph-noise", parameters);
        }
        let waves = each().find_map(|(g, k)| Some((g.wave?, *k)));
        let waves = waves.map(|(wave, k)| (wave.amplitude.over(k), wave.cycles));
        // A wave's variance is half the square of its amplitude.
        let stands_out = |(amplitude, _): &(Value, [f64; 2])| {
            amplitude.z() > MIN_DEVIATION && amplitude.value > least * std::f64::consts::SQRT_2
        };
        if let Some((amplitude, [across, down])) = waves.filter(stands_out) {
            let parameters = vec![
                ("amplitude_e", amplitude),
                ("cycles_per_column", Value::new(across, 0.0)),
                ("cycles_per_row", Value::new(down, 0.0)),
            ];
            self.add("periodic-pattern-noise", parameters);
        }
        let [gain, offset] = [0, 1].map(|which| {
            each().find_map(|(g, k)| {
                let unit = if which == 0 { Value::new(1.0, 0.0) } else { *k };
                g.channels[which].map(|c| (c.count, c.sd.over(unit)))
            })
        });
        let offset = offset.filter(|(_, sd)| sd.z() > MIN_DEVIATION && sd.value > least);
        if let Some(count) = gain.iter().chain(&offset).map(|(count, _)| *count).max() {
            let count = ("channels", Value::new(count as f64, 0.0));
            let gain = gain.map(|(_, sd)| ("gain", sd));
            let offset = offset.map(|(_, sd)| ("offset_e", sd));
            let parameters = [Some(count), offset, gain].into_iter().flatten().collect();
            self.add("readout-channel-mismatch", parameters);
        }
        // Codes that were multiplied are those of no converter.
        let analog = gains.iter().filter(|g| g.digital == 1.0);
        let codes: Vec<Codes<'_>> = analog
            .flat_map(|g| &g.histograms)
            .map(|h| Codes { histogram: &h.counts, sd: h.sd })
            .collect();
        let bits = significant_errors(&codes).into_iter();
        let bits: Vec<_> = bits.map(|(bit, error)| (KEYS[bit], error)).collect();
        if !bits.is_empty() {
            self.add("adc-nonlinearity", bits);
        }
    }

    fn add(&mut self, kind: &'static str, parameters: Vec<(&'static str, Value)>) {
        self.effects.push(Effect { kind, parameters, misfit: None });
    }
}

/// A variance at all gains, e⁻².
struct Part {
    sigma: Option<Value>,
    /// Smallest standard error of the variance at one gain, e⁻².
    at_one_gain: f64,
    /// In standard errors of none.
    deviation: f64,
    /// Standard error where there is none, e⁻².
    null: f64,
    misfit: Option<f64>,
}

impl Part {
    /// One variance at all gains; where they differ, that of the lowest gain.
    fn of(each: Vec<(Value, f64)>) -> Self {
        let nulls = each.iter().map(|(_, null)| Value::new(0.0, *null));
        let null = Value::combine(nulls).map_or(f64::INFINITY, |v| v.std_error);
        let mut variance = Value::combine(each.iter().map(|(v, _)| *v));
        let chi2 = variance.map_or(0.0, |mean| {
            let z = |v: &Value| (v.value - mean.value) / v.std_error;
            each.iter().map(|(v, _)| z(v).powi(2)).filter(|z| z.is_finite()).sum()
        });
        let misfit = tails::misfit(chi2, each.len() as f64 - 1.0);
        if misfit.is_some() {
            variance = each.first().map(|(v, _)| *v);
        }
        let deviation = variance.map_or(0.0, |v| v.value / null);
        let at_one_gain = each.iter().map(|(v, _)| v.std_error).fold(f64::INFINITY, f64::min);
        let sigma = variance.and_then(Value::sqrt);
        Self { sigma, at_one_gain, deviation, null, misfit }
    }

    /// With the error of a pattern that is the same at all gains, which has so many lines or
    /// pixels and no more.
    fn of_one_pattern(self) -> Self {
        let error = |s: Value| s.std_error.max(0.5 * self.at_one_gain / s.value);
        let sigma = self.sigma.map(|s| Value::new(s.value, error(s)));
        Self { sigma, ..self }
    }
}

/// What the spread of the read noise has by the lower half of the logarithms of variances, which
/// leans out further than their standard deviation: a quarter of the difference of the squares.
fn lean(dof: f64) -> f64 {
    /// Φ⁻¹(3/4).
    const QUARTILE: f64 = 0.674_489_75;
    let half = libm::log(median_of_squares(dof) / quantile_of_squares(-QUARTILE, dof)) / QUARTILE;
    0.25 * (half * half - trigamma(0.5 * dof))
}

/// Mean of no light, DN, less the dark signal of its exposure.
fn black(g: &AtGain, dark_dn: f64) -> Value {
    let sites = &g.found.bias.black_by_site;
    let n = sites.len() as f64;
    let mean = sites.iter().map(|v| v.value).sum::<f64>() / n;
    // Sites share frames, rows and columns: their errors do not average. The mean of a pattern is
    // zero over all sensors, but not over the lines of this one.
    let error = sites.iter().map(|v| v.std_error).sum::<f64>() / n;
    let (width, height) = g.found.size();
    let pattern = &g.found.bias.pattern;
    let lines = pattern.columns.value.max(0.0) / width as f64
        + pattern.rows.value.max(0.0) / height as f64;
    Value::new(mean - dark_dn, libm::hypot(error, lines.sqrt()))
}

/// Variance of the read noise, e⁻², without the shot noise of `dark_e` electrons and what a digital
/// gain makes of rounding beyond a twelfth.
fn read_variance(g: &AtGain, k: Value, dark_e: f64) -> Value {
    let rounding = (g.digital * g.digital - 1.0) / 12.0;
    let of_bias = g.found.bias.read_noise_variance;
    let of_bias = Value::new(of_bias.value - rounding, of_bias.std_error);
    let variance = of_bias.scaled(k.value.powi(2).recip());
    let of_gain = 2.0 * variance.value * k.std_error / k.value;
    Value::new(variance.value - dark_e, libm::hypot(variance.std_error, of_gain))
}

/// The dark current over all gains.
fn dark(gains: &[AtGain], response: &[Value]) -> Option<Dark> {
    struct One {
        gain: usize,
        rate: Value,
        spread: Option<Value>,
        hot: Option<[Value; 2]>,
    }
    let all = gains.iter().zip(response).enumerate().filter_map(|(gain, (g, k))| {
        let found = g.found.dark_current.as_ref()?;
        if g.longest_s < MIN_SPAN * g.shortest_s {
            return None;
        }
        let electrons = |v: Value| v.over(*k);
        let (width, height) = g.found.size();
        // The level of a frame is that of all its pixels and rows, which move together.
        let of_rows = g.found.bias.row_variance.value.max(0.0) / height as f64;
        let of_frames = g.found.frame_offsets.map_or(0.0, |o| o.sd.value * o.sd.value);
        let of_levels = found.errors_of_levels(0.0)[0] * (of_rows + of_frames).sqrt();
        let own = found.ordinary;
        let ordinary = Value::new(own.value.max(0.0), libm::hypot(own.std_error, of_levels));
        let spread = found.pattern_variance.sqrt().map(electrons);
        let count = found.hot_share.value * (width * height) as f64;
        let hot = found.hot_excess.filter(|_| count >= MIN_HOT).map(|mean| {
            // Of an exponential law the excess over a limit has the law's mean.
            let below = libm::exp((found.hot_threshold - found.median.value) / mean.value);
            [found.hot_share.scaled(below), electrons(mean)]
        });
        let hot = hot.filter(|[fraction, _]| fraction.value <= 1.0);
        let rate = electrons(ordinary);
        rate.std_error.is_finite().then_some(One { gain, rate, spread, hot })
    });
    let all: Vec<One> = all.collect();
    // At the lowest gain the fewest of the hot pixels saturate.
    let lowest = all.first()?;
    // All gains see the same pixels: their pattern is known as well as at the best of them.
    let spreads = || all.iter().filter_map(|one| one.spread);
    let error = spreads().map(|s| s.std_error).fold(f64::INFINITY, f64::min);
    Some(Dark {
        rate: Value::combine(all.iter().map(|one| one.rate))?,
        spread: Value::combine(spreads()).map(|s| Value::new(s.value, error)),
        hot: lowest.hot,
        gains: all.iter().map(|one| one.gain).collect(),
    })
}

/// PRNU of the brightest flat of the lowest gain, of which all flats tell what neighbours share: of
/// the charge, which the response compresses.
pub fn prnu(
    gains: &[AtGain],
    response: &Response,
    lit: &[usize],
    dsnu_e_per_s: f64,
) -> Option<Prnu> {
    let index = *lit.first()?;
    let g = &gains[index];
    let level = |i: usize| g.found.flats[i].level();
    let flat = g.flats.iter().max_by(|a, b| level(a.index).total_cmp(&level(b.index)))?;
    let k = response.gains[0].value;
    let found = &g.found.flats[flat.index];
    let variance = Value::combine(found.sites.iter().map(|site| {
        let slope = response.slope(0, site.level.value);
        let grown = k * dsnu_e_per_s * (flat.exposure_s - g.shortest_s) / site.level.value;
        let of_charge = site.prnu_variance.scaled(slope.powi(2).recip());
        Value::new(of_charge.value - grown * grown, of_charge.std_error)
    }))?;
    // Channels of columns are apart: of their variance over sensors, n channels have n − 1 parts,
    // and the mean over nine columns, which holds a ninth of a pattern of 2, 4 or 8, was taken off.
    let kept = (1.0 - (SQUARE as f64).sqrt().recip()).powi(2);
    let of_channels = g.channels[0]
        .map_or(0.0, |c| kept * c.sd.value.powi(2) * (c.count as f64 - 1.0) / c.count as f64);
    let slope = response.slope(0, found.level());
    let shared = g.found.prnu?.shared.map(|v| v.scaled(slope.powi(2).recip()));
    Some(Prnu { variance: Value::new(variance.value - of_channels, variance.std_error), shared })
}

/// What of it neighbours share, where that stands out.
pub fn shared(prnu: &Prnu) -> Option<Value> {
    let shared = prnu.shared();
    let stands_out = prnu.deviation() > MIN_DEVIATION;
    stands_out.then_some(shared).filter(|s| s.value > MIN_SHARE * prnu.variance.value)
}
