//! What an irradiance cube was made for: the part of a camera that acts before the sensor stage.
//!
//! Lens, pitch, fill factor and size are in the irradiance already. A camera that differs from the
//! cube's in one of them would get a picture that neither camera takes, so such a camera is
//! refused. The cube's header has them by their keys in a camera file; files that decide are
//! represented by the SHA-256 of their bytes, so that a copy elsewhere is the same lens.

use super::{CubeHeader, reach};
use camrig_base::{Error, ErrorCode, Result, Spectrum};
use camrig_camera::{Camera, LensKind, RelativeIllumination};
use camrig_lens::prescription::{Focus, Setup};
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Keys of a camera file that act before the sensor stage, with their values.
pub type MadeFor = BTreeMap<String, String>;

/// Bytes of a digest in the header: 64 bits, by which two of a million lenses are taken for one
/// another with a probability of 3e-8.
const DIGEST_BYTES: usize = 8;

/// What electrons are made for beside the optics: quantum efficiency and colour filters.
pub(crate) fn response(camera: &Camera) -> String {
    let pattern = camera.sensor.pattern();
    let filters = pattern.channels.iter().map(|&channel| f64::from(channel));
    let shape = [f64::from(pattern.width), f64::from(pattern.height)].into_iter().chain(filters);
    let response = camera.sensor.response(&reach::SILICON).concat().into_iter();
    pairs(shape.chain(response).enumerate().map(|(i, value)| (i as f64, value)))
}

/// What irradiance on the sensor of `camera` is made for.
///
/// # Errors
/// A file of the lens that cannot be read.
pub fn made_for(camera: &Camera) -> Result<MadeFor> {
    let sensor = &camera.sensor;
    let mut keys = MadeFor::new();
    let mut put = |key: &str, value: String| keys.insert(key.to_owned(), value);
    put("sensor.pitch_um", sensor.pitch_um.to_string());
    put("sensor.fill_factor", sensor.fill_factor.to_string());
    put("lens.transmittance", spectrum(&camera.lens.transmittance));
    match &camera.lens.kind {
        LensKind::DiffractionLimited {
            f_number,
            focal_length_mm,
            magnification,
            relative_illumination,
        } => {
            put("lens.kind", "diffraction-limited".into());
            put("lens.f_number", f_number.to_string());
            put("lens.focal_length_mm", focal_length_mm.to_string());
            put("lens.magnification", magnification.to_string());
            put("lens.relative_illumination", fall_off(relative_illumination));
        }
        LensKind::Characterised(path) => {
            put("lens.kind", "characterised".into());
            put("lens.data", files(path)?);
        }
        LensKind::Prescription(setup) => {
            put("lens.kind", "prescription".into());
            put("lens.file", files(&setup.file)?);
            prescribed(setup, &mut put)?;
        }
    }
    for effect in &camera.optical_effects {
        let entry = effect.entry();
        for (parameter, value) in entry.parameters.iter().zip(effect.values()) {
            put(&format!("effect.{}.{}", entry.kind, parameter.key), value.to_string());
        }
    }
    Ok(keys)
}

/// How a prescription is used, where that is not as in its file.
fn prescribed(setup: &Setup, mut put: impl FnMut(&str, String) -> Option<String>) -> Result<()> {
    let conditions = &setup.conditions;
    let mut number = |key: &str, value: Option<f64>| {
        if let Some(value) = value {
            put(&format!("lens.{key}"), value.to_string());
        }
    };
    number("object_distance_mm", conditions.object_distance_mm);
    match conditions.focus {
        Focus::AsDesigned => {}
        Focus::At(mm) => number("focus_distance_mm", Some(mm)),
        Focus::BestMtf(per_mm) => number("focus_mtf_per_mm", Some(per_mm)),
    }
    let shift = conditions.sensor_shift_mm;
    number("sensor_shift_mm", (shift != 0.0).then_some(shift));
    number("stop_radius_mm", conditions.stop_radius_mm);
    number("reference_nm", conditions.reference_nm);
    if let Some(name) = &setup.configuration {
        put("lens.configuration", name.clone());
    }
    for (name, glass) in &setup.glasses {
        let (nd, vd) = glass.nd_vd();
        put(&format!("lens.glass {name}"), format!("{nd}:{vd}"));
    }
    let catalogues = setup.catalogue_files()?;
    if !catalogues.is_empty() {
        let digests: Result<Vec<String>> = catalogues.iter().map(|file| files(file)).collect();
        put("lens.glass_catalogue", digests?.join(", "));
    }
    Ok(())
}

/// Refuses a camera for which a cube was not made. A cube that does not say is let pass
/// ([`unchecked`]), but for its size.
///
/// # Errors
/// Every key in which the two differ.
pub fn check_made_for(camera: &Camera, header: &CubeHeader) -> Result<()> {
    let (mut camera_has, mut cube_has) = (MadeFor::new(), MadeFor::new());
    if !header.made_for.is_empty() {
        (camera_has, cube_has) = (made_for(camera)?, header.made_for.clone());
    }
    if header.holds_electrons() {
        camera_has.insert(CubeHeader::RESPONSE.into(), response(camera));
    }
    let size = [
        ("sensor.width", camera.sensor.width as usize, header.width),
        ("sensor.height", camera.sensor.height as usize, header.height),
    ];
    for (key, camera, cube) in size {
        camera_has.insert(key.into(), camera.to_string());
        cube_has.insert(key.into(), cube.to_string());
    }
    // The keys of another kind of lens cannot be compared.
    let other_kind = camera_has.get("lens.kind") != cube_has.get("lens.kind");
    let keys: BTreeSet<&String> = camera_has.keys().chain(cube_has.keys()).collect();
    let word = |value: Option<&String>| value.map_or("not there".into(), Clone::clone);
    let differences: Vec<String> = keys
        .into_iter()
        .filter(|key| !other_kind || *key == "lens.kind" || !key.starts_with("lens."))
        .filter(|key| camera_has.get(*key) != cube_has.get(*key))
        .map(|key| {
            let (cube, camera) = (word(cube_has.get(key)), word(camera_has.get(key)));
            format!("{key}: {cube}, of the camera {camera}")
        })
        .collect();
    if differences.is_empty() {
        return Ok(());
    }
    let differences = differences.join("; ");
    let message = format!("irradiance that was made for another camera ({differences})");
    Err(Error::disagreement(message)
        .help(
            "lens, pitch, fill factor and size are in the irradiance already, and on a fast path \
             the response: use the camera for which it was made, or run the optics again for \
             this one",
        )
        .with_code(ErrorCode::NoIrradiance))
}

/// What could not be checked of a cube that does not say what it was made for.
#[must_use]
pub fn unchecked(camera: &Camera, header: &CubeHeader) -> Option<String> {
    header.made_for.is_empty().then(|| {
        format!(
            "the irradiance ({}) does not say for which lens, pitch and fill factor it was made; \
             whether they are those of {} could not be checked, and frames have no f-number and \
             no focal length",
            header.made_of, camera.name
        )
    })
}

fn fall_off(given: &RelativeIllumination) -> String {
    match given {
        RelativeIllumination::Cos4 => "cos4".into(),
        RelativeIllumination::Flat => "none".into(),
        RelativeIllumination::Table(table) => pairs(table.iter().copied()),
    }
}

/// A constant as its number, a curve as its digest.
fn spectrum(given: &Spectrum) -> String {
    let mut samples = given.samples();
    match (samples.next(), samples.next()) {
        (Some((_, value)), None) => value.to_string(),
        _ => pairs(given.samples()),
    }
}

fn pairs(values: impl Iterator<Item = (f64, f64)>) -> String {
    let mut hasher = Sha256::new();
    for (x, y) in values {
        hasher.update(x.to_le_bytes());
        hasher.update(y.to_le_bytes());
    }
    format!("table {}", digest(hasher))
}

/// The digest of a file, or of all files of a folder with their names.
fn files(path: &Path) -> Result<String> {
    let mut hasher = Sha256::new();
    if path.is_dir() {
        let failed = |e| Error::io("read", path, e);
        let entries = std::fs::read_dir(path).map_err(failed)?;
        let mut inside: Vec<PathBuf> =
            entries.map(|entry| Ok(entry.map_err(failed)?.path())).collect::<Result<_>>()?;
        inside.sort();
        for file in inside.iter().filter(|file| file.is_file()) {
            hasher.update(file.file_name().unwrap_or_default().as_encoded_bytes());
            add_file(&mut hasher, file)?;
        }
    } else {
        add_file(&mut hasher, path)?;
    }
    Ok(format!("sha256 {}", digest(hasher)))
}

fn add_file(hasher: &mut Sha256, path: &Path) -> Result<()> {
    let bytes = std::fs::read(path).map_err(|e| Error::io("read", path, e))?;
    hasher.update((bytes.len() as u64).to_le_bytes());
    hasher.update(bytes);
    Ok(())
}

fn digest(hasher: Sha256) -> String {
    hasher.finalize().iter().take(DIGEST_BYTES).map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SceneLight, frame_info, scene_irradiance};
    use camrig_exposure::IrradianceCube;
    use camrig_lens::Conditions;
    use camrig_optics::Options;

    fn camera(changes: &[(&str, camrig_camera::Value)]) -> Camera {
        let small = [("sensor.width", 16.into()), ("sensor.height", 12.into())];
        let all = small.iter().chain(changes).cloned();
        Camera::load_with("mt9v024", all).unwrap()
    }

    fn cube() -> IrradianceCube {
        let light = SceneLight::lux("D65", 300.0);
        let options = Options::default();
        scene_irradiance(&camera(&[]), "uniform:0.2", &light, &options, |_, _| ()).unwrap().cube
    }

    fn refusal(camera: &Camera, header: &CubeHeader) -> String {
        check_made_for(camera, header).unwrap_err().to_string()
    }

    #[test]
    fn a_cube_takes_the_camera_it_was_made_for_and_no_other_optics() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.irr");
        cube().save(&path, false).unwrap();
        // The sensor stage may differ: noise, response, range, seed.
        let of_the_sensor = [
            ("sensor.noise.prnu", 0.02.into()),
            ("sensor.bits", 12.into()),
            ("sensor.seed", 5.into()),
            ("effect.row-temporal-noise.sigma_e", 3.0.into()),
        ];
        let header = IrradianceCube::open(&path).unwrap().header;
        check_made_for(&camera(&of_the_sensor), &header).unwrap();
        for (key, value) in [
            ("lens.f_number", 8.0.into()),
            ("lens.focal_length_mm", 5.5.into()),
            ("lens.magnification", 0.1.into()),
            ("lens.transmittance", 0.46.into()),
            ("lens.relative_illumination", "none".into()),
            ("sensor.pitch_um", 3.0.into()),
            ("sensor.fill_factor", 0.1.into()),
            ("sensor.width", 24.into()),
            ("effect.defocus.shift_um", 40.0.into()),
            ("effect.veiling-glare.fraction", 0.1.into()),
        ] {
            let text = refusal(&camera(&[(key, value)]), &header);
            assert!(text.contains(key), "{key}: {text}");
        }
        let mobile = Camera::load("mobile").unwrap().with_size(16, 12).unwrap();
        let text = refusal(&mobile, &header);
        assert!(text.contains("sensor.pitch_um") && text.contains("lens.f_number"), "{text}");
    }

    #[test]
    fn a_cube_that_does_not_say_is_read_with_a_note_and_its_frames_claim_no_lens() {
        let camera = camera(&[]);
        let mut header = cube().header;
        let settings = camera.settings(0, 0.01, None);
        let info = |h: &CubeHeader| frame_info(&camera, &settings, None, h, false).unwrap();
        assert_eq!(info(&header).f_number, Some(4.0));
        assert_eq!(unchecked(&camera, &header), None);
        header.made_for.clear();
        check_made_for(&camera, &header).unwrap();
        assert!(unchecked(&camera, &header).unwrap().contains("could not be checked"));
        assert_eq!((info(&header).f_number, info(&header).focal_length_mm), (None, None));
        header.height = 13;
        assert!(refusal(&camera, &header).contains("sensor.height: 13, of the camera 12"));
    }

    #[test]
    fn a_lens_in_files_is_known_by_their_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("a.zmx"), "SURF 0").unwrap();
        std::fs::write(at("b.zmx"), "SURF 0").unwrap();
        std::fs::write(at("c.zmx"), "SURF 1").unwrap();
        let used = |name: &str, conditions: Conditions| {
            let mut camera = camera(&[]);
            let setup = Setup { file: at(name), conditions, ..Setup::default() };
            camera.lens.kind = LensKind::Prescription(Box::new(setup));
            made_for(&camera).unwrap()
        };
        let of = |name: &str| used(name, Conditions::default());
        assert_eq!(of("a.zmx"), of("b.zmx"));
        assert_ne!(of("a.zmx")["lens.file"], of("c.zmx")["lens.file"]);
        let near = Conditions { object_distance_mm: Some(200.0), ..Conditions::default() };
        assert_eq!(used("a.zmx", near)["lens.object_distance_mm"], "200");
        assert!(!of("a.zmx").contains_key("lens.sensor_shift_mm"));
    }
}
