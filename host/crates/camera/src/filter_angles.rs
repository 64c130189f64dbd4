//! An interference filter in oblique light.
//!
//! Its layers look thinner to light that comes at an angle θ: the transmittance measured at normal
//! incidence moves to shorter waves, T(λ, θ) = T(λ / √(1 − (sin θ / n)²)), with the effective index
//! n of the layers (Macleod, *Thin-Film Optical Filters*). A pixel sees the mean over the cone of
//! its light, an even pupil of directions around the chief ray: sin θ of its edge is 1/(2 N_w) on
//! the axis, N_w = N (1 + |m|). The chief ray of an ideal lens with its stop at the lens has tan θ
//! = h / (f (1 + |m|)) at the height h.
//!
//! Of a lens that is traced, the rays of its pupil at some heights stand for both.
//!
//! Limits: both polarisations move alike, and the filter's height of transmittance stays, as up to
//! some 30°; microlenses are not known, nor an ideal lens's telecentricity.

use super::{CrosstalkTable, SensorModel};
use camrig_base::{Bands, Error, Result, Spectrum};
use std::sync::Arc;

/// Steps of sin²θ in which the moved filter is integrated. Of a shift of 45 nm one is 1.4 nm, and
/// between two the integral over a band is a straight line but for the bands' ends.
const STEPS: usize = 32;
/// Rings of equal area and directions around the chief ray that stand for a cone of light.
const RINGS: usize = 8;
const DIRECTIONS: usize = 16;
/// Nodes of the field along each side of the sensor: between them the square of the height is a
/// straight line, so that a shift of 45 nm is off by 0.2 nm.
const NODES: usize = 17;
/// Share of a band's largest response over the field that the centre's stands for at least, so that
/// what the centre does not see has a factor.
const LEAST: f64 = 1e-4;

/// The angles at which light passes the infrared cut filter.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct FilterAngles {
    /// Effective index of the filter's layers.
    pub effective_index: f64,
    /// Where light comes from.
    pub directions: Directions,
}

/// Directions of the light that a lens sends to the sensor.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Directions {
    /// Even cones around the chief rays of an ideal lens.
    Cones {
        /// Distance from the lens to the sensor, mm.
        image_distance_mm: f64,
        /// Sine of the cone's half angle.
        sin: f64,
    },
    /// Those of a lens that is not traced yet; until then, light comes along the axis.
    Untraced,
    /// Rays of a traced lens: sin²θ of [`RAYS`](Self::RAYS) equal shares of the light in rising
    /// order, at even steps of height from the axis.
    Traced {
        /// At each height.
        sin2: Arc<[Vec<f64>]>,
        /// The last height, mm.
        reach_mm: f64,
    },
}

impl Directions {
    /// Rays at each height.
    pub const RAYS: usize = RINGS * DIRECTIONS;

    /// sin²θ of each ray at a height relative to that of the sensor's corner.
    fn sin2(&self, height: f64, corner_mm: f64) -> Vec<f64> {
        match self {
            Self::Cones { image_distance_mm, sin } => {
                let chief = sine(corner_mm / image_distance_mm * height);
                let ring = |ring: usize| sin * ((ring as f64 + 0.5) / RINGS as f64).sqrt();
                let across = |direction: usize| {
                    let turn = (direction as f64 + 0.5) / DIRECTIONS as f64;
                    libm::cos(std::f64::consts::TAU * turn)
                };
                let rays = (0..RINGS).flat_map(|r| (0..DIRECTIONS).map(move |d| (ring(r), d)));
                let sin2 = |(radius, d): (f64, usize)| {
                    chief * chief + 2.0 * chief * radius * across(d) + radius * radius
                };
                rays.map(sin2).collect()
            }
            Self::Untraced => vec![0.0],
            Self::Traced { sin2, reach_mm } => {
                // Between two heights, even in the square of the height, as angles of rays are.
                let place = (height * corner_mm / reach_mm * (sin2.len() - 1) as f64)
                    .clamp(0.0, (sin2.len() - 1) as f64);
                let below = (place as usize).min(sin2.len().saturating_sub(2));
                let [low, high] = [below, below + 1].map(|k| (k * k) as f64);
                let part = (place * place - low) / (high - low);
                let pairs = sin2[below].iter().zip(&sin2[below + 1]);
                pairs.map(|(a, b)| a + part * (b - a)).collect()
            }
        }
    }
}

/// The response per channel and band at rising sin²θ, and how far they lie apart.
pub(crate) struct Moved {
    at: Vec<Vec<Vec<f64>>>,
    step: f64,
    directions: Directions,
    corner_mm: f64,
}

impl FilterAngles {
    /// The filter's curve for light at sin²θ.
    #[must_use]
    pub fn moved(&self, filter: &Spectrum, sin2: f64) -> Spectrum {
        let n2 = self.effective_index * self.effective_index;
        filter.with_wavelengths_times((1.0 - sin2 / n2).sqrt())
    }

    /// Largest sin²θ of all light on a sensor.
    #[must_use]
    pub fn most_sin2(&self, sensor: &SensorModel) -> f64 {
        match &self.directions {
            Directions::Cones { image_distance_mm, sin: cone } => {
                let sin = sine(corner_mm(sensor) / image_distance_mm) + cone;
                (sin * sin).min(1.0)
            }
            Directions::Untraced => 0.0,
            Directions::Traced { sin2, .. } => sin2.iter().flatten().copied().fold(0.0, f64::max),
        }
    }

    /// # Errors
    /// A lens that is not traced, or not as far as the sensor's corner.
    pub fn check_traced(&self, sensor: &SensorModel) -> Result<()> {
        let traced = match &self.directions {
            Directions::Cones { .. } => true,
            Directions::Untraced => false,
            Directions::Traced { reach_mm, .. } => corner_mm(sensor) <= reach_mm * (1.0 + 1e-9),
        };
        if traced {
            return Ok(());
        }
        Err(Error::unsupported("the angles of light on the infrared cut filter are not traced")
            .help("trace them by camrig_render::with_filter_angles, or leave out ir_cut_effective_index"))
    }

    /// The responses of a sensor with each of the moved filters.
    pub(crate) fn responses(
        &self,
        sensor: &SensorModel,
        filter: &Spectrum,
        light: &[Spectrum],
        bands: &Bands,
    ) -> Moved {
        let step = self.most_sin2(sensor).max(f64::MIN_POSITIVE) / STEPS as f64;
        let of_step = |i: usize| {
            let filter = self.moved(filter, i as f64 * step);
            sensor.response_behind(Some(&filter), light, bands)
        };
        let directions = self.directions.clone();
        Moved {
            at: (0..=STEPS).map(of_step).collect(),
            step,
            directions,
            corner_mm: corner_mm(sensor),
        }
    }
}

/// Height of a sensor's corner, mm.
fn corner_mm(sensor: &SensorModel) -> f64 {
    let (w, h) = (f64::from(sensor.width), f64::from(sensor.height));
    (w * w + h * h).sqrt() / 2.0 * sensor.pitch_um * 1e-3
}

/// The sine of an angle from its tangent.
fn sine(tan: f64) -> f64 {
    tan / (1.0 + tan * tan).sqrt()
}

impl Moved {
    /// The response of a channel in a band at a height relative to the corner's: the mean over the
    /// cone.
    fn at_height(&self, channel: usize, band: usize, height: f64) -> f64 {
        let rays = self.directions.sin2(height, self.corner_mm);
        let of_ray = |sin2: &f64| {
            let place = (sin2 / self.step).clamp(0.0, STEPS as f64);
            let below = (place as usize).min(STEPS - 1);
            let part = place - below as f64;
            let [a, b] = [below, below + 1].map(|i| self.at[i][channel][band]);
            a + part * (b - a)
        };
        rays.iter().map(of_ray).sum::<f64>() / rays.len() as f64
    }

    /// The response that factors over the field multiply: that of the centre, or a small share of
    /// the largest where that is next to nothing.
    pub(crate) fn centre(&self) -> Vec<Vec<f64>> {
        let of = |channel: usize, band: usize| {
            let at = |k: usize| self.at_height(channel, band, k as f64 / (NODES - 1) as f64);
            let most = (0..NODES).map(at).fold(0.0, f64::max);
            at(0).max(LEAST * most)
        };
        let channels = self.at[0].iter().enumerate();
        channels.map(|(c, bands)| (0..bands.len()).map(|band| of(c, band)).collect()).collect()
    }

    /// The factors over the field of a sensor.
    pub(crate) fn table(&self, sensor: &SensorModel, bands: &Bands) -> CrosstalkTable {
        let node = |i: usize| 2.0 * i as f64 / (NODES - 1) as f64 - 1.0;
        let (w, h) = (f64::from(sensor.width), f64::from(sensor.height));
        let height = |x: f64, y: f64| ((x * x * w * w + y * y * h * h) / (w * w + h * h)).sqrt();
        let nodes = || (0..NODES).map(node);
        let mut factors = Vec::new();
        for (channel, centre) in self.centre().iter().enumerate() {
            for (band, &centre) in centre.iter().enumerate() {
                let of = |x: f64, y: f64| match centre > 0.0 {
                    true => self.at_height(channel, band, height(x, y)) / centre,
                    false => 1.0,
                };
                factors.extend(
                    nodes()
                        .flat_map(|y| nodes().map(move |x| (x, y)))
                        .map(|(x, y)| of(x, y) as f32),
                );
            }
        }
        CrosstalkTable {
            channels: sensor.channel_names.clone(),
            x: nodes().map(|v| v as f32).collect(),
            y: nodes().map(|v| v as f32).collect(),
            wavelength_nm: bands.centres().map(|nm| nm as f32).collect(),
            factors,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Camera, Folder};
    use camrig_base::{Bands, Outside, Spectrum};

    const BASE: &str = include_str!("../presets/mt9t012.toml");
    const FOCAL_MM: f64 = 4.9;

    fn camera(more: &str) -> camrig_base::Result<Camera> {
        let text = BASE.replace("ir_cut = ", &format!("{more}\nir_cut = "));
        Camera::parse(&text, "test", &Folder::BuiltIn)
    }

    /// A filter with steep edges at 480 and 620 nm, an even sensor and even light: the response is
    /// that of λ between the moved edges, (1 − sin²θ/n²) times that of normal light; over the cone
    /// the mean of sin²θ is that of the chief ray and half of the cone's edge.
    #[test]
    fn a_filters_pass_band_moves_with_the_chief_ray_and_the_cone() {
        let mut camera = camera("ir_cut_effective_index = 1.7").unwrap();
        let sensor = &mut camera.sensor;
        let edges = vec![479.999, 480.001, 619.999, 620.001];
        let pass = Spectrum::new(edges, vec![0.0, 1.0, 1.0, 0.0]).unwrap();
        sensor.ir_cut = Some(pass.outside(Outside::Zero));
        sensor.qe = vec![Spectrum::constant(0.5); 3];
        for (corner_tan, cone_sin) in [(1e-9, 0.01), (0.7, 0.01), (0.7, 0.25)] {
            let corner_mm = f64::from(sensor.width).hypot(f64::from(sensor.height)) / 2.0 * 2.2e-3;
            let angles = sensor.filter_angles.as_mut().unwrap();
            let image_distance_mm = corner_mm / corner_tan;
            angles.directions = super::Directions::Cones { image_distance_mm, sin: cone_sin };
            let sensor = &*sensor;
            let bands = Bands { start_nm: 400.0, step_nm: 10.0, count: 24 };
            let normal = sensor.response_behind(sensor.ir_cut.as_ref(), &[], &bands)[0].clone();
            let whole: f64 = normal.iter().sum();
            let response = &sensor.response(&bands)[0];
            let table = sensor.factors_over_the_field(&[], &bands).unwrap();
            let n2 = 1.7 * 1.7;
            for (place, height2) in [(0usize, 1.0), (8 * 17 + 8, 0.0)] {
                let tan2 = corner_tan * corner_tan * height2;
                let mean_sin2 = tan2 / (1.0 + tan2) + cone_sin * cone_sin / 2.0;
                let sum: f64 = (0..bands.count)
                    .map(|b| response[b] * f64::from(table.factors[b * 17 * 17 + place]))
                    .sum();
                let right = 1.0 - mean_sin2 / n2;
                assert!((sum / whole / right - 1.0).abs() < 3e-4, "{}: {right}", sum / whole);
            }
        }
    }

    /// The sensor lies at f (1 + m), and sin θ of the cone is 1/(2 N (1 + m)).
    #[test]
    fn angles_are_those_of_the_lens() {
        let camera = camera("ir_cut_effective_index = 2").unwrap();
        let sensor = &camera.sensor;
        let super::Directions::Cones { image_distance_mm, sin } =
            sensor.filter_angles.as_ref().unwrap().directions
        else {
            panic!("an ideal lens");
        };
        let focal_mm = match camera.lens.kind {
            crate::LensKind::DiffractionLimited { focal_length_mm, magnification, .. } => {
                focal_length_mm * (1.0 + magnification)
            }
            _ => panic!("another lens"),
        };
        assert!((image_distance_mm - focal_mm).abs() < 1e-12);
        assert_eq!(sin, 1.0 / (2.0 * 2.8 * focal_mm / FOCAL_MM));
        for (more, expected) in [
            ("ir_cut_effective_index = 0.5", "1 to 5"),
            ("ir_cut_effective_index = 2\n#", "ir_cut_effective_index without ir_cut"),
        ] {
            let text = BASE.replace("ir_cut = ", &format!("{more}ir_cut = "));
            let text =
                if more.ends_with('#') { text } else { text.replace("ir_cut = ", "\nir_cut = ") };
            let told = Camera::parse(&text, "test", &Folder::BuiltIn).unwrap_err().to_string();
            assert!(told.contains(expected), "{told}");
        }
        let plain = camera_without().sensor;
        assert!(plain.filter_angles.is_none());
        assert!(plain.factors_over_the_field(&[], &Bands::VISIBLE).is_none());
    }

    fn camera_without() -> Camera {
        Camera::parse(BASE, "test", &Folder::BuiltIn).unwrap()
    }
}
