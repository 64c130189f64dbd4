//! Frames of a sensor that reads each pixel several times.

mod rows;

use super::CubeHeader;
use super::sensor::SimulatedSensor;
use camrig_base::{Dn, Error, RawFrame, Result};
use camrig_camera::Camera;
use camrig_camera::hdr::{Hdr, HdrOutput};
use camrig_sensor_core::config::FrameSettings;
use camrig_sensor_core::effects::Needs;
use camrig_sensor_core::hdr::{Companding, MAX_CAPTURES, Output, Readout};
use rayon::prelude::*;

/// A camera with `[sensor.hdr]`, set up for cubes of given bands: each capture a sensor, and what
/// is made of their codes.
pub struct HdrSensor {
    sensors: Vec<SimulatedSensor>,
    hdr: Hdr,
    readout: Readout,
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
        Ok(Self { sensors: sensors.collect::<Result<_>>()?, hdr, readout })
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
        let curve = self.hdr.companding.as_ref().filter(|_| is_due);
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

    /// The codes of the captures of one frame, in the camera's order: `take` exposes the sensor of a
    /// capture, whose position it gets, with settings of its own.
    ///
    /// # Errors
    /// Windows of a photodiode that overlap at this exposure; those of `take`.
    pub fn frame(
        &self,
        settings: &FrameSettings,
        mut take: impl FnMut(usize, &SimulatedSensor, &FrameSettings) -> Result<RawFrame>,
    ) -> Result<Vec<RawFrame>> {
        self.hdr.check_exposure(settings.exposure_s.into())?;
        let captures = self.sensors.iter().zip(&self.hdr.captures).enumerate();
        captures
            .map(|(i, (sensor, capture))| take(i, sensor, &self.hdr.settings(capture, settings)))
            .collect()
    }

    /// The samples that `of_row` makes of the merged signal, linear DN, of each row.
    fn merged<S: Clone + Default + Send>(
        &self,
        captures: &[RawFrame],
        of_row: impl Fn(&[u32], &mut [S]) + Sync,
    ) -> Vec<S> {
        let (width, pixels) = captures.first().map_or((1, 0), |f| (f.width, f.data.len()));
        let mut samples = vec![S::default(); pixels];
        let rows = samples.par_chunks_mut(width.max(1)).enumerate();
        rows.for_each_init(
            || vec![0; width],
            |linear, (y, row)| {
                let mut codes = [&[][..]; MAX_CAPTURES];
                for (codes, frame) in codes.iter_mut().zip(captures) {
                    *codes = &frame.data[y * width..][..width];
                }
                rows::merge(&self.hdr.merge, &codes[..captures.len()], linear);
                of_row(linear, row);
            },
        );
        samples
    }

    /// What the sensor sends of the codes of its captures.
    pub fn sent(&self, captures: Vec<RawFrame>, analog_gain: f32) -> Sent {
        let samples = match &self.readout.output {
            Output::Captures => {
                Samples::Captures(captures.into_iter().map(|frame| frame.data).collect())
            }
            Output::Companded(curve) => Samples::Merged(
                self.merged(&captures, |linear, codes| rows::compand(curve, linear, codes)),
            ),
            Output::Linear if self.hdr.linear_bits() > u16::BITS => {
                Samples::Wide(self.merged(&captures, |linear, row| row.copy_from_slice(linear)))
            }
            Output::Linear => Samples::Merged(self.merged(&captures, |linear, row| {
                row.iter_mut().zip(linear).for_each(|(row, &linear)| *row = linear as u16);
            })),
        };
        self.described(samples, analog_gain)
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

/// A linear frame as codes on a curve.
fn companded<S: Dn>(curve: &Companding, frame: RawFrame<S>) -> RawFrame {
    let code = |linear: S| curve.code(linear.into());
    RawFrame {
        width: frame.width,
        height: frame.height,
        bits: curve.bits.into(),
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
