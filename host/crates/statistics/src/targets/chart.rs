//! The figures of a ColorChecker.

use super::patches::measure;
use super::picture::Picture;
use crate::statistic::{Figure, Scale};
use camrig_base::Result;
use camrig_camera::Camera;

/// The figures of a chart. The scatter of the luminance is that within single frames, as in Table
/// I of Chen et al. 2009.
pub fn figures(
    camera: &Camera,
    card_width: f64,
    picture: &Picture,
    level_known: bool,
) -> Result<Vec<(Figure, f64, f64, Scale)>> {
    let mut out = Vec::new();
    let patches = measure(camera, card_width, &picture.mean)?;
    for (patch, variance) in patches.iter().zip(&picture.patch_variance) {
        let (number, n) = (patch.number as u8, patch.samples as f64);
        for (channel, (mean, sd)) in patch.mean_dn.iter().zip(&patch.std_dn).enumerate() {
            let figure = Figure::PatchMean { patch: number, channel: channel as u8 };
            out.push((figure, *mean, sd / n.sqrt(), Scale::Linear));
        }
        // Noise depends on the level: where that is not known, its scatter cannot be compared.
        if level_known {
            // A variance is uncertain by (2 + excess kurtosis)/n of its square: the temporal noise
            // of each frame by the 2 alone, the fixed part also by pixels that stand out.
            let fixed = patch.luminance_std_dn.powi(2) / variance.max(f64::MIN_POSITIVE);
            let excess = patch.luminance_excess_kurtosis.max(0.0) * fixed * fixed;
            let of_variance = 2.0 / ((n - 1.0) * picture.frames as f64) + excess / n;
            let sd = 0.5 * of_variance.sqrt();
            out.push((Figure::PatchScatter(number), variance.sqrt(), sd, Scale::Log));
        }
    }
    Ok(out)
}
