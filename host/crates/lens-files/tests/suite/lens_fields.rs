//! Two-dimensional fields against another tracer, closed forms, and rotational lenses told as
//! others.

use camrig_lens::field::{Map, Point, points};
use camrig_lens::{Catalogue, Conditions, System, characterise};
use camrig_lens_files::{read_prescription, seq};
use camrig_prescription::toml;
use camrig_testing::shared;

fn system(text: &str) -> System {
    System::new(seq::read(text, &Catalogue::default()).unwrap(), Conditions::default()).unwrap()
}

fn traced(system: &System, fields: &[[f64; 2]], nm: f64) -> Vec<Point> {
    points(system, &Map::of(system).unwrap(), fields, &[nm]).unwrap()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    f64::hypot(a[0] - b[0], a[1] - b[1])
}

/// Two tilted mirrors (Handbook of Optics, vol. 2, ch. 18, example 46): coordinate breaks, a
/// toroid, an image whose decentre makes the chief ray land in its middle. Chief rays
/// by optiland 0.6.3 on the same file (with the toroid's radius of rotation set to PARM 1: its
/// reader takes PARM 2).
#[test]
fn a_zmx_file_with_coordinate_breaks_traces_as_in_optiland() {
    let Some(dir) = shared("data/lenses/rayoptics") else { return };
    let lens = read_prescription(&dir.join("HoO-V2C18Ex46.zmx"), &Catalogue::default()).unwrap();
    let system = System::new(lens, Conditions::default()).unwrap();
    let right = [[0.0, -0.000000002], [5.308623224, -0.001321979], [-5.312623226, 2.676313897]];
    let fields = [[0.0, 0.0], [1.0, 0.0], [-1.0, 0.5]];
    for (point, place) in traced(&system, &fields, 587.6).iter().zip(right) {
        assert!(distance(point.chief_mm, place) < 1e-6, "{point:?}");
    }
}

/// A rotational lens with an aperture that is decentred by next to nothing gives the figures of the
/// rotational pipeline; and its field is round.
#[test]
fn a_round_lens_has_the_figures_of_the_rotational_tracer() {
    let round = "RDM; EPD 8; DIM M; WL 550; XAN 0; YAN 8; SO 0 1e13\nS 60 5 620.603; CIR 5\n\
                 S -90 3\nS 0 4; STO\nS -140 2 620.364\nS 160 65; CIR 4.5\nSI 0 0";
    let turned = round.replace("CIR 4.5", "CIR 4.5; ADX 1e-12");
    // A turn about the axis of rotation is no asymmetry.
    let spun = system(&round.replace("S 160 65", "S 160 65; CDE 20"));
    assert_eq!(spun.prescription.asymmetry(), None);
    let (round, turned) = (system(round), system(&turned));
    let right = characterise::field_points(&round, &[8.0], &[550.0]).unwrap()[0];
    assert!(characterise::field_points(&turned, &[8.0], &[550.0]).is_err());
    let here = traced(&turned, &[[0.0, 8.0]], 550.0)[0];
    let height = distance(here.chief_mm, [0.0; 2]);
    assert!((height - right.chief_ray_height_mm).abs() < 1e-9, "{here:?}, {right:?}");
    let solid = here.projected_solid_angle_sr / right.projected_solid_angle_sr;
    assert!((solid - 1.0).abs() < 1e-4, "{solid}");
    let light = here.relative_illumination - right.relative_illumination;
    assert!(light.abs() < 1e-4, "{light}");
    let falls = 1.0 - right.relative_illumination;
    assert!(falls.abs() > 1e-2, "{falls}: too little to tell");
    assert!((here.spot_rms_mm / right.spot_rms_mm - 1.0).abs() < 2e-3, "{here:?}, {right:?}");
    // The same field point turned about the axis: 8° at the azimuth 30°.
    let tangent = 8.0_f64.to_radians().tan();
    let place = [0.5 * tangent, 0.75_f64.sqrt() * tangent].map(|t| t.atan().to_degrees());
    let other = traced(&turned, &[place], 550.0)[0];
    assert!((distance(other.chief_mm, [0.0; 2]) - height).abs() < 1e-9);
    assert!((other.relative_illumination - here.relative_illumination).abs() < 1e-4);
}

/// A cylinder lens 30 mm behind the stop, 90 mm in front of the image, in thin-lens optics: a
/// chief ray of slope t lands at 30t + 90(t − 30t·φ), with another power φ in x and y.
#[test]
fn the_linear_map_of_a_cylinder_lens() {
    let text = "RDM; EPD 1; DIM M; WL 587.5618; YAN 0; SO 0 1e13\nS 0 30; STO\n\
                S 0 1e-6 517.642; CYL; RDX 50\nS 200 90\nSI 0 0";
    let system = system(text);
    let map = Map::of(&system).unwrap();
    let (front, rear) = (0.517 / 50.0, -0.517 / 200.0);
    let lands = |power: f64| 30.0 + 90.0 * (1.0 - 30.0 * power);
    assert!((map.slopes_mm[0][0] - lands(front + rear)).abs() < 1e-5, "{map:?}");
    assert!((map.slopes_mm[1][1] - lands(rear)).abs() < 1e-5, "{map:?}");
    assert!(map.slopes_mm[0][1].abs() < 1e-9 && map.slopes_mm[1][0].abs() < 1e-9);
    assert!((system.efl_x_mm().unwrap() * (front + rear) - 1.0).abs() < 1e-6);
    assert!((system.paraxial.efl_mm * rear - 1.0).abs() < 1e-9);
}

/// The keys of a TOML table give the same lens as the `.seq` file.
#[test]
fn tilts_in_toml() {
    let head = "format = 'camrig-prescription/1'\nwavelengths_nm = [587.5618]\nfields_deg = [0.0]\n\
                [aperture]\nentrance_pupil_mm = 4.0\n";
    let toml = |surfaces: &str| {
        let lens = toml::read(&format!("{head}{surfaces}"), &Catalogue::default()).unwrap();
        System::new(lens, Conditions::default()).unwrap()
    };
    let table = toml(
        "[[surface]]\nradius_mm = 60.0\nthickness_mm = 4.0\nglass = '1.62:60.3'\nstop = true\n\
         tilt_deg = [-2.5, 1.5, 4.0]\ndecentre_mm = [0.3, -0.5, 0.1]\nafter = 'return'\n\
         aperture_radius_mm = 3.0\n[[surface]]\nradius_mm = -80.0\n\
         biconic = { radius_mm = -70.0 }\n\
         thickness_mm = 30.0\n[[surface]]\nthickness_mm = -20.0\nglass = 'mirror'\n\
         tilt_deg = [-40.0, 0.0, 0.0]\nafter = 'bend'\n",
    );
    let commands = system(
        "RDM; EPD 4; DIM M; WL 587.5618; YAN 0; SO 0 1e13\nS 60 4 1.62:60.3; STO; CIR 3\n\
         XDE 0.3; YDE -0.5; ZDE 0.1; ADE 2.5; BDE -1.5; CDE 4.0; DAR\nS -80 30; AAS; RDX -70\n\
         S 0 -20 REFL; ADE 40; BEN\nSI 0 0",
    );
    assert_eq!(table.prescription.surfaces, commands.prescription.surfaces);
    let field = [[1.0, -2.0]];
    assert_eq!(traced(&table, &field, 587.5618), traced(&commands, &field, 587.5618));
}
