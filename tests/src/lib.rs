//! Helpers shared by the cross-crate tests.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Clients that are Python modules rather than programs.
const PYTHON_MODULES: [&str; 5] = ["astropy", "cv2", "numpy", "rawpy", "tifffile"];

/// Finds a real client: a program on the PATH, or the Python that has a module.
///
/// `None` means the test must be skipped, and a line says so by name. With `CI=true` a missing client
/// is a failure instead, unless `CAMRIG_ALLOW_SKIP` (names separated by commas or spaces) lists it.
pub fn client(name: &str) -> Option<PathBuf> {
    let found = if PYTHON_MODULES.contains(&name) {
        let python = program("python3")?;
        let import = Command::new(&python).args(["-c", &format!("import {name}")]).output();
        import.is_ok_and(|o| o.status.success()).then_some(python)
    } else {
        program(name)
    };
    if found.is_none() {
        let allowed = std::env::var("CAMRIG_ALLOW_SKIP").unwrap_or_default();
        let allowed = allowed.split([',', ' ']).any(|a| a == name);
        let ci = std::env::var("CI").is_ok_and(|v| v == "true");
        assert!(!ci || allowed, "{name} is missing, and CAMRIG_ALLOW_SKIP does not list it");
        println!("SKIP: {name} is not installed");
    }
    found
}

fn program(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(name)).find(|p| p.is_file())
}

/// Runs a client and returns its standard output; panics with what it said when it fails.
pub fn run(program: &Path, arguments: &[&dyn AsRef<std::ffi::OsStr>]) -> Vec<u8> {
    let output = Command::new(program).args(arguments.iter().map(|a| a.as_ref())).output();
    let output = output.unwrap_or_else(|e| panic!("{}: {e}", program.display()));
    assert!(
        output.status.success(),
        "{} failed:\n{}{}",
        program.display(),
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output.stdout
}
