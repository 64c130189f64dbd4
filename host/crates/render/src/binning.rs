//! The bands in which a camera is shown a scene.
//!
//! A chart is drawn in all bands that the camera sees of its light, as far as its data reach. A
//! cube keeps its own; held at its ends it gets more of them on either side. Of more bands than a
//! sensor takes, those at both ends from which it gets next to nothing are left out; if still too
//! many are left, they are joined to [`MAX_BANDS`] equal ones. Each takes the radiance of the
//! scene's bands under it in proportion to their overlap, reflectance times light, so that energy
//! is kept. What is lost is the change of reflectances within a band.

use super::lighting::SceneInLight;
use super::reach::Sight;
use camrig_base::{Bands, Plane, Result};
use camrig_camera::Camera;
use camrig_scene::{Beyond, Grid, Quantity, Scene, Shown, White};
use camrig_sensor_core::config::MAX_BANDS;
use std::sync::Arc;

/// A scene in other bands: for each, the scene's bands with their weights.
struct Binned {
    scene: Arc<dyn Scene>,
    bands: Bands,
    parts: Vec<Vec<(usize, f32)>>,
}

impl Scene for Binned {
    fn bands(&self) -> Bands {
        self.bands
    }

    fn quantity(&self) -> Quantity {
        self.scene.quantity()
    }

    fn aspect(&self) -> Option<f64> {
        self.scene.aspect()
    }

    fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
        let mut sum = Plane::filled(grid.width, grid.height, 0.0f32);
        for &(part, weight) in &self.parts[band] {
            let plane = self.scene.plane(part, grid)?;
            sum.data.iter_mut().zip(&plane.data).for_each(|(s, v)| *s += weight * v);
        }
        Ok(sum)
    }

    fn white(&self) -> Option<&White> {
        self.scene.white()
    }

    fn shown(&self) -> Option<Shown> {
        self.scene.shown()
    }

    fn notes(&self) -> Vec<String> {
        self.scene.notes()
    }
}

impl SceneInLight {
    /// The scene in the bands that `camera` sees, at most as many as its sensor takes; what its
    /// data lack is told.
    #[must_use]
    pub fn seen_by(mut self, camera: &Camera) -> Self {
        let sight = Sight::new(camera, self.illuminant.as_ref());
        let (own, data_nm, beyond) =
            (self.scene.bands(), self.scene.data_nm(), self.scene.beyond());
        self.done.extend(sight.note(data_nm, beyond));
        let known_nm = if beyond == Beyond::Hold { [0.0, f64::INFINITY] } else { data_nm };
        let bands = sight.bands(known_nm).unwrap_or(own);
        if let Some(scene) = self.scene.in_bands(&bands) {
            return Self { white: self.white_in(&bands), scene: scene.into(), ..self };
        }
        let (held, before) = match beyond {
            Beyond::Dark => (own, 0),
            Beyond::Hold => reaching(&own, sight.reach_nm()),
        };
        if held.count <= MAX_BANDS && held == own {
            return self;
        }
        let white = self.white_in(&held);
        let seen = if held.count > MAX_BANDS { sight.seen(&held) } else { held };
        let first = (seen.start_nm - held.start_nm) / held.step_nm;
        // Edges of the bands are whole numbers here, band 0 from 0 to 1.
        let width = (seen.count as f64 / MAX_BANDS as f64).max(1.0);
        let count = seen.count.min(MAX_BANDS);
        let (mut parts, mut joined_white) = (Vec::new(), Vec::new());
        for band in 0..count {
            let start = first + width * band as f64;
            let (of, light) = joined(start, start + width, &white);
            let source = |band: usize| band.saturating_sub(before).min(own.count - 1);
            parts.push(of.into_iter().map(|(band, weight)| (source(band), weight)).collect());
            joined_white.push(light);
        }
        let bands = Bands {
            start_nm: seen.start_nm + own.step_nm * (width - 1.0) / 2.0,
            step_nm: own.step_nm * width,
            count,
        };
        if held.count > MAX_BANDS {
            self.done.push(note(&held, &bands));
        }
        let scene = Arc::new(Binned { scene: self.scene, bands, parts });
        Self { scene, white: joined_white, rebinned: width > 1.0, ..self }
    }
}

/// Bands with more of them on either side, as far as between two wavelengths, nm; and how many
/// are before the first.
fn reaching(own: &Bands, [from_nm, to_nm]: [f64; 2]) -> (Bands, usize) {
    let steps = |nm: f64| (nm / own.step_nm - 0.5).ceil().max(0.0) as usize;
    let before = steps(own.nm(0) - from_nm);
    let after = steps(to_nm - own.nm(own.count - 1));
    let start_nm = own.start_nm - before as f64 * own.step_nm;
    (Bands { start_nm, count: before + own.count + after, ..*own }, before)
}

/// The bands under an interval with their weights, and the white of the interval.
fn joined(start: f64, end: f64, white: &[f64]) -> (Vec<(usize, f32)>, f64) {
    let (first, last) = (start.floor() as usize, (end.ceil() as usize).min(white.len()));
    let overlap = |band: usize| {
        (end.min(band as f64 + 1.0) - start.max(band as f64)).max(0.0) / (end - start)
    };
    let light: f64 = (first..last).map(|band| overlap(band) * white[band]).sum();
    let weight = |band: usize| match light > 0.0 {
        true => overlap(band) * white[band] / light,
        false => overlap(band),
    };
    let parts = (first..last).map(|band| (band, weight(band) as f32));
    (parts.filter(|part| part.1 > 0.0).collect(), light)
}

fn note(old: &Bands, new: &Bands) -> String {
    let half = new.step_nm / 2.0;
    let (from, to) = (new.nm(0) - half, new.nm(new.count - 1) + half);
    let kept = if new.step_nm > old.step_nm { "energy is kept" } else { "each as it is" };
    format!(
        "the scene's {} bands of {} nm are more than the {MAX_BANDS} that a sensor takes: used are \
         {} bands of {:.3} nm from {from:.1} to {to:.1} nm, {kept}",
        old.count, old.step_nm, new.count, new.step_nm
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SceneLight, SimulatedSensor, scene_irradiance};
    use camrig_base::Spectrum;
    use camrig_optics::Options;

    /// A scene of one pixel of reflectance 0.2 + λ/10 µm, in bands of `step` nm.
    fn scene(folder: &std::path::Path, start: f64, step: f64, count: usize) -> String {
        let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        let header =
            format!("{{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, {count}), }}");
        bytes.extend(format!("{header:<117}\n").bytes());
        let value = |band: usize| (0.2 + (start + step * band as f64) / 10_000.0) as f32;
        bytes.extend((0..count).flat_map(|band| value(band).to_le_bytes()));
        let path = folder.join(format!("{count}.npy"));
        std::fs::write(&path, bytes).unwrap();
        format!("{}:start_nm={start},step_nm={step}", path.display())
    }

    fn electrons(camera: &Camera, spec: &str) -> (Vec<f32>, Vec<String>) {
        let light = SceneLight::lux("D65", 300.0);
        let seen = scene_irradiance(camera, spec, &light, &Options::default(), |_, _| ()).unwrap();
        let sensor = SimulatedSensor::new(camera, &seen.cube.header).unwrap();
        let electrons = sensor.electrons(&seen.cube, &camera.settings(0, 1.0, None)).unwrap();
        (electrons.data, seen.notes)
    }

    #[test]
    fn scenes_of_many_bands_give_the_signal_of_few() {
        let folder = tempfile::tempdir().unwrap();
        let mut camera = Camera::load("mt9v024").unwrap();
        (camera.sensor.width, camera.sensor.height) = (4, 4);
        for (many, few) in
            [((400.0, 5.0, 73), (400.0, 10.0, 37)), ((300.0, 10.0, 81), (380.0, 10.0, 63))]
        {
            let of = |(start, step, count)| scene(folder.path(), start, step, count);
            let (got, notes) = electrons(&camera, &of(many));
            let (expected, none) = electrons(&camera, &of(few));
            for (got, expected) in got.iter().zip(&expected) {
                assert!((got / expected - 1.0).abs() < 5e-3, "{many:?}: {got}, {expected}");
            }
            let said = |notes: &[String]| notes.iter().any(|n| n.contains("more than the 64"));
            assert!(said(&notes) && !said(&none), "{notes:?}");
        }
    }

    #[test]
    fn joined_bands_keep_the_energy_and_lie_where_their_parts_do() {
        let white = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let reflectance = [0.5, 0.1, 0.9, 0.3, 0.2, 0.7];
        let of = |parts: &[(usize, f32)]| -> f64 {
            parts.iter().map(|&(band, weight)| f64::from(weight) * reflectance[band]).sum()
        };
        let joined: Vec<_> = (0..4)
            .map(|i| joined(1.5 * f64::from(i), 1.5 * f64::from(i + 1), &white))
            .map(|(parts, light)| of(&parts) * light * 1.5)
            .collect();
        let energy: f64 = white.iter().zip(reflectance).map(|(w, r)| w * r).sum();
        assert!((joined.iter().sum::<f64>() - energy).abs() < 1e-6, "{joined:?}");
        assert!((joined[0] - (0.5 + 0.5 * 0.2)).abs() < 1e-6, "{joined:?}");
    }

    /// A reflectance of 0.3 in two bands from 580 to 620 nm, held, is a grey of 0.3; dark, it is
    /// the part of that grey's signal within 580 to 620 nm, as the warning says.
    #[test]
    fn a_reflectance_is_dark_beyond_its_bands_or_held() {
        let folder = tempfile::tempdir().unwrap();
        let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 2), }";
        bytes.extend(format!("{header:<117}\n").bytes());
        bytes.extend([0.3f32; 2].iter().flat_map(|v| v.to_le_bytes()));
        let path = folder.path().join("two.npy");
        std::fs::write(&path, bytes).unwrap();
        let of = |beyond| format!("{}:start_nm=590,step_nm=20,beyond={beyond}", path.display());
        let mut camera = Camera::load("mt9v024").unwrap();
        (camera.sensor.width, camera.sensor.height) = (4, 4);
        let (grey, none) = electrons(&camera, "uniform:0.3");
        let (held, told) = electrons(&camera, &of("hold"));
        for (held, grey) in held.iter().zip(&grey) {
            assert!((held / grey - 1.0).abs() < 1e-3, "{held}, {grey}");
        }
        assert!(!none.iter().any(|n| n.contains("lies outside")), "{none:?}");
        assert!(told.iter().any(|n| n.contains("keeps its end values")), "{told:?}");
        let (dark, told) = electrons(&camera, &of("dark"));
        let warned = told.iter().find(|n| n.starts_with("warning: ")).unwrap();
        let missing = dark.iter().zip(&grey).map(|(dark, grey)| 1.0 - dark / grey);
        let most = 100.0 * missing.fold(0.0f32, f32::max);
        let (before, _) = warned.split_once(" % of the signal").unwrap();
        let stated: f32 = before.rsplit(' ').next().unwrap().parse().unwrap();
        // The bands of the grey leave out up to 1e-3; the note has one decimal.
        assert!((stated - most).abs() < 0.05 + 0.1, "{most}: {warned}");
    }

    /// Closed forms of light through a filter narrower than a band, and of light that ends
    /// nowhere in the visible: electrons are ∫ Φ QE S λ dλ, straight lines between samples.
    #[test]
    fn narrow_filters_and_infrared_give_the_integral_of_the_product() {
        let mut camera = Camera::load("mt9v024").unwrap();
        (camera.sensor.width, camera.sensor.height) = (4, 4);
        let curve = |nm: &[f64], value: &[f64]| {
            let curve = Spectrum::new(nm.to_vec(), value.to_vec()).unwrap();
            curve.outside(camrig_base::Outside::Zero)
        };
        let mut of = |qe: Spectrum, cut: Option<Spectrum>| {
            camera.sensor.qe = vec![qe; 3];
            camera.sensor.ir_cut = cut;
            let light = SceneLight::lux("E", 300.0);
            let options = Options::default();
            let seen = scene_irradiance(&camera, "uniform:0.5", &light, &options, |_, _| ());
            let cube = seen.unwrap().cube;
            let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
            f64::from(sensor.electrons(&cube, &camera.settings(0, 0.01, None)).unwrap().data[0])
        };
        // QE even from 400 to 1000 nm: ∫ λ dλ = (1000² - 400²) / 2 nm².
        let wide = of(curve(&[400.0, 1000.0], &[0.5, 0.5]), None);
        let per_nm2 = wide / ((1e6 - 16e4) / 2.0);
        // A triangle of 5 nm half width at its foot about 555 nm, on the edge of two bands, and
        // about 857 nm: its area times the wavelength of its centre.
        for centre in [550.0, 555.0, 857.0] {
            let filter = curve(&[centre - 5.0, centre, centre + 5.0], &[0.0, 0.9, 0.0]);
            let narrow = of(curve(&[400.0, 1000.0], &[0.5, 0.5]), Some(filter));
            let expected = per_nm2 * 0.9 * 5.0 * centre;
            // The cube holds 16 bits a value.
            assert!((narrow / expected - 1.0).abs() < 1e-4, "{centre}: {narrow}, {expected}");
        }
    }
}
