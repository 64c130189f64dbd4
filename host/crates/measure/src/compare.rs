//! Comparison of two capture sets: statistics of captures of the same id, and their differences in
//! units of standard errors.

use super::ladder::Level;
use super::moments::Moments;
use super::stack::Stack;
use super::value::Value;
use camrig_base::{Error, Result};
use camrig_captures::CaptureSet;
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

/// The statistics of a channel: mean, temporal variance, and spatial variance of rows, columns and
/// pixels.
fn statistics(m: &Moments) -> [(&'static str, Value); 5] {
    let s = m.spatial();
    // The scatter of a mean: temporal noise and, between sensors of one kind, fixed patterns.
    let patterns = s.row.value.max(0.0) / m.plane.rows as f64
        + s.column.value.max(0.0) / m.plane.columns as f64
        + s.pixel.value.max(0.0) / m.pixels();
    let mean_error = m.mean_error().hypot(patterns.sqrt());
    [
        ("mean_dn", Value::new(m.mean(), mean_error)),
        ("temporal_variance_dn2", Value::new(m.temporal, m.temporal_error)),
        ("row_variance_dn2", s.row),
        ("column_variance_dn2", s.column),
        ("pixel_variance_dn2", s.pixel),
    ]
}

/// Compares captures of the same id. Where both sets are of one kind of camera under the same
/// conditions, z is close to standard normal.
///
/// # Errors
/// Sets of different size or pattern, or without a common id.
pub fn compare(first: &CaptureSet, second: &CaptureSet) -> Result<Vec<Row>> {
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
    let letters = first.cfa().channels();
    let mut rows = Vec::new();
    for capture in &first.captures {
        let Some(other) = second.captures.iter().find(|c| c.id == capture.id) else { continue };
        let level = |set: &CaptureSet, c| {
            Ok::<_, Error>(Level::new(set, c, &Stack::read_moments(set, c)?))
        };
        let (p, q) = (level(first, capture)?, level(second, other)?);
        for (c, letter) in letters.iter().enumerate() {
            let (sp, sq) = (statistics(&p.channels[c]), statistics(&q.channels[c]));
            for ((name, x), (_, y)) in sp.into_iter().zip(sq) {
                let error = x.std_error.hypot(y.std_error);
                if error > 0.0 {
                    rows.push(Row {
                        id: capture.id.clone(),
                        channel: letter.to_ascii_lowercase().to_string(),
                        statistic: name,
                        first: x,
                        second: y,
                        z: (y.value - x.value) / error,
                    });
                }
            }
        }
    }
    if rows.is_empty() {
        return Err(Error::disagreement("the two sets have no capture id in common")
            .help("captures are matched by id"));
    }
    Ok(rows)
}
