//! The compiled half of the Python package `camrig`, whose other half is in `python/camrig`: what
//! each call of the library takes and gives, as numpy arrays and plain Python values. Nothing is
//! computed here; the texts for users are in `python/camrig/_camrig.pyi`.

mod arrays;
mod augment;
mod batch;
mod camera;
mod captures;
mod diagnosis;
mod errors;
mod files;
mod measure;
mod render;
mod working;

use pyo3::prelude::*;

/// The compiled half of `camrig`.
#[pymodule]
mod _camrig {
    #[pymodule_export]
    use super::augment::expose_electrons;
    #[pymodule_export]
    use super::batch::Batch;
    #[pymodule_export]
    use super::camera::{Camera, effects, presets};
    #[pymodule_export]
    use super::captures::Captures;
    #[pymodule_export]
    use super::diagnosis::{Diagnosis, compare, diagnose};
    #[pymodule_export]
    use super::errors::CamrigError;
    #[pymodule_export]
    use super::files::{read_raw, write_raw};
    #[pymodule_export]
    use super::main;
    #[pymodule_export]
    use super::measure::{dark, emva, fit, mtf, ptc};
    #[pymodule_export]
    use super::render::{Irradiance, irradiance};

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}

/// Runs the program on arguments, of which the first is its name; returns its exit status.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<std::ffi::OsString>) -> u8 {
    let status = py.detach(|| camrig_cli::main_of(arguments));
    (0..=u8::MAX).find(|code| std::process::ExitCode::from(*code) == status).unwrap_or(2)
}
