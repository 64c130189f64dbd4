//! Raw files.

use crate::arrays::{Stack, array};
use crate::errors::OrRaise;
use camrig::camera::Cfa;
use camrig::formats::{Facts, Format, Frames, read};
use camrig::output;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Frames of a file, and what it says about them.
#[pyfunction]
pub fn read_raw<'py>(
    py: Python<'py>,
    path: PathBuf,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyDict>)> {
    let frames = py.detach(|| read(&path)).or_raise()?;
    let (count, height, width) = (frames.planes.len(), frames.height(), frames.width());
    let facts = PyDict::new(py);
    facts.set_item("bits", frames.facts.bits)?;
    facts.set_item("cfa", frames.facts.cfa.as_ref().map(Cfa::to_string))?;
    facts.set_item("black_level_dn", frames.facts.black_level_dn)?;
    facts.set_item("white_level_dn", frames.facts.white_level_dn)?;
    facts.set_item("notes", &frames.facts.notes)?;
    let mut planes = frames.planes.into_iter();
    let samples = match (planes.next(), count) {
        (Some(only), 1) => array(py, only.data, [height, width])?.into_any(),
        (first, _) => {
            let all = first.into_iter().chain(planes).flat_map(|plane| plane.data);
            PyArray1::from_iter(py, all).reshape([count, height, width])?.into_any()
        }
    };
    Ok((samples, facts))
}

/// Writes frames in the format of the file's name.
#[pyfunction]
#[pyo3(signature = (path, frames, *, bits, cfa = None, black_level_dn = None,
                    white_level_dn = None, overwrite = false))]
#[allow(clippy::too_many_arguments, reason = "named arguments of Python")]
pub fn write_raw(
    py: Python<'_>,
    path: PathBuf,
    frames: &Bound<'_, PyAny>,
    bits: u32,
    cfa: Option<&str>,
    black_level_dn: Option<f64>,
    white_level_dn: Option<u16>,
    overwrite: bool,
) -> PyResult<()> {
    let stack = Stack::of("frames", frames)?;
    let facts = Facts {
        bits: Some(bits),
        cfa: cfa.map(Cfa::parse).transpose().or_raise()?,
        black_level_dn,
        white_level_dn,
        ..Facts::default()
    };
    py.detach(|| -> camrig::Result<()> {
        let planes = (0..stack.count).map(|n| stack.plane(n)).collect();
        let bytes = Format::from_path(&path)?.encode(&Frames { planes, facts })?;
        output::write_file(&path, overwrite, &bytes)
    })
    .or_raise()
}
