//! Capture sets: folders with frames, and stacks that are in memory.

use crate::arrays::Stack;
use crate::errors::OrRaise;
use camrig::Error;
use camrig::captures::{CaptureSet, manifest};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Stacks of frames with the conditions under which they were taken.
#[pyclass(frozen, module = "camrig")]
pub struct Captures {
    /// The set.
    pub set: CaptureSet,
}

#[pymethods]
impl Captures {
    /// The set of a folder.
    #[staticmethod]
    fn load(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        Ok(Self { set: py.detach(|| CaptureSet::load(&folder)).or_raise()? })
    }

    /// Stacks in memory: arrays by their ids, and what a manifest says of the sensor and of them,
    /// but for the size of the frames.
    #[staticmethod]
    fn _of(sensor: &str, captures: &str, arrays: &Bound<'_, PyDict>) -> PyResult<Self> {
        let (mut held, mut size, mut largest) = (Vec::new(), None, 0);
        for (id, frames) in arrays {
            let id: String = id.extract()?;
            let stack = Stack::of(&format!("frames of {id:?}"), &frames)?;
            size = size.or(Some([stack.width, stack.height]));
            if size != Some([stack.width, stack.height]) {
                let [width, height] = size.unwrap_or_default();
                return Err(Error::disagreement(format!(
                    "frames of {} x {} pixels in {id:?} beside {width} x {height}",
                    stack.width, stack.height
                ))
                .help("all frames of a set are of one size"))
                .or_raise();
            }
            largest = largest.max(stack.largest);
            held.push(stack.held);
        }
        let Some([width, height]) = size else {
            return Err(Error::input("no captures").help("give one stack of frames at least"))
                .or_raise();
        };
        let text = format!(
            "format = \"captures/1\"\n[sensor]\nwidth = {width}\nheight = {height}\n\
             {sensor}\n{captures}"
        );
        let set = manifest::with_held(&text, held).or_raise()?;
        if u32::from(largest) >> set.sensor.bits != 0 {
            return Err(Error::disagreement(format!(
                "a sample of {largest} DN in {} bits",
                set.sensor.bits
            ))
            .help("give the bits of the sensor's samples"))
            .or_raise();
        }
        Ok(Self { set })
    }

    #[getter]
    fn ids(&self) -> Vec<&str> {
        self.set.captures.iter().map(|capture| &*capture.id).collect()
    }

    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.set.sensor.height, self.set.sensor.width)
    }

    #[getter]
    fn bits(&self) -> u32 {
        self.set.sensor.bits
    }

    fn __repr__(&self) -> String {
        let sensor = &self.set.sensor;
        format!(
            "Captures({} stacks, {} x {}, {} bits)",
            self.set.captures.len(),
            sensor.width,
            sensor.height,
            sensor.bits
        )
    }
}
