//! Notes on a photon transfer: levels left out, assumptions that do not hold.

use crate::dark::DarkLine;
use crate::ladder::{Level, Selection};
use crate::rounding::QUANTISATION_LIMITED;
use crate::transfer::Transfer;
use camrig_captures::CaptureSet;

/// Share of dark samples at 0 DN from which clipping is worth a note: it lowers the variance of
/// Gaussian noise by 0.2 %.
const CLIPPED_SHARE: f64 = 1e-3;
/// Relative change of K by the curvature of the response that is worth a note.
const BIASED: f64 = 0.005;
/// Standard errors from which that change is significant: chance gives three in one of 370
/// channels.
const SIGNIFICANT: f64 = 3.0;
/// χ² per degree of freedom of the fit from which its scatter is worth a note: 1.7 times the
/// sampling errors.
const SCATTERED_CHI2: f64 = 3.0;

/// Notes on the set as a whole.
pub(super) fn sensor_notes(
    set: &CaptureSet,
    selection: &Selection,
    darks: &[Level],
) -> Vec<String> {
    let mut notes = Vec::new();
    if set.sensor.cfa.is_none() {
        notes.push("the set names no colour filter pattern: taken as one channel".into());
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
             dark current and fixed patterns come out too small",
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
    let left: Vec<&str> =
        flats.iter().zip(&t.used).filter(|f| !f.1).map(|f| f.0.id.as_str()).collect();
    if !left.is_empty() {
        notes.push(format!(
            "channel {name}: {} of {} flat levels left out as saturated or past the knee ({})",
            left.len(),
            flats.len(),
            left.join(", ")
        ));
    }
    if t.response.is_none() {
        notes.push(format!(
            "channel {name}: the light of the levels is not known (or fewer than five are \
             usable), so the response is taken for a straight line"
        ));
    }
    let (k, straight) = (t.gain, t.gain_if_straight);
    let shift = straight.value / k.value - 1.0;
    if shift.abs() > BIASED && (straight.value - k.value).abs() > SIGNIFICANT * k.std_error {
        notes.push(format!(
            "channel {name}: the response is not a straight line; a photon transfer that takes it \
             for one would give K {:+.1} %",
            100.0 * shift
        ));
    }
    if t.reduced_chi2 > SCATTERED_CHI2 {
        notes.push(format!(
            "channel {name}: the variances scatter about the fit more than their sampling errors \
             say (χ²/ν = {:.1}); errors are widened accordingly",
            t.reduced_chi2
        ));
    }
    if t.dark_is_hidden {
        notes.push(format!(
            "channel {name}: the darks take one code or two: quantisation hides the read noise"
        ));
    } else if t.dark_variance.value < QUANTISATION_LIMITED * t.codes.square() {
        notes.push(format!(
            "channel {name}: the dark noise ({:.2} DN²) is not above quantisation: the read noise \
             is an upper limit at best",
            t.dark_variance.value
        ));
    }
}
