//! Pictures with part of a camera's noise: to tell what an algorithm does to the image from what
//! it does to noise.

use super::{Camera, Noise};
use camrig_sensor_core::effects::{Class, Effect};

/// Which of a camera's noise and fixed patterns a picture has. Rounding to DN stays, and so does
/// all that only shapes the response: full well, non-linearity, crosstalk, blooming and the like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum KeptNoise {
    /// All.
    #[default]
    All,
    /// The shot noise of light: no dark charge, no read noise, no fixed patterns, no defects.
    Shot,
    /// None: every pixel has its mean signal.
    None,
}

camrig_base::choices!(KeptNoise, "noise": All = "all", Shot = "shot", None = "none");

impl KeptNoise {
    /// What a picture lacks; `None` where that is nothing.
    #[must_use]
    pub const fn note(self) -> Option<&'static str> {
        match self {
            Self::All => None,
            Self::Shot => Some(
                "of all noise the shot noise of light alone: no dark charge, no read noise, no \
                 fixed patterns, no defects",
            ),
            Self::None => Some(
                "no noise: mean signals, rounded; no dark charge, no fixed patterns, no defects",
            ),
        }
    }
}

impl Camera {
    /// Leaves the other noise of the sensor out.
    ///
    /// ```
    /// use camrig_camera::{Camera, KeptNoise};
    /// let mut camera = Camera::load("mt9v024")?;
    /// camera.keep_noise(KeptNoise::None);
    /// assert_eq!(camera.sensor.noise.read_e, 0.0);
    /// # Ok::<(), camrig_base::Error>(())
    /// ```
    pub fn keep_noise(&mut self, kept: KeptNoise) {
        self.sensor.kept_noise = kept;
        if kept == KeptNoise::All {
            return;
        }
        self.sensor.noise = Noise {
            read_e: 0.0,
            read_e_post: 0.0,
            dark_current_e_per_s: 0.0,
            dsnu_e_per_s: 0.0,
            prnu: 0.0,
            row_fpn_e: 0.0,
            ..self.sensor.noise
        };
        if let Some(gains) = &mut self.sensor.gains {
            gains.read_e = None;
        }
        self.effects.retain(|effect| shapes_the_response(effect, kept));
        if let Some(hdr) = &mut self.sensor.hdr {
            hdr.effects.retain(|e| shapes_the_response(&e.effect, kept));
        }
    }
}

/// Whether an effect stays: it is neither noise, nor dark charge, nor a pattern.
fn shapes_the_response(effect: &Effect, kept: KeptNoise) -> bool {
    match effect.class() {
        Class::Response => true,
        Class::Shot => kept == KeptNoise::Shot,
        _ => false,
    }
}
