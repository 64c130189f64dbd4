//! Stacks whose temperature the manifest does not give.

use super::finding::{Done, Finding, Kind};
use super::scan::of_light;
use camrig_captures::CaptureSet;

/// What is said of dark and flat stacks without a temperature.
pub fn finding(set: &CaptureSet) -> Option<Finding> {
    let unknown: Vec<&str> = of_light(set)
        .filter(|(_, c)| c.temperature_c.is_none())
        .map(|(_, c)| c.id.as_str())
        .collect();
    if unknown.is_empty() {
        return None;
    }
    let all = of_light(set).count();
    let mut finding = Finding::new(Kind::Temperature, unknown.join(", "), Done::Said);
    finding.count = unknown.len();
    Some(finding.says(format!(
        "the temperature is not given for {} of {all} dark and flat stacks: that of the camera \
         file is assumed. An odd dark current may be an odd temperature, which these captures do \
         not tell apart; add temperature_c to captures.toml",
        unknown.len(),
    )))
}
