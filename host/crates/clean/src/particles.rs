//! Whether events in single frames are particles, and their rate.
//!
//! Telegraph noise recurs in the same pixels, or has small steps; heavy tails of noise have both
//! signs; neither extends to a neighbour. Particles occur anywhere, add charge, often much of it,
//! and often cross pixels. The rate a + b t, t the exposure, is fitted to the counts of the stacks
//! by maximum likelihood (Poisson), each weighted by the share of particles detected in its stack
//! ([`super::completeness`]).

use super::completeness::Completeness;
use super::events::{Event, FALSE_EVENTS, Found};
use super::finding::{Done, Finding, Hit, Kind, MAX_PIXELS, Rate, names};
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_base::numbers::counted;
use camrig_base::tails;
use camrig_captures::CaptureSet;
use std::collections::BTreeMap;

/// Largest number of negative or recurring events, relative to all events and in addition to that,
/// that is consistent with particles.
const MAX_OTHERS_SHARE: f64 = 0.1;
const MAX_OTHERS: f64 = 2.0;
/// Probability of as few negative events from a symmetric distribution below which the distribution
/// is not symmetric.
const SYMMETRIC: f64 = 0.01;
/// Number of events below which neither symmetry nor recurrence identifies a cause: 2⁻⁷ is below
/// the probability above.
const FEW: usize = 7;
/// Standard deviations above which an event is not the occasional jump of a noisy pixel: one that
/// jumps so far recurs.
const STRONG: f64 = 12.0;
/// Smallest share of particles that cross pixels or are strong. Of an exponential distribution with
/// a mean as large as the limit a third is strong; of pixels that jump by a few standard deviations
/// of noise, none.
const MIN_DISTINCTIVE_SHARE: f64 = 0.10;
/// Probability of fewer, from which they are too few.
const TOO_FEW: f64 = 1e-2;

/// A stack is quiet if its limit is below this multiple of the lowest.
const QUIET: f64 = 1.5;

/// The events that are particles; `None` where they have another cause. `found` are the events of
/// all bands, `pixels` is the number of pixels of a frame.
pub fn particles(found: Vec<Found>, pixels: usize) -> Option<Vec<Event>> {
    let too_many = |others: usize, all: f64| others as f64 > MAX_OTHERS_SHARE * all + MAX_OTHERS;
    let negative: usize = found.iter().map(|f| f.negative).sum();
    let mut events: Vec<Event> = found.into_iter().flat_map(|f| f.events).collect();
    if events.is_empty() || too_many(negative, events.len() as f64) {
        return None;
    }
    // Events whose largest sample is in the same pixel.
    let mut at: BTreeMap<[usize; 2], usize> = BTreeMap::new();
    events.iter().for_each(|e| *at.entry(e.at).or_default() += 1);
    let n = events.len() as f64;
    let recurring: usize = at.values().map(|&k| k - 1).sum();
    if tails::poisson_at_least(recurring, n * n / (2.0 * pixels as f64)) < FALSE_EVENTS {
        if too_many(recurring, n) {
            return None;
        }
        events.retain(|e| at[&e.at] == 1);
    }
    // A few events may be the tails of noise, which is symmetric and does not extend to neighbours.
    let several = events.iter().any(|e| e.pixels.len() > 1);
    let all = negative + events.len();
    if tails::binomial_at_most(negative, all, 0.5) > SYMMETRIC && !(several && negative == 0) {
        return None;
    }
    let distinctive = events.iter().filter(|e| e.pixels.len() > 1 || e.z > STRONG).count();
    let chance = tails::binomial_at_most(distinctive, events.len(), MIN_DISTINCTIVE_SHARE);
    (distinctive > 0 && chance > TOO_FEW).then_some(events)
}

/// How sensitive each stack is to events.
pub struct Sensitivity<'a> {
    /// For each stack, the deviation at which a sample of the typical pixel is an event, DN.
    pub limits: &'a [f64],
    /// For each stack, how far samples spread over it would have to rise to be events, DN.
    pub margins: &'a [Vec<f32>],
}

/// The finding about particles.
pub fn finding(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    events: &[Event],
    sensitivity: &Sensitivity<'_>,
) -> Finding {
    let Sensitivity { limits, margins } = sensitivity;
    let lowest = limits.iter().copied().fold(f64::INFINITY, f64::min);
    // Charges and tracks come from stacks nearly as quiet as the quietest: in others, noise hides
    // the ends of tracks.
    let is_quiet = |e: &&Event| limits[e.stack] < QUIET * lowest;
    let quiet: Vec<&Event> = events.iter().filter(is_quiet).collect();
    let tracks = if quiet.is_empty() { events.iter().collect() } else { quiet };
    let completeness = Completeness::new(&tracks, margins, lowest);
    let counts: Vec<Counted> = scans
        .iter()
        .enumerate()
        .filter(|(i, _)| !margins[*i].is_empty())
        .map(|(i, s)| Counted {
            events: events.iter().filter(|e| e.stack == i).count() as f64,
            frames: s.frames.len() as f64 * completeness.of_stack(i),
            exposure_s: set.captures[s.capture].exposure_s,
        })
        .collect();
    let searched = (0..scans.len()).filter(|&i| !margins[i].is_empty());
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
        true => "; too few to distinguish particles from pixels that jump",
        false => "",
    };
    let mut finding = Finding::new(Kind::ParticleHits, ids.join(", "), Done::Excluded);
    finding.count = events.len();
    finding.pixels = events.iter().map(|e| e.at).take(MAX_PIXELS).collect();
    let hit = |e: &Event| Hit {
        capture: set.captures[scans[e.stack].capture].id.clone(),
        charge_dn: e.charge_dn,
        frame: e.frame,
        pixel: e.at,
    };
    finding.hits = events.iter().map(hit).take(MAX_PIXELS).collect();
    finding.rate = Some(rate);
    let value = rate.per_s.unwrap_or(rate.per_frame);
    let error = rate.per_s_std_error.unwrap_or(rate.per_frame_std_error);
    let unit = if rate.per_s.is_some() { "1/s" } else { "1/frame" };
    finding.with_amount(value, error, unit).with_description(format!(
        "{} in a single frame each, like hits of particles (cosmic rays, radioactivity), \
         {several} of them over several pixels, {} in {}; mean charge {}. Rate of all above {}, \
         of which {share:.0} % are detected: {}{cause}. Their samples are excluded",
        counted(events.len(), "event"),
        counted(samples, "sample"),
        names(&ids),
        electrons(charge),
        electrons(lowest),
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

/// The number of events in a stack.
struct Counted {
    events: f64,
    /// Number of frames times the share of events that is detected in them.
    frames: f64,
    exposure_s: f64,
}

/// The rate a + b t by maximum likelihood.
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
    // Expectation maximisation: each event belongs to the frame or to the exposure in proportion to
    // the two terms, which stay non-negative.
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
