//! The examples of `--help`, run as a person copies them, for the commands that no chapter of the
//! guide runs. That every example parses is tested in host/cli/src/examples.rs.

use super::{camrig, camrig_ok, small_camera};
use std::path::Path;
use std::process::Command;

/// Commands whose examples need a device or minutes, and are run by other tests.
const ELSEWHERE: [&str; 5] = [
    "camrig datasheet",
    "camrig demo",
    "camrig lens import",
    "camrig rig log",
    "camrig validate paper",
];

fn help(words: &str) -> String {
    let output = camrig(Path::new("."), &format!("{words} --help"));
    String::from_utf8(output.stdout).unwrap()
}

/// The commands that do something, as they are typed.
fn commands() -> Vec<String> {
    fn add(words: &str, all: &mut Vec<String>) {
        let text = help(words);
        let Some((_, list)) = text.split_once("\nCommands:\n") else {
            all.push(format!("camrig{words}"));
            return;
        };
        let names = list.lines().take_while(|line| !line.is_empty());
        let names = names.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
        for name in
            names.filter_map(|line| line.split_whitespace().next()).filter(|n| *n != "help")
        {
            add(&format!("{words} {name}"), all);
        }
    }
    let mut all = Vec::new();
    add("", &mut all);
    all
}

/// Commands of the guide, whose chapters are run as tests.
fn guide() -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/guide");
    let chapters = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    chapters.filter(|path| path.is_file()).map(|p| std::fs::read_to_string(p).unwrap()).collect()
}

/// The files that the examples name: small ones.
fn prepare(folder: &Path) {
    std::fs::write(folder.join("my.toml"), small_camera(96, 72, &[])).unwrap();
    for name in ["dark-1", "dark-2", "dark-3"] {
        let frame = &name[5..];
        let scene = "--scene uniform:0 --exposure 10ms";
        camrig_ok(
            folder,
            &format!("simulate --camera my.toml {scene} --frame-seed {frame} -o {name}.dng"),
        );
    }
    for name in ["a", "b", "grey"] {
        camrig_ok(
            folder,
            &format!("simulate --camera my.toml --scene ramp -o {name}.dng --exposure 9ms"),
        );
    }
    camrig_ok(folder, "capture --camera my.toml --plan ptc --size 64,48 --frames 2 -o captures");
    camrig_ok(folder, "scene export colorchecker --width 64 -o envi");
    for ending in ["hdr", "img"] {
        let exported = std::fs::read_dir(folder.join("envi")).unwrap().map(|e| e.unwrap().path());
        let file = exported.filter(|p| p.extension().is_some_and(|e| e == ending)).last().unwrap();
        std::fs::copy(file, folder.join(format!("cube.{ending}"))).unwrap();
    }
    std::fs::remove_dir_all(folder.join("envi")).unwrap();
    for home in [".local/share/bash-completion/completions", ".zfunc", ".config/fish/completions"]
    {
        std::fs::create_dir_all(folder.join(home)).unwrap();
    }
    camrig_ok(folder, "scene add cube.hdr --library my-scenes --name street");
}

#[test]
fn every_example_that_no_chapter_has_runs() {
    let (folder, programs) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    prepare(folder.path());
    let program = programs.path().join("camrig");
    std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_camrig-under-test"), program).unwrap();
    let mut path = programs.path().as_os_str().to_owned();
    path.push(":");
    path.push(std::env::var_os("PATH").unwrap());
    let guide = guide();
    for command in commands() {
        if ELSEWHERE.contains(&&command[..]) || guide.contains(&format!("\n{command} ")) {
            continue;
        }
        let text = help(command.strip_prefix("camrig").unwrap());
        let (_, examples) = text.split_once("Examples:\n").unwrap_or_else(|| panic!("{command}"));
        let mut ran = 0;
        for line in examples.lines().filter_map(|line| line.strip_prefix("  camrig ")) {
            // What stands after two spaces is a remark; a chain's later programs may be absent.
            let line = line.split("  ").next().unwrap().split(" && ").next().unwrap();
            if line.contains(['|', '\\']) {
                continue;
            }
            let output = Command::new("sh")
                .args(["-ec", &format!("camrig {line}")])
                .current_dir(folder.path())
                .env("PATH", &path)
                .env("HOME", folder.path())
                .output()
                .unwrap();
            let told = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "camrig {line}\n{told}");
            ran += 1;
        }
        assert!(ran > 0, "no example of {command} was run");
    }
}
