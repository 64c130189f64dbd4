//! Runs every command of the guide as it is printed. One chapter is one session in an empty
//! folder.
//!
//! A block ```` ```sh NAME ... ```` needs the programs named and is skipped, by name, without
//! them.

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

/// Runs a chapter's blocks in order in one folder.
fn chapter(name: &str) {
    let guide = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/guide"));
    let text = std::fs::read_to_string(guide.join(name)).unwrap();
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
fn first_picture() {
    chapter("first-picture.md");
}

#[test]
fn a_camera_of_your_own() {
    chapter("camera.md");
}

#[test]
fn a_scene_from_a_camera() {
    chapter("scene.md");
}

#[test]
fn a_lens_from_a_patent() {
    chapter("lens.md");
}

#[test]
fn characterise_a_sensor() {
    chapter("sensor.md");
}

#[test]
fn diagnose() {
    chapter("diagnose.md");
}

#[test]
fn drive_a_rig() {
    chapter("rig.md");
}

#[test]
fn feed_an_isp() {
    chapter("isp.md");
}

#[test]
fn many_pictures() {
    chapter("many.md");
}

/// Every chapter is run by a test, and no link is dead.
#[test]
fn every_chapter_is_run_and_every_link_leads_somewhere() {
    let guide = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/guide"));
    let source = include_str!("guide.rs");
    for entry in std::fs::read_dir(guide).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if !name.ends_with(".md") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let run = source.contains(&format!("chapter({name:?})"));
        assert!(run || blocks(&text).is_empty(), "{name} has commands that no test runs");
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            assert!(guide.join(link).exists(), "{name} links to {link}");
        }
    }
}
