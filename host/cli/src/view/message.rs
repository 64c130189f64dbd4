//! Messages to a page: the length of a JSON text (u32, little-endian), the text, and the samples of
//! a frame (u16, little-endian), if there is one. Spaces after the text align the samples.

use super::order::Next;
use super::state::{Frame, State};
use camrig_formats::preview;
use serde_json::{Value, json};

/// The text of a message.
pub fn text(state: &State, next: &Next, frame: Option<&Frame>) -> String {
    json!({
        "source": state.source,
        "settings": state.settings,
        "status": state.status,
        "busy": state.busy,
        "frames": state.frames,
        "frames_per_s": state.frames_per_s(),
        "late": state.late,
        "dropped": state.dropped,
        "scene": state.scene,
        "recording": state.recording,
        "registers": state.registers,
        "times": state.times_after(next.seen),
        "events": state.events_after(next.event),
        "frame": frame.map(about),
    })
    .to_string()
}

/// The facts with which a page shows and measures a frame.
fn about(frame: &Frame) -> Value {
    let raw = &frame.raw;
    let development = preview::Development::new(raw, &frame.light.info);
    let letters: String = raw.cfa.letters.iter().collect();
    json!({
        "number": frame.number,
        "counter": frame.counter,
        "exposure_s": frame.settings.exposure_s,
        "analog_gain": frame.settings.analog_gain,
        "injected": frame.injected,
        "light": light_of(frame),
        "width": raw.width,
        "height": raw.height,
        "bits": raw.bits,
        "white_level_dn": raw.white_level_dn,
        "cfa": { "width": raw.cfa.width, "height": raw.cfa.height, "letters": letters },
        "black_dn": development.black_dn,
        "scale_per_dn": development.scale_per_dn,
        "srgb_from_camera": development.srgb_from_camera,
    })
}

/// A light in words, different for each.
fn light_of(frame: &Frame) -> String {
    let header = &frame.light.header;
    let illuminant = header.illuminant.as_deref().unwrap_or("the scene's light");
    let lux = header.lux.map_or(String::new(), |lux| format!(" at {lux} lx"));
    format!("{} in {illuminant}{lux}", header.made_of)
}

/// A complete message.
pub fn bytes(text: &str, frame: Option<&Frame>) -> Vec<u8> {
    let samples = frame.map_or(&[][..], |frame| &frame.raw.data);
    let length = text.len().next_multiple_of(2);
    let mut bytes = Vec::with_capacity(size_of::<u32>() + length + size_of_val(samples));
    bytes.extend((length as u32).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.resize(size_of::<u32>() + length, b' ');
    bytes.extend(samples.iter().flat_map(|dn| dn.to_le_bytes()));
    bytes
}
