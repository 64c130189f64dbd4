//! What a `.zmx` file says, what of it is refused, and what is told.

use camrig_base::Result;
use camrig_lens::{Catalogue, Conditions, Prescription, System, characterise, field};
use camrig_lens_files::zmx::{read, read_configuration};
use camrig_prescription::{Aperture, Clip, Form, Pose};

/// A plano-convex lens, curvature 0.025, of N-BK7 (n_d 1.51680), with words replaced.
fn lens(changes: &[(&str, &str)]) -> Result<Prescription> {
    read(&lens_text(changes), &Catalogue::default())
}

fn lens_text(changes: &[(&str, &str)]) -> String {
    let mut text = "MODE SEQ\nUNIT MM\nENPD 6\nGCAT SCHOTT\nFTYP 0 0 2 1 0 0 0\nXFLN 0 0\n\
                    YFLN 0 4\nWAVM 1 0.5875618 1\nWAVM 2 0.92 1\nPWAV 1\nSURF 0\n  DISZ INFINITY\n\
                    SURF 1\n  STOP\n  CURV 0.025\n  DISZ 4\n  GLAS N-BK7 0 0 0 0 0 0 0 0 0 0\n\
                    SURF 2\n  DISZ 75\nSURF 3\n  DISZ 0\n"
        .to_owned();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    text
}

fn system(changes: &[(&str, &str)]) -> System {
    System::new(lens(changes).unwrap(), Conditions::default()).unwrap()
}

#[test]
fn flags_that_change_the_system_are_refused() {
    for (from, to, word) in [
        ("FTYP 0 0 2 1 0 0 0", "FTYP 0 0 2 1 0 0 1", "afocal"),
        ("FTYP 0 0", "FTYP 5 0", "fields of kind 5"),
        ("ENPD 6", "OBNA 0.1 1", "cone angle"),
        ("ENPD 6", "FNUM 5 2", "FNUM 5 2"),
    ] {
        let error = lens(&[(from, to)]).unwrap_err().to_string();
        assert!(error.contains(word), "{to}: {error}");
    }
}

#[test]
fn fields_of_every_kind() {
    let angles = |kind: &str| {
        let kind = format!("FTYP {kind} 0");
        system(&[("FTYP 0 0", &kind), ("XFLN 0 0", "XFLN 0 3")]).fields_deg().unwrap()[1]
    };
    // acos(cos 3° cos 4°), and the direction with tangents tan 3°, tan 4°.
    assert!((angles("4") - 4.998_537).abs() < 1e-6);
    assert!((angles("0") - 4.994_169).abs() < 1e-6, "{}", angles("0"));
}

/// The image curves back so much that the search from the paraxial field loses its ray.
#[test]
fn a_real_image_height_near_the_largest() {
    let system = system(&[
        ("ENPD 6", "FNUM 9 0"),
        ("FTYP 0 0", "FTYP 3 0"),
        ("YFLN 0 4", "YFLN 0 12.8"),
        (
            "  CURV 0.025\n  DISZ 4\n  GLAS N-BK7 0 0 0 0 0 0 0 0 0 0\nSURF 2\n  DISZ 75\nSURF 3",
            "  DISZ 12\nSURF 2\n  DISZ 6\n  GLAS N-BK7\nSURF 3\n  CURV -0.08\n  DISZ 22\nSURF 4",
        ),
    ]);
    let fields = system.fields_deg().unwrap();
    let points = characterise::field_points(&system, &fields, &[587.5618]).unwrap();
    assert!((points[1].chief_ray_height_mm - 12.8).abs() < 1e-9, "{}", points[1].field_deg);
}

#[test]
fn glasses_with_offsets_and_partial_dispersions() {
    let plain = "GLAS N-BK7 0 0 0 0 0 0 0 0 0 0";
    let moved = system(&[(plain, "GLAS N-BK7 4 0 1.5168 64.17 0 0 0 0 0.01 -0.5")]);
    assert!((moved.paraxial.efl_mm - 40.0 / 0.5268).abs() < 1e-3);
    assert!(moved.prescription.notes[0].contains("offsets"));
    let model = |dpgf| {
        system(&[
            (plain, &format!("GLAS ___BLANK 1 0 1.713 53.83 {dpgf} 0 0 0 0 0")[..]),
            ("0.5875618", "0.4358343"),
        ])
    };
    let (without, with) = (model("0").paraxial.efl_mm, model("-0.0083").paraxial.efl_mm);
    // N-LAK8 by Schott's coefficients: 54.8368.
    assert!((with - 54.8368).abs() < 2e-3 && with - without > 5e-3, "{with} {without}");
}

#[test]
fn ray_aiming_that_is_off_is_said() {
    let with = |line: &str| lens(&[("PWAV 1", &format!("PWAV 1\n{line}"))]).unwrap().notes;
    assert!(with("RAIM 0 0 1 1 0 0 0 0 0 1")[0].contains("ray aiming is off"));
    for on in ["RAIM 0 1 1 1 0 0", "RAIM 0 2 1 1 0 1 0 0 0"] {
        assert!(with(on).is_empty(), "{on}");
    }
}

#[test]
fn the_configuration_that_is_taken_is_said() {
    let lens = lens(&[("PWAV 1", "PWAV 1\nMNUM 3 2")]).unwrap();
    assert!(lens.notes[0].contains("configuration 2 of 3"), "{:?}", lens.notes);
    for one in ["PWAV 1\nMNUM 1 1", "PWAV 1\nMNUM 1"] {
        assert!(self::lens(&[("PWAV 1", one)]).unwrap().notes.is_empty());
    }
}

/// Thickness 75 of the last space and the curvature of the lens per configuration.
const SET: &str = "PWAV 1\nMNUM 2 1\n\
    LTTL 0 1 0 0 0 0 1 1 1 0 0 \"far\" 0\nLTTL 0 2 0 0 0 0 1 1 1 0 0 \"near by\" 0\n\
    THIC 2 1 75 0 0 0 1 1 1 0 0 \"\" 0\nTHIC 2 2 80 0 0 0 1 1 1 0 0 \"\" 0\n\
    CRVT 1 1 0.025 0 0 0 1 1 1 0 0 \"\" 0\nCRVT 1 2 0.02 0 0 0 1 1 1 0 0 \"\" 0\n";

#[test]
fn a_configuration_is_chosen_by_number_or_title() {
    let text = |more: &str| lens_text(&[("PWAV 1", &format!("{SET}{more}")[..])]);
    let read = |more: &str, name| read_configuration(&text(more), &Catalogue::default(), name);
    let active = read("", None).unwrap();
    assert_eq!(active, read("", Some("far")).unwrap());
    for name in ["2", "Near By"] {
        let lens = read("", Some(name)).unwrap();
        let (last, first) = (&lens.surfaces[1], &lens.surfaces[0]);
        assert_eq!((last.thickness, first.curvature), (80.0, 0.02));
        let note = &lens.notes[0];
        assert!(note.contains("configuration 2 of 2") && note.contains("THIC 2 = 80"), "{note}");
        assert!(!note.contains("LTTL"), "{note}");
    }
    for (more, name, words) in [
        ("", "3", "1 \"far\", 2 \"near by\""),
        ("APER 0 1 6 0 0 0\nAPER 0 2 3 0 0 0\n", "2", "APER 0"),
        ("GLSS 1 2 0 0 0 0 1 1 1 0 0 \"N-SF11\" 0\n", "2", "GLSS 1"),
    ] {
        let error = read(more, Some(name)).unwrap_err().to_string();
        assert!(error.contains(words), "{more}: {error}");
    }
    // The same value in both is no difference; one that says nothing about the second is.
    assert!(read("APER 0 1 6 0 0 0\nAPER 0 2 6 0 0 0\n", Some("2")).is_ok());
    let bare = lens_text(&[("PWAV 1", "PWAV 1\nMNUM 2 1")]);
    let error = read_configuration(&bare, &Catalogue::default(), Some("2")).unwrap_err();
    assert!(error.to_string().contains("no values for it"), "{error}");
}

/// Files of 2004 do not say which configuration is active: the surfaces do.
#[test]
fn the_active_configuration_is_the_one_whose_values_the_surfaces_have() {
    let read = |number: &str, thickness: &str, name| {
        let set = SET.replace("MNUM 2 1", number).replace("CRVT 1 2 0.02 ", "CRVT 1 2 0.025 ");
        let text = lens_text(&[("PWAV 1", &set), ("  DISZ 75", thickness)]);
        read_configuration(&text, &Catalogue::default(), name)
    };
    for (thickness, active, other) in [("  DISZ 75", 1, "2"), ("  DISZ 80", 2, "1")] {
        let lens = read("MNUM 2", thickness, None).unwrap();
        let words = format!("configuration {active} of 2 is taken: it is the active one, whose");
        assert!(lens.notes[0].starts_with(&words), "{:?}", lens.notes);
        let lens = read("MNUM 2", thickness, Some(other)).unwrap();
        assert_eq!(lens.surfaces[1].thickness, 155.0 - thickness[7..].parse::<f64>().unwrap());
    }
    let note = &read("MNUM 2 1", "  DISZ 90", None).unwrap().notes[0];
    assert!(note.contains("the surfaces have other values"), "{note}");
    let error = read("MNUM 2 1", "  DISZ 90", Some("2")).unwrap_err().to_string();
    assert!(error.contains("do not have the values of the active one (1)"), "{error}");
}

#[test]
fn a_solve_keeps_another_configuration_from_being_set() {
    let solved = |line: &str| {
        let text = lens_text(&[("PWAV 1", SET), ("  DISZ 75", &format!("  DISZ 75\n{line}")[..])]);
        [None, Some("2")].map(|name| read_configuration(&text, &Catalogue::default(), name))
    };
    let [active, other] = solved("  MAZH 0 0");
    assert!(active.is_ok());
    let error = other.unwrap_err().to_string();
    assert!(error.contains("MAZH") && error.contains("line 28"), "{error}");
    assert!(solved("  COMM rear")[1].is_ok());
    assert!(solved("  CURV 0 4 0 0 0")[1].is_err());
}

/// B270 is tabulated from 436 to 656 nm.
#[test]
fn wavelengths_without_data_are_left_out_and_said() {
    let system =
        system(&[("N-BK7", "B270"), ("PWAV 1", "PWAV 2"), ("FTYP 0 0 2 1", "FTYP 0 0 2 2")]);
    let lens = &system.prescription;
    assert_eq!((&lens.wavelengths_nm[..], lens.reference_nm), (&[587.5618][..], 587.5618));
    assert!(lens.notes[0].contains("920 nm is left out"), "{:?}", lens.notes);
    assert!(lens.notes[1].contains("reference wavelength is 587.5618"), "{:?}", lens.notes);
    let only = self::lens(&[("N-BK7", "B270"), ("0.5875618", "0.92")]).unwrap();
    let error = System::new(only, Conditions::default()).unwrap_err().to_string();
    assert!(error.contains("920 nm is outside"), "{error}");
}

/// A lens of every kind of surface, told twice: in millimetres and in inches.
#[test]
fn surfaces_of_other_shapes_are_read_in_the_unit_of_the_file() {
    let shapes = |scale: f64| {
        let mm = |v: f64| v / scale;
        let text = format!(
            "UNIT {}\nENPD {}\nYFLN 0\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  DISZ INFINITY\n\
             SURF 1\n  STOP\n  TYPE QED_TYPE\n  CURV {}\n  CONI -0.5\n  DISZ {}\n  XDAT 1 1 0\n  \
             XDAT 2 2\n  XDAT 3 {}\n  XDAT 4 {}\n  XDAT 5 {}\n  GLAS N-BK7 0 0\n\
             SURF 2\n  TYPE BICONICX\n  CURV {}\n  CONI 0.3\n  PARM 1 {}\n  PARM 2 -2\n  DISZ {}\n\
             SURF 3\n  TYPE TOROIDAL\n  CURV {}\n  PARM 1 {}\n  PARM 2 {}\n  PARM 3 {}\n  \
             XDAT 1 0\n  XDAT 2 100\n  DISZ 0\n\
             SURF 4\n  TYPE COORDBRK\n  DISZ {}\n  PARM 1 {}\n  PARM 3 12\n  PARM 6 1\n\
             SURF 5\n  TYPE PARAXIAL\n  PARM 1 {}\n  DISZ {}\nSURF 6\n  DISZ 0\n",
            if scale == 1.0 { "MM" } else { "IN" },
            mm(5.0),
            0.02 * scale,
            mm(4.0),
            mm(8.0),
            mm(0.05),
            mm(-0.01),
            -0.01 * scale,
            mm(80.0),
            mm(7.0),
            0.005 * scale,
            mm(60.0),
            1e-4 * scale,
            1e-6 * scale.powi(3),
            mm(3.0),
            mm(0.4),
            mm(90.0),
            mm(85.0),
        );
        read(&text, &Catalogue::default()).unwrap()
    };
    let (lens, inches) = (shapes(1.0), shapes(25.4));
    let Form::Forbes(forbes) = &lens.surfaces[0].form else { panic!("{lens:?}") };
    assert_eq!((forbes.radius, &forbes.coefficients[..]), (8.0, &[0.05, -0.01][..]));
    assert_eq!(lens.surfaces[1].form, Form::Biconic { curvature: 1.0 / 80.0, conic: -2.0 });
    assert_eq!(lens.surfaces[2].form, Form::Toroid { curvature: 1.0 / 60.0 });
    assert_eq!(lens.surfaces[2].even[..2], [1e-4, 1e-6]);
    assert_eq!((&lens.surfaces[3].form, lens.surfaces[3].thickness), (&Form::Break, 3.0));
    let frame = lens.surfaces[3].entry.unwrap();
    assert_eq!(frame, Pose::tilted_then_decentred([0.4, 0.0, 0.0], [12.0, 0.0, 0.0]));
    assert_eq!(lens.surfaces[4].form, Form::Ideal { focal_mm: 90.0 });
    let landing = |lens| {
        let system = System::new(lens, Conditions::default()).unwrap();
        let map = field::Map::of(&system).unwrap();
        let points = field::points(&system, &map, &[[2.0, 3.0]], &[550.0]);
        points.unwrap()[0].chief_mm
    };
    let (a, b) = (landing(lens), landing(inches));
    assert!((a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9, "{a:?} {b:?}");
}

#[test]
fn shapes_that_are_not_known_are_refused_with_type_and_line() {
    for (change, word) in [
        ("  TYPE XPOLYNOM\n", "type XPOLYNOM"),
        ("  TYPE TOROIDAL\n  XDAT 1 3\n", "Zernike"),
        ("  TYPE QED_TYPE\n  XDAT 1 2\n", "Q-type asphere of type 2 (XDAT 1)"),
        ("  TYPE QED_TYPE\n  PARM 2 1\n", "PARM"),
        (
            "  TYPE QED_TYPE\n  XDAT 1 1\n  XDAT 2 1\n  XDAT 3 0\n",
            "normalisation radius 0 (XDAT 3)",
        ),
        ("  TYPE PARAXIAL\n  PARM 1 50\n", "plane"),
        ("  UDAP 1 1 0\n", "UDAP"),
        ("  SCBD 0 0 0 1 0 0\n", "SCBD"),
    ] {
        let stop = format!("  STOP\n{change}");
        let error = lens(&[("  STOP\n", &stop)]).unwrap_err().to_string();
        let placed = error.contains("line") || error.contains("surface 1");
        assert!(error.contains(word) && placed, "{change}: {error}");
    }
}

/// Thorlabs ASL5040-UV, of silica for 405 nm: the maker gives a focal length of 40 mm and a
/// numerical aperture of 0.65. It focuses with a Q-bfs departure along the normal of the conic;
/// with other polynomials, or none, some rays pass the focus in 0.1 mm and more.
#[test]
fn a_q_type_asphere_focuses() {
    let text = "UNIT MM\nENPD 45.72\nFTYP 0 0 1 1\nXFLN 0\nYFLN 0\nWAVM 1 0.405 1\nPWAV 1\n\
                SURF 0\n  DISZ INFINITY\nSURF 1\n  STOP\n  TYPE QED_TYPE\n  \
                CURV 5.756078762782423225E-02 0 0 0 0 \"\"\n  CONI -0.67609120640407927\n  \
                XDAT 1 0\n  XDAT 2 6\n  XDAT 3 27\n  XDAT 4 -8.148370167576E-01\n  \
                XDAT 5 -3.2311E-01\n  XDAT 6 1.0591E-01\n  XDAT 7 -5.058E-02\n  \
                XDAT 8 9.87E-03\n  XDAT 9 -2.2E-03\n  DISZ 29.85\n  GLAS SILICA\nSURF 2\n  \
                DISZ 19.687453064998852\nSURF 3\n  DISZ 0\n";
    let lens = read(text, &Catalogue::default()).unwrap();
    let system = System::new(lens, Conditions::default()).unwrap();
    assert!((system.paraxial.efl_mm - 40.0).abs() < 0.01, "{}", system.paraxial.efl_mm);
    let point = characterise::field_points(&system, &[0.0], &[405.0]).unwrap()[0];
    assert!(point.spot_rms_mm < 5e-4, "{point:?}");
}

/// A plane in air is only drawn with its semi-diameter, behind a mirror too; where light comes from
/// a glass, by a mirror or not, it is an aperture.
#[test]
fn a_plane_in_air_behind_a_mirror_is_no_aperture() {
    let behind = "  DISZ -9\n  DIAM 4 1 0\n";
    let in_air = format!(
        "SURF 2\n  DISZ 10\nSURF 3\n  DISZ -20\n  GLAS MIRROR\nSURF 4\n{behind}SURF 5\n  DISZ 0\n"
    );
    let in_glass = format!("SURF 2\n  DISZ -4\n  GLAS MIRROR\nSURF 3\n{behind}SURF 4\n  DISZ 0\n");
    for (surfaces, clips) in [(in_air, &[][..]), (in_glass, &[Clip::circle(4.0)])] {
        let lens = lens(&[("SURF 2\n  DISZ 75\nSURF 3\n  DISZ 0\n", &surfaces)]).unwrap();
        assert_eq!(lens.surfaces.last().unwrap().clips, clips, "{surfaces}");
    }
}

#[test]
fn air_may_be_named() {
    for surface in ["SURF 0\n", "SURF 2\n"] {
        let named = lens(&[(surface, &format!("{surface}  GLAS AIR 0 0 1 0\n"))]).unwrap();
        assert_eq!(named, lens(&[]).unwrap(), "{surface}");
    }
}

#[test]
fn a_stop_that_is_no_centred_surface_is_refused() {
    for change in ["  TYPE COORDBRK\n", "  OBDC 1 0\n  FLAP 0 5 0\n"] {
        let error = lens(&[("  STOP\n", &format!("  STOP\n{change}"))]).unwrap_err().to_string();
        assert!(error.contains("the stop is decentred") && error.contains("surface 1"), "{error}");
    }
}

/// A break without tilt inside a glass is no surface.
#[test]
fn a_coordinate_break_stays_in_its_medium() {
    let split = "  DISZ 1.5\n  GLAS N-BK7 0 0\nSURF 2\n  TYPE COORDBRK\n  DISZ 2.5\n  \
                 PARM 6 1\nSURF 3\n  DISZ 75\nSURF 4\n  DISZ 0\n";
    let text = lens_text(&[]);
    let (head, _) = text.split_once("  DISZ 4\n").unwrap();
    let broken = read(&format!("{head}{split}"), &Catalogue::default()).unwrap();
    assert_eq!(broken.asymmetry(), None);
    let broken = System::new(broken, Conditions::default()).unwrap();
    let whole = system(&[]);
    assert!((broken.paraxial.efl_mm - whole.paraxial.efl_mm).abs() < 1e-12);
    let height = |s: &System| characterise::field_points(s, &[4.0], &[587.5618]).unwrap()[0];
    let (a, b) = (height(&broken).chief_ray_height_mm, height(&whole).chief_ray_height_mm);
    assert!((a - b).abs() < 1e-12);
}

/// Telecentric by its flag: chief rays parallel to the axis, a cone of the given aperture. An ideal
/// lens of f = 50 at twice its focal length images with −1 exactly: the chief ray of the height 4
/// lands at 4 with the slope 4/50; the cone of 0.1 makes the solid angle π·0.1² on the axis and
/// cos⁴ of the chief ray's angle times that beside it.
#[test]
fn telecentric_object_space() {
    let text = "UNIT MM\nOBNA 0.1 0\nFTYP 1 1 2 1 0 0 0\nXFLN 0 0\nYFLN 0 4\nWAVM 1 0.55 1\n\
                PWAV 1\nSURF 0\n  DISZ 100\nSURF 1\n  TYPE PARAXIAL\n  PARM 1 50\n  DISZ 50\n\
                SURF 2\n  STOP\n  DISZ 50\nSURF 3\n  DISZ 0\n";
    let make = |text: &str| {
        let lens = read(text, &Catalogue::default()).unwrap();
        System::new(lens, Conditions::default())
    };
    // The stop in the rear focus is telecentric of itself.
    let by_stop = text.replace("FTYP 1 1", "FTYP 1 0");
    for text in [text, &by_stop] {
        let system = make(text).unwrap();
        assert!(system.paraxial.telecentric);
        let fields = system.fields_deg().unwrap();
        let points = characterise::field_points(&system, &fields, &[550.0]).unwrap();
        for (point, height) in points.iter().zip([0.0, 4.0]) {
            assert!((point.chief_ray_height_mm - height).abs() < 1e-9, "{point:?}");
            assert!((point.distortion_percent).abs() < 1e-9);
            assert!((point.opd_rms_waves).abs() < 1e-6 && point.spot_rms_mm < 1e-9, "{point:?}");
            let solid = point.projected_solid_angle_sr / (std::f64::consts::PI * 0.01);
            let cosine_4 = (1.0 + (height / 50.0_f64).powi(2)).powi(-2);
            assert!((solid - cosine_4).abs() < 1e-3, "{solid} instead of {cosine_4}");
        }
        // N = 1/(2u')/(1 + |m|), u' the tangent of the cone.
        let slope = 0.1 / (1.0_f64 - 0.01).sqrt();
        assert!((system.f_number() - 0.25 / slope).abs() < 1e-12, "{}", system.f_number());
        assert!((system.paraxial.pupil_magnification() - 1.0).abs() < 1e-12);
    }
    let error = make(&text.replace("DISZ 100", "DISZ INFINITY")).unwrap_err().to_string();
    assert!(error.contains("telecentric"), "{error}");
    let error = make(&text.replace("OBNA 0.1 0", "ENPD 4")).unwrap_err().to_string();
    assert!(error.contains("no entrance pupil"), "{error}");
}

/// A lens with what public files hold beside: lines of the system, of a surface, and of editors.
fn told(system: &str, surface: &str, behind: &str) -> Result<Vec<String>> {
    let text = format!(
        "VERS 171115\nMODE SEQ\nNAME a lens\nPFIL 0 0 0\nLANG 0\nUNIT MM X W X CM MR CPMM\n\
         ENPD 6\nENVD 20 1 0\nGFAC 0 0\nGCAT SCHOTT\nRAIM 0 2 1 1 0 0 0 0 0\n\
         PUSH 0 0 0 0 0 0\nSDMA 0 1 0\nOMMA 1 1\nFTYP 0 0 1 1 0 0 0\nROPD 2\nHYPR 0\nPICB 1\n\
         XFLN 0\nYFLN 0\nFWGN 1\nVDXN 0\nVDYN 0\nVCXN 0\nVCYN 0\nVANN 0\nWAVM 1 0.55 1\nPWAV 1\n\
         POLS 1 0 1 0 0 1 0\nGLRS 1 0\nGSTD 0 100 100 100\nNSCD 100 500 0\n\
         COFN QF \"COATING.DAT\"\n{system}SURF 0\n  DISZ INFINITY\nSURF 1\n  STOP\n  COMM front\n  \
         CURV 0.025 0 0 0 0 \"\"\n  HIDE 0 0\n  MIRR 2 0\n  SLAB 1\n  DISZ 4\n  GLAS N-BK7 0 0\n  \
         POPS 0 0\n{surface}SURF 2\n  DISZ 75\nSURF 3\n  DISZ 0\n\
         TOL TOFF 0 0 0\nMNUM 1 1\nMOFF 0 1 \"\" 0\nEFFL 0 2 0 0 0 0 6 2\n{behind}"
    );
    Ok(read(&text, &Catalogue::default())?.notes)
}

fn notes(system: &str, surface: &str, behind: &str) -> Vec<String> {
    told(system, surface, behind).unwrap()
}

#[test]
fn turned_pupils_and_surfaces_that_are_left_out_are_refused() {
    for (system, surface, line, words) in [
        ("VANN 0 30\n", "", "line 34", "a vignetted pupil that is turned (VANN)"),
        ("", "  IGNR 1\n", "line 46", "a surface that its program leaves out (IGNR)"),
    ] {
        let error = told(system, surface, "").unwrap_err().to_string();
        assert!(error.contains(line) && error.contains(words), "{error} for {words}");
    }
    assert_eq!(notes("", "  IGNR 0\n", ""), [""; 0]);
}

#[test]
fn what_changes_nothing_is_not_told() {
    assert_eq!(notes("", "", ""), [""; 0]);
}

#[test]
fn keywords_of_which_nothing_is_known_are_told_once_with_their_line() {
    for (system, surface, words) in [
        ("ABCD 1\nABCD 2\n", "", "line 34: ABCD of the system is not known"),
        ("HYPR 1\n", "", "line 34: HYPR of the system is not known"),
        ("", "  WXYZ 1\n  WXYZ 2\n", "line 46: WXYZ of a surface is not known"),
        ("GFAC 1 1.5\n", "", "line 34: GFAC is ignored"),
        ("ENVD 40 1 1\n", "", "line 34: temperature and pressure are ignored"),
        ("RAIM 0 0 1 1\n", "", "line 34: ray aiming is off"),
    ] {
        let notes = notes(system, surface, "");
        assert!(notes.len() == 1 && notes[0].starts_with(words), "{notes:?} for {words}");
    }
    // Operands of a merit function have any name.
    assert_eq!(notes("", "", "QXYZ 1 2 0\n"), [""; 0]);
}

#[test]
fn a_missing_unit_and_fields_off_the_plane_are_told() {
    let text = |unit: &str, x: f64| {
        format!(
            "{unit}ENPD 6\nFTYP 0 0 1 1\nXFLN {x}\nYFLN 0\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  \
             DISZ INFINITY\nSURF 1\n  STOP\n  CURV 0.025\n  DISZ 4\n  GLAS 1.5:60\nSURF 2\n  \
             DISZ 75\nSURF 3\n  DISZ 0\n"
        )
    };
    let notes = |text: &str| read(text, &Catalogue::default()).unwrap().notes;
    assert_eq!(notes(&text("UNIT MM\n", 0.0)), [""; 0]);
    assert!(notes(&text("", 0.0))[0].contains("millimetres are assumed"));
    assert!(notes(&text("UNIT MM\n", 3.0))[0].contains("fields off the y axis"));
}

/// Files of 2004 have the vignetting of three fields in an older form, too; it counts where it is
/// alone.
#[test]
fn the_older_form_of_vignetting_counts_where_it_is_alone() {
    let read = |lines: &str| {
        let text = format!(
            "UNIT MM\nENPD 6\nFTYP 0 0 2 1\nXFLN 0 0\nYFLN 0 5\n{lines}WAVM 1 0.55 1\nPWAV 1\n\
             SURF 0\n  DISZ INFINITY\nSURF 1\n  STOP\n  CURV 0.025\n  DISZ 4\n  GLAS 1.5:60\n\
             SURF 2\n  DISZ 75\nSURF 3\n  DISZ 0\n"
        );
        read(&text, &Catalogue::default()).unwrap().fields.vignetting
    };
    let (old, new) = ("ZVCY 0 0.2\n", "VCYN 0 0.3\n");
    assert_eq!(read(old)[1], [0.0, 0.0, 0.2, 0.2]);
    for both in [format!("{old}{new}"), format!("{new}{old}")] {
        assert_eq!(read(&both)[1], [0.0, 0.0, 0.3, 0.3]);
    }
}

/// Web pages and editors strip blanks at the start of lines.
#[test]
fn a_file_without_indentation_is_the_same_lens() {
    let behind = "PWAV 1\nMNUM 1 1\nTOL TOFF 0 0 0\nEFFL 0 2 0 0 0 0 6 2\n";
    let text = lens_text(&[("  CURV 0.025", "  TYPE EVENASPH\n  PARM 2 1e-5\n  CURV 0.025")]);
    let stripped: Vec<&str> = text.lines().map(str::trim_start).collect();
    let read = |text: &str| read(text, &Catalogue::default()).unwrap();
    let right = read(&format!("{text}{behind}"));
    assert_eq!(right.surfaces[0].even, [0.0, 1e-5]);
    assert_eq!(read(&format!("{}\n{behind}", stripped.join("\n"))), right);
    // The other way round: the unit counts where it is indented.
    let inches = |unit: &str| read(&text.replace("UNIT MM", unit));
    assert_eq!(inches("  UNIT IN"), inches("UNIT IN"));
}

#[test]
fn a_curved_object_and_a_mirror_in_its_place_are_refused() {
    for (object, words) in [
        ("SURF 0\n  DISZ 500\n  CURV 0.002 0\n", "the object surface is curved"),
        ("SURF 0\n  DISZ 500\n  GLAS MIRROR 0 0\n", "the object is a mirror"),
    ] {
        let error = lens(&[("SURF 0\n  DISZ INFINITY\n", object)]).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("line 1"), "{error}");
    }
    let far = "SURF 0\n  DISZ INFINITY\n  CURV 0.002 0\n";
    assert!(lens(&[("SURF 0\n  DISZ INFINITY\n", far)]).is_ok());
}

#[test]
fn numbers_of_fields_and_wavelengths_that_are_not_given() {
    let lens = lens(&[
        ("FTYP 0 0 2 1 0 0 0", "FTYP 0"),
        ("XFLN 0 0", "XFLN 0 0 0 0 0 0 0"),
        ("YFLN 0 4", "YFLN 0 1 2 3 4 0 0"),
    ])
    .unwrap();
    assert_eq!(lens.fields.values, [0.0, 1.0, 2.0, 3.0, 4.0]);
    assert_eq!(lens.wavelengths_nm, [587.5618, 920.0]);
    assert!(lens.notes[0].contains("all 2 are taken"), "{:?}", lens.notes);
}

/// The same pupil, told from other sides, makes the same apertures: a lens behind the stop, whose
/// fields lie on either side of the axes.
#[test]
fn vignetting_factors_have_the_sense_of_their_field() {
    let radius = |kind: &str, object: &str, fields: [f64; 2], factors: [f64; 4]| {
        let ([x, y], [dx, dy, cx, cy]) = (fields, factors);
        let text = format!(
            "UNIT MM\nENPD 4\nFTYP {kind} 0 2 1\nXFLN 0 {x}\nYFLN 0 {y}\nVDXN 0 {dx}\nVDYN 0 \
             {dy}\nVCXN 0.5 {cx}\nVCYN 0.5 {cy}\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  DISZ \
             {object}\nSURF 1\n  STOP\n  DISZ 10\nSURF 2\n  CURV 0.02\n  DISZ 3\n  GLAS 1.5:60\n\
             SURF 3\n  DISZ 90\nSURF 4\n  DISZ 0\n"
        );
        let lens = read(&text, &Catalogue::default()).unwrap();
        let system = System::new(lens, Conditions::default()).unwrap();
        let [_, pupil] = system.vignetted[..] else { panic!("{:?}", system.vignetted) };
        [pupil.centre, pupil.half[0], pupil.half[1]]
    };
    let near = |a: [f64; 3], b: [f64; 3]| {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} {b:?}");
    };
    let far = |fields, factors| radius("0", "INFINITY", fields, factors);
    near(far([0.0, 10.0], [0.0, 0.1, 0.2, 0.3]), [0.1, 0.8, 0.7]);
    near(far([0.0, -10.0], [0.0, -0.1, 0.2, 0.3]), [0.1, 0.8, 0.7]);
    near(far([10.0, 0.0], [0.1, 0.0, 0.3, 0.2]), [0.1, 0.8, 0.7]);
    near(far([-10.0, 0.0], [-0.1, 0.0, 0.3, 0.2]), [0.1, 0.8, 0.7]);
    // An object above the axis sends light downwards; its image lies below.
    let high = |kind, y, dy| radius(kind, "50", [0.0, y], [0.0, dy, 0.2, 0.3]);
    let steep = 8.0_f64.atan2(50.0).to_degrees();
    near(high("0", steep, 0.1), [0.1, 0.8, 0.7]);
    near(high("1", 8.0, -0.1), [0.1, 0.8, 0.7]);
    near(high("1", -8.0, 0.1), [0.1, 0.8, 0.7]);
}

/// A stop 30 mm in front of a lens, its pupil cut to an ellipse: relative illumination at 10° by an
/// independent tracer.
#[test]
fn vignetting_factors_make_an_ellipse_of_the_pupil() {
    for (decentre, compression, right) in
        [(0.0, 0.0, 1.0535), (0.3, 0.3, 0.7534), (-0.3, 0.3, 0.7193), (0.0, 0.4, 0.6278)]
    {
        let text = format!(
            "UNIT MM\nENPD 10\nFTYP 0 0 2 1\nXFLN 0 0\nYFLN 0 10\nVDYN 0 {decentre}\nVCYN 0 \
             {compression}\nWAVM 1 0.5875618 1\nPWAV 1\nSURF 0\n  DISZ INFINITY\nSURF 1\n  STOP\n  \
             DISZ 30\nSURF 2\n  CURV 0.01781641961231471\n  DISZ 7\n  GLAS ___BLANK 1 0 1.78472 \
             25.68 0 0 0 0 0 0\nSURF 3\n  CURV -0.01703664582516994\n  DISZ 30\nSURF 4\n  DISZ 0\n"
        );
        let lens = read(&text, &Catalogue::default()).unwrap();
        let system = System::new(lens, Conditions::default()).unwrap();
        let points = characterise::field_points(&system, &[0.0, 10.0], &[587.5618]).unwrap();
        let found = points[1].relative_illumination;
        assert!((found - right).abs() < 1e-4, "{decentre} {compression}: {found}");
    }
}

/// At a compression of 1 and more the rims of the pupil meet and cross.
#[test]
fn a_field_without_a_pupil_is_left_out_and_told() {
    let system = |compressions: &str| {
        let text = format!(
            "UNIT MM\nENPD 4\nFTYP 0 0 3 1\nXFLN 0 0 0\nYFLN 0 5 10\nVCYN {compressions}\nWAVM 1 \
             0.55 1\nPWAV 1\nSURF 0\n  DISZ INFINITY\nSURF 1\n  STOP\n  DISZ 10\nSURF 2\n  CURV \
             0.02\n  DISZ 3\n  GLAS 1.5:60\nSURF 3\n  DISZ 90\nSURF 4\n  DISZ 0\n"
        );
        System::new(read(&text, &Catalogue::default()).unwrap(), Conditions::default())
    };
    for compression in ["1", "1.2"] {
        let system = system(&format!("0 0.5 {compression}")).unwrap();
        assert_eq!(system.prescription.fields.values, [0.0, 5.0], "{compression}");
        let told = system.prescription.notes.join("\n");
        assert!(told.contains("the field 10° is left out, since no light"), "{told}");
    }
    let error = system("1.2 1.2 1.2").unwrap_err().to_string();
    assert!(error.contains("leave no pupil"), "{error}");
}

/// Through a flat port, an object in water is one in air at its distance over n; angles in water
/// grow by Snell's law.
#[test]
fn an_object_in_water_is_seen_through_a_flat_port() {
    let n = 1.3334;
    let object = |distance: f64, water: bool| {
        let glass = if water { "  GLAS ___BLANK 1 0 1.3334 0 0 0 0 0 0 0\n" } else { "" };
        let surfaces = format!(
            "SURF 0\n  DISZ {distance}\n{glass}SURF 1\n  DISZ 5\nSURF 2\n  STOP\n  CURV 0.025\n  \
             DISZ 4\n  GLAS N-BK7 0 0\nSURF 3\n  DISZ 75\nSURF 4\n  DISZ 0\n"
        );
        let text = lens_text(&[]);
        let head = &text[..text.find("SURF 0").unwrap()];
        let lens = read(&format!("{head}{surfaces}"), &Catalogue::default()).unwrap();
        System::new(lens, Conditions::default()).unwrap()
    };
    let (wet, dry) = (object(400.0, true), object(400.0 / n, false));
    let (p, q) = (&wet.paraxial, &dry.paraxial);
    assert!((p.efl_mm - q.efl_mm).abs() < 1e-12);
    assert!((p.magnification - q.magnification).abs() < 1e-12);
    assert!((p.image_distance_mm - q.image_distance_mm).abs() < 1e-9);
    assert!((wet.stop_radius_mm - dry.stop_radius_mm).abs() < 1e-12);
    let (wet, dry) = (object(1e10, true), object(1e10, false));
    let in_air = (n * 4.0_f64.to_radians().sin()).asin().to_degrees();
    let at = |system: &System, deg: f64| {
        characterise::field_points(system, &[deg], &[587.5618]).unwrap()[0]
    };
    let (a, b) = (at(&wet, 4.0), at(&dry, in_air));
    assert!((a.chief_ray_height_mm - b.chief_ray_height_mm).abs() < 1e-9, "{a:?} {b:?}");
    // Of grids of rays that differ: 128 cells across leave 3 % of the light in those of the rim.
    assert!((a.spot_rms_mm / b.spot_rms_mm - 1.0).abs() < 1e-3, "{a:?} {b:?}");
    assert!((a.opd_rms_waves / b.opd_rms_waves - 1.0).abs() < 1e-3, "{a:?} {b:?}");
    assert!(wet.prescription.notes.last().unwrap().contains("the object lies in"));
}

/// Behind a plane last surface, water leaves the power as it is and moves the image n times as far.
#[test]
fn an_image_in_water_is_told() {
    let n = 1.3334;
    let system = |glass: &str| {
        let text = lens_text(&[]);
        let head = &text[..text.find("SURF 0").unwrap()];
        let surfaces = format!(
            "SURF 0\n  DISZ INFINITY\nSURF 1\n  STOP\n  CURV 0.025\n  DISZ 4\n  GLAS N-BK7 0 0\n\
             SURF 2\n  DISZ 80\n{glass}SURF 3\n  DISZ 0\n"
        );
        let lens = read(&format!("{head}{surfaces}"), &Catalogue::default()).unwrap();
        System::new(lens, Conditions::default()).unwrap()
    };
    let (wet, dry) = (system(&format!("  GLAS ___BLANK 1 0 {n} 0 0 0 0 0 0 0\n")), system(""));
    assert!((wet.paraxial.efl_mm - dry.paraxial.efl_mm).abs() < 1e-12);
    assert!((wet.paraxial.bfl_mm - n * dry.paraxial.bfl_mm).abs() < 1e-9);
    let told = wet.prescription.notes.join("\n");
    assert!(told.contains("the image lies in") && told.contains("1 over the power"), "{told}");
    assert!(!dry.prescription.notes.join("\n").contains("lies in"));
}

#[test]
fn extended_aspheres_are_even_and_odd_ones() {
    let surface = |lines: &str| {
        let lines = format!("  CURV 0.025\n{lines}");
        lens(&[("  CURV 0.025\n", &lines)]).unwrap().surfaces[0].clone()
    };
    let even = surface("  TYPE EVENASPH\n  PARM 2 1e-5\n  PARM 3 2e-8\n");
    assert_eq!(surface("  TYPE XASPHERE\n  PARM 2 1e-5\n  PARM 3 2e-8\n").even, even.even);
    let both = surface("  TYPE XASPHERE\n  PARM 3 2e-8\n  XDAT 1 2\n  XDAT 2 1\n  XDAT 4 1e-5\n");
    assert_eq!(both.even, even.even);
    // Coefficients of (r/2)^i.
    let odd = surface("  TYPE XOSPHERE\n  XDAT 1 4\n  XDAT 2 2\n  XDAT 5 8e-5\n  XDAT 6 16e-5\n");
    assert_eq!((odd.odd, odd.even), (vec![0.0, 1e-5], vec![0.0, 1e-5]));
}

#[test]
fn parameters_that_a_type_does_not_have_are_told() {
    let note = |lines: &str| {
        let lines = format!("  CURV 0.025\n{lines}");
        lens(&[("  CURV 0.025\n", &lines)]).unwrap().notes.concat()
    };
    assert_eq!(note("  PARM 3 0\n"), "");
    assert!(note("  PARM 3 0.5\n").contains("PARM 3 = 0.5 of a STANDARD surface is not used"));
    let beyond = note("  TYPE XOSPHERE\n  XDAT 1 1\n  XDAT 2 1\n  XDAT 5 0.5\n");
    assert!(beyond.contains("XDAT 5 = 0.5 of a XOSPHERE surface"), "{beyond}");
}

#[test]
fn configurations_differ_in_diameters_parameters_and_fields() {
    let read = |editor: &str| {
        let changes = [("  CURV 0.025\n", "  CURV 0.025\n  TYPE EVENASPH\n  PARM 2 1e-5\n")];
        let text = lens_text(&changes).replace("ENPD 6", "FLOA");
        let text = text.replace("  DISZ 4\n", "  DISZ 4\n  DIAM 3 1 0 0 1\n");
        read_configuration(&format!("{text}MNUM 2 1\n{editor}"), &Catalogue::default(), Some("2"))
    };
    let lens = read(
        "SDIA 1 1 3\nSDIA 1 2 5\nPRAM 1 1 1e-5 0 2\nPRAM 1 2 2e-5 0 2\nYFIE 2 1 4\nYFIE 2 2 6\n\
         THIC 3 1 41\nTHIC 3 2 41\n",
    )
    .unwrap();
    assert_eq!(lens.aperture, Aperture::StopRadius(5.0));
    assert_eq!(lens.surfaces[0].even[1], 2e-5);
    assert_eq!(lens.fields.values, [0.0, 6.0]);
    // What the lines of the surface leave out: a diameter that follows from the light, zeros.
    let lens = read("SDIA 2 1 3\nSDIA 2 2 5\nPRAM 1 1 0 0 4\nPRAM 1 2 3e-9 0 4\n").unwrap();
    assert_eq!(lens.surfaces[0].even[3], 3e-9);
    let error = read("YFIE 3 1 4\nYFIE 3 2 6\n").unwrap_err().to_string();
    assert!(error.contains("YFIE 3, which is not known"), "{error}");
}

#[test]
fn fields_from_which_no_light_arrives_are_left_out_and_told() {
    let fields = |kind: &str, y: &str| {
        let kind = format!("FTYP {kind} 0 3 1");
        let lens = [("FTYP 0 0 2 1", &kind[..]), ("XFLN 0 0\nYFLN 0 4", y)];
        let lens = lens.map(|(from, to)| (from, to));
        let system = system(&[lens[0], lens[1], ("WAVM 2 0.92 1\n", "")]);
        let told = system.prescription.notes.iter().find(|note| note.contains("left out"));
        (system.prescription.fields.values, told.cloned().unwrap_or_default())
    };
    let (left, told) = fields("0", "XFLN 0 0 0\nYFLN 0 89.5 4");
    assert_eq!(left, [0.0, 4.0]);
    assert!(told.contains("the field 89.5° is left out"), "{told}");
    let (left, told) = fields("3", "XFLN 0 0 0\nYFLN 0 4 5000");
    assert_eq!(left, [0.0, 4.0]);
    assert!(told.contains("the field 5000 mm is left out"), "{told}");
}

#[test]
fn the_index_in_a_glass_line_is_offered_and_compared() {
    let with = |glass: &str| lens(&[("GLAS N-BK7 0 0 0 0 0", glass)]);
    let error = with("GLAS NOSUCH 0 0 1.5168 64.17 0").unwrap_err().to_string();
    assert!(error.contains("NOSUCH=1.5168:64.17"), "{error}");
    // What OpticStudio writes for want of them.
    let error = with("GLAS NOSUCH 0 0 1.5 40 0").unwrap_err().to_string();
    assert!(!error.contains("NOSUCH=1.5"), "{error}");
    assert!(with("GLAS N-BK7 0 0 1.51681 64.2 0").unwrap().notes.is_empty());
    let notes = with("GLAS N-BK7 0 0 1.5175 64.2 0").unwrap().notes;
    assert!(notes[0].contains("n_d is 1.5175 and V_d 64.2 by the file, 1.516800"), "{notes:?}");
    // The index alone is that of the catalogue.
    let notes = with("GLAS N-BK7 0 0 1.5168 55 0").unwrap().notes;
    assert!(notes[0].contains("V_d 55 by the file, 1.516800 and 64.17"), "{notes:?}");
}

#[test]
fn apertures_of_planes_in_air_and_coatings_are_told() {
    let plane =
        "SURF 2\n  DISZ 5\n  COAT AR\nSURF 3\n  DISZ 70\n  DIAM 4 1 0 0 1\nSURF 4\n  DISZ 0";
    let notes = lens(&[("SURF 2\n  DISZ 75\nSURF 3\n  DISZ 0", plane)]).unwrap().notes;
    assert!(notes[0].contains("cut no light") && notes[0].contains("(surface 3)"), "{notes:?}");
    assert!(notes[1].contains("coatings (COAT) are not traced"), "{notes:?}");
}

/// A plano-convex cylinder makes a line of a point, seen from which the pupil has no solid angle.
#[test]
fn a_cylinder_has_no_relative_illumination() {
    let system = system(&[("  CURV 0.025\n", "  CURV 0.025\n  TYPE TOROIDAL\n")]);
    let map = field::Map::of(&system).unwrap();
    let points = field::points(&system, &map, &[[0.0; 2], [0.0, 3.0]], &[587.5618]).unwrap();
    assert!(points.iter().all(|p| p.relative_illumination.is_nan()), "{points:?}");
}

#[test]
fn vignetting_factors_beside_apertures_are_told() {
    let notes = |aperture: &str| {
        let factors = "YFLN 0 4\nVCYN 0 0.2";
        let lens = [("YFLN 0 4", factors), ("  CURV 0.025\n", aperture)];
        system(&lens).prescription.notes
    };
    let told = notes("  CURV 0.025\n  FLAP 0 3 0\n");
    assert!(told[0].contains("passed over, as surfaces have apertures"), "{told:?}");
    let told = notes("  CURV 0.025\n");
    assert!(told[0].contains("make an ellipse of the pupil"), "{told:?}");
}

/// The stop in front of a lens is its entrance pupil: its radius is the distance times the slope of
/// the numerical aperture.
#[test]
fn a_numerical_aperture_kept_for_another_object_is_told() {
    let at = |aperture: &str, distance| {
        let lens = lens(&[("ENPD 6", aperture), ("  DISZ INFINITY", "  DISZ 200")]).unwrap();
        let conditions = Conditions { object_distance_mm: distance, ..Conditions::default() };
        System::new(lens, conditions).unwrap()
    };
    let far = at("OBNA 0.02 0", Some(400.0));
    let slope = 0.02 / (1.0_f64 - 0.02 * 0.02).sqrt();
    assert!((far.stop_radius_mm - 400.0 * slope).abs() < 1e-9, "{}", far.stop_radius_mm);
    let note = &far.prescription.notes[0];
    let words = format!("is {:.6} mm instead of {:.6} mm", 400.0 * slope, 200.0 * slope);
    assert!(note.contains(&words), "{note}");
    for quiet in [at("OBNA 0.02 0", None), at("ENPD 6", Some(400.0)), at("FNUM 5 0", Some(1e3))] {
        let notes = &quiet.prescription.notes;
        assert!(!notes.iter().any(|note| note.contains("aperture is kept")), "{notes:?}");
    }
}

/// In thin-lens optics the spot of an object at infinity is as wide as the pupil, times the
/// defocus over the focal length.
#[test]
fn a_sensor_far_out_of_focus_is_told() {
    let notes = |behind: &str| {
        let image = format!("SURF 2\n  DISZ {behind}");
        system(&[("SURF 2\n  DISZ 75", &image)]).prescription.notes
    };
    assert_eq!(notes("75"), [""; 0]);
    assert_eq!(notes("70"), [""; 0]);
    // The stop is the first surface; the exit pupil is its image 4 mm/1.5168 in front of the last.
    let (image, pupil) = (40.0 / 0.5168 - 4.0 / 1.5168, -4.0 / 1.5168);
    let part = 100.0 * (image - 60.0) / (image - pupil);
    let told = notes("60");
    assert!(told[0].contains(&format!("a spot of {part:.0} % of the exit pupil")), "{told:?}");
}

/// What is told of an indented file is told where the indentation is lost: a line between those of
/// surfaces is a surface's, and one behind the last an editor's.
#[test]
fn unknown_lines_of_surfaces_are_told_without_indentation() {
    let with = |line: &str| {
        let text = lens_text(&[("  CURV 0.025\n", &format!("  CURV 0.025\n  {line}\n")[..])]);
        let stripped: Vec<&str> = text.lines().map(str::trim_start).collect();
        let stripped = stripped.join("\n") + "\nEFFL 0 2 0 0 0 0 6 2\nMNUM 1 1\n";
        [text, stripped].map(|text| read(&text, &Catalogue::default()))
    };
    for lens in with("FOOB 3") {
        assert_eq!(lens.unwrap().notes, ["line 16: FOOB of a surface is not known, and not used"]);
    }
    for lens in with("IGNR 1") {
        let error = lens.unwrap_err().to_string();
        assert!(error.contains("IGNR") && error.contains("line 16"), "{error}");
    }
    for lens in with("IGNR 0") {
        assert_eq!(lens.unwrap().notes, [""; 0]);
    }
}

#[test]
fn wavelengths_stand_by_their_number() {
    let three = "FTYP 0 0 2 3 0 0 0";
    let waves = |lines: &str, used: &str| {
        let lines = format!("{lines}PWAV 1\n");
        lens(&[
            ("FTYP 0 0 2 1 0 0 0", used),
            ("WAVM 1 0.5875618 1\nWAVM 2 0.92 1\nPWAV 1\n", &lines),
        ])
    };
    let turned = waves("WAVM 3 0.65 1\nWAVM 2 0.55 4\nWAVM 1 0.45 3\n", three).unwrap();
    assert_eq!(turned.wavelengths_nm, [450.0, 550.0, 650.0]);
    assert_eq!(turned.wavelength_weights, [3.0, 4.0, 1.0]);
    assert_eq!(turned.reference_nm, 450.0);
    let old = waves("WAVL 0.45 0.55 0.65\nWWGT 3 4 1\n", three).unwrap();
    assert_eq!(old, turned);
    for (lines, missing) in [
        ("WAVM 1 0.45 1\nWAVM 3 0.65 1\n", "wavelength 2 of 3 (FTYP) is not given"),
        ("WAVM 1 0.45 1\nWAVM 2 0.55 1\n", "wavelength 3 of 3 (FTYP) is not given"),
        ("WAVL 0.45 0.55\n", "wavelength 3 of 3 (FTYP) is not given"),
    ] {
        let error = waves(lines, three).unwrap_err().to_string();
        assert!(error.contains(missing), "{lines}: {error}");
    }
    assert!(waves("WAVM 1 0.45 1\nWAVM 3 0.65 1\n", "FTYP 0").is_err());
}

#[test]
fn a_primary_wavelength_that_is_not_given_is_told() {
    let two = ("FTYP 0 0 2 1", "FTYP 0 0 2 2");
    assert_eq!(
        lens(&[two, ("PWAV 1\n", "")]).unwrap().notes,
        ["PWAV is not given: the first wavelength, 587.5618 nm, is taken as the reference"]
    );
    assert_eq!(lens(&[("PWAV 1\n", "")]).unwrap().notes, [""; 0]);
    let error = lens(&[two, ("PWAV 1\n", "PWAV 0\n")]).unwrap_err().to_string();
    assert!(error.contains("primary wavelength 0 of 2"), "{error}");
}

#[test]
fn lines_that_contradict_each_other_are_refused() {
    for (from, to, words) in [
        (
            "ENPD 6\n",
            "ENPD 6\nFNUM 2 0\n",
            "\"FNUM 2 0\" contradicts line 3, \"ENPD 6\"\n  where: line 4",
        ),
        ("ENPD 6\n", "ENPD 6\nENPD 7\n", "contradicts line 3"),
        ("UNIT MM\n", "UNIT MM\nUNIT IN\n", "\"UNIT IN\" contradicts line 2"),
        ("PWAV 1\n", "WAVM 1 0.6 1\nPWAV 1\n", "contradicts line 8, \"WAVM 1 0.5875618 1\""),
        ("  DISZ 4\n", "  DISZ 4\n  CURV 0.03\n", "\"CURV 0.03\" contradicts line 15"),
        ("  DISZ 4\n", "  DISZ 4\n  DISZ 5\n", "\"DISZ 5\" contradicts"),
        ("  DISZ 4\n", "  DISZ 4\n  PARM 1 2\n  PARM 1 3\n", "\"PARM 1 3\" contradicts"),
        ("  DISZ 75\n", "  DISZ 75\n  STOP\n", "a second surface is the stop\n  where: line 18"),
        ("YFLN 0 4\n", "YFLN 4\n", "2 fields (FTYP), of which 1 are given"),
        ("XFLN 0 0\nYFLN 0 4\n", "", "2 fields (FTYP)"),
    ] {
        let error = lens(&[(from, to)]).unwrap_err().to_string();
        assert!(error.contains(words), "{to}: {error}");
    }
    let plain = lens(&[]).unwrap();
    for (from, to) in [
        // The same said twice, and kinds of aperture that are not in use.
        ("  DISZ 4\n", "  DISZ 4\n  DISZ 4\n"),
        ("ENPD 6\n", "ENPD 6\nFNUM 0 0\n"),
        ("ENPD 6\n", "OBNA 0 0\nENPD 6\n"),
        ("  DISZ 4\n", "  DISZ 4\n  PARM 1 0\n  PARM 2 0\n"),
        ("XFLN 0 0\n", ""),
    ] {
        assert_eq!(lens(&[(from, to)]).unwrap(), plain, "{to}");
    }
}

/// Where neither `MNUM` nor the surfaces say which configuration is active, none is said to be.
#[test]
fn a_file_that_does_not_say_its_active_configuration_is_not_guessed() {
    let read = |operands: &str, name| {
        let text = lens_text(&[("PWAV 1", &format!("PWAV 1\nMNUM 2\n{operands}")[..])]);
        read_configuration(&text, &Catalogue::default(), name)
    };
    // Pupils, alike thicknesses, and thicknesses of which the surfaces have neither.
    for operands in [
        "APER 0 1 3\nAPER 0 2 6\n",
        "THIC 2 1 75\nTHIC 2 2 75\nWAVE 1 1 0.4\nWAVE 1 2 0.6\n",
        "THIC 2 1 70\nTHIC 2 2 80\n",
    ] {
        let lens = read(operands, None).unwrap();
        let [note] = &lens.notes[..] else { panic!("{:?}", lens.notes) };
        assert!(note.contains("the file does not say which is active (MNUM)"), "{note}");
        for wanted in ["1", "2"] {
            let error = read(operands, Some(wanted)).unwrap_err().to_string();
            let words = format!("configuration {wanted} of 2 cannot be set: the file does not");
            assert!(error.contains(&words), "{error}");
        }
    }
    let lens = read("THIC 2 1 70\nTHIC 2 2 75\nAPER 0 1 3\nAPER 0 2 6\n", None).unwrap();
    assert!(lens.notes[0].contains("configuration 2 of 2 is taken"), "{:?}", lens.notes);
}

#[test]
fn an_operand_without_a_value_for_the_wanted_configuration_is_refused() {
    let read = |name| {
        let lone = "PWAV 1\nMNUM 2 1\nTHIC 2 1 75\nTHIC 2 2 80\nCRVT 1 1 0.025";
        let text = lens_text(&[("PWAV 1", lone)]);
        read_configuration(&text, &Catalogue::default(), Some(name))
    };
    assert!(read("1").is_ok());
    let error = read("2").unwrap_err().to_string();
    assert!(error.contains("line 14: CRVT 1 has no value for it"), "{error}");
}
