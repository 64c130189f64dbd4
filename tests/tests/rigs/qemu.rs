//! Firmware on Cortex-M boards in QEMU.

use crate::common;
use camrig::render::Arithmetic;
use camrig::rig::log::LogDecoder;
use camrig::rig::transport::ByteLink;
use camrig::rig::{Rig, Url};
use rig_link::framing::Framing;
use rig_link::host::Limits;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A QEMU that does not outlive its test. It is killed, not asked: a read of its standard input blocks it
/// wholly.
struct Board(Child);

impl Drop for Board {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The firmware for a board, or nothing and a line that says so.
fn firmware(name: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("CAMRIG_FIRMWARE") else {
        println!("SKIP: firmware in QEMU: ci/tier-qemu builds it and runs this");
        return None;
    };
    let qemu = camrig_tests::client("qemu-system-arm")?;
    drop(qemu);
    let path = Path::new(&folder).join(name);
    assert!(path.is_file(), "no firmware {}", path.display());
    Some(path)
}

fn frames_in_qemu(machine: &str, name: &str, arithmetic: Arithmetic) {
    let Some(elf) = firmware(name) else { return };
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log.bin");
    let mut child = Command::new("qemu-system-arm")
        .args(["-machine", machine, "-display", "none", "-monitor", "none", "-serial", "null"])
        .arg("-serial")
        .arg(format!("file:{}", log.display()))
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(&elf)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    let mut board = Board(child);
    // Instructions are emulated: a row may take long.
    let limits = Limits { timeout: 20_000_000, ..Limits::default() };
    let link = ByteLink::new(machine.to_string(), Framing::Cobs, limits, input, output);
    let mut rig = Rig::with_transport(Url::Emulator, Box::new(link)).unwrap();
    assert!(rig.device().firmware.starts_with("camrig rig Cortex-M"), "{:?}", rig.device());
    common::compare(&mut rig, &[arithmetic]);
    drop(rig); // Closes the board's standard input: the firmware ends.
    assert!(board.0.wait().unwrap().success());
    let mut lines = Vec::new();
    LogDecoder::open(&elf).unwrap().decode(&std::fs::read(&log).unwrap(), |line| lines.push(line));
    let log = lines.join("\n");
    println!("{machine}:\n{log}");
    assert!(lines[0].contains("is up"), "{log}");
    assert!(log.contains("frames 6"), "{log}");
    assert!(!log.contains("panic"), "{log}");
    // The stack that the frames used has room to spare.
    let (_, stack) = log.split_once("stack used: ").expect(&log);
    let figures: Vec<usize> =
        stack.split(|c: char| !c.is_ascii_digit()).filter_map(|n| n.parse().ok()).collect();
    assert!(figures[0] <= 24 * 1024 && figures[0] + 4096 <= figures[1], "{log}");
}

#[test]
fn cortex_m4f_gives_the_frames_of_the_host() {
    frames_in_qemu("mps2-an386", "rig-m4f.elf", Arithmetic::F32);
}

#[test]
fn cortex_m3_gives_the_frames_of_the_host() {
    frames_in_qemu("mps2-an385", "rig-m3.elf", Arithmetic::Fixed);
}
