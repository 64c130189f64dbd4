//! Irradiance on the sensor, and frames of it.

use crate::arrays::array;
use crate::camera::Camera;
use crate::errors::{OrRaise, raised};
use crate::working::{self, Step};
use camrig::exposure::hdr::{HdrSensor, Sent};
use camrig::exposure::{Arithmetic, IrradianceCube, SimulatedSensor};
use camrig::light::LightLevel;
use camrig::optics::{Options, content};
use camrig::render::auto_exposure::{self, Brightness};
use camrig::render::{OpticsPath, OpticsStage};
use camrig::rig::SensorStage;
use camrig::{Error, RawFrame};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ffi::CString;
use std::path::PathBuf;
use std::sync::Mutex;

/// Spectral irradiance on a sensor.
#[pyclass(frozen, module = "camrig")]
pub struct Irradiance {
    cube: IrradianceCube,
    notes: Vec<String>,
}

/// The irradiance of a scene on a camera's sensor.
#[pyfunction]
#[pyo3(signature = (camera, scene, *, illuminant = None, lux = None, luminance = None,
                    scene_irradiance = None, oversample = None, cache = true, progress = None))]
#[allow(clippy::too_many_arguments, reason = "named arguments of Python")]
pub fn irradiance(
    py: Python<'_>,
    camera: &Bound<'_, Camera>,
    scene: String,
    illuminant: Option<String>,
    lux: Option<f64>,
    luminance: Option<f64>,
    scene_irradiance: Option<f64>,
    oversample: Option<usize>,
    cache: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Irradiance> {
    let levels = [
        lux.map(LightLevel::Lux),
        luminance.map(LightLevel::Luminance),
        scene_irradiance.map(LightLevel::Irradiance),
    ];
    let mut given = levels.into_iter().flatten();
    let level = given.next();
    if given.next().is_some() {
        return Err(Error::input("several light levels")
            .help("give one of lux, luminance and scene_irradiance"))
        .or_raise();
    }
    let stage = OpticsStage {
        scene,
        illuminant,
        level,
        options: Options { oversample, ..Options::default() },
        cache: if cache { content::directory() } else { None },
        motion: None,
        path: OpticsPath::Bands,
    };
    let camera = &camera.get().camera;
    let output = working::run(py, progress, |step| {
        let tell = |done, total| step(Step { what: "optics".into(), done, total });
        stage.run(camera, tell).or_raise()
    })?;
    Ok(Irradiance { cube: output.cube, notes: output.notes })
}

#[pymethods]
impl Irradiance {
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let cube = py.detach(|| IrradianceCube::open(&path)).or_raise()?;
        Ok(Self { cube, notes: Vec::new() })
    }

    #[pyo3(signature = (path, *, overwrite = false))]
    fn save(&self, py: Python<'_>, path: PathBuf, overwrite: bool) -> PyResult<()> {
        py.detach(|| self.cube.save(&path, overwrite)).or_raise()
    }

    #[getter]
    fn shape(&self) -> (usize, usize, usize) {
        let header = &self.cube.header;
        (header.bands, header.height, header.width)
    }

    #[getter]
    fn wavelengths_nm<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.cube.header.spectral_bands().centres())
    }

    #[getter]
    fn lux(&self) -> Option<f64> {
        self.cube.header.lux
    }

    #[getter]
    fn made_of(&self) -> &str {
        &self.cube.header.made_of
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// W m⁻² nm⁻¹, bands x height x width.
    fn array<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let header = &self.cube.header;
        let (width, height, bands) = (header.width, header.height, header.bands);
        if header.holds_electrons() {
            return Err(Error::unsupported("an array of a cube of electrons per second")
                .help("compute the irradiance with path = bands"))
            .or_raise();
        }
        let values = py.detach(|| -> camrig::Result<Vec<f32>> {
            let mut values = Vec::with_capacity(bands * height * width);
            for band in 0..bands {
                values.extend(self.cube.plane(band)?.data);
            }
            Ok(values)
        });
        PyArray1::from_vec(py, values.or_raise()?).reshape([bands, height, width])
    }

    /// The frames that a camera takes of it, one after the other.
    #[pyo3(signature = (camera, exposure, *, gain = None, frames = None, first_frame = 0,
                        arithmetic = "f32", rig = None))]
    #[allow(clippy::too_many_arguments, reason = "named arguments of Python")]
    fn _frames(
        slf: Bound<'_, Self>,
        py: Python<'_>,
        camera: Py<Camera>,
        exposure: Exposure,
        gain: Option<f64>,
        frames: Option<u32>,
        first_frame: u32,
        arithmetic: &str,
        rig: Option<String>,
    ) -> PyResult<Frames> {
        let arithmetic: Arithmetic = arithmetic.parse().map_err(|e: Error| raised(&e))?;
        let cube = slf.get();
        let model = camera.get().camera.clone().starting_at(first_frame);
        let sensor = py.detach(|| Sensor::new(&model, &cube.cube)).or_raise()?;
        let exposure_s = match exposure {
            Exposure::Seconds(seconds) => seconds,
            Exposure::Word(word) => {
                let brightness = brightness(&word).or_raise()?;
                let first = sensor.first();
                let found = py.detach(|| {
                    auto_exposure::exposure_s(&model, first, &cube.cube, gain, brightness)
                });
                let found = found.or_raise()?;
                if let Some(clipping_s) = found.clipping_s {
                    let words = format!(
                        "exposure {} s, since {clipping_s} s clips highlights of a channel",
                        found.exposure_s
                    );
                    let category = py.get_type::<PyUserWarning>();
                    PyErr::warn(py, &category, &CString::new(words)?, 1)?;
                }
                found.exposure_s
            }
        };
        let stage = py
            .detach(|| {
                let mut stage = SensorStage::open(rig.as_deref(), arithmetic)?;
                match &sensor {
                    Sensor::One(sensor) => stage.set_camera(sensor)?,
                    Sensor::Several(sensor) => stage.set_captures(sensor)?,
                }
                Ok(stage)
            })
            .or_raise()?;
        let irradiance = slf.unbind();
        let taking = Taking {
            camera: model,
            sensor,
            stage,
            exposure_s,
            gain,
            next: first_frame,
            left: frames,
            previous_s: None,
        };
        Ok(Frames { irradiance, taking: Mutex::new(taking) })
    }
}

/// Seconds, `auto` or `auto:SHARE`.
#[derive(FromPyObject)]
enum Exposure {
    Seconds(f64),
    Word(String),
}

fn brightness(word: &str) -> camrig::Result<Brightness> {
    let share = word.strip_prefix("auto:").and_then(|share| share.parse::<f64>().ok());
    match share.filter(|share| *share > 0.0 && share.is_finite()) {
        Some(share) => Ok(Brightness::Mean(share)),
        None if word == "auto" => Ok(Brightness::Highlights),
        None => Err(Error::input(format!("exposure = {word:?}")).help(
            "give seconds, \"auto\", or \"auto:SHARE\" for a mean of green of this part of full \
             scale",
        )),
    }
}

/// A sensor with one capture or several.
enum Sensor {
    One(Box<SimulatedSensor>),
    Several(Box<HdrSensor>),
}

impl Sensor {
    fn new(camera: &camrig::camera::Camera, cube: &IrradianceCube) -> camrig::Result<Self> {
        Ok(match camera.sensor.hdr {
            None => Self::One(Box::new(SimulatedSensor::new(camera, &cube.header)?)),
            Some(_) => Self::Several(Box::new(HdrSensor::in_light(camera, &cube.header, 1.0)?)),
        })
    }

    fn first(&self) -> &SimulatedSensor {
        match self {
            Self::One(sensor) => sensor,
            Self::Several(sensor) => &sensor.captures()[0],
        }
    }
}

/// Frames in time: an iterator, as each depends on what the one before left in the pixels.
#[pyclass(frozen, module = "camrig", name = "_Frames")]
pub struct Frames {
    irradiance: Py<Irradiance>,
    taking: Mutex<Taking>,
}

/// A camera that takes frames.
struct Taking {
    camera: camrig::camera::Camera,
    sensor: Sensor,
    stage: SensorStage,
    exposure_s: f64,
    gain: Option<f64>,
    next: u32,
    /// Frames still to come; without end if not given.
    left: Option<u32>,
    previous_s: Option<f32>,
}

impl Taking {
    /// Names of the captures of one exposure, where there are several.
    fn captures(&self) -> Vec<String> {
        let captures = self.camera.sensor.hdr.iter().flat_map(|hdr| &hdr.captures);
        captures.map(|capture| capture.name.clone()).collect()
    }

    fn take(&mut self, cube: &IrradianceCube) -> camrig::Result<Sent> {
        let mut settings = self.camera.settings(self.next, self.exposure_s, self.gain);
        settings.previous_exposure_s = self.previous_s;
        let before = self.previous_s.is_some().then_some(cube);
        let stage = &mut self.stage;
        let taken = match &self.sensor {
            Sensor::One(sensor) => Sent::Merged(stage.frame(sensor, cube, before, &settings)?),
            Sensor::Several(sensor) => {
                let before = before.map(|cube| [cube]);
                stage.sent(sensor, &[cube], before.as_ref().map(|b| &b[..]), &settings)?
            }
        };
        self.previous_s = Some(settings.exposure_s);
        self.next = self.next.wrapping_add(1);
        Ok(taken)
    }
}

#[pymethods]
impl Frames {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        py.check_signals()?;
        let cube = &self.irradiance.get().cube;
        let taken = py.detach(|| {
            let mut taking = self.taking.lock().unwrap_or_else(|e| e.into_inner());
            if taking.left == Some(0) {
                return Ok(None);
            }
            taking.left = taking.left.map(|left| left - 1);
            Ok(Some((taking.take(cube)?, taking.captures())))
        });
        let Some((sent, names)) = taken.or_raise()? else { return Ok(None) };
        Ok(Some(match sent {
            Sent::Merged(frame) => samples(py, frame)?,
            Sent::Wide(frame) => samples(py, frame)?,
            Sent::Captures(frames) => {
                let all = PyDict::new(py);
                for (frame, name) in frames.into_iter().zip(names) {
                    all.set_item(name, samples(py, frame)?)?;
                }
                all.into_any()
            }
        }))
    }
}

fn samples<S: numpy::Element>(py: Python<'_>, frame: RawFrame<S>) -> PyResult<Bound<'_, PyAny>> {
    Ok(array(py, frame.data, [frame.height, frame.width])?.into_any())
}
