//! Warnings where captures or a sensor do not meet the standard's assumptions or requirements.

use super::{DARK_EXPOSURES, MIN_LEVELS, SpatialPair, light_of};
use crate::correlation::NoiseCorrelation;
use crate::ladder::{self, Level, Selection};
use crate::remarks;
use crate::stack::Stack;
use crate::transfer::Transfer;
use camrig_base::{Result, Value};
use camrig_captures::{Capture, CaptureSet};

/// Light levels that the standard requires.
const LEVELS: usize = 50;
/// Frames for spatial figures that the standard requires.
const SPATIAL_FRAMES: usize = 100;
/// Largest share of dark samples at 0 DN that the standard allows.
const CLIPPED_SHARE: f64 = 5e-3;
/// Bias of K by a nonlinear response above which there is a warning: 0.5 %, which a careful
/// measurement resolves.
const MIN_BIAS: f64 = 0.005;
/// Standard errors above which a bias of K is significant: by chance, one in 370 channels.
const SIGNIFICANT: f64 = 3.0;
/// Standard errors from which a correlation is significant: four, as each set tests two of them on
/// every run and a false warning costs more than a small coupling.
const SIGNIFICANT_CORRELATION: f64 = 4.0;
/// χ² per degree of freedom of the photon transfer above which there is a warning: a scatter of 1.7
/// times the sampling errors, which ten levels exceed by chance once in a thousand sets.
const SCATTERED_CHI2: f64 = 3.0;

/// Warnings about the set as a whole.
pub(super) fn set_warnings(
    set: &CaptureSet,
    selection: &Selection,
    darks: &[Level],
    levels: &[Level],
    pair: Option<&SpatialPair>,
) -> Vec<String> {
    let mut out = Vec::new();
    out.extend(ladder::codes(darks, levels).note());
    if set.sensor.cfa.is_none() {
        out.push("the set has no colour filter pattern: treated as one channel".into());
    }
    out.extend(remarks::of_ladder(set, selection, darks, levels, DARK_EXPOSURES));
    if levels.len() < LEVELS {
        out.push(format!("{} light levels; the standard requires at least 50", levels.len()));
    }
    out.extend(without_photons(levels));
    if levels.len() < MIN_LEVELS {
        out.push(
            "fewer than three light levels: no saturation, and so no saturation capacity, maximum \
             SNR, dynamic range or linearity; add flats up to saturation"
                .into(),
        );
    }
    let clipped = darks.iter().flat_map(|d| &d.channels).map(|m| m.zeros).fold(0.0, f64::max);
    if clipped > CLIPPED_SHARE {
        out.push(format!(
            "{:.1} % of the dark samples are at 0 DN (the standard allows 0.5 %): the offset \
             clips the dark noise, so dark noise, DSNU and K are wrong",
            100.0 * clipped
        ));
    }
    match pair {
        None => out.push(
            "no flat stack of three or more frames below saturation in any channel: no DSNU and \
             PRNU, no spectrograms"
                .into(),
        ),
        Some(p) => {
            if p.frames < SPATIAL_FRAMES {
                out.push(format!(
                    "spatial figures from {} frames ({}); the standard requires at least 100",
                    p.frames, p.flat_id
                ));
            }
            if !p.same_exposure {
                out.push(
                    "no dark stack of the spatial flat's exposure time: the nearest is used"
                        .into(),
                );
            }
            if !selection.even_light {
                out.push(
                    "the light may be uneven over the sensor: PRNU includes its shading".into(),
                );
            }
        }
    }
    out
}

/// What levels of unknown photons do not determine.
fn without_photons(levels: &[Level]) -> Option<String> {
    if levels.iter().all(|l| l.photons.is_some()) {
        return None;
    }
    let linearity = match light_of(levels) {
        _ if levels.len() < MIN_LEVELS => "no quantum efficiency or responsivity",
        Some(_) => {
            "no quantum efficiency or responsivity, and the linearity is that over exposure time, \
             right if the light was steady"
        }
        None => "no quantum efficiency, responsivity or linearity",
    };
    Some(format!(
        "the photons per pixel are unknown (photons_per_pixel_per_s, or irradiance_w_m2 with \
         wavelength_nm and pitch_um): {linearity}"
    ))
}

/// Smallest correlation coefficient that causes a warning: it biases K by four times its value,
/// here about 1 %.
const MIN_CORRELATION: f64 = 0.002;

/// Warnings about correlated noise of neighbouring pixels in a capture whose moments are `stack`.
pub(super) fn correlation_warning(
    set: &CaptureSet,
    flat: &Capture,
    stack: &Stack,
    warnings: &mut Vec<String>,
) -> Result<()> {
    let correlation = NoiseCorrelation::of(set, flat, stack, 0.1 * MIN_CORRELATION)?;
    for (place, rho) in [("to the right", correlation.right), ("below", correlation.below)] {
        if rho.value.abs() > MIN_CORRELATION
            && rho.value.abs() > SIGNIFICANT_CORRELATION * rho.std_error
        {
            warnings.push(format!(
                "the temporal noise of a pixel and its neighbour {place} is correlated ({:+.2} % \
                 ± {:.2} %): pixels are not independent as the standard assumes (neighbour \
                 coupling or filtering), and K is biased by several times that",
                100.0 * rho.value,
                100.0 * rho.std_error
            ));
        }
    }
    Ok(())
}

/// Warnings about a nonlinear response, and about noise that is not shot noise.
pub(super) fn curvature_warnings(t: &Transfer, k: Value, name: &str, warnings: &mut Vec<String>) {
    let bias = k.value / t.gain.value - 1.0;
    let significant =
        (k.value - t.gain.value).abs() > SIGNIFICANT * libm::hypot(k.std_error, t.gain.std_error);
    if let Some(r) = &t.response
        && bias.abs() > MIN_BIAS
        && significant
    {
        let q = r.quadratic;
        warnings.push(format!(
            "channel {name}: the response is nonlinear ({:+.2} ± {:.2} % per 1000 DN): the \
             standard's K differs by {:+.1} % from the gain at small signals, {:.4} DN/e⁻, and the \
             quantum efficiency by as much in the opposite direction",
            1e5 * q.value,
            1e5 * q.std_error,
            100.0 * bias,
            t.gain.value
        ));
    }
    if t.reduced_chi2 > SCATTERED_CHI2 {
        warnings.push(format!(
            "channel {name}: the variances scatter about a photon transfer curve more than their \
             sampling errors (χ²/ν = {:.1}): the noise is not shot noise and read noise alone, or \
             the light was not steady",
            t.reduced_chi2
        ));
    }
}
