//! Powers have the same bits on every system: `powi` with a positive number in the source is a
//! chain of multiplications, with a variable a call whose order of multiplication differs from
//! system to system, with a negative number one that inverts first or last. Clippy cannot tell
//! them apart (`clippy.toml` forbids the elementary functions).

use std::path::Path;

#[test]
fn powi_has_a_positive_exponent_in_the_source() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).canonicalize().unwrap();
    let mut found = Vec::new();
    ["host", "sensor-core", "rig-link"].iter().for_each(|f| search(&root.join(f), &mut found));
    assert!(found.is_empty(), "`libm::pow` or `powi(…).recip()` instead: {found:#?}");
}

fn search(folder: &Path, found: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() && !["target", "tests"].iter().any(|own| entry.ends_with(own)) {
            search(&entry, found);
        } else if entry.extension().is_some_and(|e| e == "rs") {
            let text = std::fs::read_to_string(&entry).unwrap();
            let powers = text.split(".powi(").skip(1).map(|rest| rest.split(')').next().unwrap());
            let variable = powers.filter(|e| e.parse::<u32>().is_err());
            found.extend(variable.map(|e| format!("{}: powi({e})", entry.display())));
        }
    }
}
