//! Sensors that read each pixel several times and merge the readings: `[sensor.hdr]`.
//!
//! A **capture** is one reading of a pixel by a converter, a **window** one integration of one
//! photodiode. Each capture is a plain sensor ([`Camera::of_capture`]): it has a photodiode's
//! response, well, dark current and PRNU, its own converter and read noise, and the exposure and
//! gain of a frame times its ratios. Captures of one window see the same charge, as their random
//! streams have the window's number; [`Merge`] and [`Companding`] of `camrig-sensor-core` make the
//! sensor's code of theirs.
//!
//! A cell of a quad pattern, four photodiodes under one filter, is a **pixel** here, with the pitch
//! and the position of the cell: its photodiodes may have exposures of their own, and the merged
//! frame has a pixel per cell. That they stand a quarter of the pitch beside its centre is left
//! out.
//!
//! What a merged signal should be, its mean, noise and dynamic range, is in [`expected`].

mod check;
pub mod expected;
pub(crate) mod file;
pub(crate) mod remarks;

#[cfg(test)]
mod tests;

pub(crate) use check::{check_chains, effect_on, hdr};
pub use file::HdrOutput;

use crate::{Camera, Window};
use camrig_base::{Error, Result, Spectrum};
use camrig_sensor_core::config::{FrameSettings, Streams};
use camrig_sensor_core::effects::Effect;
use camrig_sensor_core::hdr::{Companding, Merge, Output, Ratios, Readout};

/// A photodiode of a pixel.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Photodiode {
    /// Its name.
    pub name: String,
    /// Its response over that of the camera's `qe`, with the light of the others that leaks in.
    pub response: Spectrum,
    /// Charge that it holds, e⁻.
    pub full_well_e: f64,
    /// Charge beyond it that its capacitor takes, e⁻.
    pub overflow_e: f64,
    /// Mean dark current at the reference temperature, e⁻/s.
    pub dark_current_e_per_s: f64,
    /// Standard deviation over pixels of the dark current, e⁻/s.
    pub dsnu_e_per_s: f64,
    /// Standard deviation over pixels of the relative gain.
    pub prnu: f64,
}

impl Photodiode {
    /// Its ratio, where that is the same at all wavelengths: of others no number is right for all
    /// light.
    pub fn ratio(&self) -> Option<f64> {
        let mut ratios = self.response.samples().map(|(_, ratio)| ratio);
        let first = ratios.next()?;
        ratios.all(|ratio| ratio == first).then_some(first)
    }
}

/// A reading of a pixel.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Capture {
    /// Its name.
    pub name: String,
    /// Position of its photodiode in [`Hdr::photodiodes`].
    pub photodiode: usize,
    /// Number of its window.
    pub window: u8,
    /// When the window begins, after the beginning of the frame, µs.
    pub start_us: f64,
    /// Its exposure over that of the frame.
    pub exposure_ratio: f64,
    /// Its analog gain over that of the frame.
    pub gain_ratio: f64,
    /// Charge at which the converter's range ends at unity gain, e⁻.
    pub full_scale_e: f64,
    /// Bits of the converter.
    pub bits: u8,
    /// DN of no signal.
    pub black_level_dn: u16,
    /// Read noise at unity gain, e⁻.
    pub read_e: f64,
    /// The part of it that comes after the gain stage, e⁻.
    pub read_e_post: f64,
    /// Row-wise fixed pattern, e⁻.
    pub row_fpn_e: f64,
    /// Whether it sees its photodiode's capacitor too.
    pub overflow: bool,
    /// Virtual channel on which it is sent alone.
    pub virtual_channel: u8,
    /// Linear DN per DN in the merge.
    pub gain: f64,
}

/// An effect of some captures only.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectOn {
    /// The effect.
    pub effect: Effect,
    /// For each capture, whether it has it.
    pub captures: Vec<bool>,
}

/// `[sensor.hdr]` of a camera file, checked.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Hdr {
    /// What the sensor sends.
    pub output: HdrOutput,
    /// Time from one row to the next, µs.
    pub row_time_us: f64,
    /// The photodiodes of a pixel.
    pub photodiodes: Vec<Photodiode>,
    /// The readings of a pixel, the most sensitive first.
    pub captures: Vec<Capture>,
    /// The merge of their codes.
    pub merge: Merge,
    /// The curve of the output, if it has one.
    pub companding: Option<Companding>,
    /// Effects of some captures only.
    pub effects: Vec<EffectOn>,
}

impl Hdr {
    /// The capture of a name.
    ///
    /// # Errors
    /// A name that there is not; the message lists those there are.
    pub fn position(&self, name: &str) -> Result<usize> {
        self.captures.iter().position(|c| c.name == name).ok_or_else(|| {
            let known: Vec<&str> = self.captures.iter().map(|c| c.name.as_str()).collect();
            Error::input(format!("no capture {name:?}"))
                .help(format!("the camera's captures are {}", known.join(", ")))
        })
    }

    /// The settings of a capture in a frame with `settings`: its exposures and gain.
    pub fn settings(&self, capture: &Capture, settings: &FrameSettings) -> FrameSettings {
        capture.ratios().settings(settings)
    }

    /// How the captures are taken, and what is sent of them, as `camrig-sensor-core` has it.
    pub fn readout(&self) -> Readout {
        let output = match (self.output, &self.companding) {
            (HdrOutput::Captures, _) => Output::Captures,
            (HdrOutput::Companded, Some(curve)) => Output::Companded(curve.clone()),
            _ => Output::Linear,
        };
        let ratios = self.captures.iter().map(Capture::ratios).collect();
        Readout { ratios, merge: self.merge.clone(), output }
    }

    /// When the captures collect light in frames of this exposure.
    pub fn windows(&self, exposure_s: f64) -> Vec<Window> {
        let window = |capture: &Capture| Window {
            start_s: 1e-6 * capture.start_us,
            exposure_s: exposure_s * capture.exposure_ratio,
        };
        self.captures.iter().map(window).collect()
    }

    /// Checks that the windows of each photodiode follow each other in a frame of this exposure.
    ///
    /// # Errors
    /// Two windows of a photodiode that overlap, with their times.
    pub fn check_exposure(&self, exposure_s: f64) -> Result<()> {
        let end_us = |c: &Capture| c.start_us + 1e6 * exposure_s * c.exposure_ratio;
        for (i, a) in self.captures.iter().enumerate() {
            let others = self.captures[i + 1..].iter();
            let mut others =
                others.filter(|b| a.photodiode == b.photodiode && a.window != b.window);
            // Rounding of times is no overlap.
            let meets = |b: &&Capture| {
                let shared = end_us(a).min(end_us(b)) - a.start_us.max(b.start_us);
                shared > 1e-6 * end_us(a).max(end_us(b))
            };
            if let Some(b) = others.find(meets) {
                let window =
                    |c: &Capture| format!("{} from {} to {:.3} µs", c.name, c.start_us, end_us(c));
                return Err(Error::input(format!(
                    "windows of photodiode {:?} overlap: {}, {}",
                    self.photodiodes[a.photodiode].name,
                    window(a),
                    window(b)
                ))
                .help(
                    "a photodiode integrates once at a time: shorten the exposure, or begin the \
                       later window (start_us) after the end of the earlier one",
                ));
            }
        }
        Ok(())
    }

    /// Names of the captures, separated by commas.
    pub fn names(&self) -> String {
        let names: Vec<&str> = self.captures.iter().map(|c| c.name.as_str()).collect();
        names.join(", ")
    }

    /// The error of something that looks at one reading of a pixel; its help is the caller's.
    pub fn where_one_is_read(&self) -> Error {
        let what = format!("a sensor of {} captures where one is read", self.captures.len());
        Error::unsupported(what)
    }

    /// Largest value of the linear signal, DN: where the last capture ends.
    pub fn linear_white_dn(&self, analog_gain: f64) -> u32 {
        let Some(last) = self.captures.last() else { return self.merge.max_dn() };
        let end = self.end_dn(last, analog_gain) - f64::from(last.black_level_dn);
        let linear = (end * last.gain).floor() + f64::from(self.merge.pedestal_dn());
        linear.min(f64::from(self.merge.max_dn())) as u32
    }

    /// Bits of the linear signal.
    pub fn linear_bits(&self) -> u32 {
        self.merge.linear_bits().into()
    }

    /// Rows that a capture is sent late, after the first that the sensor sends of a frame.
    pub fn late_rows(&self, capture: &Capture) -> usize {
        (capture.start_us / self.row_time_us).round() as usize
    }

    /// Charge that a capture can see, e⁻.
    pub fn well_e(&self, capture: &Capture) -> f64 {
        let photodiode = &self.photodiodes[capture.photodiode];
        let overflow_e = if capture.overflow { photodiode.overflow_e } else { 0.0 };
        photodiode.full_well_e + overflow_e
    }

    /// Code at which a capture ends: that of its well, or the converter's last.
    fn end_dn(&self, capture: &Capture, analog_gain: f64) -> f64 {
        let full = self.well_e(capture) * capture.dn_per_e(analog_gain);
        (full + f64::from(capture.black_level_dn)).min(capture.max_dn())
    }
}

impl Capture {
    fn ratios(&self) -> Ratios {
        Ratios { exposure: self.exposure_ratio, gain: self.gain_ratio }
    }

    /// Largest DN.
    fn max_dn(&self) -> f64 {
        f64::from((1u32 << self.bits) - 1)
    }

    /// DN per electron in a frame of this analog gain.
    pub fn dn_per_e(&self, analog_gain: f64) -> f64 {
        analog_gain * self.gain_ratio * self.max_dn() / self.full_scale_e
    }
}

impl Camera {
    /// The plain camera that a capture is, with the streams of its window. A camera without
    /// `[sensor.hdr]` has none.
    ///
    /// ```
    /// use camrig_camera::Camera;
    /// # fn example(camera: &Camera) -> Option<()> {
    /// let hdr = camera.sensor.hdr.as_ref()?;
    /// for (i, capture) in hdr.captures.iter().enumerate() {
    ///     let plain = camera.of_capture(i)?;
    ///     assert_eq!(plain.sensor.bits, capture.bits);
    /// }
    /// # Some(()) }
    /// ```
    pub fn of_capture(&self, position: usize) -> Option<Self> {
        let hdr = self.sensor.hdr.as_ref()?;
        let capture = hdr.captures.get(position)?;
        let photodiode = &hdr.photodiodes[capture.photodiode];
        let mut camera = self.clone();
        camera.name = format!("{} {}", self.name, capture.name);
        let of_capture = hdr.effects.iter().filter(|e| e.captures[position]);
        camera.effects.extend(of_capture.map(|e| e.effect));
        let sensor = &mut camera.sensor;
        sensor.hdr = None;
        sensor.streams = Streams {
            photodiode: capture.photodiode as u8,
            window: capture.window,
            capture: position as u8,
        };
        for qe in &mut sensor.qe {
            *qe = qe.times(&photodiode.response).ok()?;
        }
        sensor.full_well_e = hdr.well_e(capture);
        sensor.full_scale_e = capture.full_scale_e;
        sensor.bits = capture.bits;
        sensor.black_level_dn = capture.black_level_dn.into();
        if sensor.kept_noise == crate::KeptNoise::All {
            let noise = &mut sensor.noise;
            noise.dark_current_e_per_s = photodiode.dark_current_e_per_s;
            noise.dsnu_e_per_s = photodiode.dsnu_e_per_s;
            noise.prnu = photodiode.prnu;
            noise.read_e = capture.read_e;
            noise.read_e_post = capture.read_e_post;
            noise.row_fpn_e = capture.row_fpn_e;
        }
        Some(camera)
    }
}
