//! Runs every command of README and guide as it is printed. One page is one session in an empty
//! folder.
//!
//! Only ```` ```sh ```` blocks are run. A block ```` ```sh NAME ... ```` needs the programs named
//! and is skipped, by name, without them.

use std::path::Path;
use std::process::Command;

/// A block of commands: the programs that it needs, and its text.
type Block = (Vec<String>, String);

fn blocks(markdown: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut inside = false;
    for line in markdown.lines() {
        match line.strip_prefix("```") {
            Some(_) if inside => inside = false,
            Some(info) => {
                let mut words = info.split_whitespace();
                if words.next() == Some("sh") {
                    blocks.push((words.map(String::from).collect(), String::new()));
                    inside = true;
                }
            }
            None if inside => {
                if let Some((_, text)) = blocks.last_mut() {
                    text.push_str(line);
                    text.push('\n');
                }
            }
            None => {}
        }
    }
    blocks
}

/// The repository.
fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Runs a page's blocks in order in one folder.
fn page(name: &str) {
    let text = std::fs::read_to_string(root().join(name)).unwrap();
    let blocks = blocks(&text);
    let programs = tempfile::tempdir().unwrap();
    let program = programs.path().join("camrig");
    std::fs::hard_link(env!("CARGO_BIN_EXE_camrig-under-test"), &program)
        .or_else(|_| std::fs::copy(env!("CARGO_BIN_EXE_camrig-under-test"), &program).map(drop))
        .unwrap();
    let path = std::env::join_paths(
        std::iter::once(programs.path().to_path_buf())
            .chain(std::env::split_paths(&std::env::var_os("PATH").unwrap())),
    )
    .unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (needs, commands) in blocks {
        if needs.iter().any(|program| camrig_tests::client(program).is_none()) {
            continue;
        }
        let output = Command::new("bash")
            .args(["-euo", "pipefail", "-c", &commands])
            .current_dir(folder.path())
            .env("PATH", &path)
            .env("HOME", folder.path())
            .env_remove("XDG_CACHE_HOME")
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{name}:\n{commands}\n{told}");
        assert!(!told.contains("panicked"), "{name}:\n{commands}\n{told}");
    }
}

#[test]
fn readme() {
    page("README.md");
}

#[test]
fn first_picture() {
    page("docs/guide/first-picture.md");
}

#[test]
fn a_camera_of_your_own() {
    page("docs/guide/camera.md");
}

#[test]
fn a_scene_from_a_camera() {
    page("docs/guide/scene.md");
}

#[test]
#[ignore = "minutes: ci/full; its commands are tested in lens.rs"]
fn a_lens_from_a_patent() {
    page("docs/guide/lens.md");
}

#[test]
fn characterise_a_sensor() {
    page("docs/guide/sensor.md");
}

#[test]
fn diagnose() {
    page("docs/guide/diagnose.md");
}

#[test]
fn be_a_camera() {
    page("docs/guide/live-camera.md");
}

#[test]
fn be_a_usb_camera() {
    page("docs/guide/usb-camera.md");
}

#[test]
fn drive_a_rig() {
    page("docs/guide/rig.md");
}

#[test]
fn feed_an_isp() {
    page("docs/guide/isp.md");
}

#[test]
fn many_pictures() {
    page("docs/guide/many.md");
}

/// Every page with commands is run by a test, and no link is dead.
#[test]
fn every_page_is_run_and_every_link_leads_somewhere() {
    let source = include_str!("guide.rs");
    for folder in ["", "docs/guide"] {
        let folder = root().join(folder);
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "md") {
                continue;
            }
            let name = path.strip_prefix(root()).unwrap().display().to_string();
            let text = std::fs::read_to_string(&path).unwrap();
            let run = source.contains(&format!("page({name:?})"));
            assert!(run || blocks(&text).is_empty(), "{name} has commands that no test runs");
            for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
                let file = link.split('#').next().unwrap();
                assert!(folder.join(file).exists(), "{name} links to {link}");
            }
        }
    }
}
