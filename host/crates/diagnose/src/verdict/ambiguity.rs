//! Effects that the captures cannot distinguish, and captures that would.

use crate::candidates;
use crate::search::Outcome;

/// The captures that distinguish two kinds, in words.
pub(super) fn tie_breaker(a: &str, b: &str) -> &'static str {
    let is = |x: &str, y: &str| (a == x && b == y) || (a == y && b == x);
    let any = |x: &str| a == x || b == x;
    if is("system-gain", "quantum-efficiency") || is("system-gain", "lens-transmittance") {
        "flats over the whole range: variance over mean gives the gain by itself"
    } else if any("optical-crosstalk") && any("defocus") {
        "narrow-band flats under a colour filter array, where crosstalk mixes the channels and \
         defocus does not; or the edge through focus, which moves the blur of defocus alone"
    } else if any("f-number") {
        "edges in focus at two marks of the aperture ring: the Airy disc follows the f-number, the \
         transmittance does not change the blur; and the mark on the ring itself"
    } else if any("defocus") {
        "edges lying and standing, in the middle and in the corners, at two f-numbers"
    } else if any("decentre-tilt") || any("distortion") || any("lateral-colour") {
        "a grid of dots that fills the frame: radial displacement is the same all around the axis"
    } else if any("veiling-glare") || any("lens-transmittance") {
        "charts with black patches in a bright surround at two illuminances, and flats \
         without the lens"
    } else if is("green-imbalance", "readout-channel-mismatch") {
        "flats by light of a known spectrum: mismatched columns move red against blue, unequal \
         greens do not"
    } else if any("relative-illumination") || any("colour-shading") {
        "flats with and without the lens"
    } else if any("charge-coupling") || any("brighter-fatter") {
        "flats at five and more levels up to full well: the neighbours' correlation is constant \
         or grows with the level"
    } else if any("read-noise-spread")
        || any("random-telegraph-noise")
        || any("heavy-tailed-read-noise")
    {
        "a dark stack of 100 frames and more: kurtosis and memory of the noisiest pixels"
    } else if any("row-correlated-noise") || any("row-temporal-noise") {
        "a dark stack of 64 frames and more: spectrum of row means"
    } else if any("hot-pixels")
        || any("amp-glow")
        || any("dark-current-gradient")
        || any("dark-current")
    {
        "dark stacks at four exposures up to 10 s and two temperatures"
    } else if any("nonlinearity") || any("full-well") || any("exposure-offset") {
        "flats at ten levels by light at one exposure, and at ten exposures in one light"
    } else {
        "twice as many frames of the captures at hand"
    }
}

/// Name of the built-in plan with captures that would distinguish them.
pub fn next_plan(outcome: &Outcome) -> &'static str {
    let of_targets = |kind: &String| candidates::shown_by_targets(kind);
    match outcome.confounded.iter().any(|pair| of_targets(&pair.taken) || of_targets(&pair.rival))
    {
        true => "optics",
        false => "diagnosis",
    }
}
