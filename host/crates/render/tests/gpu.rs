//! Frames whose blur a graphics processor has summed, beside those of the processor.

use camrig_camera::{Camera, presets};
use camrig_light::{Illuminant, LightLevel, photometry};
use camrig_optics::{Characterisation, Device, Options};
use camrig_render::SimulatedSensor;
use camrig_scene::LitScene;

#[test]
#[ignore = "needs a graphics processor: ci/tier-gpu"]
fn frames_of_a_graphics_processor_are_those_of_the_processor_within_a_dn() {
    let devices = Device::available();
    if devices.len() < 2 {
        println!("SKIP: no Vulkan device (install mesa-vulkan-drivers for one in software)");
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    Characterisation::example(17, 0.5).write(&dir.path().join("lens"), false).unwrap();
    for name in ["mt9v024-qe.csv", "ir-cut-690.csv"] {
        std::fs::write(dir.path().join(name), presets::file(name).unwrap()).unwrap();
    }
    let preset = presets::file("mt9v024.toml").unwrap();
    let (from, to) = (preset.find("[lens]").unwrap(), preset.find("[sensor]").unwrap());
    let lens = "[lens]\nkind = \"characterised\"\ndata = \"lens\"\n";
    let file = dir.path().join("c.toml");
    std::fs::write(&file, [&preset[..from], lens, &preset[to..]].concat()).unwrap();
    let camera = Camera::load(file.to_str().unwrap()).unwrap().with_size(96, 64).unwrap();

    let scene = camrig_scene::chart::open("colorchecker").unwrap().unwrap();
    let light = Illuminant::parse("D65").unwrap();
    let white =
        photometry::white_radiance(&light, LightLevel::Lux(300.0), &scene.bands()).unwrap();
    let frame = |device: Device| {
        let options = Options { device, ..Options::default() };
        let lit = LitScene { scene: &*scene, white: white.clone() };
        let (cube, report) = camrig_render::irradiance(&camera, &lit, &options).unwrap();
        assert_eq!(report.device.as_deref(), device.name());
        let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
        let settings = camera.settings(0, 0.02, None);
        sensor.frame(&cube, &settings).unwrap().data
    };
    let (cpu, gpu) = (frame(devices[0]), frame(devices[1]));
    let differences = || cpu.iter().zip(&gpu).map(|(a, b)| a.abs_diff(*b));
    println!("{} of {} pixels differ", differences().filter(|&d| d > 0).count(), cpu.len());
    // 4e-7 of the light less or more may make one electron or rounding of another, no more.
    assert!(differences().all(|d| d <= 1), "{:?}", differences().max());
    let (dark, bright) = (cpu.iter().min().unwrap(), cpu.iter().max().unwrap());
    assert!(bright - dark > 100, "a picture of something");
}
