//! Temporal and spatial moments of a stack of frames, per site or channel.

use super::spatial::{PlaneMoments, SpatialVariance};
use camrig_base::Value;

/// Largest share of samples at the white level of a stack that counts as not saturated: clipping
/// the upper 0.1 % of a Gaussian lowers its variance by 0.2 %.
pub const SATURATED_SHARE: f64 = 1e-3;

/// Temporal and spatial moments of the pixels of a site or channel, in DN and DN².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// Moments of the mean frame over the pixels of a site; of a channel, their mean over its
    /// sites.
    pub plane: PlaneMoments,
    /// Number of sites.
    pub sites: usize,
    /// Number of frames.
    pub frames: usize,
    /// Variance of the frames' means, DN²: temporal noise of the mean and drift of the light.
    pub drift: f64,
    /// Mean over pixels of the temporal variance less the frames' drift, DN². For two frames this
    /// is EMVA 1288 R4, eq. 18: half the mean square difference less half the squared difference
    /// of the means. 0 for one frame.
    pub temporal: f64,
    /// Standard error of `temporal`, DN², for Gaussian noise whose variance may differ between
    /// pixels.
    pub temporal_error: f64,
    /// Share of samples at 0 DN.
    pub zeros: f64,
    /// Share of samples at or above the white level.
    pub whites: f64,
    /// Share of samples above the white level.
    pub beyond_white: f64,
}

impl Moments {
    /// Mean over pixels and frames, DN.
    pub fn mean(&self) -> f64 {
        self.plane.mean
    }

    /// Number of pixels.
    pub fn pixels(&self) -> f64 {
        self.plane.pixels() * self.sites as f64
    }

    /// Standard error of the mean, DN, from the noise of the frames: temporal noise, or the
    /// scatter of the frames' means where that is larger.
    pub fn mean_error(&self) -> f64 {
        let l = self.frames as f64;
        (self.temporal / (self.pixels() * l)).max(self.drift / l).sqrt()
    }

    /// Temporal variance above that of a dark, DN², with its sampling error.
    pub fn above(&self, dark: &Self) -> Value {
        let error = libm::hypot(self.temporal_error, dark.temporal_error);
        Value::new(self.temporal - dark.temporal, error)
    }

    /// Spatial variance: variance over pixels of their means, less the remaining temporal noise.
    pub fn spatial(&self) -> SpatialVariance {
        self.plane.split(self.temporal / self.frames as f64, self.sites)
    }

    /// Moments of a channel from those of its sites. Spatial variances are those within each site,
    /// so that a difference between two green sites is not non-uniformity.
    pub fn pool(sites: &[Moments]) -> Moments {
        let k = sites.len() as f64;
        let mean_of = |f: fn(&Moments) -> f64| sites.iter().map(f).sum::<f64>() / k;
        Moments {
            plane: PlaneMoments::pool(&sites.iter().map(|m| m.plane).collect::<Vec<_>>()),
            sites: sites.len(),
            frames: sites[0].frames,
            drift: mean_of(|m| m.drift),
            temporal: mean_of(|m| m.temporal),
            temporal_error: sites.iter().map(|m| m.temporal_error.powi(2)).sum::<f64>().sqrt() / k,
            zeros: mean_of(|m| m.zeros),
            whites: mean_of(|m| m.whites),
            beyond_white: mean_of(|m| m.beyond_white),
        }
    }
}
