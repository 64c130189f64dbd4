//! Detects copied frames in a stack. Copies have no noise of their own, so that the temporal
//! variance is too low: by a third if each of two frames occurs twice.

use super::stack::Stack;
use camrig_base::copies::Print;
use camrig_base::{Error, Result};
use camrig_captures::{Capture, CaptureSet};
use std::collections::{BTreeMap, BTreeSet};

/// Refuses copies in a capture that was read as `stack`. Only frames with equal sums are read again
/// and compared.
///
/// # Errors
/// A frame that is a copy of another, and files that cannot be read.
pub fn refuse(set: &CaptureSet, capture: &Capture, stack: &Stack) -> Result<()> {
    let alike = alike(&stack.marks);
    if alike.is_empty() {
        return Ok(());
    }
    let across = set.cfa().width;
    let mut first: BTreeMap<Print, usize> = BTreeMap::new();
    let (mut copy, mut frame) = (None, 0);
    set.for_each_batch(capture, |planes| {
        for plane in planes {
            let print = alike.contains(&frame).then(|| Print::of(plane, across)).flatten();
            if let Some(print) = print {
                let of = *first.entry(print).or_insert(frame);
                if of != frame {
                    copy.get_or_insert((frame, of));
                }
            }
            frame += 1;
        }
        Ok(())
    })?;
    let Some((frame, of)) = copy else { return Ok(()) };
    // Where each frame has its own file, its name helps.
    let name = |i: usize| match capture.files.get(i) {
        Some(file) if capture.files.len() == stack.frames => {
            format!("frame {i} ({})", file.display())
        }
        _ => format!("frame {i}"),
    };
    Err(Error::input(format!("{} is a copy of {}, the same samples", name(frame), name(of)))
        .at(format!("capture {:?}", capture.id))
        .help("copies have no noise of their own: take the frames again, or keep one of each"))
}

/// The frames whose hash equals that of another frame.
fn alike(marks: &[u64]) -> BTreeSet<usize> {
    let mut frames: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (frame, mark) in marks.iter().enumerate() {
        frames.entry(*mark).or_default().push(frame);
    }
    frames.into_values().filter(|frames| frames.len() > 1).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Sensor, Shot, write_npy};

    /// The refusal of a dark of frames of these samples, 8 x 6 each.
    fn refusal(frames: &[Vec<u16>]) -> Option<String> {
        let directory = tempfile::tempdir().unwrap();
        let sensor = Sensor { width: 8, height: 6, ..Sensor::default() };
        let shot =
            Shot { exposure_s: 0.01, rate: 0.0, frames: 2, temperature_c: 25.0, analog_gain: 1.0 };
        sensor.write(directory.path(), &[shot]);
        let shape = [frames.len(), 6, 8];
        write_npy(&directory.path().join("dark-0.npy"), &shape, &frames.concat());
        let set = CaptureSet::load(directory.path()).unwrap();
        let capture = &set.captures[0];
        let stack = Stack::read(&set, capture).unwrap();
        refuse(&set, capture, &stack).err().map(|e| e.to_string())
    }

    #[test]
    fn copied_frames_are_refused_unless_the_sensor_has_no_noise() {
        let noise = |k: u32| -> Vec<u16> {
            let sample = |i: u32| 60 + ((48 * k + i).wrapping_mul(2_654_435_761) >> 29) as u16;
            (0..48).map(sample).collect()
        };
        // Equal sums alone are not a copy.
        let mut turned = noise(1);
        turned.rotate_left(5);
        assert_eq!(refusal(&[noise(1), turned, noise(2)]), None);
        assert_eq!(refusal(&[vec![64; 48], vec![64; 48]]), None);
        let copied = refusal(&[noise(1), noise(2), noise(1)]).unwrap();
        for part in ["frame 2 is a copy of frame 0", "capture \"dark-0\"", "keep one of each"] {
            assert!(copied.contains(part), "{copied}");
        }
    }
}
