//! What is peculiar to graphics processors. That they blur as they should, the tests of the engine
//! see, which run on every device.

use super::super::varying::tests::{noise, rows_of};
use super::super::varying::{Kernels, Tiling};
use super::super::{Device, DeviceChoice};
use super::*;
use camrig_base::Plane;

/// A graphics processor of the test's own.
fn own() -> Option<&'static Gpu> {
    if Device::available().len() < 2 {
        println!("SKIP: no Vulkan device (install mesa-vulkan-drivers for one in software)");
        return None;
    }
    Some(Box::leak(Box::new(Gpu::find(|_| true).unwrap())))
}

struct Example {
    tiling: Tiling,
    kernels: Kernels,
    source: Plane<f32>,
}

impl Example {
    fn new() -> Self {
        let tiling = Tiling::new(2, (140, 100), 21, 10, 26);
        let count = (tiling.across() + 1) * (tiling.down() + 1) * 21 * 21;
        let kernels = Kernels { size: 21, data: (0..count).map(noise).collect() };
        let source = Plane::from_fn(140, 100, |x, y| noise(x * 71 + y * 1009 + 5));
        Self { tiling, kernels, source }
    }

    fn through(&self, blurrer: &Blurrer) -> Result<Plane<f32>> {
        blurrer.blur(&rows_of(&self.source), &self.kernels, (5, 5), (60, 39))
    }
}

#[test]
#[ignore = "needs a graphics processor: ci/tier-gpu"]
fn the_bytes_depend_neither_on_the_run_nor_on_how_much_is_handed_over_at_once() {
    let Some(gpu) = own() else { return };
    let example = Example::new();
    let mut blurrer = Blurrer::new(gpu, &example.tiling).unwrap();
    let whole = example.through(&blurrer).unwrap();
    assert_eq!(example.through(&blurrer).unwrap(), whole);
    // In rows: whole blocks of four, a number that is no multiple of them, and fewer than a block.
    for rows in [12, 6, 1] {
        blurrer.work = rows * 4 * 21 * 21 * 60;
        assert_eq!(example.through(&blurrer).unwrap(), whole, "{rows} rows");
    }
}

#[test]
#[ignore = "needs a graphics processor: ci/tier-gpu"]
fn what_a_device_cannot_do_is_an_error_with_words() {
    let Some(gpu) = own() else { return };
    let words = |error: Option<Error>| error.expect("refused").to_string();
    // 64 pixels of 64 KiB each in fast memory; kernels of 256 MiB each.
    let fine = Tiling::new(4096, (8192, 8192), 1, 0, 4096);
    let said = words(Blurrer::new(gpu, &fine).err());
    assert!(said.contains("4096 cells per pixel") && said.contains("the processor"), "{said}");
    let wide = Tiling::new(1, (64, 64), 8192, 4096, 64);
    let blurrer = Blurrer::new(gpu, &wide).unwrap();
    let kernels = Kernels { size: 8192, data: Vec::new() };
    let source = Plane::filled(64, 64, 1.0);
    let said = words(blurrer.blur(&rows_of(&source), &kernels, (0, 0), (64, 64)).err());
    assert!(said.contains("8192 x 8192") && said.contains("the processor"), "{said}");
    // Lost: pulled out, or reset by its driver.
    let example = Example::new();
    let blurrer = Blurrer::new(gpu, &example.tiling).unwrap();
    gpu.device.destroy();
    let said = words(example.through(&blurrer).err());
    assert!(said.contains(gpu.name()) && said.contains("the processor"), "{said}");
}

#[test]
#[ignore = "needs a graphics processor: ci/tier-gpu"]
fn what_is_not_dedicated_is_taken_only_when_asked_for() {
    let Some(Device::Gpu(gpu)) = Device::available().get(1).copied() else { return };
    let dedicated = is_dedicated(gpu.kind);
    assert_eq!(DeviceChoice::Auto.open().unwrap().name().is_some(), dedicated);
    assert_eq!(DeviceChoice::Gpu.open().unwrap().name(), Some(gpu.name()));
    assert_eq!(DeviceChoice::Cpu.open().unwrap().name(), None);
}
