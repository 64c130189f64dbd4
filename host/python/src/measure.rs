//! Figures of captures and frames. Each function returns JSON, which Python's half reads.

use crate::arrays::Stack;
use crate::captures::Captures;
use crate::errors::OrRaise;
use camrig::Result;
use camrig::clean::{self, Cleaned};
use camrig::measure::{self, dark_stack, figure, gains, mtf as edges};
use pyo3::prelude::*;
use serde_json::json;

/// Photon transfer.
#[pyfunction]
pub fn ptc(py: Python<'_>, captures: &Bound<'_, Captures>) -> PyResult<String> {
    let set = captures.get().set.clone();
    let figures = py.detach(|| -> Result<_> {
        let (set, found) = Cleaned::for_measurements(set, &clean::Options::default())?;
        let mut result = measure::ptc::measure(&set)?;
        result.notes.splice(0..0, found);
        result.json(gains::measure(&set)?.as_ref())
    });
    Ok(json!(figures.or_raise()?).to_string())
}

/// EMVA 1288.
#[pyfunction]
pub fn emva(py: Python<'_>, captures: &Bound<'_, Captures>) -> PyResult<String> {
    let set = captures.get().set.clone();
    let figures = py.detach(|| -> Result<_> {
        let (set, found) = Cleaned::for_measurements(set, &clean::Options::default())?;
        let mut result = measure::emva::measure(&set)?;
        result.warnings.splice(0..0, found);
        result.json()
    });
    Ok(json!(figures.or_raise()?).to_string())
}

/// Dark stacks of a set.
#[pyfunction]
pub fn dark(
    py: Python<'_>,
    captures: &Bound<'_, Captures>,
    dn_per_e: Option<f64>,
) -> PyResult<String> {
    let set = &captures.get().set;
    let figures = py.detach(|| dark_stack::json_of_set(&dark_stack::of_set(set)?, dn_per_e));
    Ok(json!(figures.or_raise()?).to_string())
}

/// Slanted edges of frames.
#[pyfunction]
pub fn mtf(
    py: Python<'_>,
    frames: &Bound<'_, PyAny>,
    cfa: &str,
    channels: Option<Vec<char>>,
    regions: Vec<[usize; 4]>,
    white_level_dn: Option<u16>,
    pitch_um: Option<f64>,
) -> PyResult<String> {
    let stack = Stack::of("frames", frames)?;
    let cfa = camrig::camera::Cfa::parse(cfa).or_raise()?;
    let found = py.detach(|| -> Result<_> {
        let planes: Vec<_> = (0..stack.count).map(|n| (stack.plane(n), white_level_dn)).collect();
        let letters = channels.unwrap_or_else(|| cfa.channels());
        let given =
            regions.iter().map(|&[x, y, width, height]| edges::Roi { x, y, width, height });
        let regions: Vec<edges::Roi> = given.collect();
        figure::object(&edges::edges(&planes, &cfa, &letters, &regions, pitch_um)?)
    });
    Ok(json!(found.or_raise()?).to_string())
}

/// A camera file of captures, with the values in it and what to know about them.
#[pyfunction]
pub fn fit(
    py: Python<'_>,
    captures: &Bound<'_, Captures>,
    name: String,
    like: Option<String>,
    given: Vec<String>,
    dn_per_e: Option<f64>,
) -> PyResult<String> {
    let set = &captures.get().set;
    let found = py.detach(|| -> Result<_> {
        let given = given.iter().map(|text| text.parse()).collect::<Result<_>>()?;
        let mut options = camrig::fit::Options::default();
        options.name = name;
        options.like = like;
        options.given = given;
        options.dn_per_e = dn_per_e;
        let fitted = camrig::fit::fit(set, &options)?;
        Ok(json!({
            "toml": fitted.draft.text(),
            "values": fitted.values(),
            "notes": fitted.notes,
        }))
    });
    Ok(found.or_raise()?.to_string())
}
