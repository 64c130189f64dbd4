//! The tracer against figures of other programs and closed forms.

use camrig_lens::characterise;
use camrig_lens::prescription::Object;
use camrig_lens::{Catalogue, Conditions, Prescription, System};
use camrig_lens_files::read_prescription;
use camrig_prescription::toml;
use camrig_testing::shared;
use std::path::PathBuf;

/// A finite-conjugate lens of an outside designer: EFL and pupil as its own program printed them.
#[test]
fn edmund_54852_first_order() {
    let Some(file) = shared("data/lenses/lens_EO54852/EO54852.ZMX") else { return };
    let lens = read_prescription(&file, &Catalogue::default()).unwrap();
    let system = System::new(lens, Conditions::default()).unwrap();
    let p = system.paraxial;
    // The catalogue of 2004 gave indices to 5 digits: 1e-5 of n is 1e-4 mm of EFL in this lens.
    assert!((p.efl_mm - 5.99997).abs() < 1e-4, "{}", p.efl_mm);
    assert!((p.entrance_z_mm - 4.057948).abs() < 1e-6, "{}", p.entrance_z_mm);
    assert!((system.entrance_pupil_mm - 3.38094).abs() < 1e-4, "{}", system.entrance_pupil_mm);
    assert!((p.magnification + 0.023954).abs() < 1e-6);
}

/// Clear apertures from vignetting factors, against those ray-optics 0.9.8 derives from the same
/// file.
#[test]
fn vignetting_factors_give_the_apertures_ray_optics_finds() {
    let Some(file) = shared("data/lenses/rayoptics/ag_dblgauss.seq") else { return };
    let lens = read_prescription(&file, &Catalogue::default()).unwrap();
    let system = System::new(lens, Conditions::default()).unwrap();
    let theirs = [
        28.1719, 27.1359, 24.6262, 22.8939, 17.2926, 0.0, 15.1348, 17.2501, 18.9261, 20.349,
        20.7763,
    ];
    for (i, (surface, radius)) in system.prescription.surfaces.iter().zip(theirs).enumerate() {
        // Programs differ in how they aim at the rim of a vignetted pupil: 2 % of a radius.
        if i != system.prescription.stop {
            assert!((surface.clips[0].outer / radius - 1.0).abs() < 0.02, "surface {}", i + 1);
        }
    }
}

/// Far out of focus the light of a mirror with a hole is a ring around an empty window.
#[test]
fn a_window_without_light_is_refused_in_words() {
    let text = "format = \"camrig-prescription/1\"\nwavelengths_nm = [550.0]\nfields_deg = [0.0]\n\
         [aperture]\nstop_radius_mm = 2.5\n[[surface]]\nradius_mm = -200.0\nconic = -1.0\n\
         thickness_mm = -110.0\nglass = \"mirror\"\nstop = true\nobscuration_radius_mm = 1.0\n";
    let lens = toml::read(text, &Catalogue::default()).unwrap();
    let system = System::new(lens, Conditions::default()).unwrap();
    let plan = characterise::Plan {
        heights: 2,
        density: None,
        max_field_deg: 0.01,
        wavelengths_nm: vec![550.0],
        psf_size: 16,
        psf_spacing_um: Some(0.5),
        method: characterise::PsfMethod::Geometric,
    };
    let error = characterise::characterise(&system, &plan, &|_, _| ()).unwrap_err().to_string();
    assert!(error.contains("no light falls on the PSF's 8 µm"), "{error}");
    assert!(error.contains("550 nm"), "{error}");
}

/// A point so far away that digits of its distance are lost beside the lens is as one at infinity.
#[test]
fn an_object_far_away_is_one_at_infinity() {
    let lens =
        toml::read(include_str!("../../src/fuzz/lens.toml"), &Catalogue::default()).unwrap();
    let points = |object: Object| {
        let lens = Prescription { object, ..lens.clone() };
        let system = System::new(lens, Conditions::default()).unwrap();
        characterise::field_points(&system, &[0.0, 8.0, 14.0], &[486.1, 587.6]).unwrap()
    };
    let infinite = points(Object::Infinity);
    for distance in [1e8, 1e9, 9e9] {
        for (a, b) in infinite.iter().zip(points(Object::Distance(distance))) {
            // The image moves by f²/distance; the wavefront bends by r²/2 over the distance, in
            // waves.
            let near = 1e8 / distance;
            assert!((a.chief_ray_height_mm - b.chief_ray_height_mm).abs() < 2e-5 * near);
            assert!((a.opd_rms_waves - b.opd_rms_waves).abs() < 3e-4 * near + 1e-6, "{a:?} {b:?}");
            assert!((a.relative_illumination - b.relative_illumination).abs() < 1e-6, "{b:?}");
        }
    }
}

/// Every real file of the collection loads, or is refused for a tilt among a surface's properties.
#[test]
fn real_files_load() {
    let Some(dir) = shared("data/lenses") else { return };
    let refused = [("zmax_37992.zmx", "SCBD")];
    let mut seen = 0;
    for folder in ["rayoptics", "optiland", "lens_EO54852"] {
        let mut files: Vec<PathBuf> =
            std::fs::read_dir(dir.join(folder)).unwrap().map(|e| e.unwrap().path()).collect();
        files.sort();
        for path in files {
            let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
            if extension != "zmx" && extension != "seq" {
                continue;
            }
            seen += 1;
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            match read_prescription(&path, &Catalogue::default()) {
                Err(error) => {
                    let error = error.to_string();
                    let (_, why) = refused.iter().find(|(file, _)| *file == name).expect(&error);
                    assert!(error.contains("line") && error.contains(why), "{error}");
                }
                Ok(lens) => {
                    assert!(refused.iter().all(|(file, _)| *file != name), "{name}");
                    let system = match System::new(lens, Conditions::default()) {
                        Ok(system) => system,
                        // A plane-parallel plate with an r⁴ figure has no focal length.
                        Err(e) if name == "asp46.seq" && e.to_string().contains("afocal") => {
                            continue;
                        }
                        Err(e) => panic!("{name}: {e}"),
                    };
                    assert!(system.paraxial.efl_mm.is_finite() && system.stop_radius_mm > 0.0);
                }
            }
        }
    }
    assert_eq!(seen, 16);
}
