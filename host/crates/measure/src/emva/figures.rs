//! The figures of EMVA 1288 by their names in the standard.

use super::profiles::Profiles;
use crate::spectrogram::{Histogram, Spectrogram};
use camrig_base::Value;
use serde::Serialize;

/// The standard's figures of one channel, with the standard errors that follow from the sampling
/// errors of means and variances (NaN where there is no estimate); `None` where the captures do not
/// determine one.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    /// Quantum efficiency η, electrons per photon (0 to 1).
    pub quantum_efficiency: Option<Value>,
    /// System gain K, DN/e⁻.
    pub overall_system_gain: Option<Value>,
    /// Responsivity R, DN per photon.
    pub responsivity_dn_per_photon: Option<Value>,
    /// Temporal dark noise σ_y.dark, DN.
    pub temporal_dark_noise_dn: Option<Value>,
    /// Temporal dark noise σ_d, e⁻; `None` where quantisation hides it.
    pub temporal_dark_noise_e: Option<Value>,
    /// Absolute sensitivity threshold μ_p.min, photons.
    pub absolute_sensitivity_threshold_p: Option<Value>,
    /// Absolute sensitivity threshold μ_e.min, e⁻.
    pub absolute_sensitivity_threshold_e: Option<Value>,
    /// Saturation capacity μ_p.sat, photons.
    pub saturation_capacity_p: Option<Value>,
    /// Saturation capacity μ_e.sat, e⁻.
    pub saturation_capacity_e: Option<Value>,
    /// Signal-to-noise ratio at saturation.
    pub snr_max: Option<Value>,
    /// Signal-to-noise ratio at saturation, dB.
    pub snr_max_db: Option<Value>,
    /// Signal-to-noise ratio at saturation, bits.
    pub snr_max_bit: Option<Value>,
    /// Dynamic range: saturation capacity over absolute sensitivity threshold.
    pub dynamic_range: Option<Value>,
    /// Dynamic range, dB.
    pub dynamic_range_db: Option<Value>,
    /// Dynamic range, bits.
    pub dynamic_range_bit: Option<Value>,
    /// DSNU1288, e⁻.
    pub dsnu_1288_e: Option<Value>,
    /// Row part of DSNU1288, e⁻.
    pub dsnu_1288_row_e: Option<Value>,
    /// Column part of DSNU1288, e⁻.
    pub dsnu_1288_column_e: Option<Value>,
    /// Pixel part of DSNU1288, e⁻.
    pub dsnu_1288_pixel_e: Option<Value>,
    /// PRNU1288, per cent.
    pub prnu_1288_percent: Option<Value>,
    /// Row part of PRNU1288, per cent.
    pub prnu_1288_row_percent: Option<Value>,
    /// Column part of PRNU1288, per cent.
    pub prnu_1288_column_percent: Option<Value>,
    /// Pixel part of PRNU1288, per cent.
    pub prnu_1288_pixel_percent: Option<Value>,
    /// Linearity error LE: mean absolute deviation from the line between 5 and 95 % of saturation,
    /// per cent.
    pub linearity_error_percent: Option<Value>,
    /// Most negative deviation from the line, per cent.
    pub linearity_error_min_percent: Option<Value>,
    /// Most positive deviation from the line, per cent.
    pub linearity_error_max_percent: Option<Value>,
    /// Dark current from the mean, μ_I.mean, e⁻/s.
    pub dark_current_mean_e_per_s: Option<Value>,
    /// Dark current from the variance, μ_I.var, e⁻/s.
    pub dark_current_variance_e_per_s: Option<Value>,
    /// Temperature interval that doubles the dark current, °C.
    pub dark_current_doubling_c: Option<Value>,
    /// K at small signals, corrected for the curvature of the response, DN/e⁻ (not part of the
    /// standard).
    pub linearised_system_gain: Option<Value>,
}

/// Result for one channel.
#[derive(Clone, Debug, Serialize)]
pub struct ChannelEmva {
    /// The channel's letter, lower case (`m` for mono).
    #[serde(skip)]
    pub channel: String,
    /// Whether the light reached saturation; otherwise capacity, SNR and dynamic range are lower
    /// limits, or, of fewer levels than a saturation needs, not determined.
    #[serde(skip)]
    pub saturates: bool,
    /// The figures.
    #[serde(flatten)]
    pub figures: Figures,
    /// Light levels in rising order.
    pub levels: Vec<LevelRow>,
    /// Dark stacks at the flats' temperature.
    pub darks: Vec<DarkRow>,
    /// Spectra of the dark mean frame, DN².
    pub spectrogram_dark: Option<Spectrogram>,
    /// Spectra of the flat mean frame minus the dark one, DN².
    pub spectrogram_prnu: Option<Spectrogram>,
    /// Deviations of pixels of the dark mean frame, DN.
    pub histogram_dsnu: Option<Histogram>,
    /// Deviations of pixels of the flat mean frame minus the dark one, high-pass filtered, DN.
    pub histogram_prnu: Option<Histogram>,
    /// Profiles of the dark mean frame, and of the flat one minus it.
    #[serde(skip)]
    pub profiles: Option<[Profiles; 2]>,
}

impl ChannelEmva {
    /// The figures that are lower limits, as the light did not reach saturation.
    #[must_use]
    pub fn lower_limits(&self) -> &'static [&'static str] {
        match self.figures.saturation_capacity_e.filter(|_| !self.saturates) {
            None => &[],
            Some(_) => &[
                "saturation_capacity_p",
                "saturation_capacity_e",
                "snr_max",
                "snr_max_db",
                "snr_max_bit",
                "dynamic_range",
                "dynamic_range_db",
                "dynamic_range_bit",
            ],
        }
    }
}

/// One light level.
#[derive(Clone, Debug, Serialize)]
pub struct LevelRow {
    /// Id of the capture.
    pub id: String,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Photons per pixel.
    pub photons: Option<f64>,
    /// Mean above dark, DN.
    pub signal_dn: f64,
    /// Temporal variance above dark, DN².
    pub variance_dn2: f64,
    /// Signal over temporal noise, dB.
    pub snr_db: Option<Value>,
    /// Deviation from the line of the linearity fit, per cent, where the fit covers it.
    pub linearity_deviation_percent: Option<f64>,
}

/// One dark stack.
#[derive(Clone, Debug, Serialize)]
pub struct DarkRow {
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Mean, DN.
    pub mean_dn: f64,
    /// Temporal variance, DN².
    pub variance_dn2: f64,
}
