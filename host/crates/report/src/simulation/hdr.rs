//! What a merged signal is good for: its signal-to-noise ratio over light, dynamic range and
//! hand-overs, by the closed form.

use super::super::numbers::fixed;
use super::super::page::{Page, Table};
use super::super::plot::{Colour, Mark, Plot};
use camrig_camera::Camera;
use camrig_camera::hdr::expected::{Expected, db};
use camrig_sensor_core::config::FrameSettings;

/// Light below the threshold that the plot begins with.
const BELOW: f64 = 0.5;
/// Points per decade of light.
const PER_DECADE: f64 = 60.0;

/// The section of a camera with several captures; nothing for others.
pub(super) fn section(page: &mut Page, camera: &Camera, settings: &FrameSettings) {
    let (exposure_s, gain) = (settings.exposure_s.into(), settings.analog_gain.into());
    let (Some(hdr), Ok(expected)) = (&camera.sensor.hdr, Expected::new(camera, exposure_s, gain))
    else {
        return;
    };
    let [least, most] = [BELOW * expected.threshold_e(), expected.saturation_e()];
    let decades = libm::log10(most / least);
    let points = (PER_DECADE * decades) as usize;
    let lights: Vec<f64> = (0..=points)
        .map(|i| least * libm::pow(10.0, decades * i as f64 / points as f64))
        .collect();
    let merged = lights.iter().map(|&e| [e, db(expected.merged(e).snr())]).collect();
    let mut plot = Plot::new(
        "Signal-to-noise ratio of the merged signal",
        "photo-electrons of the first capture",
        "SNR, dB",
    );
    plot.log_x().series("merged", Mark::Line, Colour::Given, merged);
    if hdr.companding.is_some() {
        let codes = lights.iter().filter_map(|&e| Some([e, db(expected.companded_snr(e)?)]));
        plot.series("companded", Mark::Dashed, Colour::Reference, codes.collect());
    }
    plot.note(
        "Closed form: shot noise of light and dark current once for each window, read noise and \
         rounding of each capture, the width of a code of the curve. It falls where a less \
         sensitive capture takes over.",
    );
    page.heading("Dynamic range").plot(&plot);
    let range = expected.dynamic_range();
    let mut table = Table::new(&["dynamic range"]).numbers(&["dB"]);
    let mut row = |name: String, value: f64| {
        table.row(vec![name, fixed(value, 1)]);
    };
    row("from an SNR of 1 (EMVA 1288)".into(), range.snr_1_db);
    if let Some(value) = range.read_noise_db {
        row("from the read noise, as data sheets have it".into(), value);
    }
    for (limit, value) in range.above {
        row(format!("with an SNR nowhere below {limit} dB"), value);
    }
    page.rows(&table);
    let mut table = Table::new(&["hand-over to"]).numbers(&[
        "from, e⁻",
        "to, e⁻",
        "SNR before, dB",
        "after, dB",
    ]);
    for hand in expected.hand_overs() {
        let [from, to] = hand.light_e.map(|e| fixed(e, 0));
        let [before, after] = hand.snr.map(|snr| fixed(db(snr), 1));
        table.row(vec![hand.to, from, to, before, after]);
    }
    page.rows(&table);
}
