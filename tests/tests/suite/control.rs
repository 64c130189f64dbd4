//! The control loop: scripts of register writes, and the console.

use super::{camrig, camrig_ok, small_camera};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

const SMALL: &str = "--set sensor.width=96 --set sensor.height=64";

fn stream(dir: &Path, script: &str) -> Vec<(f64, f64)> {
    std::fs::write(dir.join("script.toml"), format!("format = \"rig-script/1\"\n{script}"))
        .unwrap();
    std::fs::write(dir.join("c.toml"), small_camera(96, 64, &[])).unwrap();
    camrig_ok(
        dir,
        "simulate --camera c.toml --scene ramp --exposure 1ms -o x.npy --save-irradiance x.irr",
    );
    let output = camrig_ok(
        dir,
        "rig stream emulator: --camera c.toml --irradiance x.irr --script script.toml --frames 8 \
        --json",
    );
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let settings = told["settings"].as_array().unwrap().iter();
    settings.map(|s| (number(&s["exposure_s"]), number(&s["analog_gain"]))).collect()
}

/// A still scene on the emulator with a script's writes before frame 0.
fn scripted(registers: &str, more: &str) -> Value {
    let dir = tempfile::tempdir().unwrap();
    let script = format!("format = \"rig-script/1\"\n[[write]]\nbefore_frame = 0\n{registers}\n");
    std::fs::write(dir.path().join("s.toml"), script).unwrap();
    let command = format!(
        "rig stream emulator: --camera mt9v024 {SMALL} --scene ramp --collapse --script s.toml \
         --frames 2 --json {more}"
    );
    serde_json::from_slice(&camrig_ok(dir.path(), &command).stdout).unwrap()
}

/// 400 lines of the camera file's 20 µs, and not of the emulator's own 10 µs.
#[test]
fn the_timing_of_the_camera_file_counts_for_still_scenes() {
    let timing = "--set sensor.timing.line_time_us=20 --set sensor.timing.frame_length_lines=500";
    let told = scripted("registers = { \"0x0202\" = 400 }", timing);
    let exposure_s = told["settings"][0]["exposure_s"].as_f64().unwrap();
    assert!((exposure_s - 0.008).abs() < 1e-6, "{exposure_s}");
}

#[test]
fn frames_in_standby_are_told_as_such() {
    let told = scripted("registers = { \"0x0100\" = 0 }", "");
    assert_eq!((&told["frames_dropped"], &told["frames_in_standby"]), (&json!(2), &json!(2)));
}

#[test]
fn an_exposure_longer_than_the_frame_rate_allows_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let script = "format = \"rig-script/1\"\n[[write]]\nbefore_frame = 0\nexposure_s = 0.2\n";
    std::fs::write(dir.path().join("s.toml"), script).unwrap();
    for how in ["--exposure 200ms", "--script s.toml"] {
        let output = camrig(
            dir.path(),
            &format!(
                "rig stream emulator: --camera mt9v024 {SMALL} --scene ramp --collapse --fps 20 \
                 --frames 2 {how}"
            ),
        );
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{how}: {told}");
        assert!(told.contains("200 ms is longer than a frame at 20 frames/s, 50 ms"), "{told}");
    }
}

/// Frames until a write takes effect, from the register of the rig; 1 is the next frame.
fn delay(register: &str) -> usize {
    let output = camrig(Path::new("."), &format!("rig register emulator: {register} --json"));
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    told["value"].as_u64().unwrap_or(1) as usize
}

/// Writes before frame 3 take effect after the delays of the sensor (registers 0x3004 and 0x3006),
/// neither earlier nor later.
#[test]
fn a_script_takes_effect_with_the_delay_of_the_sensor() {
    let dir = tempfile::tempdir().unwrap();
    let settings = stream(
        dir.path(),
        "[[write]]\nbefore_frame = 0\nexposure_s = 0.005\nanalog_gain = 1.0\n\
         [[write]]\nbefore_frame = 3\nexposure_s = 0.010\nanalog_gain = 2.0\n",
    );
    let first = |changed: &dyn Fn(&(f64, f64)) -> bool| settings.iter().position(changed).unwrap();
    let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
    // A write before the first frame is in force at once.
    assert!(near(settings[0].0, 0.005) && near(settings[0].1, 1.0), "{settings:?}");
    // With a delay of 1 the write acts on the next frame to begin, which is frame 3.
    assert_eq!(first(&|s| near(s.1, 2.0)), 2 + delay("0x3006"), "{settings:?}");
    assert_eq!(first(&|s| near(s.0, 0.010)), 2 + delay("0x3004"), "{settings:?}");
}

#[test]
fn wrong_scripts_are_refused_before_the_stream() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(
        dir.path().join("s.toml"),
        "format = \"rig-script/1\"\nwrite = [{ frame = 1 }]",
    )
    .unwrap();
    let output = camrig(
        dir.path(),
        "rig stream emulator: --camera mt9v024 --scene ramp --script s.toml --frames 2",
    );
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("before_frame"));
}

/// A write that the rig refuses ends the stream: its figures are those of the frames before, and
/// no rate was kept.
#[test]
fn a_script_refused_within_the_stream_ends_it() {
    let dir = tempfile::tempdir().unwrap();
    let script = "format = \"rig-script/1\"\n[[write]]\nbefore_frame = 0\nexposure_s = 0.001\n\
                  [[write]]\nbefore_frame = 1\nregisters = { \"0x0ff0\" = 1 }\n";
    std::fs::write(dir.path().join("s.toml"), script).unwrap();
    let output = camrig(
        dir.path(),
        &format!(
            "rig stream emulator: --camera mt9v024 {SMALL} --scene ramp --collapse --fps 20 \
             --script s.toml --frames 3 --json"
        ),
    );
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("before frame 1"), "{told}");
    let figures: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&figures["frames"], &figures["pace_kept"]), (&json!(1), &Value::Null));
}

/// An exposure that the register cannot hold is none that a script can ask for.
#[test]
fn a_scripted_exposure_beyond_the_register_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let script = "format = \"rig-script/1\"\n[[write]]\nbefore_frame = 0\nexposure_s = 2\n";
    std::fs::write(dir.path().join("s.toml"), script).unwrap();
    let stream = "rig stream emulator: --camera mt9v024 --scene ramp --collapse --script s.toml \
                  --frames 1";
    let output = camrig(dir.path(), &format!("{stream} {SMALL}"));
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("65535"), "{told}");
}

/// The console of an emulator, with its address split into host, port and token.
pub(super) struct Console {
    pub(super) child: Child,
    host: String,
    token: String,
}

impl Console {
    fn open(dir: &Path) -> Self {
        Self::of(dir, &format!("emulator: --camera mt9v024 {SMALL} --scene ramp --fps 50"))
    }

    pub(super) fn of(dir: &Path, arguments: &str) -> Self {
        Self::fed(dir, arguments, &[])
    }

    /// One whose standard input begins with these bytes, as long as a pipe holds.
    pub(super) fn fed(dir: &Path, arguments: &str, input: &[u8]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
            .args(["rig", "view"])
            .args(arguments.split_whitespace())
            .current_dir(dir)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.as_mut().unwrap().write_all(input).unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let (host, token) = line.trim().strip_prefix("http://").unwrap().split_once("/#").unwrap();
        assert_eq!(token.len(), 32);
        assert!(host.starts_with("127.0.0.1:"), "loopback by default: {host}");
        Self { child, host: host.to_string(), token: token.to_string() }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream
    }

    /// Sends a request and returns status and body.
    fn ask(&self, method: &str, path: &str, headers: &str) -> (u16, String) {
        let mut stream = self.connect();
        let request = format!("{method} {path} HTTP/1.1\r\n{headers}\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let status = answer.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
        let body = answer.split_once("\r\n\r\n").map_or("", |(_, b)| b).to_string();
        (status, body)
    }

    pub(super) fn page(&self) -> Page {
        let mut request = format!("ws://{}/socket", self.host).into_client_request().unwrap();
        let protocols = format!("camrig, {}", self.token).parse().unwrap();
        request.headers_mut().insert("Sec-WebSocket-Protocol", protocols);
        let (socket, _) = tungstenite::client(request, self.connect()).unwrap();
        Page { socket, seen: 0 }
    }
}

impl Drop for Console {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A page as a browser would have it.
pub(super) struct Page {
    socket: WebSocket<TcpStream>,
    seen: u64,
}

impl Page {
    fn say(&mut self, what: Value) {
        self.socket.send(Message::text(what.to_string())).unwrap();
    }

    pub(super) fn set(&mut self, order: Value) {
        self.say(json!({ "set": order }));
    }

    /// What is next: the text, and the samples of a frame.
    fn next(&mut self) -> (Value, Vec<u16>) {
        self.say(json!({ "next": { "seen": self.seen, "event": 0, "pixels": true } }));
        let Message::Binary(bytes) = self.socket.read().unwrap() else { panic!("no frame") };
        let (length, rest) = bytes.split_first_chunk().unwrap();
        let (text, samples) = rest.split_at(u32::from_le_bytes(*length) as usize);
        let told: Value = serde_json::from_slice(text).unwrap();
        self.seen = told["frames"].as_u64().unwrap();
        (told, samples.as_chunks().0.iter().map(|dn| u16::from_le_bytes(*dn)).collect())
    }

    /// Waits for what is wanted.
    pub(super) fn until(&mut self, wanted: impl Fn(&Value) -> bool) -> (Value, Vec<u16>) {
        let end = Instant::now() + Duration::from_secs(60);
        loop {
            let (told, samples) = self.next();
            if wanted(&told) {
                return (told, samples);
            }
            assert!(Instant::now() < end, "not in a minute: {told}");
        }
    }

    /// Waits for an event whose words have `part`.
    pub(super) fn until_told(&mut self, part: &str) -> Value {
        let with = |told: &Value| {
            let events = told["events"].as_array().unwrap().clone();
            events.into_iter().find(|e| e["text"].as_str().unwrap().contains(part))
        };
        with(&self.until(|told| with(told).is_some()).0).unwrap()
    }
}

/// Whether the newest frame was exposed with these settings.
pub(super) fn exposed(told: &Value, exposure_s: f64, gain: f64) -> bool {
    let near = |key: &str, v: f64| {
        told["frame"][key].as_f64().is_some_and(|have| (have - v).abs() < 1e-6)
    };
    near("exposure_s", exposure_s) && near("analog_gain", gain)
}

#[test]
fn the_console_shows_frames_and_drives_the_control_loop() {
    let dir = tempfile::tempdir().unwrap();
    let console = Console::open(dir.path());
    let mut page = console.page();
    let (told, samples) = page.until(|t| t["frames"].as_u64() > Some(3) && t["frame"].is_object());
    assert_eq!((&told["frame"]["width"], &told["frame"]["height"]), (&json!(96), &json!(64)));
    assert_eq!(samples.len(), 96 * 64);
    assert!(exposed(&told, 0.01, 1.0), "{told}");
    let mean = |samples: &[u16]| {
        let black = told["frame"]["black_dn"][0].as_f64().unwrap();
        samples.iter().map(|&dn| f64::from(dn)).sum::<f64>() / samples.len() as f64 - black
    };
    let full = mean(&samples);
    page.set(json!({ "exposure_s": 0.004 }));
    page.set(json!({ "analog_gain": 2.0 }));
    let (_, samples) = page.until(|t| exposed(t, 0.004, 2.0));
    // Signal is proportional to exposure and gain; noise of the mean is far below.
    assert!((mean(&samples) / full / 0.8 - 1.0).abs() < 0.02, "{full} DN");
    page.set(json!({ "lux": 150.0 }));
    let dimmed =
        |t: &Value| t["frame"]["light"].as_str().is_some_and(|l| l.ends_with("at 150 lx"));
    let (_, samples) = page.until(dimmed);
    assert!((mean(&samples) / full / 0.4 - 1.0).abs() < 0.02, "{full} DN");
    page.set(json!("registers"));
    let (told, _) = page.until(|t| t["registers"].as_array().unwrap().len() > 10);
    let registers = told["registers"].as_array().unwrap();
    let gain = registers.iter().find(|r| r["address"] == 0x0204).unwrap();
    assert_eq!(gain["value"], 512);
}

#[test]
fn what_goes_wrong_is_told_to_the_page_and_the_stream_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let console = Console::open(dir.path());
    let mut page = console.page();
    page.set(json!({ "register": { "address": 0x0666, "value": 1 } }));
    assert_eq!(page.until_told("0x0666")["error"], true);
    page.set(json!({ "exposure_s": 30.0 }));
    assert_eq!(page.until_told("beyond the rig's limit")["error"], true);
    page.set(json!({ "exposure_s": 1e300 }));
    page.until_told("above 0, at most 60 s");
    page.set(json!({ "scene": "/etc/passwd" }));
    page.until_told("choose a built-in chart");
    page.set(json!({ "scene": "uniform" }));
    let even = |t: &Value| t["frame"]["light"].as_str().is_some_and(|l| l.contains("uniform"));
    page.until(even);
    page.set(json!({ "register": { "address": 0x3100, "value": 1 } }));
    let (told, _) = page.until(|t| t["dropped"] == 1);
    let now = told["frames"].as_u64();
    let (told, _) = page.until(|t| t["frames"].as_u64() > now.map(|n| n + 3));
    assert!(exposed(&told, 0.01, 1.0) && told["status"] == "streaming", "{told}");
}

/// What is saved is what the page shows, as `camrig simulate` would write it; a recording has the
/// frames that it says.
#[test]
fn frames_are_saved_and_recorded_under_names_of_their_own() {
    let dir = tempfile::tempdir().unwrap();
    let console = Console::open(dir.path());
    let mut page = console.page();
    let (told, samples) = page.until(|t| t["frame"].is_object());
    let number = told["frame"]["number"].as_u64().unwrap();
    for expected in [format!("mt9v024-{number:06}.dng"), format!("mt9v024-{number:06}-2.dng")] {
        page.say(json!("save"));
        page.seen = u64::MAX; // news of events alone, so that the frame stays the one to be saved
        page.until_told(&expected);
    }
    page.seen = 0;
    camrig_ok(dir.path(), &format!("convert mt9v024-{number:06}.dng saved.npy"));
    let saved = std::fs::read(dir.path().join("saved.npy")).unwrap();
    let bytes: Vec<u8> = samples.iter().flat_map(|dn| dn.to_le_bytes()).collect();
    assert!(saved.ends_with(&bytes), "other samples");
    page.set(json!({ "record": true }));
    page.until(|t| t["recording"]["frames"].as_u64() > Some(3));
    page.set(json!({ "record": false }));
    let said = page.until_told(" recorded: ")["text"].as_str().unwrap().to_string();
    let count: usize = said.split(' ').next().unwrap().parse().unwrap();
    camrig_ok(dir.path(), "convert mt9v024-recording.mcap recorded.npy");
    let recorded = std::fs::read(dir.path().join("recorded.npy")).unwrap();
    let shape = format!("({count}, 64, 96)");
    assert!(String::from_utf8_lossy(&recorded[..128]).contains(&shape), "{said}");
}

/// The rig goes and comes back; the console waits for it.
#[test]
fn a_rig_that_is_unplugged_is_opened_again() {
    let dir = tempfile::tempdir().unwrap();
    let serve = |address: &str| {
        let mut child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
            .args(["rig", "serve", "--tcp", address])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        (child, line.trim().to_string())
    };
    let (mut rig, address) = serve("127.0.0.1:0");
    let arguments = format!("{address} --camera mt9v024 {SMALL} --scene ramp --fps 50");
    let console = Console::of(dir.path(), &arguments);
    let mut page = console.page();
    page.set(json!({ "analog_gain": 2.0 }));
    page.until(|t| exposed(t, 0.01, 2.0));
    rig.kill().unwrap();
    rig.wait().unwrap();
    page.until(|t| t["status"] == "reconnecting");
    assert_eq!(page.until_told("")["error"], true);
    let (mut rig, _) = serve(address.trim_start_matches("tcp://"));
    // With the settings that it had.
    let (told, _) = page.until(|t| t["status"] == "streaming" && t["frame"].is_object());
    let after = told["frames"].as_u64();
    page.until(|t| t["frames"].as_u64() > after.map(|n| n + 5) && exposed(t, 0.01, 2.0));
    rig.kill().unwrap();
    rig.wait().unwrap();
}

#[test]
fn a_hostile_page_is_turned_away() {
    let dir = tempfile::tempdir().unwrap();
    let console = Console::open(dir.path());
    let mut page = console.page();
    page.until(|t| t["frames"].as_u64() > Some(0));
    let (host, token) = (&console.host, &console.token);
    let port = host.rsplit(':').next().unwrap();
    let upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
        Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    let with = |token: &str| format!("{upgrade}Sec-WebSocket-Protocol: camrig, {token}\r\n");
    let own = with(token);
    for (what, headers) in [
        ("no token", format!("Host: {host}\r\n{upgrade}Sec-WebSocket-Protocol: camrig\r\n")),
        ("a wrong token", format!("Host: {host}\r\n{}", with(&"0".repeat(32)))),
        ("part of the token", format!("Host: {host}\r\n{}", with(&token[..31]))),
        ("another origin", format!("Host: {host}\r\nOrigin: http://evil.example\r\n{own}")),
        ("another port", format!("Host: {host}\r\nOrigin: http://127.0.0.1:1\r\n{own}")),
        ("no origin of its own", format!("Host: {host}\r\nOrigin: null\r\n{own}")),
        (
            "two origins",
            format!(
                "Host: {host}\r\nOrigin: http://{host}\r\nOrigin: http://evil.example\r\n{own}"
            ),
        ),
        ("a rebound name", format!("Host: evil.example:{port}\r\n{own}")),
        ("two hosts", format!("Host: {host}\r\nHost: evil.example\r\n{own}")),
        ("no host", own.clone()),
    ] {
        let (status, body) = console.ask("GET", "/socket", &headers);
        assert!(status == 403 && !body.contains(token.as_str()), "{what}: {status} {body}");
    }
    for (method, path, expected) in [
        ("POST", "/", 405),
        ("OPTIONS", "/", 405),
        ("POST", "/socket", 403),
        ("GET", "/../Cargo.toml", 404),
        ("GET", "/none", 404),
    ] {
        let (status, _) = console.ask(method, path, &format!("Host: {host}\r\n"));
        assert_eq!(status, expected, "{method} {path}");
    }
    // None of these requests reached the rig, and it still runs.
    let now = page.seen;
    let (told, _) = page.until(|t| t["frames"].as_u64() > Some(now + 5) && t["frame"].is_object());
    assert!(exposed(&told, 0.01, 1.0), "{told}");
    // The page itself is served, also to its own origin.
    let (status, body) =
        console.ask("GET", "/", &format!("Host: {host}\r\nOrigin: http://{host}\r\n"));
    assert!(status == 200 && body.contains("camrig console") && !body.contains(token.as_str()));
}
