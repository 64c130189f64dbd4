//! DSNU1288 and PRNU1288, spectrograms and histograms from a pair of long stacks.

use super::{ChannelEmva, saturation_index};
use crate::dark::SAME_EXPOSURE;
use crate::ladder::Level;
use crate::moments::SATURATED_SHARE;
use crate::spectrogram::{Histogram, SitePlane};
use crate::stack::Stack;
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

/// Fills in the spatial figures of channel `c` from the pair.
pub(super) fn spatial_figures(
    out: &mut ChannelEmva,
    dark: &Stack,
    flat: &Stack,
    c: usize,
) -> Result<()> {
    let (d, f) = (dark.channel_moments(c), flat.channel_moments(c));
    let (ds, fs) = (d.spatial(), f.spatial());
    let k = out.figures.overall_system_gain;
    let signal = f.mean() - d.mean();
    let root = |v: f64| (v > 0.0).then(|| v.sqrt());
    let dsnu = |v: f64| root(v).map(|s| s / k);
    let prnu = |flat: f64, dark: f64| root(flat - dark).map(|s| 100.0 * s / signal);
    let figures = &mut out.figures;
    figures.dsnu_1288_e = dsnu(ds.total.value);
    figures.dsnu_1288_row_e = dsnu(ds.row.value);
    figures.dsnu_1288_column_e = dsnu(ds.column.value);
    figures.dsnu_1288_pixel_e = dsnu(ds.pixel.value);
    figures.prnu_1288_percent = prnu(fs.total.value, ds.total.value);
    figures.prnu_1288_row_percent = prnu(fs.row.value, ds.row.value);
    figures.prnu_1288_column_percent = prnu(fs.column.value, ds.column.value);
    figures.prnu_1288_pixel_percent = prnu(fs.pixel.value, ds.pixel.value);
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
    out.histogram_dsnu = Some(Histogram::of(&plane.data));
    let terms = [(&flat.sum[..], per_frame(flat)), (dark_mean.0, -dark_mean.1)];
    let plane = SitePlane::of(site, shape, &terms, plane.data);
    out.spectrogram_prnu = Some(plane.spectrogram()?);
    out.histogram_prnu = Some(Histogram::of(&plane.high_pass()));
    Ok(())
}
