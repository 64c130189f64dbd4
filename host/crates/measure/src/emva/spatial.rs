//! DSNU1288 and PRNU1288, spectrograms and histograms from a pair of long stacks.

use super::profiles::Profiles;
use super::{ChannelEmva, saturation_index};
use crate::ladder::Level;
use crate::moments::SATURATED_SHARE;
use crate::spectrogram::{Histogram, SitePlane};
use crate::stack::Stack;
use crate::tolerance::SAME_EXPOSURE;
use camrig_base::Result;
use camrig_base::Value;

/// Fewest frames of a flat stack for spatial figures: below, the temporal noise that has to be
/// subtracted is larger than the patterns of most sensors.
const MIN_FRAMES: usize = 3;

/// Standard errors by which a level above the saturated one, the level of largest temporal
/// variance, must have less variance to be past saturation: by chance, one in 700 of equally
/// bright levels.
const LESS_VARIANCE: f64 = 3.0;

/// The stacks for the spatial figures, as indices into the darks and the levels.
pub(super) struct SpatialPair {
    pub dark: usize,
    pub flat: usize,
    pub flat_id: String,
    pub frames: usize,
    pub same_exposure: bool,
    /// For each channel, whether the flat is past saturation.
    pub past: Vec<bool>,
}

impl SpatialPair {
    /// Of the flats that are past saturation in the fewest channels, and have at least half the
    /// largest number of frames of those, the one nearest to half saturation of the channel that
    /// saturates first; and the dark of its exposure. `None` where all flats are past saturation
    /// in every channel.
    pub fn choose(darks: &[Level], levels: &[&Level]) -> Option<Self> {
        let channels = darks[0].channels.len();
        let saturations: Vec<usize> = (0..channels).map(|c| saturation_index(levels, c)).collect();
        let past = |i: usize| -> Vec<bool> {
            (0..channels).map(|c| is_past(levels, i, c, saturations[c])).collect()
        };
        let long: Vec<(usize, Vec<bool>)> = (0..levels.len())
            .filter(|&i| levels[i].channels[0].frames >= MIN_FRAMES)
            .map(|i| (i, past(i)))
            .collect();
        let number = |past: &[bool]| past.iter().filter(|p| **p).count();
        let fewest = long.iter().map(|l| number(&l.1)).min().filter(|n| *n < channels)?;
        let usable = || long.iter().filter(|l| number(&l.1) == fewest);
        let frames = |i: usize| levels[i].channels[0].frames;
        let most = usable().map(|l| frames(l.0)).max()?;
        let signal =
            |i: usize, c: usize| levels[i].channels[c].mean() - darks[0].channels[c].mean();
        // Where none saturates, the channel of largest signal is nearest to it.
        let first = (0..channels).min_by(|&a, &b| {
            let of = |c: usize| signal(saturations[c], c);
            saturations[a].cmp(&saturations[b]).then(of(b).total_cmp(&of(a)))
        })?;
        let off = |i: usize| (signal(i, first) - 0.5 * signal(saturations[first], first)).abs();
        let (chosen, past) = usable()
            .filter(|l| 2 * frames(l.0) >= most)
            .min_by(|a, b| off(a.0).total_cmp(&off(b.0)))?;
        let (dark, same_exposure) = nearest_dark(darks, levels[*chosen].exposure_s)?;
        Some(Self {
            dark,
            flat: *chosen,
            flat_id: levels[*chosen].id.clone(),
            frames: frames(*chosen),
            same_exposure,
            past: past.clone(),
        })
    }
}

/// Variance over pixels of a flat's means less that of a dark's, DN²: PRNU1288 is its root as a
/// share of the signal.
fn above_dark(flat: Value, dark: Value) -> Value {
    Value::new(flat.value - dark.value, libm::hypot(flat.std_error, dark.std_error))
}

/// PRNU1288 of a channel of light levels, from the stacks that the standard's spatial figures come
/// from; `None` where none is below saturation and long enough.
pub(crate) fn prnu_of_levels(darks: &[Level], levels: &[Level], channel: usize) -> Option<Value> {
    let pair = SpatialPair::choose(darks, &levels.iter().collect::<Vec<_>>())?;
    let [flat, dark] = [&levels[pair.flat], &darks[pair.dark]].map(|l| &l.channels[channel]);
    let variance = above_dark(flat.spatial().total, dark.spatial().total);
    let of_signal = 1.0 / (flat.mean() - dark.mean());
    variance.sqrt().filter(|_| !pair.past[channel]).map(|v| v.scaled(of_signal))
}

/// Whether a level is past saturation in a channel, given its saturated level: it has samples at
/// the white level or, with a full well below it, less variance than darker levels.
fn is_past(levels: &[&Level], level: usize, channel: usize, saturation: usize) -> bool {
    let (m, at) = (&levels[level].channels[channel], &levels[saturation].channels[channel]);
    let error = libm::hypot(at.temporal_error, m.temporal_error);
    let less = at.temporal - m.temporal > LESS_VARIANCE * error;
    m.whites >= SATURATED_SHARE || (level > saturation && less)
}

/// Index of the dark for a flat of an exposure time (s), and whether it is of that time: same
/// exposure first, then the longest stack, then the nearest exposure.
fn nearest_dark(darks: &[Level], exposure_s: f64) -> Option<(usize, bool)> {
    let apart = |i: usize| libm::log(darks[i].exposure_s / exposure_s).abs();
    let other = |i: usize| apart(i) > SAME_EXPOSURE;
    let frames = |i: usize| darks[i].channels[0].frames;
    let dark = (0..darks.len()).filter(|&i| frames(i) >= 2).min_by(|&a, &b| {
        other(a).cmp(&other(b)).then(frames(b).cmp(&frames(a))).then(apart(a).total_cmp(&apart(b)))
    })?;
    Some((dark, !other(dark)))
}

/// Step of a flat's mean minus a dark's after the high-pass filter, DN: means of F and D frames of
/// whole DN are multiples of 1/lcm(F, D), and the filter subtracts means of 25 of them.
fn high_passed(dark: &Stack, flat: &Stack) -> f64 {
    let (mut a, mut b) = (dark.frames, flat.frames);
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a.max(1) as f64 / (25.0 * dark.frames as f64 * flat.frames as f64)
}

/// Standard errors below 0 at which a component's variance contradicts the total instead of being
/// negative by chance: one in 700.
const CONTRADICTS: f64 = 3.0;

/// Row, column and pixel part of a total variance as the standard splits it: their sum is the
/// total (release 4.0, section 8.2). The estimate of a part smaller than its error can be
/// negative: it is not determined, and the others are scaled to the total. A significantly
/// negative part contradicts the total, and none is determined.
fn parts_of(total: f64, parts: &[Value; 3]) -> [Option<Value>; 3] {
    let contradicted = parts.iter().any(|v| v.value < -CONTRADICTS * v.std_error);
    if total <= 0.0 || contradicted {
        return [None; 3];
    }
    let positive: f64 = parts.iter().map(|v| v.value.max(0.0)).sum();
    let whole = parts.iter().all(|v| v.value > 0.0);
    let share = if whole { 1.0 } else { total / positive };
    parts.map(|part| (part.value > 0.0).then(|| part.scaled(share)))
}

/// A warning on the parts of a figure that are not determined.
fn parts_warning(
    figure: &str,
    name: &str,
    frames: usize,
    total: f64,
    parts: &[Option<Value>; 3],
) -> Option<String> {
    if total <= 0.0 {
        return Some(format!(
            "channel {name}: {figure} is not determined: the variance over pixels is not above \
             the residual temporal noise in means of {frames} frames; use more frames"
        ));
    }
    let names = ["row", "column", "pixel"].iter().zip(parts);
    let missing: Vec<&str> = names.filter(|p| p.1.is_none()).map(|p| *p.0).collect();
    let (some, is) = match missing.len() {
        0 => return None,
        3 => {
            return Some(format!(
                "channel {name}: the parts of {figure} are not determined: rows and columns would \
                 be above the total, from which more temporal noise is taken off than means of \
                 {frames} frames have (correlated frames, or patterns that drift)"
            ));
        }
        1 => ("part", "is"),
        _ => ("parts", "are"),
    };
    Some(format!(
        "channel {name}: the {} {some} of {figure} {is} not determined (smaller than the error \
         with {frames} frames); the others are scaled to the total",
        missing.join(" and ")
    ))
}

/// Adds the spatial figures of channel `c`; those of the flat only where it is below saturation.
pub(super) fn spatial_figures(
    out: &mut ChannelEmva,
    dark: &Stack,
    flat: Option<&Stack>,
    c: usize,
    warnings: &mut Vec<String>,
) -> Result<()> {
    dsnu_figures(out, dark, c, warnings);
    match flat {
        Some(flat) => prnu_figures(out, dark, flat, c, warnings),
        None => warnings.push(format!(
            "channel {}: PRNU1288 is not determined: the channel is past saturation in every flat \
             stack of three or more frames that the spatial figures can come from",
            out.channel
        )),
    }
    // Spectra and histograms are those of the channel's first site; sites of one channel are
    // alike.
    let Some(&site) = dark.sites.iter().find(|s| s.channel == c) else { return Ok(()) };
    let shape = (dark.width, dark.height);
    let per_frame = |s: &Stack| 1.0 / s.frames as f64;
    let dark_mean = (&dark.sum[..], per_frame(dark));
    let plane = SitePlane::of(site, shape, &[dark_mean], Vec::new());
    out.spectrogram_dark = Some(plane.spectrogram()?);
    out.histogram_dsnu = Some(Histogram::of(&plane.data, per_frame(dark)));
    let Some(flat) = flat else { return Ok(()) };
    let of_dark = Profiles::of(&plane);
    let terms = [(&flat.sum[..], per_frame(flat)), (dark_mean.0, -dark_mean.1)];
    let plane = SitePlane::of(site, shape, &terms, plane.data);
    out.spectrogram_prnu = Some(plane.spectrogram()?);
    out.profiles = Some([of_dark, Profiles::of(&plane)]);
    out.histogram_prnu = Some(Histogram::of(&plane.high_pass(), high_passed(dark, flat)));
    Ok(())
}

/// Fills in DSNU1288 and its parts.
fn dsnu_figures(out: &mut ChannelEmva, dark: &Stack, c: usize, warnings: &mut Vec<String>) {
    let spatial = dark.channel_moments(c).spatial();
    let figures = &mut out.figures;
    let Some(k) = figures.overall_system_gain else { return };
    let dsnu = |v: Value| Some(v.sqrt()?.over(k));
    let total = spatial.total.value;
    let parts = parts_of(total, &[spatial.row, spatial.column, spatial.pixel]);
    warnings.extend(parts_warning("DSNU1288", &out.channel, dark.frames, total, &parts));
    figures.dsnu_1288_e = dsnu(spatial.total);
    [figures.dsnu_1288_row_e, figures.dsnu_1288_column_e, figures.dsnu_1288_pixel_e] =
        parts.map(|v| v.and_then(dsnu));
}

/// Fills in PRNU1288 and its parts.
fn prnu_figures(
    out: &mut ChannelEmva,
    dark: &Stack,
    flat: &Stack,
    c: usize,
    warnings: &mut Vec<String>,
) {
    let (d, f) = (dark.channel_moments(c), flat.channel_moments(c));
    let (ds, fs) = (d.spatial(), f.spatial());
    let signal = f.mean() - d.mean();
    let prnu = |v: Value| Some(v.sqrt()?.scaled(100.0 / signal));
    let total = above_dark(fs.total, ds.total);
    let parts = [(fs.row, ds.row), (fs.column, ds.column), (fs.pixel, ds.pixel)];
    let parts = parts_of(total.value, &parts.map(|(f, d)| above_dark(f, d)));
    let frames = flat.frames.min(dark.frames);
    warnings.extend(parts_warning("PRNU1288", &out.channel, frames, total.value, &parts));
    let figures = &mut out.figures;
    figures.prnu_1288_percent = prnu(total);
    [
        figures.prnu_1288_row_percent,
        figures.prnu_1288_column_percent,
        figures.prnu_1288_pixel_percent,
    ] = parts.map(|v| v.and_then(prnu));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_make_up_the_total_and_none_is_above_it() {
        let of = |total: f64, values: [f64; 3]| {
            parts_of(total, &values.map(|v| Value::new(v, 1.0))).map(|v| v.map(|v| v.value))
        };
        // As split: the sum is the total, parts may be negative.
        assert_eq!(of(9.0, [4.0, 3.0, 2.0]), [Some(4.0), Some(3.0), Some(2.0)]);
        // 13 + 1 - 2 = 12: the two that are left are 12 together, in their proportion.
        let [row, column, pixel] = of(12.0, [13.0, 1.0, -2.0]);
        let (row, column) = (row.unwrap(), column.unwrap());
        assert!((row + column - 12.0).abs() < 1e-12 && (row / column - 13.0).abs() < 1e-12);
        assert_eq!(pixel, None);
        assert_eq!(of(-1.0, [3.0, -2.0, -2.0]), [None; 3]);
        assert_eq!(of(6.0, [9.0, 1.0, -4.0]), [None; 3]);

        let one = Some(Value::new(0.3, 0.1));
        let warning = parts_warning("DSNU1288", "m", 4, 6.0, &[None; 3]).unwrap();
        assert!(warning.contains("the parts of DSNU1288 are not determined"), "{warning}");
        let warning = parts_warning("DSNU1288", "m", 4, 12.0, &[one, None, None]).unwrap();
        assert!(warning.contains("the column and pixel parts of DSNU1288 are not determined"));
        let warning = parts_warning("PRNU1288", "m", 4, -1.0, &[None; 3]).unwrap();
        assert!(
            warning.contains("PRNU1288 is not determined") && warning.contains("4 frames"),
            "{warning}"
        );
        assert_eq!(parts_warning("PRNU1288", "m", 4, 1.0, &[one; 3]), None);
    }
}
