//! Notes on a photon transfer: excluded levels, violated assumptions.

use crate::dark::DarkLine;
use crate::ladder::{Level, Selection};
use crate::rounding::QUANTISATION_LIMITED;
use crate::transfer::Transfer;
use camrig_captures::CaptureSet;

/// Share of dark samples at 0 DN from which clipping is worth a note: it lowers the variance of
/// Gaussian noise by 0.2 %.
const CLIPPED_SHARE: f64 = 1e-3;
/// Relative change of K by the curvature of the response above which it is noted.
const MIN_BIAS: f64 = 0.005;
/// Standard errors above which that change is significant: by chance, one in 370 channels.
const SIGNIFICANT: f64 = 3.0;
/// χ² per degree of freedom of the fit above which its scatter is noted: 1.7 times the sampling
/// errors.
const SCATTERED_CHI2: f64 = 3.0;

/// Notes on the set as a whole.
pub(super) fn sensor_notes(
    set: &CaptureSet,
    selection: &Selection,
    darks: &[Level],
) -> Vec<String> {
    let mut notes = Vec::new();
    if set.sensor.cfa.is_none() {
        notes.push("the set has no colour filter pattern: treated as one channel".into());
    }
    if !selection.even_light {
        notes.push(
            "the light may be uneven over the sensor: prnu includes its shading, if any".into(),
        );
    }
    let clipped = darks.iter().flat_map(|d| &d.channels).map(|m| m.zeros).fold(0.0, f64::max);
    if clipped > CLIPPED_SHARE {
        notes.push(format!(
            "{:.2} % of the dark samples are at 0 DN: the offset clips the noise, so read noise, \
             dark current and fixed patterns are too small",
            100.0 * clipped
        ));
    }
    if DarkLine::of(darks, 0).offset_and_rate().1.is_none() {
        notes.push(format!(
            "the darks' exposure times (about {} s) do not span a factor of 1.5: no dark current, \
             and the read noise includes the dark current's shot noise of that time",
            darks[0].exposure_s
        ));
    }
    notes
}

/// Notes on one channel's fit.
pub(super) fn channel_notes(t: &Transfer, flats: &[Level], name: &str, notes: &mut Vec<String>) {
    let excluded: Vec<&str> =
        flats.iter().zip(&t.used).filter(|f| !f.1).map(|f| f.0.id.as_str()).collect();
    if !excluded.is_empty() {
        notes.push(format!(
            "channel {name}: {} of {} flat levels excluded as saturated or above the knee ({})",
            excluded.len(),
            flats.len(),
            excluded.join(", ")
        ));
    }
    if t.used.iter().filter(|used| **used).count() == 1 {
        notes.push(format!(
            "channel {name}: one flat level: its gain is the difference of its variance and the \
             darks' over that of their means, and nothing checks that it is the same at others"
        ));
    }
    if t.response.is_none() {
        notes.push(format!(
            "channel {name}: the light of the levels is unknown (or fewer than five are \
             usable), so the response is assumed to be linear"
        ));
    }
    let (k, straight) = (t.gain, t.gain_if_straight);
    let shift = straight.value / k.value - 1.0;
    if shift.abs() > MIN_BIAS && (straight.value - k.value).abs() > SIGNIFICANT * k.std_error {
        notes.push(format!(
            "channel {name}: the response is nonlinear; a photon transfer that assumes a linear \
             one would have K {:+.1} %",
            100.0 * shift
        ));
    }
    if t.reduced_chi2 > SCATTERED_CHI2 {
        notes.push(format!(
            "channel {name}: the variances scatter about the fit more than their sampling errors \
             (χ²/ν = {:.1}); errors are increased accordingly",
            t.reduced_chi2
        ));
    }
    if t.dark_is_hidden {
        notes.push(format!(
            "channel {name}: the darks have only one or two codes: quantisation hides the read noise"
        ));
    } else if t.dark_variance.value < QUANTISATION_LIMITED * t.codes.square() {
        notes.push(format!(
            "channel {name}: the dark noise ({:.2} DN²) is not above quantisation: the read noise \
             is an upper limit at best",
            t.dark_variance.value
        ));
    }
}
