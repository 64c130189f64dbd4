//! Electrons of a uniform scene against another simulator and the closed form.

use super::{camrig_ok, shared};
use std::path::Path;

/// The camera of `golden/isetcam/a_sensor_means.json`, except for its colour filters.
fn camera(cfa: &str, qe: &str) -> String {
    format!(
        "[lens]\nkind = \"diffraction-limited\"\nf_number = 4.0\nfocal_length_mm = 4.0\n\
         magnification = 0.003344481605351171\nrelative_illumination = \"none\"\n\
         [sensor]\nwidth = 64\nheight = 64\npitch_um = 2.2\nfill_factor = 0.8\ncfa = \"{cfa}\"\n\
         qe = {qe}\nconversion_gain_uv_per_e = 50.0\nfull_well_e = 16000\nbits = 16\n\
         black_level_dn = 400\n[sensor.noise]\nread_e = 0.0\ndark_current_e_per_s = 0.0\n\
         prnu = 0.0\nrow_fpn_e = 0.0\n"
    )
}

/// Mean electrons in 16 frames of a perfect white of 100 cd/m² under D65, 10 ms, for each channel
/// letter.
fn mean_electrons(dir: &Path) -> Vec<(char, f64)> {
    camrig_ok(
        dir,
        "simulate --camera c.toml --scene uniform:1.0 --illuminant D65 --luminance 100 \
         --exposure 10ms --frames 16 -o out --force",
    );
    let mut sums = Vec::new();
    for i in 0..16 {
        let frames = camrig::formats::read(&dir.join(format!("out/{i:04}.dng"))).unwrap();
        let frame = frames.raw(0).unwrap();
        for (c, letter) in frame.cfa.channels().into_iter().enumerate() {
            if sums.len() <= c {
                sums.push((letter, 0.0, 0.0));
            }
            for y in 0..frame.height {
                for x in (0..frame.width).filter(|&x| frame.cfa.channel(x, y) == c) {
                    sums[c].1 += f64::from(frame.data[y * frame.width + x]) - 400.0;
                    sums[c].2 += 1.0;
                }
            }
        }
    }
    sums.into_iter().map(|(l, sum, n)| (l, sum / n * 16000.0 / 65535.0)).collect()
}

/// The required tolerance is 0.5 %. Shot noise of the mean is below 0.05 %; summing D65 in bands
/// of 10 nm instead of 1 nm makes a difference below 0.1 %.
fn close(got: f64, golden: f64) {
    assert!((got / golden - 1.0).abs() < 0.005, "{got} e-, independent figure {golden} e-");
}

#[test]
fn electrons_with_a_flat_quantum_efficiency_agree_with_isetcam() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), camera("mono", "0.6")).unwrap();
    close(mean_electrons(dir.path())[0].1, 1242.199);
}

#[test]
fn electrons_of_a_bayer_sensor_agree_with_isetcam() {
    let Some(inputs) = shared("golden/isetcam/a_bayer_qe_inputs.csv") else { return };
    let dir = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(inputs).unwrap();
    let rows: Vec<(f64, String)> = text
        .lines()
        .skip(1)
        .map(|line| {
            let (nm, rest) = line.split_once(',').unwrap();
            (nm.parse().unwrap(), rest.split(',').take(3).collect::<Vec<_>>().join(","))
        })
        .collect();
    // Each of its samples, the first and the last too, stands for 10 nm.
    let (first, last) = (&rows[0], &rows[rows.len() - 1]);
    let before = (first.0 - 5.0, first.1.clone());
    let after = (last.0 + 5.0, last.1.clone());
    let mut qe = "wavelength_nm,r,g,b\n".to_string();
    for (nm, values) in std::iter::once(&before).chain(&rows).chain([&after]) {
        qe.push_str(&format!("{nm},{values}\n"));
    }
    std::fs::write(dir.path().join("qe.csv"), qe).unwrap();
    std::fs::write(dir.path().join("c.toml"), camera("GRBG", "\"qe.csv\"")).unwrap();
    let got = mean_electrons(dir.path());
    for ((letter, e), golden) in got.into_iter().zip([436.175, 435.267, 366.357]) {
        println!("{letter} {e}");
        close(e, golden);
    }
}
