//! A public collection of lenses from patents, of which `CAMRIG_PATENTS` names the folder (the
//! `lenses` of flaresim_nuke, MIT; its files stay there): every file opens or says what it lacks,
//! and focal length and back focus equal those of a paraxial trace of our own.

use camrig_lens_files::system;
use camrig_prescription::Setup;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A surface of the collection: a radius (0 for a plane) or the stop, the distance to the next,
/// n_d and V_d behind it.
struct Surface {
    radius_mm: Option<f64>,
    is_stop: bool,
    thickness_mm: f64,
    n_d: f64,
    v_d: f64,
}

/// The surfaces of a file; what is odd about it where it has something else.
fn surfaces(text: &str) -> Result<Vec<Surface>, String> {
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or("").trim());
    let lines = lines.skip_while(|line| *line != "surfaces:").skip(1).filter(|l| !l.is_empty());
    let surface = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [radius, thickness, n_d, v_d, _aperture, _coating] = words[..] else {
            return Err(format!("no plain surface: {line}"));
        };
        let number = |word: &str| word.parse::<f64>().map_err(|e| format!("{word}: {e}"));
        let is_stop = radius == "stop";
        let radius = if is_stop { 0.0 } else { number(radius)? };
        Ok(Surface {
            radius_mm: Some(radius).filter(|r| *r != 0.0),
            is_stop,
            thickness_mm: number(thickness)?,
            n_d: number(n_d)?,
            v_d: number(v_d)?,
        })
    };
    lines.map(surface).collect()
}

/// Focal length and distance from the last surface to the focus, mm, of a ray that comes in at a
/// height of 1 mm parallel to the axis.
fn paraxial(surfaces: &[Surface]) -> (f64, f64) {
    let (mut height, mut slope, mut before) = (1.0, 0.0, 1.0);
    for (i, s) in surfaces.iter().enumerate() {
        let power = s.radius_mm.map_or(0.0, |r| (s.n_d - before) / r);
        slope = (before * slope - height * power) / s.n_d;
        if i + 1 < surfaces.len() {
            height += slope * s.thickness_mm;
        }
        before = s.n_d;
    }
    (-1.0 / (slope * before), -height / slope)
}

/// The lens for OpticStudio, in the light of the d line and stopped down to f/16.
fn zmx(surfaces: &[Surface], efl_mm: f64) -> String {
    let mut out = format!(
        "UNIT MM\nENPD {:?}\nFTYP 0 0 1 1 0 0 0\nXFLN 0\nYFLN 0\nWAVM 1 0.5875618 1\nPWAV 1\nSURF 0\n  \
         TYPE STANDARD\n  CURV 0\n  DISZ INFINITY\n",
        efl_mm.abs() / 16.0
    );
    for (i, s) in surfaces.iter().enumerate() {
        let curvature = s.radius_mm.map_or(0.0, f64::recip);
        let stop = if s.is_stop { "  STOP\n" } else { "" };
        let _ = write!(out, "SURF {}\n{stop}  TYPE STANDARD\n  CURV {curvature:?}\n", i + 1);
        let _ = writeln!(out, "  DISZ {:?}", s.thickness_mm);
        if s.n_d != 1.0 {
            let _ = writeln!(out, "  GLAS ___BLANK 1 0 {:?} {:?}", s.n_d, s.v_d);
        }
    }
    let _ = write!(out, "SURF {}\n  TYPE STANDARD\n  CURV 0\n  DISZ 0\n", surfaces.len() + 1);
    out
}

fn files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
        match entry.is_dir() {
            true => files(&entry, out),
            false => {
                out.extend(Some(entry).filter(|p| p.extension().is_some_and(|e| e == "lens")))
            }
        }
    }
}

#[test]
#[ignore = "its files are fetched by hand; CAMRIG_PATENTS names their folder"]
fn lenses_of_patents_have_their_focal_lengths() {
    let Some(folder) = std::env::var_os("CAMRIG_PATENTS") else {
        println!("SKIP: CAMRIG_PATENTS does not name the folder of flaresim_nuke's lenses");
        return;
    };
    let mut all = Vec::new();
    files(Path::new(&folder), &mut all);
    all.sort();
    assert!(!all.is_empty(), "no .lens files in {}", folder.display());
    let out = tempfile::tempdir().unwrap();
    let (mut opened, mut refused) = (0, Vec::new());
    for file in &all {
        let name = file.file_stem().unwrap().to_string_lossy();
        let surfaces = match surfaces(&std::fs::read_to_string(file).unwrap()) {
            Ok(surfaces) => surfaces,
            Err(why) => {
                refused.push(format!("{name}: {why}"));
                continue;
            }
        };
        let (efl_mm, bfl_mm) = paraxial(&surfaces);
        let path = out.path().join("lens.zmx");
        std::fs::write(&path, zmx(&surfaces, efl_mm.clamp(-1e4, 1e4))).unwrap();
        match system(&Setup { file: path, ..Setup::default() }) {
            Ok(lens) => {
                opened += 1;
                for (found, right) in
                    [(lens.paraxial.efl_mm, efl_mm), (lens.paraxial.bfl_mm, bfl_mm)]
                {
                    let off = (found - right).abs() / efl_mm.abs();
                    assert!(off < 1e-6, "{name}: {found} for {right}");
                }
            }
            Err(e) => refused.push(format!("{name}: {e}")),
        }
    }
    println!("{opened} of {} opened", all.len());
    refused.iter().for_each(|why| println!("{why}"));
    assert!(opened * 10 > all.len() * 9, "{} refused", refused.len());
}
