//! The report of a diagnosis.

use crate::diagnose::search::{Outcome, Session};
use crate::diagnose::verdict;
use crate::report::page::Page;

/// The page.
pub fn page(session: &Session, outcome: &Outcome, improved: &str) -> String {
    let mut page = Page::new("Diagnosis");
    let found = verdict::report(session, outcome);
    page.verbatim(&serde_json::to_string_pretty(&found).unwrap_or_default());
    page.heading("Improved camera file").verbatim(improved);
    page.html()
}
