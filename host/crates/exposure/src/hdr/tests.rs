//! Frames of HDR sensors against the figures of `golden/hdr`.

use super::{HdrSensor, Sent};
use crate::rows::{Vector, rows};
use crate::{Arithmetic, CubeHeader, IrradianceCube, IrradianceWriter};
use camrig_base::{Bands, Plane};
use camrig_camera::hdr::Hdr;
use camrig_camera::hdr::expected::Expected;
use camrig_camera::{Camera, Change};
use camrig_firmware_sim::camera::{Capture, encode_captures};
use camrig_firmware_sim::{CaptureMemory, Memory, Rig, RowMemory, rig as device};
use camrig_rig_link::device::Model;
use camrig_rig_link::message::{Before, Codec, Exposure, FrameBegin, NumberFormat};
use camrig_rig_link::registers::Registers;
use camrig_sensor_core::arith::{Arith, BLOCK, Block, Fixed, Float};
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::effects::Effect;
use camrig_sensor_core::hdr::{Output, Readout};
use camrig_sensor_core::spectral::GROUP;
use camrig_testing::{hdr, shared};
use std::collections::HashMap;
use std::iter::successors;

fn camera(name: &str, size: [u32; 2], changes: &[Change]) -> Camera {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.toml");
    std::fs::write(&path, hdr::camera(name, size, "companded")).unwrap();
    Camera::load_with(path.to_str().unwrap(), changes).unwrap()
}

/// The rows of a table of golden/hdr, each as its columns by name.
fn golden(file: &str) -> Option<Vec<HashMap<String, String>>> {
    let mut table = csv::Reader::from_path(shared("golden/hdr")?.join(file)).unwrap();
    Some(table.deserialize().map(Result::unwrap).collect())
}

/// Photo-electrons and dark electrons of each capture.
fn electrons(hdr: &Hdr, exposure_s: f64, mu: f64) -> Vec<[f64; 2]> {
    let of = |c: &camrig_camera::hdr::Capture| {
        let photodiode = &hdr.photodiodes[c.photodiode];
        let (_, ratio) = photodiode.response.samples().next().unwrap();
        let dark = photodiode.dark_current_e_per_s * exposure_s * c.exposure_ratio;
        [mu * ratio * c.exposure_ratio, dark]
    };
    hdr.captures.iter().map(of).collect()
}

/// The codes of each capture without noise in these lights, one per pixel of a row.
fn codes<A: Vector>(camera: &Camera, exposure_s: f64, lights: &[f64]) -> Vec<Vec<u16>> {
    let hdr = camera.sensor.hdr.as_ref().unwrap();
    let header = header(camera);
    let sensor = HdrSensor::in_light(camera, &header, 1.0).unwrap();
    let of = |i: usize| {
        let mut config = sensor.captures()[i].config.clone();
        config.effects.retain(|e| matches!(e, Effect::FullWell(_)));
        let mut light = |_: u32, out: &mut [Block<A::Signal>]| {
            for (v, mu) in out.as_flattened_mut().iter_mut().zip(lights) {
                let [light, dark] = electrons(hdr, exposure_s, *mu)[i];
                // Beyond the range of charge it saturates.
                *v = A::Light::signal((light + dark) as f32);
            }
        };
        let settings = hdr.settings(&hdr.captures[i], &FrameSettings::new(exposure_s as f32));
        let mut out = vec![0; lights.len()];
        rows::<A>(&config, &settings, &mut light, 0, &mut out).unwrap();
        out
    };
    (0..hdr.captures.len()).map(of).collect()
}

fn header(camera: &Camera) -> CubeHeader {
    let size = (camera.sensor.width as usize, camera.sensor.height as usize);
    let bands = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };
    CubeHeader::new(size, &bands, "even light")
}

/// The code of a capture in f64, and how far the exact value is from the next rounding.
fn exact(hdr: &Hdr, i: usize, electrons: f64) -> (u16, f64) {
    let capture = &hdr.captures[i];
    let charge = electrons.min(hdr.well_e(capture));
    let dn = charge * capture.dn_per_e(1.0) + f64::from(capture.black_level_dn);
    let code = dn.round_ties_even().min(4095.0) as u16;
    (code, (dn - dn.floor() - 0.5).abs())
}

fn codes_without_noise<A: Vector>() {
    let Some(rows) = golden("expected_dn.csv") else { return };
    for name in hdr::CAMERAS {
        let own: Vec<_> = rows.iter().filter(|row| row["camera"] == name).collect();
        let camera = camera(name, [own.len() as u32, 1], &[]);
        let described = camera.sensor.hdr.as_ref().unwrap();
        let lights: Vec<f64> = own.iter().map(|row| row["mu_e"].parse().unwrap()).collect();
        let all = codes::<A>(&camera, hdr::exposure_s(name), &lights);
        for (x, row) in own.iter().enumerate() {
            let wanted: Vec<u16> =
                row["capture_dn"].split(' ').map(|dn| dn.parse().unwrap()).collect();
            let each = electrons(described, hdr::exposure_s(name), lights[x]);
            for (i, wanted) in wanted.iter().enumerate() {
                let (code, to_half) = exact(described, i, each[i][0] + each[i][1]);
                assert_eq!(code, *wanted, "the test's own reference");
                let off = all[i][x].abs_diff(*wanted);
                assert!(off == 0 || (off == 1 && to_half < 0.01), "{name} {row:?}: {}", all[i][x]);
            }
            let merge = &described.merge;
            assert_eq!(merge.above_black(&wanted).to_string(), row["merged"], "{name} {row:?}");
            let linear = merge.linear(&wanted);
            assert_eq!(linear.to_string(), row["linear_dn"], "{name} {row:?}");
            let code = described.companding.as_ref().unwrap().code(linear);
            assert_eq!(code.to_string(), row["companded_dn"], "{name} {row:?}");
        }
    }
}

#[test]
fn codes_without_noise_are_those_of_the_closed_form() {
    codes_without_noise::<Float>();
    codes_without_noise::<Fixed>();
}

/// What a rig's device sends of a pixel in one arithmetic, without noise: these electrons in each
/// capture.
fn sent_by_a_rig(
    sensor: &HdrSensor,
    output: Output,
    electrons: &[[f64; 2]],
    settings: &FrameSettings,
    arithmetic: NumberFormat,
) -> Vec<u16> {
    let readout = Readout { output, ..sensor.readout().clone() };
    let configs: Vec<SensorConfig> = (sensor.captures().iter().zip(&readout.ratios))
        .zip(electrons)
        .map(|((capture, ratios), [light, dark])| {
            let mut config = capture.config.clone();
            config.effects.retain(|e| matches!(e, Effect::FullWell(_)));
            // In light of 1 W m⁻² nm⁻¹ these are the electrons of the exposure.
            let per_s = (light + dark) / f64::from(ratios.settings(settings).exposure_s);
            config.response = [per_s as f32].into_iter().collect();
            config
        })
        .collect();
    let captures = configs.iter().map(|config| Capture { config, crosstalk: None });
    let mut camera = vec![0; 16_384];
    let n = encode_captures(&readout, captures, &mut camera).unwrap();

    let (mut float, mut fixed) = (vec![[0.0; BLOCK]; 8], vec![[Default::default(); BLOCK]; 8]);
    let (mut sums, mut fixed_sums) = ([[0.0; GROUP]; 4], [[0; GROUP]; 4]);
    let (mut mantissas, mut exponents) = ([0; 4 * GROUP], [0; 4]);
    let mut more = [const { CaptureMemory::EMPTY }; 3];
    let memory = Memory::new(&mut mantissas, &mut exponents, &mut [], 1)
        .with_float(RowMemory { rows: &mut float, sums: &mut sums })
        .with_fixed(RowMemory { rows: &mut fixed, sums: &mut fixed_sums })
        .with_captures(&mut more);
    let mut rig = Rig::new("test", memory);
    rig.camera_piece(0, &camera[..n]).unwrap();
    rig.camera_end().unwrap();
    let on_link = device::Sensor { captures: configs.iter().collect(), readout: Some(&readout) };
    let raw_bits = [12, 16, 20, 24].into_iter().find(|b| on_link.raw_row(*b).is_some()).unwrap();
    let raw_row = on_link.raw_row(raw_bits).unwrap();
    let begin = FrameBegin {
        transfer: 0,
        frame: 0,
        rows: 1,
        width: 1,
        bands: 1,
        codec: Codec::Bfp16,
        arithmetic,
        raw_bits,
        temperature_c: 20.0,
        before: Before::Dark,
        exposure: None,
    };
    let exposure = Exposure { exposure_s: settings.exposure_s, analog_gain: 1.0 };
    rig.begin(&begin, exposure, &Registers::new()).unwrap();
    let mut unit = [0; 33];
    // 2¹⁵ x 2⁻¹⁵ in the first of its 16 pixels.
    (unit[0], unit[2]) = (-15i8 as u8, 0x80);
    rig.units(0, 0, &unit);
    let mut packed = vec![0; raw_row.bytes(1)];
    rig.raw_row(0, &mut packed);
    let mut samples = vec![0; raw_row.rows * if raw_row.halves { 2 } else { 1 }];
    raw_row.unpack(&packed, &mut samples).unwrap();
    samples
}

/// The device of a rig, from its camera's bytes to its packed row: captures within the tolerance of
/// the golden figures, merge and curve exact.
#[test]
fn a_rig_sends_the_codes_of_the_closed_form() {
    let Some(rows) = golden("expected_dn.csv") else { return };
    for name in hdr::CAMERAS {
        let camera = camera(name, [1, 1], &[]);
        let described = camera.sensor.hdr.as_ref().unwrap();
        let sensor = HdrSensor::in_light(&camera, &header(&camera), 1.0).unwrap();
        let exposure_s = hdr::exposure_s(name);
        let settings = FrameSettings::new(exposure_s as f32);
        for row in rows.iter().filter(|row| row["camera"] == name) {
            let each = electrons(described, exposure_s, row["mu_e"].parse().unwrap());
            for arithmetic in [NumberFormat::F32, NumberFormat::Fixed] {
                let sent = |output| sent_by_a_rig(&sensor, output, &each, &settings, arithmetic);
                let codes = sent(Output::Captures);
                let wanted: Vec<u16> =
                    row["capture_dn"].split(' ').map(|dn| dn.parse().unwrap()).collect();
                for (i, (code, wanted)) in codes.iter().zip(&wanted).enumerate() {
                    let (_, to_half) = exact(described, i, each[i][0] + each[i][1]);
                    let off = code.abs_diff(*wanted);
                    assert!(off == 0 || (off == 1 && to_half < 0.01), "{name} {row:?}: {code}");
                }
                let linear = match sent(Output::Linear)[..] {
                    [whole] => u32::from(whole),
                    [upper, lower] => {
                        u32::from(upper) << (described.linear_bits() / 2) | u32::from(lower)
                    }
                    _ => panic!("one pixel"),
                };
                assert_eq!(linear, described.merge.linear(&codes), "{name} {row:?}");
                let companding = described.companding.as_ref().unwrap();
                let companded = sent(Output::Companded(companding.clone()));
                assert_eq!(companded, [companding.code(linear)], "{name} {row:?}");
                if codes == wanted {
                    assert_eq!(linear.to_string(), row["linear_dn"], "{name} {row:?}");
                    assert_eq!(companded[0].to_string(), row["companded_dn"], "{name} {row:?}");
                }
            }
        }
    }
}

/// Share of levels at which any capture has another code than in f64.
fn other_codes<A: Vector>(name: &str, levels: usize) -> f64 {
    // As many levels as a row has pixels at most, row by row.
    let camera = camera(name, [20_000, 1], &[]);
    let described = camera.sensor.hdr.as_ref().unwrap();
    let exposure_s = hdr::exposure_s(name);
    let end = Expected::new(&camera, exposure_s, 1.0).unwrap().saturation_e();
    let light = |k: usize| {
        let decades = end.log10() + 1.0;
        10f64.powf(-1.0 + decades * k as f64 / (levels - 1) as f64)
    };
    let lights: Vec<f64> = (0..levels).map(light).collect();
    let mut others = 0;
    for lights in lights.chunks(20_000) {
        let all = codes::<A>(&camera, exposure_s, lights);
        others += (0..lights.len())
            .filter(|&x| {
                let each = electrons(described, exposure_s, lights[x]);
                (0..all.len()).any(|i| {
                    let (code, _) = exact(described, i, each[i][0] + each[i][1]);
                    assert!(all[i][x].abs_diff(code) <= 1, "{name} {}", lights[x]);
                    all[i][x] != code
                })
            })
            .count();
    }
    others as f64 / levels as f64
}

#[test]
fn both_arithmetics_have_the_codes_of_f64_almost_always() {
    let Some(rows) = golden("arithmetic.csv") else { return };
    const LEVELS: usize = 200_000;
    for row in rows {
        let name = &row["camera"];
        let share = match row["arithmetic"].as_str() {
            "f32" => other_codes::<Float>(name, LEVELS),
            _ => other_codes::<Fixed>(name, LEVELS),
        };
        let wanted: f64 = row["share_of_levels_with_another_code"].parse().unwrap();
        println!("{name} {}: {share:.2e}, reference {wanted:.2e}", row["arithmetic"]);
        assert!(share <= 2.0 * wanted, "{name} {}: {share}", row["arithmetic"]);
    }
}

#[test]
fn a_ratio_that_is_off_shows_in_the_merged_signal_as_far_as_its_weight() {
    let Some(rows) = golden("handover.csv") else { return };
    for row in rows {
        let (ratio, leak) = match row["case"].as_str() {
            "red +6 %" => (1.06, 0.0),
            "blue -8 %" => (0.92, 0.0),
            "leak 0.1 % of large" => (1.0, 0.001),
            _ => (1.0, 0.0),
        };
        let mut camera = camera("split4", [1, 1], &[]);
        let described = camera.sensor.hdr.as_mut().unwrap();
        let small = ratio * 3.0 / 128.0 + leak;
        described.photodiodes[1].response = camrig_base::Spectrum::constant(small);
        let light = row["mu_e"].parse().unwrap();
        let codes = codes::<Float>(&camera, hdr::exposure_s("split4"), &[light]);
        let codes: Vec<u16> = codes.iter().map(|row| row[0]).collect();
        let merged = camera.sensor.hdr.unwrap().merge.above_black(&codes);
        assert_eq!(merged.to_string(), row["merged"], "{row:?}");
    }
}

/// What each output sends of a noisy ramp from darkness to beyond the end of the last capture, over
/// the rows of several tasks: merge and curve by their definitions of the captures' codes.
#[test]
fn what_is_sent_is_the_merge_of_the_captures_pixel_by_pixel() {
    const SIZE: [u32; 2] = [150, 70];
    for name in hdr::CAMERAS {
        let camera = camera(name, SIZE, &[]);
        let described = camera.sensor.hdr.as_ref().unwrap();
        let mut writer = IrradianceWriter::new(header(&camera)).unwrap();
        let brighter = |light: &f32| Some(1.2 * light);
        let steps: Vec<f32> = successors(Some(1e-9), brighter).take(150).collect();
        let light = |x, y| steps[(x + y) % 150];
        writer.push(&Plane::from_fn(SIZE[0] as usize, SIZE[1] as usize, light)).unwrap();
        let cube = writer.finish().unwrap();
        let settings = FrameSettings::new(hdr::exposure_s(name) as f32);
        for arithmetic in Arithmetic::ALL {
            let sent = |output| {
                let mut sensor = HdrSensor::in_light(&camera, &cube.header, 1.0).unwrap();
                sensor.readout.output = output;
                sensor.frame(&[&cube], None, &settings, arithmetic).unwrap()
            };
            let Sent::Captures(captures) = sent(Output::Captures) else { panic!("captures") };
            let companding = described.companding.as_ref().unwrap();
            let linear = (0..captures[0].data.len()).map(|i| {
                let codes: Vec<u16> = captures.iter().map(|frame| frame.data[i]).collect();
                described.merge.linear(&codes)
            });
            let linear: Vec<u32> = linear.collect();
            let codes: Vec<u16> = linear.iter().map(|&dn| companding.code(dn)).collect();
            assert!(codes.iter().max() > codes.iter().min(), "{name}");
            match sent(Output::Linear) {
                Sent::Wide(frame) => assert_eq!(frame.data, linear, "{name}"),
                Sent::Merged(frame) => {
                    let data: Vec<u32> = frame.data.into_iter().map(u32::from).collect();
                    assert_eq!(data, linear, "{name}");
                }
                Sent::Captures(_) => panic!("the merged signal"),
            }
            match sent(Output::Companded(companding.clone())) {
                Sent::Merged(frame) => assert_eq!(frame.data, codes, "{name}"),
                _ => panic!("codes"),
            }
        }
    }
}

/// A frame: the codes of its captures, and the merged signal.
struct Flat {
    captures: Vec<camrig_base::RawFrame>,
    linear: Vec<u32>,
}

/// One noisy frame of even light, µ photo-electrons in the first capture.
fn flat(camera: &Camera, exposure_s: f64, mu: f64, frame: u32) -> Flat {
    let cube = IrradianceCube::uniform(header(camera), &[1.0]).unwrap();
    let band = header(camera).spectral_bands();
    let per_s = camera.of_capture(0).unwrap().sensor.response(&band)[0][0];
    let light = mu / (per_s * exposure_s);
    let settings = FrameSettings::new(exposure_s as f32).with_frame(frame);
    let sent = |output| {
        let mut sensor = HdrSensor::in_light(camera, &cube.header, light).unwrap();
        sensor.readout.output = output;
        sensor.frame(&[&cube], None, &settings, Arithmetic::F32).unwrap()
    };
    let Sent::Captures(captures) = sent(Output::Captures) else { panic!("captures") };
    let linear = match sent(Output::Linear) {
        Sent::Wide(frame) => frame.data,
        Sent::Merged(frame) => frame.data.into_iter().map(u32::from).collect(),
        Sent::Captures(_) => panic!("the merged signal"),
    };
    Flat { captures, linear }
}

fn mean_and_deviation(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    let squares: f64 = values.map(|v| (v - mean) * (v - mean)).sum();
    (mean, (squares / (n - 1.0)).sqrt())
}

#[test]
fn merged_and_companded_frames_have_the_mean_and_noise_of_independent_draws() {
    const SIDE: u32 = 200;
    // Draws behind the golden figures over those here.
    let fewer = 1e6 / f64::from(SIDE * SIDE);
    for name in hdr::CAMERAS {
        let Some(rows) = golden(&format!("mc_{name}.csv")) else { return };
        let camera = camera(name, [SIDE, SIDE], &[]);
        let described = camera.sensor.hdr.as_ref().unwrap();
        for (frame, row) in (0..).zip(&rows) {
            let number = |column: &str| row[column].parse::<f64>().unwrap();
            let got = flat(&camera, hdr::exposure_s(name), number("mu_e"), frame);
            let near = |got: f64, column: &str, error: &str| {
                let tolerance = 5.0 * number(error) * (1.0 + fewer).sqrt();
                let off = got - number(column);
                assert!(off.abs() <= tolerance.max(1e-9), "{name} {column} {row:?}: {got}");
            };
            let pedestal = f64::from(described.merge.pedestal_dn());
            let merged = got.linear.iter().map(|&dn| f64::from(dn) - pedestal);
            let (mean, deviation) = mean_and_deviation(merged);
            // Light at which the output's end cuts the noise has other figures before the cut.
            if number("merged_mean") + 6.0 * number("merged_std") + pedestal
                < f64::from(described.merge.max_dn())
            {
                near(mean, "merged_mean", "se");
                near(deviation, "merged_std", "se_std");
            }
            let companding = described.companding.as_ref().unwrap();
            let sent = got.linear.iter().map(|&dn| f64::from(companding.code(dn)));
            near(mean_and_deviation(sent).0, "companded_mean", "se_companded");
        }
    }
}

/// Flats over more than five decades of light, and beside and between the hand-overs: the SNR of
/// the linear signal, dips included, is that of the closed form. Where a step's code scatters over
/// an end of its ramp, the closed form, which is of first order, does not hold.
#[test]
fn snr_of_flats_is_that_of_the_closed_form() {
    const SIDE: u32 = 100;
    const SIGMAS: f64 = 5.0;
    let pixels = f64::from(SIDE * SIDE);
    for name in hdr::CAMERAS {
        let camera = camera(name, [SIDE, SIDE], &[]);
        let described = camera.sensor.hdr.as_ref().unwrap();
        let exposure_s = hdr::exposure_s(name);
        let expected = Expected::new(&camera, exposure_s, 1.0).unwrap();
        let end = expected.saturation_e();
        let hand_overs = expected.hand_overs();
        let beside = |h: &camrig_camera::hdr::expected::HandOver| {
            let [low, high] = h.light_e;
            [0.8 * low, 0.5 * (low + high), 1.25 * high]
        };
        let decades = (0..24).map(|k| 0.1 * (9.0 * end).powf(f64::from(k) / 23.0));
        let lights: Vec<f64> = decades.chain(hand_overs.iter().flat_map(beside)).collect();
        assert!(lights[23] / lights[0] > 1e5, "{name}: {end}");
        // Whether the codes that decide are far from the ends of their ramps.
        let clear = |mu: f64| {
            described.merge.hands().iter().all(|hand| {
                let i = usize::from(hand.decide);
                let capture = &described.captures[i];
                let [light, dark] = electrons(described, exposure_s, mu)[i];
                let dn_per_e = capture.dn_per_e(1.0);
                let code = (light + dark) * dn_per_e + f64::from(capture.black_level_dn);
                let sigma = dn_per_e * (light + dark + capture.read_e.powi(2)).sqrt();
                let ends = [hand.low_dn, hand.high_dn].map(f64::from);
                ends.iter().all(|end| (code - end).abs() > SIGMAS * sigma)
            })
        };
        let mut seen = 0;
        for (frame, &mu) in (0..).zip(&lights).filter(|(_, mu)| clear(**mu)) {
            let got = flat(&camera, exposure_s, mu, frame);
            let pedestal = f64::from(described.merge.pedestal_dn());
            let values = got.linear.iter().map(|&dn| f64::from(dn) - pedestal);
            let (mean, deviation) = mean_and_deviation(values);
            let merged = expected.merged(mu);
            let snr = (mean - (merged.mean - merged.signal)) / deviation;
            // Of the mean, and of the deviation.
            let error = (1.0 / pixels + merged.snr().powi(2) / (2.0 * pixels)).sqrt();
            let off = (snr - merged.snr()) / error;
            assert!(off.abs() < SIGMAS, "{name} at {mu} e-: {snr}, {}, {off}", merged.snr());
            seen += 1;
        }
        assert!(seen >= 24, "{name}: {seen}");
    }
}

#[test]
fn two_gains_read_one_charge_and_two_exposures_two() {
    let Some(rows) = golden("shared_charge.csv") else { return };
    const SIDE: u32 = 400;
    for row in rows.iter().filter(|row| row["draw"] == "shared") {
        let number = |column: &str| row[column].parse::<f64>().unwrap();
        let name = &row["camera"];
        let camera = camera(name, [SIDE, SIDE], &[]);
        let got = flat(&camera, hdr::exposure_s(name), number("mu_e"), 0);
        let correlation = |a: usize, b: usize| {
            let values = |i: usize| got.captures[i].data.iter().map(|&dn| f64::from(dn));
            let ((ma, sa), (mb, sb)) =
                (mean_and_deviation(values(a)), mean_and_deviation(values(b)));
            let n = f64::from(SIDE * SIDE);
            values(a).zip(values(b)).map(|(x, y)| (x - ma) * (y - mb)).sum::<f64>()
                / (n - 1.0)
                / (sa * sb)
        };
        let fewer = (1e6 / f64::from(SIDE * SIDE) + 1.0).sqrt();
        let off = correlation(0, 1) - number("correlation_hcg_lcg");
        assert!(off.abs() < 5.0 * number("se_correlation") * fewer, "{name}: {off}");
        let dn_per_e = camera.sensor.hdr.as_ref().unwrap().captures[0].dn_per_e(1.0);
        let merged = got.linear.iter().map(|&dn| f64::from(dn) / dn_per_e);
        let variance = mean_and_deviation(merged).1.powi(2);
        let off = variance - number("variance_e2");
        assert!(off.abs() < 5.0 * number("se") * fewer, "{name}: {variance}");
    }
    let camera = camera("dol3", [SIDE, SIDE], &[]);
    let got = flat(&camera, hdr::exposure_s("dol3"), 8000.0, 0);
    let [(ml, sl), (mm, sm)] =
        [0, 1].map(|i| mean_and_deviation(got.captures[i].data.iter().map(|&dn| f64::from(dn))));
    let pairs = got.captures[0].data.iter().zip(&got.captures[1].data);
    let sum: f64 = pairs.map(|(&a, &b)| (f64::from(a) - ml) * (f64::from(b) - mm)).sum();
    let n = f64::from(SIDE * SIDE);
    assert!((sum / n / (sl * sm)).abs() < 5.0 / n.sqrt(), "two windows are two draws");
}

#[test]
fn fixed_patterns_belong_to_a_photodiode() {
    let mut camera = camera("split4", [64, 64], &[]);
    for photodiode in &mut camera.sensor.hdr.as_mut().unwrap().photodiodes {
        photodiode.prnu = 0.05;
    }
    // Light at which hcg, lcg and the small photodiode are far above their noise.
    let frames = (0..8).map(|f| flat(&camera, hdr::exposure_s("split4"), 4000.0, f));
    let frames: Vec<_> = frames.collect();
    let map = |i: usize| -> Vec<f64> {
        let pixels = 0..64 * 64;
        pixels.map(|p| frames.iter().map(|f| f64::from(f.captures[i].data[p])).sum()).collect()
    };
    let correlation = |a: &[f64], b: &[f64]| {
        let ((ma, sa), (mb, sb)) =
            (mean_and_deviation(a.iter().copied()), mean_and_deviation(b.iter().copied()));
        let sum: f64 = a.iter().zip(b).map(|(x, y)| (x - ma) * (y - mb)).sum();
        sum / (a.len() - 1) as f64 / (sa * sb)
    };
    assert!(correlation(&map(0), &map(1)) > 0.95, "two gains of one photodiode");
    assert!(correlation(&map(0), &map(2)).abs() < 0.1, "two photodiodes");
}

#[test]
fn a_sensor_of_several_captures_is_not_read_as_one() {
    let camera = camera("split4", [4, 2], &[]);
    let e = crate::SimulatedSensor::new(&camera, &header(&camera)).err().unwrap();
    assert!(e.remedy().unwrap().contains("--capture: hcg, lcg, small, very-short"));
    let overlapping = HdrSensor::in_light(&camera, &header(&camera), 1.0).unwrap();
    let cube = IrradianceCube::uniform(header(&camera), &[1.0]).unwrap();
    let long = FrameSettings::new(0.03);
    let e = overlapping.frame(&[&cube], None, &long, Arithmetic::F32).err().unwrap();
    assert!(e.to_string().contains("overlap"), "{e}");
}
