//! Scenes that change in front of the console: what rows collect in time, and writers that are
//! silent or die.

use super::control::{Console, exposed};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::io::Write;

/// 64 rows of 20 µs in frames of 2000 lines, 40 ms.
const CAMERA: &str = "emulator: --camera mt9v024 --set sensor.width=96 --set sensor.height=64 \
                      --set sensor.timing.line_time_us=20 --fps 25";
const WIDTH: usize = 96;
const HEIGHT: usize = 64;

/// Mean of 1 + m cos(2π 100 t) over a row's window: frame 0 opens at 0 with 2 ms, and windows close
/// at the same phase of the lamp in all frames.
fn lamp(row: f64, exposure: f64) -> f64 {
    let close = 0.002 + 20e-6 * row;
    let x = 0.5 * TAU * 100.0 * exposure;
    1.0 + 0.5 * x.sin() / x * (TAU * 100.0 * (close - 0.5 * exposure)).cos()
}

/// Signal of the upper rows over that of the lower rows.
fn slope(told: &Value, samples: &[u16]) -> f64 {
    let black = told["frame"]["black_dn"][0].as_f64().unwrap();
    let rows = 16;
    let mean = |samples: &[u16]| {
        samples.iter().map(|dn| f64::from(*dn)).sum::<f64>() / samples.len() as f64 - black
    };
    mean(&samples[..rows * WIDTH]) / mean(&samples[(HEIGHT - rows) * WIDTH..])
}

#[test]
fn rows_collect_light_in_time_also_after_the_exposure_has_changed() {
    let dir = tempfile::tempdir().unwrap();
    let scene = "--scene uniform:0.5 --lux 2000 --lamp mains:hz=100,depth=0.5 --exposure 2ms";
    let console = Console::of(dir.path(), &format!("{CAMERA} {scene}"));
    let mut page = console.page();
    // Outer rows of the sixteen at either edge are 7.5 rows from their middle.
    let expected = |exposure| lamp(7.5, exposure) / lamp(HEIGHT as f64 - 8.5, exposure);
    for exposure in [0.002, 0.006] {
        page.set(json!({ "exposure_s": exposure }));
        // Noise of 1536 samples and of their rows' offsets stays below 1 %. On a busy machine a
        // frame may show the light before once more, made for another exposure, and says so.
        let mut found = Vec::new();
        while found.last().is_none_or(|f: &f64| (f / expected(exposure) - 1.0).abs() > 0.02) {
            let (told, samples) = page.until(|told| exposed(told, exposure, 1.0));
            found.push(slope(&told, &samples));
            assert!(found.len() < 50, "{exposure}: {found:?}, not {}", expected(exposure));
            let said = told["events"].to_string().contains("was computed for");
            assert!(!said || told["scene"]["late"] != 0, "{told}");
        }
    }
    assert!((expected(0.002) - expected(0.006)).abs() > 0.1);
}

const VIDEO: &[u8] = b"YUV4MPEG2 W16 H12 F25:1 Ip A1:1 C444\n";

/// A grey frame of video.
fn video(luma: u8) -> Vec<u8> {
    coloured(luma, 128)
}

/// A frame of video of one luma and one Cb.
fn coloured(luma: u8, blue: u8) -> Vec<u8> {
    let planes = [luma, blue, 128].map(|code| vec![code; 16 * 12]);
    [b"FRAME\n".to_vec(), planes.concat()].concat()
}

/// Before the first frame has come, the page says that it is waited for. What is told of later
/// frames stands on it once, with the number of frames.
#[test]
fn the_page_is_there_before_the_scene_and_has_the_notes_of_its_frames() {
    let dir = tempfile::tempdir().unwrap();
    let scene = "--scene - --stall 100 --lux 2000 --exposure 2ms";
    let mut console = Console::fed(dir.path(), &format!("{CAMERA} {scene}"), &[]);
    let mut page = console.page();
    let (told, _) =
        page.until(|told| told["busy"] == "waiting for the first frame of standard input");
    assert_eq!((&told["status"], &told["frames"]), (&json!("starting"), &json!(0)));
    // An order waits for the stream.
    page.set(json!({ "exposure_s": 0.004 }));
    let mut stdin = console.child.stdin.take().unwrap();
    // Blue beyond 1 from the fourth frame on: the same in three frames, another in each of four.
    let blue = [60, 60, 60, 40, 50, 70, 80].map(|luma| coloured(luma, 255)).concat();
    stdin.write_all(&[VIDEO, &video(60).repeat(3), &blue].concat()).unwrap();
    let (told, _) = page.until(|told| exposed(told, 0.004, 1.0));
    assert_eq!(told["busy"], Value::Null);
    drop(stdin);
    page.until_told("it has ended");
    let (told, _) = page.until(|_| true);
    let events = told["events"].as_array().unwrap();
    let count = |part: &str| {
        let with = |e: &&Value| e["text"].as_str().unwrap().contains(part);
        let found: Vec<&Value> = events.iter().filter(with).collect();
        assert!(found.iter().all(|e| e["error"] == false), "{found:?}");
        found.iter().map(|e| e["count"].as_u64().unwrap()).collect::<Vec<_>>()
    };
    assert_eq!(count("clipped: 192 pixels (100.00 %)"), [3, 1, 1], "{events:#?}");
    assert_eq!(count("further notes about single frames"), [2]);
    // What holds for all ten frames, and what was said of the stream.
    assert_eq!((count("sRGB is assumed"), count("a limited range")), (vec![10], vec![1]));
}

#[test]
fn a_writer_who_is_silent_or_dies_holds_up_no_frame() {
    let dir = tempfile::tempdir().unwrap();
    let begin = [VIDEO, &video(60), &video(90), &video(90)].concat();
    let scene = "--scene - --stall 100 --lux 2000 --exposure 2ms";
    let mut console = Console::fed(dir.path(), &format!("{CAMERA} {scene}"), &begin);
    let mut page = console.page();
    // Frames go on and orders are obeyed in the last light that came.
    page.until(|told| told["scene"]["late"].as_u64() > Some(5));
    page.set(json!({ "exposure_s": 0.004 }));
    let (told, _) = page.until(|told| exposed(told, 0.004, 1.0));
    assert_eq!(page.until_told("waiting for its next light")["error"], false);
    let received = told["scene"]["frames"]["received"].as_u64();
    let mut stdin = console.child.stdin.take().unwrap();
    stdin.write_all(&[video(120), video(120), video(120)].concat()).unwrap();
    page.until(|told| told["scene"]["frames"]["received"].as_u64() > received);
    page.until_told("its next light arrived after");
    // It dies within a frame.
    stdin.write_all(&video(60)[..100]).unwrap();
    drop(stdin);
    let fault = page.until_told("ends within");
    assert_eq!((&fault["error"], &fault["source"]), (&json!(true), &json!("scene")));
    page.until_told("its last light stays");
    let (told, _) = page.until(|_| true);
    let now = told["frames"].as_u64();
    page.set(json!({ "exposure_s": 0.002 }));
    page.until(|told| told["frames"].as_u64() > now.map(|n| n + 3) && exposed(told, 0.002, 1.0));
}
