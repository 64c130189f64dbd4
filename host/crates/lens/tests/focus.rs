//! Where the sensor goes: by the best MTF on the axis, or a focus distance.

use camrig_lens::characterise::field_points;
use camrig_lens::{Catalogue, Conditions, Focus, System};
use camrig_prescription::toml;

/// A plane and a hyperboloid of eccentricity n: free of aberration for an object at infinity.
/// n − 1 = 0.5 and R = −10: focal length 20.
fn perfect(thickness: f64) -> String {
    format!(
        "format = \"camrig-prescription/1\"\nwavelengths_nm = [500.0]\nfields_deg = [0.0]\n\
         [aperture]\nf_number = 10.0\n[[surface]]\nthickness_mm = 1.0\nglass = \"flat\"\n\
         stop = true\n[[surface]]\nradius_mm = -10.0\nconic = -2.25\n\
         thickness_mm = {thickness}\n[glass.flat]\nnd = 1.5\n"
    )
}

fn focused(text: &str, focus: Focus, sensor_shift_mm: f64) -> camrig_base::Result<System> {
    let lens = toml::read(text, &Catalogue::default()).unwrap();
    System::new(lens, Conditions { focus, sensor_shift_mm, ..Conditions::default() })
}

#[test]
fn a_perfect_lens_is_sharpest_in_its_focus_with_the_mtf_of_diffraction() {
    for thickness in [20.0, 19.7, 20.2] {
        let system = focused(&perfect(thickness), Focus::BestMtf(40.0), 0.0).unwrap();
        let found = system.prescription.surfaces[1].thickness;
        // λN² = 50 µm; the top of the MTF is found to a small part of it.
        assert!((found - 20.0).abs() < 5e-4, "{thickness}: {found}");
        let note = system.prescription.notes.last().unwrap();
        // ν/ν_c = 40·0.0005·10 = 0.2: (2/π)(acos x − x√(1 − x²)) = 0.7471.
        let mtf: f64 = note.split('(').nth(1).unwrap()[..6].parse().unwrap();
        assert!((mtf - 0.7471).abs() < 5e-3, "{note}");
    }
    let shifted = focused(&perfect(19.7), Focus::BestMtf(40.0), 0.1).unwrap();
    assert!((shifted.prescription.surfaces[1].thickness - 20.1).abs() < 5e-4);
    let error = focused(&perfect(20.0), Focus::BestMtf(250.0), 0.0).unwrap_err().to_string();
    assert!(error.contains("cut-off"), "{error}");
}

#[test]
fn wavelengths_count_by_their_weights() {
    let glass = "nd = 1.5\nvd = 200.0";
    let with = |lines: &str| {
        let text = perfect(20.0)
            .replace("nd = 1.5", glass)
            .replace("wavelengths_nm = [500.0]", &format!("reference_nm = 500.0\n{lines}"));
        let system = focused(&text, Focus::BestMtf(40.0), 0.0).unwrap();
        system.prescription.surfaces[1].thickness
    };
    let blue = with("wavelengths_nm = [450.0]");
    let both = with("wavelengths_nm = [450.0, 650.0]");
    assert!(both - blue > 0.01, "{blue} {both}");
    let weighted = |weights: &str| with(&format!("wavelengths_nm = [450.0, 650.0]\n{weights}"));
    assert_eq!(weighted("wavelength_weights = [1, 0]"), blue);
    assert_eq!(weighted("wavelength_weights = [3, 3]"), both);
    let mostly_blue = weighted("wavelength_weights = [3, 1]");
    assert!(blue < mostly_blue && mostly_blue < both, "{mostly_blue}");
    for wrong in ["[1]", "[0, 0]", "[2, -1]"] {
        let text = perfect(20.0)
            .replace("[500.0]", "[500.0, 600.0]")
            .replace("[aperture]", &format!("wavelength_weights = {wrong}\n[aperture]"));
        let error = toml::read(&text, &Catalogue::default()).unwrap_err().to_string();
        assert!(error.contains("weights"), "{error}");
    }
}

#[test]
fn a_focus_distance_moves_the_sensor_as_the_image_moves() {
    let at = |distance: f64| focused(&perfect(20.0), Focus::At(distance), 0.0);
    let thickness = |distance| at(distance).unwrap().prescription.surfaces[1].thickness;
    // Principal planes: the front one lies t/n = 2/3 mm behind the first surface, the rear one
    // in the second surface. 1/b = 1/20 − 1/(500 + 2/3).
    let image = 1.0 / (1.0 / 20.0 - 1.0 / (500.0 + 2.0 / 3.0));
    assert!((thickness(500.0) - image).abs() < 1e-9, "{}", thickness(500.0));
    assert_eq!(thickness(f64::INFINITY), 20.0);
    let error = at(15.0).unwrap_err().to_string();
    assert!(error.contains("no real image"), "{error}");
    assert!(at(-5.0).is_err() && at(f64::NAN).is_err());
    assert!(at(500.0).unwrap().prescription.notes[0].contains("focused at 500 mm"));

    // The picture breathes: a field grows as the sensor moves away. Its chief ray goes through
    // the middle of the first surface, and leaves the second at 2/3·tan θ with the slope
    // 29/30·tan θ.
    let height = |distance: f64| {
        let points = field_points(&at(distance).unwrap(), &[0.01], &[500.0]).unwrap();
        points[0].chief_ray_height_mm
    };
    let grown = height(500.0) / height(f64::INFINITY);
    assert!((grown - (2.0 / 3.0 + 29.0 / 30.0 * image) / 20.0).abs() < 1e-6, "{grown}");
}
