//! The response curve of a camera from several exposures (P. E. Debevec, J. Malik, "Recovering
//! High Dynamic Range Radiance Maps from Photographs", SIGGRAPH 1997), per channel.
//!
//! A pixel that sees the irradiance E for a time t has the signal Z above black with
//! g(ln Z) = ln E + ln t. The curve g and all ln E are found together by least squares:
//!
//! Σ w (g(ln Z) − ln E − ln t)² + Σ (Δ²g / h²)²
//!
//! g is piecewise linear over knots h = 0.1 apart in ln Z, so that a linear response and any power
//! law have no second difference and the smoothness term does not bend them (over Z itself, as
//! first published, it pulls the dark end off); the prior is a curvature of about 1 per e-fold².
//! (It cannot be left to the likelihood: noise is in Z, so a staircase with a step between any two
//! patches would fit best.) ln E is eliminated, which leaves one banded system of the size of the
//! knots. Scale is free: the curve is set to g = ln Z at half of full scale.
//!
//! Exposure times that are all powers of one factor leave a ripple of that period undetermined but
//! for the smoothness; mixed factors (1, 2, 5, 10, ...) or steps of 2 determine it.
//!
//! Samples are means over square blocks of one channel in each exposure. Dropped are blocks with a
//! pixel above 95 % of full scale, below 0.5 % of it or 1 DN in the mean, or uneven by more than
//! 10 % (one standard deviation). w is the inverse variance of ln Z: that of the block's mean, of
//! rounding to whole DN, and 0.5 % for the repeatability of light and shutter.

use super::exposures::Series;
use camrig_base::Cfa;
use camrig_base::{Error, Plane, Result};
use camrig_linear::{Matrix, Vector, solve_positive};

/// Distance of the knots in ln Z.
const STEP: f64 = 0.1;
/// Largest usable pixel, of full scale.
pub const SATURATION: f64 = 0.95;
/// Least usable mean, of full scale.
const DARKNESS: f64 = 0.005;
/// Largest standard deviation within a block over its mean.
const UNEVENNESS: f64 = 0.1;
/// Relative standard deviation of light and shutter from one exposure to the next.
const REPEATABILITY: f64 = 0.005;
/// Blocks across a frame.
const BLOCKS: usize = 32;
/// Smallest signal from which an exposure's time is estimated, of full scale.
const BRIGHT: f64 = 0.1;
/// A mean residual of one exposure above this contradicts its time.
const CONTRADICTION: f64 = 0.05;

/// The curve of one channel.
#[derive(Clone, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Response {
    /// Letter of the channel.
    pub channel: char,
    /// Least and largest signal that the curve was fitted to, DN above black.
    pub range_dn: [f64; 2],
    /// ln Z of the first knot; the others follow at `STEP`.
    pub first_ln_dn: f64,
    /// g at the knots.
    pub g: Vec<f64>,
    /// Root mean square of the residuals, percent of signal, weighted.
    pub residual_percent: f64,
    /// Samples used (a block at an exposure).
    pub samples: usize,
}

impl Response {
    /// The signal that a linear camera of the same sensitivity at half scale would have, DN.
    /// Outside the fitted range the curve goes on with its end slopes.
    pub fn linear_dn(&self, signal_dn: f64) -> f64 {
        if signal_dn <= 0.0 {
            return signal_dn;
        }
        libm::exp(self.ln_linear(libm::log(signal_dn)))
    }

    fn ln_linear(&self, ln_dn: f64) -> f64 {
        let (knot, part) = place(ln_dn, self.first_ln_dn, self.g.len());
        self.g[knot] + part * (self.g[knot + 1] - self.g[knot])
    }

    /// Largest departure of the curve from a straight line through the origin within its range, as
    /// a fraction: half the spread of linear_dn(Z) / Z.
    pub fn departure_from_linear(&self) -> f64 {
        let [first, last] = self.range_dn.map(libm::log);
        let ratio = (0..=100).map(|i| {
            let x = first + (last - first) * f64::from(i) / 100.0;
            self.ln_linear(x) - x
        });
        let (least, most) =
            ratio.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), r| (a.min(r), b.max(r)));
        libm::expm1((most - least) / 2.0)
    }
}

/// Knot to the left and the part of the way to the next, beyond the ends outside 0..1.
fn place(x: f64, first: f64, knots: usize) -> (usize, f64) {
    let position = (x - first) / STEP;
    let knot = position.floor().clamp(0.0, knots as f64 - 2.0);
    (knot as usize, position - knot)
}

/// Largest distance of two channels' curves within their common range, as a fraction, each curve
/// shifted by a constant so that their sensitivities do not count (the paper's Fig. 2).
pub fn spread(responses: &[Response]) -> f64 {
    let first = responses.iter().map(|r| r.range_dn[0]).fold(0.0, f64::max);
    let last = responses.iter().map(|r| r.range_dn[1]).fold(f64::INFINITY, f64::min);
    if last <= first {
        return f64::NAN;
    }
    let at =
        |i: u32| libm::log(first) + (libm::log(last) - libm::log(first)) * f64::from(i) / 100.0;
    let curves: Vec<Vec<f64>> = responses
        .iter()
        .map(|r| {
            let curve: Vec<f64> = (0..=100).map(|i| r.ln_linear(at(i)) - at(i)).collect();
            let mean = curve.iter().sum::<f64>() / curve.len() as f64;
            curve.into_iter().map(|v| v - mean).collect()
        })
        .collect();
    (0..=100).fold(0.0, |most: f64, i| {
        let here = curves.iter().map(|c| c[i]);
        let (a, b) =
            here.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        most.max(libm::expm1(b - a))
    })
}

/// One block at one exposure.
struct Sample {
    exposure: usize,
    ln_dn: f64,
    ln_seconds: f64,
    weight: f64,
}

/// Counts of what was dropped, for messages.
#[derive(Default)]
struct Dropped {
    saturated: usize,
    dark: usize,
    uneven: usize,
}

/// The curve of each channel of the pattern from all series together. `full_scale_dn` is the
/// saturation level above black.
pub fn fit(series: &[Series], cfa: &Cfa, full_scale_dn: f64) -> Result<Vec<Response>> {
    let channels = cfa.channels();
    channels.iter().map(|&channel| fit_channel(series, cfa, channel, full_scale_dn)).collect()
}

fn fit_channel(
    series: &[Series],
    cfa: &Cfa,
    channel: char,
    full_scale_dn: f64,
) -> Result<Response> {
    let mut dropped = Dropped::default();
    // Per block its samples; exposures are numbered through all series.
    let mut blocks: Vec<Vec<Sample>> = Vec::new();
    let mut names = Vec::new();
    for series in series {
        let first = names.len();
        names.extend(series.exposures.iter().map(|e| e.id.clone()));
        let mut of_series: Vec<Vec<Sample>> = Vec::new();
        for (index, exposure) in series.exposures.iter().enumerate() {
            let statistics = block_statistics(&exposure.signal, cfa, channel);
            of_series.resize_with(statistics.len(), Vec::new);
            for (block, sample) in of_series.iter_mut().zip(statistics) {
                if let Some((ln_dn, weight)) = sample.usable(full_scale_dn, &mut dropped) {
                    let ln_seconds = libm::log(exposure.seconds);
                    block.push(Sample { exposure: first + index, ln_dn, ln_seconds, weight });
                }
            }
        }
        // A block seen once does not constrain the curve.
        blocks.extend(of_series.into_iter().filter(|block| block.len() > 1));
    }
    let all = || blocks.iter().flatten();
    let samples = all().count();
    if blocks.len() < 10 {
        return Err(Error::input(format!(
            "channel {channel}: only {} blocks are usable at two or more exposures",
            blocks.len()
        ))
        .at(format!(
            "{} blocks saturated, {} too dark, {} uneven",
            dropped.saturated, dropped.dark, dropped.uneven
        ))
        .help(
            "shoot even patches with exposures a factor of 2 or 3 apart, neither black nor full",
        ));
    }
    let least = all().map(|s| s.ln_dn).fold(f64::INFINITY, f64::min);
    let most = all().map(|s| s.ln_dn).fold(f64::NEG_INFINITY, f64::max);
    let knots = ((most - least) / STEP).ceil() as usize + 2;
    let g = monotonic(solve(&blocks, least, knots, libm::log(full_scale_dn / 2.0))?);

    let mut response = Response {
        channel,
        range_dn: [libm::exp(least), libm::exp(most)],
        first_ln_dn: least,
        g,
        residual_percent: 0.0,
        samples,
    };
    let (mut square, mut weights) = (0.0, 0.0);
    let mut of_exposure = vec![(0.0, 0.0); names.len()];
    for block in &blocks {
        let sum: f64 = block.iter().map(|s| s.weight).sum();
        let value = |s: &Sample| response.ln_linear(s.ln_dn) - s.ln_seconds;
        let mean = block.iter().map(|s| s.weight * value(s)).sum::<f64>() / sum;
        for s in block {
            let residual = value(s) - mean;
            square += s.weight * residual * residual;
            weights += s.weight;
            // Near black, offsets of a few tenths of a DN weigh more than any shutter.
            if libm::exp(s.ln_dn) > BRIGHT * full_scale_dn {
                of_exposure[s.exposure].0 += s.weight * residual;
                of_exposure[s.exposure].1 += s.weight;
            }
        }
    }
    response.residual_percent = 100.0 * (square / weights).sqrt();
    let of_exposure = names.iter().zip(of_exposure).filter(|(_, (_, weight))| *weight > 0.0);
    let means = of_exposure.map(|(name, (sum, weight))| (name, sum / weight));
    if let Some((name, mean)) = means.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        && mean.abs() > CONTRADICTION
    {
        let factor = libm::exp(mean);
        return Err(Error::disagreement(format!(
            "channel {channel}: capture {name:?} has {factor:.2} times the light that its \
             exposure time and the other captures say"
        ))
        .help("correct its exposure_s, or leave it out: the light or the shutter changed"));
    }
    Ok(response)
}

/// Mean, variance, largest pixel and count of a block.
struct Block {
    mean: f64,
    variance: f64,
    most: f64,
    count: f64,
}

impl Block {
    /// ln of the mean and its weight, where the block is usable.
    fn usable(&self, full_scale_dn: f64, dropped: &mut Dropped) -> Option<(f64, f64)> {
        if self.most > SATURATION * full_scale_dn {
            dropped.saturated += 1;
            return None;
        }
        if self.mean < (DARKNESS * full_scale_dn).max(1.0) {
            dropped.dark += 1;
            return None;
        }
        // Rounding to whole DN spreads the pixels of an even block too.
        if self.variance > (UNEVENNESS * self.mean).powi(2) + 1.0 / 12.0 {
            dropped.uneven += 1;
            return None;
        }
        let of_mean = self.variance / self.count + 1.0 / 12.0;
        let weight = 1.0 / (of_mean / (self.mean * self.mean) + REPEATABILITY * REPEATABILITY);
        Some((libm::log(self.mean), weight))
    }
}

fn block_statistics(signal: &Plane<f32>, cfa: &Cfa, channel: char) -> Vec<Block> {
    // Whole cells of the pattern, at least two of them a side.
    let cell = cfa.width.max(cfa.height);
    let edge = (signal.width / BLOCKS / cell).max(2) * cell;
    let mut blocks = Vec::new();
    for top in (0..signal.height / edge).map(|i| i * edge) {
        for left in (0..signal.width / edge).map(|i| i * edge) {
            let (mut sum, mut square, mut most, mut count) = (0.0, 0.0, 0.0f64, 0.0);
            for y in top..top + edge {
                for x in (left..left + edge).filter(|&x| cfa.letter(x, y) == channel) {
                    let value = f64::from(signal.at(x, y));
                    sum += value;
                    square += value * value;
                    most = most.max(value);
                    count += 1.0;
                }
            }
            let mean = sum / count;
            let variance = ((square - sum * mean) / (count - 1.0f64).max(1.0)).max(0.0);
            blocks.push(Block { mean, variance, most, count });
        }
    }
    blocks
}

/// Solves for the knots with ln E of every block eliminated, g = `anchor` at ln Z = `anchor`.
fn solve(blocks: &[Vec<Sample>], first: f64, knots: usize, anchor: f64) -> Result<Vec<f64>> {
    let mut normal = Matrix::zeros(knots, knots);
    let mut right = Vector::zeros(knots);
    for block in blocks {
        let sum: f64 = block.iter().map(|s| s.weight).sum();
        let mean_time = block.iter().map(|s| s.weight * s.ln_seconds).sum::<f64>() / sum;
        let mut mean_row = vec![0.0; knots];
        for s in block {
            for (knot, part) in row(s.ln_dn, first, knots) {
                mean_row[knot] += s.weight * part / sum;
            }
        }
        let used: Vec<usize> = (0..knots).filter(|&k| mean_row[k] != 0.0).collect();
        for s in block {
            let mut own = vec![0.0; knots];
            for (knot, part) in row(s.ln_dn, first, knots) {
                own[knot] += part;
            }
            let time = s.ln_seconds - mean_time;
            for &i in &used {
                let a = own[i] - mean_row[i];
                right[i] += s.weight * a * time;
                for &j in &used {
                    normal[(i, j)] += s.weight * a * (own[j] - mean_row[j]);
                }
            }
        }
    }
    let smooth = 1.0 / (STEP * STEP * STEP * STEP);
    for middle in 1..knots - 1 {
        let terms = [(middle - 1, 1.0), (middle, -2.0), (middle + 1, 1.0)];
        for (i, a) in terms {
            for (j, b) in terms {
                normal[(i, j)] += smooth * a * b;
            }
        }
    }
    // The scale: one more equation, as heavy as all others together.
    let heavy = normal.diagonal().sum();
    let terms = row(anchor, first, knots);
    for (i, a) in terms {
        right[i] += heavy * a * anchor;
        for (j, b) in terms {
            normal[(i, j)] += heavy * a * b;
        }
    }
    let solved = solve_positive(normal, &right).ok_or_else(|| {
        Error::input("the exposures do not determine a response curve")
            .help("add exposures so that neighbouring ones share part of their range of signals")
    })?;
    Ok(solved.iter().copied().collect())
}

/// The two knots about ln Z with their weights.
fn row(ln_dn: f64, first: f64, knots: usize) -> [(usize, f64); 2] {
    let (knot, part) = place(ln_dn, first, knots);
    [(knot, 1.0 - part), (knot + 1, part)]
}

/// The nearest rising curve: neighbours out of order are pooled, and every step rises a little, so
/// that the curve can be inverted.
fn monotonic(g: Vec<f64>) -> Vec<f64> {
    const MIN_SLOPE: f64 = 0.01;
    let tilt = |k: usize| k as f64 * MIN_SLOPE * STEP;
    let mut pools: Vec<(f64, usize)> = Vec::new();
    for (k, value) in g.into_iter().enumerate() {
        pools.push((value - tilt(k), 1));
        while let [.., (a, n), (b, m)] = pools[..]
            && a > b
        {
            pools.truncate(pools.len() - 2);
            pools.push(((a * n as f64 + b * m as f64) / (n + m) as f64, n + m));
        }
    }
    let flat = pools.into_iter().flat_map(|(value, count)| std::iter::repeat_n(value, count));
    flat.enumerate().map(|(k, value)| value + tilt(k)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::exposures::{Exposure, Series};
    use super::*;

    fn series(times: &[f64], real: &[f64], respond: impl Fn(f64) -> f64) -> Series {
        // 8 x 8 patches with a range of 1000, in counts of a 12-bit camera at 1 s.
        let light =
            |x: usize, y: usize| 4.0 * 1000f64.powf(((x / 20) + 8 * (y / 20)) as f64 / 63.0);
        let exposures =
            times.iter().zip(real).enumerate().map(|(i, (&seconds, &real))| Exposure {
                id: format!("e{i}"),
                seconds,
                frames: 1,
                signal: Plane::from_fn(160, 160, |x, y| {
                    (respond(light(x, y) * real).min(4095.0)).round() as f32
                }),
            });
        Series { name: "test".into(), exposures: exposures.collect() }
    }

    const TIMES: [f64; 8] = [0.5, 1.0, 2.5, 5.0, 10.0, 25.0, 50.0, 100.0];

    /// Curves of cameras in closed form: linear, a power law, and one that bends near saturation.
    /// The relation recovered from exposures alone is the inverse, up to scale, within 1 %.
    #[test]
    fn known_curves_are_recovered() {
        let mono = Cfa::parse("mono").unwrap();
        type Curve = (&'static str, fn(f64) -> f64, fn(f64) -> f64);
        let curves: [Curve; 3] = [
            ("linear", |e| e, |z| z),
            ("power", |e| 16.0 * e.powf(0.75), |z| (z / 16.0).powf(1.0 / 0.75)),
            (
                "bent",
                |e| 5000.0 * (1.0 - (-e / 5000.0).exp()),
                |z| -5000.0 * (1.0 - z / 5000.0).ln(),
            ),
        ];
        for (name, respond, invert) in curves {
            let series = [series(&TIMES, &TIMES, respond)];
            let response = &fit(&series, &mono, 4095.0).unwrap()[0];
            let scale = 2047.5 / invert(2047.5);
            for signal in [30.0, 100.0, 400.0, 1500.0, 3000.0, 3800.0] {
                let (got, expected) = (response.linear_dn(signal), invert(signal) * scale);
                assert!((got / expected - 1.0).abs() < 0.01, "{name} {signal}: {got} {expected}");
            }
            assert!(response.residual_percent < 1.0, "{name}: {}", response.residual_percent);
            // Even patches of 20 DN are rounded by up to 2.5 %; averaged over the curve, 1 %.
            let straight = response.departure_from_linear() < 0.02;
            assert_eq!(straight, name == "linear", "{name} {}", response.departure_from_linear());
        }
    }

    #[test]
    fn a_wrong_exposure_time_is_named() {
        let mono = Cfa::parse("mono").unwrap();
        let mut real = TIMES;
        real[3] = 7.0;
        let message =
            fit(&[series(&TIMES, &real, |e| e)], &mono, 4095.0).err().unwrap().to_string();
        assert!(message.contains("\"e3\""), "{message}");
    }

    #[test]
    fn saturated_series_are_refused_with_the_reason() {
        let mono = Cfa::parse("mono").unwrap();
        let times = [1e5, 2e5];
        let message =
            fit(&[series(&times, &times, |e| e)], &mono, 4095.0).err().unwrap().to_string();
        assert!(message.contains("saturated"), "{message}");
    }

    #[test]
    fn pooling_makes_a_rising_curve() {
        let g = monotonic(vec![0.0, 1.0, 0.5, 2.0, 1.9, 1.8, 3.0]);
        assert!(g.windows(2).all(|w| w[1] > w[0]));
        assert!((g[1] - 0.75).abs() < 0.01 && (g[4] - 1.9).abs() < 0.01);
    }

    /// A real 8-bit camera: dots seen through seven filters at seven exposures. Its true response
    /// is not known, so what is held is that its exposures fit one rising curve per channel, to
    /// the 2 % by which the set's exposure times themselves agree.
    #[test]
    fn a_real_camera() {
        let Some(path) = camrig_testing::shared("data/captures/bllanos_narrowband_7x7") else {
            return;
        };
        let set = camrig_captures::CaptureSet::load(&path).unwrap();
        let series = super::super::exposures::read(&set, &[]).unwrap();
        assert_eq!(series.len(), 14);
        let dots: Vec<Series> =
            series.into_iter().filter(|s| s.name.starts_with("dots")).collect();
        let responses = fit(&dots, &Cfa::parse("GBRG").unwrap(), 255.0).unwrap();
        for r in &responses {
            println!("{}: {} samples, residual {:.2} %", r.channel, r.samples, r.residual_percent);
            assert!(r.residual_percent < 2.0);
            let curve: Vec<f64> = (10..=250).map(|dn| r.linear_dn(f64::from(dn))).collect();
            assert!(curve.windows(2).all(|w| w[1] > w[0]), "{} falls", r.channel);
        }
        println!("curves apart by {:.1} %", 100.0 * spread(&responses));
    }
}
