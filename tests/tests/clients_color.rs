//! A simulated ColorChecker, developed by real raw converters and compared with the colours of its
//! reflectances. This judges colour matrices, white balance, levels and pattern together.

use camrig::RawFrame;
use camrig::camera::Camera;
use camrig::formats::{DngInfo, dng};
use camrig::light::{Illuminant, LightLevel, photometry};
use camrig::optics::Options;
use camrig::render::{self, SimulatedSensor};
use camrig::scene::chart::colorchecker;
use camrig::scene::{LitScene, Spectrum};
use camrig_tests::color::{delta_e_2000, lab, srgb_to_linear, xyz_of_srgb};
use camrig_tests::{client, png_rgb, run};
use std::path::PathBuf;

// RawTherapee refuses 192 x 144.
const WIDTH: usize = 256;
const HEIGHT: usize = 192;
const CARD: f64 = 0.8;
/// Patch 19 of the chart, white.
const WHITE: usize = 18;

type Lab = [f64; 3];

/// The chart in D65 through the preset `mt9t012` on fewer, larger pixels, without the shading of
/// the lens, because colours of a chart are judged in even light.
fn chart() -> (RawFrame, DngInfo) {
    let folder = tempfile::tempdir().unwrap();
    let presets =
        PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../host/crates/camera/presets"));
    for entry in std::fs::read_dir(&presets).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), folder.path().join(entry.file_name())).unwrap();
    }
    let text = std::fs::read_to_string(presets.join("mt9t012.toml")).unwrap();
    let text = text
        .replace("width = 2048", &format!("width = {WIDTH}"))
        .replace("height = 1536", &format!("height = {HEIGHT}"))
        .replace("pitch_um = 2.2", "pitch_um = 17.6")
        .replace("\"cos4\"", "\"none\"");
    let path = folder.path().join("camera.toml");
    std::fs::write(&path, text).unwrap();
    let camera = Camera::load(path.to_str().unwrap()).unwrap();
    let scene = camrig::scene_files::open(&format!("colorchecker:width={CARD}")).unwrap();
    let light = Illuminant::parse("D65").unwrap();
    let level = LightLevel::Lux(300.0);
    let white = photometry::white_radiance(&light, level, &scene.bands()).unwrap();
    let lit = LitScene { scene: &*scene, white };
    let (cube, _) = render::irradiance(&camera, &lit, &Options::default()).unwrap();
    let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
    let settings = camera.settings(0, 2e-3, None);
    let raw = sensor.frame(&cube, &settings).unwrap();
    let brightest = raw.data.iter().max().unwrap();
    assert!((700..1023).contains(brightest), "white near the top, nothing saturated: {brightest}");
    let info = render::dng_info(&camera, &settings, Some(&light), "colour test").unwrap();
    (raw, info)
}

/// Mean over the middle of each patch.
fn patches<T>(
    mut at: impl FnMut(usize, usize) -> T,
    mut mean: impl FnMut(Vec<T>) -> [f64; 3],
) -> Vec<[f64; 3]> {
    (0..24)
        .map(|index| {
            let [left, top, edge] = colorchecker::patch(index, CARD);

            let pixel = |t: f64, size: usize| (t * WIDTH as f64 + size as f64 / 2.0) as usize;
            let (x0, x1) = (pixel(left + 0.25 * edge, WIDTH), pixel(left + 0.75 * edge, WIDTH));
            let (y0, y1) = (pixel(top + 0.25 * edge, HEIGHT), pixel(top + 0.75 * edge, HEIGHT));
            let mut values = Vec::new();
            for y in y0..y1 {
                for x in x0..x1 {
                    values.push(at(x, y));
                }
            }
            mean(values)
        })
        .collect()
}

/// Colours of the patches' reflectances in D65: XYZ with white at Y = 1.
fn truth() -> Vec<[f64; 3]> {
    let light = Illuminant::parse("D65").unwrap().power;
    let lit = |reflectance: &Spectrum| {
        let nm: Vec<f64> = (380..=780).step_by(5).map(f64::from).collect();
        let power = nm.iter().map(|&n| light.at(n) * reflectance.at(n)).collect();
        photometry::xyz(&Spectrum::new(nm, power).unwrap())
    };
    let white = lit(&Spectrum::constant(1.0))[1];
    let table = colorchecker::reflectances();
    (0..24).map(|i| lit(&table.spectrum(i).unwrap()).map(|v| v / white)).collect()
}

/// CIE XYZ of sRGB's white.
fn d65() -> [f64; 3] {
    xyz_of_srgb([1.0; 3])
}

/// L*a*b* with the white patch scaled to its true luminance, because exposure is not judged.
fn labs(xyz: &[[f64; 3]], truth: &[[f64; 3]]) -> Vec<Lab> {
    let scale = truth[WHITE][1] / xyz[WHITE][1];
    xyz.iter().map(|v| lab(v.map(|t| t * scale), d65())).collect()
}

/// XYZ of the raw patches by the D65 matrix in the DNG itself.
fn by_matrix(raw: &RawFrame, info: &DngInfo) -> Vec<[f64; 3]> {
    let inverse = camrig::color::inverse(&info.daylight_matrix().unwrap()).unwrap();
    let at = |x: usize, y: usize| (raw.cfa.channel(x, y), f64::from(raw.data[y * WIDTH + x]));
    let mean = |values: Vec<(usize, f64)>| {
        let camera: [f64; 3] = std::array::from_fn(|channel| {
            let own: Vec<f64> = values.iter().filter(|v| v.0 == channel).map(|v| v.1).collect();
            own.iter().sum::<f64>() / own.len() as f64 - raw.black_level_dn
        });
        inverse.map(|row| row.iter().zip(camera).map(|(m, c)| m * c).sum())
    };
    patches(at, mean)
}

/// Patches of a picture of linear sRGB values; the converter may have cropped a border all round.
fn of_picture(width: usize, pixels: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let border = (WIDTH - width) / 2;
    let mean = |values: Vec<[f64; 3]>| {
        let n = values.len() as f64;
        xyz_of_srgb(std::array::from_fn(|c| values.iter().map(|v| v[c]).sum::<f64>() / n))
    };
    patches(|x, y| pixels[(y - border) * width + x - border], mean)
}

/// Mean and largest ΔE2000.
fn differences(one: &[Lab], two: &[Lab]) -> (f64, f64) {
    let all: Vec<f64> = one.iter().zip(two).map(|(a, b)| delta_e_2000(*a, *b)).collect();
    (all.iter().sum::<f64>() / 24.0, all.iter().copied().fold(0.0, f64::max))
}

#[test]
fn converters_see_the_chart_in_its_colours() {
    let (raw, info) = chart();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("chart.dng");
    std::fs::write(&path, dng::encode(&raw, &info).unwrap()).unwrap();
    let truth = truth();
    let expected = labs(&truth, &truth);
    let matrix = labs(&by_matrix(&raw, &info), &truth);
    let (model_mean, model_max) = differences(&matrix, &expected);
    println!("{:>16}: dE00 to truth mean {model_mean:.2} max {model_max:.2}", "matrix alone");
    let judge = |name: &str, xyz: Vec<[f64; 3]>, tolerance: f64| {
        let found = labs(&xyz, &truth);
        let (mean, max) = differences(&found, &expected);
        let (to_matrix, most) = differences(&found, &matrix);
        println!(
            "{name:>16}: dE00 to truth mean {mean:.2} max {max:.2}; to the matrix mean \
             {to_matrix:.2} max {most:.2}"
        );
        assert!(most < tolerance, "{name}: {most}");
    };
    // A converter differs from its matrix by its treatment of noise in demosaicing and by its
    // arithmetic, on every patch by less than the eye can just see (1).
    if let Some(dcraw) = client("dcraw") {
        let (width, pixels) = ppm(&run(&dcraw, &[&"-w", &"-4", &"-o", &"1", &"-c", &path]));
        judge("dcraw", of_picture(width, &pixels), 1.0);
    }
    if let Some(python) = client("rawpy") {
        const SCRIPT: &str = "
import sys, rawpy
r = rawpy.imread(sys.argv[1])
# LibRaw otherwise takes the brightest pixel for the white level.
a = r.postprocess(use_camera_wb=True, no_auto_bright=True, output_bps=16, gamma=(1, 1),
    adjust_maximum_thr=0.0)
sys.stdout.buffer.write(b'P6 %d %d 65535\\n' % (a.shape[1], a.shape[0]))
sys.stdout.buffer.write(a.astype('>u2').tobytes())";
        let (width, pixels) = ppm(&run(&python, &[&"-c", &SCRIPT, &path]));
        judge("LibRaw (rawpy)", of_picture(width, &pixels), 1.0);
    }
    if let Some(rawtherapee) = client("rawtherapee-cli") {
        let out = folder.path().join("out.png");
        run(&rawtherapee, &[&"-Y", &"-n", &"-b16", &"-o", &out, &"-c", &path]);
        let (width, _, pixels) = png_rgb(&out);
        let linear: Vec<_> = pixels.iter().map(|p| p.map(srgb_to_linear)).collect();
        judge("RawTherapee", of_picture(width, &linear), 1.0);
    }
}

/// A 16-bit P6 picture as values 0..=1.
fn ppm(bytes: &[u8]) -> (usize, Vec<[f64; 3]>) {
    let mut words = bytes.split(|b| b.is_ascii_whitespace());
    let mut next = || std::str::from_utf8(words.next().unwrap()).unwrap().to_string();
    assert_eq!(next(), "P6");
    let (width, height): (usize, usize) = (next().parse().unwrap(), next().parse().unwrap());
    assert_eq!((width, height, next().as_str()), (WIDTH, HEIGHT, "65535"));
    let samples = &bytes[bytes.len() - width * height * 6..];
    let value = |b: &[u8]| f64::from(u16::from_be_bytes([b[0], b[1]])) / 65535.0;
    let pixels = samples.chunks_exact(6).map(|p| [value(p), value(&p[2..]), value(&p[4..])]);
    (width, pixels.collect())
}
