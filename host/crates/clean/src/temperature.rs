//! Stacks whose temperature the manifest does not give.

use super::finding::{Done, Finding, Kind};
use super::scan::darks_and_flats;
use camrig_captures::CaptureSet;

/// The finding about dark and flat stacks without a temperature.
pub fn finding(set: &CaptureSet) -> Option<Finding> {
    let unknown: Vec<&str> = darks_and_flats(set)
        .filter(|(_, c)| c.temperature_c.is_none())
        .map(|(_, c)| c.id.as_str())
        .collect();
    if unknown.is_empty() {
        return None;
    }
    let all = darks_and_flats(set).count();
    let finding = Finding::new(Kind::Temperature, unknown.join(", "), Done::Reported);
    Some(finding.with_count(unknown.len()).with_description(format!(
        "captures.toml has no temperature for {} of {all} dark and flat stacks; that of the camera \
         file is assumed. These captures cannot distinguish an unusual dark current from an \
         unusual temperature; add temperature_c",
        unknown.len(),
    )))
}
