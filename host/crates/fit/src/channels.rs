//! Columns that are read through 2, 4, 8 or 16 channels in turn, each with its own gain and offset.
//!
//! Of the mean frame, each pixel over the mean of its site, the means of columns less what is smooth
//! over twice sixteen columns, in which every such pattern averages out, have a mean mⱼ over the
//! columns of each of sixteen classes. Σ (mⱼ/s)² over its degrees of freedom, s from the
//! scatter within the classes, is Fisher's F where they do not differ; the channels are as few as
//! leave no more than chance to sixteen.

use camrig_base::Value;
use camrig_base::tails::variance_ratio;
use camrig_estimates::robust::{clip, clipped_mean, variance};
use camrig_estimates::{Sites, Stack};

/// Most channels; a camera has a power of two of them.
const MOST: usize = 16;
/// Standard normal deviate from which classes differ: of sensors without channels, three in a
/// hundred thousand pass it.
const MIN_DEVIATION: f64 = 4.0;
/// Robust standard deviations at which columns are clipped: defective ones are no channel's.
const CLIP: f64 = 4.0;

/// Channels of columns.
#[derive(Clone, Copy, Debug)]
pub struct Channels {
    /// How many.
    pub count: usize,
    /// Standard deviation of their gains, or of their offsets in DN.
    pub sd: Value,
}

impl Channels {
    /// The gains of a flat, less the dark of its exposure; none where they do not differ.
    pub fn of_gains(flat: &Stack, dark: &Stack, sites: Sites) -> Option<Self> {
        let map: Vec<f64> = map(flat).iter().zip(map(dark)).map(|(v, d)| v - d).collect();
        let width = flat.size().0;
        let means = site_means(&map, width, sites);
        let relative =
            map.iter().enumerate().map(|(i, v)| v / means[sites.of(i % width, i / width)] - 1.0);
        Self::of(&relative.collect::<Vec<_>>(), width)
    }

    /// The offsets of a dark, DN.
    pub fn of_offsets(dark: &Stack, sites: Sites) -> Option<Self> {
        let map = map(dark);
        let width = dark.size().0;
        let means = site_means(&map, width, sites);
        let rest = map.iter().enumerate().map(|(i, v)| v - means[sites.of(i % width, i / width)]);
        Self::of(&rest.collect::<Vec<_>>(), width)
    }

    fn of(map: &[f64], width: usize) -> Option<Self> {
        // Each class needs columns that scatter.
        if width < 8 * MOST {
            return None;
        }
        let column = |x: usize| map.iter().skip(x).step_by(width).copied().collect();
        let columns: Vec<f64> = (0..width).map(|x| clipped_mean(column(x), CLIP).value).collect();
        let twice = smooth(&smooth(&columns));
        let rest: Vec<f64> = twice.iter().zip(&columns[MOST..]).map(|(s, c)| c - s).collect();
        // The first of these is at column MOST, of the first class.
        let class = |j: usize| rest.iter().skip(j).step_by(MOST).copied().collect();
        let finest: Vec<f64> = (0..MOST).map(|j| clipped_mean(class(j), CLIP).value).collect();
        let scatter: Vec<f64> =
            rest.iter().enumerate().map(|(i, v)| v - finest[i % MOST]).collect();
        // Each class has its own mean, which takes a degree of freedom.
        let within = (rest.len() - MOST) as f64;
        let own = clipped_variance(scatter) * (rest.len() - 1) as f64 / within;
        let of_mean = own / (rest.len() / MOST) as f64;
        let coarse = |n: usize| -> Vec<f64> {
            let of = |j: usize| finest.iter().skip(j).step_by(n).sum::<f64>();
            (0..n).map(|j| of(j) * n as f64 / MOST as f64).collect()
        };
        // What a pattern of n channels leaves of the finest.
        let left = |n: usize| -> f64 {
            let coarse = coarse(n);
            let squares = finest.iter().enumerate().map(|(j, m)| (m - coarse[j % n]).powi(2));
            squares.sum::<f64>() / of_mean
        };
        let is_enough = |n: &usize| {
            let freedom = (MOST - n) as f64;
            let deviation = || variance_ratio(left(*n) / freedom, [freedom, within]);
            *n == MOST || deviation() < MIN_DEVIATION
        };
        let count = [1, 2, 4, 8, MOST].into_iter().find(is_enough)?;
        if count == 1 {
            return None;
        }
        let noise = of_mean * count as f64 / MOST as f64;
        let means = coarse(count);
        let square = Value::new(variance(&means) - noise, 0.0);
        let sd = square.sqrt()?.value;
        Some(Self { count, sd: Value::new(sd, (noise / (count as f64 - 1.0)).sqrt()) })
    }
}

fn map(stack: &Stack) -> Vec<f64> {
    let n = stack.frames.len() as f64;
    let pixel = |p: usize| stack.frames.iter().map(|f| f64::from(f.data[p])).sum::<f64>() / n;
    (0..stack.frames[0].data.len()).map(pixel).collect()
}

fn site_means(map: &[f64], width: usize, sites: Sites) -> Vec<f64> {
    let mut sums = vec![[0.0; 2]; sites.count()];
    for (i, v) in map.iter().enumerate() {
        let [sum, count] = &mut sums[sites.of(i % width, i / width)];
        *sum += v;
        *count += 1.0;
    }
    sums.into_iter().map(|[sum, count]| sum / count).collect()
}

/// Means of [`MOST`] neighbours and half of one more at either end: as many less.
fn smooth(columns: &[f64]) -> Vec<f64> {
    let mean = |w: &[f64]| {
        let ends = 0.5 * (w[0] + w[MOST]);
        (ends + w[1..MOST].iter().sum::<f64>()) / MOST as f64
    };
    columns.windows(MOST + 1).map(mean).collect()
}

fn clipped_variance(mut values: Vec<f64>) -> f64 {
    clip(&mut values, CLIP);
    variance(&values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::normal;
    use camrig_base::Plane;
    use camrig_captures::Role;

    /// Columns with gains of their own of 0.02 %, in a flat that falls to one side, and channels.
    fn stack(level: f64, gains: &[f64]) -> Stack {
        let mut state = 3u64;
        let mut normal = || normal(&mut state);
        let columns: Vec<f64> = (0..320)
            .map(|x| 1.0 + gains[x % gains.len()] + 2e-4 * normal() - 1e-4 * x as f64)
            .collect();
        let frames = (0..8).map(|_| {
            Plane::from_fn(320, 64, |x, _| {
                (100.0 + level * columns[x] + 0.04 * level * normal()).round() as u16
            })
        });
        Stack::new("flat", Role::Flat, 0.001, frames.collect())
    }

    #[test]
    fn as_many_channels_are_found_as_there_are() {
        let dark = stack(0.0, &[0.0]);
        let mono = Sites { across: 1, down: 1 };
        for gains in [
            &[0.002, -0.002][..],
            &[0.003, -0.001, 0.001, -0.003],
            &[0.002, 0.001, -0.003, 0.0, 0.001, -0.002, 0.003, -0.002],
        ] {
            let found = Channels::of_gains(&stack(2000.0, gains), &dark, mono).unwrap();
            assert_eq!(found.count, gains.len(), "{found:?}");
            let sd = variance(gains).sqrt();
            let off = (found.sd.value - sd).abs();
            assert!(
                off < 4.0 * found.sd.std_error && found.sd.std_error < 0.1 * sd,
                "{found:?} {sd}"
            );
        }
        assert!(Channels::of_gains(&stack(2000.0, &[0.0]), &dark, mono).is_none());
        assert!(Channels::of_offsets(&dark, mono).is_none());
    }

    /// Of two thousand sensors of 160 to 320 columns without channels none has some: by chance one
    /// would in sixteen such tests.
    #[test]
    fn columns_without_channels_have_none() {
        let mut state = 5u64;
        for draw in 0..2000 {
            let width = 160 + 32 * (draw % 6);
            let columns: Vec<f64> = (0..width).map(|_| normal(&mut state)).collect();
            let found = Channels::of(&columns, width);
            assert!(found.is_none(), "draw {draw}: {found:?}");
        }
    }
}
