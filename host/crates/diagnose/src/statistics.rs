//! The battery: every statistic of a set of stacks, with the scatter that theory gives it.
//!
//! A statistic keeps its value in its own unit, so that values of replicates can be averaged and estimates be
//! made of them; [`Scale`] says on which scale its scatter is normal. Standard deviations are those of the sampling
//! laws (χ² for variances, binomial for counts), not of replicates, so they hold for a single set.

use super::channels::Channels;
use super::design::{Condition, Design};
use super::looks::Figure;
use super::maps::{self, MapKind};
use super::ratios;
use super::shading;
use super::spatial::{PERIODS, Spatial, aperiodic, basis};
use super::spectrum::Background;
use super::tails;
use super::temporal::{LAGS, Temporal, mean};
use camrig_base::median::median;
use camrig_camera::Camera;
use camrig_captures::Role;

/// Where a statistic was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// A stack: its position in the design.
    Stack(usize),
    /// A stack of an edge, dots or a chart: its position among them.
    Look(usize),
    /// A map made of several stacks.
    Map(MapKind),
    /// All stacks together.
    Set,
}

/// What was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[allow(missing_docs)]
pub enum What {
    Mean(u8),
    Ratio(u8),
    Variance(u8),
    FrameVariance,
    FrameTrend,
    FrameLag,
    RowVariance,
    RowLag,
    RowSlow,
    RowPeak,
    ColumnVariance,
    ColumnSlow,
    ColumnPeak,
    Covariance(u8),
    BlockVariance,
    PlanePeak,
    Spread,
    NoisyPixels,
    NoiseSlope(u8),
    NoiseBlocks,
    Skewness,
    Kurtosis,
    TopKurtosis,
    TimeLag,
    TopTimeLag,
    Zeros,
    Saturated,
    Codes(u8),
    Roughness,
    MissingCodes,
    Slope(u8),
    RowPattern,
    RowPatternPeak,
    ColumnPattern,
    ColumnPatternPeak,
    ColumnPeriod(u8),
    RowPeriod(u8),
    PixelPattern,
    Tails,
    High,
    Low,
    MapCovariance(u8),
    MapBlocks,
    FineBlocks,
    Corner(u8),
    EveryOtherRow,
    EveryOtherColumn,
    Checkerboard,
    FallOff(u8),
    FallOffApart(u8),
    Lattice,
    AfterImage,
    Of(Figure),
}

/// The scale on which a statistic's scatter is normal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Its own.
    Linear,
    /// Its logarithm.
    Log,
    /// Its cube root (means of squares with few degrees of freedom).
    CubeRoot,
    /// A count of rare things.
    Count,
}

impl What {
    /// Whether a measured value may be uncertain by more than the model's replicates are: where one pixel of a patch that
    /// stands out is luck, which the kurtosis of the patch tells.
    pub fn tells_its_scatter(self) -> bool {
        matches!(self, Self::Of(Figure::PatchScatter(_)))
    }
}

/// One statistic.
#[derive(Clone, Copy, Debug)]
pub struct Statistic {
    /// Where.
    pub place: Place,
    /// What.
    pub what: What,
    /// Its value.
    pub value: f64,
    /// Standard deviation on its scale; of counts not used.
    pub sd: f64,
    /// Its scale.
    pub scale: Scale,
}

impl Scale {
    /// A value on this scale.
    pub fn of(self, value: f64) -> f64 {
        match self {
            Scale::Linear | Scale::Count => value,
            Scale::Log => value.max(1e-12).ln(),
            Scale::CubeRoot => value.max(0.0).cbrt(),
        }
    }
}

/// Frequencies (cycles per code) at which the converter's steps are looked for, and their names.
pub const CODE_PERIODS: [(f64, &str); 5] =
    [(0.5, "2"), (0.25, "4"), (0.125, "8"), (0.375, "8/3"), (0.0625, "16")];

/// The statistics of a set of stacks.
pub fn battery(camera: &Camera, design: &Design, stacks: &[Temporal]) -> Vec<Statistic> {
    let channels = Channels::new(camera);
    let mut out = Vec::new();
    let reference = maps::reference_dark(design);
    let summaries: Vec<_> = stacks.iter().map(|t| Summary::new(t, &channels)).collect();
    for (i, (t, c)) in stacks.iter().zip(&design.conditions).enumerate() {
        let mut add = |what, value: f64, sd: f64, scale| {
            if value.is_finite() && sd.is_finite() {
                out.push(Statistic { place: Place::Stack(i), what, value, sd, scale });
            }
        };
        means(t, c, i, reference, stacks, &channels, &mut add);
        temporal(t, c, &summaries[i], &mut add);
    }
    out.extend(ratios::ratios(design, stacks, reference, &channels));
    codes(stacks, &summaries, &mut out);
    for map in maps::maps(camera, design, stacks) {
        spatial(&map, &mut out);
        if map.kind == maps::MapKind::Gain {
            out.extend(shading::falls(&map, &channels));
        }
    }
    out
}

/// Per channel: pixels, mean variance, mean third and fourth moments.
struct Summary {
    variance: Vec<f64>,
    mean_variance: f64,
    skewness: f64,
    kurtosis: f64,
    /// Half the width in codes of the middle 68 % of the samples, over pixels and time: what outliers do not widen.
    width: f64,
}

impl Summary {
    fn new(t: &Temporal, channels: &Channels) -> Self {
        let variance = channels.means(&t.pixel_variance);
        let (third, fourth) = (channels.means(&t.pixel_third), channels.means(&t.pixel_fourth));
        let k = channels.count() as f64;
        // Moments over n residuals of their own mean are (n − 1)/n of what a free mean would give.
        let n = t.dof.max(1.0);
        let shrink = n / (n + 1.0);
        let over = |m: &[f64], power: f64| {
            m.iter().zip(&variance).map(|(m, v)| m / v.max(1e-9).powf(power)).sum::<f64>() / k
        };
        let kurtosis = over(&fourth, 2.0) - 3.0 * shrink;
        let mean_variance = variance.iter().sum::<f64>() / k;
        Self {
            skewness: over(&third, 1.5),
            kurtosis,
            width: half_width(&t.histogram),
            mean_variance,
            variance,
        }
    }
}

/// Half of the distance between the quantiles of a histogram that are one standard deviation of a normal law from its mean.
fn half_width(histogram: &[u32]) -> f64 {
    let total: f64 = histogram.iter().map(|&n| f64::from(n)).sum();
    let quantile = |share: f64| {
        let mut left = share * total;
        for (code, &n) in histogram.iter().enumerate() {
            let n = f64::from(n);
            if left <= n && n > 0.0 {
                return code as f64 + left / n;
            }
            left -= n;
        }
        histogram.len() as f64
    };
    (quantile(0.841_344_746) - quantile(0.158_655_254)) / 2.0
}

/// Variance of the frames' means about their mean.
fn frame_variance(t: &Temporal) -> f64 {
    let m = t.frame_means.iter().sum::<f64>() / t.frames as f64;
    t.frame_means.iter().map(|f| (f - m).powi(2)).sum::<f64>() / (t.frames as f64 - 1.0)
}

/// Standard deviation of the cube root of a mean of squares with `dof` degrees of freedom (Wilson & Hilferty 1931).
fn spread_of_squares(value: f64, dof: f64) -> f64 {
    value.max(0.0).cbrt() * (2.0 / (9.0 * dof)).sqrt()
}

/// Variance of lines from the differences of those two apart, of the same filters, in which smooth structure counts little
/// (von Neumann 1941).
fn rough_variance(lines: &[f64]) -> f64 {
    let squares = lines.windows(3).map(|w| (w[2] - w[0]).powi(2)).sum::<f64>();
    squares / (2.0 * lines.len().saturating_sub(2).max(1) as f64)
}

/// Mean per channel: absolute for the reference dark stack, relative to it for all others, so that the mean of the
/// offset pattern, which is another on each sensor, counts once.
fn means(
    t: &Temporal,
    c: &Condition,
    i: usize,
    reference: Option<usize>,
    stacks: &[Temporal],
    channels: &Channels,
    add: &mut impl FnMut(What, f64, f64, Scale),
) {
    let against = reference.filter(|&r| r != i).map(|r| &stacks[r]);
    let difference: Vec<f32> = match against {
        Some(r) => t.mean.data.iter().zip(&r.mean.data).map(|(a, b)| a - b).collect(),
        None => t.mean.data.clone(),
    };
    let (w, h) = (t.width, t.height);
    let frames = |t: &Temporal| frame_variance(t) / t.frames as f64;
    let mut variance = frames(t) + against.map_or(0.0, frames);
    let by_channel = channels.means(&difference);
    let mut left = difference;
    channels.change(&mut left, &by_channel, |v, mean| v - mean);
    let rows: Vec<f64> = left.chunks(w).map(mean).collect();
    let mut columns = vec![0.0f64; w];
    for row in left.chunks(w) {
        columns.iter_mut().zip(row).for_each(|(c, &v)| *c += f64::from(v) / h as f64);
    }
    variance += rough_variance(&rows) / h as f64 + rough_variance(&columns) / w as f64;
    let share = channels.count() as f64 / left.len() as f64;
    left.iter_mut().for_each(|v| *v *= *v);
    let squares = channels.means(&left);
    for (channel, (value, square)) in by_channel.iter().zip(squares).enumerate() {
        let sd = (variance + square * share).sqrt();
        if c.role == Role::Dark || c.level_known {
            add(What::Mean(channel as u8), *value, sd, Scale::Linear);
        }
    }
}

fn temporal(t: &Temporal, c: &Condition, s: &Summary, add: &mut impl FnMut(What, f64, f64, Scale)) {
    let (w, h) = (t.width as f64, t.height as f64);
    let (n, f) = (w * h, t.dof);
    // A stack at saturation has no noise to speak of.
    let top = t.histogram.len() - 1;
    let saturated = f64::from(t.histogram[top]) / (n * t.frames as f64);
    let zeros = f64::from(t.histogram[0]) / (n * t.frames as f64);
    let fraction = |p: f64| (p.max(1e-7) * (1.0 - p.min(0.5)) / (n * f)).sqrt() + 1e-6;
    add(What::Zeros, zeros, fraction(zeros), Scale::Linear);
    add(What::Saturated, saturated, fraction(saturated), Scale::Linear);
    if saturated > 0.5 || s.mean_variance < 1e-3 {
        return;
    }
    let k = s.variance.len() as f64;
    let excess = 1.0 + s.kurtosis.max(0.0) / 2.0;
    for (class, &v) in s.variance.iter().enumerate() {
        add(What::Variance(class as u8), v, (2.0 * k * excess / (f * n)).sqrt(), Scale::Log);
    }
    let v = s.mean_variance;
    let frames = t.frames as f64;
    let df = frames - 1.0;
    add(What::FrameVariance, frame_variance(t) * n / v, (2.0 / (9.0 * df)).sqrt(), Scale::CubeRoot);
    if t.frames >= 6 {
        // In standard deviations of the frames themselves: trend and memory, whatever their size.
        let m = t.frame_means.iter().sum::<f64>() / frames;
        let sd = frame_variance(t).sqrt().max(1e-12);
        let d: Vec<f64> = t.frame_means.iter().map(|f| (f - m) / sd).collect();
        let middle = (frames - 1.0) / 2.0;
        let power: f64 = (0..t.frames).map(|i| (i as f64 - middle).powi(2)).sum();
        let slope: f64 = d.iter().enumerate().map(|(i, d)| d * (i as f64 - middle)).sum::<f64>();
        add(What::FrameTrend, slope / power.sqrt(), 1.0, Scale::Linear);
        let lag = d.windows(2).map(|p| p[0] * p[1]).sum::<f64>() / df;
        add(What::FrameLag, lag, 1.0 / df.sqrt(), Scale::Linear);
    }
    lines(t.row_power.as_slice(), f, w, v, add, [What::RowVariance, What::RowSlow, What::RowPeak]);
    let row_variance = t.row_power.iter().sum::<f64>() / t.row_power.len() as f64;
    add(What::RowLag, t.row_lag / row_variance.max(1e-12), 1.0 / (f * h).sqrt(), Scale::Linear);
    lines(
        t.column_power.as_slice(),
        f,
        h,
        v,
        add,
        [What::ColumnVariance, What::ColumnSlow, What::ColumnPeak],
    );
    // The products of pixels two apart, whose channels differ in variance, scatter by Σ v²/n, of others by less.
    let unequal = (s.variance.iter().map(|v| v * v).sum::<f64>() / k).sqrt() / v;
    for (i, c) in t.covariance.iter().enumerate().take(LAGS.len()) {
        add(What::Covariance(i as u8), c / v, unequal / (f * n).sqrt(), Scale::Linear);
    }
    add(What::BlockVariance, t.block_variance / v, (128.0 / (f * n)).sqrt(), Scale::Log);
    if let Some(power) = &t.power {
        let (_, over) = Background::of(power, t.width).highest(power);
        let top = f64::from(over) * tails::median_of_squares(2.0 * f);
        let z = tails::largest(tails::chi_square(top, 2.0 * f), power.len());
        add(What::PlanePeak, z, 1.0, Scale::Linear);
    }
    add(What::Skewness, s.skewness, (6.0 / (f * n)).sqrt(), Scale::Linear);
    add(What::Kurtosis, s.kurtosis, (24.0 * excess * excess / (f * n)).sqrt(), Scale::Linear);
    if c.photo_e.len() == 1 || c.role == Role::Dark {
        pixels(t, s, add);
    }
}

/// Where on the sensor the noise is: slopes and 16x16 blocks of the pixels' variance, single noisy pixels held.
fn noise_over_the_sensor(t: &Temporal, v: f64, add: &mut impl FnMut(What, f64, f64, Scale)) {
    let (w, h) = (t.width, t.height);
    let limit = 1.0 + 5.0 * (2.0 / t.dof).sqrt();
    let at = |i: usize| (f64::from(t.pixel_variance[i]) / v).min(limit);
    let n = (w * h) as f64;
    let middle = (0..w * h).map(at).sum::<f64>() / n;
    let scatter = (0..w * h).map(|i| (at(i) - middle).powi(2)).sum::<f64>() / n;
    let (across, down) = (w / 16, h / 16);
    let (mut slopes, mut blocks) = ([0.0; 5], Vec::with_capacity(across * down));
    for by in 0..down {
        for bx in 0..across {
            let mut sum = 0.0;
            for y in by * 16..by * 16 + 16 {
                sum += (y * w + bx * 16..y * w + bx * 16 + 16).map(at).sum::<f64>();
            }
            let block = sum / 256.0 - middle;
            let u = (bx as f64 * 16.0 + 8.0) / w as f64 * 2.0 - 1.0;
            let v = (by as f64 * 16.0 + 8.0) / h as f64 * 2.0 - 1.0;
            for (s, b) in slopes.iter_mut().zip(basis(u, v)) {
                *s += block * b;
            }
            blocks.push(block);
        }
    }
    let count = blocks.len() as f64;
    let sd = (scatter / (256.0 * count)).sqrt();
    for (i, s) in slopes.iter().enumerate() {
        add(What::NoiseSlope(i as u8), s / count, sd, Scale::Linear);
    }
    let ratio = blocks.iter().map(|b| b * b).sum::<f64>() / count * 256.0 / scatter;
    add(What::NoiseBlocks, ratio, spread_of_squares(ratio, count), Scale::CubeRoot);
}

/// White part, slow part and lines of row or column means. `across` pixels make one mean.
fn lines(
    power: &[f64],
    dof: f64,
    across: f64,
    pixel_variance: f64,
    add: &mut impl FnMut(What, f64, f64, Scale),
    [all, slow, peak]: [What; 3],
) {
    let bins = power.len() as f64;
    let mean = power.iter().sum::<f64>() / bins;
    add(all, mean * across / pixel_variance, (1.0 / (dof * bins)).sqrt(), Scale::Log);
    let few = power.len().min(8);
    let low = power[..few].iter().sum::<f64>() / few as f64;
    let (ratio, samples) = (low / mean.max(1e-12), 2.0 * dof * few as f64);
    add(slow, ratio, spread_of_squares(ratio, samples), Scale::CubeRoot);
    // Against the bins around, so that a continuum is no line.
    let mut top = f64::MIN;
    for (i, &p) in power.iter().enumerate().skip(4) {
        let (from, to) = (i.saturating_sub(12).max(1), (i + 13).min(power.len()));
        let middle = median(&mut power[from..to].to_vec(), f64::total_cmp);
        let white = middle / tails::median_of_squares(2.0 * dof);
        top = top.max(tails::chi_square(p / white.max(1e-12), 2.0 * dof));
    }
    // The median of 25 bins scatters by a quarter of their spread.
    add(peak, tails::largest(top / 1.05, power.len()), 1.0, Scale::Linear);
}

/// How pixels differ in their noise.
fn pixels(t: &Temporal, s: &Summary, add: &mut impl FnMut(What, f64, f64, Scale)) {
    let (n, f) = (t.pixel_variance.len() as f64, t.dof);
    if f < 3.0 {
        return;
    }
    let v = s.mean_variance;
    let second =
        t.pixel_variance.iter().map(|&x| (f64::from(x) / v - 1.0).powi(2)).sum::<f64>() / n;
    // Variance of χ²/f is 2/f, its own scatter has fourth moment 12/f² (1 + 4/f).
    let scatter = ((8.0 + 48.0 / f) / (f * f) / n).sqrt();
    add(What::Spread, second * f / 2.0, scatter * f / 2.0, Scale::Linear);
    // χ² quantile that a pixel passes with a chance of 1e-6.
    let limit = v * tails::quantile_of_squares(4.753, f);
    let noisy = t.pixel_variance.iter().filter(|&&x| f64::from(x) > limit).count();
    add(What::NoisyPixels, noisy as f64, 1.0, Scale::Count);
    noise_over_the_sensor(t, v, add);
    let lag = mean(&t.pixel_lag) / v;
    add(What::TimeLag, lag, 1.0 / (f * n).sqrt(), Scale::Linear);
    if t.frames >= 8 {
        // The half per cent of pixels with most noise: few levels or many?
        let rank = (t.pixel_variance.len() / 200).max(8);
        let mut sorted = t.pixel_variance.clone();
        let at = sorted.len() - rank;
        let edge = *sorted.select_nth_unstable_by(at, f32::total_cmp).1;
        let (mut fourth, mut square, mut lag, mut own, mut count) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (i, &x) in t.pixel_variance.iter().enumerate().filter(|(_, x)| **x >= edge) {
            let x = f64::from(x);
            fourth += f64::from(t.pixel_fourth[i]);
            square += x * x;
            lag += f64::from(t.pixel_lag[i]);
            own += x;
            count += 1.0;
        }
        add(What::TopKurtosis, fourth / square, (24.0 / (f * count)).sqrt(), Scale::Linear);
        add(What::TopTimeLag, lag / own, 1.2 / (f * count).sqrt(), Scale::Linear);
    }
}

/// Steps of the converter, from the codes of all stacks wide enough to be smooth over them.
fn codes(stacks: &[Temporal], summaries: &[Summary], out: &mut Vec<Statistic>) {
    let bins = stacks.first().map_or(0, |t| t.histogram.len());
    let mut add = |what, value: f64, sd: f64, scale| {
        if value.is_finite() {
            out.push(Statistic { place: Place::Set, what, value, sd, scale });
        }
    };
    for (k, (frequency, _)) in CODE_PERIODS.iter().enumerate() {
        let (mut re, mut im, mut n) = (0.0, 0.0, 0.0);
        for (t, s) in stacks.iter().zip(summaries) {
            let ends = f64::from(t.histogram[0]) + f64::from(t.histogram[bins - 1]);
            let samples = (t.mean.data.len() * t.frames) as f64;
            // A normal law's own wave at this frequency: exp(−2π²σ²f²), to be below its scatter.
            if s.width * frequency < 0.75 || ends > 1e-4 * samples {
                continue;
            }
            for (code, &count) in t.histogram.iter().enumerate().filter(|c| *c.1 > 0) {
                let angle = std::f64::consts::TAU * ((code as f64 * frequency) % 1.0);
                re += f64::from(count) * angle.cos();
                im += f64::from(count) * angle.sin();
                n += f64::from(count);
            }
        }
        if n > 0.0 {
            let dof = if *frequency == 0.5 { 1.0 } else { 2.0 };
            let value = (re * re + im * im) * 2.0 / dof / n;
            add(What::Codes(k as u8), value, (2.0f64 / (9.0 * dof)).sqrt(), Scale::CubeRoot);
        }
    }
    // Fourth differences, which a smooth density has none of, in their Poisson scatter.
    let mut pooled = vec![0.0f64; bins];
    for (t, _) in stacks.iter().zip(summaries).filter(|(_, s)| s.width > 4.0) {
        pooled.iter_mut().zip(&t.histogram).for_each(|(p, &h)| *p += f64::from(h));
    }
    let (mut sum, mut count, mut missing) = (0.0, 0.0, 0.0);
    for w in pooled.windows(5).filter(|w| w.iter().sum::<f64>() > 250.0) {
        let d = w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4];
        let var = w[0] + 16.0 * w[1] + 36.0 * w[2] + 16.0 * w[3] + w[4];
        sum += d * d / var;
        count += 1.0;
        missing += f64::from(w[2] == 0.0 && w[1].min(w[3]) > 30.0);
    }
    if count > 30.0 {
        // Neighbouring fourth differences share codes: the effective number is count/(1 + 2Σρ²) = count/2.3.
        add(What::Roughness, sum / count, (2.0 * 2.3f64 / count).sqrt(), Scale::Log);
        add(What::MissingCodes, missing, 1.0, Scale::Count);
    }
}

fn spatial(map: &maps::Map, out: &mut Vec<Statistic>) {
    let s: &Spatial = &map.spatial;
    let mut add = |what, value: f64, sd: f64, scale| {
        if value.is_finite() && sd.is_finite() {
            out.push(Statistic { place: Place::Map(map.kind), what, value, sd, scale });
        }
    };
    let (w, h) = (s.columns.len() as f64, s.rows.len() as f64);
    let n = w * h;
    let v = s.pixel_variance;
    if map.even {
        let rows = (s.row_variance / h).max(v / n);
        let columns = (s.column_variance / w).max(v / n);
        let scatter = [columns, rows, columns, rows, v / n];
        for (i, (k, variance)) in s.slopes.iter().zip(scatter).enumerate() {
            add(What::Slope(i as u8), *k, (variance + v / n).sqrt(), Scale::Linear);
        }
        let blocks = n / 256.0;
        let fine = (blocks - 25.0).max(1.0);
        add(What::MapBlocks, s.blocks, spread_of_squares(s.blocks, blocks), Scale::CubeRoot);
        add(
            What::FineBlocks,
            s.fine_blocks,
            spread_of_squares(s.fine_blocks, fine),
            Scale::CubeRoot,
        );
        for (i, c) in s.corners.iter().enumerate() {
            let var = v * 64.0 / n + s.row_variance * 8.0 / h + s.column_variance * 8.0 / w;
            add(What::Corner(i as u8), *c, var.sqrt(), Scale::Linear);
        }
    }
    let rows = spread_of_squares(s.row_variance, aperiodic(h));
    add(What::RowPattern, s.row_variance, rows, Scale::CubeRoot);
    let columns = spread_of_squares(s.column_variance, aperiodic(w));
    add(What::ColumnPattern, s.column_variance, columns, Scale::CubeRoot);
    // A bin of a single line's power is exponential: P(> r) = e^−r.
    let line = |r: f64, bins: f64| tails::largest(tails::deviate(-r), bins as usize);
    add(What::RowPatternPeak, line(s.row_peak / 1.1, h / 2.0), 1.0, Scale::Linear);
    add(What::ColumnPatternPeak, line(s.column_peak / 1.1, w / 2.0), 1.0, Scale::Linear);
    // Period 2 is the signed contrast of every other line, below.
    for (i, p) in PERIODS.iter().enumerate().skip(1) {
        let sd = (2.0 / (9.0 * (*p as f64 - 1.0))).sqrt();
        add(What::ColumnPeriod(i as u8), s.column_periods[i], sd, Scale::CubeRoot);
        add(What::RowPeriod(i as u8), s.row_periods[i], sd, Scale::CubeRoot);
    }
    add(What::PixelPattern, v, (2.0 / n).sqrt(), Scale::Log);
    add(What::Tails, s.whole_variance / v, (2.0 / n).sqrt(), Scale::Log);
    add(What::High, s.high, 1.0, Scale::Count);
    add(What::Low, s.low, 1.0, Scale::Count);
    add(What::Skewness, s.skewness, (6.0 / n).sqrt(), Scale::Linear);
    add(What::Kurtosis, s.kurtosis, (24.0 / n).sqrt(), Scale::Linear);
    for (i, c) in s.correlation.iter().enumerate() {
        add(What::MapCovariance(i as u8), *c, 1.0 / n.sqrt(), Scale::Linear);
    }
    // Two means of half the lines, or pixels, each; a line's variance holds its pixels'.
    let [rows, columns, checkerboard] = s.phases;
    add(What::EveryOtherRow, rows, (4.0 * s.row_variance / h).sqrt(), Scale::Linear);
    add(What::EveryOtherColumn, columns, (4.0 * s.column_variance / w).sqrt(), Scale::Linear);
    add(What::Checkerboard, checkerboard, (4.0 * v / n).sqrt(), Scale::Linear);
    add(What::Lattice, tails::largest(s.lattice, 512), 1.0, Scale::Linear);
    if let Some((slope, sd)) = map.after_image {
        add(What::AfterImage, slope, sd, Scale::Linear);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_do_not_widen_a_histogram() {
        // A normal law of standard deviation 3 at 100, in 65536 samples. Within a code its density is taken for even, which
        // shifts a quantile by up to a code times 1/(8 · 3).
        let mut histogram: Vec<u32> = (0..4096)
            .map(|code| {
                let z = (f64::from(code) - 100.0) / 3.0;
                (65536.0 / (3.0 * std::f64::consts::TAU.sqrt()) * (-z * z / 2.0).exp()) as u32
            })
            .collect();
        let width = half_width(&histogram);
        assert!((width - 3.0).abs() < 1.0 / 24.0, "{width}");
        histogram[4000] = 30;
        assert!((half_width(&histogram) - width).abs() < 0.01);
        assert_eq!(half_width(&[0; 16]), 0.0);
    }
}
