//! The exposures of one static view: mean frames above black.

use camrig_base::{Error, Plane, Result};
use camrig_captures::{Capture, CaptureSet, Role};

/// One exposure: the mean of its frames.
#[derive(Clone, Debug)]
pub struct Exposure {
    /// The capture's id.
    pub id: String,
    /// Exposure time, s.
    pub seconds: f64,
    /// Number of frames averaged.
    pub frames: usize,
    /// Mean DN above black.
    pub signal: Plane<f32>,
}

/// Exposures of the same view under the same light.
#[derive(Clone, Debug)]
pub struct Series {
    /// What they have in common.
    pub name: String,
    /// In order of time.
    pub exposures: Vec<Exposure>,
}

/// Reads the captures that show something (or only those named in `ids`), grouped by role, scene,
/// light and gain. Black is the mean of the set's dark frames of the same exposure where there are
/// some, else `black_level_dn` of the set. Series of one exposure are left out.
pub fn read(set: &CaptureSet, ids: &[String]) -> Result<Vec<Series>> {
    for id in ids {
        if !set.captures.iter().any(|c| c.id == *id) {
            let known = set.captures.iter().map(|c| c.id.as_str());
            let nearest = camrig_base::toml_text::nearest(id, known);
            return Err(Error::input(format!("no capture {id:?}; did you mean {nearest:?}?")));
        }
    }
    let wanted = |c: &Capture| {
        let chosen = if ids.is_empty() { c.role != Role::Rotation } else { ids.contains(&c.id) };
        chosen && c.role != Role::Dark
    };
    let mut groups: Vec<(String, Vec<&Capture>)> = Vec::new();
    for capture in set.captures.iter().filter(|c| wanted(c)) {
        let name = common_name(capture);
        match groups.iter_mut().find(|(n, _)| *n == name) {
            Some((_, captures)) => captures.push(capture),
            None => groups.push((name, vec![capture])),
        }
    }
    let mut series = Vec::new();
    for (name, mut captures) in groups {
        captures.sort_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s));
        let times = |c: &[&Capture]| c.windows(2).any(|w| w[1].exposure_s > w[0].exposure_s);
        if captures.len() < 2 || !times(&captures) {
            continue;
        }
        let exposures = captures.iter().map(|c| exposure(set, c)).collect::<Result<_>>()?;
        series.push(Series { name, exposures });
    }
    if series.is_empty() {
        return Err(Error::input("fewer than two exposures of any view").help(
            "shoot the same view at several exposure times: captures of one role, scene, light \
             and gain with different exposure_s",
        ));
    }
    Ok(series)
}

/// What captures of one series share.
fn common_name(capture: &Capture) -> String {
    let mut name = format!("{:?}", capture.role).to_lowercase();
    let light = capture.light.clone().unwrap_or_default();
    for part in [
        capture.scene.as_ref().map(|s| s.scene.clone()),
        light.wavelength_nm.map(|nm| format!("{nm} nm")),
        light.illuminant,
        light.lux.map(|lux| format!("{lux} lx")),
        light.irradiance_w_m2.map(|e| format!("{e} W/m²")),
        light.photons_per_pixel_per_s.map(|p| format!("{p} photons/s")),
        (capture.analog_gain != 1.0).then(|| format!("gain {}", capture.analog_gain)),
    ]
    .into_iter()
    .flatten()
    {
        name.push_str(", ");
        name.push_str(&part);
    }
    name
}

fn exposure(set: &CaptureSet, capture: &Capture) -> Result<Exposure> {
    let (mut signal, frames) = mean(set, capture)?;
    let same = |c: &&Capture| {
        (c.exposure_s / capture.exposure_s - 1.0).abs() < 1e-3
            && c.analog_gain == capture.analog_gain
    };
    // Several dark stacks count alike.
    let mut darks = Vec::new();
    for dark in set.with_role(Role::Dark).filter(same) {
        darks.push(mean(set, dark)?.0);
    }
    let level = set.sensor.black_level_dn.unwrap_or(0.0) as f32;
    for (i, value) in signal.data.iter_mut().enumerate() {
        *value -= match darks.len() {
            0 => level,
            n => darks.iter().map(|d| d.data[i]).sum::<f32>() / n as f32,
        };
    }
    Ok(Exposure { id: capture.id.clone(), seconds: capture.exposure_s, frames, signal })
}

/// The mean frame of a capture.
fn mean(set: &CaptureSet, capture: &Capture) -> Result<(Plane<f32>, usize)> {
    let (width, height) = (set.sensor.width, set.sensor.height);
    // Whole numbers below 2^32: exact in any order.
    let mut sums = vec![0u32; width * height];
    let frames = set.for_each_batch(capture, |batch| {
        for frame in batch {
            sums.iter_mut().zip(&frame.data).for_each(|(sum, &dn)| *sum += u32::from(dn));
        }
        Ok(())
    })?;
    let data = sums.into_iter().map(|s| (f64::from(s) / frames.max(1) as f64) as f32).collect();
    Ok((Plane { width, height, data }, frames))
}
