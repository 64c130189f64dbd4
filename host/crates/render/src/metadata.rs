//! What a raw file says about the camera that made it, computed from the camera's model.

use super::corrections;
use camrig_base::Cfa;
use camrig_base::Result;
use camrig_base::Spectrum;
use camrig_camera::hdr::{Hdr, HdrOutput};
use camrig_camera::{Camera, KeptNoise, LensKind};
use camrig_exposure::CubeHeader;
use camrig_formats::{ColorMatrix, DngInfo, color};
use camrig_light::{Illuminant, photometry};
use camrig_scene::chart::colorchecker;
use camrig_sensor_core::config::FrameSettings;
use camrig_sensor_core::effects::Effect;

/// Metadata of a frame: colour matrices fitted over the ColorChecker's reflectances under A and
/// D65, white of the scene's light, and the noise profile of the sensor model. Where no light is
/// known, as of scenes of radiance, white is D65, the light of their pictures.
pub fn dng_info(
    camera: &Camera,
    settings: &FrameSettings,
    light: Option<&Illuminant>,
    description: &str,
) -> Result<DngInfo> {
    let (f_number, focal_length_mm) = match camera.lens.kind {
        LensKind::DiffractionLimited { f_number, focal_length_mm, .. } => {
            (Some(f_number), Some(focal_length_mm))
        }
        _ => (None, None),
    };
    let gain = f64::from(settings.analog_gain);
    let mut info = DngInfo {
        model: camera.name.clone(),
        description: description.to_string(),
        exposure_s: Some(f64::from(settings.exposure_s)),
        iso: Some((100.0 * gain).round() as u32),
        f_number,
        focal_length_mm,
        pitch_um: Some(camera.sensor.pitch_um),
        noise_profile: noise_profile(camera, gain),
        black_levels_dn: black_levels(camera, gain),
        ..DngInfo::default()
    };
    if let Some(sensitivity) = sensitivity(camera) {
        let table = colorchecker::reflectances();
        let reflectances: Vec<Spectrum> =
            (0..table.curves.len()).map(|i| table.spectrum(i)).collect::<Result<_>>()?;
        let xyz = photometry::observer();
        let matrix = |name: &str| {
            let light = Illuminant::parse(name)?;
            color::fit(&sensitivity, &light.power, &xyz, &reflectances).map(|f| f.camera_from_xyz)
        };
        info.color_matrices =
            vec![ColorMatrix::of_a(matrix("A")?), ColorMatrix::of_d65(matrix("D65")?)];
        let daylight = Illuminant::parse("D65")?;
        let white = light.unwrap_or(&daylight);
        info.as_shot_neutral = Some(color::neutral(&sensitivity, &white.power)?);
    }
    Ok(info)
}

/// What the file of a frame says, [`dng_info`] with how the frame was made; with `opcodes` also
/// how to correct lens shading and bad pixels.
pub fn frame_info(
    camera: &Camera,
    settings: &FrameSettings,
    light: Option<&Illuminant>,
    header: &CubeHeader,
    opcodes: bool,
) -> Result<DngInfo> {
    let (seed, frame) = (camera.sensor.seed, settings.frame);
    let description = format!("{}; sensor seed {seed}, frame {frame}", header.made_of);
    let mut info = dng_info(camera, settings, light, &description)?;
    if header.made_for.is_empty() {
        // Light of an unknown lens, whatever lens the camera file has.
        (info.f_number, info.focal_length_mm) = (None, None);
    }
    if opcodes {
        let corrections = corrections(camera, settings)?;
        (info.opcode_list1, info.opcode_list2) = (corrections.list1, corrections.list2);
    }
    Ok(info)
}

/// What the file of a merged frame says beyond [`frame_info`]: the linear value of each code of its
/// curve, its upper 16 bits, and the black level on that scale. The noise of merged frames is not
/// a profile's straight line.
pub fn describe_merged(info: &mut DngInfo, hdr: &Hdr, cfa: &Cfa) {
    info.noise_profile.clear();
    info.black_levels_dn.clear();
    let (HdrOutput::Companded, Some(companding)) = (hdr.output, &hdr.companding) else { return };
    let parts = (hdr.merge.max_dn() + 1) >> 16;
    let linear = |code: u32| {
        let lowest = companding.lowest(code as u16).max(0) / i64::from(parts);
        lowest.min(i64::from(u16::MAX)) as u16
    };
    info.linearization = (0..1u32 << companding.bits).map(linear).collect();
    let black = f64::from(hdr.merge.pedestal_dn()) / f64::from(parts);
    info.black_levels_dn = vec![black; cfa.width * cfa.height];
}

/// Black level of each cell of the colour filter pattern, DN, where an effect `black-level-offset`
/// gives the planes of 2 x 2 pixels levels of their own: a file tells them, as a camera's does
/// that knows them of its converters. Empty where they are equal, as what is common to all is an
/// error that the camera does not know, and where planes are not cells of the pattern.
fn black_levels(camera: &Camera, gain: f64) -> Vec<f64> {
    let mut planes = [0.0; 4];
    for effect in &camera.effects {
        if let Effect::BlackLevelOffset(b) = effect {
            let own = [b.plane_0_dn, b.plane_1_dn, b.plane_2_dn, b.plane_3_dn];
            planes.iter_mut().zip(own).for_each(|(sum, own)| *sum += f64::from(own));
        }
    }
    let cfa = &camera.sensor.cfa;
    if planes == [planes[0]; 4] || !cfa.width.is_multiple_of(2) || !cfa.height.is_multiple_of(2) {
        return Vec::new();
    }
    let plane = |i: usize| planes[i / cfa.width % 2 * 2 + i % cfa.width % 2];
    let black_level_dn = camera.sensor.at_gain(gain).black_level_dn;
    let level = |i| (black_level_dn + plane(i)).max(0.0);
    (0..cfa.width * cfa.height).map(level).collect()
}

/// Electrons per energy of the channels R, G, B with lens and filters, where the camera has these.
fn sensitivity(camera: &Camera) -> Option<[Spectrum; 3]> {
    let sensor = &camera.sensor;
    let channel = |names: &[&str]| {
        let index = sensor.channel_names.iter().position(|n| names.contains(&n.as_str()))?;
        let (nm, value) = (380..=780)
            .step_by(5)
            .map(|nm| {
                let nm = f64::from(nm);
                let filter = sensor.ir_cut.as_ref().map_or(1.0, |f| f.at(nm));
                let (first, last) = sensor.qe[index].range_nm();
                let known = (first..=last).contains(&nm) || first == last;
                let qe = if known { sensor.qe[index].at(nm) } else { 0.0 };
                (nm, qe * filter * camera.lens.transmittance.at(nm) * nm)
            })
            .unzip();
        Spectrum::new(nm, value).ok()
    };
    Some([channel(&["r"])?, channel(&["g", "gr"])?, channel(&["b"])?])
}

/// Per channel (S, O): variance = S x + O of the signal x, 0 at black and 1 at white. S is one
/// electron, or nothing where shot noise is left out, O the noise of a pixel in the dark from frame
/// to frame with the converter's rounding, both as fractions of the range.
pub fn noise_profile(camera: &Camera, gain: f64) -> Vec<(f64, f64)> {
    let sensor = &camera.sensor;
    let max_dn = f64::from((1u32 << sensor.bits) - 1);
    let at = sensor.at_gain(gain);
    let range = max_dn - at.black_level_dn;
    let scale = at.dn_per_e / range;
    let read_e2 = dark_variance_e2(camera, gain, at.read_variance_e2);
    let offset = read_e2 * scale * scale + at.rounding() / (12.0 * range * range);
    let shot = if sensor.kept_noise == KeptNoise::None { 0.0 } else { scale };
    // DNG 1.4: a pair for all planes, or one for each.
    vec![(shot, offset); if sensor.cfa.channels() == ['R', 'G', 'B'] { 3 } else { 1 }]
}

/// Variance of a pixel in the dark from frame to frame, mean over the pixels, e⁻²: of the read noise
/// and of the effects that add to it, by their closed forms. What is common to a frame is no noise
/// of a picture.
fn dark_variance_e2(camera: &Camera, gain: f64, read_e2: f64) -> f64 {
    let squared = |e: f32| f64::from(e) * f64::from(e);
    let scaled =
        |sigma: f32, exponent: f32| squared(sigma) * libm::pow(gain, 2.0 * f64::from(exponent));
    let (mut spread, mut added) = (1.0, 0.0);
    for effect in &camera.effects {
        match effect {
            Effect::ReadNoiseSpread(e) => spread *= libm::exp(2.0 * squared(e.spread)),
            Effect::HeavyTailedReadNoise(e) => added += scaled(e.sigma_e, e.gain_exponent),
            Effect::RowTemporalNoise(e) => added += scaled(e.sigma_e, e.gain_exponent),
            Effect::RowCorrelatedNoise(e) => added += scaled(e.sigma_e, e.gain_exponent),
            Effect::ColumnTemporalNoise(e) => added += scaled(e.sigma_e, e.gain_exponent),
            Effect::PeriodicPatternNoise(e) => {
                added += 0.5 * scaled(e.amplitude_e, e.gain_exponent);
            }
            Effect::ResetNoise(e) => {
                added += squared(e.sigma_e(camera.sensor.temperature_c as f32))
            }
            Effect::RandomTelegraphNoise(e) => {
                let switching = match e.between_samples {
                    0.0 => e.duty * (1.0 - e.duty),
                    s => 2.0 * s * e.duty * (1.0 - e.duty),
                };
                let amplitude = squared(e.amplitude_e) * (1.0 + squared(e.spread));
                added += f64::from(e.fraction * switching) * amplitude;
            }
            _ => (),
        }
    }
    spread * read_e2 + added
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::AnyEffect;

    /// O is the variance in the dark, whatever makes it: (5 K/4031)² + (1/4031)²/12.
    #[test]
    fn noise_of_effects_is_in_the_noise_profile() {
        let mut camera = Camera::load("mobile").unwrap();
        let sensor = &mut camera.sensor;
        (sensor.bits, sensor.black_level_dn, sensor.full_scale_e) = (12, 64.0, 11_000.0);
        (sensor.noise.read_e, sensor.noise.read_e_post) = (0.0, 0.0);
        let offset = |camera: &Camera| noise_profile(camera, 1.0)[0].1;
        let range = 4095.0 - 64.0;
        let rounding = 1.0 / 12.0 / (range * range);
        assert!((offset(&camera) / rounding - 1.0).abs() < 1e-9);
        let alone = |e2: f64| e2 * (4095.0f64 / 11_000.0 / range).powi(2) + rounding;
        let add = |kind: &str, values: &[f32]| {
            let mut camera = camera.clone();
            let Some(AnyEffect::Sensor(effect)) = AnyEffect::new(kind, values) else {
                panic!("{kind}")
            };
            camera.effects = vec![effect];
            offset(&camera)
        };
        for (kind, values, e2) in [
            ("heavy-tailed-read-noise", &[5.0, -0.1, 0.0][..], 25.0),
            ("row-temporal-noise", &[1.2, 0.0], 1.44),
            ("periodic-pattern-noise", &[2.0, 0.1, 0.0, 0.0], 2.0),
            ("random-telegraph-noise", &[0.01, 10.0, 0.2, 0.5, 1.0, 0.0, 0.0], 0.5),
        ] {
            assert!((add(kind, values) / alone(e2) - 1.0).abs() < 1e-6, "{kind}");
        }
    }

    /// Scenes of radiance, whose light nobody knows, are shown as under D65.
    #[test]
    fn white_is_daylight_unless_the_light_is_known() {
        let camera = Camera::load("mobile").unwrap();
        let settings = camera.settings(0, 0.01, None);
        let neutral = |light: Option<&str>| {
            let light = light.map(|name| Illuminant::parse(name).unwrap());
            let info = dng_info(&camera, &settings, light.as_ref(), "").unwrap();
            info.as_shot_neutral.unwrap()
        };
        assert_eq!(neutral(None), neutral(Some("D65")));
        assert!(neutral(Some("A"))[2] < neutral(None)[2]);
        // That of the case files, from an independent sum over D65.
        for (got, right) in neutral(None).iter().zip([0.6428, 1.0, 0.8221]) {
            assert!((got - right).abs() < 1e-4, "{got} {right}");
        }
    }
}
