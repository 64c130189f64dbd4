//! Whether events of single frames are particles, and how often they come.
//!
//! Telegraph noise jumps in the same pixels again, or by little; heavy tails of noise go both ways;
//! and neither reaches a neighbour. Particles come anywhere, add charge, often much of it, and
//! often cross pixels. The rate is fitted to the counts of the stacks as a + b t, t the exposure,
//! by the likelihood of their Poisson law, each with the share of particles that its stack shows
//! ([`super::completeness`]).

use super::completeness::Completeness;
use super::finding::{Done, Finding, Kind, Rate, names};
use super::hits::{Event, FALSE_EVENTS, Found};
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_base::numbers::counted;
use camrig_base::tails;
use camrig_captures::CaptureSet;
use std::collections::BTreeMap;

/// Events below their pixel's other samples, beyond this share of those above and this number, are
/// noise with wide tails.
const NEGATIVE: (f64, f64) = (0.1, 2.0);
/// Chance of as few events below among symmetric ones from which these are not taken to be so.
const SYMMETRIC: f64 = 0.01;
/// Events below which neither symmetry nor recurrence tells much of a cause: 2⁻⁷ is below the
/// chance above.
const FEW: usize = 7;
/// Deviation from which an event is no chance of a noisy pixel: one that jumps so far is seen
/// again.
const STRONG: f64 = 12.0;
/// Share of particles that reach several pixels or are strong, at least, and the chance of fewer.
/// Of an exponential law with a mean as large as the limit a third is strong; of pixels that jump
/// by a few standard deviations of noise, none.
const TELLING: (f64, f64) = (0.10, 1e-2);

/// A stack is quiet whose limit is below this multiple of the lowest.
const QUIET: f64 = 1.5;

/// The events that are particles; `None` where something else made them. `found` are those of all
/// bands, `pixels` those of a frame.
pub fn particles(found: Vec<Found>, pixels: usize) -> Option<Vec<Event>> {
    let negative: usize = found.iter().map(|f| f.negative).sum();
    let mut events: Vec<Event> = found.into_iter().flat_map(|f| f.events).collect();
    if events.is_empty() || negative as f64 > NEGATIVE.0 * events.len() as f64 + NEGATIVE.1 {
        return None;
    }
    // Events whose largest sample is in the same pixel again.
    let mut at: BTreeMap<[usize; 2], usize> = BTreeMap::new();
    events.iter().for_each(|e| *at.entry(e.at).or_default() += 1);
    let n = events.len() as f64;
    let again: usize = at.values().map(|&k| k - 1).sum();
    if tails::poisson_least(again, n * n / (2.0 * pixels as f64)) < FALSE_EVENTS {
        if again as f64 > NEGATIVE.0 * n + NEGATIVE.1 {
            return None;
        }
        events.retain(|e| at[&e.at] == 1);
    }
    // Few events may be the tails of noise, which is symmetric; such do not reach neighbours.
    let several = events.iter().any(|e| e.pixels.len() > 1);
    let all = negative + events.len();
    if tails::binomial_most(negative, all, 0.5) > SYMMETRIC && !(several && negative == 0) {
        return None;
    }
    let telling = events.iter().filter(|e| e.pixels.len() > 1 || e.z > STRONG).count();
    let (share, chance) = TELLING;
    let enough = telling > 0 && tails::binomial_most(telling, events.len(), share) > chance;
    enough.then_some(events)
}

/// Where events would be seen.
pub struct Seen<'a> {
    /// For each stack, the deviation that single samples of the typical pixel need, DN.
    pub limits: &'a [f64],
    /// For each stack, how far samples all over it would have to rise to be events, DN.
    pub margins: &'a [Vec<f32>],
}

/// What is said of them.
pub fn finding(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    events: &[Event],
    seen: &Seen<'_>,
) -> Finding {
    let quietest = seen.limits.iter().copied().fold(f64::INFINITY, f64::min);
    // Stacks nearly as quiet as the quietest tell charges and tracks: in others noise hides the
    // ends of tracks.
    let is_quiet = |e: &&Event| seen.limits[e.stack] < QUIET * quietest;
    let quiet: Vec<&Event> = events.iter().filter(is_quiet).collect();
    let told = if quiet.is_empty() { events.iter().collect() } else { quiet };
    let shown = Completeness::new(&told, seen.margins, quietest);
    let counts: Vec<Counted> = scans
        .iter()
        .enumerate()
        .filter(|(i, _)| !seen.margins[*i].is_empty())
        .map(|(i, s)| Counted {
            events: events.iter().filter(|e| e.stack == i).count() as f64,
            frames: s.frames.len() as f64 * shown.of_law(i),
            exposure_s: set.captures[s.capture].exposure_s,
        })
        .collect();
    let searched = (0..scans.len()).filter(|&i| !seen.margins[i].is_empty());
    let all: f64 = searched.map(|i| scans[i].frames.len() as f64).sum();
    let share = 100.0 * counts.iter().map(|c| c.frames).sum::<f64>() / all.max(1.0);
    let rate = rate(&counts);
    let mut stacks: Vec<usize> = events.iter().map(|e| e.stack).collect();
    stacks.sort_unstable();
    stacks.dedup();
    let ids: Vec<&str> =
        stacks.iter().map(|&s| set.captures[scans[s].capture].id.as_str()).collect();
    let samples: usize = events.iter().map(|e| e.pixels.len()).sum();
    let charge = events.iter().map(|e| e.charge_dn).sum::<f64>() / events.len() as f64;
    let electrons = |dn: f64| match transfer.dn_per_e {
        Some(k) if k > 0.0 => format!("{dn:.1} DN ({:.0} e⁻)", dn / k),
        _ => format!("{dn:.1} DN"),
    };
    let several = events.iter().filter(|e| e.pixels.len() > 1).count();
    let cause = match events.len() < FEW {
        true => "; too few to tell particles from pixels that jump",
        false => "",
    };
    let mut finding = Finding::new(Kind::ParticleHits, ids.join(", "), Done::LeftOut);
    finding.count = events.len();
    finding.pixels = events.iter().map(|e| e.at).take(super::finding::MAX_PIXELS).collect();
    finding.rate = Some(rate);
    let value = rate.per_s.unwrap_or(rate.per_frame);
    let error = rate.per_s_std_error.unwrap_or(rate.per_frame_std_error);
    let unit = if rate.per_s.is_some() { "1/s" } else { "1/frame" };
    finding.amount(value, error, unit).says(format!(
        "{} in a single frame each, as particles leave them (cosmic rays, radioactivity), \
         {several} of them over several pixels, {} in {}; mean charge {}. Rate of all with more \
         than {}, of which {share:.0} % are found: {}{cause}. Their samples are left out",
        counted(events.len(), "event"),
        counted(samples, "sample"),
        names(&ids),
        electrons(charge),
        electrons(quietest),
        in_words(&rate),
    ))
}

fn in_words(rate: &Rate) -> String {
    let constant = format!("{:.2} ± {:.2} per frame", rate.per_frame, rate.per_frame_std_error);
    match (rate.per_s, rate.per_s_std_error) {
        (Some(b), Some(se)) => format!("{constant} and {b:.3} ± {se:.3} per second of exposure"),
        _ => constant,
    }
}

/// Events of a stack.
struct Counted {
    events: f64,
    /// Frames times the share of events that is found in them.
    frames: f64,
    exposure_s: f64,
}

/// a + b t by Poisson's likelihood, Newton steps from a straight line.
fn rate(counts: &[Counted]) -> Rate {
    let frames: f64 = counts.iter().map(|c| c.frames).sum();
    let events: f64 = counts.iter().map(|c| c.events).sum();
    let longest = counts.iter().map(|c| c.exposure_s).fold(0.0, f64::max);
    let shortest = counts.iter().map(|c| c.exposure_s).fold(f64::INFINITY, f64::min);
    let constant = Rate {
        per_frame: events / frames.max(1e-9),
        per_frame_std_error: events.max(1.0).sqrt() / frames.max(1e-9),
        per_s: None,
        per_s_std_error: None,
    };
    if longest < 2.0 * shortest || longest <= 0.0 {
        return constant;
    }
    // Expectation maximisation: each event is of the frame or of the exposure, in proportion. It
    // keeps both terms at 0 and above.
    let (mut a, mut b) = (0.5 * constant.per_frame, 0.5 * constant.per_frame / longest);
    let seconds: f64 = counts.iter().map(|c| c.frames * c.exposure_s).sum();
    for _ in 0..2000 {
        let (mut of_frames, mut of_time) = (0.0, 0.0);
        for c in counts {
            let total = (a + b * c.exposure_s).max(1e-300);
            of_frames += c.events * a / total;
            of_time += c.events * b * c.exposure_s / total;
        }
        (a, b) = (of_frames / frames, of_time / seconds);
    }
    // Fisher information of both.
    let (mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0);
    for c in counts {
        let w = c.frames / (a + b * c.exposure_s).max(1e-9);
        aa += w;
        ab += w * c.exposure_s;
        bb += w * c.exposure_s * c.exposure_s;
    }
    let determinant = (aa * bb - ab * ab).max(1e-300);
    Rate {
        per_frame: a,
        per_frame_std_error: (bb / determinant).sqrt(),
        per_s: Some(b),
        per_s_std_error: Some((aa / determinant).sqrt()),
    }
}
