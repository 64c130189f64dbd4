//! The figures of EMVA 1288 by their names in the standard.

use super::profiles::Profiles;
use crate::spectrogram::{Histogram, Spectrogram};
use serde::Serialize;

/// The standard's figures of one channel; `None` where the captures do not determine one.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    /// Quantum efficiency η, electrons per photon (0 to 1).
    pub quantum_efficiency: Option<f64>,
    /// System gain K, DN/e⁻.
    pub overall_system_gain: f64,
    /// Responsivity R, DN per photon.
    pub responsivity_dn_per_photon: Option<f64>,
    /// Temporal dark noise σ_y.dark, DN.
    pub temporal_dark_noise_dn: f64,
    /// Temporal dark noise σ_d, e⁻; `None` where quantisation hides it.
    pub temporal_dark_noise_e: Option<f64>,
    /// Absolute sensitivity threshold μ_p.min, photons.
    pub absolute_sensitivity_threshold_p: Option<f64>,
    /// Absolute sensitivity threshold μ_e.min, e⁻.
    pub absolute_sensitivity_threshold_e: f64,
    /// Saturation capacity μ_p.sat, photons.
    pub saturation_capacity_p: Option<f64>,
    /// Saturation capacity μ_e.sat, e⁻.
    pub saturation_capacity_e: f64,
    /// Signal-to-noise ratio at saturation.
    pub snr_max: f64,
    /// Signal-to-noise ratio at saturation, dB.
    pub snr_max_db: f64,
    /// Signal-to-noise ratio at saturation, bits.
    pub snr_max_bit: f64,
    /// Dynamic range: saturation capacity over absolute sensitivity threshold.
    pub dynamic_range: f64,
    /// Dynamic range, dB.
    pub dynamic_range_db: f64,
    /// Dynamic range, bits.
    pub dynamic_range_bit: f64,
    /// DSNU1288, e⁻.
    pub dsnu_1288_e: Option<f64>,
    /// Row part of DSNU1288, e⁻.
    pub dsnu_1288_row_e: Option<f64>,
    /// Column part of DSNU1288, e⁻.
    pub dsnu_1288_column_e: Option<f64>,
    /// Pixel part of DSNU1288, e⁻.
    pub dsnu_1288_pixel_e: Option<f64>,
    /// PRNU1288, per cent.
    pub prnu_1288_percent: Option<f64>,
    /// Row part of PRNU1288, per cent.
    pub prnu_1288_row_percent: Option<f64>,
    /// Column part of PRNU1288, per cent.
    pub prnu_1288_column_percent: Option<f64>,
    /// Pixel part of PRNU1288, per cent.
    pub prnu_1288_pixel_percent: Option<f64>,
    /// Linearity error LE: mean absolute deviation from the line between 5 and 95 % of saturation,
    /// per cent.
    pub linearity_error_percent: Option<f64>,
    /// Most negative deviation from the line, per cent.
    pub linearity_error_min_percent: Option<f64>,
    /// Most positive deviation from the line, per cent.
    pub linearity_error_max_percent: Option<f64>,
    /// Dark current from the mean, μ_I.mean, e⁻/s.
    pub dark_current_mean_e_per_s: Option<f64>,
    /// Dark current from the variance, μ_I.var, e⁻/s.
    pub dark_current_variance_e_per_s: Option<f64>,
    /// Temperature interval that doubles the dark current, °C.
    pub dark_current_doubling_c: Option<f64>,
    /// K at small signals, corrected for the curvature of the response, DN/e⁻ (not part of the
    /// standard).
    pub linearised_system_gain: Option<f64>,
}

/// Standard errors of the main figures, from the sampling errors of variances and means, in the
/// figures' units.
#[derive(Clone, Debug, Default, Serialize)]
pub struct StdErrors {
    /// Standard error of K.
    pub overall_system_gain: f64,
    /// Standard error of η (that of K, which exceeds that of the responsivity by far).
    pub quantum_efficiency: Option<f64>,
    /// Standard error of σ_d.
    pub temporal_dark_noise_e: Option<f64>,
    /// Standard error of DSNU1288.
    pub dsnu_1288_e: Option<f64>,
    /// Standard error of PRNU1288.
    pub prnu_1288_percent: Option<f64>,
    /// Standard error of the linearised K.
    pub linearised_system_gain: Option<f64>,
}

/// Result for one channel.
#[derive(Clone, Debug, Serialize)]
pub struct ChannelEmva {
    /// The channel's letter, lower case (`m` for mono).
    #[serde(skip)]
    pub channel: String,
    /// Whether the light reached saturation; otherwise capacity, SNR and dynamic range are lower
    /// limits.
    #[serde(skip)]
    pub saturates: bool,
    /// The figures.
    #[serde(flatten)]
    pub figures: Figures,
    /// Standard errors of the figures.
    pub std_errors: StdErrors,
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

/// One light level.
#[derive(Clone, Debug, Serialize)]
pub struct LevelRow {
    /// Id of the capture.
    pub id: String,
    /// Photons per pixel.
    pub photons: Option<f64>,
    /// Mean above dark, DN.
    pub signal_dn: f64,
    /// Temporal variance above dark, DN².
    pub variance_dn2: f64,
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
