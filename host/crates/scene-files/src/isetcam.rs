//! Scenes as ISETCam saves them (`sceneToFile`), MATLAB version 5 or 7.3 (HDF5).
//!
//! - `photons`: rows x columns x bands of radiance in photons s⁻¹ sr⁻¹ m⁻² nm⁻¹;
//! - or instead `mcCOEF` (coefficients, rows x columns x bases), `basis.basis` (bands x bases) and
//!   `imgMean` (mean per band): photons = basis · mcCOEF + mean;
//! - `wave`, `basis.wave` or `spectrum.wave`: band centres, nm;
//! - `illuminant`: `data.photons` with `spectrum.wave`, or (older) `data` in energy units with
//!   `wavelength`.
//!
//! With an illuminant that is the same for the whole scene the cube is the reflectance photons /
//! illuminant; otherwise it is the radiance. A linear model can be negative in dark places: such
//! values are set to 0.

use super::cube::{BandSource, Cube};
use super::matlab::{self, Array, Value};
use super::matlab_write;
use super::selection::Stated;
use super::sidecar::{Own, Sidecar};
use super::strided::{Bytes, Layout, Strided};
use super::{Quantity, hdf5};
use camrig_base::{Bands, Error, Plane, Result, Spectrum};
use camrig_light::photometry::photons_to_energy;
use std::path::Path;

const VARIABLES: &[&str] =
    &["photons", "mcCOEF", "basis", "imgMean", "wave", "spectrum", "illuminant"];

/// Opens a scene file.
pub(super) fn open(path: &Path, sidecar: &Sidecar) -> Result<Cube> {
    sidecar.without(&["axes", "array"], "an ISETCam scene")?;
    let mut file = if matlab::is_version_5(path)? {
        Variables::of(matlab::read(path, VARIABLES)?)
    } else {
        Variables {
            large: hdf5::large(path, &["photons", "mcCOEF"])?,
            ..Variables::of(hdf5::read(path, VARIABLES)?)
        }
    };
    let planes = file.planes()?;
    let (nm, assumed) = sidecar.wavelengths(planes.bands(), file.wavelengths(), None)?;
    let mut notes: Vec<String> = assumed.into_iter().collect();
    let white = match (file.illuminant_photons(&nm), sidecar.quantity) {
        (_, Some(Quantity::Radiance)) => None,
        (Ok(white), _) => white,
        (Err(why), Some(Quantity::Reflectance)) => {
            return Err(Error::input(format!("no reflectance can be had: its illuminant {why}"))
                .help("leave quantity=reflectance out: the scene holds radiance"));
        }
        (Err(why), None) => {
            notes.push(format!("its illuminant {why}: the scene is radiance, light included"));
            None
        }
    };
    if let (None, Some(Quantity::Reflectance)) = (&white, sidecar.quantity) {
        return Err(Error::input("no reflectance can be had: the file has no illuminant")
            .help("leave quantity=reflectance out: the scene holds radiance"));
    }
    let to_light: Vec<f64> = match &white {
        Some(white) => white.iter().map(|w| 1.0 / w).collect(),
        None => nm.iter().map(|&nm| photons_to_energy(nm)).collect(),
    };
    let quantity = if white.is_some() { Quantity::Reflectance } else { Quantity::Radiance };
    let scale = f64::from(sidecar.scale.unwrap_or(1.0));
    let gain = to_light.into_iter().map(|f| f64::from((f * scale) as f32)).collect();
    let understood = match &white {
        Some(_) => "ISETCam scene: photons over those of its illuminant, which is left out",
        None => "ISETCam scene: photons times their energy",
    };
    let own = Own {
        nm: Some(nm),
        quantity: Some(quantity),
        stated: Stated { gain: Some(gain), scale: Some(1.0), ..Stated::default() },
        understood: vec![understood.into()],
        notes,
        ..Own::default()
    };
    sidecar.cube(planes, own)
}

/// A linear model: planes of coefficients, and per band the weights of the bases and the mean.
struct LinearModel {
    coefficients: Box<dyn BandSource>,
    basis: Vec<Vec<f64>>,
    mean: Vec<f64>,
}

impl BandSource for LinearModel {
    fn size(&self) -> (usize, usize) {
        self.coefficients.size()
    }

    fn bands(&self) -> usize {
        self.basis.len()
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let (width, height) = self.size();
        let mut sum = Plane::filled(width, height, self.mean[band] as f32);
        for (index, weight) in self.basis[band].iter().enumerate() {
            let plane = self.coefficients.read(index)?;
            sum.data.iter_mut().zip(&plane.data).for_each(|(s, c)| *s += *weight as f32 * c);
        }
        // NaN is kept: the cube refuses it.
        sum.data.iter_mut().filter(|v| **v < 0.0).for_each(|v| *v = 0.0);
        Ok(sum)
    }
}

/// The variables of a file; large arrays are sources that are read band by band.
struct Variables {
    small: Vec<(String, Value)>,
    large: Vec<(String, Box<dyn BandSource>)>,
}

impl Variables {
    fn of(small: Vec<(String, Value)>) -> Self {
        Self { small, large: Vec::new() }
    }

    fn get(&self, name: &str) -> Option<&Value> {
        self.small.iter().find(|(n, _)| n == name).map(|(_, v)| v)
    }

    /// The image of a name: rows x columns x planes.
    fn image(&mut self, name: &str) -> Result<Option<Box<dyn BandSource>>> {
        if let Some(index) = self.large.iter().position(|(n, _)| n == name) {
            return Ok(Some(self.large.remove(index).1));
        }
        let Some(index) = self.small.iter().position(|(n, _)| n == name) else { return Ok(None) };
        let Value::Array(Array { mut shape, sample, bytes }) = self.small.remove(index).1 else {
            return Err(Error::input(format!("variable {name} is no numeric array")));
        };
        shape.resize(3, 1);
        let layout = Layout::packed("bxy", [shape[2], shape[1], shape[0]])?;
        let image = Strided::new(Bytes::Memory(bytes), 0, sample, false, layout)?;
        Ok(Some(Box::new(image)))
    }

    fn planes(&mut self) -> Result<Box<dyn BandSource>> {
        if let Some(photons) = self.image("photons")? {
            return Ok(photons);
        }
        let Some(coefficients) = self.image("mcCOEF")? else {
            return Err(Error::input("no variable photons and no mcCOEF")
                .help("save the scene with ISETCam's sceneToFile"));
        };
        let basis = self.get("basis").and_then(|b| b.field("basis")).and_then(Value::array);
        let bases = coefficients.bands();
        let Some(basis) = basis.filter(|b| b.shape.len() == 2 && b.shape[1] == bases) else {
            return Err(Error::input(format!("no basis.basis of {bases} columns for mcCOEF")));
        };
        let (bands, numbers) = (basis.shape[0], basis.numbers());
        let mean = match self.get("imgMean").and_then(Value::array).map(Array::numbers) {
            Some(mean) if mean.len() == bands => mean,
            None => vec![0.0; bands],
            Some(mean) if mean.is_empty() => vec![0.0; bands],
            Some(mean) => {
                return Err(Error::input(format!("imgMean has {} of {bands} bands", mean.len())));
            }
        };
        let basis =
            (0..bands).map(|b| (0..bases).map(|k| numbers[k * bands + b]).collect()).collect();
        Ok(Box::new(LinearModel { coefficients, basis, mean }))
    }

    fn wavelengths(&self) -> Option<Vec<f64>> {
        let inner = |name: &str| self.get(name).and_then(|v| v.field("wave"));
        let wave = self.get("wave").or_else(|| inner("basis")).or_else(|| inner("spectrum"))?;
        wave.array().map(Array::numbers)
    }

    /// The illuminant in photons at these wavelengths, where the file has one; in words, why it
    /// cannot be used.
    fn illuminant_photons(&self, nm: &[f64]) -> Result<Option<Vec<f64>>, String> {
        let Some(light) = self.get("illuminant") else { return Ok(None) };
        let wave = light
            .field("wavelength")
            .or_else(|| light.field("spectrum").and_then(|s| s.field("wave")))
            .and_then(Value::array);
        let wave = wave.map_or_else(|| nm.to_vec(), Array::numbers);
        let Some(data) = light.field("data") else { return Ok(None) };
        let (values, energy) = match data.field("photons") {
            Some(photons) => (photons.array(), false),
            None => (data.array(), true),
        };
        let values = values.ok_or("is no array of numbers")?.numbers();
        if values.is_empty() {
            return Ok(None);
        }
        if values.len() != wave.len() {
            return Err(format!(
                "is not the same for the whole scene ({} values at {} wavelengths)",
                values.len(),
                wave.len()
            ));
        }
        let curve = Spectrum::new(wave, values).map_err(|e| format!("is no curve ({e})"))?;
        let (first, last) = curve.range_nm();
        if let Some(nm) = nm.iter().find(|nm| !(first..=last).contains(*nm)) {
            return Err(format!("is of {first} to {last} nm and does not reach {nm} nm"));
        }
        let photons =
            nm.iter().map(|&nm| curve.at(nm) / if energy { photons_to_energy(nm) } else { 1.0 });
        let photons: Vec<f64> = photons.collect();
        match photons.iter().all(|&p| p > 0.0) {
            true => Ok(Some(photons)),
            false => Err("is not above 0 at every wavelength".into()),
        }
    }
}

/// Writes a scene as `sceneToFile` does without compression. `white` is the radiance of a perfect
/// white per band, W m⁻² sr⁻¹ nm⁻¹, for a reflectance scene; a radiance scene has none.
///
/// # Errors
/// Those of `band`, and a file that cannot be written.
pub fn write(
    path: &Path,
    name: &str,
    bands: &Bands,
    white: Option<&[f64]>,
    mut band: impl FnMut(usize) -> Result<Plane<f32>>,
) -> Result<()> {
    let mut bytes: Vec<u8> = Vec::new();
    let (mut width, mut height) = (0, 0);
    for index in 0..bands.count {
        let plane = band(index)?;
        (width, height) = (plane.width, plane.height);
        let factor = white.map_or(1.0, |w| w[index]) / photons_to_energy(bands.nm(index));
        for x in 0..width {
            for y in 0..height {
                bytes.extend((plane.at(x, y) * factor as f32).to_le_bytes());
            }
        }
    }
    let row = |values: Vec<f64>| Value::Array(Array::doubles(vec![1, values.len()], values));
    let text = |text: &str| Value::Text(text.to_string());
    let wave = || row(bands.centres().collect());
    let fields = |list: Vec<(&str, Value)>| {
        Value::Struct(list.into_iter().map(|(n, v)| (n.to_string(), v)).collect())
    };
    let sample = super::strided::Sample::F32;
    let photons = Array { shape: vec![height, width, bands.count], sample, bytes };
    let mut variables = vec![
        ("photons", Value::Array(photons)),
        ("wave", wave()),
        ("spectrum", fields(vec![("wave", wave())])),
        ("comment", text("Scene exported by camrig")),
        ("name", text(name)),
        ("type", text("scene")),
        // Field of view in degrees and distance in metres: ISETCam's defaults, as scenes here have
        // neither.
        ("fov", row(vec![10.0])),
        ("dist", row(vec![1.2])),
    ];
    if let Some(white) = white {
        let photons =
            bands.centres().zip(white).map(|(nm, w)| w / photons_to_energy(nm)).collect();
        let light = vec![
            ("name", text("white")),
            ("type", text("illuminant")),
            ("spectrum", fields(vec![("wave", wave())])),
            ("data", fields(vec![("photons", row(photons))])),
        ];
        variables.push(("illuminant", fields(light)));
    }
    matlab_write::write(path, &variables)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open as open_scene;
    use camrig_scene::Grid;

    #[test]
    fn what_is_written_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("scene.mat");
        let value =
            |x: usize, y: usize, band: usize| (x + 3 * y) as f32 / 10.0 + band as f32 / 100.0;
        let white: Vec<f64> = (0..31).map(|b| 1e-3 * (1.0 + f64::from(b))).collect();
        let grid = Grid { width: 3, height: 2, left: -0.5, top: -1.0 / 3.0, cell: 1.0 / 3.0 };
        for white in [Some(&white[..]), None] {
            write(&path, "test", &Bands::VISIBLE, white, |band| {
                Ok(Plane::from_fn(3, 2, |x, y| value(x, y, band)))
            })
            .unwrap();
            let scene = open_scene(path.to_str().unwrap()).unwrap();
            let reflectance = scene.quantity() == Quantity::Reflectance;
            assert_eq!(reflectance, white.is_some());
            for band in [0, 17, 30] {
                let plane = scene.plane(band, &grid).unwrap();
                let expected = Plane::from_fn(3, 2, |x, y| value(x, y, band));
                for (got, expected) in plane.data.iter().zip(&expected.data) {
                    assert!((got - expected).abs() <= 4e-7 * expected, "{got} for {expected}");
                }
            }
        }
    }

    #[test]
    fn a_quantity_that_is_asked_for_is_given_or_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("scene.mat");
        let spec = |quantity: &str| format!("{}:quantity={quantity}", path.display());
        let grid = Grid { width: 1, height: 1, left: -0.5, top: -0.5, cell: 1.0 };
        let white: Vec<f64> = (0..31).map(|b| 1e-3 * (1.0 + f64::from(b))).collect();
        let half = |_| Ok(Plane::filled(1, 1, 0.5f32));
        write(&path, "test", &Bands::VISIBLE, Some(&white), half).unwrap();
        let scene = open_scene(&spec("radiance")).unwrap();
        assert_eq!(scene.quantity(), Quantity::Radiance);
        for (band, white) in white.iter().enumerate() {
            let got = f64::from(scene.plane(band, &grid).unwrap().data[0]);
            assert!((got / (0.5 * white) - 1.0).abs() < 1e-6, "{got} in band {band}");
        }
        write(&path, "test", &Bands::VISIBLE, None, half).unwrap();
        let error = open_scene(&spec("reflectance")).err().unwrap().to_string();
        assert!(error.contains("the file has no illuminant"), "{error}");
    }

    /// Files written by scipy.io and h5py (`tests/data/make.py` holds the formula).
    #[test]
    fn files_of_other_writers() {
        let place = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
        let grid = Grid { width: 3, height: 2, left: -0.5, top: -1.0 / 3.0, cell: 1.0 / 3.0 };
        for file in ["photons_v5.mat", "model_v5.mat", "photons_v73.mat"] {
            let scene = open_scene(place.join(file).to_str().unwrap()).unwrap();
            assert_eq!(scene.quantity(), Quantity::Reflectance, "{file}");
            for band in 0..4 {
                let plane = scene.plane(band * 10, &grid).unwrap();
                let expected = Plane::from_fn(3, 2, |x, y| (1 + x + 3 * y + band) as f32 / 10.0);
                for (got, expected) in plane.data.iter().zip(&expected.data) {
                    assert!((got - expected).abs() < 1e-6, "{file} {got} for {expected}");
                }
            }
        }
    }

    /// ISETCam's linear model with a mean, energy illuminant and `wave` in the basis.
    #[test]
    fn linear_models_are_evaluated() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("scene.mat");
        let row = |n: Vec<f64>| Value::Array(Array::doubles(vec![1, n.len()], n));
        let nm: Vec<f64> = Bands::VISIBLE.centres().collect();
        let basis: Vec<f64> =
            (0..62).map(|i| if i < 31 { 1.0 } else { f64::from(i - 31) }).collect();
        let energy: Vec<f64> = nm.iter().map(|w| w * 2e-3).collect();
        let unit: Vec<f64> = nm.iter().map(|&w| w * 2e-3 / photons_to_energy(w)).collect();
        let fields = |l: Vec<(&str, Value)>| {
            Value::Struct(l.into_iter().map(|(n, v)| (n.to_string(), v)).collect())
        };
        // Two pixels in one row; photons = c0 + c1 · band + mean.
        let mean: Vec<f64> = (0..31).map(|_| 5e14).collect();
        let save = |energy: Vec<f64>, of_light: Vec<f64>| {
            let coefficients = Array::doubles(vec![1, 2, 2], [1e15, 2e15, 1e14, -3e14]);
            let basis = Value::Array(Array::doubles(vec![31, 2], basis.clone()));
            let basis = fields(vec![("basis", basis), ("wave", row(nm.clone()))]);
            let light = fields(vec![("data", row(energy)), ("wavelength", row(of_light))]);
            let all = [
                ("mcCOEF", Value::Array(coefficients)),
                ("basis", basis),
                ("imgMean", row(mean.clone())),
                ("illuminant", light),
            ];
            matlab_write::write(&path, &all).unwrap();
        };
        // An illuminant that ends before the scene does, and one of other places.
        let notes = |why: &str| {
            let scene = open_scene(path.to_str().unwrap()).unwrap();
            assert_eq!(scene.quantity(), Quantity::Radiance);
            assert!(scene.notes().iter().any(|note| note.contains(why)), "{:?}", scene.notes());
        };
        save(energy[..20].to_vec(), nm[..20].to_vec());
        notes("is of 400 to 590 nm and does not reach 600 nm");
        save(energy.repeat(2), nm.clone());
        notes("62 values at 31 wavelengths");
        save(energy.clone(), nm.clone());
        let scene = open_scene(path.to_str().unwrap()).unwrap();
        assert_eq!(scene.quantity(), Quantity::Reflectance);
        let grid = Grid { width: 2, height: 1, left: -0.5, top: -0.25, cell: 0.5 };
        for band in [0usize, 5, 30] {
            let b = band as f64;
            let plane = scene.plane(band, &grid).unwrap();
            for (x, photons) in [1e15 + 1e14 * b + 5e14, 2e15 - 3e14 * b + 5e14].iter().enumerate()
            {
                let expected = photons.max(0.0) / unit[band];
                assert!((f64::from(plane.data[x]) - expected).abs() < 1e-6 * (1.0 + expected));
            }
        }
    }
}
