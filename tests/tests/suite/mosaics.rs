//! Mosaics of many bands: each pixel of a pattern of up to 5 x 5 has a filter of its own.

use super::bad_input::refuses;
use super::camrig_ok;
use camrig::camera::{Camera, KeptNoise};
use camrig::render::{Arithmetic, CubeHeader, FrameOptions, IrradianceCube, SimulatedSensor};
use camrig::scene::Bands;
use std::path::Path;

/// Peak and half width, nm, of the triangles that are the filters' pass bands, above a leak that is
/// the same at all wavelengths.
const PEAK: f64 = 0.5;
const HALF_WIDTH_NM: f64 = 20.0;
const LEAK: f64 = 0.2;
const PITCH_UM: f64 = 3.0;
const FULL_WELL_E: f64 = 16_000.0;
/// Planck's constant times the speed of light, J m.
const HC: f64 = 6.626_070_15e-34 * 299_792_458.0;

/// Centre of the band of a channel.
fn centre_nm(channel: usize) -> f64 {
    430.0 + 10.0 * channel as f64
}

/// A camera with a mosaic of `side` x `side` bands, named by letters in the order of its pixels.
fn camera(directory: &Path, side: usize, [width, height]: [usize; 2]) -> Camera {
    let letters: Vec<char> = ('A'..='Y').take(side * side).collect();
    let rows: Vec<String> = letters.chunks(side).map(|row| row.iter().collect()).collect();
    let mut table = String::from("wavelength_nm");
    letters.iter().for_each(|letter| table.push_str(&format!(",{}", letter.to_lowercase())));
    for nm in (390..=710).step_by(5).map(f64::from) {
        table.push_str(&format!("\n{nm}"));
        for channel in 0..letters.len() {
            let pass = 1.0 - (nm - centre_nm(channel)).abs() / HALF_WIDTH_NM;
            table.push_str(&format!(",{}", LEAK + PEAK * pass.max(0.0)));
        }
    }
    std::fs::write(directory.join("qe.csv"), table).unwrap();
    let text = format!(
        "[lens]\nkind = \"diffraction-limited\"\nf_number = 4.0\nfocal_length_mm = 4.0\n\
         relative_illumination = \"none\"\n[sensor]\nwidth = {width}\nheight = {height}\n\
         pitch_um = {PITCH_UM}\nfill_factor = 1.0\ncfa = {rows:?}\nqe = \"qe.csv\"\n\
         full_well_e = {FULL_WELL_E}\nbits = 12\nblack_level_dn = 100\nanalog_gain = 1.0\n\
         [sensor.noise]\nread_e = 3.0\ndark_current_e_per_s = 0.0\nprnu = 0.0\nrow_fpn_e = 0.0\n"
    );
    let file = directory.join("c.toml");
    std::fs::write(&file, text).unwrap();
    Camera::load(file.to_str().unwrap()).unwrap()
}

/// In even light E from 400 to 700 nm each pixel collects t E A/(hc) ∫ QE λ dλ, with the integral
/// (700² − 400²)/2 of the leak and, of a triangle, its area times the wavelength of its peak.
#[test]
fn each_pixel_of_a_mosaic_has_the_mean_of_its_band() {
    let (width, height) = (47, 33);
    let bands = Bands { start_nm: 405.0, step_nm: 10.0, count: 30 };
    let (level, exposure_s) = (5e-4f64, 0.01);
    let directory = tempfile::tempdir().unwrap();
    for side in [3, 4, 5] {
        let mut camera = camera(directory.path(), side, [width, height]);
        camera.keep_noise(KeptNoise::None);
        assert_eq!(camera.sensor.channel_names.len(), side * side);
        let header = CubeHeader::new((width, height), &bands, "");
        let cube = IrradianceCube::uniform(header, &vec![level as f32; bands.count]).unwrap();
        let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
        let settings = camera.settings(0, exposure_s, None);
        let area_m2 = PITCH_UM * PITCH_UM * 1e-12;
        let right = |pixel: usize| {
            let channel = pixel / width % side * side + pixel % width % side;
            let pass = PEAK * HALF_WIDTH_NM * centre_nm(channel);
            let integral = LEAK * (700.0 * 700.0 - 400.0 * 400.0) / 2.0 + pass;
            exposure_s * level * area_m2 / HC * 1e-9 * integral
        };
        // Irradiance has mantissas of 16 bits.
        let electrons = sensor.electrons(&cube, &settings).unwrap();
        for (pixel, got) in electrons.data.iter().enumerate() {
            let off = f64::from(*got) / right(pixel) - 1.0;
            assert!(off.abs() < 3e-5, "side {side}, pixel {pixel}: {got}, {}", right(pixel));
        }
        let dn_per_e = 4095.0 / FULL_WELL_E;
        for arithmetic in Arithmetic::ALL {
            let options = FrameOptions { arithmetic, ..FrameOptions::default() };
            let frame = sensor.frame_with(&cube, &settings, options).unwrap();
            for (pixel, got) in frame.data.iter().enumerate() {
                let dn = 100.0 + dn_per_e * right(pixel);
                assert!((f64::from(*got) - dn).abs() < 0.6, "side {side}, {pixel}: {got}, {dn}");
            }
        }
    }
}

/// Files keep the pattern or say that they cannot; photon transfer reads the gain of each channel.
#[test]
fn mosaics_are_written_read_and_measured_by_channel() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    for side in [3usize, 5] {
        let pattern = camera(directory, side, [60, 45]).sensor.cfa;
        let simulate = "simulate --camera c.toml --scene uniform:0.5 --lux 300 --exposure 5ms";
        camrig_ok(directory, &format!("{simulate} --force -o f.tiff --report page.html"));
        camrig_ok(directory, &format!("{simulate} --force -o rig.tiff --rig emulator:"));
        let [here, rig] =
            ["f.tiff", "rig.tiff"].map(|f| std::fs::read(directory.join(f)).unwrap());
        assert!(here == rig, "the same bytes from a rig");
        camrig_ok(directory, "convert f.tiff f.fits --force");
        for file in ["f.tiff", "f.fits"] {
            let frames = camrig::formats::read(&directory.join(file)).unwrap();
            assert_eq!(frames.facts.cfa.as_ref(), Some(&pattern), "{file}");
        }
        let channels = format!("{} channels in a DNG", side * side);
        refuses(directory, &format!("{simulate} -o f.dng"), &[&channels, ".tiff"]);
        refuses(directory, "convert f.tiff f.dng", &[&channels]);
        refuses(directory, "convert f.tiff f.y4m", &["colour filters"]);
        refuses(directory, "convert f.tiff f.mcap", &["colour filter pattern"]);
    }
    camera(directory, 4, [96, 96]);
    let plan = "format = \"plan/1\"\n[[stack]]\nid = \"dark\"\nrole = \"dark\"\nframes = 8\n\
                exposure_s = 0.01\n[[stack]]\nid = \"flat\"\nrole = \"flat\"\nframes = 8\n\
                exposure_s = 0.01\nfill = [0.1, 0.25, 0.4, 0.55, 0.7]\n\
                light = { wavelength_nm = 550.0 }\n";
    std::fs::write(directory.join("plan.toml"), plan).unwrap();
    camrig_ok(directory, "capture --camera c.toml --plan plan.toml -o set");
    let ptc = camrig_ok(directory, "measure ptc set --json").stdout;
    let ptc: serde_json::Value = serde_json::from_slice(&ptc).unwrap();
    let channels = ptc["channels"].as_object().unwrap();
    assert_eq!(channels.len(), 16, "{ptc}");
    let truth = 4095.0 / FULL_WELL_E;
    for (channel, figures) in channels {
        let gain = &figures["system_gain_dn_per_e"];
        let [value, error] = ["value", "std_error"].map(|key| gain[key].as_f64().unwrap());
        assert!(error < 0.05 * truth, "{channel}: {gain}");
        assert!((value - truth).abs() < 4.5 * error, "{channel}: {gain}, true {truth}");
    }
    camrig_ok(directory, "measure ptc set --report page.html --force");
    let page = std::fs::read_to_string(directory.join("page.html")).unwrap();
    assert!(('A'..='P').all(|letter| page.contains(&format!(">{letter}<"))), "no channel P");
}
