//! What is doubtful in `[sensor.hdr]` though it can be: for people, with the reason.

use super::{Hdr, HdrOutput};

/// Error of a merge's gain from which on it is remarked.
const MAX_GAIN_ERROR: f64 = 0.01;

/// Remarks on the merge and the curve of a sensor.
pub(crate) fn of(hdr: &Hdr) -> Vec<String> {
    gains(hdr).into_iter().chain(steps(hdr)).collect()
}

/// Gains that are not the ratio of the captures' signals: the merged signal jumps at the hand-over.
fn gains(hdr: &Hdr) -> Vec<String> {
    let ratio = |i: usize| {
        let capture = &hdr.captures[i];
        let electrons = hdr.photodiodes[capture.photodiode].ratio()? * capture.exposure_ratio;
        Some(electrons * capture.dn_per_e(1.0) * capture.gain)
    };
    let Some(first) = ratio(0) else { return Vec::new() };
    let of = |i: usize| {
        let error = ratio(i)? / first - 1.0;
        let (name, gain) = (&hdr.captures[i].name, hdr.captures[i].gain);
        (error.abs() > MAX_GAIN_ERROR).then(|| {
            format!(
                "the merge's gain {gain} of capture {name} is {:+.1} % off the ratio of its signal \
                 to the first's: the merged signal jumps there (a gain of {:.4} would not)",
                100.0 * error,
                gain / (1.0 + error)
            )
        })
    };
    (1..hdr.captures.len()).filter_map(of).collect()
}

/// Captures in whose range the curve is finer than their codes: two neighbouring codes of the
/// capture lie several codes of the output apart.
fn steps(hdr: &Hdr) -> Option<String> {
    let companding = hdr.companding.as_ref().filter(|_| hdr.output == HdrOutput::Companded)?;
    let offset = f64::from(hdr.merge.pedestal_dn()) - f64::from(companding.subtract_dn);
    let hands = hdr.merge.hands().iter().zip(&hdr.captures[1..]);
    let of = |(hand, to): (&camrig_sensor_core::hdr::Hand, &super::Capture)| {
        let decide = &hdr.captures[usize::from(hand.decide)];
        let above_black = f64::from(hand.high_dn) - f64::from(decide.black_level_dn);
        let step = companding.curve.step(above_black * decide.gain + offset);
        (step < to.gain).then(|| format!("{} ({step} and {:.4} linear DN)", to.name, to.gain))
    };
    let finer: Vec<String> = hands.filter_map(of).collect();
    (!finer.is_empty()).then(|| {
        format!(
            "the curve has more codes than the capture where these take over, so that some never \
             occur: {}",
            finer.join(", ")
        )
    })
}
