//! Glass catalogues (`.agf`) that a person puts beside a lens file, and what is told of them.

use super::{camrig_ok, lens};
use camrig::lens::{Catalogue, Conditions, System};
use std::path::Path;

/// Schott's N-BK7 with another B1 of formula 2: n² grows by the difference times λ²/(λ² − C1).
fn n_bk7(b1: f64) -> String {
    format!(
        "CC by hand\nNM N-BK7 2 517642 1.5168 64.17 0 1 0\nCD {b1} 0.00600069867 0.231792344 \
         0.0200179144 1.01046945 103.560653\nLD 0.31 2.5\n"
    )
}

/// B1 of the maker.
const SCHOTT: f64 = 1.03961212;
/// What is told of 0.003 more: at the d line n = 1.516800, n² + 0.0030531.
const TOLD: &str = "glass N-BK7 is that of schott.agf, not the built-in one of SCHOTT: n_d \
                    1.517806 instead of 1.516800 (+1.0e-3)";

/// A small frame through the lens of `camera.toml`.
const SIMULATE: &str = "simulate --camera ./camera.toml --set sensor.width=24 \
    --set sensor.height=16 --set sensor.pitch_um=80 --scene uniform:0.5 --exposure 5ms \
    --psf-tolerance 0.2 --force -o frame.npy";

/// Everything that a command prints, on one line.
fn printed(dir: &Path, arguments: &str) -> String {
    let output = camrig_ok(dir, arguments);
    let text = [output.stderr, output.stdout].concat();
    let text = String::from_utf8(text).unwrap();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Every command that traces a lens, in any of its formats, says that a catalogue replaces a
/// built-in glass; and nothing of one that has the same glass.
#[test]
fn a_catalogue_that_replaces_a_built_in_glass_is_told() {
    let folder = lens::folder();
    let dir = folder.path();
    lens::camera_with(dir, "kind = \"prescription\"\nfile = \"good.toml\"");
    let commands = [
        "lens info good.zmx",
        "lens info good.seq --json",
        "lens trace good.toml",
        "lens trace good.seq --wavelengths 550 --psf-size 32 --psf-tolerance 1 --force -o traced",
        "lens tolerance good.toml --fields 0 --lenses 2 --frequency 20 --decentre 0.01",
        "lens plot good.toml --force -o plots",
        SIMULATE,
    ];
    std::fs::write(dir.join("schott.agf"), n_bk7(SCHOTT + 0.003)).unwrap();
    for command in commands {
        let text = printed(dir, command);
        assert!(text.contains(TOLD), "camrig {command}: {text}");
    }
    std::fs::write(dir.join("schott.agf"), n_bk7(SCHOTT)).unwrap();
    for command in commands {
        let text = printed(dir, command);
        assert!(!text.contains("schott.agf"), "camrig {command}: {text}");
    }
}

/// The same of a catalogue elsewhere, on the command line and in a camera file.
#[test]
fn a_catalogue_that_is_named_is_told_too() {
    let folder = lens::folder();
    let dir = folder.path();
    std::fs::create_dir(dir.join("glass")).unwrap();
    std::fs::write(dir.join("glass/schott.agf"), n_bk7(SCHOTT + 0.003)).unwrap();
    let text = printed(dir, "lens trace good.zmx --glass-catalogue glass");
    assert!(text.contains(TOLD), "{text}");
    assert!(!printed(dir, "lens trace good.zmx").contains("schott.agf"));
    // A glass that a person defines is meant.
    let text = printed(dir, "lens trace good.zmx --glass-catalogue glass --glass N-BK7=1.52:64");
    assert!(!text.contains("schott.agf"), "{text}");
    let keys = "kind = \"prescription\"\nfile = \"good.toml\"\nglass_catalogue = \"glass\"";
    lens::camera_with(dir, keys);
    let text = printed(dir, SIMULATE);
    assert!(text.contains(TOLD), "{text}");
}

/// N-BK7 as four rows of a paper, and a plastic that is measured from 436 nm.
#[test]
fn an_index_that_is_carried_on_beyond_the_data_is_told() {
    let notes = |glass: &str, wavelengths: &str| {
        let text = format!(
            "format = \"camrig-prescription/1\"\nwavelengths_nm = {wavelengths}\n\
             fields_deg = [0.0]\n[aperture]\nf_number = 8.0\n[[surface]]\nradius_mm = 50.0\n\
             thickness_mm = 5.0\nstop = true\n{glass}[[surface]]\nradius_mm = -50.0\n\
             thickness_mm = 45.0\n"
        );
        let table = "[glass.X]\ntable_nm = [[480.0, 1.522], [587.6, 1.5168], [656.3, 1.5143]]\n";
        let text = if glass.contains('X') { text + table } else { text };
        let lens = camrig::prescription::toml::read(&text, &Catalogue::default()).unwrap();
        System::new(lens, Conditions::default()).unwrap().prescription.notes
    };
    let told = notes("glass = \"X\"\n", "[410.0, 550.0, 656.3]");
    assert_eq!(
        told,
        ["glass X is known from 480 to 656.3 nm: its index is carried on to 410 nm, and \
          uncertain there"]
    );
    assert!(notes("glass = \"X\"\n", "[480.0, 550.0, 656.3]").is_empty());
    assert!(notes("glass = \"N-BK7\"\n", "[400.0, 2300.0]").is_empty());
    assert!(notes("glass = \"N-BK7\"\n", "[550.0, 2600.0]")[0].contains("carried on to 2600 nm"));
}
