//! The distribution of the dark current over pixels: log-normal, as in many sensors, compared with
//! the catalogue's, a normal distribution plus hot pixels with an exponential one.
//!
//! Both are fitted to the histogram of the dark-current map by maximum likelihood, convolved with
//! the temporal noise of a pixel of each rate.

use super::seen::Seen;
use super::stage;
use super::view::View;
use super::{FALSE_ALARMS, Shape, shapes};
use crate::data::design::Design;
use crate::finding::{Finding, number};
use crate::numerics::minimise::lowest;
use crate::report::{Domain, Form};
use crate::statistics::maps::{self, MapKind};
use crate::statistics::statistic::{Key, Place};
use crate::statistics::temporal::{Temporal, mean};
use camrig_base::Value;
use camrig_camera::Camera;
use camrig_camera::empirical::{Empirical, Law, Table};
use camrig_captures::Role;
use std::f64::consts::SQRT_2;

/// Bins of the map's values.
const BINS: usize = 60;
/// Fraction of the pixels above the last bin.
const ABOVE_BINS: f64 = 0.002;
/// Nodes at which a distribution is sampled.
const NODES: usize = 61;
/// The outermost nodes, standard deviations.
const OUTERMOST: f64 = 4.5;
/// Range of the logarithm's standard deviation: below it the distribution is nearly normal.
const SPREADS: [f64; 2] = [0.05, 1.8];
/// Rounds in which the four parameters of the catalogue's distribution are fitted, two at a time.
const ROUNDS: usize = 3;
/// Standard errors up to which the correlation of neighbours is not significant: the border's
/// pixels are copies of their neighbours, which makes two standard errors of it.
const MAX_CORRELATION_Z: f64 = 6.0;
/// Correlation of neighbours that does not affect the distribution, significant or not.
const MAX_CORRELATION: f64 = 0.05;
/// Range of the natural logarithm of the fraction of hot pixels.
const LN_HOT: [f64; 2] = [-9.0, -0.7];

/// A log-normal distribution of the dark current.
pub(crate) struct DarkLaw {
    mean: Value,
    spread: Value,
    sd: Value,
    shortest_s: f64,
    evidence: [f64; 2],
}

/// The distribution that both halves show.
pub(crate) fn find(fit: &View<'_>, held_out: &View<'_>) -> Vec<Box<dyn Shape>> {
    shapes(law(fit, held_out))
}

/// A histogram of a map's values, and the noise of a value.
struct Histogram {
    edges: Vec<f64>,
    counts: Vec<f64>,
    pixels: f64,
    mean: f64,
    /// Variance of a pixel without dark current, and the increase per e⁻/s of it.
    noise: (f64, f64),
}

impl Histogram {
    fn new(view: &View<'_>, edges: Option<Vec<f64>>) -> Option<Self> {
        let plane = view.plane(MapKind::DarkCurrent)?;
        let (short, long) = (maps::reference_dark(view.design)?, maps::long_dark(view.design)?);
        let mut values: Vec<f64> = plane.data.iter().map(|&v| f64::from(v)).collect();
        values.sort_by(f64::total_cmp);
        let edges = edges.unwrap_or_else(|| {
            let top = values[((1.0 - ABOVE_BINS) * (values.len() - 1) as f64) as usize];
            let low = values[0];
            (0..=BINS).map(|i| low + (top - low) * i as f64 / BINS as f64).collect()
        });
        let mut counts = vec![0.0; BINS + 2];
        for v in &values {
            counts[edges.partition_point(|e| e <= v)] += 1.0;
        }
        let pixels = values.len() as f64;
        let mean_rate = values.iter().sum::<f64>() / pixels;
        let [a, b] = [short, long].map(|i| {
            let t = &view.stacks[i];
            let unit = view.gain(i).powi(2) * t.frames as f64;
            (mean(&t.pixel_variance) / unit, view.design.conditions[i].stack.exposure_s, t.frames)
        });
        let longer = b.1 - a.1;
        let shot = (a.1 / a.2 as f64 + b.1 / b.2 as f64) / (longer * longer);
        // The stacks' variance includes the shot noise of the mean rate.
        let all = (a.0 + b.0) / (longer * longer);
        let noise = ((all - shot * mean_rate).max(0.1 * all), shot);
        (mean_rate > 0.0).then_some(Self { edges, counts, pixels, mean: mean_rate, noise })
    }

    /// Twice the negative log-likelihood of a distribution, given as rates with their weights.
    fn cost(&self, law: &[(f64, f64)]) -> f64 {
        let mut shares = vec![1e-12; self.counts.len()];
        for &(rate, share) in law {
            let sd = (self.noise.0 + self.noise.1 * rate.max(0.0)).sqrt();
            let mut below = 0.0;
            for (i, edge) in self.edges.iter().enumerate() {
                let up_to = 0.5 * libm::erfc(-(edge - rate) / (SQRT_2 * sd));
                shares[i] += share * (up_to - below);
                below = up_to;
            }
            shares[self.edges.len()] += share * (1.0 - below);
        }
        let of = self.counts.iter().zip(&shares).filter(|(n, _)| **n > 0.0);
        of.map(|(n, s)| -2.0 * n * libm::log(s.max(1e-300))).sum()
    }
}

/// Normal deviates with their weights.
fn nodes() -> Vec<(f64, f64)> {
    let step = 2.0 * OUTERMOST / (NODES - 1) as f64;
    let z = (0..NODES).map(|i| -OUTERMOST + step * i as f64);
    let all: Vec<(f64, f64)> = z.map(|z| (z, libm::exp(-z * z / 2.0))).collect();
    let sum: f64 = all.iter().map(|n| n.1).sum();
    all.into_iter().map(|(z, w)| (z, w / sum)).collect()
}

/// A log-normal distribution with a mean and a standard deviation of the logarithm.
fn log_normal(nodes: &[(f64, f64)], ln_mean: f64, spread: f64) -> Vec<(f64, f64)> {
    let middle = ln_mean - spread * spread / 2.0;
    nodes.iter().map(|(z, w)| (libm::exp(middle + spread * z), *w)).collect()
}

/// A normal distribution, and a fraction of pixels with an exponential excess.
fn with_hot(nodes: &[(f64, f64)], [m, s, ln_share, ln_hot]: [f64; 4]) -> Vec<(f64, f64)> {
    let share = libm::exp(ln_share);
    let cold = nodes.iter().map(|(z, w)| (m + s * z, w * (1.0 - share)));
    let count = NODES / 2;
    let quantile = move |i: usize| -libm::log(1.0 - (i as f64 + 0.5) / count as f64);
    let hot = (0..count).map(move |i| (m + libm::exp(ln_hot) * quantile(i), share / count as f64));
    cold.chain(hot).collect()
}

/// Whether neighbours in the dark-current map are uncorrelated: a glow also has a distribution over
/// pixels, but a spatial structure.
fn is_white(view: &View<'_>) -> bool {
    let Some(plane) = view.plane(MapKind::DarkCurrent) else { return false };
    let (w, map) = (plane.width, view.levelled(plane).data);
    let power: f64 = map.iter().map(|&v| f64::from(v).powi(2)).sum();
    let pairs = |apart: usize| map.iter().zip(&map[apart.min(map.len())..]);
    let products = |apart| pairs(apart).map(|(a, b)| f64::from(a * b)).sum::<f64>();
    let least = power * (MAX_CORRELATION_Z / (map.len() as f64).sqrt()).max(MAX_CORRELATION);
    [1, w].into_iter().all(|apart| products(apart).abs() < least)
}

fn law(fit: &View<'_>, held_out: &View<'_>) -> Option<DarkLaw> {
    if !is_white(fit) {
        return None;
    }
    let a = Histogram::new(fit, None)?;
    let b = Histogram::new(held_out, Some(a.edges.clone()))?;
    let nodes = nodes();
    let around = libm::log(a.mean);
    let of = |h: &Histogram, m: f64, s: f64| h.cost(&log_normal(&nodes, m, s));
    let (m, s) = lowest(|m, s| of(&a, m, s), [around - 0.7, around + 0.7], SPREADS);
    // The catalogue's distribution, two parameters at a time.
    let width = a.mean * s.min(1.0);
    let mut rival = [a.mean, width, -4.0, libm::log(a.mean) + 1.0];
    for _ in 0..ROUNDS {
        let hot = (rival[2], rival[3]);
        let (x, y) = lowest(
            |m, s| a.cost(&with_hot(&nodes, [m, s, hot.0, hot.1])),
            [0.0, 2.0 * a.mean],
            [1e-3 * a.mean, 3.0 * a.mean],
        );
        let (p, q) = lowest(
            |p, q| a.cost(&with_hot(&nodes, [x, y, p, q])),
            LN_HOT,
            [around - 2.0, around + 4.0],
        );
        rival = [x, y, p, q];
    }
    // Two parameters fewer: ln n for each (Schwarz 1978).
    let fewer = 2.0 * libm::log(a.pixels);
    let evidence = [
        a.cost(&with_hot(&nodes, rival)) - of(&a, m, s) + fewer,
        b.cost(&with_hot(&nodes, rival)) - of(&b, m, s),
    ];
    // A normal distribution is the limit of a narrow log-normal: near it the two look the same.
    if evidence[0] < fewer - 2.0 * libm::log(FALSE_ALARMS)
        || evidence[1] < 0.0
        || s < 2.0 * SPREADS[0]
    {
        return None;
    }
    let mean = libm::exp(m);
    let ratio = (libm::exp(s * s) - 1.0).sqrt();
    let spread_se = s / (2.0 * a.pixels).sqrt();
    let sd = mean * ratio;
    // d(sd)/ds at a known mean: mean e^(s²) s/ratio.
    let by_spread = mean * libm::exp(s * s) * s / ratio;
    let mean_se = (sd * sd + a.noise.0).sqrt() / a.pixels.sqrt();
    Some(DarkLaw {
        mean: Value { value: mean, std_error: mean_se },
        spread: Value { value: s, std_error: spread_se },
        sd: Value { value: sd, std_error: libm::hypot(by_spread * spread_se, ratio * mean_se) },
        shortest_s: stage::shortest_s(fit.design),
        evidence,
    })
}

impl Shape for DarkLaw {
    fn subtract(&self, _: &Camera, _: &Design, _: &mut [Temporal]) {}

    fn shows_in(&self, design: &Design, (place, what): &Key) -> bool {
        match place {
            Place::Map(MapKind::DarkCurrent) => true,
            // Pixels with more dark charge have more shot noise.
            Place::Stack(i) => {
                let stack = &design.conditions[*i].stack;
                let longer = stack.role == Role::Dark && stack.exposure_s > self.shortest_s;
                longer && what.is_of_single_pixels()
            }
            _ => false,
        }
    }

    fn stages(&self, camera: &mut Camera, design: &Design) -> Vec<Empirical> {
        // The stage has all of the dark current.
        camera.sensor.noise.dark_current_e_per_s = 0.0;
        camera.sensor.noise.dsnu_e_per_s = 0.0;
        let spread = self.spread.value;
        let quantile = |z: &f64| libm::exp(spread * z - spread * spread / 2.0);
        let deviates: Vec<f64> = nodes().into_iter().map(|(z, _)| z).collect();
        let values = deviates.iter().map(quantile).collect();
        let law = Table::Distribution(Law { deviates, values });
        vec![stage::dark(camera, design, law, self.mean.value)]
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        let values = view.plane(MapKind::DarkCurrent)?.data.iter().map(|&v| f64::from(v));
        Some(Seen::quantiles("dark current, e⁻/s", values.collect()))
    }

    fn findings(&self) -> Vec<Finding> {
        vec![Finding {
            parameters: vec![
                ("ln_spread", self.spread),
                ("mean_e_per_s", self.mean),
                ("sd_e_per_s", self.sd),
            ],
            description: format!(
                "dark current that is log-normal over pixels: mean {} e⁻/s, standard deviation {} \
                 e⁻/s, standard deviation of its logarithm {}",
                number(self.mean),
                number(self.sd),
                number(self.spread),
            ),
            ..Finding::new(Domain::Dark, Form::Distribution, self.evidence)
        }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::bench::{HEIGHT, Hidden, Shot, WIDTH, figure, shoot};
    use rand_distr::{Distribution, Normal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    #[test]
    fn a_log_normal_law_is_told_from_hot_pixels_and_from_a_glow() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(41);
        let normal = Normal::new(0.0, 1.0).unwrap();
        let z: Vec<f64> = (0..WIDTH * HEIGHT).map(|_| normal.sample(&mut rng)).collect();
        let add = |e: &mut [f64], shot: &Shot<'_>, rate: &dyn Fn(usize) -> f64| {
            e.iter_mut().enumerate().for_each(|(i, v)| *v += rate(i) * shot.exposure_s);
        };
        // Mean 12 e⁻/s, that of the bench, spread 0.7.
        let law = |i: usize| 12.0 * ((0.7 * z[i] - 0.245).exp() - 1.0);
        let hot = |i: usize| if i.is_multiple_of(97) { 200.0 } else { 0.0 };
        let glow = |i: usize| 60.0 * (-((i % WIDTH) as f64) / 6.0).exp();
        let of = |rate: &dyn Fn(usize) -> f64| {
            let charge = |e: &mut [f64], shot: &mut Shot<'_>| add(e, shot, rate);
            let bench = shoot(42, &Hidden { charge: Some(&charge), ..Hidden::default() });
            let found = find(&bench.view(0), &bench.view(1));
            found.iter().flat_map(|s| s.findings()).collect::<Vec<Finding>>()
        };
        let findings = of(&law);
        let [found] = &findings[..] else { panic!("{findings:?}") };
        // Three errors of 4032 pixels: 8.9 e⁻/s over √4032, and 0.7/√8064.
        assert!((figure(found, "mean_e_per_s") - 12.0).abs() < 0.5, "{found:?}");
        assert!((figure(found, "ln_spread") - 0.7).abs() < 0.03, "{found:?}");
        assert!(of(&hot).is_empty() && of(&glow).is_empty() && of(&|_| 0.0).is_empty());
    }
}
