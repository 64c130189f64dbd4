//! The control loop: scripts of register writes, and the live page.

use super::{camrig, camrig_ok, small_camera};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

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

/// The live page of an emulator, with its address split into host, port and token.
struct Page {
    child: Child,
    host: String,
    token: String,
}

impl Page {
    fn open(dir: &Path) -> Self {
        let arguments =
            format!("rig view emulator: --camera mt9v024 {SMALL} --scene ramp --fps 50");
        let mut child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
            .args(arguments.split_whitespace())
            .current_dir(dir)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let (host, token) = line.trim().strip_prefix("http://").unwrap().split_once("/#").unwrap();
        assert_eq!(token.len(), 32);
        assert!(host.starts_with("127.0.0.1:"), "loopback by default: {host}");
        Self { child, host: host.to_string(), token: token.to_string() }
    }

    /// Sends a request unchanged and returns status and body.
    fn raw(&self, request: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let status = answer.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
        let body = answer.split_once("\r\n\r\n").map_or("", |(_, b)| b).to_string();
        (status, body)
    }

    fn ask(&self, method: &str, path: &str, headers: &str, body: &str) -> (u16, String) {
        let length = body.len();
        self.raw(&format!(
            "{method} {path} HTTP/1.1\r\n{headers}Content-Length: {length}\r\n\
            Connection: close\r\n\r\n{body}"
        ))
    }

    fn own(&self) -> String {
        format!("Host: {}\r\nX-Camrig-Token: {}\r\n", self.host, self.token)
    }

    fn state(&self) -> serde_json::Value {
        let (status, body) = self.ask("GET", "/api/state", &self.own(), "");
        assert_eq!(status, 200, "{body}");
        serde_json::from_str(&body).unwrap()
    }

    /// Waits for a state and returns it.
    fn until(&self, wanted: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
        let end = Instant::now() + Duration::from_secs(60);
        loop {
            let state = self.state();
            if wanted(&state) {
                return state;
            }
            assert!(Instant::now() < end, "not in a minute: {state}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn the_live_page_shows_frames_and_drives_the_control_loop() {
    let dir = tempfile::tempdir().unwrap();
    let page = Page::open(dir.path());
    let state = page.until(|s| s["frames"].as_u64() > Some(3));
    assert_eq!((state["width"].as_u64(), state["height"].as_u64()), (Some(96), Some(64)));
    assert!((state["exposure_s"].as_f64().unwrap() - 0.01).abs() < 1e-6);
    assert_eq!(state["row_profile"].as_array().unwrap().len(), 96);
    assert_eq!(state["column_profile"].as_array().unwrap().len(), 64);
    assert!(state["noise_dn"].as_f64().unwrap() > 0.0);
    let settings = "{\"exposure_s\":0.004,\"analog_gain\":2.0}";
    let (status, _) = page.ask("POST", "/api/control", &page.own(), settings);
    assert_eq!(status, 200);
    page.until(|s| {
        let near = |key: &str, v: f64| (s[key].as_f64().unwrap() - v).abs() < 1e-6;
        near("exposure_s", 0.004)
            && near("analog_gain", 2.0)
            && s["noise_frames"].as_u64() > Some(1)
    });
    for picture in ["/api/frame.png", "/api/noise.png"] {
        let (status, body) = page.ask("GET", picture, &page.own(), "");
        assert!(status == 200 && body.contains("PNG"), "{picture}: {status}");
    }
}

#[test]
fn a_hostile_page_is_turned_away() {
    let dir = tempfile::tempdir().unwrap();
    let page = Page::open(dir.path());
    page.until(|s| s["frames"].as_u64() > Some(0));
    let (host, token) = (&page.host, &page.token);
    let port = host.rsplit(':').next().unwrap();
    let order = "{\"exposure_s\":0.03}";
    let with_token = format!("X-Camrig-Token: {token}\r\n");
    for (what, headers) in [
        ("no token", format!("Host: {host}\r\n")),
        ("a wrong token", format!("Host: {host}\r\nX-Camrig-Token: {}\r\n", "0".repeat(32))),
        ("part of the token", format!("Host: {host}\r\nX-Camrig-Token: {}\r\n", &token[..31])),
        ("another origin", format!("Host: {host}\r\nOrigin: http://evil.example\r\n{with_token}")),
        ("another port", format!("Host: {host}\r\nOrigin: http://127.0.0.1:1\r\n{with_token}")),
        ("no origin of its own", format!("Host: {host}\r\nOrigin: null\r\n{with_token}")),
        (
            "two origins",
            format!(
                "Host: {host}\r\nOrigin: http://{host}\r\nOrigin: http://evil.example\r\n\
                {with_token}"
            ),
        ),
        ("a rebound name", format!("Host: evil.example:{port}\r\n{with_token}")),
        ("two hosts", format!("Host: {host}\r\nHost: evil.example\r\n{with_token}")),
        ("no host", with_token.clone()),
    ] {
        let (status, _) = page.ask("POST", "/api/control", &headers, order);
        assert!((400..404).contains(&status), "{what}: {status}");
        let (status, body) = page.ask("GET", "/api/state", &headers, "");
        assert!(
            (400..404).contains(&status) && !body.contains("frames"),
            "{what}: {status} {body}"
        );
    }
    for (method, path, body, expected) in [
        ("GET", "/api/control", "", 405),
        ("POST", "/api/state", "", 405),
        ("GET", "/../Cargo.toml", "", 404),
        ("GET", "/api/none", "", 404),
        ("POST", "/api/control", "{\"exposure_s\":-1}", 400),
        ("POST", "/api/control", "{\"exposure_s\":1e300}", 400),
        ("POST", "/api/control", "{\"fault\":1}", 400),
        ("POST", "/api/control", "", 400),
    ] {
        let (status, _) = page.ask(method, path, &page.own(), body);
        assert_eq!(status, expected, "{method} {path} {body}");
    }
    let (status, _) = page.ask("POST", "/api/control", &page.own(), &"x".repeat(5000));
    assert_eq!(status, 413);
    // No answer to a preflight request gives permission.
    let preflight = format!(
        "Host: {host}\r\nOrigin: http://evil.example\r\nAccess-Control-Request-Method: POST\r\n\
         Access-Control-Request-Headers: x-camrig-token\r\n"
    );
    assert_eq!(page.ask("OPTIONS", "/api/control", &preflight, "").0, 403);
    // None of these requests reached the rig, and it still runs.
    let state = page.until(|s| s["frames"].as_u64() > Some(5));
    assert!((state["exposure_s"].as_f64().unwrap() - 0.01).abs() < 1e-6, "{state}");
    // The page itself is served, also to its own origin.
    let (status, body) =
        page.ask("GET", "/", &format!("Host: {host}\r\nOrigin: http://{host}\r\n"), "");
    assert!(status == 200 && body.contains("camrig rig view") && !body.contains(token.as_str()));
}
