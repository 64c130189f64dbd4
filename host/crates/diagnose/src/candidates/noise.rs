//! Noise of single pixels.

use super::{Proposal, deviation, list};
use crate::evidence::{Estimated, Evidence, pooled};
use crate::maps::MapKind;
use crate::model::current;
use crate::statistics::{Place, What};
use crate::tails::{median_of_squares, quantile_of_squares};
use camrig_base::median::median;
use camrig_captures::Role;
use camrig_sensor_core::effects::{
    Effect, heavy_tailed_read_noise::HeavyTailedReadNoise,
    random_telegraph_noise::RandomTelegraphNoise, read_noise::ReadNoise,
    read_noise_spread::ReadNoiseSpread,
};

/// Pixel variance of the dark stacks.
pub fn read_noise(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let short = short_darks(e);
        let excess = pooled(short.iter().filter_map(|&i| {
            let k = e.gain(&e.design.conditions[i]).powi(2);
            let x = e.variance_excess(i)?;
            Some(Estimated { value: x.value / k, se: x.se / k })
        }))?;
        let noise = &e.camera.sensor.noise;
        let s = deviation(noise.read_e, excess)?;
        let post = noise.read_e_post.min(s.value);
        let effect = ReadNoise { read_e: s.value as f32, read_e_post: post as f32 };
        Some(
            Proposal::new("read-noise", effect.into(), excess.z().abs())
                .with("read_e", s.value, s.se),
        )
    })())
}

/// Dark stacks whose dark charge is small against read noise, else the shortest.
fn short_darks(e: &Evidence<'_>) -> Vec<usize> {
    let noise = &e.camera.sensor.noise;
    let few: Vec<usize> = e
        .of_role(Role::Dark)
        .filter(|(_, c)| {
            let growth =
                ((c.temperature_c - noise.temperature_ref_c) / noise.dark_doubling_c).exp2();
            noise.dark_current_e_per_s * growth * c.exposure_s < 0.1 * noise.read_e.powi(2)
                && c.before_e.iter().all(|&b| b == 0.0)
        })
        .map(|(i, _)| i)
        .collect();
    if few.is_empty() {
        super::super::maps::reference_dark(e.design).into_iter().collect()
    } else {
        few
    }
}

/// Excess over the model of Var(σ²)/mean², e⁻⁴, and dark variance, e⁻², of the dark stack with most frames.
fn variance_of_variance(e: &Evidence<'_>) -> Option<(usize, Estimated, f64)> {
    let (stack, c) = short_darks(e)
        .into_iter()
        .map(|i| (i, &e.design.conditions[i]))
        .max_by_key(|(_, c)| c.frames)?;
    let f = e.stacks[stack].dof;
    let place = Place::Stack(stack);
    let (vd, vm) = e.variance(stack)?;
    let k4 = e.gain(c).powi(4);
    // Spread = f/2 (M (1 + 2/f) − 1), M the mean square of the pixels' relative variance.
    let of = |spread: f64, v: f64| (2.0 * spread / f + 1.0) / (1.0 + 2.0 / f) * v * v;
    let d = of(e.measured(place, What::Spread)?, vd) - vd * vd;
    let m = of(e.predicted(place, What::Spread)?, vm) - vm * vm;
    let se = e.difference(place, What::Spread)?.se * 2.0 / (f + 2.0) * vm * vm;
    Some((stack, Estimated { value: (d - m) / k4, se: se / k4 }, vd / e.gain(c).powi(2)))
}

/// Spread of the pixels' dark variance.
pub fn read_noise_spread(e: &Evidence<'_>) -> Vec<Proposal> {
    let made = (|| {
        let (_, excess, _) = variance_of_variance(e)?;
        let read = e.camera.sensor.noise.read_e.powi(2);
        let present = match current(e.camera, "read-noise-spread") {
            Some(Effect::ReadNoiseSpread(x)) => f64::from(x.spread),
            _ => 0.0,
        };
        // Var(r² e^(2sz)) = r⁴ e^(4s²) (e^(4s²) − 1).
        let now = {
            let g = (4.0 * present * present).exp();
            read * read * g * (g - 1.0)
        };
        let target = ((now + excess.value) / (read * read)).max(0.0);
        let g = 0.5 + (0.25 + target).sqrt();
        let s = (g.ln() / 4.0).sqrt();
        let se = excess.se / (read * read) / (8.0 * s.max(0.01) * g * (2.0 * g - 1.0));
        let effect = ReadNoiseSpread { spread: s as f32 };
        let one = Proposal::new("read-noise-spread", effect.into(), excess.z().abs())
            .with("spread", s, se);
        // The median that leaves the mean square where it was.
        let median = e.camera.sensor.noise.read_e * (present * present - s * s).exp();
        let post = e.camera.sensor.noise.read_e_post.min(median);
        let read = ReadNoise { read_e: median as f32, read_e_post: post as f32 };
        let both = one.clone().and(read.into()).with("read_e", median, f64::NAN);
        Some([one, both])
    })();
    made.into_iter().flatten().collect()
}

/// A few pixels that switch between two levels: outliers of the offset map, or where few frames make that, of the
/// map of noise.
pub fn telegraph(e: &Evidence<'_>) -> Vec<Proposal> {
    let made = (|| {
        let reference = super::super::maps::reference_dark(e.design)?;
        let t = &e.stacks[reference];
        let place = Place::Map(MapKind::Offset);
        let s = &e.map(MapKind::Offset)?.spatial;
        let k = e.reference_gain()?;
        let pixels = (s.rows.len() * s.columns.len()) as f64;
        let count = |place, what| {
            let (d, m) = (e.measured(place, what)?, e.predicted(place, what)?);
            Some((d, m, crate::tails::count(d, m * 16.0, 16.0)))
        };
        let (high, expected, z_high) = count(place, What::High)?;
        let noisy = count(Place::Stack(reference), What::NoisyPixels);
        let spread = variance_of_variance(e).map_or(0.0, |v| v.1.z());
        let strength = z_high.max(noisy.map_or(0.0, |n| n.2)).max(spread);
        let renewal = renewal(e, reference, t.dof);
        let propose = |fraction: f64, amplitude: f64, width: f32| {
            let effect = RandomTelegraphNoise {
                fraction: fraction as f32,
                amplitude_e: amplitude as f32,
                renewal: renewal as f32,
                duty: 0.5,
                spread: width,
            };
            let root = (fraction * pixels).max(1.0).sqrt();
            Proposal::new("random-telegraph-noise", effect.into(), strength)
                .with("fraction", fraction, fraction * 2.0 / root)
                .with("amplitude_e", amplitude, amplitude / root)
                .with("renewal", renewal, f64::NAN)
                .with("spread", f64::from(width), f64::NAN)
        };
        if let Some(Effect::RandomTelegraphNoise(x)) = current(e.camera, "random-telegraph-noise") {
            // The counts of outliers follow the fraction; the amplitude stays.
            let noisy = noisy.map_or((0.0, 0.0), |n| (n.0, n.1));
            let ratio = (high + noisy.0 + 1.0) / (expected + noisy.1 + 1.0);
            let fraction = f64::from(x.fraction) * ratio;
            return Some(vec![propose(fraction, f64::from(x.amplitude_e), x.spread)]);
        }
        let mut out = Vec::new();
        // Cumulants of the map: f (A/2)³ and f (A/2)⁴ for one amplitude, 6 and 24 times that for exponential ones.
        let [third, fourth] = s.cumulants;
        for (width, c3, c4) in [(1.0f32, 6.0, 24.0), (0.0, 1.0, 1.0)] {
            let half = fourth / third * c3 / c4;
            if half > 0.0 && third > 0.0 {
                out.push(propose(third / (c3 * half.powi(3)), 2.0 * half / k, width));
            }
        }
        // The same from the variances of the pixels, f A²/4 and f (A²/4)².
        if let Some((m1, m2)) = variance_excess(e, reference) {
            for (width, c1, c2) in [(1.0f32, 2.0, 24.0), (0.0, 1.0, 1.0)] {
                let quarter = m2 / m1 * c1 / c2;
                if quarter > 0.0 && m1 > 0.0 {
                    out.push(propose(m1 / (c1 * quarter), 2.0 * quarter.sqrt(), width));
                }
            }
        }
        Some(out)
    })();
    made.unwrap_or_default()
}

/// Chance of a renewal from the memory of the noisiest pixels.
fn renewal(e: &Evidence<'_>, stack: usize, dof: f64) -> f64 {
    let place = Place::Stack(stack);
    let lag = e.measured(place, What::TopTimeLag).zip(e.predicted(place, What::TopTimeLag));
    let held = match current(e.camera, "random-telegraph-noise") {
        Some(Effect::RandomTelegraphNoise(x)) => Some(f64::from(x.renewal)),
        _ => None,
    };
    match (lag, held) {
        (Some((d, m)), Some(held)) => held - (d - m),
        // A stack's own mean hides part of the memory.
        (Some((d, _)), None) => 1.0 - d - 2.0 / dof,
        (None, held) => held.unwrap_or(0.2),
    }
    .clamp(0.03, 1.0)
}

/// Mean and mean square, e⁻² and e⁻⁴, of what pixels beyond the 99.9 % point of χ² have above the median variance, over
/// all pixels.
fn variance_excess(e: &Evidence<'_>, stack: usize) -> Option<(f64, f64)> {
    let t = &e.stacks[stack];
    let k2 = e.gain(&e.design.conditions[stack]).powi(2);
    let middle = f64::from(median(&mut t.pixel_variance.clone(), f32::total_cmp));
    let white = middle / median_of_squares(t.dof);
    let limit = white * quantile_of_squares(3.1, t.dof);
    let (mut first, mut second) = (0.0, 0.0);
    for v in t.pixel_variance.iter().map(|&v| f64::from(v)).filter(|v| *v > limit) {
        first += v - white;
        // The scatter of a pixel's own variance, 2v²/(f + 2), is no spread.
        second += (v - white).powi(2) - 2.0 * v * v / (t.dof + 2.0);
    }
    let n = t.pixel_variance.len() as f64;
    // χ² itself leaves a thousandth above the limit, 1.1 times as far above white as the limit.
    let chance = 0.001 * 1.1 * (limit - white);
    let (first, second) = ((first / n - chance) / k2, second / n / (k2 * k2));
    (first > 0.0 && second > 0.0).then_some((first, second))
}

/// Kurtosis of a Tukey lambda law less 3.
fn tukey_kurtosis(l: f64) -> f64 {
    if l.abs() < 0.01 {
        return 1.2;
    }
    let g = libm::tgamma;
    // Moments of Q(u) (Joiner & Rosenblatt 1971).
    let beta = |a: f64, b: f64| g(a) * g(b) / g(a + b);
    let m2 = 2.0 / (l * l) * (1.0 / (1.0 + 2.0 * l) - beta(1.0 + l, 1.0 + l));
    let m4 = 2.0 / l.powi(4)
        * (1.0 / (1.0 + 4.0 * l) - 4.0 * beta(1.0 + 3.0 * l, 1.0 + l)
            + 3.0 * beta(1.0 + 2.0 * l, 1.0 + 2.0 * l));
    m4 / (m2 * m2) - 3.0
}

/// The λ of a kurtosis, and how fast the kurtosis falls with it there.
fn tukey_lambda(kurtosis: f64) -> (f64, f64) {
    let (mut low, mut high) = (-0.22, 0.13);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if tukey_kurtosis(middle) > kurtosis { low = middle } else { high = middle }
    }
    let lambda = 0.5 * (low + high);
    (lambda, (tukey_kurtosis(lambda - 0.005) - tukey_kurtosis(lambda + 0.005)) / 0.01)
}

/// The λ of a part of the read noise in longer tails than all of it would have, the rest being normal: so the fourth and sixth
/// cumulants of Student's t, 6/(ν−4) and 240/((ν−4)(ν−6)), are met to some per cent. Clear of 0, about which the stage keeps
/// to the logistic law, and of the rare giants of smaller λ.
const LONGER: f64 = 0.04;

/// Kurtosis of the dark residuals: read noise that follows Tukey's law altogether, or in part and in longer tails.
pub fn heavy_tails(e: &Evidence<'_>) -> Vec<Proposal> {
    let made = (|| {
        let (stack, c) = short_darks(e)
            .into_iter()
            .map(|i| (i, &e.design.conditions[i]))
            .max_by_key(|(_, c)| c.frames)?;
        let k = e.difference(Place::Stack(stack), What::Kurtosis)?;
        let v = e.variance(stack)?.0 / e.gain(c).powi(2);
        let normal = e.camera.sensor.noise.read_e;
        let held = match current(e.camera, "heavy-tailed-read-noise") {
            Some(Effect::HeavyTailedReadNoise(x)) => {
                Some((f64::from(x.sigma_e), f64::from(x.lambda)))
            }
            _ => None,
        };
        let read = held.map_or(normal, |h| h.0.hypot(normal));
        // Share of the variance, and kurtosis of all read noise.
        let share = held.map(|h| (h.0 / read).powi(2));
        let now = held.zip(share).map_or(0.0, |(h, share)| share * share * tukey_kurtosis(h.1));
        // Its kurtosis is that of the sum over its share squared.
        let dilution = (v / (read * read)).powi(2);
        let target = now + k.value * dilution;
        if target < 0.02 {
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
            let effect = HeavyTailedReadNoise { sigma_e: sigma as f32, lambda: lambda as f32 };
            let post = e.camera.sensor.noise.read_e_post.min(rest);
            let rest_of_it = ReadNoise { read_e: rest as f32, read_e_post: post as f32 };
            let p = Proposal::new("heavy-tailed-read-noise", effect.into(), k.z().abs())
                .and(rest_of_it.into())
                .with("sigma_e", sigma, f64::NAN)
                .with("lambda", lambda, k.se * dilution / (share * share) / fall);
            if share < 1.0 { p.with("read_e", rest, f64::NAN) } else { p }
        };
        Some(shares.into_iter().map(propose).collect())
    })();
    made.unwrap_or_default()
}
