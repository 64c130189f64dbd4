//! The files that the scripts in `contrib/lens-programs` leave, in the layout of each program, come
//! back as the lens that wrote them.

use camrig_lens::characterise::{self, Plan, PsfMethod};
use camrig_lens::{Catalogue, Conditions, System};
use camrig_lens_files::import;
use camrig_optics::Characterisation;
use camrig_prescription::toml;
use std::fmt::Write as _;
use std::path::Path;

const SINGLET: &str = r#"format = "camrig-prescription/1"
wavelengths_nm = [486.1, 587.6, 656.3]
fields_deg = [0.0, 12.0]
[aperture]
f_number = 6.0
[[surface]]
radius_mm = 9.0
thickness_mm = 2.0
glass = "N-BK7"
[[surface]]
radius_mm = -40.0
thickness_mm = 1.0
[[surface]]
thickness_mm = 12.5
stop = true
"#;

const HEIGHTS: usize = 4;
const PSF_SIZE: usize = 64;
const PSF_SPACING_UM: f64 = 1.5;

/// The lens as our own tracer characterises it.
fn traced() -> (System, Characterisation) {
    let lens = toml::read(SINGLET, &Catalogue::default()).unwrap();
    let system = System::new(lens, Conditions::default()).unwrap();
    let plan = Plan {
        heights: HEIGHTS,
        density: None,
        max_field_deg: 12.0,
        wavelengths_nm: vec![486.1, 587.6, 656.3],
        psf_size: PSF_SIZE,
        psf_spacing_um: Some(PSF_SPACING_UM),
        method: PsfMethod::Auto,
    };
    let lens = characterise::characterise(&system, &plan, &|_, _| ()).unwrap();
    (system, lens)
}

/// `ISETPARMS.TXT` and the tables, with the names that the scripts give them.
fn write_tables(folder: &Path, lens: &Characterisation) {
    let parameters = format!(
        "lensFile='singlet.zmx';\npsfSize={};\npsfSpacing={:.9};\nwave={};\nimgHeightNum={};\n\
         imgHeightMax={:.9};\nobjDist=10000000000;\nmag=0;\nbaseLensFileName='singlet';\n\
         refWave=587.6;\nfov=12;\nefl={:.9};\nfnumber_eff=6;\nfnumber={:.9};\n",
        PSF_SIZE,
        PSF_SPACING_UM * 1e-3,
        "[486.1 587.6 656.3]",
        HEIGHTS,
        lens.heights_mm[3],
        lens.efl_mm,
        lens.f_number,
    );
    std::fs::write(folder.join("ISETPARMS.TXT"), parameters).unwrap();
    let angles = lens.chief_ray_angle_deg.as_ref().unwrap();
    let radians: Vec<f64> = angles.iter().map(|v| v.to_radians()).collect();
    for (kind, values) in
        [("DI", &lens.real_height_mm), ("RI", &lens.relative_illumination), ("CRA", &radians)]
    {
        let rows = values.chunks(3).map(|row| {
            let words: Vec<String> = row.iter().map(|v| format!("{v:.8E}")).collect();
            words.join(" ") + "\n"
        });
        let text: String = rows.collect();
        std::fs::write(folder.join(format!("singlet_{kind}_.dat")), text).unwrap();
    }
}

/// A Huygens listing as OpticStudio writes it: UTF-16 with CR LF, rows from +y down, image at −y,
/// four digits, normalised to the Strehl ratio.
fn opticstudio_listing(samples: &[f32], nm: f64, image_y: f64, deg: f64) -> Vec<u8> {
    let size = PSF_SIZE;
    let peak = samples.iter().copied().fold(0.0, f32::max);
    let mut text = format!(
        "Listing of Huygens PSF Data\r\n\r\nFile : C:\\singlet.zmx\r\nTitle: \r\nDate : 1\r\n\r\n\
         \r\nHuygens PSF\r\n{:.4} µm at {:.4} (deg).\r\nData spacing is {:.3} µm.\r\n\
         Data area is 96.000 by 96.000 µm.\r\nStrehl ratio: 0.500\r\nPupil grid size: 128 by 128\
         \r\nImage grid size: {size} by {size}\r\nCenter point is: {}, {}\r\n\
         Center coordinates  :   0.00000000E+00,  {:.8E} Millimeters\r\n\
         Values are not normalized to peak = 1.0.\r\n\r\n",
        nm * 1e-3,
        -deg,
        PSF_SPACING_UM,
        size / 2 + 1,
        size / 2 + 1,
        -image_y,
    );
    for row in samples.chunks(size) {
        let words: Vec<String> = row.iter().map(|v| format!("{:.3E}", 0.5 * v / peak)).collect();
        let _ = write!(text, "{}\r\n", words.join("\t"));
    }
    std::iter::once(0xfeff).chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect()
}

/// A grid of numbers as CODE V's BUF EXP writes it; 100 is the peak of a perfect lens.
fn codev_grid(samples: &[f32]) -> Vec<u8> {
    let peak = samples.iter().copied().fold(0.0, f32::max);
    let rows = samples.chunks(PSF_SIZE).map(|row| {
        let words: Vec<String> = row.iter().map(|v| format!("{:12.6}", 50.0 * v / peak)).collect();
        words.join(" ") + "\r\n"
    });
    rows.collect::<String>().into_bytes()
}

fn same(found: &Characterisation, expected: &Characterisation, psf_digits: f64) {
    let near = |a: &[f64], b: &[f64], part: f64| {
        assert_eq!(a.len(), b.len());
        assert!(
            a.iter().zip(b).all(|(a, b)| (a - b).abs() <= part * b.abs() + 1e-9),
            "{a:?} {b:?}"
        );
    };
    near(&found.heights_mm, &expected.heights_mm, 1e-8);
    near(&found.wavelengths_nm, &expected.wavelengths_nm, 0.0);
    near(&found.real_height_mm, &expected.real_height_mm, 1e-8);
    near(&found.relative_illumination, &expected.relative_illumination, 1e-8);
    let angles = |lens: &Characterisation| lens.chief_ray_angle_deg.clone().unwrap();
    near(&angles(found), &angles(expected), 1e-8);
    assert!((found.efl_mm - expected.efl_mm).abs() < 1e-8);
    assert!((found.f_number - expected.f_number).abs() < 1e-8);
    assert_eq!(found.psf.spacing_um, expected.psf.spacing_um);
    for h in 0..4 {
        for w in 0..3 {
            let (a, b) = (found.psf.psf(h, w), expected.psf.psf(h, w));
            let peak = b.iter().copied().fold(0.0, f32::max);
            for (a, b) in a.iter().zip(b) {
                assert!(f64::from((a - b).abs()) < psf_digits * f64::from(peak), "{h} {w}");
            }
        }
    }
}

#[test]
fn what_the_scripts_leave_is_the_lens_that_wrote_it() {
    let (system, lens) = traced();
    for (opticstudio, digits) in [(true, 1e-3), (false, 1e-5)] {
        let folder = tempfile::tempdir().unwrap();
        write_tables(folder.path(), &lens);
        for h in 0..4 {
            let deg = system.field_of_paraxial_height(lens.heights_mm[h]);
            for (w, nm) in lens.wavelengths_nm.iter().enumerate() {
                let samples = lens.psf.psf(h, w);
                let (name, bytes) = match opticstudio {
                    true => (
                        format!("singlet_2D_PSF_Fld{}_Wave{}.dat", h + 1, w + 1),
                        opticstudio_listing(samples, *nm, lens.real_height_mm[3 * h + w], deg),
                    ),
                    false => (format!("singlet_PSF_{}_{}.dat", h + 1, w + 1), codev_grid(samples)),
                };
                std::fs::write(folder.path().join(name), bytes).unwrap();
            }
        }
        same(&import::import(folder.path()).unwrap(), &lens, digits);
    }
}
