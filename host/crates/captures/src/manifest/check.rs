//! Checks the values of a manifest.

use super::{File, Sensor, paths};
use crate::{Capture, CaptureSet, Light, Role, SensorFacts};
use camrig_base::{Cfa, Error, Result, mistakes, toml_text};
use std::path::{Path, PathBuf};

/// Checks all values and reports all that are wrong.
pub fn check(raw: File, root: PathBuf, text: &str) -> Result<CaptureSet> {
    if raw.format != "captures/1" {
        return Err(Error::unsupported(format!("capture format {:?}", raw.format))
            .at("key \"format\"")
            .help("this program reads format = \"captures/1\""));
    }
    let mut wrong = Vec::new();
    let sensor = check_sensor(raw.sensor).map_err(|e| wrong.push(e.at("[sensor]"))).ok();
    let camera = raw.camera.map(|c| {
        let is_path = c.contains(['/', '\\']) || Path::new(&c).extension().is_some();
        if is_path { root.join(c) } else { PathBuf::from(c) }
    });
    let ids: Vec<String> = raw.capture.iter().map(|entry| entry.get_ref().id.clone()).collect();
    let mut captures: Vec<Capture> = Vec::with_capacity(ids.len());
    for (index, entry) in raw.capture.into_iter().enumerate() {
        let id = &ids[index];
        let line = toml_text::line_of(text, entry.span().start);
        let place = format!("line {line}, [[capture]] id {id:?}");
        if ids[..index].contains(id) {
            let twice = Error::input(format!("capture id {id:?} is used twice"));
            wrong.push(twice.at(&place).help("ids name captures; make them unique"));
        }
        let entry = entry.into_inner();
        if let Some(before) = entry.preceded_by.as_ref().filter(|before| !ids.contains(before)) {
            let known: Vec<&str> = ids.iter().map(String::as_str).collect();
            let unknown = Error::input(format!("preceded_by = {before:?} is no capture's id"));
            wrong.push(unknown.at(&place).help(toml_text::did_you_mean(before, &known)));
        }
        match check_entry(entry, &root) {
            Ok(capture) => captures.push(capture),
            Err(e) => wrong.push(e.at(place)),
        }
    }
    match sensor {
        Some(sensor) if wrong.is_empty() => Ok(CaptureSet { root, camera, sensor, captures }),
        _ => Err(mistakes::all(wrong)),
    }
}

fn check_sensor(s: Sensor) -> Result<SensorFacts> {
    if s.width == 0 || s.height == 0 || s.width > 1 << 16 || s.height > 1 << 16 {
        return Err(Error::input(format!("frame size {} x {}", s.width, s.height))
            .help("width and height are in pixels, 1 to 65536"));
    }
    if !(1..=16).contains(&s.bits) {
        return Err(Error::input(format!("bits = {}", s.bits)).help("use 1 to 16"));
    }
    let full_scale = ((1u32 << s.bits) - 1) as u16;
    let white = s.white_level_dn.unwrap_or(full_scale);
    if white > full_scale {
        return Err(Error::input(format!(
            "white_level_dn = {white} does not fit {} bits",
            s.bits
        ))
        .help(format!("use at most {full_scale}")));
    }
    if let Some(black) = s.black_level_dn
        && !(black >= 0.0 && black < f64::from(white))
    {
        return Err(Error::input(format!("black_level_dn = {black}"))
            .help(format!("it lies between 0 and white_level_dn = {white}")));
    }
    if let Some(pitch) = s.pitch_um
        && !(pitch > 0.0 && pitch.is_finite())
    {
        return Err(Error::input(format!("pitch_um = {pitch}")).help("use a pixel pitch in µm"));
    }
    let cfa = s.cfa.as_deref().map(Cfa::parse).transpose().map_err(|e| e.at("key \"cfa\""))?;
    Ok(SensorFacts {
        width: s.width,
        height: s.height,
        bits: s.bits,
        cfa,
        black_level_dn: s.black_level_dn,
        white_level_dn: white,
        pitch_um: s.pitch_um,
        window: None,
    })
}

fn check_entry(mut e: Capture, root: &Path) -> Result<Capture> {
    // Only bias frames, without light and dark current, have no exposure.
    if !(e.role == Role::Dark && e.exposure_s == 0.0) {
        positive("exposure_s", e.exposure_s)?;
    }
    positive("analog_gain", e.analog_gain)?;
    if let Some(t) = e.exposure_requested_s {
        positive("exposure_requested_s", t)?;
    }
    if let Some(t) = e.temperature_c
        && !(t > -273.15 && t.is_finite())
    {
        return Err(Error::input(format!("temperature_c = {t}")).help("it is in degrees Celsius"));
    }
    if let Some(light) = &e.light {
        check_light(light, e.role)?;
    }
    if e.role == Role::Rotation && e.rotation.is_none() {
        return Err(Error::input("a rotation capture without [capture.rotation]")
            .help("give x, y (-1..1), tilt_x_deg and tilt_y_deg"));
    }
    if let Some(r) = &e.rotation {
        let ok = r.x.abs() <= 1.0
            && r.y.abs() <= 1.0
            && r.tilt_x_deg.abs() < 80.0
            && r.tilt_y_deg.abs() < 80.0;
        if !ok {
            return Err(Error::input("a point or tilt out of range")
                .at("[capture.rotation]")
                .help("x and y are -1..1 over the sensor, tilts below 80 degrees"));
        }
    }
    paths::resolve(root, &mut e.light, &mut e.scene);
    let files = match e.held {
        Some(_) => Vec::new(),
        None => paths::expand_all(root, &e.files)?,
    };
    Ok(Capture { files, ..e })
}

fn check_light(light: &Light, role: Role) -> Result<()> {
    let place = |e: Error| e.at("[capture.light]");
    let amounts = [light.irradiance_w_m2, light.photons_per_pixel_per_s, light.lux];
    if role == Role::Dark && amounts.iter().flatten().any(|&a| a > 0.0) {
        return Err(place(Error::input("a dark capture with light"))
            .help("remove [capture.light], or use role = \"flat\""));
    }
    for amount in amounts.into_iter().flatten() {
        if !(amount >= 0.0 && amount.is_finite()) {
            return Err(place(Error::input(format!("an amount of light of {amount}")))
                .help("light is zero or more"));
        }
    }
    if light.irradiance_w_m2.is_some() && light.wavelength_nm.is_none() {
        return Err(place(Error::input("irradiance_w_m2 without wavelength_nm"))
            .help("the number of photons depends on the wavelength: add wavelength_nm"));
    }
    for (key, length) in [("wavelength_nm", light.wavelength_nm), ("width_nm", light.width_nm)] {
        if let Some(nm) = length {
            positive(key, nm).map_err(place)?;
        }
    }
    Ok(())
}

fn positive(key: &str, value: f64) -> Result<()> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(Error::input(format!("{key} = {value}")).help("it is more than zero"))
}
