//! What a merged signal should be: mean, noise, dynamic range, in closed form.
//!
//! First order: the weights of the merge are those of the mean codes. The mean of captures of one
//! window shifts in a ramp by w′ Cov(DN_d, B − A), which is left out.

use super::{Capture, Hdr};
use crate::Camera;
use camrig_base::{Error, Result};
use camrig_sensor_core::effects::read_noise;

/// The expected signal of a camera with several captures, in frames of one exposure and gain.
/// Light is given as µ, the mean photo-electrons of the first capture.
#[derive(Clone, Debug)]
pub struct Expected<'a> {
    hdr: &'a Hdr,
    analog_gain: f64,
    /// Photo-electrons of each capture for one of the first.
    electrons: Vec<f64>,
    /// Dark electrons of each capture.
    dark_e: Vec<f64>,
}

/// The merged signal in one light.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Merged {
    /// Mean above black, linear DN.
    pub mean: f64,
    /// The part of it that is light, linear DN.
    pub signal: f64,
    /// Variance, linear DN².
    pub variance: f64,
    /// Weight of each capture but the first as its step gives it, 0 to 1.
    pub weights: Vec<f64>,
}

impl Merged {
    /// Signal over noise.
    pub fn snr(&self) -> f64 {
        self.signal / libm::sqrt(self.variance)
    }
}

/// Light and SNR around a hand-over.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct HandOver {
    /// The capture that takes over.
    pub to: String,
    /// µ at which it begins and ends, e⁻.
    pub light_e: [f64; 2],
    /// SNR just before and just after.
    pub snr: [f64; 2],
}

impl<'a> Expected<'a> {
    /// Of a camera in frames of an exposure and an analog gain.
    ///
    /// # Errors
    /// A camera without `[sensor.hdr]`; photodiodes whose ratio depends on the wavelength, of
    /// which µ does not determine the light of the second.
    pub fn new(camera: &'a Camera, exposure_s: f64, analog_gain: f64) -> Result<Self> {
        let hdr = camera.sensor.hdr.as_ref();
        let hdr = hdr.ok_or_else(|| Error::input("a camera without [sensor.hdr]"))?;
        let noise = &camera.sensor.noise;
        let warmer = camera.sensor.temperature_c - noise.temperature_ref_c;
        let growth = libm::exp2(warmer / noise.dark_doubling_c);
        let ratio = |c: &Capture| {
            let photodiode = &hdr.photodiodes[c.photodiode];
            photodiode.ratio().map(|ratio| ratio * c.exposure_ratio).ok_or_else(|| {
                Error::unsupported(format!(
                    "expected signals of photodiode {:?}, whose ratio depends on the wavelength",
                    photodiode.name
                ))
            })
        };
        let ratios = hdr.captures.iter().map(ratio).collect::<Result<Vec<f64>>>()?;
        let dark = |c: &Capture| {
            let per_s = hdr.photodiodes[c.photodiode].dark_current_e_per_s;
            per_s * growth * exposure_s * c.exposure_ratio
        };
        let dark_e = hdr.captures.iter().map(dark).collect();
        let electrons = ratios.iter().map(|r| r / ratios[0]).collect();
        Ok(Self { hdr, analog_gain, electrons, dark_e })
    }

    fn dn_per_e(&self, i: usize) -> f64 {
        self.hdr.captures[i].dn_per_e(self.analog_gain)
    }

    /// Electrons at which a capture ends: its well, or the converter.
    fn end_e(&self, i: usize) -> f64 {
        let capture = &self.hdr.captures[i];
        let converter = capture.max_dn() - f64::from(capture.black_level_dn);
        self.hdr.well_e(capture).min(converter / self.dn_per_e(i))
    }

    /// Variance of reading and rounding, e⁻².
    fn own_e2(&self, i: usize) -> f64 {
        let capture = &self.hdr.captures[i];
        let gain = self.analog_gain * capture.gain_ratio;
        let dn_per_e = self.dn_per_e(i);
        read_noise::variance(capture.read_e, capture.read_e_post, gain)
            + 1.0 / (12.0 * dn_per_e * dn_per_e)
    }

    /// SNR of a capture alone; `None` where it saturates.
    pub fn capture_snr(&self, i: usize, light_e: f64) -> Option<f64> {
        let (light, dark) = (light_e * self.electrons[i], self.dark_e[i]);
        let variance = light + dark + self.own_e2(i);
        (light + dark < self.end_e(i)).then(|| light / libm::sqrt(variance))
    }

    /// The merged signal: with coefficients a_c that sum to 1 and k_c = a_c g_c K_c, its variance
    /// is Σ over windows (Σ of their k_c)² (µ_w + D_w) + Σ k_c² (r_c² + 1/(12 K_c²)): the captures
    /// of a window share their charge.
    pub fn merged(&self, light_e: f64) -> Merged {
        let captures = &self.hdr.captures;
        let all = 0..captures.len();
        let seen = |i: usize| (light_e * self.electrons[i]).min(self.hdr.well_e(&captures[i]));
        let charge = |i: usize| {
            (light_e * self.electrons[i] + self.dark_e[i]).min(self.hdr.well_e(&captures[i]))
        };
        let code = |i: usize| {
            let dn = charge(i) * self.dn_per_e(i) + f64::from(captures[i].black_level_dn);
            dn.min(captures[i].max_dn())
        };
        let mut coefficients = vec![0.0; captures.len()];
        coefficients[0] = 1.0;
        let mut weights = Vec::new();
        for (k, hand) in self.hdr.merge.hands().iter().enumerate() {
            let (low, high) = (f64::from(hand.low_dn), f64::from(hand.high_dn));
            let weight = ((code(usize::from(hand.decide)) - low) / (high - low)).clamp(0.0, 1.0);
            coefficients.iter_mut().for_each(|a| *a *= 1.0 - weight);
            coefficients[k + 1] += weight;
            weights.push(weight);
        }
        let scale = |i: usize| coefficients[i] * captures[i].gain * self.dn_per_e(i);
        let above_black = |i: usize| {
            let dn = code(i) - f64::from(captures[i].black_level_dn);
            coefficients[i] * captures[i].gain * dn
        };
        let mut variance: f64 = all.clone().map(|i| scale(i) * scale(i) * self.own_e2(i)).sum();
        for first in all.clone() {
            let window = captures[first].window;
            if captures[..first].iter().any(|c| c.window == window) {
                continue;
            }
            let of_window = all.clone().filter(|&i| captures[i].window == window);
            let sum: f64 = of_window.map(scale).sum();
            let full = light_e * self.electrons[first] + self.dark_e[first]
                >= self.hdr.well_e(&captures[first]);
            variance += if full { 0.0 } else { sum * sum * charge(first) };
        }
        Merged {
            mean: all.clone().map(above_black).sum(),
            signal: all.map(|i| scale(i) * seen(i)).sum(),
            variance,
            weights,
        }
    }

    /// SNR of the codes of the curve, referred to its input: a code that covers s linear numbers
    /// adds s²/12. `None` without a curve.
    pub fn companded_snr(&self, light_e: f64) -> Option<f64> {
        let companding = self.hdr.companding.as_ref()?;
        let merged = self.merged(light_e);
        let offset = f64::from(self.hdr.merge.pedestal_dn()) - f64::from(companding.subtract_dn);
        let step = companding.curve.step(merged.mean + offset);
        Some(merged.signal / libm::sqrt(merged.variance + step * step / 12.0))
    }

    /// µ at which the last capture saturates, e⁻.
    pub fn saturation_e(&self) -> f64 {
        let last = self.electrons.len() - 1;
        self.end_e(last) / self.electrons[last]
    }

    /// µ at which the first capture has an SNR of 1, as EMVA 1288 has the absolute sensitivity
    /// threshold, e⁻.
    pub fn threshold_e(&self) -> f64 {
        let noise2 = self.dark_e[0] + self.own_e2(0);
        0.5 * (1.0 + libm::sqrt(1.0 + 4.0 * noise2))
    }

    /// The hand-overs in their order.
    pub fn hand_overs(&self) -> Vec<HandOver> {
        // Just outside the ramp.
        const BESIDE: f64 = 1e-4;
        let hands = self.hdr.merge.hands().iter().zip(&self.hdr.captures[1..]);
        let of = |(hand, to): (&camrig_sensor_core::hdr::Hand, &Capture)| {
            let i = usize::from(hand.decide);
            let black = f64::from(self.hdr.captures[i].black_level_dn);
            let light_e = [hand.low_dn, hand.high_dn].map(|dn| {
                ((f64::from(dn) - black) / self.dn_per_e(i) - self.dark_e[i]) / self.electrons[i]
            });
            let [low, high] = light_e;
            let snr = [low * (1.0 - BESIDE), high * (1.0 + BESIDE)].map(|e| self.merged(e).snr());
            HandOver { to: to.name.clone(), light_e, snr }
        };
        hands.map(of).collect()
    }

    /// Dynamic range, dB, by three definitions.
    pub fn dynamic_range(&self) -> DynamicRange {
        let read_e = self.hdr.captures[0].read_e;
        let saturation = self.saturation_e();
        DynamicRange {
            snr_1_db: db(saturation / self.threshold_e()),
            read_noise_db: (read_e > 0.0).then(|| db(saturation / read_e)),
            above: [20.0, 25.0, 30.0].map(|limit_db| (limit_db, self.range_above(limit_db))),
        }
    }

    /// The longest range of light in which the SNR of the merged signal is nowhere below a limit,
    /// dB; in steps of 0.02 dB.
    pub fn range_above(&self, limit_db: f64) -> f64 {
        const STEP_DB: f64 = 0.02;
        let [least, most] = [self.threshold_e(), self.saturation_e()];
        let steps = (db(most / least) / STEP_DB) as usize;
        let light = |i: usize| least * libm::pow(10.0, STEP_DB * i as f64 / 20.0);
        let (mut best, mut length) = (0usize, 0usize);
        for i in 0..steps {
            let good = db(self.merged(light(i)).snr()) >= limit_db;
            length = if good { length + 1 } else { 0 };
            best = best.max(length);
        }
        best.saturating_sub(1) as f64 * STEP_DB
    }
}

/// Dynamic range of a merged signal, dB (20 lg of a ratio of light).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct DynamicRange {
    /// From where the first capture has an SNR of 1 (EMVA 1288) to where the last one saturates.
    pub snr_1_db: f64,
    /// The same from the read noise of the first capture, as data sheets have it; without read
    /// noise none.
    pub read_noise_db: Option<f64>,
    /// Limits of the SNR, dB, and the longest range of light in which it is nowhere below.
    pub above: [(f64, f64); 3],
}

/// A ratio in dB, as of amplitudes.
pub fn db(ratio: f64) -> f64 {
    20.0 * libm::log10(ratio)
}
