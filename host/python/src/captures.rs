//! Capture sets: folders with frames, and stacks that are in memory.

use crate::arrays::Stack;
use crate::errors::OrRaise;
use camrig::Error;
use camrig::captures::{CaptureSet, manifest};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Map, Value, json};
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

    /// Stacks in memory: arrays by their ids, and the manifest that describes them as JSON.
    #[staticmethod]
    fn _of(manifest: &str, arrays: &Bound<'_, PyDict>) -> PyResult<Self> {
        let wrong = |e: serde_json::Error| Error::input(format!("conditions of captures: {e}"));
        let mut text: Map<String, Value> =
            serde_json::from_str(manifest).map_err(wrong).or_raise()?;
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
        text["sensor"]["width"] = json!(width);
        text["sensor"]["height"] = json!(height);
        let text = toml::to_string(&text)
            .map_err(|e| Error::input(format!("conditions of captures: {e}")))
            .or_raise()?;
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
