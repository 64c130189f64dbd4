//! The order in which a set is looked at: each stage sees what those before it left.
//!
//! Codes and copies, then the level of frames, events of single frames, changes within stacks,
//! labels of light, curves over frames, and last the marks of processing.

use super::band::{Band, Levels, Residuals, bands};
use super::blocks::blocks;
use super::changes::{self, Change, Changed};
use super::cleaned::{Changes, Replaced};
use super::curves::{self, Rows};
use super::events::{self, particles};
use super::finding::{Done, Finding};
use super::hits::{Event, Found, MIN_FRAMES, Search};
use super::processed::{self, Lags};
use super::scan::{Scan, of_light};
use super::transfer::Transfer;
use super::{codes, copies, labels, temperature};
use camrig_base::{Plane, Result};
use camrig_captures::{CaptureSet, Role};

/// Share of the samples of a stack that may be at its lowest code: more of them are clipped, and
/// what is above them looks like events.
const CLIPPED: f64 = 1e-3;
/// Frames that marks of compression are looked for in, per stack.
const COMPRESSED_FRAMES: usize = 4;

/// What the bands of a stack gave.
struct Stack {
    found: Vec<Found>,
    changes: Vec<Change>,
    lags: Lags,
    rows: Rows,
    /// Deviation that a sample of the typical pixel needs to be an event, DN.
    limit_dn: f64,
}

/// Findings of a set, and what is done about them. `progress` hears how many frames were read.
pub fn inspect(
    set: &CaptureSet,
    progress: &(dyn Fn(usize) + Sync),
) -> Result<(Vec<Finding>, Changes)> {
    let mut scans = Vec::new();
    for (index, _) in of_light(set) {
        let scan = Scan::read(set, index)?;
        progress(scan.frames.len());
        if !scan.frames.is_empty() {
            scans.push(scan);
        }
    }
    let mut findings = copies::copies(set, &scans);
    let mut done = Changes::default();
    if let Some(step) = codes::step(&scans) {
        findings.push(codes::finding(set, &step));
        done.step = step.idle_bits().map(|_| step);
    }
    let temperature = temperature::finding(set);
    if findings.iter().any(|f| f.done == Done::Refused) {
        findings.extend(temperature);
        return Ok((findings, done));
    }
    let transfer = Transfer::of(set, &scans);
    let pixels = set.sensor.width * set.sensor.height;
    let samples = scans.iter().map(|s| s.frames.len() * pixels).sum::<usize>() as f64;
    let mut stacks = Vec::with_capacity(scans.len());
    for (i, scan) in scans.iter().enumerate() {
        stacks.push(stack(set, scan, &transfer, (i, samples))?);
        progress(scan.frames.len());
    }
    let limits: Vec<f64> = stacks.iter().map(|s| s.limit_dn).collect();
    let margins = |s: &Stack| s.found.iter().flat_map(|f| &f.margins).copied().collect();
    let margins: Vec<Vec<f32>> = stacks.iter().map(margins).collect();
    let found = stacks.iter_mut().flat_map(|s| s.found.drain(..)).collect();
    if let Some(events) = particles(found, pixels) {
        let seen = events::Seen { limits: &limits, margins: &margins };
        findings.push(events::finding(set, &scans, &transfer, &events, &seen));
        take_events_off(&scans, &events, &mut stacks, &mut done);
    }
    let (changed, finding) = changes_of(set, &scans, &transfer, &stacks)?;
    findings.extend(finding);
    take_changes_off(&scans, &changed, &mut stacks, &mut done);
    for label in labels::labels(set, &scans, &transfer) {
        done.labels.insert(label.capture, label.ratio);
        findings.push(labels::finding(set, &label));
    }
    let lags: Vec<Lags> = stacks.iter().map(|s| s.lags.clone()).collect();
    let filtered = processed::demosaiced(set, &scans, &lags)
        .or_else(|| processed::filtered(set, &scans, &transfer, &lags));
    let marks = match filtered {
        Some(finding) => Some(finding),
        None => transformed(set, &scans)?,
    };
    if marks.is_none() {
        let rows: Vec<Rows> = stacks.into_iter().map(|s| s.rows).collect();
        done.curve = curves::curve(set, &scans, &transfer, &rows);
        let said = done.curve.as_ref();
        findings.extend(said.map(|c| curves::finding(set, &scans, &transfer, c)));
    }
    findings.extend(marks);
    findings.extend(temperature);
    done.replaced.values_mut().for_each(|r| r.sort_unstable());
    Ok((findings, done))
}

/// Looks at a stack band by band. `of` is its index among the scans, and the samples of the set.
fn stack(
    set: &CaptureSet,
    scan: &Scan,
    transfer: &Transfer,
    (index, samples): (usize, f64),
) -> Result<Stack> {
    let capture = &set.captures[scan.capture];
    let cfa = set.cfa();
    let (width, height, n) = (set.sensor.width, set.sensor.height, scan.frames.len());
    let levels = Levels::new(set, scan, transfer.black);
    let mut out = Stack {
        found: Vec::new(),
        changes: Vec::new(),
        lags: Lags::new(index),
        rows: Rows { stack: index, sums: vec![Vec::with_capacity(height); n], width },
        limit_dn: f64::INFINITY,
    };
    let clipped = lowest_is_clipped(scan);
    for rows in bands(width, height, n, cfa.height) {
        let band = Band::read(set, capture, &rows)?;
        for row in band.samples.chunks(width * n) {
            let mut sums = vec![0.0; n];
            for pixel in row.chunks(n) {
                sums.iter_mut().zip(pixel).for_each(|(s, &v)| *s += f64::from(v));
            }
            out.rows.sums.iter_mut().zip(sums).for_each(|(frame, s)| frame.push(s));
        }
        let r = Residuals::new(&band, &levels);
        out.lags.add(&r, (cfa.width, cfa.height), rows.start);
        let search = Search {
            stack: index,
            first_row: rows.start,
            dn_per_e: transfer.gain(capture.analog_gain),
            black: transfer.black,
            samples,
            white: f64::from(set.sensor.white_level_dn),
        };
        if clipped || n < MIN_FRAMES {
            continue;
        }
        let found = search.find(&band, &r, cfa.width);
        let scatter = 1.0 + std::f64::consts::PI / 2.0 / (n as f64 - 1.0);
        out.limit_dn = out.limit_dn.min(search.limit() * (r.typical * scatter).sqrt());
        let masked: Vec<(usize, usize)> = found
            .events
            .iter()
            .flat_map(|e| e.pixels.iter().map(|&p| (e.frame, p as usize)))
            .collect();
        out.changes.extend(changes::changes(&search, &r, &masked));
        out.found.push(found);
    }
    Ok(out)
}

/// Whether the converter clips the noise of a stack at its lower end.
fn lowest_is_clipped(scan: &Scan) -> bool {
    let all: u64 = scan.codes.iter().sum();
    let Some(lowest) = scan.codes.iter().position(|&n| n > 0) else { return false };
    let next = scan.codes.get(lowest + 1).copied().unwrap_or(0);
    let count = scan.codes[lowest];
    // A stack of one code has no noise to clip.
    count > next && next > 0 && count as f64 > CLIPPED * all as f64
}

/// Replaces the samples of events, in the sums of rows too.
fn take_events_off(scans: &[Scan], events: &[Event], stacks: &mut [Stack], done: &mut Changes) {
    for e in events {
        let replaced = done.replaced.entry(scans[e.stack].capture).or_default();
        for (&pixel, &[was, is]) in e.pixels.iter().zip(&e.samples) {
            replaced.push(Replaced { frame: e.frame, pixel, value: is });
            let rows = &mut stacks[e.stack].rows;
            rows.sums[e.frame][pixel as usize / rows.width] += f64::from(is) - f64::from(was);
        }
    }
}

/// Pixels that change within stacks, and what is said of them.
fn changes_of(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    stacks: &[Stack],
) -> Result<(Vec<Changed>, Option<Finding>)> {
    let together = stacks.iter().zip(scans).filter_map(|(stack, scan)| {
        changes::together(&stack.changes, scan.frames.len()).map(|found| found.1)
    });
    let mut pixels: Vec<usize> = together.flatten().map(|c| c.pixel).collect();
    pixels.sort_unstable();
    pixels.dedup();
    if pixels.is_empty() {
        return Ok((Vec::new(), None));
    }
    let changed = changes::follow(set, scans, transfer, &pixels)?;
    if changed.is_empty() {
        return Ok((changed, None));
    }
    let finding = changes::finding(set, scans, transfer, &pixels, &changed);
    Ok((changed, Some(finding)))
}

/// Replaces the samples of pixels that changed.
fn take_changes_off(
    scans: &[Scan],
    changed: &[Changed],
    stacks: &mut [Stack],
    done: &mut Changes,
) {
    for c in changed {
        let replaced = done.replaced.entry(scans[c.stack].capture).or_default();
        for (pixel, values) in &c.values {
            for (i, &[was, is]) in values.iter().enumerate() {
                let (pixel, frame) = (*pixel, c.from + i);
                replaced.push(Replaced { frame, pixel, value: is });
                let rows = &mut stacks[c.stack].rows;
                rows.sums[frame][pixel as usize / rows.width] += f64::from(is) - f64::from(was);
            }
        }
    }
}

/// Looks for marks of compression in the first dark stack and in the brightest flat.
fn transformed(set: &CaptureSet, scans: &[Scan]) -> Result<Option<Finding>> {
    let role = |s: &&Scan| set.captures[s.capture].role;
    let unsaturated = |s: &&Scan| s.saturated(set.sensor.white_level_dn) < CLIPPED;
    let dark = scans.iter().find(|s| role(s) == Role::Dark);
    let flats = scans.iter().filter(|s| role(s) == Role::Flat).filter(unsaturated);
    let flat = flats.max_by(|a, b| a.mean().total_cmp(&b.mean()));
    let mut best: Option<(f64, Finding)> = None;
    for scan in dark.into_iter().chain(flat) {
        let mut frames: Vec<Plane<u16>> = Vec::new();
        set.for_each_batch(&set.captures[scan.capture], |planes| {
            let more = COMPRESSED_FRAMES.saturating_sub(frames.len());
            frames.extend(planes.iter().take(more).cloned());
            Ok(())
        })?;
        if let Some(found) = blocks(&frames)
            && best.as_ref().is_none_or(|(strength, _)| found.strength > *strength)
        {
            best = Some((found.strength, processed::transformed(set, scan, &found)));
        }
    }
    Ok(best.map(|b| b.1))
}
