//! Comparison of two capture sets: statistics of captures of the same id, and their differences in
//! units of standard errors.

use super::ladder::Level;
use super::moments::Moments;
use super::rounding::QUANTISATION;
use super::stack::Stack;
use super::tolerance::{SAME_EXPOSURE, SAME_TEMPERATURE_C};
use camrig_base::Value;
use camrig_base::{Error, Result};
use camrig_captures::{Capture, CaptureSet};
use serde::Serialize;

/// One statistic of one capture and channel in both sets.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Id of the capture.
    pub id: String,
    /// Channel letter, lower case.
    pub channel: String,
    /// Name of the statistic, with its unit.
    pub statistic: &'static str,
    /// Value in the first set.
    pub first: Value,
    /// Value in the second set.
    pub second: Value,
    /// Difference in units of its standard error.
    pub z: f64,
}

/// Two sets, capture by capture.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// The statistics of the captures of the same id.
    pub rows: Vec<Row>,
    /// What differs besides the samples: captures of one of the sets alone, and conditions.
    pub notes: Vec<String>,
}

/// The statistics of a channel: mean, temporal variance, and spatial variance of rows, columns and
/// pixels; without those that this number of frames does not show.
///
/// Samples are whole DN. The errors of means and variances are at least those of rounding noise,
/// 1/12 DN², so that constant frames can be compared, and a constant offset between them is a
/// difference.
fn statistics(m: &Moments, frames: Frames) -> Vec<(&'static str, Value)> {
    let s = m.spatial();
    let samples = m.pixels() * m.frames as f64;
    // The scatter of a mean: temporal noise and, between sensors of one kind, fixed patterns.
    let patterns = s.row.value.max(0.0) / m.plane.rows as f64
        + s.column.value.max(0.0) / m.plane.columns as f64
        + s.pixel.value.max(0.0) / m.pixels();
    let mean_error =
        libm::hypot(m.mean_error(), patterns.sqrt()).max((QUANTISATION / samples).sqrt());
    let mut all = vec![("mean_dn", Value::new(m.mean(), mean_error))];
    let mut variance = |name, v: Value, count: f64| {
        let least = QUANTISATION * (2.0 / count).sqrt();
        all.push((name, Value::new(v.value, v.std_error.max(least))));
    };
    if frames == Frames::Several {
        variance("temporal_variance_dn2", Value::new(m.temporal, m.temporal_error), samples);
    }
    if frames != Frames::OneInOneSet {
        variance("row_variance_dn2", s.row, m.pixels());
        variance("column_variance_dn2", s.column, m.pixels());
        variance("pixel_variance_dn2", s.pixel, m.pixels());
    }
    all
}

/// How many frames two captures have.
#[derive(Clone, Copy, PartialEq)]
enum Frames {
    Several,
    /// One each: no temporal variance is seen, and the spatial ones contain it alike.
    One,
    /// One in one set alone: its spatial variances contain the temporal one, the other's do not.
    OneInOneSet,
}

impl Frames {
    fn of(first: usize, second: usize) -> Self {
        match (first > 1, second > 1) {
            (true, true) => Self::Several,
            (false, false) => Self::One,
            _ => Self::OneInOneSet,
        }
    }
}

/// Compares captures of the same id. Where both sets are of one kind of camera under the same
/// conditions, z is close to standard normal.
///
/// # Errors
/// Sets of different size or pattern, or without a common id.
pub fn compare(first: &CaptureSet, second: &CaptureSet) -> Result<Comparison> {
    let (a, b) = (&first.sensor, &second.sensor);
    if (a.width, a.height) != (b.width, b.height) || first.cfa() != second.cfa() {
        return Err(Error::disagreement(format!(
            "frames of {} x {} {} against {} x {} {}",
            a.width,
            a.height,
            first.cfa(),
            b.width,
            b.height,
            second.cfa()
        ))
        .help("compare sets of one size and colour filter pattern"));
    }
    let mut out = Comparison { rows: Vec::new(), notes: sensors_differ(first, second) };
    for (which, set, other) in [("first", first, second), ("second", second, first)] {
        let alone = set.captures.iter().filter(|c| of_id(other, &c.id).is_none());
        let alone: Vec<&str> = alone.map(|c| c.id.as_str()).collect();
        if !alone.is_empty() {
            out.notes.push(format!("only the {which} set has capture {}", alone.join(", ")));
        }
    }
    for capture in &first.captures {
        if let Some(other) = of_id(second, &capture.id) {
            out.add((first, capture), (second, other))?;
        }
    }
    if out.rows.is_empty() {
        return Err(Error::disagreement("the two sets have no capture id in common")
            .help("captures are matched by id"));
    }
    Ok(out)
}

fn of_id<'a>(set: &'a CaptureSet, id: &str) -> Option<&'a Capture> {
    set.captures.iter().find(|c| c.id == id)
}

impl Comparison {
    /// Adds the statistics of one capture of each set.
    fn add(
        &mut self,
        first: (&CaptureSet, &Capture),
        second: (&CaptureSet, &Capture),
    ) -> Result<()> {
        let id = &first.1.id;
        self.notes.extend(conditions_differ(first.1, second.1));
        let level = |(set, capture): (&CaptureSet, &Capture)| {
            Ok::<_, Error>(Level::new(set, capture, &Stack::read_moments(set, capture)?))
        };
        let (p, q) = (level(first)?, level(second)?);
        let frames = Frames::of(p.channels[0].frames, q.channels[0].frames);
        if frames == Frames::OneInOneSet {
            self.notes.push(format!(
                "capture {id:?} has one frame in one of the sets: of it, means alone are compared"
            ));
        }
        for (c, letter) in first.0.cfa().channels().iter().enumerate() {
            let of = |level: &Level| statistics(&level.channels[c], frames);
            for ((statistic, x), (_, y)) in of(&p).into_iter().zip(of(&q)) {
                self.rows.push(Row {
                    id: id.clone(),
                    channel: letter.to_ascii_lowercase().to_string(),
                    statistic,
                    first: x,
                    second: y,
                    z: (y.value - x.value) / libm::hypot(x.std_error, y.std_error),
                });
            }
        }
        Ok(())
    }
}

/// The levels in which the manifests of two sets differ.
fn sensors_differ(first: &CaptureSet, second: &CaptureSet) -> Vec<String> {
    let (a, b) = (&first.sensor, &second.sensor);
    let words = |dn: Option<f64>| dn.map_or("unknown".to_owned(), |dn| format!("{dn} DN"));
    let white = |dn: u16| Some(f64::from(dn));
    let levels = [
        ("white level", white(a.white_level_dn), white(b.white_level_dn)),
        ("black level", a.black_level_dn, b.black_level_dn),
    ];
    let differ = levels.into_iter().filter(|(_, a, b)| a != b);
    differ.map(|(name, a, b)| format!("{name}: {} against {}", words(a), words(b))).collect()
}

/// The conditions in which two captures of the same id differ.
fn conditions_differ(first: &Capture, second: &Capture) -> Option<String> {
    let (a, b) = (first, second);
    let mut differ = Vec::new();
    if a.role != b.role {
        differ.push(format!("role {:?} against {:?}", a.role, b.role));
    }
    if (a.exposure_s - b.exposure_s).abs() > SAME_EXPOSURE * a.exposure_s {
        differ.push(format!("exposure {} s against {} s", a.exposure_s, b.exposure_s));
    }
    if a.analog_gain != b.analog_gain {
        differ.push(format!("analog gain {} against {}", a.analog_gain, b.analog_gain));
    }
    if let (Some(a), Some(b)) = (a.temperature_c, b.temperature_c)
        && (a - b).abs() > SAME_TEMPERATURE_C
    {
        differ.push(format!("temperature {a} °C against {b} °C"));
    }
    if a.light != b.light {
        differ.push("another light".to_owned());
    }
    let id = &first.id;
    (!differ.is_empty()).then(|| format!("capture {id:?} differs: {}", differ.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::write_npy;
    use std::path::Path;

    /// A set of stacks of two mono frames of 16 x 8, from (id, entry, samples); `sensor` is more
    /// of its table.
    fn set(folder: &Path, sensor: &str, captures: &[(&str, &str, [u16; 2])]) -> CaptureSet {
        let mut text = format!(
            "format = \"captures/1\"\n[sensor]\nwidth = 16\nheight = 8\nbits = 12\n{sensor}\n"
        );
        for (id, entry, [even, odd]) in captures {
            let value = |i: usize| if i.is_multiple_of(2) { *even } else { *odd };
            let samples: Vec<u16> = (0..2 * 16 * 8).map(value).collect();
            write_npy(&folder.join(format!("{id}.npy")), &[2, 8, 16], &samples);
            text += &format!("[[capture]]\nid = \"{id}\"\nfiles = \"{id}.npy\"\n{entry}\n");
        }
        std::fs::write(folder.join("captures.toml"), text).unwrap();
        CaptureSet::load(folder).unwrap()
    }

    const BIAS: &str = "role = \"dark\"\nexposure_s = 0.0";

    #[test]
    fn constant_frames_differ_where_their_values_do() {
        let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let a = set(folders[0].path(), "", &[("bias", BIAS, [64; 2])]);
        let b = set(folders[1].path(), "", &[("bias", BIAS, [80; 2])]);
        let differ = compare(&a, &b).unwrap();
        let mean = &differ.rows[0];
        // Rounding of 256 samples: errors of √(1/12/256) DN on either side.
        let z = 16.0 / (2.0 / 12.0f64 / 256.0).sqrt();
        assert_eq!(mean.statistic, "mean_dn");
        assert!((mean.z / z - 1.0).abs() < 1e-9, "{mean:?}");
        assert!(differ.rows[1..].iter().all(|row| row.z == 0.0), "{:?}", differ.rows);
        assert!(compare(&a, &a).unwrap().rows.iter().all(|row| row.z == 0.0));
    }

    #[test]
    fn other_conditions_and_captures_are_reported() {
        let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let dark = "role = \"dark\"\nexposure_s = 0.02";
        let flat = "role = \"flat\"\nexposure_s = 2.0\nanalog_gain = 8.0";
        let black = "black_level_dn = 64";
        let a = [("bias", BIAS, [64; 2]), ("g", dark, [99, 101])];
        let a = set(folders[0].path(), black, &a);
        let b = [("g", flat, [99, 101])];
        let b = set(folders[1].path(), "black_level_dn = 0\nwhite_level_dn = 2000", &b);
        let told = compare(&a, &b).unwrap().notes.join("\n");
        for words in [
            "white level: 4095 DN against 2000 DN",
            "black level: 64 DN against 0 DN",
            "only the first set has capture bias",
            "capture \"g\" differs: role Dark against Flat, exposure 0.02 s against 2 s, analog \
             gain 1 against 8",
        ] {
            assert!(told.contains(words), "{words}: {told}");
        }
        assert_eq!(compare(&a, &a).unwrap().notes, [""; 0]);
    }
}
