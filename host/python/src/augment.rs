//! Frames of mean electrons: the sensor without lens and light, for training data.

use crate::camera::Camera;
use crate::errors::{OrRaise, raised};
use camrig::Error;
use camrig::exposure::{Arithmetic, CubeHeader, SimulatedSensor};
use numpy::{PyArray1, PyArray3, PyArrayMethods, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Raw frames, DN, of mean photo-electrons per pixel and exposure (frames x rows x columns); the
/// noise of a frame is that of the frame number in `seeds`.
#[pyfunction]
pub fn expose_electrons<'py>(
    py: Python<'py>,
    camera: &Bound<'py, Camera>,
    electrons: PyReadonlyArray3<'py, f32>,
    seeds: Vec<u32>,
    exposure_s: f64,
    gain: Option<f64>,
    arithmetic: &str,
) -> PyResult<Bound<'py, PyArray3<u16>>> {
    let arithmetic: Arithmetic = arithmetic.parse().map_err(|e: Error| raised(&e))?;
    let camera = &camera.get().camera;
    let [count, height, width] = [0, 1, 2].map(|axis| electrons.shape()[axis]);
    if seeds.len() != count {
        return Err(Error::disagreement(format!("{} seeds of {count} frames", seeds.len()))
            .help("give a seed for each frame"))
        .or_raise();
    }
    if camera.sensor.hdr.is_some() {
        return Err(Error::unsupported("electrons of a sensor of several captures").help(
            "each capture has electrons of its own: give the camera file of one of them, without \
             [sensor.hdr]",
        ))
        .or_raise();
    }
    let means = electrons.as_slice()?;
    let frames = py.detach(|| -> camrig::Result<Vec<u16>> {
        let bands = camrig::scene::Bands::VISIBLE;
        let sensor = SimulatedSensor::new(camera, &CubeHeader::new((width, height), &bands, ""))?;
        let mut samples = Vec::with_capacity(means.len());
        for (means, seed) in means.chunks_exact((width * height).max(1)).zip(seeds) {
            let settings = camera.settings(seed, exposure_s, gain);
            samples.extend(sensor.frame_of_electrons(means, &settings, arithmetic)?.data);
        }
        Ok(samples)
    });
    PyArray1::from_vec(py, frames.or_raise()?).reshape([count, height, width])
}
