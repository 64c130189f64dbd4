//! What a sensor of several captures does with a row of them.

use super::{Companding, HdrError, MAX_CAPTURES, Merge};
use crate::config::FrameSettings;
use serde::{Deserialize, Serialize};

/// Exposure and gain of a capture, over those of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ratios {
    /// Of the exposures.
    pub exposure: f64,
    /// Of the analogue gains.
    pub gain: f64,
}

impl Ratios {
    /// The settings of the capture in a frame with `settings`.
    pub fn settings(&self, settings: &FrameSettings) -> FrameSettings {
        let exposure = |s: f32| (f64::from(s) * self.exposure) as f32;
        let gain = (f64::from(settings.analog_gain) * self.gain) as f32;
        let mut own = settings.with_exposure(exposure(settings.exposure_s)).with_gain(gain);
        own.previous_exposure_s = settings.previous_exposure_s.map(exposure);
        own
    }
}

/// What is sent of the captures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "there is one, and no heap to put it in")]
pub enum Output {
    /// Codes of the merged signal on a curve.
    Companded(Companding),
    /// The merged signal.
    Linear,
    /// The captures one by one.
    Captures,
}

/// The captures of a sensor, and what is sent of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Readout {
    /// Exposure and gain of each capture.
    pub ratios: heapless::Vec<Ratios, MAX_CAPTURES>,
    /// The merge of their codes.
    pub merge: Merge,
    /// What is sent.
    pub output: Output,
}

impl Readout {
    /// Checks that there are ratios for each capture that is merged, and merge and curve.
    ///
    /// # Errors
    /// The first thing found wrong.
    pub fn check(&self) -> Result<(), HdrError> {
        self.merge.check()?;
        if self.ratios.len() != self.merge.captures() {
            return Err(HdrError::Captures);
        }
        match &self.output {
            Output::Companded(curve) => curve.check(),
            Output::Linear | Output::Captures => Ok(()),
        }
    }

    /// Bits of what is sent, where that is not the captures with their own.
    pub fn bits(&self) -> Option<u8> {
        match &self.output {
            Output::Companded(curve) => Some(curve.bits),
            Output::Linear => Some(self.merge.linear_bits()),
            Output::Captures => None,
        }
    }

    /// Makes what is sent of a row of `width` pixels from the codes of its captures, one capture
    /// after the other, in their place: the first `width` are codes or the merged signal. One of
    /// more than 16 bits is its upper half there, and its lower half in the `width` that follow;
    /// the captures stay as they are.
    #[inline(always)]
    pub fn send(&self, width: usize, codes: &mut [u16]) {
        let captures = self.merge.captures();
        if self.output == Output::Captures {
            return;
        }
        let half = u32::from(self.merge.linear_bits()) / 2;
        for x in 0..width {
            let mut pixel = [0; MAX_CAPTURES];
            for (c, code) in pixel.iter_mut().enumerate().take(captures) {
                *code = codes.get(c * width + x).copied().unwrap_or(0);
            }
            let linear = self.merge.linear(&pixel);
            let [first, second] = match &self.output {
                Output::Companded(curve) => [Some(curve.code(linear)), None],
                _ if half <= 8 => [Some(linear as u16), None],
                _ => [Some((linear >> half) as u16), Some((linear & ((1 << half) - 1)) as u16)],
            };
            for (part, sample) in [first, second].into_iter().enumerate() {
                if let (Some(place), Some(sample)) = (codes.get_mut(part * width + x), sample) {
                    *place = sample;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Curve, Hand, Level, Rounding};
    use super::*;

    fn readout(linear_bits: u8, output: Output) -> Readout {
        let level = |gain| Level { black_dn: 64, gain };
        let hand = Hand { decide: 0, low_dn: 3000, high_dn: 3600 };
        let merge = Merge::new(&[level(256), level(256 << 6)], &[hand], linear_bits, 64).unwrap();
        let ratios = [1.0, 1.0 / 64.0].map(|exposure| Ratios { exposure, gain: 1.0 });
        Readout { ratios: ratios.into_iter().collect(), merge, output }
    }

    #[test]
    fn a_row_is_sent_in_the_place_of_its_captures() {
        let codes = [164, 3300, 4095, 64, 117, 4095];
        let linear =
            [0, 1, 2].map(|x| readout(20, Output::Linear).merge.linear(&[codes[x], codes[x + 3]]));
        assert_eq!(linear[2], 64 + 4031 * 64);
        let sent = |bits, output| {
            let (readout, mut row) = (readout(bits, output), codes);
            readout.check().unwrap();
            readout.send(3, &mut row);
            row
        };
        let halves = sent(20, Output::Linear);
        for (x, linear) in linear.into_iter().enumerate() {
            assert_eq!(u32::from(halves[x]) << 10 | u32::from(halves[3 + x]), linear);
        }
        assert_eq!(sent(16, Output::Linear)[..3], linear.map(|l| l.min(65_535) as u16));
        assert_eq!(sent(24, Output::Captures), codes);
        let curve = Curve::new(&[(1 << 20, 4096.0)], Rounding::Floor).unwrap();
        let curve = Companding { curve, bits: 12, subtract_dn: 0, pedestal_dn: 0 };
        let companded = sent(20, Output::Companded(curve.clone()));
        assert_eq!(companded[..3], linear.map(|l| (l >> 8) as u16));
        let odd = Companding { bits: 11, ..curve };
        assert_eq!(readout(20, Output::Companded(odd)).check(), Err(HdrError::Bits));
    }

    #[test]
    fn captures_have_the_frames_exposures_times_their_ratios() {
        let settings = FrameSettings::new(0.016).with_gain(2.0).after_exposure(0.032);
        let own = readout(16, Output::Linear).ratios[1].settings(&settings);
        assert_eq!((own.exposure_s, own.analog_gain), (0.000_25, 2.0));
        assert_eq!(own.previous_exposure_s, Some(0.0005));
    }
}
