//! `camrig convert` as a person runs it.

use camrig::camera::Cfa;
use camrig::formats::{DngInfo, Facts, Format, Frames, decode, read};
use camrig::{Plane, RawFrame};
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn convert(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_camrig"));
    command.current_dir(folder).arg("convert").args(arguments);
    command.output().unwrap()
}

fn ok(folder: &Path, arguments: &[&str]) {
    let output = convert(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
}

/// What it says when it ends with status 2.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = convert(folder, arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    String::from_utf8(output.stderr).unwrap()
}

/// A folder with `a.dng`, and what is in it.
fn folder() -> (tempfile::TempDir, RawFrame) {
    let raw = RawFrame {
        width: 32,
        height: 20,
        bits: 10,
        cfa: Cfa::parse("GRBG").unwrap(),
        black_level_dn: 42.0,
        white_level_dn: 1000,
        data: (0..640u32).map(|i| (i.wrapping_mul(2654435761) >> 9 & 1023) as u16).collect(),
    };
    let info = DngInfo { iso: Some(100), exposure_s: Some(0.01), ..DngInfo::default() };
    let facts = Facts { dng: Some(info), ..Facts::of(&raw) };
    let frames = Frames { facts, ..Frames::from_raw(&raw) };
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.dng"), Format::Dng.encode(&frames).unwrap()).unwrap();
    (folder, raw)
}

/// Through every format and back to DNG: the same samples, and with the facts given again where a
/// format does not carry them, the same frame.
#[test]
fn a_chain_through_every_format_is_lossless() {
    let (folder, raw) = folder();
    let path = folder.path();
    let facts = ["--bits", "10", "--cfa", "GRBG", "--black", "42", "--white", "1000"];
    let names = [
        "b.tiff",
        "c.npy",
        "d.pgm",
        "e.png",
        "f.fits",
        "g.csi2",
        "h_32x20_SGRBG10P.raw",
        "i_32x20_SGRBG10.raw",
        "j.dng",
    ];
    let mut last = "a.dng";
    for name in names {
        ok(path, &[&[last, name], &facts[..]].concat());
        assert_eq!(read(&path.join(name)).unwrap().planes[0].data, raw.data, "{name}");
        last = name;
    }
    assert_eq!(read(&path.join("j.dng")).unwrap().raw(0).unwrap(), raw);
}

/// DNG to DNG keeps every byte, metadata included.
#[test]
fn dng_to_dng_is_the_same_file() {
    let (folder, _) = folder();
    ok(folder.path(), &["a.dng", "b.dng"]);
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("a.dng") == bytes("b.dng"));
}

#[test]
fn pipes_carry_pixels_and_only_pixels() {
    let (folder, raw) = folder();
    let out = convert(folder.path(), &["a.dng", "-", "--to", "SGRBG10", "--hint"]);
    let expected: Vec<u8> = raw.data.iter().flat_map(|dn| dn.to_le_bytes()).collect();
    assert_eq!(out.stdout, expected);
    let hints = String::from_utf8(out.stderr).unwrap();
    assert!(hints.contains("-pixel_format bayer_grbg16le -video_size 32x20"), "{hints}");
    let mut child = Command::new(env!("CARGO_BIN_EXE_camrig"))
        .args(["convert", "-", "-", "--to", "npy", "--from", "SGRBG10"])
        .args(["--width", "32", "--height", "20"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    std::io::Write::write_all(&mut child.stdin.take().unwrap(), &expected).unwrap();
    let back = child.wait_with_output().unwrap().stdout;
    assert_eq!(decode(&back).unwrap().planes[0].data, raw.data);
}

#[test]
fn stride_padding_is_passed_over() {
    let (folder, _) = folder();
    let rows = [[1u16, 2, 3, 4, 99, 99], [5, 6, 7, 8, 99, 99]];
    let bytes: Vec<u8> = rows.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(folder.path().join("p_4x2_Y16.raw"), bytes).unwrap();
    ok(folder.path(), &["p_4x2_Y16.raw", "p.npy", "--stride", "12"]);
    let back = read(&folder.path().join("p.npy")).unwrap();
    assert_eq!(back.planes[0], Plane { width: 4, height: 2, data: vec![1, 2, 3, 4, 5, 6, 7, 8] });
}

#[test]
fn mistakes_are_explained_and_leave_nothing() {
    let (folder, _) = folder();
    let path = folder.path();
    let whole = std::fs::read(path.join("a.dng")).unwrap();
    std::fs::write(path.join("cut.dng"), &whole[..700]).unwrap();
    std::fs::write(path.join("noise.dat"), [7; 100]).unwrap();
    std::fs::write(path.join("there.npy"), "mine").unwrap();
    let before = std::fs::read_dir(path).unwrap().count();
    for (arguments, words) in [
        (&["missing.dng", "x.npy"][..], "No such file"),
        (&["cut.dng", "x.npy"], "truncated"),
        (&["noise.dat", "x.npy"], "not in a known raw format"),
        (&["a.dng", "x.jpg"], "no raw format"),
        (&["a.dng", "x.raw"], "NAME_640x480_SGRBG10P.raw"),
        (&["a.dng", "x_32x20_SRGGB10P.raw"], "GRBG"),
        (&["a.dng", "x_32x20_SGRBG8.raw"], "8 bits"),
        (&["a.dng", "there.npy"], "--force"),
        (&["a.dng", "no/x.npy"], "folder does not exist"),
        (&["a.dng", "-"], "--to"),
        (&["a.dng", "x.npy", "--frame", "1"], "counted from 0"),
        (&["a.dng", "x.csi2", "--virtual-channel", "4"], "virtual channel"),
        (&["there.npy", "x.dng"], "not in a known raw format"),
    ] {
        let said = refused(path, arguments);
        assert!(said.contains(words), "{arguments:?}: {said}");
    }
    assert_eq!(std::fs::read_dir(path).unwrap().count(), before);
    assert_eq!(std::fs::read(path.join("there.npy")).unwrap(), b"mine");
    if cfg!(target_os = "linux") {
        assert!(refused(path, &["a.dng", "/dev/full", "--to", "npy"]).contains("No space left"));
    }
}
