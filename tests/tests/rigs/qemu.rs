//! Firmware on Cortex-M boards in QEMU.

use crate::{captures, common};
use camrig::render::Arithmetic;
use camrig::rig::log::LogDecoder;
use camrig::rig::transport::ByteLink;
use camrig::rig::{Rig, Url};
use camrig_rig_link::framing::Framing;
use camrig_rig_link::host::Limits;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A QEMU process that ends with its test. It is killed, because it does not react to a request
/// while it waits for standard input.
struct Board(Child);

impl Drop for Board {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The firmware for a board. `None`, with a line that says so, if it was not built.
fn firmware(name: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("CAMRIG_FIRMWARE") else {
        println!("not here: ci/tier-firmware builds the firmware and runs this in QEMU");
        return None;
    };
    let qemu = camrig_tests::client("qemu-system-arm")?;
    drop(qemu);
    let path = Path::new(&folder).join(name);
    assert!(path.is_file(), "no firmware {}", path.display());
    Some(path)
}

/// A board with its link on standard input and output, and with a log.
struct Emulated {
    board: Board,
    rig: Rig,
    elf: PathBuf,
    folder: tempfile::TempDir,
}

impl Emulated {
    fn start(machine: &str, name: &str, more: &[&str]) -> Option<Self> {
        let elf = firmware(name)?;
        let folder = tempfile::tempdir().unwrap();
        let mut child = Command::new("qemu-system-arm")
            .args(["-machine", machine, "-display", "none", "-monitor", "none", "-serial", "null"])
            .arg("-serial")
            .arg(format!("file:{}", folder.path().join("log.bin").display()))
            .args(["-semihosting-config", "enable=on,target=native"])
            .args(more)
            .arg("-kernel")
            .arg(&elf)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let board = Board(child);
        // QEMU emulates every instruction, so a row may take long.
        let mut limits = Limits::default();
        limits.timeout = 20_000_000;
        let link = ByteLink::new(machine.to_string(), Framing::Cobs, limits, input, output);
        let rig = Rig::with_transport(Url::Emulator, Box::new(link)).unwrap();
        assert!(rig.device().firmware.starts_with("camrig rig Cortex-M"), "{:?}", rig.device());
        Some(Self { board, rig, elf, folder })
    }

    /// Closes the board's standard input, upon which the firmware ends, and returns its log as
    /// text.
    fn end(self) -> String {
        let Self { mut board, rig, elf, folder } = self;
        drop(rig);
        assert!(board.0.wait().unwrap().success());
        let mut log = String::new();
        let bytes = std::fs::read(folder.path().join("log.bin")).unwrap();
        LogDecoder::open(&elf).unwrap().decode(&bytes, |line| log += &(line + "\n"));
        assert!(!log.contains("panic"), "{log}");
        log
    }
}

/// The numbers that follow `label` in a log.
fn figures(log: &str, label: &str) -> Vec<usize> {
    let (_, rest) = log.split_once(label).expect(log);
    let line = rest.lines().next().unwrap_or_default();
    line.split(|c: char| !c.is_ascii_digit()).filter_map(|n| n.parse().ok()).collect()
}

fn frames_in_qemu(machine: &str, name: &str, arithmetic: Arithmetic) {
    let Some(mut emulated) = Emulated::start(machine, name, &[]) else { return };
    common::compare(&mut emulated.rig, &[arithmetic]);
    captures::compare(&mut emulated.rig, arithmetic);
    let log = emulated.end();
    println!("{machine}:\n{log}");
    assert!(log.lines().next().unwrap().contains("is up"), "{log}");
    assert!(log.contains("frames 15"), "{log}");
    println!("FIGURE {name} stack {}", figures(&log, "stack used: ")[0]);
    // With the static memory, which ci/tier-firmware bounds at 138 KiB, this stays within 192 KiB.
    let stack = figures(&log, "stack used: ");
    assert!(stack[0] <= 54 * 1024 && stack[0] < stack[1], "{log}");
}

/// Firmware of the base model gives the same frames; a camera with other effects is refused with
/// their names.
#[test]
fn firmware_of_the_base_model_gives_the_frames_of_the_host() {
    for (machine, name, arithmetic) in [
        ("mps2-an386", "rig-m4f-base.elf", Arithmetic::F32),
        ("mps2-an385", "rig-m3-base.elf", Arithmetic::Fixed),
    ] {
        let Some(mut emulated) = Emulated::start(machine, name, &[]) else { return };
        common::compare_cameras(&mut emulated.rig, &[arithmetic], 0..2);
        let folder = tempfile::tempdir().unwrap();
        let camera = common::camera(folder.path(), 2);
        let cube = common::cube(&camera, common::BANDS);
        let sensor = common::sensor(&camera, &cube);
        let said = emulated.rig.set_camera(&sensor).unwrap_err().to_string();
        assert!(
            said.contains("lacks effects of the camera: ") && said.contains("image-lag"),
            "{said}"
        );
        let log = emulated.end();
        println!("FIGURE {name} stack {}", figures(&log, "stack used: ")[0]);
        assert!(log.contains("frames 4"), "{log}");
    }
}

#[test]
fn cortex_m4f_gives_the_frames_of_the_host() {
    frames_in_qemu("mps2-an386", "rig-m4f.elf", Arithmetic::F32);
}

#[test]
fn cortex_m3_gives_the_frames_of_the_host() {
    frames_in_qemu("mps2-an385", "rig-m3.elf", Arithmetic::Fixed);
}

/// Instructions per pixel, exact and repeatable under `-icount`, in seven bands: of the unchanged
/// mt9v024 preset (every effect of the base model), and of four captures of split4, merged and
/// companded. The bounds are 1.25 times the counts of Rust 1.96 (2026-11): another compiler passes,
/// another algorithm does not.
#[test]
fn instructions_per_pixel_stay_within_bounds() {
    type Count = fn(&mut Rig, Arithmetic) -> usize;
    let (one, four): (Count, Count) = (common::count_frame, captures::count_frame);
    let m4f = ("mps2-an386", "rig-m4f-count.elf", Arithmetic::F32);
    let m3 = ("mps2-an385", "rig-m3-count.elf", Arithmetic::Fixed);
    for ((machine, name, arithmetic), row, count, [max_collect, max_compute]) in [
        (m4f, "rig-m4f-count.elf", one, [44, 2440]),
        (m3, "rig-m3-count.elf", one, [67, 3210]),
        (m4f, "four-captures-m4f", four, [342, 9020]),
        (m3, "four-captures-m3", four, [502, 12_400]),
    ] {
        let Some(mut emulated) = Emulated::start(machine, name, &["-icount", "shift=10"]) else {
            return;
        };
        let pixels = count(&mut emulated.rig, arithmetic);
        let log = emulated.end();
        let kilo = figures(&log, "kilo-instructions: ");
        let bands = common::BANDS.count;
        let collect = 1000.0 * kilo[0] as f64 / (pixels * bands) as f64;
        let compute = 1000.0 * kilo[1] as f64 / pixels as f64;
        // Packets carry little besides bands.
        let link = 1000.0 * kilo[2] as f64 / (pixels * bands) as f64;
        println!("FIGURE {row} collect {collect:.1}\nFIGURE {row} compute {compute:.0}");
        println!("FIGURE {row} link {link:.1}");
        assert!(collect <= f64::from(max_collect) && compute <= f64::from(max_compute), "{log}");
    }
}

/// A real UART, byte by byte, opened as a serial port. QEMU carries about 50 kB/s to the board and
/// stops reading while the board computes, so the packets that the host sends ahead take seconds.
#[cfg(target_os = "linux")]
#[test]
fn a_uart_carries_frames_too() {
    use std::io::{BufRead, BufReader};
    let Some(elf) = firmware("rig-m4f-uart.elf") else { return };
    let mut child = Command::new("qemu-system-arm")
        .args(["-machine", "mps2-an386", "-display", "none", "-monitor", "none", "-serial", "pty"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(&elf)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let _board = Board(child);
    let terminal = line.split_whitespace().find(|w| w.starts_with("/dev/")).expect(&line);
    let mut rig = Rig::open(&format!("serial://{terminal}")).unwrap();
    common::one_frame(&mut rig, Arithmetic::F32);
}
