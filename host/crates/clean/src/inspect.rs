//! The order of the inspection: each step sees the frames without what those before it found.
//!
//! Codes and copies, then frame levels, events in single frames, changes within stacks, labels of
//! light, curves over frames, and last the marks of processing.

use super::band::{Band, bands};
use super::blocks::blocks;
use super::changes::{self, Change, Changed};
use super::corrections::{Corrections, Replaced, Substitution};
use super::curves::{self, RowSums};
use super::events::{Event, Found, MIN_FRAMES, Search};
use super::finding::{Done, Finding};
use super::options::Options;
use super::particles::{self, particles};
use super::processed::{self, Lags};
use super::residuals::{FrameLevels, Residuals};
use super::scan::{Scan, darks_and_flats};
use super::transfer::Transfer;
use super::{codes, copies, labels, requantised, temperature, top_code};
use camrig_base::{Plane, Result};
use camrig_captures::{CaptureSet, Role};

/// Largest share of the samples of a stack at its lowest code: with more, the noise is clipped, and
/// what is above the lowest code looks like events.
const CLIPPED: f64 = 1e-3;
/// Frames of a stack that are searched for marks of compression.
const COMPRESSED_FRAMES: usize = 4;

/// Results from the bands of a stack.
struct Stack {
    found: Vec<Found>,
    changes: Vec<Change>,
    lags: Lags,
    rows: RowSums,
    /// Deviation at which a sample of the typical pixel is an event, DN.
    limit_dn: f64,
}

impl Stack {
    /// Keeps the sums of rows up to date with a sample that was replaced.
    fn update_rows(&mut self, frame: usize, pixel: u32, s: Substitution) {
        let row = pixel as usize / self.rows.width;
        self.rows.sums[frame][row] += f64::from(s.to) - f64::from(s.from);
    }
}

/// The findings of a set, and the corrections for them.
pub fn inspect(set: &CaptureSet, options: &Options<'_>) -> Result<(Vec<Finding>, Corrections)> {
    let mut scans = Vec::new();
    for (index, _) in darks_and_flats(set) {
        let scan = Scan::read(set, index)?;
        options.report(scan.frames.len());
        if !scan.frames.is_empty() {
            scans.push(scan);
        }
    }
    let mut findings = copies::copies(set, &scans);
    let mut corrections = Corrections::default();
    let mut quantised_again = false;
    if let Some(step) = codes::step(&scans) {
        findings.push(codes::finding(set, &step));
        corrections.step = step.idle_bits().map(|_| step);
    } else {
        match codes::digital_gains(set, &scans) {
            gains if gains.is_empty() => quantised_again = true,
            gains => findings.extend(gains),
        }
    }
    let mut transfer = Transfer::of(set, &scans);
    let mut set = set.clone();
    let top = top_code::piled(&set, &scans);
    if let Some(top) = top.or_else(|| top_code::smeared(&set, &scans, &transfer)) {
        findings.push(top_code::finding(&set, &scans, &top));
        corrections.top_code = Some(top.dn);
        set.sensor.white_level_dn = top.dn;
        transfer = Transfer::of(&set, &scans);
    }
    let set = &set;
    let temperature = temperature::finding(set);
    if quantised_again {
        findings.extend(requantised::finding(set, &scans, &transfer));
    }
    if findings.iter().any(|f| f.done == Done::Refused) {
        findings.extend(temperature);
        return Ok((findings, corrections));
    }
    let pixels = set.sensor.width * set.sensor.height;
    let samples = scans.iter().map(|s| s.frames.len() * pixels).sum::<usize>() as f64;
    let mut stacks = Vec::with_capacity(scans.len());
    for (i, scan) in scans.iter().enumerate() {
        stacks.push(stack(set, scan, &transfer, (i, samples))?);
        options.report(scan.frames.len());
    }
    let limits: Vec<f64> = stacks.iter().map(|s| s.limit_dn).collect();
    let margins = |s: &Stack| s.found.iter().flat_map(|f| &f.margins).copied().collect();
    let margins: Vec<Vec<f32>> = stacks.iter().map(margins).collect();
    let found = stacks.iter_mut().flat_map(|s| s.found.drain(..)).collect();
    if let Some(events) = particles(found, pixels) {
        let sensitivity = particles::Sensitivity { limits: &limits, margins: &margins };
        findings.push(particles::finding(set, &scans, &transfer, &events, &sensitivity));
        exclude_events(&scans, events, &mut stacks, &mut corrections);
    }
    let (changed, finding) = changes_of(set, &scans, &transfer, &stacks)?;
    findings.extend(finding);
    exclude_changes(&scans, changed, &mut stacks, &mut corrections);
    for label in labels::labels(set, &scans, &transfer) {
        corrections.labels.insert(label.capture, label.ratio);
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
        let rows: Vec<RowSums> = stacks.into_iter().map(|s| s.rows).collect();
        corrections.curve = curves::curve(set, &scans, &transfer, &rows);
        let curve = corrections.curve.as_ref();
        findings.extend(curve.map(|c| curves::finding(set, &scans, &transfer, c)));
    }
    findings.extend(marks);
    findings.extend(temperature);
    corrections.replaced.values_mut().for_each(|r| r.sort_unstable());
    Ok((findings, corrections))
}

/// Inspects a stack band by band, given its index among the scans and the number of samples of the
/// set.
fn stack(
    set: &CaptureSet,
    scan: &Scan,
    transfer: &Transfer,
    (index, samples): (usize, f64),
) -> Result<Stack> {
    let capture = &set.captures[scan.capture];
    let cfa = set.cfa();
    let (width, height, n) = (set.sensor.width, set.sensor.height, scan.frames.len());
    let levels = FrameLevels::new(set, scan, transfer.black);
    let mut out = Stack {
        found: Vec::new(),
        changes: Vec::new(),
        lags: Lags::new(index),
        rows: RowSums { stack: index, sums: vec![Vec::with_capacity(height); n], width },
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
        out.limit_dn = out.limit_dn.min(search.limit() * (r.typical_variance * scatter).sqrt());
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
fn exclude_events(
    scans: &[Scan],
    events: Vec<Event>,
    stacks: &mut [Stack],
    out: &mut Corrections,
) {
    for e in events {
        let replaced = out.replaced.entry(scans[e.stack].capture).or_default();
        for (pixel, sample) in e.pixels.into_iter().zip(e.samples) {
            replaced.push(Replaced { frame: e.frame, pixel, value: sample.to });
            stacks[e.stack].update_rows(e.frame, pixel, sample);
        }
    }
}

/// Pixels that change within stacks, and the finding about them.
fn changes_of(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    stacks: &[Stack],
) -> Result<(Vec<Changed>, Option<Finding>)> {
    let simultaneous = stacks
        .iter()
        .zip(scans)
        .filter_map(|(stack, scan)| changes::simultaneous(&stack.changes, scan.frames.len()));
    let mut pixels: Vec<usize> = simultaneous.flatten().map(|c| c.pixel).collect();
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

/// Replaces the samples of pixels that changed, in the sums of rows too.
fn exclude_changes(
    scans: &[Scan],
    changed: Vec<Changed>,
    stacks: &mut [Stack],
    out: &mut Corrections,
) {
    for c in changed {
        let replaced = out.replaced.entry(scans[c.stack].capture).or_default();
        for pixel in c.pixels {
            for (frame, sample) in (c.from..).zip(pixel.samples) {
                replaced.push(Replaced { frame, pixel: pixel.pixel, value: sample.to });
                stacks[c.stack].update_rows(frame, pixel.pixel, sample);
            }
        }
    }
}

/// Searches the first dark stack and the brightest unsaturated flat for marks of compression.
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
