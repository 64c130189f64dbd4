//! Runs the package's tests in Python on the library as this build has made it.

use std::path::{Path, PathBuf};
use std::process::Command;

/// A folder with the package: the sources, and the library beside this test.
fn package() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("camrig");
    std::fs::create_dir(&inside).unwrap();
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/camrig");
    for entry in std::fs::read_dir(sources).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_file() {
            std::fs::copy(&entry, inside.join(entry.file_name().unwrap())).unwrap();
        }
    }
    let built = std::env::current_exe().unwrap().with_file_name(format!(
        "{}_camrig{}",
        std::env::consts::DLL_PREFIX,
        std::env::consts::DLL_SUFFIX
    ));
    let name = if cfg!(windows) { "_camrig.pyd" } else { "_camrig.abi3.so" };
    std::fs::copy(&built, inside.join(name)).unwrap();
    folder
}

fn tests() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests")
}

#[test]
fn the_package_passes_its_tests_in_python() {
    let package = package();
    let python = |arguments: &[&str]| {
        let mut command = Command::new("python3");
        command
            .args(arguments)
            .env("PYTHONPATH", package.path())
            .env("PYTHONDONTWRITEBYTECODE", "1");
        command
    };
    let has = python(&["-c", "import numpy, pytest"]).output();
    if !has.is_ok_and(|output| output.status.success()) {
        println!("SKIP: Python package: needs python3 with numpy and pytest");
        return;
    }
    let cache = package.path().join("cache");
    let output = python(&["-m", "pytest", "-q", "-p", "no:cacheprovider", "--doctest-modules"])
        .args([package.path().join("camrig"), tests()])
        .env("XDG_CACHE_HOME", cache)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}\n{}", String::from_utf8_lossy(&output.stderr));
    println!("{said}");
}
