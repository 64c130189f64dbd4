//! From the edge's position to the response: oversampled edge spread function, line spread
//! function, Fourier transform.

use super::line::{EdgeLine, no_edge};
use super::{BLOCKS, OVERSAMPLING, Rows, TUKEY_ALPHA, far_sides};
use camrig_base::{Error, Result, Value};
use camrig_fourier::plans::real_forward;
use camrig_fourier::sinc;
use std::f64::consts::PI;

/// Fewest bins on either side of the edge.
const MIN_BINS: usize = 4;
/// Ratio of the zero-padded to the original length of the line spread function, so that the
/// transform's samples are dense enough for linear interpolation.
const PADDING: usize = 8;
/// Highest frequency of the curve, cycles per bin. At the bins' own Nyquist frequency, 0.5, the
/// central difference passes nothing, and its correction grows without limit.
const HIGHEST: f64 = 0.45;
/// Ratio of one window to the next narrower one.
const NARROWER: f64 = std::f64::consts::SQRT_2;
/// Smallest half width of a window over the blur: at six blurs, where the window is one half,
/// nothing of a normal line spread function is left. Chosen: a narrower one has less noise, and
/// moves the response by more.
const MIN_BLURS: f64 = 12.0;
/// Standard errors within which two estimates agree.
const AGREE: f64 = 2.0;
/// Largest gap between samples across the edge, bins: a polygon over a wider one would smooth the
/// edge.
const LARGEST_GAP: f64 = 2.0;

/// An edge spread function: means over bins on both sides of the edge.
pub struct Spread {
    /// Mean of each bin, DN.
    pub dn: Vec<f64>,
    /// Width of a bin, pixels.
    bin: f64,
    /// Variance of a bin by noise, DN².
    variance: f64,
    /// Standard deviation of the blurred step that fits best, pixels.
    blur: f64,
}

impl Spread {
    /// Distance from the edge that every row reaches on both sides, pixels.
    pub fn reach(rows: &Rows, line: &EdgeLine) -> f64 {
        let mut half = f64::INFINITY;
        for row in rows {
            let cos = 1.0 / libm::hypot(line.slope(row[0].along), 1.0);
            let place = line.at(row[0].along);
            half = half.min((place - row[0].across) * cos);
            half = half.min((row[row.len() - 1].across - place) * cos);
        }
        half
    }

    /// The spread function up to the distance `reach` of all rows except those of the block
    /// `without`; `step` is the mean distance between samples of a row, pixels.
    pub fn of(
        rows: &Rows,
        line: &EdgeLine,
        step: f64,
        reach: f64,
        without: Option<usize>,
    ) -> Result<Self> {
        let bin = step / OVERSAMPLING;
        let side = ((reach / bin).floor() as usize).max(MIN_BINS);
        let mut samples: Vec<(f64, f64)> = Vec::new();
        for (index, row) in rows.iter().enumerate() {
            if without == Some(index * BLOCKS / rows.len()) {
                continue;
            }
            let place = line.at(row[0].along);
            let cos = 1.0 / libm::hypot(line.slope(row[0].along), 1.0);
            samples.extend(row.iter().map(|s| ((s.across - place) * cos, s.value)));
        }
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        let noise = far_sides(rows, line, reach).map(|side| side.variance);
        let (dn, share) = bin_means(&samples, bin, side)?;
        Ok(Self { dn, bin, variance: 0.5 * (noise[0] + noise[1]) * share, blur: line.blur })
    }

    /// The mean of spread functions of equal bins.
    pub fn mean(several: &[Self]) -> Self {
        let mut dn = vec![0.0; several[0].dn.len()];
        for one in several {
            dn.iter_mut().zip(&one.dn).for_each(|(sum, v)| *sum += v / several.len() as f64);
        }
        let variance = several.iter().map(|one| one.variance).sum::<f64>();
        let n = several.len() as f64;
        let blur = several.iter().map(|one| one.blur).sum::<f64>() / n;
        Self { dn, bin: several[0].bin, variance: variance / (n * n), blur }
    }

    /// MTF50 of the blurred step that fits best, cycles per pixel.
    fn fitted(&self) -> f64 {
        (2.0 * std::f64::consts::LN_2).sqrt() / (2.0 * PI * self.blur)
    }

    /// Distance of bin `i` from the edge, pixels.
    fn place(&self, i: usize) -> f64 {
        (i as f64 + 0.5 - 0.5 * self.dn.len() as f64) * self.bin
    }

    /// Distance of the last bin's end from the edge, pixels.
    pub fn half(&self) -> f64 {
        0.5 * self.dn.len() as f64 * self.bin
    }

    /// The step's height, DN; signed, with its error by noise. Tails of diffraction fall as 1/x²,
    /// so that as much lies beyond X as between X/2 and X; where noise hides them, the difference
    /// of the outer halves' means has less of it.
    fn height(&self, lsf: &[f64]) -> Value {
        let count = self.dn.len();
        let outer = |i: &usize| self.place(*i).abs() > 0.5 * self.half();
        let with_tails =
            lsf.iter().sum::<f64>() + (0..count).filter(outer).map(|i| lsf[i]).sum::<f64>();
        let (mut means, mut bins) = (0.0, 0.0);
        for i in (0..count).filter(outer) {
            means += self.place(i).signum() * self.dn[i];
            bins += 0.5;
        }
        let means = Value::new(means / bins, (2.0 * self.variance / bins).sqrt());
        // The ends count twice and the middles once, in pairs of bins that a central difference
        // halves.
        let error = (5.0 * self.variance).sqrt();
        let agree = (means.value - with_tails).abs() < AGREE * error;
        if agree { means } else { Value::new(with_tails, error) }
    }

    /// Half width, pixels, of the window: the smallest that gives the response at one half of all
    /// larger ones within their noise, by the method of O. Lepski (Theory Probab. Appl. 36, 682,
    /// 1991). Without noise it is the whole region, as in the standard.
    pub fn window(&self) -> Result<f64> {
        let blur = self.blur;
        let frequency = self.fitted();
        let mut widths = vec![self.half()];
        while let Some(next) = widths.last().map(|w| w / NARROWER)
            && next > MIN_BLURS * blur
        {
            widths.push(next);
        }
        let mut seen: Vec<Value> = Vec::new();
        for &half in &widths {
            let sfr = Sfr::of(self, half)?;
            let Some(at) = sfr.at(frequency) else { return Ok(self.half()) };
            let one = Value::new(at, sfr.noise(frequency).sqrt());
            if seen.iter().any(|w| (w.value - one.value).abs() > AGREE * w.std_error) {
                break;
            }
            seen.push(one);
        }
        Ok(widths[seen.len() - 1])
    }
}

/// The spatial frequency response of an edge.
pub struct Sfr {
    /// (cycles per pixel, response).
    pub curve: Vec<[f64; 2]>,
    /// The edge spread function: (distance from the edge, pixels; DN).
    pub spread: Vec<[f64; 2]>,
    /// The step's height including its tails, DN; signed.
    pub height: f64,
    /// Relative standard error of the height.
    height_error: f64,
    /// Half width of the window, pixels.
    pub half: f64,
    /// MTF50 of the blurred step that fits best, cycles per pixel.
    pub fitted: f64,
    /// Density of the noise over distance, relative to the step's height squared, pixels.
    density: f64,
}

impl Sfr {
    /// The response of a spread function under a window of this half width, pixels.
    pub fn of(spread: &Spread, half: f64) -> Result<Self> {
        let (bin, count) = (spread.bin, spread.dn.len());
        // Central difference; the ends, where the window vanishes, stay 0.
        let mut lsf = vec![0.0; count];
        for i in 1..count - 1 {
            lsf[i] = 0.5 * (spread.dn[i + 1] - spread.dn[i - 1]);
        }
        let Value { value: height, std_error } = spread.height(&lsf);
        if height == 0.0 {
            return Err(no_edge());
        }
        // What the window takes off, the blurred step that fits best puts back.
        for (i, value) in lsf.iter_mut().enumerate() {
            let place = spread.place(i);
            let window = tukey((place / half).clamp(-1.0, 1.0));
            let u = place / spread.blur;
            let normal = libm::exp(-0.5 * u * u) * bin / ((2.0 * PI).sqrt() * spread.blur);
            *value = window * *value / height + (1.0 - window) * normal;
        }
        let padded = (PADDING * count).next_power_of_two();
        lsf.resize(padded, 0.0);
        let plan = real_forward(padded);
        let mut spectrum = plan.make_output_vec();
        let mut lsf: Vec<f32> = lsf.iter().map(|v| *v as f32).collect();
        plan.process(&mut lsf, &mut spectrum)
            .map_err(|e| Error::internal(format!("Fourier transform: {e}")))?;
        // The component of the noise at right angles to the response adds its power.
        let mut out = Self {
            curve: Vec::new(),
            spread: spread.dn.iter().enumerate().map(|(i, dn)| [spread.place(i), *dn]).collect(),
            height,
            height_error: (std_error / height).abs(),
            half,
            fitted: spread.fitted(),
            density: spread.variance * bin / (height * height),
        };
        for (k, value) in spectrum.iter().enumerate() {
            let f = k as f64 / (padded as f64 * bin);
            if f > 1.0 || f * bin > HIGHEST {
                break;
            }
            let correction = sinc(2.0 * f * bin) * sinc(f * bin);
            let power = f64::from(value.norm_sqr()) / correction.powi(2) - out.noise(f);
            out.curve.push([f, power.max(0.0).sqrt()]);
        }
        line_from_one(&mut out.curve, 1.0 / spread.half());
        Ok(out)
    }

    /// Variance of the response at a frequency, cycles per pixel, by noise: white noise of density
    /// n, pixels, under the window w over ±h gives each component n/2·∫(w'² + (2πf·w)²) =
    /// n/2·(π²/4h + 3π²f²h).
    pub fn noise(&self, f: f64) -> f64 {
        let pi2 = PI.powi(2);
        0.5 * self.density * pi2 * (0.25 / self.half + 3.0 * f * f * self.half)
    }

    /// Standard error by noise of a response of one half at a frequency, cycles per pixel: the
    /// transform's and the height's.
    pub fn error_at_half(&self, f: f64) -> f64 {
        libm::hypot(self.noise(f).sqrt(), 0.5 * self.height_error)
    }

    /// How steeply the response falls where it is one half, per cycle per pixel: over half of the
    /// frequency on both sides, as noise decides between neighbours, and no steeper than a bell,
    /// whose slope there is ln 2 over the frequency. It is 0 where the response rises.
    pub fn fall(&self, f: f64) -> f64 {
        let end = self.curve.last().map_or(f, |p| p[0]);
        let beside = (0.5 * f).min(end - f);
        let fall = match (self.at(f - beside), self.at(f + beside)) {
            (Some(before), Some(after)) => (before - after) / (2.0 * beside),
            _ => 0.0,
        };
        fall.clamp(0.0, std::f64::consts::LN_2 / f)
    }

    /// Frequency where the response first falls to a level, cycles per pixel.
    pub fn crossing(&self, level: f64) -> Option<f64> {
        self.curve.windows(2).find_map(|w| {
            let ([f0, m0], [f1, m1]) = (w[0], w[1]);
            (m0 >= level && m1 < level).then(|| f0 + (f1 - f0) * (m0 - level) / (m0 - m1))
        })
    }

    /// The response at a frequency, cycles per pixel; `None` beyond the end of the curve.
    pub fn at(&self, f: f64) -> Option<f64> {
        let i = self.curve.partition_point(|p| p[0] < f).max(1);
        let ([f0, m0], [f1, m1]) = (self.curve[i - 1], *self.curve.get(i)?);
        Some(m0 + (m1 - m0) * (f - f0) / (f1 - f0))
    }
}

/// At f = 0 the response is 1 by definition, although the window has cut the tails. Below
/// `resolved`, cycles per pixel, of which half the window holds a period, the transform shows the
/// window: the curve is a line from 1 to the first frequency that is resolved.
fn line_from_one(curve: &mut [[f64; 2]], resolved: f64) {
    let first = curve.iter().find(|p| p[0] >= resolved).or(curve.last());
    let Some(&[end, response]) = first else { return };
    for [f, value] in curve.iter_mut().take_while(|p| p[0] < end) {
        *value = 1.0 + (response - 1.0) * *f / end;
    }
}

/// Means over the bins of the polygon through sorted samples (distance, value). With few
/// phases of the slant, samples cluster, and their mean would not be that of the bin's centre.
///
/// Beside them the variance of a bin over that of a sample: Σ w²/(bin Σ w) of the lengths w of
/// polygon that the samples stand for.
fn bin_means(samples: &[(f64, f64)], bin: f64, side: usize) -> Result<(Vec<f64>, f64)> {
    let gap = samples.windows(2).map(|w| {
        let inside = w[0].0.abs() < side as f64 * bin;
        if inside { w[1].0 - w[0].0 } else { 0.0 }
    });
    if gap.fold(0.0, f64::max) > LARGEST_GAP * bin {
        return Err(Error::input("the rows meet too few phases of the sampling").help(
            "slant the edge by 2 to 10 degrees, away from 1/4, 1/2 and whole pixels a row",
        ));
    }
    // Integral of the polygon from its first sample to distance d.
    let mut area = vec![0.0; samples.len()];
    for i in 1..samples.len() {
        let (a, b) = (samples[i - 1], samples[i]);
        area[i] = area[i - 1] + 0.5 * (a.1 + b.1) * (b.0 - a.0);
    }
    let integral = |d: f64| {
        let i = samples.partition_point(|s| s.0 <= d).clamp(1, samples.len() - 1);
        let (a, b) = (samples[i - 1], samples[i]);
        let h = d - a.0;
        let slope = if b.0 > a.0 { (b.1 - a.1) / (b.0 - a.0) } else { 0.0 };
        area[i - 1] + h * (a.1 + 0.5 * slope * h)
    };
    let edge = |i: usize| (i as f64 - side as f64) * bin;
    let means = (0..2 * side).map(|i| (integral(edge(i + 1)) - integral(edge(i))) / bin);
    let lengths = samples.windows(3).map(|w| 0.5 * (w[2].0 - w[0].0));
    let (sum, squares) = lengths.fold((0.0, 0.0), |(sum, squares), w| (sum + w, squares + w * w));
    Ok((means.collect(), squares / (bin * sum)))
}

/// Tukey window at u from -1 to 1.
fn tukey(u: f64) -> f64 {
    let flat = 1.0 - TUKEY_ALPHA;
    let u = u.abs();
    if u <= flat { 1.0 } else { 0.5 * (1.0 + libm::cos(PI * (u - flat) / TUKEY_ALPHA)) }
}
