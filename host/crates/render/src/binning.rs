//! Scenes of more bands than a sensor takes: rebinned for the camera that looks at them.
//!
//! Bands at both ends from which the sensor gets next to nothing are left out; if still too many
//! are left, they are joined to [`MAX_BANDS`] equal ones. Each takes the radiance of the scene's
//! bands under it in proportion to their overlap, reflectance times light, so that energy is kept.
//! What is lost is the change of the sensor's response within a band, which the note states.

use super::lighting::SceneInLight;
use camrig_base::{Bands, Plane, Result};
use camrig_camera::Camera;
use camrig_scene::{Grid, Quantity, Scene, White};
use camrig_sensor_core::config::MAX_BANDS;
use std::sync::Arc;

/// Share of each channel's signal that bands at one end may have to be left out.
const UNSEEN: f64 = 1e-4;

/// A scene in fewer bands: for each, the scene's bands with their weights.
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

    fn notes(&self) -> Vec<String> {
        self.scene.notes()
    }
}

impl SceneInLight {
    /// The scene in as few bands as the sensor of `camera` takes; as it is where that holds
    /// already.
    #[must_use]
    pub fn binned_for(self, camera: &Camera) -> Self {
        let bands = self.scene.bands();
        if bands.count <= MAX_BANDS {
            return self;
        }
        let signal = signal(camera, &bands, &self.white);
        let (first, count) = seen(&signal);
        // Edges of the scene's bands are whole numbers here, band 0 from 0 to 1.
        let width = (count as f64 / MAX_BANDS as f64).max(1.0);
        let binned = count.min(MAX_BANDS);
        let (mut parts, mut white) = (Vec::new(), Vec::new());
        for band in 0..binned {
            let start = first as f64 + width * band as f64;
            let (of, light) = joined(start, start + width, &self.white);
            parts.push(of);
            white.push(light);
        }
        let new = Bands {
            start_nm: bands.start_nm + bands.step_nm * (first as f64 + (width - 1.0) / 2.0),
            step_nm: bands.step_nm * width,
            count: binned,
        };
        let note = note(&bands, &new, &signal, &self::signal(camera, &new, &white));
        let Self { scene, illuminant, lux, spec, mut done, .. } = self;
        done.push(note);
        let scene = Arc::new(Binned { scene, bands: new, parts });
        Self { scene, illuminant, lux, white, spec, done }
    }
}

/// Electrons per second, up to a common factor, that a white gives in each channel and band.
fn signal(camera: &Camera, bands: &Bands, white: &[f64]) -> Vec<Vec<f64>> {
    let through = camera.lens.transmittance.sample(bands);
    let light: Vec<f64> = white.iter().zip(through).map(|(w, t)| w * t).collect();
    let of = |response: Vec<f64>| response.iter().zip(&light).map(|(r, l)| r * l).collect();
    camera.sensor.response(bands).into_iter().map(of).collect()
}

/// The first band that counts, and how many do.
fn seen(signal: &[Vec<f64>]) -> (usize, usize) {
    let count = signal.first().map_or(0, Vec::len);
    let unseen = |channel: &Vec<f64>, bands: &mut dyn Iterator<Item = usize>| {
        let most = UNSEEN * channel.iter().sum::<f64>();
        let mut sum = 0.0;
        bands
            .take_while(|&band| {
                sum += channel[band];
                sum <= most
            })
            .count()
    };
    let least = |ends: Vec<usize>| ends.into_iter().min().unwrap_or(0);
    let first = least(signal.iter().map(|c| unseen(c, &mut (0..count))).collect());
    let last = least(signal.iter().map(|c| unseen(c, &mut (0..count).rev())).collect());
    // A camera that sees nothing gets all bands.
    if first + last >= count { (0, count) } else { (first, count - first - last) }
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

fn note(old: &Bands, new: &Bands, before: &[Vec<f64>], after: &[Vec<f64>]) -> String {
    let sum = |channel: &Vec<f64>| channel.iter().sum::<f64>();
    let changes = before.iter().zip(after).map(|(b, a)| (sum(a) / sum(b) - 1.0).abs());
    let change = changes.filter(|c| c.is_finite()).fold(0.0, f64::max);
    let half = new.step_nm / 2.0;
    let (from, to) = (new.nm(0) - half, new.nm(new.count - 1) + half);
    let kept = if new.step_nm > old.step_nm { "energy is kept" } else { "each as it is" };
    format!(
        "the scene's {} bands of {} nm are more than the {MAX_BANDS} that a sensor takes: used are \
         {} bands of {:.3} nm from {from:.1} to {to:.1} nm, {kept}; the signal of a white changes \
         by {:.3} %",
        old.count,
        old.step_nm,
        new.count,
        new.step_nm,
        100.0 * change
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SceneLight, SimulatedSensor, scene_irradiance};
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

    #[test]
    fn ends_without_signal_are_left_out() {
        let signal = [vec![0.0, 1e-6, 1.0, 1.0, 0.0, 0.0], vec![0.0, 1.0, 1.0, 1.0, 1e-6, 0.0]];
        assert_eq!(seen(&signal), (1, 3));
        assert_eq!(seen(&[vec![0.0; 3]]), (0, 3));
    }
}
