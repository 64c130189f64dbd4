//! Stacks of two or three frames, as EMVA 1288 requires at many levels: too short to divide, whole
//! stacks alternate between the halves in the order of their level.

use camrig_base::numbers::counted;
use camrig_captures::{Capture, CaptureSet, Role};

/// Shortest stack that is divided itself, frames.
const MIN_DIVIDED: usize = 4;
/// Shortest stack with noise, frames.
const MIN_FRAMES: usize = 2;
/// Number of short flats, or of short darks, from which they alternate: with fewer, neither half
/// has a series.
const MIN_LEVELS: usize = 6;

/// A short stack and the halves that it belongs to.
pub(super) struct Short {
    /// Index of the capture.
    pub capture: usize,
    /// Whether it is used for fitting.
    pub fit: bool,
    /// Whether it is held out.
    pub held_out: bool,
}

/// The short dark and flat stacks of a set: in the order of their level, every second one is held
/// out. The only dark of a set belongs to both halves, as both need one.
pub(super) fn stacks(set: &CaptureSet, counts: &[usize]) -> Vec<Short> {
    let short = |role: Role| -> Vec<usize> {
        let of = |i: &usize| {
            set.captures[*i].role == role && (MIN_FRAMES..MIN_DIVIDED).contains(&counts[*i])
        };
        (0..counts.len()).filter(of).collect()
    };
    let (mut flats, mut darks) = (short(Role::Flat), short(Role::Dark));
    if flats.len() < MIN_LEVELS {
        flats.clear();
        // Darks accompany flats, or are a series by themselves.
        if darks.len() < MIN_LEVELS {
            return Vec::new();
        }
    }
    let captures = &set.captures;
    flats.sort_by(|&a, &b| level(&captures[a]).total_cmp(&level(&captures[b])));
    darks.sort_by(|&a, &b| captures[a].exposure_s.total_cmp(&captures[b].exposure_s));
    let only_dark = captures.iter().filter(|c| c.role == Role::Dark).count() == 1;
    let alternate = |all: &[usize], both: bool| -> Vec<Short> {
        let one = |(k, &capture): (usize, &usize)| {
            let fit = k % 2 == 0;
            Short { capture, fit: fit || both, held_out: !fit || both }
        };
        all.iter().enumerate().map(one).collect()
    };
    let mut out = alternate(&flats, false);
    out.extend(alternate(&darks, only_dark));
    out
}

/// The stated light × exposure of a capture, for the order; 0 where it is not stated.
fn level(c: &Capture) -> f64 {
    let light = c.light.as_ref();
    let amount = light.and_then(|l| l.photons_per_pixel_per_s.or(l.irradiance_w_m2).or(l.lux));
    amount.unwrap_or(0.0) * c.exposure_s
}

/// The note about them.
pub(super) fn note(set: &CaptureSet, short: &[Short]) -> Option<String> {
    if short.is_empty() {
        return None;
    }
    let ids = |of: &dyn Fn(&Short) -> bool| -> String {
        let ids: Vec<&str> =
            short.iter().filter(|s| of(s)).map(|s| set.captures[s.capture].id.as_str()).collect();
        ids.join(", ")
    };
    let both = ids(&|s| s.fit && s.held_out);
    let shared = if both.is_empty() { both } else { format!("; in both halves: {both}") };
    Some(format!(
        "{} of two or three frames, too few to divide: levels alternate between fit ({}) \
         and held-out ({}){shared}",
        counted(short.len(), "stack"),
        ids(&|s| s.fit && !s.held_out),
        ids(&|s| s.held_out && !s.fit),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_captures::SensorFacts;

    #[test]
    fn short_darks_of_many_exposures_alternate_without_flats() {
        let dark =
            |k: u8| Capture::new(format!("d{k}"), Role::Dark, Vec::new(), 0.1 * f64::from(7 - k));
        let sensor = SensorFacts {
            width: 4,
            height: 4,
            bits: 8,
            cfa: None,
            black_level_dn: None,
            white_level_dn: 255,
            pitch_um: None,
            window: None,
        };
        let (root, captures) = ("set".into(), (0..7).map(dark).collect());
        let set = CaptureSet { root, camera: None, sensor, captures };
        let halves: Vec<(usize, bool, bool)> =
            stacks(&set, &[2; 7]).iter().map(|s| (s.capture, s.fit, s.held_out)).collect();
        // Alternating, from the shortest exposure on.
        let expected: Vec<_> = (0..7).map(|k| (6 - k, k % 2 == 0, k % 2 == 1)).collect();
        assert_eq!(halves, expected);
        // Five are not enough, and long stacks are divided.
        assert!(stacks(&set, &[2, 2, 2, 2, 2, 8, 8]).is_empty());
    }
}
