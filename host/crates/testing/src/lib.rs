//! What the tests of camrig share.

pub mod browser;
pub mod hdr;

use std::path::{Path, PathBuf};

/// Test material that is not part of the repository: `place` in the folder that `CAMRIG_SHARED`
/// names, or in `shared` beside the repository. Prints that a test is skipped where it is absent.
#[must_use]
pub fn shared(place: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../shared");
    let path = std::env::var_os("CAMRIG_SHARED").map_or_else(beside, PathBuf::from).join(place);
    if path.exists() {
        return Some(path);
    }
    println!("SKIP: {} is not there", path.display());
    None
}
