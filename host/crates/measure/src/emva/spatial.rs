//! DSNU1288 and PRNU1288, spectrograms and histograms from a pair of long stacks.

use super::profiles::Profiles;
use super::{ChannelEmva, saturation_index};
use crate::dark::SAME_EXPOSURE;
use crate::ladder::Level;
use crate::moments::SATURATED_SHARE;
use crate::spectrogram::{Histogram, SitePlane};
use crate::stack::Stack;
use crate::value::Value;
use camrig_base::Result;

/// Fewest frames of a flat stack for spatial figures: below, the temporal noise that has to be
/// subtracted is larger than the patterns of most sensors.
const LEAST_FRAMES: usize = 3;

/// The stacks for the spatial figures, as indices into the selection.
pub(super) struct SpatialPair {
    pub dark: usize,
    pub flat: usize,
    pub flat_id: String,
    pub frames: usize,
    pub same_exposure: bool,
}

impl SpatialPair {
    /// The flat nearest to half saturation among those of at least half the largest number of
    /// frames, and the dark of its exposure.
    pub fn choose(darks: &[Level], flats: &[(usize, Level)]) -> Option<Self> {
        let saturation = saturation_index(&flats.iter().map(|f| &f.1).collect::<Vec<_>>(), 0);
        let dark_mean = darks[0].channels[0].mean();
        let half = 0.5 * (flats[saturation].1.channels[0].mean() - dark_mean);
        let usable = |l: &&(usize, Level)| {
            let m = &l.1.channels[0];
            m.frames >= LEAST_FRAMES && m.whites < SATURATED_SHARE
        };
        let most = flats.iter().filter(usable).map(|f| f.1.channels[0].frames).max()?;
        let off = |l: &Level| (l.channels[0].mean() - dark_mean - half).abs();
        let (flat, level) = flats
            .iter()
            .filter(usable)
            .filter(|f| 2 * f.1.channels[0].frames >= most)
            .min_by(|a, b| off(&a.1).total_cmp(&off(&b.1)))?;
        let apart = |d: &Level| (d.exposure_s / level.exposure_s).ln().abs();
        let dark =
            (0..darks.len()).filter(|&i| darks[i].channels[0].frames >= 2).min_by(|&a, &b| {
                let key =
                    |i: usize| (apart(&darks[i]) > SAME_EXPOSURE, darks[i].channels[0].frames);
                // Same exposure first, then the longest stack, then the nearest exposure.
                let (ka, kb) = (key(a), key(b));
                ka.0.cmp(&kb.0)
                    .then(kb.1.cmp(&ka.1))
                    .then(apart(&darks[a]).total_cmp(&apart(&darks[b])))
            })?;
        Some(Self {
            dark,
            flat: *flat,
            flat_id: level.id.clone(),
            frames: level.channels[0].frames,
            same_exposure: apart(&darks[dark]) <= SAME_EXPOSURE,
        })
    }
}

/// Step of a flat's mean less a dark's after the high-pass filter, DN: means of F and D frames of
/// whole DN lie on multiples of 1/lcm(F, D), and the filter takes off means of 25 of them.
fn high_passed(dark: &Stack, flat: &Stack) -> f64 {
    let (mut a, mut b) = (dark.frames, flat.frames);
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a.max(1) as f64 / (25.0 * dark.frames as f64 * flat.frames as f64)
}

/// Standard errors below 0 from which a part's variance contradicts the total, instead of being a
/// small one that chance made negative: one in 700.
const CONTRADICTS: f64 = 3.0;

/// Row, column and pixel part of a total variance as the standard splits it: their sum is the
/// total (release 4.0, section 8.2). A part that is smaller than its error can come out negative:
/// it is not determined, and the others make up the total. A part that is negative beyond its
/// error contradicts the total, and none is determined.
fn parts_of(total: f64, parts: &[Value; 3]) -> [Option<f64>; 3] {
    let contradicted = parts.iter().any(|v| v.value < -CONTRADICTS * v.std_error);
    if total <= 0.0 || contradicted {
        return [None; 3];
    }
    let positive: f64 = parts.iter().map(|v| v.value.max(0.0)).sum();
    let whole = parts.iter().all(|v| v.value > 0.0);
    let share = if whole { 1.0 } else { total / positive };
    std::array::from_fn(|i| (parts[i].value > 0.0).then_some(parts[i].value * share))
}

/// Says which parts of a figure are not determined.
fn parts_warning(
    figure: &str,
    name: &str,
    frames: usize,
    total: f64,
    parts: &[Option<f64>; 3],
) -> Option<String> {
    if total <= 0.0 {
        return Some(format!(
            "channel {name}: {figure} is not determined: the variance over pixels is not above \
             the temporal noise left in means of {frames} frames; more frames lower it"
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
         that {frames} frames leave); the others are scaled to make up the total",
        missing.join(" and ")
    ))
}

/// Fills in the spatial figures of channel `c` from the pair.
pub(super) fn spatial_figures(
    out: &mut ChannelEmva,
    dark: &Stack,
    flat: &Stack,
    c: usize,
    warnings: &mut Vec<String>,
) -> Result<()> {
    let (d, f) = (dark.channel_moments(c), flat.channel_moments(c));
    let (ds, fs) = (d.spatial(), f.spatial());
    let k = out.figures.overall_system_gain;
    let signal = f.mean() - d.mean();
    let dsnu = |v: f64| v.sqrt() / k;
    let prnu = |v: f64| 100.0 * v.sqrt() / signal;
    let of_dark = [ds.row, ds.column, ds.pixel];
    let of_flat = [fs.row, fs.column, fs.pixel];
    let above = |i: usize| {
        let error = of_flat[i].std_error.hypot(of_dark[i].std_error);
        Value::new(of_flat[i].value - of_dark[i].value, error)
    };
    let (dark_total, total) = (ds.total.value, fs.total.value - ds.total.value);
    let dark_parts = parts_of(dark_total, &of_dark);
    let parts = parts_of(total, &std::array::from_fn(above));
    let name = out.channel.clone();
    warnings.extend(parts_warning("DSNU1288", &name, dark.frames, dark_total, &dark_parts));
    let frames = flat.frames.min(dark.frames);
    warnings.extend(parts_warning("PRNU1288", &name, frames, total, &parts));
    let figures = &mut out.figures;
    figures.dsnu_1288_e = (dark_total > 0.0).then(|| dsnu(dark_total));
    [figures.dsnu_1288_row_e, figures.dsnu_1288_column_e, figures.dsnu_1288_pixel_e] =
        dark_parts.map(|v| v.map(dsnu));
    figures.prnu_1288_percent = (total > 0.0).then(|| prnu(total));
    [
        figures.prnu_1288_row_percent,
        figures.prnu_1288_column_percent,
        figures.prnu_1288_pixel_percent,
    ] = parts.map(|v| v.map(prnu));
    out.std_errors.dsnu_1288_e =
        figures.dsnu_1288_e.map(|s| 0.5 * ds.total.std_error / (s * k * k));
    out.std_errors.prnu_1288_percent = figures.prnu_1288_percent.map(|p| {
        let error = fs.total.std_error.hypot(ds.total.std_error);
        0.5 * error * (100.0 / signal).powi(2) / p
    });
    // Spectra and histograms are those of the channel's first site; sites of one channel are
    // alike.
    let Some(&site) = flat.sites.iter().find(|s| s.channel == c) else { return Ok(()) };
    let shape = (flat.width, flat.height);
    let per_frame = |s: &Stack| 1.0 / s.frames as f64;
    let dark_mean = (&dark.sum[..], per_frame(dark));
    let plane = SitePlane::of(site, shape, &[dark_mean], Vec::new());
    out.spectrogram_dark = Some(plane.spectrogram()?);
    out.histogram_dsnu = Some(Histogram::of(&plane.data, per_frame(dark)));
    let of_dark = Profiles::of(&plane);
    let terms = [(&flat.sum[..], per_frame(flat)), (dark_mean.0, -dark_mean.1)];
    let plane = SitePlane::of(site, shape, &terms, plane.data);
    out.spectrogram_prnu = Some(plane.spectrogram()?);
    out.profiles = Some([of_dark, Profiles::of(&plane)]);
    out.histogram_prnu = Some(Histogram::of(&plane.high_pass(), high_passed(dark, flat)));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_make_up_the_total_and_none_is_above_it() {
        let of =
            |total: f64, values: [f64; 3]| parts_of(total, &values.map(|v| Value::new(v, 1.0)));
        // As split: the sum is the total, parts may be negative.
        assert_eq!(of(9.0, [4.0, 3.0, 2.0]), [Some(4.0), Some(3.0), Some(2.0)]);
        // 13 + 1 - 2 = 12: the two that are left are 12 together, in their proportion.
        let [row, column, pixel] = of(12.0, [13.0, 1.0, -2.0]);
        let (row, column) = (row.unwrap(), column.unwrap());
        assert!((row + column - 12.0).abs() < 1e-12 && (row / column - 13.0).abs() < 1e-12);
        assert_eq!(pixel, None);
        assert_eq!(of(-1.0, [3.0, -2.0, -2.0]), [None; 3]);
        assert_eq!(of(6.0, [9.0, 1.0, -4.0]), [None; 3]);

        let said = parts_warning("DSNU1288", "m", 4, 6.0, &[None; 3]).unwrap();
        assert!(said.contains("the parts of DSNU1288 are not determined"), "{said}");
        let said = parts_warning("DSNU1288", "m", 4, 12.0, &[Some(11.0), None, None]).unwrap();
        assert!(said.contains("the column and pixel parts of DSNU1288 are not determined"));
        let said = parts_warning("PRNU1288", "m", 4, -1.0, &[None; 3]).unwrap();
        assert!(
            said.contains("PRNU1288 is not determined") && said.contains("4 frames"),
            "{said}"
        );
        assert_eq!(parts_warning("PRNU1288", "m", 4, 1.0, &[Some(0.3); 3]), None);
    }
}
