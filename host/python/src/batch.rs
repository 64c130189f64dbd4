//! Data sets of a sweep, picture by picture.

use crate::errors::OrRaise;
use camrig::batch::{self, Dataset, Sweep};
use camrig::optics::{Device, content};
use pyo3::prelude::*;
use std::path::PathBuf;

/// A sweep and the data set that is made of it.
#[pyclass(frozen, module = "camrig", name = "_Batch")]
pub struct Batch {
    sweep: Sweep,
    dataset: Dataset,
}

#[pymethods]
impl Batch {
    #[new]
    fn new(py: Python<'_>, sweep: PathBuf, directory: PathBuf) -> PyResult<Self> {
        py.detach(|| {
            let sweep = Sweep::load(&sweep)?;
            let dataset = Dataset::open(&directory, &sweep)?;
            Ok(Self { sweep, dataset })
        })
        .or_raise()
    }

    fn __len__(&self) -> usize {
        self.sweep.pictures() as usize
    }

    /// Makes one picture, if it is not there yet.
    fn make(&self, py: Python<'_>, index: u64) -> PyResult<()> {
        py.detach(|| {
            let (cpu, cache) = (Device::Cpu, content::directory());
            let only = index..index + 1;
            batch::run(&self.sweep, &self.dataset, only, cpu, cache, || (), |_| ())
        })
        .or_raise()
    }
}
