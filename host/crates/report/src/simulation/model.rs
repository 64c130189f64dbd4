//! The camera's model as curves: response against wavelength, noise and SNR against signal.

use super::frames::Levels;
use crate::plot::{Colour, Mark, Plot};
use camrig_camera::{Camera, KeptNoise};
use camrig_diagnose::model::effects::dn_per_e;
use camrig_light::Illuminant;

/// Points of a curve over signal.
const POINTS: u32 = 60;
/// SNR that a picture needs to be clearly usable (ISO 12232).
const USABLE: f64 = 10.0;

/// Temporal and fixed noise of a pixel in the base model: eq. 10 of Chen et al. 2009 without row
/// pattern and DSNU, with the quantisation of the converter.
pub(super) struct Noise {
    /// Variances that do not depend on the signal, e⁻²: of reading and of rounding.
    read2: f64,
    rounding2: f64,
    /// Shot noise: variance per electron of signal, e⁻.
    shot: f64,
    prnu: f64,
    full_well_e: f64,
    /// System gain, DN/e⁻.
    pub dn_per_e: f64,
}

impl Noise {
    pub fn of(camera: &Camera, analog_gain: f64) -> Self {
        let (noise, at) = (&camera.sensor.noise, camera.sensor.at_gain(analog_gain));
        let dn_per_e = dn_per_e(camera, analog_gain);
        Self {
            read2: at.read_variance_e2,
            rounding2: at.rounding() / (12.0 * dn_per_e * dn_per_e),
            shot: if camera.sensor.kept_noise == KeptNoise::None { 0.0 } else { 1.0 },
            prnu: noise.prnu,
            full_well_e: at.full_well_e,
            dn_per_e,
        }
    }

    /// Standard deviation at a signal, both in e⁻.
    pub fn sigma(&self, signal_e: f64) -> f64 {
        (self.read2 + self.rounding2 + self.shot * signal_e + (self.prnu * signal_e).powi(2))
            .sqrt()
    }

    /// Signals from 1 e⁻ to full well.
    fn curve(&self, of: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
        let at = |i: u32| libm::pow(self.full_well_e, f64::from(i) / f64::from(POINTS));
        (0..=POINTS).map(at).filter(|s| *s >= 1.0).map(|s| [s, of(s)]).collect()
    }
}

/// Electrons per photon that enters the lens, and the light, over wavelength.
pub(super) fn response(camera: &Camera, light: Option<&Illuminant>) -> Plot {
    let sensor = &camera.sensor;
    let nm: Vec<f64> = (380..=780).step_by(5).map(f64::from).collect();
    let mut plot = Plot::new("Spectral response", "wavelength, nm", "electrons per photon, e⁻");
    plot.x_range(380.0, 780.0).note("Quantum efficiency with filters and lens.");
    let mut most_of_all = 0.0_f64;
    for (name, qe) in sensor.channel_names.iter().zip(&sensor.qe) {
        let at = |&w: &f64| {
            let filter = sensor.ir_cut.as_ref().map_or(1.0, |f| f.at(w));
            [w, qe.at(w) * filter * camera.lens.transmittance.at(w)]
        };
        let points: Vec<[f64; 2]> = nm.iter().map(at).collect();
        most_of_all = points.iter().map(|p| p[1]).fold(most_of_all, f64::max);
        plot.series(&name.to_uppercase(), Mark::Line, Colour::of_channel(name), points);
    }
    if let Some(light) = light {
        let most = nm.iter().map(|&w| light.power.at(w)).fold(0.0, f64::max);
        let points = nm.iter().map(|&w| [w, most_of_all * light.power.at(w) / most]).collect();
        let label = format!("{}, scaled", light.name);
        plot.series(&label, Mark::Dashed, Colour::Reference, points);
    }
    plot
}

/// Standard deviations over signal, both in e⁻.
pub(super) fn noise(noise: &Noise) -> Plot {
    let mut plot = Plot::new("Noise of a pixel", "signal, e⁻", "standard deviation, e⁻");
    plot.log_x().log_y().note(
        "Temporal and fixed-pattern noise of the base model, without the effects of the camera \
         file.",
    );
    let mut curve = |name: &str, mark: Mark, colour: Colour, of: &dyn Fn(f64) -> f64| {
        // There is no zero on a logarithmic axis.
        if of(1.0) > 0.0 {
            plot.series(name, mark, colour, noise.curve(of));
        }
    };
    curve("total", Mark::Line, Colour::Measured, &|s| noise.sigma(s));
    curve("shot", Mark::Dashed, Colour::Series(0), &|s| (noise.shot * s).sqrt());
    curve("read", Mark::Dashed, Colour::Series(2), &|_| noise.read2.sqrt());
    curve("quantisation", Mark::Dashed, Colour::Series(4), &|_| noise.rounding2.sqrt());
    curve("PRNU", Mark::Dashed, Colour::Series(3), &|s| noise.prnu * s);
    plot.limit_x(noise.full_well_e, "full well");
    plot
}

/// SNR over signal, with where a channel's samples lie.
pub(super) fn snr(noise: &Noise, of_frame: Option<(&Levels, usize)>) -> Plot {
    let title = if of_frame.is_some() { "Where the samples lie" } else { "SNR of a pixel" };
    let mut plot = Plot::new(title, "signal, e⁻", "signal-to-noise ratio, 1");
    plot.log_x().log_y();
    let curve = noise.curve(|s| s / noise.sigma(s));
    plot.series("SNR of the model", Mark::Line, Colour::Measured, curve);
    plot.limit_y(USABLE, "SNR 10");
    if let Some((levels, channel)) = of_frame {
        let name = &levels.channels[channel];
        for (share, words) in [(0.5, "median"), (0.99, "99 %")] {
            let signal = (levels.quantile(channel, share) - levels.black) / noise.dn_per_e;
            if signal >= 1.0 {
                plot.limit_x(signal, &format!("{words} {name}"));
            }
        }
        plot.note(&format!(
            "Half and 99 % of the {name} samples lie left of their lines. Pictures are clearly \
             usable from SNR 10 on (ISO 12232)."
        ));
    }
    plot
}
