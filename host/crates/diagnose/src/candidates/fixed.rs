//! Patterns of the offset: `row-offset-fpn`, `column-offset-fpn`, `pixel-offset-fpn`; and
//! `readout-channel-mismatch`, of offset and gain.
//!
//! The offset map is the mean of the reference dark stack, DN. Standard deviations come from the
//! variance V of its row means, column means or pixels and the model's prediction V', as σ² =
//! σ₀² + (V − V')/K², e⁻², with K the system gain (DN/e⁻) and σ₀ what the model has. Channels of
//! the read-out are columns that repeat every n columns: n is the period whose means leave least
//! of the columns by Schwarz's criterion, σ² the variance between its n means less that of a mean,
//! in e⁻² from the offset map and without unit from the gain map.

use super::common::{of_excess, present};
use super::gain::greens_look_like_columns;
use super::proposal::Proposal;
use crate::data::channels::Channels;
use crate::evidence::Evidence;
use crate::model::effects::current;
use crate::statistics::lines::{PERIODS, phase_means};
use crate::statistics::maps::MapKind;
use crate::statistics::statistic::{Place, What};
use camrig_base::Value;
use camrig_linear::moments;
use camrig_sensor_core::effects::{Effect, readout_channel_mismatch::ReadoutChannelMismatch};

/// Turns of the fixed-point iteration of [`compensation`]: at some halving per turn the error is
/// below 1e-9 after them.
const TURNS: usize = 30;

/// Excess of a variance of the offset map, e⁻².
fn offset_excess(e: &Evidence<'_>, what: What) -> Option<Value> {
    let k = e.reference_gain()?;
    Some(e.difference(Place::Map(MapKind::Offset), what)?.scaled(1.0 / (k * k)))
}

/// `row-offset-fpn`: variance of the row means of the offset map.
pub fn row_offset(e: &Evidence<'_>) -> Option<Proposal> {
    let x = offset_excess(e, What::RowPattern)?;
    let present = e.camera.sensor.noise.row_fpn_e;
    of_excess("row-offset-fpn", "sigma_e", present, x)
}

/// `column-offset-fpn`: variance of the column means of the offset map.
pub fn column_offset(e: &Evidence<'_>) -> Option<Proposal> {
    let x = offset_excess(e, What::ColumnPattern)?;
    let present = present(e.camera, "column-offset-fpn", "sigma_e").unwrap_or(0.0);
    of_excess("column-offset-fpn", "sigma_e", present, x)
}

/// `pixel-offset-fpn`: variance of the pixels of the offset map.
pub fn pixel_offset(e: &Evidence<'_>) -> Option<Proposal> {
    let x = offset_excess(e, What::PixelPattern)?;
    let present = present(e.camera, "pixel-offset-fpn", "sigma_e").unwrap_or(0.0);
    of_excess("pixel-offset-fpn", "sigma_e", present, x)
}

/// `readout-channel-mismatch`: offsets from the offset map and gains from the gain map, each by
/// itself.
pub fn readout_channels(e: &Evidence<'_>) -> Vec<Proposal> {
    [offset_mismatch, gain_mismatch].into_iter().filter_map(|of| of(e)).collect()
}

/// Offsets of the read-out channels, e⁻.
fn offset_mismatch(e: &Evidence<'_>) -> Option<Proposal> {
    let m = Mismatch::of(&Columns::of(e, MapKind::Offset, e.reference_gain()?)?, |_| 1.0)?;
    let effect =
        ReadoutChannelMismatch { offset_e: m.sigma.value as f32, ..present_mismatch(e, &m) };
    m.proposal(e, MapKind::Offset, effect, "offset_e")
}

/// Gains of the read-out channels. Two that look like unequal greens are taken for these.
fn gain_mismatch(e: &Evidence<'_>) -> Option<Proposal> {
    let channels = Channels::new(e.camera);
    let columns = Columns::of(e, MapKind::Gain, 1.0)?;
    let m = Mismatch::of(&columns, |means| compensation(means, &channels))?;
    let of_greens = m.period == 2 && greens_look_like_columns(&e.camera.sensor.cfa, e.design);
    (!of_greens).then_some(())?;
    let effect = ReadoutChannelMismatch { gain: m.sigma.value as f32, ..present_mismatch(e, &m) };
    m.proposal(e, MapKind::Gain, effect, "gain")
}

/// The mismatch that the model has, if its channels are as many; one of nothing otherwise.
fn present_mismatch(e: &Evidence<'_>, found: &Mismatch) -> ReadoutChannelMismatch {
    let channels = found.period as f32;
    match current(e.camera, "readout-channel-mismatch") {
        Some(Effect::ReadoutChannelMismatch(x)) if x.channels == channels => x,
        _ => ReadoutChannelMismatch { channels, offset_e: 0.0, gain: 0.0 },
    }
}

/// Deviation of a map's columns from the model by a period, in standard deviations. Of two columns
/// it is that of their contrast, whichever is the brighter one.
fn period_deviation(e: &Evidence<'_>, map: MapKind, period: usize) -> Option<f64> {
    let at = PERIODS.iter().position(|p| *p == period)?;
    let place = Place::Map(map);
    if at == 0 {
        return Some(e.difference(place, What::EveryOtherColumn)?.z().abs());
    }
    let what = What::ColumnPeriod(at as u8);
    let (p, s) = (e.model.of.get(&(place, what))?, e.data.get(&(place, what))?);
    Some((p.scale.of(s.value) - p.scaled) / p.sd)
}

/// Column means of a map.
struct Columns<'a> {
    /// In the map's unit, slopes taken out.
    means: &'a [f64],
    /// Their variance without what repeats, in the map's unit squared.
    variance: f64,
    /// What the results are to be in, in the map's unit.
    unit: f64,
}

impl<'a> Columns<'a> {
    fn of(e: &'a Evidence<'_>, map: MapKind, unit: f64) -> Option<Self> {
        let spatial = &e.map(map)?.spatial;
        Some(Self { means: &spatial.columns.means, variance: spatial.columns.variance, unit })
    }

    /// Mean of the columns of each phase of a period.
    fn phases(&self, period: usize) -> Vec<f64> {
        phase_means(self.means, period).into_iter().map(|m| m / self.unit).collect()
    }

    /// Variance of such a mean.
    fn noise(&self, period: usize) -> f64 {
        self.variance / (self.unit * self.unit) * period as f64 / self.means.len() as f64
    }

    /// The period that leaves least of the means of the longest one, each mean paid for by ln N of
    /// N columns (Schwarz 1978).
    fn period(&self) -> Option<usize> {
        let longest = PERIODS[PERIODS.len() - 1];
        let all = self.phases(longest);
        let left = |n: usize| {
            let own = self.phases(n);
            let squares = all.iter().enumerate().map(|(p, m)| (m - own[p % n]).powi(2));
            squares.sum::<f64>() / self.noise(longest)
                + libm::log(self.means.len() as f64) * n as f64
        };
        PERIODS.into_iter().min_by(|&a, &b| left(a).total_cmp(&left(b)))
    }
}

/// Columns that repeat.
struct Mismatch {
    /// After how many.
    period: usize,
    /// Standard deviation of their phases.
    sigma: Value,
}

impl Mismatch {
    /// From columns whose phase means are this many times smaller than the mismatch is.
    fn of(columns: &Columns<'_>, compensation: impl Fn(&[f64]) -> f64) -> Option<Self> {
        let n = columns.period()?;
        let (means, within) = (columns.phases(n), columns.noise(n));
        let (_, between) = moments(&means);
        let factor = compensation(&means);
        let value = factor * (between - within).max(0.0).sqrt();
        let se = factor * within.sqrt() / (2.0 * (n as f64 - 1.0)).sqrt();
        Some(Self { period: n, sigma: Value::new(value, se) })
    }

    /// The proposal of an effect whose parameter `key` a map gave.
    fn proposal(
        &self,
        e: &Evidence<'_>,
        map: MapKind,
        effect: ReadoutChannelMismatch,
        key: &'static str,
    ) -> Option<Proposal> {
        let strength = period_deviation(e, map, self.period)?;
        let p = Proposal::new("readout-channel-mismatch", effect.into(), strength);
        Some(p.with("channels", Value::chosen(self.period as f64)).with(key, self.sigma))
    }
}

/// How many times larger the deviations of column phases were before each channel was divided by
/// its own mean: under a colour filter array phases that share no channel cannot be compared.
fn compensation(means: &[f64], channels: &Channels) -> f64 {
    let n = means.len();
    let middle = means.iter().sum::<f64>() / n as f64;
    let seen: Vec<f64> = means.iter().map(|m| m - middle).collect();
    let shares: Vec<Vec<f64>> = (0..n).map(|phase| channels.shares_of_columns(phase, n)).collect();
    // seen = whole - what the phase's channels have on average: a contraction.
    let mut whole = seen.clone();
    for _ in 0..TURNS {
        let average = |c: usize| {
            let total: f64 = shares.iter().map(|s| s[c]).sum();
            whole.iter().zip(&shares).map(|(w, s)| w * s[c]).sum::<f64>() / total.max(1e-12)
        };
        let averages: Vec<f64> = (0..channels.count()).map(average).collect();
        let taken = |s: &Vec<f64>| s.iter().zip(&averages).map(|(s, a)| s * a).sum::<f64>();
        whole = seen.iter().zip(&shares).map(|(m, s)| m + taken(s)).collect();
    }
    let power = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
    (power(&whole) / power(&seen).max(1e-300)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Cfa;
    use camrig_camera::Camera;

    #[test]
    fn phases_of_columns_are_told_from_channels_that_lie_in_one_of_them() {
        let mut camera = Camera::load("mt9t012").unwrap();
        // Of a Bayer sensor's columns the green pixels alone can be compared: half of the pixels,
        // half of the deviation.
        let bayer = Channels::new(&camera);
        assert!((compensation(&[1.001, 0.999], &bayer) - 2.0).abs() < 1e-6);
        // Pairs of like columns are compared whole.
        let same_parity = [1.001, 1.0, 0.999, 1.0];
        assert!((compensation(&same_parity, &bayer) - 1.0).abs() < 1e-6);
        camera.sensor.cfa = Cfa::parse("mono").unwrap();
        camera.sensor.channel_names.truncate(1);
        let monochrome = Channels::new(&camera);
        assert!((compensation(&[1.001, 0.999], &monochrome) - 1.0).abs() < 1e-6);
    }
}
