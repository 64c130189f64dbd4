//! Straight lines through the means of every pixel over a series of stacks, accumulated one stack
//! at a time.

use super::dark::MIN_SPAN;
use super::site::Site;
use super::spatial::{PlaneMoments, SpatialVariance};
use super::stack::Stack;
use camrig_base::Value;
use camrig_base::median::{median, robust_sd};
use rayon::prelude::*;

/// Weighted straight lines `y = offset + slope · x`, one per pixel; `x` (exposure time, signal)
/// and the weight are common to a channel. Two planes of sums are kept, independent of the number
/// of stacks.
#[derive(Clone, Debug)]
pub struct LineMaps {
    width: usize,
    height: usize,
    sites: Vec<Site>,
    sum_y: Vec<f64>,
    sum_xy: Vec<f64>,
    channels: Vec<Sums>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    w: f64,
    x: f64,
    xx: f64,
    z: f64,
    xz: f64,
    range: Option<(f64, f64)>,
}

/// A coefficient of a pixel's line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Line {
    /// Value at x = 0.
    Offset,
    /// Change per unit of x.
    Slope,
}

/// Robust standard deviations above the median from which a pixel is hot: one in 1e9 of a Gaussian
/// pattern.
const HOT: f64 = 6.0;
/// Hot pixels from which their law is known.
const MIN_HOT: f64 = 5.0;

/// The hot pixels of a channel, in units of the slope.
#[derive(Clone, Debug)]
pub struct Hot {
    limits: Vec<Limit>,
    /// Share of pixels with their exponential law, those of it below the limit included.
    pub fraction: Value,
    /// Mean of their exponential law; none of few.
    pub mean: Option<Value>,
    /// What they add to the mean over all pixels.
    pub of_mean: f64,
}

#[derive(Clone, Copy, Debug)]
struct Limit {
    site: Site,
    middle: f64,
    limit: f64,
}

/// One channel's share of a stack to add.
#[derive(Clone, Copy, Debug, Default)]
pub struct Point {
    /// Abscissa.
    pub x: f64,
    /// A second quantity of the stack, such as its exposure time (see
    /// [`LineMaps::companion_slope`]).
    pub z: f64,
    /// Weight: inverse variance of a pixel's mean, 1/DN²; 0 to exclude the channel.
    pub weight: f64,
}

impl LineMaps {
    /// Empty maps for frames of `width` x `height` pixels.
    pub fn new(width: usize, height: usize, sites: &[Site]) -> Self {
        let channels = sites.iter().map(|s| s.channel + 1).max().unwrap_or(1);
        Self {
            width,
            height,
            sites: sites.to_vec(),
            sum_y: vec![0.0; width * height],
            sum_xy: vec![0.0; width * height],
            channels: vec![Sums::default(); channels],
        }
    }

    /// Adds a stack, one point per channel.
    pub fn add(&mut self, stack: &Stack, points: &[Point]) {
        for (sums, p) in self.channels.iter_mut().zip(points) {
            sums.w += p.weight;
            sums.x += p.weight * p.x;
            sums.xx += p.weight * p.x * p.x;
            sums.z += p.weight * p.z;
            sums.xz += p.weight * p.x * p.z;
            if p.weight > 0.0 {
                let (low, high) = sums.range.unwrap_or((p.x, p.x));
                sums.range = Some((low.min(p.x), high.max(p.x)));
            }
        }
        let (step_x, step_y) = (self.sites[0].step_x, self.sites[0].step_y);
        let (sites, width) = (&self.sites, self.width);
        self.sum_y
            .par_chunks_mut(width)
            .zip(self.sum_xy.par_chunks_mut(width))
            .enumerate()
            .for_each(|(row, (sum_y, sum_xy))| {
                for x in 0..width {
                    let site = sites[(row % step_y) * step_x + x % step_x];
                    let p = points[site.channel];
                    let wy = p.weight * stack.mean_at(x, row);
                    sum_y[x] += wy;
                    sum_xy[x] += p.x * wy;
                }
            });
    }

    /// Rows of the frames.
    pub fn rows(&self) -> usize {
        self.height
    }

    /// Columns of the frames.
    pub fn columns(&self) -> usize {
        self.width
    }

    /// Number of pixels of a channel.
    pub fn pixels(&self, channel: usize) -> f64 {
        let of = self.sites.iter().filter(|s| s.channel == channel);
        of.map(|s| (s.rows(self.height) * s.columns(self.width)) as f64).sum()
    }

    /// Determinant of the normal equations; `None` where x does not span [`MIN_SPAN`], as lines
    /// then cannot be extrapolated to zero.
    fn determinant(&self, channel: usize) -> Option<f64> {
        let s = self.channels[channel];
        let (low, high) = s.range?;
        (high >= MIN_SPAN * low).then_some(s.w * s.xx - s.x * s.x)
    }

    /// Offset or slope of a pixel of `channel`.
    fn value(&self, line: Line, at: usize, channel: usize, determinant: Option<f64>) -> f64 {
        let s = self.channels[channel];
        match (line, determinant) {
            (Line::Offset, Some(d)) => (s.xx * self.sum_y[at] - s.x * self.sum_xy[at]) / d,
            (Line::Slope, Some(d)) => (s.w * self.sum_xy[at] - s.x * self.sum_y[at]) / d,
            (_, None) => self.sum_y[at] / s.w,
        }
    }

    /// Slope of the second quantity `z` over `x`, with the same weights.
    pub fn companion_slope(&self, channel: usize) -> Option<f64> {
        let s = self.channels[channel];
        Some((s.w * s.xz - s.x * s.z) / self.determinant(channel)?)
    }

    /// The pixels of a channel whose slope lies more than six robust standard deviations above
    /// the median, at each site: hot pixels, where x is the exposure of darks.
    pub fn hot(&self, channel: usize) -> Option<Hot> {
        let determinant = Some(self.determinant(channel)?);
        let slope = |at: usize| self.value(Line::Slope, at, channel, determinant);
        let (mut limits, mut excess, mut pixels) = (Vec::new(), Vec::new(), 0.0);
        for site in self.sites.iter().filter(|site| site.channel == channel) {
            let places = site.pixels(self.width, self.height);
            let all: Vec<f64> = places.map(|(x, y)| slope(y * self.width + x)).collect();
            let middle = median(&mut all.clone(), f64::total_cmp);
            let limit = HOT * robust_sd(all.iter().map(|v| (v - middle) as f32));
            pixels += all.len() as f64;
            excess.extend(all.iter().map(|v| v - middle).filter(|v| *v > limit));
            limits.push(Limit { site: *site, middle, limit });
        }
        let count = excess.len() as f64;
        let sum: f64 = excess.iter().sum();
        // Of an exponential law the excess over a limit has the law's mean, which is its deviation.
        let limit = limits.iter().map(|l| l.limit).sum::<f64>() / limits.len() as f64;
        let mean = sum / count - limit;
        let mean = (count >= MIN_HOT).then(|| Value::new(mean, mean / count.sqrt()));
        let above = Value::new(count / pixels, count.max(1.0).sqrt() / pixels);
        let fraction = above.scaled(mean.map_or(1.0, |m| libm::exp(limit / m.value)));
        Some(Hot { limits, fraction, mean, of_mean: sum / pixels })
    }

    /// Mean of a coefficient over a channel's pixels, and its variance over them less the temporal
    /// noise of the lines. Where x spans too little, the offset is the pixels' mean and there is
    /// no slope (`None`).
    pub fn spread(&self, line: Line, channel: usize) -> Option<(f64, SpatialVariance)> {
        self.spread_without(line, channel, None)
    }

    /// The same with hot pixels at the median of their site.
    pub fn spread_without(
        &self,
        line: Line,
        channel: usize,
        hot: Option<&Hot>,
    ) -> Option<(f64, SpatialVariance)> {
        let s = self.channels[channel];
        s.range?;
        let determinant = self.determinant(channel);
        let noise = match (line, determinant) {
            (Line::Offset, Some(d)) => s.xx / d,
            (Line::Offset, None) => 1.0 / s.w,
            (Line::Slope, d) => s.w / d?,
        };
        let planes: Vec<PlaneMoments> = (self.sites.iter())
            .filter(|site| site.channel == channel)
            .map(|&site| {
                let hot = hot.and_then(|hot| hot.limits.iter().find(|l| l.site == site));
                PlaneMoments::of(site, self.width, self.height, |at| {
                    let value = self.value(line, at, channel, determinant);
                    match hot {
                        Some(own) if value > own.middle + own.limit => own.middle,
                        _ => value,
                    }
                })
            })
            .collect();
        let pooled = PlaneMoments::pool(&planes);
        Some((pooled.mean, pooled.split(noise, planes.len())))
    }
}
