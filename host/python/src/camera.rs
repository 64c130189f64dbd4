//! Cameras.

use crate::errors::OrRaise;
use camrig::camera::{self, Change};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Where a camera file comes from.
#[derive(Clone)]
enum Source {
    /// A preset or a file.
    Named(String),
    /// A text, and the folder of the files that it names.
    Text(String, PathBuf),
}

/// A camera: lens, sensor and effects. Immutable.
#[pyclass(frozen, module = "camrig")]
pub struct Camera {
    source: Source,
    changes: Vec<Change>,
    /// The camera.
    pub camera: camera::Camera,
}

impl Camera {
    fn new(source: Source, changes: Vec<Change>) -> camrig::Result<Self> {
        let camera = match &source {
            Source::Named(name) => camera::Camera::load_with(name, &changes),
            Source::Text(text, folder) => camera::Camera::from_text(text, folder, &changes),
        }?;
        Ok(Self { source, changes, camera })
    }
}

#[pymethods]
impl Camera {
    #[new]
    fn open(py: Python<'_>, camera: &str) -> PyResult<Self> {
        py.detach(|| Self::new(Source::Named(camera.to_owned()), Vec::new())).or_raise()
    }

    #[staticmethod]
    fn from_toml(py: Python<'_>, text: String, folder: PathBuf) -> PyResult<Self> {
        py.detach(|| Self::new(Source::Text(text, folder), Vec::new())).or_raise()
    }

    /// Keys with values, which Python's half has made text of.
    fn _changed(&self, py: Python<'_>, changes: Vec<String>) -> PyResult<Self> {
        let more: Vec<Change> =
            changes.iter().map(|text| text.parse()).collect::<camrig::Result<_>>().or_raise()?;
        let (source, changes) = (self.source.clone(), [&self.changes[..], &more].concat());
        py.detach(|| Self::new(source, changes)).or_raise()
    }

    fn to_toml(&self) -> &str {
        &self.camera.text
    }

    #[getter]
    fn name(&self) -> &str {
        &self.camera.name
    }

    #[getter]
    fn shape(&self) -> (u32, u32) {
        (self.camera.sensor.height, self.camera.sensor.width)
    }

    #[getter]
    fn bits(&self) -> u32 {
        self.camera.sensor.bits.into()
    }

    #[getter]
    fn cfa(&self) -> String {
        self.camera.sensor.cfa.to_string()
    }

    #[getter]
    fn black_level_dn(&self) -> f64 {
        self.camera.sensor.black_level_dn
    }

    fn __repr__(&self) -> String {
        let sensor = &self.camera.sensor;
        let (name, size) = (&self.camera.name, (sensor.width, sensor.height));
        format!("Camera({name:?}, {} x {}, {} bits, {})", size.0, size.1, sensor.bits, sensor.cfa)
    }
}

/// Names of the built-in cameras.
#[pyfunction]
pub fn presets() -> Vec<&'static str> {
    camera::presets::names()
}

/// Effects by name, each with its equation, source and range in words.
#[pyfunction]
pub fn effects(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    for effect in camera::EffectKind::all() {
        all.set_item(effect.kind, effect.doc)?;
    }
    Ok(all)
}
