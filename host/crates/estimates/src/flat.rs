//! Flicker of the light, gain, PRNU, defective columns, rows and areas: of a flat stack.

use super::areas::{Area, far, find, running_median};
use super::bias::Bias;
use super::robust::{jackknife, mad_sd, mean, median};
use super::transfer::inefficiency;
use super::{Sites, Stack};
use camrig_base::Value;
use camrig_base::tails::{median_of_squares, quantile_of_squares};
use camrig_linear::{Matrix, inverse};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Deviation of a column from its neighbours in robust standard deviations, and at least, from
/// which it is defective.
const DEFECTIVE: f64 = 8.0;
const MIN_DEFECT: f64 = 0.05;
/// The same of a line from those around it, and of a pixel of an area from the rest.
const MIN_LINE_DEFECT: f64 = 0.04;
const MIN_AREA_DEFECT: f64 = 0.1;
/// Robust standard deviations beyond which a pixel's gain is not of the core: of a normal
/// distribution one pixel in two million.
const OUTLIER: f64 = 5.0;
/// Part of the median level from which a pixel's noise tells the gain: that of others is not
/// light's.
const MIN_LIT: f64 = 0.5;
/// The power of flicker over the median power from which it is fitted, and the scatter of rows
/// from which it is fitted in any case.
const MIN_POWER: f64 = 30.0;
const MIN_ROWS: f64 = 0.02;
/// Variance over the median's at which noisy pixels count, and the normal deviate of a variance
/// that chance alone exceeds in one of a thousand million pixels.
const NOISY: f64 = 6.0;
const BY_CHANCE: f64 = 6.0;
/// Half the side of the square whose mean is removed from gain maps, pixels.
const REACH: usize = 4;
/// Its side, pixels.
pub(crate) const SIDE: usize = 2 * REACH + 1;
/// Pixels of that square.
pub const SQUARE: usize = SIDE * SIDE;

/// What a flat stack shows.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Flat {
    /// The stack.
    pub stack: String,
    /// Its exposure time, s.
    pub exposure_s: f64,
    /// The strongest frequency over rows.
    pub flicker: Flicker,
    /// Standard deviation of the logarithm of the light from frame to frame.
    pub frame_sd: Value,
    /// Gain and PRNU of each site.
    pub sites: Vec<Site>,
    /// Correlation of the gain of neighbours: to the right, below, two to the right, two below.
    pub gain_correlation: [Value; 4],
    /// Columns whose gain departs from that of their neighbours.
    pub defective_columns: Vec<usize>,
    /// Their mean gain relative to the others; none where there are none.
    pub defective_gain: Option<Value>,
    /// Rows, parts of lines and clusters whose gain departs, with their gain relative to the
    /// others.
    pub defective_areas: Vec<Area>,
    /// Charge that stays behind at each transfer along rows and down columns; none where the noise
    /// is not that of light.
    pub transfer_inefficiency: [Option<Value>; 2],
}

/// The strongest frequency of the light over rows.
#[derive(Clone, Debug)]
pub struct Flicker {
    /// Its power over the median of all frequencies.
    pub power_ratio: f64,
    /// Cycles per row, and amplitude relative to the mean after integration over the exposure; not
    /// fitted where nothing stands out.
    pub fit: Option<[Value; 2]>,
    /// What the pixels of each site see; empty where it is not fitted.
    pub by_site: Vec<Wave>,
}

/// A wave against that of all pixels.
#[derive(Clone, Copy, Debug)]
pub struct Wave {
    /// Its amplitude, over theirs.
    pub depth: Value,
    /// The angle by which it lags, degrees.
    pub lag_deg: Value,
}

/// Of the pixels at one site.
#[derive(Clone, Copy, Debug)]
pub struct Site {
    /// Level above black, DN.
    pub level: Value,
    /// Temporal variance over the level, without the read noise: DN per electron.
    pub gain: Value,
    /// Variance over pixels of the relative gain, without what is smooth over nine pixels.
    pub prnu_variance: Value,
}

impl Flat {
    /// Of a stack of two frames or more, with the bias of the same gain.
    pub fn of(stack: &Stack, bias: &Bias, sites: Sites) -> Self {
        Self::with_gains(stack, bias, sites).0
    }

    /// The same with the maps of the gain, less 1 and what is smooth, by even and by odd frames;
    /// 0 where pixels stand out.
    pub(crate) fn with_gains(stack: &Stack, bias: &Bias, sites: Sites) -> (Self, [Vec<f64>; 2]) {
        let (width, height) = stack.size();
        let frames: Vec<Vec<f64>> = (0..stack.frames.len())
            .into_par_iter()
            .map(|i| stack.values(i).iter().zip(&bias.map).map(|(v, m)| v - m).collect())
            .collect();
        let n = frames.len() as f64;
        let (lines, levels) = row_logarithms(&frames, width);
        let frame_sd = super::robust::variance(&levels).sqrt();
        let whole = [width, height];
        let maps: Vec<SiteMaps> =
            (0..sites.count()).map(|s| SiteMaps::of(&frames, whole, sites, s)).collect();
        let mut halves = [0, 1].map(|half| assemble(&maps, half, whole, sites));
        let gains = column_gains(&halves, width);
        let defective_columns = defective(&gains);
        let own: Vec<f64> = defective_columns.iter().map(|x| 1.0 + gains[*x]).collect();
        let defective_gain = (!own.is_empty()).then(|| {
            let Value { value, std_error } = mean(&own);
            Value::new(value, std_error.max(mad_sd(&gains) / (own.len() as f64).sqrt()))
        });
        let mut used = vec![true; width * height];
        let columns = |x: &usize| (*x..width * height).step_by(width);
        defective_columns.iter().flat_map(columns).for_each(|p| used[p] = false);
        let mut defective_areas = defective_rows(&maps, whole, sites);
        defective_areas.iter().flat_map(|a| a.places(width)).for_each(|p| used[p] = false);
        let both = halves[0].iter().zip(&halves[1]).zip(&used);
        let map: Vec<f64> =
            both.map(|((a, b), used)| if *used { 0.5 * (a + b) } else { 0.0 }).collect();
        let limit = (DEFECTIVE * mad_sd(&map)).max(MIN_AREA_DEFECT);
        for mut area in find(&map, width, |v| v.abs() > limit) {
            area.places(width).for_each(|p| used[p] = false);
            area.value.value += 1.0;
            defective_areas.push(area);
        }
        // Single pixels that stand out are defects, no part of the core's spread.
        let limit = OUTLIER * mad_sd(&map);
        map.iter().zip(&mut used).for_each(|(v, used)| *used &= v.abs() <= limit);
        for map in &mut halves {
            map.iter_mut().zip(&used).for_each(|(v, used)| *v = if *used { *v } else { 0.0 });
            remove_local_mean(map, width);
        }
        let gain_correlation = correlations(&halves, width, [(1, 0), (0, 1), (2, 0), (0, 2)]);
        let by_site = maps.iter().enumerate().map(|(s, maps)| {
            let own = products(&halves, width, 0, 0).into_iter().enumerate();
            let own = own.filter(|(p, _)| used[*p] && sites.of(p % width, p / width) == s);
            let product = mean(&own.map(|(_, v)| v).collect::<Vec<_>>());
            // The mean over the square contains the pixel itself.
            let kept = 1.0 - 1.0 / SQUARE as f64;
            Site {
                level: maps.level,
                gain: maps.gain(bias.clipped_variance),
                prnu_variance: Value {
                    value: product.value / kept,
                    std_error: product.std_error / kept,
                },
            }
        });
        let flat = Self {
            stack: stack.id.clone(),
            exposure_s: stack.exposure_s,
            flicker: Flicker::of(&lines, &maps, sites),
            frame_sd: Value { value: frame_sd, std_error: frame_sd / (2.0 * (n - 1.0)).sqrt() },
            sites: by_site.collect(),
            gain_correlation,
            defective_columns,
            defective_gain,
            defective_areas,
            transfer_inefficiency: inefficiency(&frames, width, bias.clipped_variance),
        };
        (flat, halves)
    }

    /// The mean level of the sites above black, DN.
    pub fn level(&self) -> f64 {
        self.sites.iter().map(|s| s.level.value).sum::<f64>() / self.sites.len().max(1) as f64
    }
}

/// The logarithm of the row means of each frame over those of the mean frame, and its mean over
/// rows, which is taken off.
fn row_logarithms(frames: &[Vec<f64>], width: usize) -> (Vec<Vec<f64>>, Vec<f64>) {
    let rows = |frame: &Vec<f64>| -> Vec<f64> {
        let of = |row: &[f64]| (row.iter().sum::<f64>() / width as f64).max(1.0);
        frame.chunks(width).map(of).collect()
    };
    let means: Vec<Vec<f64>> = frames.iter().map(rows).collect();
    let height = means[0].len();
    let average = |y: usize| means.iter().map(|frame| frame[y]).sum::<f64>() / means.len() as f64;
    let average: Vec<f64> = (0..height).map(average).collect();
    let of_frame = |frame: &Vec<f64>| {
        less_mean(frame.iter().zip(&average).map(|(v, a)| libm::log(v / a)).collect())
    };
    means.iter().map(of_frame).unzip()
}

/// A line less its mean, and the mean.
fn less_mean(line: Vec<f64>) -> (Vec<f64>, f64) {
    let level = line.iter().sum::<f64>() / line.len() as f64;
    (line.iter().map(|v| v - level).collect(), level)
}

impl Flicker {
    /// The phase of each frame is free, the frequency one for all.
    fn of(lines: &[Vec<f64>], maps: &[SiteMaps], sites: Sites) -> Self {
        let height = lines[0].len();
        let (first, step) = (1.0 / height as f64, 0.1 / height as f64);
        let count = ((0.5 - first) / step).ceil() as usize;
        let powers: Vec<f64> =
            (0..count).into_par_iter().map(|k| power(lines, first + k as f64 * step)).collect();
        let strongest = (0..count).max_by(|a, b| powers[*a].total_cmp(&powers[*b])).unwrap_or(0);
        let power_ratio = powers[strongest] / median(powers.clone());
        let squares = lines.iter().flatten().map(|v| v * v).sum::<f64>();
        let rows_sd = (squares / (lines.len() * height) as f64).sqrt();
        let fit = (power_ratio > MIN_POWER || rows_sd > MIN_ROWS).then(|| {
            let fit = |lines: &[&Vec<f64>]| fit(lines, first + strongest as f64 * step);
            let [frequency, depth] = fit(&lines.iter().collect::<Vec<_>>());
            let without = |i: usize| {
                let rest = lines.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, l)| l);
                fit(&rest.collect::<Vec<_>>())
            };
            let left_out: Vec<[f64; 2]> = (0..lines.len()).into_par_iter().map(without).collect();
            let error = |figure: usize| jackknife(lines.len(), |i| left_out[i][figure]);
            [
                Value { value: frequency, std_error: error(0) },
                Value { value: depth, std_error: error(1) },
            ]
        });
        let by_site = fit.map_or_else(Vec::new, |[frequency, _]| {
            let of = |(s, map): (usize, &SiteMaps)| {
                let rows = (s / sites.across, sites.down);
                Wave::of(&map.lines, rows, lines, frequency.value)
            };
            maps.iter().enumerate().map(of).collect()
        });
        Self { power_ratio, fit, by_site }
    }
}

/// Sum over frames of the power at a frequency in cycles per row.
fn power(lines: &[Vec<f64>], frequency: f64) -> f64 {
    let wave: Vec<[f64; 2]> = (0..lines[0].len())
        .map(|y| {
            let phase = TAU * frequency * y as f64;
            [libm::cos(phase), libm::sin(phase)]
        })
        .collect();
    let of_line = |line: &Vec<f64>| {
        let [re, im] = line
            .iter()
            .zip(&wave)
            .fold([0.0, 0.0], |[re, im], (v, [c, s])| [re + v * c, im + v * s]);
        re * re + im * im
    };
    lines.iter().map(of_line).sum()
}

/// Frequency and root mean square amplitude of the waves, one per line, that leave the least
/// squares.
fn fit(lines: &[&Vec<f64>], near: f64) -> [f64; 2] {
    /// Points of a search, and how often it narrows by fifteen.
    const POINTS: usize = 31;
    const ROUNDS: usize = 3;
    let height = lines[0].len();
    let (mut low, mut high) = (near - 0.5 / height as f64, near + 0.5 / height as f64);
    let mut best = (f64::INFINITY, near, 0.0);
    for _ in 0..ROUNDS {
        let step = (high - low) / (POINTS - 1) as f64;
        for k in 0..POINTS {
            let frequency = low + k as f64 * step;
            let (left, waves) = waves(lines, 0, 1, frequency);
            if left < best.0 {
                best = (left, frequency, waves.iter().map(power_of).sum());
            }
        }
        (low, high) = (best.1 - step, best.1 + step);
    }
    let n = lines.len() as f64;
    // The mean over frames was taken off each line.
    [best.1, depth((best.2 / (n - 1.0).max(1.0)).sqrt())]
}

/// The depth A of light of 1 + A sin, whose logarithm has the first harmonic
/// L = 2 (1 − √(1 − A²))/A.
fn depth(of_logarithm: f64) -> f64 {
    of_logarithm / (1.0 + 0.25 * of_logarithm * of_logarithm)
}

impl Wave {
    /// Of a site's rows, every `step`th from `first` on, against all rows; with errors by leaving
    /// out one frame at a time.
    fn of(own: &[Vec<f64>], rows: (usize, usize), all: &[Vec<f64>], frequency: f64) -> Self {
        let waves = |lines: &[Vec<f64>], (first, step)| {
            waves(&lines.iter().collect::<Vec<_>>(), first, step, frequency).1
        };
        let (own, all) = (waves(own, rows), waves(all, (0, 1)));
        let of = |without: Option<usize>| {
            let kept = |i: &usize| Some(*i) != without;
            let depth = |waves: &[[f64; 2]]| {
                let squares = (0..waves.len()).filter(kept).map(|i| power_of(&waves[i]));
                depth(mean(&squares.collect::<Vec<_>>()).value.sqrt())
            };
            // Sum over frames of all waves' conjugates times the site's.
            let [re, im] = (0..own.len()).filter(kept).fold([0.0, 0.0], |[re, im], i| {
                let ([a, b], [c, d]) = (own[i], all[i]);
                [re + a * c + b * d, im + b * c - a * d]
            });
            [depth(&own) / depth(&all), -libm::atan2(im, re).to_degrees()]
        };
        let [depth, lag] = of(None);
        let error = |figure: usize| jackknife(all.len(), |i| of(Some(i))[figure]);
        Self { depth: Value::new(depth, error(0)), lag_deg: Value::new(lag, error(1)) }
    }
}

fn power_of(wave: &[f64; 2]) -> f64 {
    wave[0] * wave[0] + wave[1] * wave[1]
}

/// What waves of a frequency leave of the squares of lines, which are of every `step`th row from
/// `first` on, and the wave of each: real and imaginary part of its amplitude at row 0.
fn waves(lines: &[&Vec<f64>], first: usize, step: usize, frequency: f64) -> (f64, Vec<[f64; 2]>) {
    let height = lines[0].len();
    let design: Vec<[f64; 3]> = (0..height)
        .map(|i| {
            let phase = TAU * frequency * (first + i * step) as f64;
            [libm::cos(phase), libm::sin(phase), 1.0]
        })
        .collect();
    let normal = Matrix::from_fn(3, 3, |i, j| design.iter().map(|d| d[i] * d[j]).sum());
    let Some(inverse) = inverse(normal) else {
        return (f64::INFINITY, vec![[0.0; 2]; lines.len()]);
    };
    let mut left = 0.0;
    let wave = |line: &&Vec<f64>| {
        let mut right = [0.0; 3];
        let mut squares = 0.0;
        for (v, d) in line.iter().zip(&design) {
            squares += v * v;
            (0..3).for_each(|i| right[i] += v * d[i]);
        }
        let c: Vec<f64> =
            (0..3).map(|i| (0..3).map(|j| inverse[(i, j)] * right[j]).sum()).collect();
        left += squares - (0..3).map(|i| c[i] * right[i]).sum::<f64>();
        [c[0], -c[1]]
    };
    let waves = lines.iter().map(wave).collect();
    (left, waves)
}

/// The pixels of one site.
struct SiteMaps {
    width: usize,
    level: Value,
    /// Temporal variance of each pixel that is lit, DN², and the mean level of these.
    variance: Vec<f64>,
    lit_level: f64,
    /// Frames less the one that their mean takes.
    dof: f64,
    /// Rows that depart from those around them, with their gain relative to these.
    defective_rows: Vec<(usize, f64)>,
    /// Relative gain less 1, of even and of odd frames.
    gains: [Vec<f64>; 2],
    /// The logarithm of the light of each row in each frame over its mean, less its mean over rows.
    lines: Vec<Vec<f64>>,
}

impl SiteMaps {
    fn of(frames: &[Vec<f64>], [width, _]: [usize; 2], sites: Sites, site: usize) -> Self {
        let (first_x, first_y) = (site % sites.across, site / sites.across);
        let own: Vec<Vec<f64>> = frames
            .iter()
            .map(|frame| {
                let rows = frame.chunks(width).skip(first_y).step_by(sites.down);
                rows.flat_map(|row| row.iter().skip(first_x).step_by(sites.across))
                    .copied()
                    .collect()
            })
            .collect();
        let columns = (width - first_x).div_ceil(sites.across);
        let n = own.len() as f64;
        // The light of each row in each frame, over its mean: flicker is not noise.
        let of_rows = |frame: &Vec<f64>| -> Vec<f64> {
            frame.chunks(columns).map(|r| r.iter().sum::<f64>() / columns as f64).collect()
        };
        let mut light: Vec<Vec<f64>> = own.iter().map(of_rows).collect();
        for y in 0..light[0].len() {
            let average = light.iter().map(|f| f[y]).sum::<f64>() / n;
            // Of a row without light, the light of frames is not known.
            light.iter_mut().for_each(|f| f[y] = if average < 1.0 { 1.0 } else { f[y] / average });
        }
        let gain_of = |takes: fn(usize) -> bool| -> Vec<f64> {
            let taken = || own.iter().zip(&light).enumerate().filter(|(i, _)| takes(*i));
            (0..own[0].len())
                .map(|p| {
                    let signal: f64 = taken().map(|(_, (f, _))| f[p]).sum();
                    signal / taken().map(|(_, (_, l))| l[p / columns]).sum::<f64>()
                })
                .collect()
        };
        let gain = gain_of(|_| true);
        let average: Vec<f64> =
            (0..gain.len()).map(|p| own.iter().map(|f| f[p]).sum::<f64>() / n).collect();
        let dof = (n - 1.0) * (columns as f64 - 1.0) / columns as f64;
        let variance = |p: usize| {
            let of = |(f, l): (&Vec<f64>, &Vec<f64>)| (f[p] - l[p / columns] * gain[p]).powi(2);
            own.iter().zip(&light).map(of).sum::<f64>() / dof
        };
        let limit = MIN_LIT * median(average.clone()) - BY_CHANCE * mad_sd(&average);
        let lit: Vec<usize> = (0..gain.len()).filter(|p| average[*p] >= limit).collect();
        let variance = lit.iter().map(|p| variance(*p)).collect();
        let levels: Vec<f64> = lit.iter().map(|p| average[*p]).collect();
        let frame_means: Vec<f64> =
            own.iter().map(|f| libm::log(mean(f).value.max(1.0))).collect();
        let mean_level = mean(&average).value;
        let middles = row_medians(&gain, columns);
        let around = running_median(&middles);
        let departures: Vec<f64> =
            middles.iter().zip(&around).map(|(m, a)| m / a.max(1.0) - 1.0).collect();
        let rows = far(&departures, DEFECTIVE, MIN_LINE_DEFECT);
        let relative = |mut gain: Vec<f64>| {
            let middles = row_medians(&gain, columns);
            for (y, row) in gain.chunks_mut(columns).enumerate() {
                let middle = if rows.contains(&y) { around[y] } else { middles[y] };
                row.iter_mut().for_each(|v| *v /= middle);
            }
            let ordinary = without_defective(&gain, columns, &rows);
            let first = smooth(&ordinary, columns);
            let smooth = smooth(&without_outliers(ordinary, &first), columns);
            gain.iter().zip(smooth).map(|(g, s)| g / s - 1.0).collect()
        };
        Self {
            width: columns,
            level: Value {
                value: mean_level,
                std_error: mean_level * mean(&frame_means).std_error,
            },
            variance,
            lit_level: mean(&levels).value,
            dof: n - 1.0,
            defective_rows: rows.iter().map(|y| (*y, 1.0 + departures[*y])).collect(),
            gains: [relative(gain_of(|i| i % 2 == 0)), relative(gain_of(|i| i % 2 == 1))],
            lines: light
                .iter()
                .map(|rows| less_mean(rows.iter().map(|v| libm::log(v.max(1e-6))).collect()).0)
                .collect(),
        }
    }

    /// Mean variance over mean level: a ratio for each pixel would be too large where noise is as
    /// large as the level. Noisy pixels count with [`NOISY`] times the median, or what chance gives
    /// the variance of so few frames, at most.
    fn gain(&self, read_variance: f64) -> Value {
        let by_chance = quantile_of_squares(BY_CHANCE, self.dof) / median_of_squares(self.dof);
        let most = by_chance.max(NOISY) * median(self.variance.clone());
        let kept: Vec<f64> = self.variance.iter().map(|v| v.min(most)).collect();
        let Value { value, std_error } = mean(&kept);
        Value::new(value - read_variance, std_error).scaled(1.0 / self.lit_level)
    }
}

/// The gain map of a half of the frames over the whole sensor.
fn assemble(
    maps: &[SiteMaps],
    half: usize,
    [width, height]: [usize; 2],
    sites: Sites,
) -> Vec<f64> {
    let at = |p: usize| {
        let (x, y) = (p % width, p / width);
        let map = &maps[sites.of(x, y)];
        map.gains[half][(y / sites.down) * map.width + x / sites.across]
    };
    (0..width * height).map(at).collect()
}

/// The median over rows of the relative gain less 1, of each column.
fn column_gains(halves: &[Vec<f64>; 2], width: usize) -> Vec<f64> {
    let column = |x: usize| {
        let [a, b] = [0, 1].map(|h: usize| halves[h].iter().skip(x).step_by(width));
        median(a.zip(b).map(|(a, b)| 0.5 * (a + b)).collect())
    };
    (0..width).map(column).collect()
}

/// Columns whose gain stands out.
fn defective(gains: &[f64]) -> Vec<usize> {
    let centre = median(gains.to_vec());
    let limit = (DEFECTIVE * mad_sd(gains)).max(MIN_DEFECT);
    (0..gains.len()).filter(|x| (gains[*x] - centre).abs() > limit).collect()
}

fn row_medians(map: &[f64], width: usize) -> Vec<f64> {
    map.chunks(width).map(|row| median(row.to_vec())).collect()
}

/// Rows of the sensor that depart at each of their sites.
fn defective_rows(maps: &[SiteMaps], [width, height]: [usize; 2], sites: Sites) -> Vec<Area> {
    let of_row = |y: usize| {
        let own = &maps[y % sites.down * sites.across..][..sites.across];
        let gain = |map: &SiteMaps| {
            map.defective_rows.iter().find(|(row, _)| *row == y / sites.down).map(|r| r.1)
        };
        let value = mean(&own.iter().map(gain).collect::<Option<Vec<f64>>>()?);
        Some(Area { left: 0, top: y, width, height: 1, value })
    };
    (0..height).filter_map(of_row).collect()
}

/// Columns that depart from the running median of columns, and `rows`, replaced by what is around
/// them, so that they do not bend the smooth model.
fn without_defective(gain: &[f64], width: usize, rows: &[usize]) -> Vec<f64> {
    let column = |x: usize| median(gain.iter().skip(x).step_by(width).copied().collect());
    let columns: Vec<f64> = (0..width).map(column).collect();
    let running = running_median(&columns);
    let departures: Vec<f64> = columns.iter().zip(&running).map(|(c, r)| c / r - 1.0).collect();
    let mut filled = gain.to_vec();
    for x in far(&departures, DEFECTIVE, MIN_LINE_DEFECT) {
        filled.iter_mut().skip(x).step_by(width).for_each(|v| *v = running[x]);
    }
    for y in rows {
        filled[y * width..(y + 1) * width].copy_from_slice(&running);
    }
    filled
}

/// Single pixels that stand out, replaced by the smooth model that they bent.
fn without_outliers(mut gain: Vec<f64>, smooth: &[f64]) -> Vec<f64> {
    let departures: Vec<f64> = gain.iter().zip(smooth).map(|(g, s)| g / s - 1.0).collect();
    let limit = OUTLIER * mad_sd(&departures);
    for ((v, departure), smooth) in gain.iter_mut().zip(departures).zip(smooth) {
        if departure.abs() > limit {
            *v = *smooth;
        }
    }
    gain
}

/// Legendre polynomials up to degree four along each side, fewer on short ones, by least squares.
fn smooth(map: &[f64], width: usize) -> Vec<f64> {
    let height = map.len() / width;
    let (along_x, along_y) = (Polynomials::over(width), Polynomials::over(height));
    let (nx, ny) = (along_x.count(), along_y.count());
    // Σ Y map X, then both normal matrices.
    let mut sums = Matrix::zeros(ny, nx);
    for (row, y) in map.chunks(width).zip(&along_y.values) {
        for i in 0..nx {
            let along = row.iter().zip(&along_x.values).map(|(v, x)| v * x[i]).sum::<f64>();
            (0..ny).for_each(|j| sums[(j, i)] += y[j] * along);
        }
    }
    let coefficients = along_y.normal_inverse() * sums * along_x.normal_inverse();
    let rows = along_y.values.iter().flat_map(|y| {
        let of_row: Vec<f64> =
            (0..nx).map(|i| (0..ny).map(|j| y[j] * coefficients[(j, i)]).sum()).collect();
        along_x.values.iter().map(move |x| x.iter().zip(&of_row).map(|(x, c)| x * c).sum::<f64>())
    });
    rows.collect()
}

/// Legendre polynomials at evenly spaced places from -1 to 1.
struct Polynomials {
    values: Vec<Vec<f64>>,
}

impl Polynomials {
    fn over(n: usize) -> Self {
        let degree = (n / 12).clamp(1, 4);
        let at = |i: usize| {
            let t = -1.0 + 2.0 * i as f64 / (n as f64 - 1.0);
            let mut p = vec![1.0, t];
            for k in 1..degree {
                let k_ = k as f64;
                p.push(((2.0 * k_ + 1.0) * t * p[k] - k_ * p[k - 1]) / (k_ + 1.0));
            }
            p
        };
        Self { values: (0..n).map(at).collect() }
    }

    fn count(&self) -> usize {
        self.values[0].len()
    }

    fn normal_inverse(&self) -> Matrix {
        let n = self.count();
        let normal = Matrix::from_fn(n, n, |i, j| self.values.iter().map(|p| p[i] * p[j]).sum());
        inverse(normal).expect("polynomials are independent")
    }
}

/// An index mirrored at the first and the last of `n`.
fn mirrored(i: isize, n: usize) -> usize {
    let last = n as isize - 1;
    let i = if i < 0 { -i } else { i };
    (if i > last { 2 * last - i } else { i }).clamp(0, last) as usize
}

/// Takes the mean of the square around each pixel off it, edges mirrored.
fn remove_local_mean(map: &mut [f64], width: usize) {
    let height = map.len() / width;
    let running = |n: usize, at: &dyn Fn(usize) -> f64| -> Vec<f64> {
        let around =
            |i: usize| (0..SIDE).map(move |k| mirrored((i + k) as isize - REACH as isize, n));
        (0..n).map(|i| around(i).map(at).sum::<f64>() / SIDE as f64).collect()
    };
    let along: Vec<f64> = map.chunks(width).flat_map(|row| running(width, &|x| row[x])).collect();
    for x in 0..width {
        let column = running(height, &|y| along[y * width + x]);
        column.iter().enumerate().for_each(|(y, m)| map[y * width + x] -= m);
    }
}

/// Correlations of the gains of pixels at these distances in columns and rows, of the maps of even
/// and of odd frames.
pub(crate) fn correlations<const N: usize>(
    halves: &[Vec<f64>; 2],
    width: usize,
    distances: [(isize, usize); N],
) -> [Value; N] {
    let whole = mean(&products(halves, width, 0, 0)).value.max(1e-9);
    distances.map(|(dx, dy)| mean(&products(halves, width, dx, dy)).scaled(whole.recip()))
}

/// Products of the maps of even and odd frames at a distance to the right, or left, and below, in
/// which noise does not count.
pub(crate) fn products([a, b]: &[Vec<f64>; 2], width: usize, dx: isize, dy: usize) -> Vec<f64> {
    let height = a.len() / width;
    let [left, right] = [(-dx).max(0) as usize, dx.max(0) as usize];
    let pairs = (0..height - dy).flat_map(|y| (left..width - right).map(move |x| (x, y)));
    pairs
        .map(|(x, y)| {
            let (here, there) = (y * width + x, (y + dy) * width + x + right - left);
            0.5 * (a[here] * b[there] + b[here] * a[there])
        })
        .collect()
}
