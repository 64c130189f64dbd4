//! Faults of links and rigs are reported with exit status 2.

use crate::common;
use crate::emulator::tcp_server;
use camrig::rig::{FrameRequest, Rig};

fn words(url: &str) -> String {
    Rig::open(url).err().expect("this rig cannot be opened").to_string()
}

#[test]
fn an_older_rig_is_named_with_both_versions() {
    let said = words(&tcp_server(Some((0, 0))));
    assert!(said.contains("supports versions 0 to 0"), "{said}");
    assert!(said.contains("update the rig's firmware"), "{said}");
}

#[test]
fn a_busy_rig_says_so() {
    let url = tcp_server(None);
    let _first = Rig::open(&url).unwrap();
    let said = words(&url);
    assert!(said.contains("busy with another host"), "{said}");
}

#[test]
fn a_rig_is_free_again_when_its_host_is_gone() {
    let url = tcp_server(None);
    drop(Rig::open(&url).unwrap());
    // The server notices the end of the link in its own time.
    let again = (0..100).find_map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(20));
        Rig::open(&url).ok()
    });
    assert!(again.is_some());
}

#[test]
fn a_camera_too_wide_is_refused_with_the_limit() {
    let folder = tempfile::tempdir().unwrap();
    let mut camera = common::camera(folder.path(), 0);
    camera.sensor.width = 20_000;
    camera.sensor.height = 1;
    let cube = common::cube(&camera, common::BANDS);
    let sensor = common::sensor(&camera, &cube);
    let said = Rig::open("emulator:").unwrap().set_camera(&sensor).unwrap_err().to_string();
    assert!(said.contains("supports 16384 pixels"), "{said}");
}

/// The patterns of a frame are those of its sensor: one of another seed is none that was asked for.
#[test]
fn a_frame_of_another_sensor_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut camera = common::camera(folder.path(), 0);
    let cube = common::cube(&camera, common::BANDS);
    let mut rig = Rig::open("emulator:").unwrap();
    rig.set_camera(&common::sensor(&camera, &cube)).unwrap();
    let seed = camera.sensor.seed;
    camera.sensor.seed += 1;
    let request = FrameRequest::new(camera.settings(0, 0.02, None));
    let other = common::sensor(&camera, &cube);
    let said = rig.frame(&cube, &other, &request).map(|_| ()).unwrap_err().to_string();
    let words = format!("with seed {seed}, the camera's is {}", seed + 1);
    assert!(said.contains(&words), "{said}");
}

#[test]
fn absent_rigs_are_named_with_advice() {
    for (url, word) in [
        ("tcp://127.0.0.1:1", "no rig answers"),
        ("serial:///dev/no-such-port", "cannot open /dev/no-such-port"),
        ("hid://1209:fffe", "HID"),
        ("usb://", "not an address of a rig"),
    ] {
        let said = words(url);
        assert!(said.contains(word) && said.contains("help:"), "{url}: {said}");
    }
}
