//! Temporal and spatial moments of a stack of frames, per site or channel.

use super::spatial::{PlaneMoments, SpatialVariance};

/// Temporal and spatial moments of the pixels of a site or channel, in DN and DN².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// The mean frame's moments over the pixels of one site (their mean over a channel's sites).
    pub plane: PlaneMoments,
    /// Sites taken together.
    pub sites: usize,
    /// Frames.
    pub frames: usize,
    /// Variance of the frames' means: temporal noise of the mean and drift of the light.
    pub drift: f64,
    /// Mean over pixels of the temporal variance, the frames' drift taken out (EMVA 1288 R4, eq.
    /// 18, for two frames: half the mean square difference less half the squared difference of the
    /// means; this is the same for any number of frames). 0 for one frame.
    pub temporal: f64,
    /// Standard error of `temporal` for Gaussian noise whose variance may differ over pixels.
    pub temporal_error: f64,
    /// Share of samples at 0 DN.
    pub zeros: f64,
    /// Share of samples at or above the white level.
    pub whites: f64,
}

impl Moments {
    /// Mean over pixels and frames, DN.
    pub fn mean(&self) -> f64 {
        self.plane.mean
    }

    /// Pixels.
    pub fn pixels(&self) -> f64 {
        self.plane.pixels() * self.sites as f64
    }

    /// Standard error of the mean from the noise of the frames: temporal noise, or the scatter of
    /// the frames' means where that is larger.
    pub fn mean_error(&self) -> f64 {
        let l = self.frames as f64;
        (self.temporal / (self.pixels() * l)).max(self.drift / l).sqrt()
    }

    /// Variance over pixels of the true pixel means: the temporal remainder taken out.
    pub fn spatial(&self) -> SpatialVariance {
        self.plane.split(self.temporal / self.frames as f64, self.sites)
    }

    /// Sites of one channel taken together: means of the sites' moments. Spatial variances are
    /// those within each site, so a difference between two greens is not non-uniformity.
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
        }
    }
}
