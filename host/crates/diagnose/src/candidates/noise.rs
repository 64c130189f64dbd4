//! Noise of single pixels: `read-noise`, `read-noise-spread`, `random-telegraph-noise`,
//! `heavy-tailed-read-noise`.
//!
//! With v the variance of dark pixels over frames (DN²), K the system gain (DN/e⁻), primes what
//! the model predicts and ⟨ ⟩ inverse-variance means:
//!
//!   read noise: r² = r₀² + ⟨(v − v')/K²⟩, e⁻², over the dark stacks with little dark
//!               charge; of several gains G the line (v − v')/K² = a + b/G², b behind the gain;
//!   its spread: Var(r²) = r⁴ g (g − 1), g = exp(4 s²), from the scatter of the pixels' variances
//!               beyond that of χ²;
//!   its tails:  the λ of Tukey's law with the excess kurtosis of the dark residuals;
//!   telegraph:  share f and amplitude A (e⁻) of the pixels from two moments of a law that only
//!               they widen: third and fourth cumulant of the offset map, where a pixel that is up
//!               half of the time lies ±A/2, or mean and mean square of what outlying pixels have
//!               in excess of the median variance, A²/4.

use super::common::{Count, dark_growth, present};
use super::proposal::{Proposal, deviation};
use crate::evidence::Evidence;
use crate::model::effects::current;
use crate::numerics::tails::{median_of_squares, quantile_of_squares};
use crate::statistics::maps::{MapKind, reference_dark};
use crate::statistics::statistic::{Place, What};
use camrig_base::Value;
use camrig_base::median::median;
use camrig_captures::Role;
use camrig_estimates::gains::Parts;
use camrig_sensor_core::effects::{Effect, read_noise::ReadNoise};

/// Dark charge, in variances of read noise, below which a dark stack shows read noise: an error of
/// a tenth of the dark charge is then a hundredth of the variance.
const LITTLE_DARK_CHARGE: f64 = 0.1;
/// Least spread by which the error of the spread is divided: at none the derivative is none.
const MIN_SPREAD: f64 = 0.01;
/// Standard normal deviate whose tail, 0.001, is what an outlying variance passes by chance.
const OUTLYING: f64 = 3.1;
/// The tail of [`OUTLYING`].
const OUTLYING_TAIL: f64 = 0.001;
/// Mean excess of values beyond that limit over the excess of the limit: a normal law has a mean
/// of 3.4 beyond 3.1.
const TAIL_MEAN: f64 = 1.1;
/// Chance of a renewal from frame to frame where nothing shows it: the default of the effect.
const RENEWAL: f64 = 0.2;
/// Renewals that the effect allows.
const RENEWALS: [f64; 2] = [0.03, 1.0];
/// Standard error of the share of telegraph pixels in Poisson errors of their number: it follows
/// from the third power of an amplitude that the same pixels give. Chosen, not measured.
const TELEGRAPH_SHARE_ERROR: f64 = 2.0;
/// Excess kurtosis of read noise below which no tails are proposed: a little above the smallest
/// that the `small` design of `tests/hidden` can show, 0.014.
const MIN_KURTOSIS: f64 = 0.02;
/// The λ of a part of the read noise in longer tails than all of it would have, the rest being
/// normal: so the fourth and sixth cumulants of Student's t, 6/(ν−4) and 240/((ν−4)(ν−6)), are met
/// to some per cent. Clear of 0, about which the effect keeps to the logistic law, and of the rare
/// giants of smaller λ.
const LONGER: f64 = 0.04;
/// The λ that are searched: those of the effect in which the kurtosis falls with λ, to just short
/// of 0.14, where it is that of a normal law.
const LAMBDAS: [f64; 2] = [-0.22, 0.13];
/// Change of λ from which the slope of its kurtosis is taken.
const SLOPE_STEP: f64 = 0.005;
/// About λ = 0 the moments of Tukey's law are those of the logistic law.
const LOGISTIC_WITHIN: f64 = 0.01;
/// Excess kurtosis of the logistic law.
const LOGISTIC_KURTOSIS: f64 = 1.2;

/// `read-noise`: variance of the pixels of dark stacks; at several gains G with its part behind the
/// gain, of which 1/G² is seen.
pub fn read_noise(e: &Evidence<'_>) -> Option<Proposal> {
    let excess = |&i: &usize| {
        let condition = &e.design.conditions[i];
        let excess = e.variance_excess(i)?.scaled(1.0 / e.gain(condition).powi(2));
        Some((condition.stack.analog_gain, excess))
    };
    let excess: Vec<(f64, Value)> = short_darks(e).iter().filter_map(excess).collect();
    if let Some(both) = read_noise_and_part(e, &excess) {
        return Some(both);
    }
    let excess = Value::combine(excess.into_iter().map(|(_, excess)| excess))?;
    let noise = &e.camera.sensor.noise;
    let s = deviation(noise.read_e, excess)?;
    let effect = with_read_noise(e, s.value);
    Some(Proposal::new("read-noise", effect, excess.z().abs()).with("read_e", s))
}

/// Both parts, from what stacks at gains G have more than the model, e⁻²; none of a single gain.
fn read_noise_and_part(e: &Evidence<'_>, excess: &[(f64, Value)]) -> Option<Proposal> {
    let at_unity = excess.iter().map(|(gain, v)| (gain * gain, v.scaled(gain * gain)));
    let points: Vec<(f64, Value)> = at_unity.collect();
    let more = Parts::of(&points)?;
    let noise = &e.camera.sensor.noise;
    let post = (noise.read_e_post.powi(2) + more.behind.value).max(0.0);
    let pre = (noise.read_e.powi(2) - noise.read_e_post.powi(2) + more.before.value).max(0.0);
    let root = |variance: f64, error: f64| {
        Value::new(variance.sqrt(), 0.5 * error / variance.sqrt().max(error.sqrt()))
    };
    let whole = root(pre + post, more.at_unity.std_error);
    let post = root(post, more.behind.std_error);
    let effect = ReadNoise { read_e: whole.value as f32, read_e_post: post.value as f32 };
    // χ² of no change less that of the change.
    let gained = points.iter().map(|(square, v)| {
        let left = v.value - more.before.value * square - more.behind.value;
        v.z().powi(2) - (left / v.std_error).powi(2)
    });
    let strength = gained.sum::<f64>().max(0.0).sqrt();
    let proposal = Proposal::new("read-noise", effect.into(), strength);
    Some(proposal.with("read_e", whole).with("read_e_post", post))
}

/// Read noise of the model with another standard deviation at unity gain, e⁻; the part after the
/// gain stage is at most the whole.
fn with_read_noise(e: &Evidence<'_>, read_e: f64) -> Effect {
    let post = e.camera.sensor.noise.read_e_post.min(read_e);
    ReadNoise { read_e: read_e as f32, read_e_post: post as f32 }.into()
}

/// Dark stacks whose dark charge is small against read noise; if there is none, the shortest.
fn short_darks(e: &Evidence<'_>) -> Vec<usize> {
    let noise = &e.camera.sensor.noise;
    let short: Vec<usize> = e
        .of_role(Role::Dark)
        .filter(|(_, c)| {
            let growth = dark_growth(noise, c.stack.temperature_c);
            let charge = noise.dark_current_e_per_s * growth * c.stack.exposure_s;
            charge < LITTLE_DARK_CHARGE * noise.read_e.powi(2)
                && c.before_e.iter().all(|&b| b == 0.0)
        })
        .map(|(i, _)| i)
        .collect();
    if short.is_empty() { reference_dark(e.design).into_iter().collect() } else { short }
}

/// Of [`short_darks`] that with most frames.
fn longest_short_dark(e: &Evidence<'_>) -> Option<usize> {
    short_darks(e).into_iter().max_by_key(|&i| e.design.conditions[i].stack.frames)
}

/// Excess over the model of the variance of the pixels' variances, e⁻⁴, in the dark stack with
/// most frames.
fn excess_of_spread(e: &Evidence<'_>) -> Option<Value> {
    let stack = longest_short_dark(e)?;
    let f = e.stacks[stack].dof;
    let place = Place::Stack(stack);
    let (vd, vm) = e.variance(stack)?;
    let k4 = e.gain(&e.design.conditions[stack]).powi(4);
    // Spread = f/2 (M (1 + 2/f) − 1), M the mean square of the pixels' relative variance.
    let of = |spread: f64, v: f64| (2.0 * spread / f + 1.0) / (1.0 + 2.0 / f) * v * v;
    let d = of(e.measured(place, What::Spread)?, vd) - vd * vd;
    let m = of(e.predicted(place, What::Spread)?, vm) - vm * vm;
    let se = e.difference(place, What::Spread)?.std_error * 2.0 / (f + 2.0) * vm * vm;
    Some(Value { value: (d - m) / k4, std_error: se / k4 })
}

/// `read-noise-spread`: scatter of the pixels' dark variances; with the model's read noise as the
/// median over pixels, and with a median that leaves the mean square where it is.
pub fn read_noise_spread(e: &Evidence<'_>) -> Vec<Proposal> {
    spreads(e).map_or_else(Vec::new, Into::into)
}

fn spreads(e: &Evidence<'_>) -> Option<[Proposal; 2]> {
    let excess = excess_of_spread(e)?;
    let read = e.camera.sensor.noise.read_e.powi(2);
    let present = present(e.camera, "read-noise-spread", "spread").unwrap_or(0.0);
    // Var(r² e^(2sz)) = r⁴ e^(4s²) (e^(4s²) − 1).
    let now = {
        let g = libm::exp(4.0 * present * present);
        read * read * g * (g - 1.0)
    };
    let target = ((now + excess.value) / (read * read)).max(0.0);
    let g = 0.5 + (0.25 + target).sqrt();
    let s = (libm::log(g) / 4.0).sqrt();
    let se = excess.std_error / (read * read) / (8.0 * s.max(MIN_SPREAD) * g * (2.0 * g - 1.0));
    let spread = [("spread", Value::new(s, se))];
    let alone = Proposal::of("read-noise-spread", excess.z().abs(), spread)?;
    let median = e.camera.sensor.noise.read_e * libm::exp(present * present - s * s);
    let both = alone.clone().and(with_read_noise(e, median));
    Some([alone, both.with("read_e", Value::chosen(median))])
}

/// A law of amplitudes over telegraph pixels.
struct Amplitudes {
    /// The effect's parameter: 1 exponential, 0 all alike.
    spread: f64,
    /// ⟨Aⁿ⟩/⟨A⟩ⁿ for n = 2, 3, 4.
    moments: [f64; 3],
}

/// The laws that are tried.
const AMPLITUDES: [Amplitudes; 2] = [
    Amplitudes { spread: 1.0, moments: [2.0, 6.0, 24.0] },
    Amplitudes { spread: 0.0, moments: [1.0; 3] },
];

/// `random-telegraph-noise`: pixels that switch between two levels. Once from the outliers of the
/// offset map and once from those of the variances, each with every law of amplitudes; where the
/// model has the effect, the share of pixels alone, from the counts of outliers.
pub fn telegraph(e: &Evidence<'_>) -> Vec<Proposal> {
    let Some(t) = Telegraph::of(e) else { return Vec::new() };
    let present = current(e.camera, "random-telegraph-noise");
    if let Some(Effect::RandomTelegraphNoise(x)) = present {
        let (seen, expected) = t.noisy.as_ref().map_or((0.0, 0.0), |n| (n.seen, n.expected));
        let ratio = (t.high.seen + seen + 1.0) / (t.high.expected + expected + 1.0);
        let fraction = f64::from(x.fraction) * ratio;
        let amplitude = f64::from(x.amplitude_e);
        return t.proposal(fraction, amplitude, f64::from(x.spread)).into_iter().collect();
    }
    let mut out = Vec::new();
    // Cumulants of the map: f ⟨(A/2)³⟩ and f ⟨(A/2)⁴⟩.
    let [third, fourth] = t.cumulants;
    for Amplitudes { spread, moments: [_, c3, c4] } in AMPLITUDES {
        let half = fourth / third * c3 / c4;
        if half > 0.0 && third > 0.0 {
            out.extend(t.proposal(third / (c3 * half.powi(3)), 2.0 * half / t.gain, spread));
        }
    }
    // Excesses of the variances: f ⟨A²/4⟩ and f ⟨(A²/4)²⟩.
    if let Some((first, second)) = outlying_variances(e, t.stack) {
        for Amplitudes { spread, moments: [c2, _, c4] } in AMPLITUDES {
            let quarter = second / first * c2 / c4;
            if quarter > 0.0 && first > 0.0 {
                out.extend(t.proposal(first / (c2 * quarter), 2.0 * quarter.sqrt(), spread));
            }
        }
    }
    out
}

/// What the reference dark stack shows of telegraph pixels.
struct Telegraph {
    /// The stack.
    stack: usize,
    /// Number of its pixels.
    pixels: f64,
    /// System gain, DN/e⁻.
    gain: f64,
    /// High outliers of the offset map.
    high: Count,
    /// Pixels of outlying variance, where frames are enough for them.
    noisy: Option<Count>,
    /// Third (DN³) and fourth (DN⁴) cumulant of the offset map.
    cumulants: [f64; 2],
    /// Deviation of all that shows it, in standard deviations.
    strength: f64,
    /// Chance of a renewal from one frame to the next.
    renewal: f64,
}

impl Telegraph {
    fn of(e: &Evidence<'_>) -> Option<Self> {
        let stack = reference_dark(e.design)?;
        let s = &e.map(MapKind::Offset)?.spatial;
        let gain = e.reference_gain()?;
        let high = Count::of(e, Place::Map(MapKind::Offset), What::High)?;
        let noisy = Count::of(e, Place::Stack(stack), What::NoisyPixels);
        let spread = excess_of_spread(e).map_or(0.0, |x| x.z());
        let strength = high.z.max(noisy.as_ref().map_or(0.0, |n| n.z)).max(spread);
        Some(Self {
            stack,
            pixels: (s.rows.means.len() * s.columns.means.len()) as f64,
            gain,
            high,
            noisy,
            cumulants: s.cumulants,
            strength,
            renewal: renewal(e, stack, e.stacks[stack].dof),
        })
    }

    /// A proposal of a share of pixels with a mean amplitude, e⁻.
    fn proposal(&self, fraction: f64, amplitude: f64, spread: f64) -> Option<Proposal> {
        let root = (fraction * self.pixels).max(1.0).sqrt();
        let se = fraction * TELEGRAPH_SHARE_ERROR / root;
        let parameters = [
            ("fraction", Value::new(fraction, se)),
            ("amplitude_e", Value { value: amplitude, std_error: amplitude / root }),
            ("renewal", Value::chosen(self.renewal)),
            ("spread", Value::chosen(spread)),
        ];
        Proposal::of("random-telegraph-noise", self.strength, parameters)
    }
}

/// Chance of a renewal from one frame to the next: one less the correlation of the noisiest pixels
/// with the frame before, in a stack of `dof` degrees of freedom.
fn renewal(e: &Evidence<'_>, stack: usize, dof: f64) -> f64 {
    let place = Place::Stack(stack);
    let lag = e.measured(place, What::TopTimeLag).zip(e.predicted(place, What::TopTimeLag));
    let present = present(e.camera, "random-telegraph-noise", "renewal");
    match (lag, present) {
        (Some((d, m)), Some(present)) => present - (d - m),
        // A stack's own mean hides part of the correlation.
        (Some((d, _)), None) => 1.0 - d - 2.0 / dof,
        (None, present) => present.unwrap_or(RENEWAL),
    }
    .clamp(RENEWALS[0], RENEWALS[1])
}

/// Mean and mean square, e⁻² and e⁻⁴, over all pixels of what outlying pixels have in excess of
/// the variance of the others. `None` where χ² explains them.
fn outlying_variances(e: &Evidence<'_>, stack: usize) -> Option<(f64, f64)> {
    let t = &e.stacks[stack];
    let k2 = e.gain(&e.design.conditions[stack]).powi(2);
    let middle = f64::from(median(&mut t.pixel_variance.clone(), f32::total_cmp));
    let white = middle / median_of_squares(t.dof);
    let limit = white * quantile_of_squares(OUTLYING, t.dof);
    let (mut first, mut second) = (0.0, 0.0);
    for v in t.pixel_variance.iter().map(|&v| f64::from(v)).filter(|v| *v > limit) {
        first += v - white;
        // The scatter of a pixel's own variance, 2v²/(f + 2), is no spread.
        second += (v - white).powi(2) - 2.0 * v * v / (t.dof + 2.0);
    }
    let n = t.pixel_variance.len() as f64;
    let chance = OUTLYING_TAIL * TAIL_MEAN * (limit - white);
    let (first, second) = ((first / n - chance) / k2, second / n / (k2 * k2));
    (first > 0.0 && second > 0.0).then_some((first, second))
}

/// Excess kurtosis of Tukey's law (moments of its quantile function: Joiner & Rosenblatt 1971).
fn tukey_kurtosis(l: f64) -> f64 {
    if l.abs() < LOGISTIC_WITHIN {
        return LOGISTIC_KURTOSIS;
    }
    let g = libm::tgamma;
    let beta = |a: f64, b: f64| g(a) * g(b) / g(a + b);
    let m2 = 2.0 / (l * l) * (1.0 / (1.0 + 2.0 * l) - beta(1.0 + l, 1.0 + l));
    let m4 = 2.0 / l.powi(4)
        * (1.0 / (1.0 + 4.0 * l) - 4.0 * beta(1.0 + 3.0 * l, 1.0 + l)
            + 3.0 * beta(1.0 + 2.0 * l, 1.0 + 2.0 * l));
    m4 / (m2 * m2) - 3.0
}

/// The λ with an excess kurtosis, by bisection, and how fast the kurtosis falls with λ there.
fn tukey_lambda(kurtosis: f64) -> (f64, f64) {
    let [mut low, mut high] = LAMBDAS;
    // Halving a range of 0.35 to below the rounding of a double.
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if tukey_kurtosis(middle) > kurtosis { low = middle } else { high = middle }
    }
    let lambda = 0.5 * (low + high);
    let fall = tukey_kurtosis(lambda - SLOPE_STEP) - tukey_kurtosis(lambda + SLOPE_STEP);
    (lambda, fall / (2.0 * SLOPE_STEP))
}

/// `heavy-tailed-read-noise`: read noise that follows Tukey's law altogether, or in part and in
/// longer tails.
pub fn heavy_tails(e: &Evidence<'_>) -> Vec<Proposal> {
    tails(e).unwrap_or_default()
}

fn tails(e: &Evidence<'_>) -> Option<Vec<Proposal>> {
    let stack = longest_short_dark(e)?;
    let kurtosis = e.difference(Place::Stack(stack), What::Kurtosis)?;
    let v = e.variance(stack)?.0 / e.gain(&e.design.conditions[stack]).powi(2);
    let normal = e.camera.sensor.noise.read_e;
    let present = match current(e.camera, "heavy-tailed-read-noise") {
        Some(Effect::HeavyTailedReadNoise(x)) => Some((f64::from(x.sigma_e), f64::from(x.lambda))),
        _ => None,
    };
    let read = present.map_or(normal, |p| libm::hypot(p.0, normal));
    // Share of the variance, and excess kurtosis of all read noise.
    let share = present.map(|p| (p.0 / read).powi(2));
    let now = present.zip(share).map_or(0.0, |(p, share)| share * share * tukey_kurtosis(p.1));
    // The kurtosis of a sum is that of the part with tails times the square of its share.
    let dilution = (v / (read * read)).powi(2);
    let target = now + kurtosis.value * dilution;
    if target < MIN_KURTOSIS {
        return None;
    }
    let part = (target / tukey_kurtosis(LONGER)).sqrt();
    let shares = match share {
        Some(share) => vec![share],
        None if part < 1.0 => vec![1.0, part],
        None => vec![1.0],
    };
    let propose = |share: f64| {
        let (lambda, fall) = tukey_lambda(target / (share * share));
        let (sigma, rest) = (read * share.sqrt(), read * (1.0 - share).sqrt());
        let se = kurtosis.std_error * dilution / (share * share) / fall;
        let lambda = Value::new(lambda, se);
        let law = [("sigma_e", Value::chosen(sigma)), ("lambda", lambda)];
        let p = Proposal::of("heavy-tailed-read-noise", kurtosis.z().abs(), law)?;
        let p = p.and(with_read_noise(e, rest));
        Some(if share < 1.0 { p.with("read_e", Value::chosen(rest)) } else { p })
    };
    Some(shares.into_iter().filter_map(propose).collect())
}
