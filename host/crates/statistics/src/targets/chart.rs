//! The figures of a ColorChecker.

use super::measured::MeasuredFigure;
use super::patches::measure;
use super::picture::Picture;
use crate::statistic::{Figure, Scale};
use camrig_base::Result;
use camrig_camera::Camera;

/// The figures of a chart. The scatter of the luminance is that within single frames, as in Table I
/// of Chen et al. 2009.
pub fn figures(
    camera: &Camera,
    card_width: f64,
    picture: &Picture,
    level_known: bool,
) -> Result<Vec<MeasuredFigure>> {
    let mut out = Vec::new();
    let patches = measure(camera, card_width, &picture.mean)?;
    for (patch, variance) in patches.iter().zip(&picture.patch_variance) {
        let (number, n) = (patch.number as u8, patch.samples as f64);
        for (channel, (mean, sd)) in patch.mean_dn.iter().zip(&patch.std_dn).enumerate() {
            let figure = Figure::PatchMean { patch: number, channel: channel as u8 };
            out.push(MeasuredFigure::linear(figure, *mean, sd / n.sqrt()));
        }
        // Noise depends on the level, so it cannot be compared where the level is unknown.
        if level_known {
            // The variance of a variance is (2 + excess kurtosis)/n of its square: for the temporal
            // noise of each frame 2/n alone, for the fixed pattern with the kurtosis of outliers.
            let fixed = patch.luminance_std_dn.powi(2) / variance.max(f64::MIN_POSITIVE);
            let excess = patch.luminance_excess_kurtosis.max(0.0) * fixed * fixed;
            let of_variance = 2.0 / ((n - 1.0) * picture.frames as f64) + excess / n;
            let sd = 0.5 * of_variance.sqrt();
            let figure = Figure::PatchScatter(number);
            out.push(MeasuredFigure { figure, value: variance.sqrt(), sd, scale: Scale::Log });
        }
    }
    Ok(out)
}
