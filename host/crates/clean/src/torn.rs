//! Torn frames: rows from some row on, or all, are of another exposure. They are left out before
//! anything else is measured.
//!
//! Which frames these are, [`camrig_estimates::torn`] finds from the dark stacks of one gain and
//! temperature, in a strip of columns: a tear crosses them all.

use super::finding::{Done, Finding, Kind, names};
use super::scan::darks_and_flats;
use camrig_base::{Plane, Result};
use camrig_captures::{CaptureSet, Role};
use camrig_estimates::Stack;
use camrig_estimates::torn::{self, Torn};
use std::collections::BTreeMap;

/// Columns of the strip: the mean of a row scatters by a tenth of a pixel's noise.
const COLUMNS: usize = 128;
/// Most samples of a strip in memory; longer stacks have a narrower one.
const MAX_SAMPLES: usize = 1 << 26;

/// The set without torn frames, and the findings about them.
pub fn left_out(mut set: CaptureSet) -> Result<(CaptureSet, Vec<Finding>)> {
    let mut groups: BTreeMap<(u64, Option<u64>), Vec<usize>> = BTreeMap::new();
    for (index, c) in darks_and_flats(&set).filter(|(_, c)| c.role == Role::Dark) {
        let conditions = (c.analog_gain.to_bits(), c.temperature_c.map(f64::to_bits));
        groups.entry(conditions).or_default().push(index);
    }
    let mut findings = Vec::new();
    for mut darks in groups.into_values() {
        darks.sort_by(|a, b| set.captures[*a].exposure_s.total_cmp(&set.captures[*b].exposure_s));
        let strips = darks.iter().map(|i| strip(&set, *i)).collect::<Result<Vec<Stack>>>()?;
        let found = torn::find(&strips.iter().collect::<Vec<_>>());
        for index in darks {
            let capture = &mut set.captures[index];
            let own: Vec<&Torn> = found.iter().filter(|t| t.stack == capture.id).collect();
            if !own.is_empty() {
                capture.left_out = own.iter().map(|t| t.frame).collect();
                findings.push(finding(&capture.id, &own));
            }
        }
    }
    Ok((set, findings))
}

/// The middle columns of a stack.
fn strip(set: &CaptureSet, index: usize) -> Result<Stack> {
    let capture = &set.captures[index];
    let (width, height) = (set.sensor.width, set.sensor.height);
    let most = MAX_SAMPLES / (height * set.count(capture)?).max(1);
    let columns = width.min(COLUMNS).min(most.max(1));
    let first = (width - columns) / 2;
    let mut frames = Vec::new();
    set.for_each_batch(capture, |planes| {
        let cut = |p: &Plane<u16>| Plane::from_fn(columns, height, |x, y| p.row(y)[first + x]);
        frames.extend(planes.iter().map(cut));
        Ok(())
    })?;
    Ok(Stack::new(&capture.id, capture.role, capture.exposure_s, frames))
}

fn finding(id: &str, torn: &[&Torn]) -> Finding {
    let of = |t: &&Torn| match t.row {
        0 => format!("{} as a whole", t.frame),
        row => format!("{} from row {row} on", t.frame),
    };
    let frames: Vec<String> = torn.iter().map(of).collect();
    let frames: Vec<&str> = frames.iter().map(String::as_str).collect();
    let step = torn.iter().map(|t| t.step_dn).sum::<f64>() / torn.len() as f64;
    let description =
        format!("of another exposure: frame {}; a step of {step:.2} DN", names(&frames));
    Finding {
        frames: torn.iter().map(|t| t.frame).collect(),
        ..Finding::new(Kind::TornFrames, id, Done::Excluded)
            .with_count(torn.len())
            .with_amount(step, f64::NAN, "DN")
            .with_description(description)
    }
}

/// Gives the frames of a finding the numbers that they have among all frames of its capture, those
/// left out too.
pub fn number_all_frames(set: &CaptureSet, finding: &mut Finding) {
    let Some(capture) = set.captures.iter().find(|c| c.id == finding.place) else { return };
    for frame in &mut finding.frames {
        for left_out in &capture.left_out {
            *frame += usize::from(left_out <= frame);
        }
    }
}
