//! From the edge's position to the response: oversampled edge spread function, line spread
//! function, Fourier transform.

use super::line::{EdgeLine, no_edge};
use super::{BLOCKS, OVERSAMPLING, Rows, TUKEY_ALPHA};
use camrig_base::{Error, Result};
use camrig_fourier::plans::Sample;
use camrig_fourier::sinc;

/// Fewest bins on either side of the edge.
const MIN_BINS: usize = 4;
/// Ratio of the zero-padded to the original length of the line spread function, so that the
/// transform's samples are dense enough for linear interpolation.
const PADDING: usize = 8;
/// Highest frequency of the curve, cycles per bin. At the bins' own Nyquist frequency, 0.5, the
/// central difference passes nothing, and its correction grows without limit.
const HIGHEST: f64 = 0.45;
/// Largest gap between samples across the edge, bins: a polygon over a wider one would smooth the
/// edge.
const LARGEST_GAP: f64 = 2.0;

/// An edge spread function: means over bins on both sides of the edge.
pub struct Spread {
    /// Mean of each bin, DN.
    pub dn: Vec<f64>,
    /// Width of a bin, pixels.
    bin: f64,
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
        Ok(Self { dn: bin_means(&samples, bin, side)?, bin })
    }

    /// The mean of spread functions of equal bins.
    pub fn mean(several: &[Self]) -> Self {
        let mut dn = vec![0.0; several[0].dn.len()];
        for one in several {
            dn.iter_mut().zip(&one.dn).for_each(|(sum, v)| *sum += v / several.len() as f64);
        }
        Self { dn, bin: several[0].bin }
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
    /// Half width of the window, pixels.
    pub half: f64,
}

impl Sfr {
    /// The response of a spread function.
    pub fn of(spread: &Spread) -> Result<Self> {
        let Spread { dn: spread, bin } = spread;
        let (bin, count) = (*bin, spread.len());
        let side = count / 2;
        // Central difference; the ends, where the window vanishes, stay 0.
        let mut lsf = vec![0.0; count];
        for i in 1..count - 1 {
            lsf[i] = 0.5 * (spread[i + 1] - spread[i - 1]);
        }
        // The step's full height: the sum over the bins and the tails beyond them. Tails of
        // diffraction fall as 1/x², so that as much lies beyond X as between X/2 and X.
        let place = |i: usize| (i as f64 + 0.5 - side as f64) / side as f64;
        let outer = (0..count).filter(|&i| place(i).abs() > 0.5);
        let height = lsf.iter().sum::<f64>() + outer.map(|i| lsf[i]).sum::<f64>();
        if height == 0.0 {
            return Err(no_edge());
        }
        for (i, value) in lsf.iter_mut().enumerate() {
            *value *= tukey(place(i)) / height;
        }
        let padded = (PADDING * count).next_power_of_two();
        lsf.resize(padded, 0.0);
        let plan = f64::real_forward(padded);
        let mut spectrum = plan.make_output_vec();
        plan.process(&mut lsf, &mut spectrum)
            .map_err(|e| Error::internal(format!("Fourier transform: {e}")))?;
        let mut curve: Vec<[f64; 2]> = Vec::new();
        for (k, value) in spectrum.iter().enumerate() {
            let f = k as f64 / (padded as f64 * bin);
            if f > 1.0 || f * bin > HIGHEST {
                break;
            }
            let correction = sinc(2.0 * f * bin) * sinc(f * bin);
            curve.push([f, value.norm() / correction]);
        }
        line_from_one(&mut curve, 1.0 / (side as f64 * bin));
        let half = side as f64 * bin;
        let spread = spread.iter().enumerate().map(|(i, dn)| [half * place(i), *dn]).collect();
        Ok(Self { curve, spread, height, half })
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
fn bin_means(samples: &[(f64, f64)], bin: f64, side: usize) -> Result<Vec<f64>> {
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
    Ok((0..2 * side).map(|i| (integral(edge(i + 1)) - integral(edge(i))) / bin).collect())
}

/// Tukey window at u from -1 to 1.
fn tukey(u: f64) -> f64 {
    let flat = 1.0 - TUKEY_ALPHA;
    let u = u.abs();
    if u <= flat {
        1.0
    } else {
        0.5 * (1.0 + libm::cos(std::f64::consts::PI * (u - flat) / TUKEY_ALPHA))
    }
}
