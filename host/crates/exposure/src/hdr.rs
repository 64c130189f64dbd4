//! Frames of a sensor that reads each pixel several times.

mod rows;

use super::sensor::{Arithmetic, Inputs, ROWS_PER_TASK, SimulatedSensor};
use super::{CubeHeader, IrradianceCube};
use camrig_base::{Dn, Error, RawFrame, Result};
use camrig_camera::Camera;
use camrig_camera::hdr::{Hdr, HdrOutput};
use camrig_sensor_core::config::FrameSettings;
use camrig_sensor_core::effects::Needs;
use camrig_sensor_core::hdr::{MAX_CAPTURES, Merge, Output, Readout};
use rayon::prelude::*;
use rows::Compander;

/// A camera with `[sensor.hdr]`, set up for cubes of given bands: each capture a sensor, and what
/// is made of their codes.
pub struct HdrSensor {
    sensors: Vec<SimulatedSensor>,
    hdr: Hdr,
    readout: Readout,
    /// Of the camera's curve, where it has one.
    compander: Option<Compander>,
}

impl HdrSensor {
    /// The sensor of `camera` in front of a cube with this header, in another light level than
    /// the cube was made for: `light` multiplies the irradiance.
    ///
    /// # Errors
    /// A camera without `[sensor.hdr]`; a cube of another size than the sensor's, or of electrons
    /// of one response; values that `sensor-core` refuses.
    pub fn in_light(camera: &Camera, header: &CubeHeader, light: f64) -> Result<Self> {
        let hdr = camera.sensor.hdr.clone();
        let hdr = hdr.ok_or_else(|| Error::input("a camera without [sensor.hdr]"))?;
        if header.holds_electrons() {
            return Err(Error::disagreement("electrons of one response for several captures")
                .help("make the irradiance anew, in bands"));
        }
        if camera.chain().iter().any(|e| e.entry().needs == Needs::EarlierFrames) {
            return Err(Error::unsupported("persistence of a sensor of several captures")
                .help("choose one with --capture, or remove the effect from the camera file"));
        }
        let captures = (0..hdr.captures.len()).filter_map(|i| camera.of_capture(i));
        let sensors = captures.map(|camera| SimulatedSensor::in_light(&camera, header, light));
        let readout = hdr.readout();
        let compander = hdr.companding.as_ref().map(Compander::new);
        Ok(Self { sensors: sensors.collect::<Result<_>>()?, hdr, readout, compander })
    }

    /// What the camera's file says of its captures.
    pub fn hdr(&self) -> &Hdr {
        &self.hdr
    }

    /// The same sensor before its curve: it sends the merged signal where it would send codes. A frame
    /// of it becomes codes by [`Self::on_curve`].
    #[must_use]
    pub fn before_curve(mut self) -> Self {
        if matches!(self.readout.output, Output::Companded(_)) {
            self.readout.output = Output::Linear;
        }
        self
    }

    /// What the sensor sends after its curve; the same of a sensor that is not [`Self::before_curve`],
    /// or has none.
    pub fn on_curve(&self, sent: Sent) -> Sent {
        let is_due = self.hdr.output == HdrOutput::Companded
            && matches!(self.readout.output, Output::Linear);
        let curve = self.compander.as_ref().filter(|_| is_due);
        match (curve, sent) {
            (Some(curve), Sent::Wide(frame)) => Sent::Merged(companded(curve, frame)),
            (Some(curve), Sent::Merged(frame)) => Sent::Merged(companded(curve, frame)),
            (_, sent) => sent,
        }
    }

    /// How its captures are taken, and what is sent of them.
    pub fn readout(&self) -> &Readout {
        &self.readout
    }

    /// The sensors of the captures.
    pub fn captures(&self) -> &[SimulatedSensor] {
        &self.sensors
    }

    /// What the sensor sends of a frame under `now`: light that all captures see, or that of each.
    /// `before` is that of the frame before; darkness without it.
    ///
    /// # Errors
    /// Windows of a photodiode that overlap at this exposure; settings out of range or beyond the
    /// arithmetic; irradiance that cannot be read.
    pub fn frame(
        &self,
        now: &[&IrradianceCube],
        before: Option<&[&IrradianceCube]>,
        settings: &FrameSettings,
        arithmetic: Arithmetic,
    ) -> Result<Sent> {
        self.hdr.check_exposure(settings.exposure_s.into())?;
        let captures = self.sensors.iter().zip(&self.hdr.captures).enumerate();
        let inputs = captures.map(|(i, (sensor, capture))| Inputs {
            sensor,
            cube: seen(now, i),
            before: before.map(|cubes| seen(cubes, i)),
            held: &[],
            settings: self.hdr.settings(capture, settings),
        });
        let taking = Taking { merge: &self.hdr.merge, inputs: inputs.collect(), arithmetic };
        taking.inputs.iter().try_for_each(|inputs| inputs.check(arithmetic))?;
        let samples = match (&self.readout.output, &self.compander) {
            (Output::Captures, _) => Samples::Captures(taking.captures()?),
            (Output::Companded(_), Some(curve)) => {
                Samples::Merged(taking.merged(|linear| curve.code(linear))?)
            }
            _ if self.hdr.linear_bits() > u16::BITS => {
                Samples::Wide(taking.merged(|linear| linear)?)
            }
            _ => Samples::Merged(taking.merged(|linear| linear as u16)?),
        };
        Ok(self.described(samples, settings.analog_gain))
    }

    /// The frames of samples that the sensor has sent in a frame of this gain, here or on a rig.
    pub fn described(&self, samples: Samples, analog_gain: f32) -> Sent {
        let (config, hdr) = (&self.sensors[0].config, &self.hdr);
        let (width, height) = (config.width as usize, config.height as usize);
        let cfa = self.sensors[0].cfa().clone();
        let white = hdr.linear_white_dn(analog_gain.into());
        let pedestal = hdr.merge.pedestal_dn();
        match samples {
            Samples::Captures(all) => {
                let settings = FrameSettings::new(1.0).with_gain(analog_gain);
                let captures = all.into_iter().zip(self.sensors.iter().zip(&hdr.captures));
                let frame = |(data, (sensor, capture)): (_, (&SimulatedSensor, _))| {
                    sensor.raw_frame(data, hdr.settings(capture, &settings).analog_gain)
                };
                Sent::Captures(captures.map(frame).collect())
            }
            Samples::Merged(data) => {
                let (bits, black_level_dn, white_level_dn) = match &self.readout.output {
                    Output::Companded(curve) => {
                        (curve.bits.into(), curve.code(pedestal).into(), curve.code(white))
                    }
                    _ => (u16::BITS, pedestal.into(), white as u16),
                };
                Sent::Merged(RawFrame {
                    width,
                    height,
                    bits,
                    cfa,
                    black_level_dn,
                    white_level_dn,
                    data,
                })
            }
            Samples::Wide(data) => Sent::Wide(RawFrame {
                width,
                height,
                bits: hdr.linear_bits(),
                cfa,
                black_level_dn: pedestal.into(),
                white_level_dn: white,
                data,
            }),
        }
    }
}

/// What a capture sees: what all do, or its own light.
pub fn seen<'c>(cubes: &[&'c IrradianceCube], capture: usize) -> &'c IrradianceCube {
    cubes.get(capture).unwrap_or(&cubes[0])
}

/// A frame of several captures.
struct Taking<'a> {
    merge: &'a Merge,
    inputs: Vec<Inputs<'a>>,
    arithmetic: Arithmetic,
}

impl Taking<'_> {
    /// Width and number of pixels.
    fn size(&self) -> (usize, usize) {
        let config = self.inputs.first().map(|inputs| &inputs.sensor.config);
        config.map_or((1, 0), |c| (c.width as usize, c.width as usize * c.height as usize))
    }

    /// The codes of each capture.
    fn captures(&self) -> Result<Vec<Vec<u16>>> {
        let (width, pixels) = self.size();
        let of_one = |inputs: &Inputs<'_>| {
            let mut codes = vec![0; pixels];
            let tasks = codes.par_chunks_mut(width * ROWS_PER_TASK).enumerate();
            tasks.try_for_each(|(i, out)| {
                inputs.rows(self.arithmetic, i * ROWS_PER_TASK, out, &mut [])
            })?;
            Ok(codes)
        };
        self.inputs.iter().map(of_one).collect()
    }

    /// The samples that `sample` makes of the merged signal, linear DN. The captures are there for
    /// a few rows at a time, which stay in the cache until they are merged.
    fn merged<S: Clone + Default + Send>(
        &self,
        sample: impl Fn(u32) -> S + Sync,
    ) -> Result<Vec<S>> {
        let (width, pixels) = self.size();
        let mut samples = vec![S::default(); pixels];
        let tasks = samples.par_chunks_mut(width * ROWS_PER_TASK).enumerate();
        tasks.try_for_each_init(
            || (vec![vec![0; width * ROWS_PER_TASK]; self.inputs.len()], vec![0; width]),
            |(captures, linear), (i, out)| {
                for (inputs, codes) in self.inputs.iter().zip(&mut *captures) {
                    let codes = &mut codes[..out.len()];
                    inputs.rows(self.arithmetic, i * ROWS_PER_TASK, codes, &mut [])?;
                }
                for (y, out) in out.chunks_mut(width).enumerate() {
                    let mut codes = [&[][..]; MAX_CAPTURES];
                    for (codes, capture) in codes.iter_mut().zip(&*captures) {
                        *codes = &capture[y * width..][..width];
                    }
                    rows::merge(self.merge, &codes[..captures.len()], linear);
                    out.iter_mut().zip(&*linear).for_each(|(out, &dn)| *out = sample(dn));
                }
                Ok(())
            },
        )?;
        Ok(samples)
    }
}

/// A linear frame as codes on a curve.
fn companded<S: Dn>(curve: &Compander, frame: RawFrame<S>) -> RawFrame {
    let code = |linear: S| curve.code(linear.into());
    RawFrame {
        width: frame.width,
        height: frame.height,
        bits: curve.bits(),
        cfa: frame.cfa,
        black_level_dn: curve.code(frame.black_level_dn as u32).into(),
        white_level_dn: code(frame.white_level_dn),
        data: frame.data.into_iter().map(code).collect(),
    }
}

/// The samples of a frame that a sensor of several captures sends.
pub enum Samples {
    /// Those of each capture.
    Captures(Vec<Vec<u16>>),
    /// The merged signal, on a curve or of 16 bits.
    Merged(Vec<u16>),
    /// The merged signal, of 20 or 24 bits.
    Wide(Vec<u32>),
}

/// What a sensor sends of an exposure.
pub enum Sent {
    /// A frame of each capture.
    Captures(Vec<RawFrame>),
    /// The merged signal, on a curve or of 16 bits.
    Merged(RawFrame),
    /// The merged signal, of 20 or 24 bits.
    Wide(RawFrame<u32>),
}

#[cfg(test)]
mod tests;
