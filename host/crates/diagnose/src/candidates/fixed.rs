//! Candidates that are fixed patterns: they show in maps.

use super::{Proposal, deviation, list};
use crate::channels::Channels;
use crate::evidence::{Estimated, Evidence, pooled};
use crate::maps::{MapKind, long_dark, reference_dark};
use crate::model::current;
use crate::spatial::{PERIODS, phase_means};
use crate::statistics::{Place, What};
use camrig_base::Plane;
use camrig_base::median::median;
use camrig_captures::Role;
use camrig_sensor_core::effects::{
    Effect, column_gain_fpn::ColumnGainFpn, column_offset_fpn::ColumnOffsetFpn,
    dark_current::DarkCurrent, dark_current_gradient::DarkCurrentGradient,
    defective_pixels::DefectivePixels, green_imbalance::GreenImbalance, hot_pixels::HotPixels,
    pixel_offset_fpn::PixelOffsetFpn, prnu::Prnu, prnu_correlated::PrnuCorrelated,
    readout_channel_mismatch::ReadoutChannelMismatch, row_offset_fpn::RowOffsetFpn,
};

/// Excess of a variance in a map, in units of `unit`².
fn excess(e: &Evidence<'_>, map: MapKind, what: What, unit: f64) -> Option<Estimated> {
    let x = e.difference(Place::Map(map), what)?;
    Some(Estimated { value: x.value / (unit * unit), se: x.se / (unit * unit) })
}

/// A standard deviation from the excess of a variance.
fn spread(
    kind: &'static str,
    key: &'static str,
    present: f64,
    excess: Option<Estimated>,
    effect: impl Fn(f32) -> Effect,
) -> Vec<Proposal> {
    list((|| {
        let excess = excess?;
        let s = deviation(present, excess)?;
        Some(Proposal::new(kind, effect(s.value as f32), excess.z().abs()).with(key, s.value, s.se))
    })())
}

/// Variance of row means of the offset map.
pub fn row_offset(e: &Evidence<'_>) -> Vec<Proposal> {
    let x = e.reference_gain().and_then(|k| excess(e, MapKind::Offset, What::RowPattern, k));
    let present = e.camera.sensor.noise.row_fpn_e;
    spread("row-offset-fpn", "sigma_e", present, x, |s| RowOffsetFpn { sigma_e: s }.into())
}

/// Variance of column means of the offset map.
pub fn column_offset(e: &Evidence<'_>) -> Vec<Proposal> {
    let x = e.reference_gain().and_then(|k| excess(e, MapKind::Offset, What::ColumnPattern, k));
    let present = match current(e.camera, "column-offset-fpn") {
        Some(Effect::ColumnOffsetFpn(x)) => f64::from(x.sigma_e),
        _ => 0.0,
    };
    spread("column-offset-fpn", "sigma_e", present, x, |s| ColumnOffsetFpn { sigma_e: s }.into())
}

/// Variance of the pixels of the offset map.
pub fn pixel_offset(e: &Evidence<'_>) -> Vec<Proposal> {
    let x = e.reference_gain().and_then(|k| excess(e, MapKind::Offset, What::PixelPattern, k));
    let present = match current(e.camera, "pixel-offset-fpn") {
        Some(Effect::PixelOffsetFpn(x)) => f64::from(x.sigma_e),
        _ => 0.0,
    };
    spread("pixel-offset-fpn", "sigma_e", present, x, |s| PixelOffsetFpn { sigma_e: s }.into())
}

/// Columns that repeat every few columns, in the offset map.
pub fn readout_channels(e: &Evidence<'_>) -> Vec<Proposal> {
    let mut out = Vec::new();
    for (map, gain) in [(MapKind::Offset, false), (MapKind::Gain, true)] {
        let made = (|| {
            let z = |i: usize| {
                if i == 0 {
                    let d = e.difference(Place::Map(map), What::EveryOtherColumn)?;
                    return Some(d.z().abs());
                }
                let p = e.model.of.get(&(Place::Map(map), What::ColumnPeriod(i as u8)))?;
                let s = e.data.get(&(Place::Map(map), What::ColumnPeriod(i as u8)))?;
                Some((p.scale.of(s.value) - p.scaled) / p.sd)
            };
            let spatial = &e.map(map)?.spatial;
            let columns = &spatial.columns;
            let unit = if gain { 1.0 } else { e.reference_gain()? };
            let means = |n: usize| -> Vec<f64> {
                phase_means(columns, n).into_iter().map(|m| m / unit).collect()
            };
            let scatter = |n: usize| {
                spatial.column_variance / (unit * unit) * n as f64 / columns.len() as f64
            };
            // The period that leaves least of the means of the longest, each mean paid for by ln N (Schwarz 1978).
            let longest = PERIODS[PERIODS.len() - 1];
            let all = means(longest);
            let left = |n: usize| {
                let own = means(n);
                let squares = all.iter().enumerate().map(|(p, m)| (m - own[p % n]).powi(2));
                squares.sum::<f64>() / scatter(longest) + (columns.len() as f64).ln() * n as f64
            };
            let best = (0..PERIODS.len())
                .min_by(|&a, &b| left(PERIODS[a]).total_cmp(&left(PERIODS[b])))?;
            let n = PERIODS[best];
            let (means, within) = (means(n), scatter(n));
            let m = means.iter().sum::<f64>() / n as f64;
            let between = means.iter().map(|x| (x - m).powi(2)).sum::<f64>() / (n as f64 - 1.0);
            let hidden =
                if gain { taken_with_channels(&means, &Channels::new(e.camera)) } else { 1.0 };
            let sigma = hidden * (between - within).max(0.0).sqrt();
            let se = hidden * within.sqrt() / (2.0 * (n as f64 - 1.0)).sqrt();
            let (mut offset_e, mut relative) = match current(e.camera, "readout-channel-mismatch") {
                Some(Effect::ReadoutChannelMismatch(x)) if x.channels == n as f32 => {
                    (x.offset_e, x.gain)
                }
                _ => (0.0, 0.0),
            };
            let key = if gain {
                relative = sigma as f32;
                "gain"
            } else {
                offset_e = sigma as f32;
                "offset_e"
            };
            let effect = ReadoutChannelMismatch { channels: n as f32, offset_e, gain: relative };
            Some(
                Proposal::new("readout-channel-mismatch", effect.into(), z(best)?)
                    .with("channels", n as f64, f64::NAN)
                    .with(key, sigma, se),
            )
        })();
        out.extend(made);
    }
    out
}

/// How many times larger the deviations of column phases were before each channel was divided by its own mean: under a colour
/// filter array phases that share no channel cannot be compared.
fn taken_with_channels(means: &[f64], channels: &Channels) -> f64 {
    let n = means.len();
    let middle = means.iter().sum::<f64>() / n as f64;
    let seen: Vec<f64> = means.iter().map(|m| m - middle).collect();
    let shares: Vec<Vec<f64>> = (0..n).map(|phase| channels.shares_of_columns(phase, n)).collect();
    // seen = whole - what the phase's channels have on average: a contraction, some halving per turn.
    let mut whole = seen.clone();
    for _ in 0..30 {
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

/// Outliers of the dark-current map, else of the offset map.
pub fn hot_pixels(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let (kind, per_unit) = match long_dark(e.design) {
            Some(_) => (MapKind::DarkCurrent, 1.0),
            None => {
                let c = &e.design.conditions[reference_dark(e.design)?];
                (MapKind::Offset, 1.0 / (e.gain(c) * c.exposure_s))
            }
        };
        let s = &e.map(kind)?.spatial;
        let n = (s.rows.len() * s.columns.len()) as f64;
        let limit = 5.5 * s.pixel_variance.sqrt();
        let expected = e.predicted(Place::Map(kind), What::High)?;
        let noise = &e.camera.sensor.noise;
        let held_fraction = match current(e.camera, "hot-pixels") {
            Some(Effect::HotPixels(x)) => f64::from(x.fraction),
            _ => 0.0,
        };
        if s.high < 1.0 {
            return None;
        }
        // Beyond a limit an exponential law has its mean above it.
        let mean = ((s.high_sum / s.high - limit) * per_unit).max(0.05 * limit * per_unit);
        let more = (s.high - expected).max(0.0);
        let fraction = if held_fraction > 0.0 {
            held_fraction * (s.high / expected.max(1.0))
        } else {
            more / n * (limit * per_unit / mean).exp()
        };
        let z = crate::tails::count(s.high, expected * 16.0, 16.0);
        // The growth with temperature was not looked at: the dark current's serves. The map was taken at the long dark's.
        let growth = match long_dark(e.design) {
            Some(i) => ((e.design.conditions[i].temperature_c - noise.temperature_ref_c)
                / noise.dark_doubling_c)
                .exp2(),
            None => 1.0,
        };
        let mean = mean / growth;
        let effect = HotPixels {
            fraction: fraction.min(0.1) as f32,
            mean_e_per_s: mean as f32,
            doubling_c: noise.dark_doubling_c as f32,
            reference_c: noise.temperature_ref_c as f32,
        };
        Some(
            Proposal::new("hot-pixels", effect.into(), z)
                .with("fraction", fraction, fraction / more.max(1.0).sqrt() * 1.5)
                .with("mean_e_per_s", mean, mean / s.high.sqrt()),
        )
    })())
}

/// Mean and spread of dark current.
pub fn dark_current(e: &Evidence<'_>) -> Vec<Proposal> {
    let noise = e.camera.sensor.noise;
    let growth_at = |t: f64| ((t - noise.temperature_ref_c) / noise.dark_doubling_c).exp2();
    let made = (|| {
        let reference = &e.design.conditions[reference_dark(e.design)?];
        // Rise of the mean with exposure at the reference's temperature.
        let rate = pooled(e.of_role(Role::Dark).flat_map(|(i, c)| {
            let classes = e.camera.sensor.channel_names.len() as u8;
            let time = c.exposure_s - reference.exposure_s;
            let usable = time > 0.0
                && (c.temperature_c - reference.temperature_c).abs() < 0.5
                && c.before_e.iter().all(|&b| b == 0.0);
            let scale = e.gain(c) * time * growth_at(c.temperature_c);
            (0..classes).filter(move |_| usable).filter_map(move |k| {
                let d = e.difference(Place::Stack(i), What::Mean(k))?;
                Some(Estimated { value: d.value / scale, se: d.se / scale })
            })
        }));
        let map = MapKind::DarkCurrent;
        let spread = e.difference(Place::Map(map), What::PixelPattern).map(|x| {
            let g = growth_at(reference.temperature_c).powi(2);
            Estimated { value: x.value / g, se: x.se / g }
        });
        Some((rate, spread))
    })();
    let Some((rate, spread)) = made else { return Vec::new() };
    let effect = |mean: f64, dsnu: f64| -> Effect {
        DarkCurrent {
            mean_e_per_s: mean as f32,
            dsnu_e_per_s: dsnu as f32,
            doubling_c: noise.dark_doubling_c as f32,
            reference_c: noise.temperature_ref_c as f32,
        }
        .into()
    };
    let mut out = Vec::new();
    let (mean, dsnu) = (noise.dark_current_e_per_s, noise.dsnu_e_per_s);
    let new_mean = rate.map(|r| Estimated { value: (mean + r.value).max(0.0), se: r.se });
    let new_dsnu = spread.and_then(|s| deviation(dsnu, s));
    if let (Some(r), Some(m)) = (rate, new_mean) {
        out.push(Proposal::new("dark-current", effect(m.value, dsnu), r.z().abs()).with(
            "mean_e_per_s",
            m.value,
            m.se,
        ));
    }
    if let (Some(x), Some(s)) = (spread, new_dsnu) {
        out.push(Proposal::new("dark-current", effect(mean, s.value), x.z().abs()).with(
            "dsnu_e_per_s",
            s.value,
            s.se,
        ));
        if let (Some(r), Some(m)) = (rate, new_mean) {
            out.push(
                Proposal::new(
                    "dark-current",
                    effect(m.value, s.value),
                    r.z().abs().min(x.z().abs()),
                )
                .with("mean_e_per_s", m.value, m.se)
                .with("dsnu_e_per_s", s.value, s.se),
            );
        }
    }
    out
}

/// Dark signal at other temperatures.
pub fn doubling(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let noise = e.camera.sensor.noise;
        let reference = &e.design.conditions[reference_dark(e.design)?];
        let of_channel = |(i, channel): (usize, u8)| {
            let c = &e.design.conditions[i];
            let dt = c.temperature_c - reference.temperature_c;
            let from_ref = c.temperature_c - noise.temperature_ref_c;
            if dt.abs() < 2.0 || from_ref.abs() < 2.0 || c.before_e.iter().any(|&b| b > 0.0) {
                return None;
            }
            let place = Place::Stack(i);
            let d = e.difference(place, What::Mean(channel))?;
            let scale = e.gain(c) * c.exposure_s;
            let model = noise.dark_current_e_per_s * (from_ref / noise.dark_doubling_c).exp2();
            let ratio = 1.0 + d.value / scale / model;
            if ratio <= 0.0 {
                return None;
            }
            // ln 2 (T − T_ref)/T_d' = ln 2 (T − T_ref)/T_d + ln ratio.
            let per_k = ratio.ln() / (std::f64::consts::LN_2 * from_ref);
            let se = d.se / scale / model / ratio / (std::f64::consts::LN_2 * from_ref.abs());
            Some(Estimated { value: per_k, se })
        };
        let classes = e.camera.sensor.channel_names.len() as u8;
        let all = e.of_role(Role::Dark).flat_map(|(i, _)| (0..classes).map(move |k| (i, k)));
        let shift = pooled(all.filter_map(of_channel))?;
        let inverse = 1.0 / noise.dark_doubling_c + shift.value;
        if inverse <= 0.01 {
            return None;
        }
        let value = 1.0 / inverse;
        let effect = DarkCurrent {
            mean_e_per_s: noise.dark_current_e_per_s as f32,
            dsnu_e_per_s: noise.dsnu_e_per_s as f32,
            doubling_c: value as f32,
            reference_c: noise.temperature_ref_c as f32,
        };
        Some(Proposal::new("dark-current-temperature", effect.into(), shift.z().abs()).with(
            "doubling_c",
            value,
            shift.se * value * value,
        ))
    })())
}

/// Means over 16x16 pixels, those further than `clip` from the block's median held, and where they are: (u, v, value).
pub(super) fn block_means(plane: &Plane<f32>, clip: f64) -> Vec<(f64, f64, f64)> {
    let (w, h) = (plane.width, plane.height);
    let clip = clip as f32;
    let (mut out, mut block) = (Vec::new(), Vec::with_capacity(256));
    for by in 0..h / 16 {
        for bx in 0..w / 16 {
            block.clear();
            for row in plane.data.chunks(w).skip(by * 16).take(16) {
                block.extend_from_slice(&row[bx * 16..bx * 16 + 16]);
            }
            let middle = median(&mut block, f32::total_cmp);
            let sum: f64 =
                block.iter().map(|&v| f64::from(v.clamp(middle - clip, middle + clip))).sum();
            let u = (bx as f64 * 16.0 + 8.0) / w as f64 * 2.0 - 1.0;
            let v = (by as f64 * 16.0 + 8.0) / h as f64 * 2.0 - 1.0;
            out.push((u, v, sum / 256.0));
        }
    }
    out
}

/// Least-squares amplitude of a template on block means, both without their means, and what it explains.
pub(super) fn amplitude(
    blocks: &[(f64, f64, f64)],
    template: impl Fn(f64, f64) -> f64,
) -> (f64, f64, f64) {
    let n = blocks.len() as f64;
    let t: Vec<f64> = blocks.iter().map(|b| template(b.0, b.1)).collect();
    let (mt, mb) = (t.iter().sum::<f64>() / n, blocks.iter().map(|b| b.2).sum::<f64>() / n);
    let (mut tb, mut tt) = (0.0, 0.0);
    for (t, b) in t.iter().zip(blocks) {
        tb += (t - mt) * (b.2 - mb);
        tt += (t - mt).powi(2);
    }
    (tb / tt.max(1e-300), tt, tb * tb / tt.max(1e-300))
}

/// A slope in the dark-current map.
pub fn gradient(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        if current(e.camera, "dark-current-gradient").is_some() {
            return None;
        }
        let of = |i| e.difference(Place::Map(MapKind::DarkCurrent), What::Slope(i));
        let (x, y) = (of(0)?, of(1)?);
        let noise = &e.camera.sensor.noise;
        let long = &e.design.conditions[long_dark(e.design)?];
        let growth =
            ((long.temperature_c - noise.temperature_ref_c) / noise.dark_doubling_c).exp2();
        // rate (1 + u cos θ)/2 is an amplitude of rate/(2√3) of √3u.
        let rate = 2.0 * 3f64.sqrt() * x.value.hypot(y.value) / growth;
        let direction = y.value.atan2(x.value).to_degrees();
        let effect = DarkCurrentGradient {
            rate_e_per_s: rate as f32,
            direction_deg: direction as f32,
            doubling_c: noise.dark_doubling_c as f32,
            reference_c: noise.temperature_ref_c as f32,
        };
        // The gradient's own mean, rate/2, is no part of the mean that was there.
        let mean = DarkCurrent {
            mean_e_per_s: (noise.dark_current_e_per_s - rate / 2.0).max(0.0) as f32,
            dsnu_e_per_s: noise.dsnu_e_per_s as f32,
            doubling_c: noise.dark_doubling_c as f32,
            reference_c: noise.temperature_ref_c as f32,
        };
        Some(
            Proposal::new("dark-current-gradient", effect.into(), x.z().hypot(y.z()))
                .and(mean.into())
                .with("rate_e_per_s", rate, x.se * 2.0 * 3f64.sqrt() / growth)
                .with("direction_deg", direction, (x.se / x.value.hypot(y.value)).to_degrees()),
        )
    })())
}

/// Variance of the pixels of the gain map.
pub fn prnu(e: &Evidence<'_>) -> Vec<Proposal> {
    let x = excess(e, MapKind::Gain, What::PixelPattern, 1.0);
    spread("prnu", "sigma", e.camera.sensor.noise.prnu, x, |s| Prnu { sigma: s }.into())
}

/// Covariance of neighbours in the gain map, and what the pixels' variance has more; where it has not as much more, the
/// pixels' own spread is as much less.
pub fn prnu_correlated(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let place = Place::Map(MapKind::Gain);
        let variance = e.map(MapKind::Gain)?.spatial.pixel_variance;
        // Neighbours beside, below and diagonally share this much of the variance: least squares.
        let shares = [0.5, 0.5, 0.25];
        let squares: f64 = shares.iter().map(|s| s * s).sum();
        let (mut value, mut doubt) = (0.0, 0.0);
        for (i, share) in shares.into_iter().enumerate() {
            let d = e.difference(place, What::MapCovariance(i as u8))?;
            value += variance * share * d.value / squares;
            doubt += (variance * share * d.se / squares).powi(2);
        }
        let shared = Estimated { value, se: doubt.sqrt() };
        let more = excess(e, MapKind::Gain, What::PixelPattern, 1.0)?;
        let own = Estimated { value: more.value - shared.value, se: more.se.hypot(shared.se) };
        let own_changes = own.z().abs() > 2.0;
        let added = if own_changes { shared } else { pooled([shared, more])? };
        let present = match current(e.camera, "prnu-correlated") {
            Some(Effect::PrnuCorrelated(x)) => f64::from(x.sigma),
            _ => 0.0,
        };
        let s = deviation(present, added)?;
        let effect = PrnuCorrelated { sigma: s.value as f32 };
        let p = Proposal::new("prnu-correlated", effect.into(), added.z().abs());
        let p = p.with("sigma", s.value, s.se);
        let prnu = e.camera.sensor.noise.prnu;
        Some(match own_changes {
            true => p.and(Prnu { sigma: (prnu * prnu + own.value).max(0.0).sqrt() as f32 }.into()),
            false => p,
        })
    })())
}

/// Variance of the columns of the gain map.
pub fn column_gain(e: &Evidence<'_>) -> Vec<Proposal> {
    let x = excess(e, MapKind::Gain, What::ColumnPattern, 1.0);
    let present = match current(e.camera, "column-gain-fpn") {
        Some(Effect::ColumnGainFpn(x)) => f64::from(x.sigma),
        _ => 0.0,
    };
    spread("column-gain-fpn", "sigma", present, x, |s| ColumnGainFpn { sigma: s }.into())
}

/// Contrast of the greens in the gain map.
pub fn green_imbalance(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let cfa = &e.camera.sensor.cfa;
        if (cfa.width, cfa.height) != (2, 2) {
            return None;
        }
        // Which of the two diagonals is green, and whether its first member is in a row with red; the second is in another
        // row and column than the first.
        let green = |x, y| cfa.letter(x, y) == 'G';
        let (left_first, first_row) = if green(0, 0) && green(1, 1) {
            (true, 0)
        } else if green(1, 0) && green(0, 1) {
            (false, 0)
        } else {
            return None;
        };
        let red_first = (0..2).any(|x| cfa.letter(x, first_row) == 'R');
        let of = |what| e.difference(Place::Map(MapKind::Gain), what);
        let (rows, columns) = (of(What::EveryOtherRow)?, of(What::EveryOtherColumn)?);
        let value = rows.value + if left_first { columns.value } else { -columns.value };
        let d = Estimated { value, se: rows.se.hypot(columns.se) };
        let sign = if red_first { 1.0 } else { -1.0 };
        let present = match current(e.camera, "green-imbalance") {
            Some(Effect::GreenImbalance(x)) => f64::from(x.centre),
            _ => 0.0,
        };
        let value = present + sign * d.value;
        let effect = GreenImbalance { centre: value as f32, corner: value as f32 };
        Some(
            Proposal::new("green-imbalance", effect.into(), d.z().abs())
                .with("centre", value, d.se),
        )
    })())
}

/// Low outliers of the gain map.
pub fn defects(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let place = Place::Map(MapKind::Gain);
        let s = &e.map(MapKind::Gain)?.spatial;
        let n = (s.rows.len() * s.columns.len()) as f64;
        let expected = e.predicted(place, What::Low)?;
        let z = crate::tails::count(s.low, expected * 16.0, 16.0);
        if s.low < 1.0 {
            return None;
        }
        let held = match current(e.camera, "defective-pixels") {
            Some(Effect::DefectivePixels(x)) => Some(f64::from(x.fraction)),
            _ => None,
        };
        let gain = (1.0 + s.low_sum / s.low).clamp(0.0, 1.0);
        let fraction = match held {
            Some(f) => f * s.low / expected.max(1.0),
            None => (s.low - expected).max(0.0) / n,
        };
        let effect = DefectivePixels { fraction: fraction as f32, gain: gain as f32 };
        Some(
            Proposal::new("defective-pixels", effect.into(), z)
                .with("fraction", fraction, fraction / s.low.sqrt())
                .with("gain", gain, s.pixel_variance.sqrt() / s.low.sqrt()),
        )
    })())
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Cfa;
    use camrig_camera::Camera;

    #[test]
    fn phases_of_columns_are_told_from_channels_that_lie_in_one_of_them() {
        let mut camera = Camera::load("mt9t012").unwrap();
        // Of a Bayer sensor's columns the green pixels alone can be compared: half of the pixels, half of the deviation.
        let bayer = Channels::new(&camera);
        assert!((taken_with_channels(&[1.001, 0.999], &bayer) - 2.0).abs() < 1e-6);
        // Pairs of like columns are compared whole.
        let same_parity = [1.001, 1.0, 0.999, 1.0];
        assert!((taken_with_channels(&same_parity, &bayer) - 1.0).abs() < 1e-6);
        camera.sensor.cfa = Cfa::parse("mono").unwrap();
        camera.sensor.channel_names.truncate(1);
        let monochrome = Channels::new(&camera);
        assert!((taken_with_channels(&[1.001, 0.999], &monochrome) - 1.0).abs() < 1e-6);
    }
}
