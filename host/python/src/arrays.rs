//! numpy arrays: results that are handed over, arguments that are shared; neither is copied.

use crate::errors::OrRaise;
use camrig::captures::Held;
use camrig::{Error, Plane};
use numpy::{Element, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray3};
use numpy::{PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Samples, row by row, as an array of `height` x `width`.
pub fn array<T: Element>(
    py: Python<'_>,
    data: Vec<T>,
    [height, width]: [usize; 2],
) -> PyResult<Bound<'_, PyArray2<T>>> {
    PyArray1::from_vec(py, data).reshape([height, width])
}

/// A stack of frames: uint16 of frames x height x width, or of one frame.
pub struct Stack {
    /// Frames.
    pub count: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// The samples.
    pub held: Held,
    /// The largest sample, DN.
    pub largest: u16,
}

impl Stack {
    /// Of a numpy array, of which `name` tells the user.
    ///
    /// # Errors
    /// Another kind of array, another shape, nothing in it.
    pub fn of(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let wrong = |what: String| {
            Error::input(what).at(name).help(
                "give a numpy array of uint16, frames x height x width, in C order: \
                 numpy.ascontiguousarray(frames, dtype=numpy.uint16) if its values are whole DN",
            )
        };
        let Ok(any) = value.cast::<PyUntypedArray>() else {
            return Err(wrong(format!("a {}", value.get_type().name()?))).or_raise();
        };
        let shape = any.shape().to_vec();
        let is = || format!("an array of {} and shape {shape:?}", any.dtype());
        let frames = match any.ndim() {
            2 => any.call_method1("reshape", ((1, shape[0], shape[1]),))?,
            _ => value.clone(),
        };
        let Ok(frames) = frames.cast::<PyArray3<u16>>() else {
            return Err(wrong(is())).or_raise();
        };
        let Ok(samples) = Samples::of(frames) else {
            return Err(wrong(format!("{}, not in C order", is()))).or_raise();
        };
        let [count, height, width] = [0, 1, 2].map(|axis| frames.shape()[axis]);
        let largest = samples.as_ref().iter().copied().max().unwrap_or(0);
        let held = Held::new(width, height, samples).map_err(|e| e.at(name)).or_raise()?;
        Ok(Self { count, height, width, held, largest })
    }

    /// Frame `n`.
    pub fn plane(&self, n: usize) -> Plane<u16> {
        let size = self.width * self.height;
        let data = self.held.samples()[n * size..(n + 1) * size].to_vec();
        Plane { width: self.width, height: self.height, data }
    }
}

/// The samples of an array, which lives as long as they do.
pub struct Samples {
    /// Holds the array, and keeps Rust from writing to it.
    _array: Py<PyArray3<u16>>,
    first: *const u16,
    count: usize,
}

// SAFETY: the samples are only read, and the array that owns them is held. As everywhere in numpy,
// who writes to an array while a call reads it gets a mixture of old and new values.
unsafe impl Send for Samples {}
// SAFETY: as above.
unsafe impl Sync for Samples {}

impl Samples {
    fn of(array: &Bound<'_, PyArray3<u16>>) -> PyResult<Self> {
        let read: PyReadonlyArray3<'_, u16> = array.try_readonly()?;
        let samples = read.as_slice()?;
        let (first, count) = (samples.as_ptr(), samples.len());
        Ok(Self { _array: array.clone().unbind(), first, count })
    }
}

impl AsRef<[u16]> for Samples {
    fn as_ref(&self) -> &[u16] {
        // SAFETY: the array of `count` samples in C order from `first` on is held by `_array`, and
        // numpy does not move the samples of an array that others refer to.
        unsafe { std::slice::from_raw_parts(self.first, self.count) }
    }
}
