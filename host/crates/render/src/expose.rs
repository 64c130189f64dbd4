//! The sensor stage on the workstation: frames from an irradiance cube, in parallel over rows.

use super::made_for::holds_electrons;
use camrig_base::{Error, Plane, RawFrame, Result};
use camrig_camera::{Camera, CrosstalkTable};
use camrig_exposure::rows::{BandSums, Vector, refused, rows};
use camrig_exposure::{Chunk, IrradianceCube};
use camrig_sensor_core::arith::{Arith, BLOCK, Block, Fixed, Float, blocks};
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::effects::Needs;
use camrig_sensor_core::pipeline::MeanRows;
use rayon::prelude::*;

/// Arithmetic of the sensor stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Arithmetic {
    /// 32-bit floating point.
    #[default]
    F32,
    /// 32-bit fixed point, as on parts without a floating-point unit.
    Fixed,
}

impl Arithmetic {
    /// All choices, in the order of a list for people.
    pub const ALL: [Self; 2] = [Self::F32, Self::Fixed];

    /// The name in files and on command lines.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::Fixed => "fixed",
        }
    }
}

impl std::fmt::Display for Arithmetic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Arithmetic {
    type Err = camrig_base::Error;

    fn from_str(text: &str) -> Result<Self> {
        camrig_base::choice::by_name("arithmetic", text, &Self::ALL, Self::name)
    }
}

/// Rows computed by one task.
const ROWS_PER_TASK: usize = 32;

/// A camera's sensor set up for cubes of given bands.
pub struct SimulatedSensor {
    /// The sensor as `sensor-core` takes it.
    pub config: SensorConfig,
    crosstalk: Option<CrosstalkTable>,
    cfa: camrig_base::Cfa,
}

impl SimulatedSensor {
    /// The sensor of `camera` in front of irradiance of these bands; `light` multiplies the
    /// irradiance (another light level than the cube was made for).
    pub fn new(camera: &Camera, header: &super::CubeHeader, light: f64) -> Result<Self> {
        let sensor = &camera.sensor;
        if (header.width, header.height) != (sensor.width as usize, sensor.height as usize) {
            return Err(Error::disagreement(format!(
                "irradiance of {} x {} pixels for a sensor of {} x {}",
                header.width, header.height, sensor.width, sensor.height
            ))
            .help("use the camera for which the irradiance was made, or simulate it anew"));
        }
        let mut config = camera.sensor_config(&header.spectral_bands())?;
        let light = light * header.level;
        let electrons = holds_electrons(header);
        for response in &mut config.response {
            // Electrons per second are what the response would make of the bands.
            let own = if electrons { 1.0 } else { f64::from(*response) };
            *response = (own * light) as f32;
        }
        config.check().map_err(refused)?;
        Ok(Self { config, crosstalk: sensor.crosstalk.clone(), cfa: sensor.cfa.clone() })
    }

    /// One frame of `cube`. `before` is what the sensor saw in the frame before (for effects with
    /// a memory).
    pub fn frame(
        &self,
        cube: &IrradianceCube,
        before: Option<&IrradianceCube>,
        settings: &FrameSettings,
        arithmetic: Arithmetic,
    ) -> Result<RawFrame> {
        settings.check().map_err(refused)?;
        let width = self.config.width as usize;
        let mut data = vec![0; width * self.config.height as usize];
        let inputs = Inputs { sensor: self, cube, before, settings };
        data.par_chunks_mut(width * ROWS_PER_TASK).enumerate().try_for_each(|(i, out)| {
            let first = i * ROWS_PER_TASK;
            match arithmetic {
                Arithmetic::F32 => cube_rows::<Float>(&inputs, first, out),
                Arithmetic::Fixed => cube_rows::<Fixed>(&inputs, first, out),
            }
        })?;
        Ok(self.raw_frame(data, settings.analog_gain))
    }

    /// Mean photo-electrons of every pixel, before any effect.
    ///
    /// # Errors
    /// Irradiance that cannot be read.
    pub fn electrons(
        &self,
        cube: &IrradianceCube,
        settings: &FrameSettings,
    ) -> Result<Plane<f32>> {
        let (width, height) = (self.config.width as usize, self.config.height as usize);
        let mut data = vec![0.0; width * height];
        let inputs = Inputs { sensor: self, cube, before: None, settings };
        data.par_chunks_mut(width * ROWS_PER_TASK)
            .enumerate()
            .try_for_each(|(i, out)| electrons(&inputs, i * ROWS_PER_TASK, out))?;
        Ok(Plane { width, height, data })
    }

    /// A frame of this sensor from its DN, however they were computed.
    pub fn raw_frame(&self, data: Vec<u16>, analog_gain: f32) -> RawFrame {
        RawFrame {
            width: self.config.width as usize,
            height: self.config.height as usize,
            bits: u32::from(self.config.bits),
            cfa: self.cfa.clone(),
            black_level_dn: f64::from(self.config.black_level_dn),
            white_level_dn: self.white_level_dn(analog_gain),
            data,
        }
    }

    /// The crosstalk table as `sensor-core` takes it.
    pub fn crosstalk(&self) -> Option<camrig_sensor_core::crosstalk::Crosstalk<'_>> {
        self.crosstalk.as_ref().map(CrosstalkTable::as_core)
    }

    /// DN at which a pixel saturates: full well or the converter's end, whichever comes first.
    fn white_level_dn(&self, analog_gain: f32) -> u16 {
        let full = self.config.dn_per_e(analog_gain) * self.config.full_well_e;
        (full + self.config.black_level_dn).min(f32::from(self.config.max_dn())) as u16
    }
}

struct Inputs<'a> {
    sensor: &'a SimulatedSensor,
    cube: &'a IrradianceCube,
    before: Option<&'a IrradianceCube>,
    settings: &'a FrameSettings,
}

/// Computes the rows from `first` on that fill `out`.
fn cube_rows<A: Vector>(inputs: &Inputs<'_>, first: usize, out: &mut [u16]) -> Result<()> {
    let config = &inputs.sensor.config;
    let (width, height) = (config.width as usize, config.height as usize);
    let windows = config.effects.iter().filter(|e| e.entry().needs == Needs::Neighbours).count();
    let count = out.len() / width;
    let from = first.saturating_sub(windows);
    let to = (first + count + windows).min(height);
    let crosstalk = inputs.sensor.crosstalk();
    let mut source = CubeRows::<A> {
        sums: BandSums::new(config, inputs.settings, crosstalk)?,
        now: load(inputs.cube, from, to)?,
        before: inputs.before.map(|cube| load(cube, from, to)).transpose()?,
    };
    rows::<A>(config, inputs.settings, &mut source, first, out)
}

/// Mean photo-electrons of the rows from `first` on.
fn electrons(inputs: &Inputs<'_>, first: usize, out: &mut [f32]) -> Result<()> {
    let config = &inputs.sensor.config;
    let width = config.width as usize;
    let rows = out.len() / width;
    let crosstalk = inputs.sensor.crosstalk();
    let mut sums = BandSums::<Float>::new(config, inputs.settings, crosstalk)?;
    let bands = load(inputs.cube, first, first + rows)?;
    let mut row = vec![[0.0; BLOCK]; blocks(width)];
    for (y, out) in (first..).zip(out.chunks_mut(width)) {
        Float::COLLECT(&mut sums, &bands, y as u32, &mut row);
        out.copy_from_slice(&row.as_flattened()[..width]);
    }
    Ok(())
}

/// Rows of every band.
fn load(cube: &IrradianceCube, from: usize, to: usize) -> Result<Vec<Chunk<'_>>> {
    (0..cube.header.bands).map(|band| cube.chunk(band, from, to - from)).collect()
}

/// Mean photo-electrons from the rows of a cube.
struct CubeRows<'a, A: Arith> {
    sums: BandSums<'a, A>,
    now: Vec<Chunk<'a>>,
    before: Option<Vec<Chunk<'a>>>,
}

impl<A: Vector> MeanRows<A> for CubeRows<'_, A> {
    fn mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        A::COLLECT(&mut self.sums, &self.now, row, out);
    }

    fn previous_mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        match &self.before {
            Some(bands) => A::COLLECT(&mut self.sums, bands, row, out),
            None => out.fill([A::Signal::default(); BLOCK]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SceneLight, scene_irradiance};
    use camrig_camera::KeptNoise;
    use camrig_optics::Options;

    /// Of a grey card with every kind of noise in the camera: what is left of each pixel after its
    /// mean signal, in frames 0 and 1, e⁻; and electrons per DN.
    fn residuals(kept: KeptNoise) -> ([Vec<f64>; 2], Vec<f64>, f64) {
        let keys = [
            ("sensor.width", toml::Value::from(256)),
            ("sensor.height", 192.into()),
            ("effect.hot-pixels.fraction", 0.01.into()),
            ("effect.hot-pixels.mean_e_per_s", 1e4.into()),
            ("effect.column-offset-fpn.sigma_e", 20.0.into()),
            ("effect.row-temporal-noise.sigma_e", 20.0.into()),
        ];
        let keys = keys.map(|(key, value)| (key.to_string(), value));
        let mut camera = Camera::load_with("mt9v024", &keys).unwrap();
        camera.keep_noise(kept);
        let (light, options) = (SceneLight::lux("D65", 300.0), Options::default());
        let cube = scene_irradiance(&camera, "uniform:0.3", &light, &options, |_, _| ());
        let cube = cube.unwrap().cube;
        let sensor = SimulatedSensor::new(&camera, &cube.header, 1.0).unwrap();
        let mean = sensor.electrons(&cube, &camera.settings(0, 0.01, None)).unwrap().data;
        let max_dn = f64::from((1u32 << camera.sensor.bits) - 1);
        let e_per_dn = camera.sensor.full_well_e / max_dn;
        let frame = |number| {
            let settings = camera.settings(number, 0.01, None);
            let frame = sensor.frame(&cube, None, &settings, Arithmetic::F32).unwrap();
            let signal = |dn: &u16| (f64::from(*dn) - camera.sensor.black_level_dn) * e_per_dn;
            frame.data.iter().zip(&mean).map(|(dn, e)| signal(dn) - f64::from(*e)).collect()
        };
        let frames: [Vec<f64>; 2] = [0, 1].map(frame);
        (frames, mean.into_iter().map(f64::from).collect(), e_per_dn)
    }

    #[test]
    fn without_noise_pixels_have_their_mean_and_with_shot_noise_its_variance() {
        let ([first, second], mean, e_per_dn) = residuals(KeptNoise::None);
        assert_eq!(first, second);
        assert!(mean[0] > 20.0 * e_per_dn, "{}", mean[0]);
        assert!(first.iter().all(|left| left.abs() < 0.5001 * e_per_dn));

        let ([first, second], mean, e_per_dn) = residuals(KeptNoise::Shot);
        let expected = mean.iter().sum::<f64>() / mean.len() as f64 + e_per_dn * e_per_dn / 12.0;
        let square = |v: &[f64]| v.iter().map(|e| e * e).sum::<f64>() / v.len() as f64;
        // 49,152 pixels: 0.6 % of a variance.
        assert!((square(&first) / expected - 1.0).abs() < 0.03, "{}", square(&first) / expected);
        // No part of it is the same in two frames.
        let common: f64 = first.iter().zip(&second).map(|(a, b)| a * b).sum();
        assert!((common / first.len() as f64 / expected).abs() < 0.03);
    }
}
