//! Where on the sensor things of a scene come to, and what a place on the sensor sees: the mapping
//! of the optics stage, for labels of pictures.

use super::lens;
use super::lighting::frame_aspect;
use camrig_base::{Bands, Result};
use camrig_camera::Camera;
use camrig_optics::{Lens, Options};
use camrig_scene::Grid;

/// The wavelength at which the eye is most sensitive, nm.
const NM: f64 = 555.0;
/// Distance at which a place is found, mm: far below a pixel.
const FOUND_MM: f64 = 1e-7;
/// Steps of Newton's method, and halvings of one. A trade: it doubles its digits with each step,
/// and a place that the lens does not image has to be given up at some time.
const STEPS: usize = 50;

/// The mapping between a picture's pixels and those of a camera that sees it, at 555 nm. Both have
/// their origin in the corner at the top left, so that the first pixel's centre is (0.5, 0.5).
pub struct Places {
    lens: Box<dyn Lens>,
    /// Pixels of the sensor.
    sensor: [f64; 2],
    pitch_mm: f64,
    /// Pixels of the picture.
    picture: [f64; 2],
    /// Widths of the picture's content in a sensor's width.
    scale: f64,
}

impl Places {
    /// For a picture of that many pixels.
    ///
    /// # Errors
    /// Lens data that cannot be read or traced.
    pub fn new(camera: &Camera, (width, height): (usize, usize)) -> Result<Self> {
        let band = Bands { start_nm: NM, step_nm: 1.0, count: 1 };
        let unit = Grid { width: 1, height: 1, left: 0.0, top: 0.0, cell: 1.0 };
        let picture = [width as f64, height as f64];
        let aspect = Some(picture[0] / picture[1]);
        Ok(Self {
            lens: lens(camera, &band, &Options::default())?,
            sensor: [f64::from(camera.sensor.width), f64::from(camera.sensor.height)],
            pitch_mm: camera.sensor.pitch_um * 1e-3,
            picture,
            scale: unit.over_content(aspect, frame_aspect(camera)).cell,
        })
    }

    /// Whether straight lines stay straight.
    pub fn is_linear(&self) -> bool {
        self.lens.ideal_place(NM).is_none()
    }

    /// What of the picture a place on the sensor sees, pixels.
    pub fn seen(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let axis = <[f64; 2]>::from(self.lens.axis_mm());
        let mm = |place: f64, i: usize| (place - 0.5 * self.sensor[i]) * self.pitch_mm - axis[i];
        let ideal = self.ideal([mm(x, 0), mm(y, 1)]);
        [0, 1].map(|i| self.in_picture(ideal[i] + axis[i], i))
    }

    /// Where on the sensor a place of the picture comes to, pixels, within the frame or outside;
    /// none where the lens does not image it.
    pub fn imaged(&self, place: [f64; 2]) -> Option<[f64; 2]> {
        let axis = <[f64; 2]>::from(self.lens.axis_mm());
        let ideal = [0, 1].map(|i| self.ideal_mm(place[i], i) - axis[i]);
        let real = self.real(ideal)?;
        Some([0, 1].map(|i| (real[i] + axis[i]) / self.pitch_mm + 0.5 * self.sensor[i]))
    }

    /// A picture's pixels from mm right of and below the sensor's centre without distortion.
    fn in_picture(&self, mm: f64, i: usize) -> f64 {
        let widths = mm / (self.sensor[0] * self.pitch_mm);
        widths * self.scale * self.picture[0] + 0.5 * self.picture[i]
    }

    /// The inverse of [`Self::in_picture`].
    fn ideal_mm(&self, pixels: f64, i: usize) -> f64 {
        let widths = (pixels - 0.5 * self.picture[i]) / (self.scale * self.picture[0]);
        widths * self.sensor[0] * self.pitch_mm
    }

    fn ideal(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        self.lens.ideal_place(NM).map_or([x, y], |ideal| ideal.at(x, y).into())
    }

    /// The inverse of [`Self::ideal`] by Newton's method from the axis, with steps halved until
    /// they come closer.
    fn real(&self, ideal: [f64; 2]) -> Option<[f64; 2]> {
        if self.is_linear() {
            return Some(ideal);
        }
        let missed = |real: [f64; 2]| {
            let found = self.ideal(real);
            [ideal[0] - found[0], ideal[1] - found[1]]
        };
        let length = |[x, y]: [f64; 2]| libm::hypot(x, y);
        let mut real = [0.0, 0.0];
        let mut miss = missed(real);
        for _ in 0..STEPS {
            if length(miss) < FOUND_MM {
                return Some(real);
            }
            // Over a tenth of a pixel: beyond what rounding does, below what bends.
            let h = 0.1 * self.pitch_mm;
            let [right, down] = [missed([real[0] + h, real[1]]), missed([real[0], real[1] + h])];
            let [a, c] = [0, 1].map(|i| (miss[i] - right[i]) / h);
            let [b, d] = [0, 1].map(|i| (miss[i] - down[i]) / h);
            let determinant = a * d - b * c;
            let step = [
                (d * miss[0] - b * miss[1]) / determinant,
                (a * miss[1] - c * miss[0]) / determinant,
            ];
            let shorter = (0..STEPS).map(|n| libm::pow(0.5, n as f64)).find_map(|part| {
                let next = [real[0] + part * step[0], real[1] + part * step[1]];
                let left = missed(next);
                (length(left) < length(miss)).then_some((next, left))
            });
            (real, miss) = shorter?;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::OpticalEffect;

    fn camera(effects: &[(&str, &[f32])]) -> Camera {
        let mut camera = Camera::load("mt9v024").unwrap();
        let effect = |(kind, values): &(&str, &[f32])| OpticalEffect::new(kind, values).unwrap();
        camera.optical_effects = effects.iter().map(effect).collect();
        camera
    }

    /// A square picture fills the width of a frame of 752 x 480: 3.76 pixels for one of 200, and
    /// rows above and below are cut off.
    #[test]
    fn an_ideal_lens_scales_and_centres() {
        let places = Places::new(&camera(&[]), (200, 200)).unwrap();
        assert!(places.is_linear());
        for ([x, y], [u, v]) in [
            ([100.0, 100.0], [376.0, 240.0]),
            ([0.0, 100.0], [0.0, 240.0]),
            ([200.0, 150.0], [752.0, 428.0]),
            ([50.0, 0.0], [188.0, -136.0]),
        ] {
            let found = places.imaged([x, y]).unwrap();
            assert!((found[0] - u).abs() < 1e-9 && (found[1] - v).abs() < 1e-9, "{found:?}");
            let back = places.seen([u, v]);
            assert!((back[0] - x).abs() < 1e-9 && (back[1] - y).abs() < 1e-9, "{back:?}");
        }
    }

    /// Brown's polynomial: real height h(1 + k1 h²), h in heights of the corner.
    #[test]
    fn distortion_moves_places_by_its_own_equation() {
        for k1 in [-0.1f32, 0.15] {
            let places = Places::new(&camera(&[("distortion", &[k1, 0.0, 1.0])]), (752, 480));
            let places = places.unwrap();
            assert!(!places.is_linear());
            let corner = libm::hypot(376.0, 240.0);
            for [x, y] in [[0.0, 0.0], [376.0, 0.0], [700.0, 400.0], [376.0, 240.0]] {
                let [right, down] = [x - 376.0, y - 240.0];
                let h = libm::hypot(right, down) / corner;
                let longer = 1.0 + f64::from(k1) * h * h;
                let found = places.imaged([x, y]).unwrap();
                let expected = [376.0 + right * longer, 240.0 + down * longer];
                for i in [0, 1] {
                    assert!((found[i] - expected[i]).abs() < 1e-3, "{found:?} {expected:?}");
                    assert!((places.seen(found)[i] - [x, y][i]).abs() < 1e-3);
                }
            }
        }
    }
}
