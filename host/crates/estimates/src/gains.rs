//! What lies behind the analog gain: a variance of the bias at several gains G is a G² + b in DN²,
//! with a what is amplified and b what the converter and the paths behind the gain add (EMVA 1288
//! release 4.0, section 2.2).

use super::bias::Bias;
use camrig_base::Value;

/// Standard errors from which a part is there for certain, and below which it may be none.
const CERTAIN: f64 = 5.0;
const MAX_CHANCE: f64 = 3.0;

/// A variance in DN²: what is amplified, at unity gain, and what comes behind the gain.
#[derive(Clone, Copy, Debug)]
pub struct Parts {
    /// a.
    pub before: Value,
    /// b.
    pub behind: Value,
    /// a + b, the whole at unity gain: its parts are not independent.
    pub at_unity: Value,
}

/// The parts of each kind of noise and pattern of the bias.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct BehindGain {
    /// Of the read noise of the median pixel.
    pub read_noise: Parts,
    /// Of the noise of rows.
    pub rows: Parts,
    /// Of the offsets of sites from frame to frame; none of a monochrome sensor.
    pub sites: Option<Parts>,
    /// Of the pattern of columns.
    pub column_pattern: Parts,
    /// Of the pattern of rows.
    pub row_pattern: Parts,
    /// Of the pattern of single pixels.
    pub pixel_pattern: Parts,
    /// Whether offsets of frames are likelier all behind the gain than all before it.
    pub frames_are_behind: bool,
}

impl BehindGain {
    /// Of the bias at each gain; none of a single gain.
    pub(crate) fn of(biases: &[(f64, Bias)]) -> Option<Self> {
        let parts = |of: &dyn Fn(&Bias) -> Value| {
            let points = biases.iter().map(|(gain, bias)| (gain * gain, of(bias)));
            Parts::of(&points.collect::<Vec<_>>())
        };
        let of_sites = |b: &Bias| b.frame_site_variance.unwrap_or(Value::new(0.0, 1.0));
        let has_sites = biases.iter().all(|(_, b)| b.frame_site_variance.is_some());
        let at_least = |v: Value, null: f64| Value::new(v.value, v.std_error.max(null));
        Some(Self {
            read_noise: parts(&|b| b.read_noise_variance)?,
            rows: parts(&|b| at_least(b.row_variance, b.row_variance_null))?,
            sites: if has_sites { parts(&of_sites) } else { None },
            column_pattern: parts(&|b| at_least(b.pattern.columns, b.pattern.line_nulls[0]))?,
            row_pattern: parts(&|b| at_least(b.pattern.rows, b.pattern.line_nulls[1]))?,
            pixel_pattern: parts(&|b| b.pattern.pixels)?,
            frames_are_behind: frame_deviance(biases, 0) < frame_deviance(biases, 2),
        })
    }
}

/// −2 ln of the likelihood of offsets of frames whose variance grows by this power of the gain: s is
/// that of n frame means, p that of the law and of what is white, Σ (n − 1) (ln p + s/p). A few
/// frames tell little of a variance, but σ² G² differs much from σ².
fn frame_deviance(biases: &[(f64, Bias)], power: i32) -> f64 {
    let dof = |b: &Bias| b.frames() as f64 - 1.0;
    let (sum, weight) = biases.iter().fold((0.0, 0.0), |(sum, weight), (gain, b)| {
        (
            sum + dof(b) * b.frame_variance.value / libm::pow(*gain, f64::from(power)),
            weight + dof(b),
        )
    });
    let law = (sum / weight).max(0.0);
    let of_bias = |(gain, b): &(f64, Bias)| {
        // Its error is that of the whole variance.
        let seen = b.frame_variance.std_error * (0.5 * dof(b)).sqrt();
        let p =
            (seen - b.frame_variance.value).max(0.0) + law * libm::pow(*gain, f64::from(power));
        if p > 0.0 { dof(b) * (libm::log(p) + seen / p) } else { 0.0 }
    };
    biases.iter().map(of_bias).sum()
}

impl Parts {
    /// Whether all of it lies behind the gain, as far as the captures show.
    pub fn is_behind(&self) -> bool {
        self.behind.z() > CERTAIN && self.before.z() < MAX_CHANCE
    }

    /// The weighted line through variances over the square of the gain; none of a single gain.
    pub fn of(points: &[(f64, Value)]) -> Option<Self> {
        let (mut w, mut wx, mut wy, mut wxx, mut wxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (x, v) in points {
            let weight = v.std_error.max(f64::MIN_POSITIVE.sqrt()).powi(2).recip();
            w += weight;
            wx += weight * x;
            wy += weight * v.value;
            wxx += weight * x * x;
            wxy += weight * x * v.value;
        }
        let determinant = w * wxx - wx * wx;
        if points.len() < 2 || determinant <= 1e-9 * w * wxx {
            return None;
        }
        // With error of the combination c a + d b, of which the covariance is −Σwx.
        let value = |c: f64, d: f64| {
            let value = c * (w * wxy - wx * wy) + d * (wxx * wy - wx * wxy);
            let variance = c * c * w + d * d * wxx - 2.0 * c * d * wx;
            Value::new(value / determinant, (variance / determinant).sqrt())
        };
        Some(Self { before: value(1.0, 0.0), behind: value(0.0, 1.0), at_unity: value(1.0, 1.0) })
    }
}
