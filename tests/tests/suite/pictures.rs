//! Pictures of red, green and blue, and renders, as scenes.

use super::{camrig, camrig_ok, shared};
use std::path::Path;

/// A camera without noise but that of light, so flat that a frame's mean is the scene's
/// brightness.
const CAMERA: &str = "[lens]\nkind = \"diffraction-limited\"\nf_number = 4.0\n\
    focal_length_mm = 4.0\nrelative_illumination = \"none\"\n\
    [sensor]\nwidth = 64\nheight = 48\npitch_um = 3.0\nfill_factor = 1.0\ncfa = \"RGGB\"\n\
    qe = \"qe.csv\"\nconversion_gain_uv_per_e = 50.0\nfull_well_e = 16000\nbits = 16\n\
    black_level_dn = 400\n[sensor.noise]\nread_e = 0.0\ndark_current_e_per_s = 0.0\n\
    prnu = 0.0\nrow_fpn_e = 0.0\n";
const QE: &str = "wavelength_nm,r,g,b\n400,0.05,0.1,0.45\n425,0.05,0.125,0.475\n450,0.05,0.15,0.5\n\
    475,0.05,0.275,0.375\n500,0.05,0.4,0.25\n525,0.075,0.475,0.15\n550,0.1,0.55,0.05\n\
    575,0.3,0.375,0.04\n600,0.5,0.2,0.03\n625,0.5,0.125,0.03\n650,0.5,0.05,0.03\n\
    675,0.45,0.05,0.03\n700,0.4,0.05,0.03\n";

fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), CAMERA).unwrap();
    std::fs::write(dir.path().join("qe.csv"), QE).unwrap();
    dir
}

/// Mean signal above black of R, G, B in the middle of a frame of a scene, DN; from its edges a
/// lens that sees nothing beyond the frame would lose light.
fn signal(dir: &Path, scene: &str, light: &str) -> [f64; 3] {
    camrig_ok(
        dir,
        &format!(
            "simulate --camera c.toml --scene {scene} {light} --exposure 50ms -o out.dng --force"
        ),
    );
    let frames = camrig::formats::read(&dir.join("out.dng")).unwrap();
    let frame = frames.raw(0).unwrap();
    let (mut sums, mut counts) = ([0.0; 3], [0.0; 3]);
    for y in 8..frame.height - 8 {
        for x in 8..frame.width - 8 {
            let channel = [[0, 1], [1, 2]][y % 2][x % 2];
            sums[channel] += f64::from(frame.data[y * frame.width + x]) - 400.0;
            counts[channel] += 1.0;
        }
    }
    [0, 1, 2].map(|c| sums[c] / counts[c])
}

/// Shot noise of the means is below 0.1 %; greys are flat to 0.1 %.
fn near(found: [f64; 3], expected: [f64; 3], tolerance: f64) {
    for c in 0..3 {
        let off = (found[c] / expected[c] - 1.0).abs();
        assert!(off < tolerance, "{found:?}, not {expected:?}");
    }
}

/// A PNG of one grey of 16 bits.
fn grey_png(path: &Path, code: u16) {
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), 8, 6);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let data = code.to_be_bytes().repeat(48);
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
}

/// A TIFF of one colour of 8 bits, in one strip.
fn colour_tiff(path: &Path, colour: [u8; 3]) {
    let tags: [(u16, u16, u32, u32); 8] = [
        (256, 3, 1, 8),
        (257, 3, 1, 6),
        (258, 3, 3, 8 + 2 + 8 * 12 + 4),
        (259, 3, 1, 1),
        (262, 3, 1, 2),
        (273, 4, 1, 8 + 2 + 8 * 12 + 4 + 6),
        (277, 3, 1, 3),
        (279, 4, 1, 144),
    ];
    let mut bytes = b"II\x2a\0\x08\0\0\0\x08\0".to_vec();
    for (tag, kind, count, value) in tags {
        bytes.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
        bytes.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
    }
    bytes.extend([0, 0, 0, 0, 8, 0, 8, 0, 8, 0]);
    bytes.extend(colour.repeat(48));
    std::fs::write(path, bytes).unwrap();
}

/// A Radiance picture of 8 x 6 pixels of one value.
pub fn radiance_picture(path: &Path, pixel: [u8; 4]) {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 6 +X 8\n".to_vec();
    bytes.extend(pixel.repeat(48));
    // Width 8 would announce runs by its first bytes 2, 2; these are none.
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn a_photograph_of_a_white_patch_is_as_bright_as_a_chart_of_its_reflectance() {
    let dir = folder();
    let dir = dir.path();
    // 0.9 by the curve of sRGB: 1.055 * 0.9^(1/2.4) - 0.055 = 0.954687.
    grey_png(&dir.join("white.png"), 62_565);
    for light in ["--lux 300", "--illuminant A --luminance 60"] {
        near(signal(dir, "white.png", light), signal(dir, "uniform:0.9", light), 3e-3);
    }
    // A render of it: 230.4/256 of 1, which is a white in the light.
    radiance_picture(&dir.join("white.hdr"), [230, 230, 230, 128]);
    let expected = signal(dir, "uniform:0.8984", "--lux 300");
    near(signal(dir, "white.hdr", "--lux 300"), expected, 3e-3);
    near(signal(dir, "white.hdr", "--lux 600").map(|v| v / 2.0), expected, 3e-3);
    let absolute = signal(dir, "white.hdr:scale=95.493", "");
    near(absolute, expected, 3e-3);
}

#[test]
fn pictures_of_every_kind_are_simulated() {
    let dir = folder();
    let dir = dir.path();
    let colour = [122u8, 82, 64];
    colour_tiff(&dir.join("c.tif"), colour);
    let expected = signal(dir, "c.tif", "--lux 300");
    assert!(expected[0] > 1.2 * expected[2], "a brown: {expected:?}");
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../host/crates/scene-files/tests/data");
    std::fs::copy(data.join("colour.jpg"), dir.join("c.jpg")).unwrap();
    // The JPEG is off by a code, 2 % of its light.
    near(signal(dir, "c.jpg", "--lux 300"), expected, 3e-2);
    let mut encoder = png::Encoder::new(std::fs::File::create(dir.join("c.png")).unwrap(), 8, 6);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&colour.repeat(48)).unwrap();
    near(signal(dir, "c.png", "--lux 300"), expected, 1e-9);
    // 0.1946, 0.0844 and 0.0513 as multiples of 1/1024.
    radiance_picture(&dir.join("c.hdr"), [199, 86, 53, 126]);
    near(signal(dir, "c.hdr:as=reflectance", "--lux 300"), expected, 2e-2);
    let Some(cases) = shared("cases/files/scene") else { return };
    let grey = signal(dir, "uniform:0.18", "--lux 300");
    for file in ["rgb.exr", "rgba-half.exr", "xyz.exr"] {
        let file = cases.join(file);
        near(signal(dir, &file.display().to_string(), "--lux 300"), grey, 5e-3);
    }
}

#[test]
fn what_a_picture_lacks_is_asked_for() {
    let dir = folder();
    let dir = dir.path();
    radiance_picture(&dir.join("c.hdr"), [199, 86, 53, 126]);
    let refused = |arguments: &str, words: &str| {
        let output = camrig(dir, arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert!(said.contains(words), "{arguments}: {said}");
    };
    let simulate = "simulate --camera c.toml --exposure 1ms -o out.npy --scene";
    refused(&format!("{simulate} c.hdr"), "absolute scale");
    refused(&format!("{simulate} c.hdr --illuminant A --lux 20"), "as=reflectance");
    refused(&format!("{simulate} c.hdr:primaries=ntsc --lux 20"), "rec2020");
    refused("scene add c.hdr --library l --name c", "absolute scale");
    refused("scene export c.hdr -o e", "absolute scale");
    assert!(!dir.join("out.npy").exists() && !dir.join("e").exists());
    let info = camrig_ok(dir, "scene info c.hdr:scale=50 --json");
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!((&info["width"], &info["quantity"]), (&8.into(), &"radiance".into()));
    assert!(info["understood"].to_string().contains("50 cd/m²"), "{info}");
    assert!(info["notes"].to_string().contains("linear Rec. 709"), "{info}");
    camrig_ok(dir, "scene add c.hdr:scale=50 --library l --name c");
}
