//! What a `.seq` file says, and what of it is refused.

use camrig_base::Result;
use camrig_lens::prescription::{Aperture, Clip, Medium, Object, Shape};
use camrig_lens::{Catalogue, Conditions, Prescription, System};
use camrig_lens_files::seq::{read, read_position};

/// A biconvex lens of focal length 78.23 mm behind `head`, with `more` after its first surface.
fn lens(head: &str, more: &str) -> Result<Prescription> {
    let text = format!(
        "{head}\nDIM M; WL 587.6; YAN 0\nSO 0 1e13\nS 80 5 NBK7_SCHOTT\n{more}\nS -80 75\nSI 0 0\n"
    );
    read(&text, &Catalogue::default())
}

fn efl(lens: Result<Prescription>) -> f64 {
    System::new(lens.unwrap(), Conditions::default()).unwrap().paraxial.efl_mm
}

#[test]
fn what_may_change_the_image_is_refused_with_its_line() {
    for (command, word) in [
        ("YTO", "toroid"),
        ("CUX 0.01", "without AAS or CYL"),
        ("AAS; AR 1e-6", "anamorphic"),
        ("SPS QCN", "SPS QCN"),
        ("HOE", "hologram"),
        ("HCO C1 -4e-4", "hologram"),
        ("TEL", "telecentric"),
        ("AFO", "afocal"),
        ("ADE SO 3", "of the object"),
        ("ADE 3 4", "2 values"),
        ("ZOO 2; ZOO THI S1 1 2 3", "3 values for 2"),
        ("ZOO THI S1 1 2", "for 0 zoom positions"),
        ("ZOO 2; ZOO NEW S1 1 2", "not known"),
        ("RMD TIR", "TIR"),
        ("NEW 3", "not known"),
        ("S3 9 9", "not known"),
        ("STO S5", "S1 to S1"),
        ("K S1 1 2", "not understood"),
        ("SLB 'x\nK 'x", "not closed"),
    ] {
        let error = lens("RDM; EPD 6", command).unwrap_err().to_string();
        let line = if command.contains('\n') { "line 6" } else { "line 5" };
        assert!(error.contains(word) && error.contains(line), "{command}: {error}");
    }
}

#[test]
fn bookkeeping_leaves_no_trace() {
    let more = "SLB \"front\"; CCY 0; THC 100; DLT 0.1\nTEL NO; ADE 0; CIR EDG 9; PIM\n\
                CUM 0; THM 0.6; CLS WVL RUS GRE BLU";
    let lens = lens("RDM; EPD 6", more).unwrap();
    assert!(lens.surfaces[0].clips.is_empty());
    assert_eq!(lens.notes.len(), 2, "{:?}", lens.notes);
    assert!(lens.notes[0].contains("PIM") && lens.notes[1].contains("STO"), "{:?}", lens.notes);
}

/// The value stands in the surface's line already.
#[test]
fn a_solve_in_place_of_a_value_is_told_and_changes_nothing() {
    let plain = lens("RDM; EPD 6", "STO").unwrap();
    for solve in ["THI HMY 0.0", "THI S1 PIM", "CUY UMY -0.1", "RDY S1 UCY 0.2", "cuy s1 umy 1"] {
        let solved = lens("RDM; EPD 6", &format!("STO; {solve}")).unwrap();
        assert_eq!(solved.surfaces, plain.surfaces, "{solve}");
        let [note] = &solved.notes[..] else { panic!("{:?}", solved.notes) };
        assert!(note.starts_with("line 5: ") && note.contains("is not solved again"), "{note}");
    }
    let error = lens("RDM; EPD 6", "THI XYZ 0").unwrap_err().to_string();
    assert!(error.contains("\"XYZ\" is not a number"), "{error}");
}

#[test]
fn words_in_full_mean_what_the_short_ones_mean() {
    let text = "RDM; EPD 6; DIM M; WL 587.6; YAN 0; SO 0 1e13; S 80 5 NBK7_SCHOTT; STO; S -80 75; \
                SI 0 0";
    let with =
        |from: &str, to: &str| read(&text.replace(from, to), &Catalogue::default()).unwrap();
    for (from, to) in [
        ("DIM M", "DIM mm"),
        ("1e13", "inf"),
        ("1e13", "INFINITY"),
        ("1e13", "5; THI SO Infinity"),
        ("STO", "stop"),
    ] {
        assert_eq!(with(from, to), with("", ""), "{to}");
    }
    assert_eq!(with("DIM M", "DIM CM"), with("DIM M", "DIM C"));
    assert_eq!(with("DIM M", "DIM IN"), with("DIM M", "DIM I"));
}

/// Each centre is that of the clear aperture, of the obscuration, or of what has the label.
#[test]
fn centres_move_the_aperture_that_they_name() {
    let clips = |more: &str| {
        let text = format!(
            "RDM; EPD 6; WL 550; YAN 0; SO 0 1e13\nS 0 1\n{more}\nS 80 5 1.5:60; STO\nS -80 75\n\
             SI 0 0"
        );
        Ok::<_, camrig_base::Error>(read(&text, &Catalogue::default())?.surfaces[0].clips.clone())
    };
    let (clear, obscured) = (Clip::circle(10.0), Clip::circle(1.0).obstacle());
    let at = |clip: Clip, centre: [f64; 2]| Clip { centre, ..clip };
    for (more, expected) in [
        ("CIR 10; CIR OBS 1; ADY 3", [at(clear, [0.0, 3.0]), obscured]),
        ("ADY OBS 3; CIR 10; CIR OBS 1", [clear, at(obscured, [0.0, 3.0])]),
        ("CIR 10; CIR OBS L'SP' 1; ADY L'SP' 3; ADX 0", [clear, at(obscured, [0.0, 3.0])]),
        (
            "CIR L'A' 10; CIR OBS 1; ADX CLR -2; ADY CLR L'A' 1; ADX EDG 5",
            [at(clear, [-2.0, 1.0]), obscured],
        ),
    ] {
        assert_eq!(clips(more).unwrap(), expected, "{more}");
    }
    for (more, words) in [
        ("ADY 3", "ADY 3: the surface has no clear aperture"),
        ("CIR 10; ADY OBS 3", "ADY OBS 3: the surface has no obscuration"),
        ("CIR OBS L'A' 1; ADY L'B' 3", "ADY B 3: the surface has no aperture of that label"),
        ("CIR L'A' 9; CIR L'B' 8; ADX 1", "ADX 1: the surface has 2 clear apertures"),
        ("REX L'A' 2; REX L'B' 3; REY L'C' 1", "REY without the width in x"),
    ] {
        let error = clips(more).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("line"), "{more}: {error}");
    }
}

#[test]
fn commands_name_their_surface() {
    let text = "RDM; EPD 6; DIM M; WL 587.6; YAN 0; SO 0 1e13; S 60 5 NBK7_SCHOTT\nSTO\nS -60 9\n\
                S 0 50\nSTO S3\nK S1 -0.5; CIR S2 L'rear' 4\nRDY S2 -50; THI S2 8\nSI 0 0";
    let lens = read(text, &Catalogue::default()).unwrap();
    assert_eq!((lens.stop, lens.surfaces[0].conic), (2, -0.5));
    assert_eq!((lens.surfaces[1].curvature, lens.surfaces[1].thickness), (-0.02, 8.0));
    assert_eq!(lens.surfaces[1].clips, [Clip::circle(4.0)]);
}

#[test]
fn a_mirror_by_mode_is_a_mirror() {
    let text = "RDM; EPD 6; DIM M; WL 587.6; YAN 0; SO 0 1e13; S -200 -100; STO; RMD REFL; SI 0 0";
    let lens = read(text, &Catalogue::default()).unwrap();
    assert_eq!(lens.surfaces[0].medium, Medium::Mirror);
    let text = text.replace("-100; STO; RMD REFL", "-100 AIR REFL; STO");
    assert_eq!(read(&text, &Catalogue::default()).unwrap(), lens);
}

/// n = 1.55 + 4000/λ² at five wavelengths, from red to blue, over two lines each.
#[test]
fn private_glasses_are_tables() {
    let head = "RDM; EPD 6\nPRV\nPWL 700 650&\n 600 500 420\n'own' 1.558163 1.559467 &\n 1.561111 \
                1.566 1.572676\nEND";
    let text = format!(
        "{head}\nDIM M; WL 600; YAN 0\nSO 0 1e13\nS 61.1111 0 'own'\nSTO\nS 0 75\nSI 0 0\n"
    );
    let found = efl(read(&text, &Catalogue::default()));
    assert!((found - 61.1111 / 0.561111).abs() < 1e-3, "{found}");
    let short = text.replace(" 1.572676", "");
    assert!(read(&short, &Catalogue::default()).unwrap_err().to_string().contains("4 indices"));
    let formula = text.replace("1.558163", "SCH");
    assert!(read(&formula, &Catalogue::default()).unwrap_err().to_string().contains("SCH"));
}

/// NOA61 as a file of CODE V 11.1 has it: the coefficients are those of the square of the maker's
/// n = 1.5375 + 0.00829045λ⁻² − 0.000211046λ⁻⁴ (Norland).
#[test]
fn a_private_glass_may_be_a_laurent_series() {
    let text = "RDM; EPD 6\nPRV\nPWL 550\n'NOA61' LAU 2.36390625 0.0 0.025493134 -0.000580235 &\n\
                -0.349933e-5 0.445404e-7\nEND\nDIM M; WL 480; YAN 0\nSO 0 1e13\n\
                S 50 0 'noa61'\nSTO\nS 0 75\nSI 0 0\n";
    let read = |text: &str| read(text, &Catalogue::default());
    let per = 0.48_f64.powi(-2);
    let n = 1.5375 + 0.00829045 * per - 0.000211046 * per * per;
    let found = efl(read(text));
    assert!((found - 50.0 / (n - 1.0)).abs() < 1e-4, "{found}");
    let short = read(&text.replace(" 0.445404e-7", "")).unwrap_err().to_string();
    assert!(short.contains("LAU with 5 coefficients") && short.contains("NOA61"), "{short}");
    let other = read(&text.replace("LAU", "GMS")).unwrap_err().to_string();
    assert!(other.contains("\"GMS\"") && other.contains("table"), "{other}");
}

#[test]
fn without_rdm_the_lens_says_what_its_numbers_are() {
    for head in ["EPD 12", "FNO 5", "NA 0.1"] {
        let lens = lens(head, "STO").unwrap();
        assert!(lens.notes[0].contains("taken as radii"), "{:?}", lens.notes);
        assert!((efl(Ok(lens)) - 78.233).abs() < 1e-3);
    }
    let text = "FNO 5; DIM M; WL 587.6; YAN 0; SO 0 1e13; S 0.0125 5 NBK7_SCHOTT; STO; \
                S -0.0125 75; SI 0 0";
    let lens = read(text, &Catalogue::default()).unwrap();
    assert!(lens.notes[0].contains("by curvature"), "{:?}", lens.notes);
    assert!((efl(Ok(lens)) - 78.233).abs() < 1e-3);
    // Out of focus either way: the surfaces' sizes decide.
    let lens = read(&text.replace("0.0125", "80").replace(" 75", " 40"), &Catalogue::default());
    assert!(lens.unwrap().notes[0].contains("smaller"));
}

/// tan²θ = tan²x + tan²y.
#[test]
fn fields_off_both_axes() {
    let text = "RDM; EPD 6; DIM M; WL 587.6; XAN 0 30; YAN 20 30; SO 0 1e13; \
                S 80 5 NBK7_SCHOTT; STO; S -80 75; SI 0 0";
    let fields = read(text, &Catalogue::default()).unwrap().fields.values;
    assert_eq!(fields[0], 20.0);
    assert!((fields[1] - 39.231_520_483_592_26).abs() < 1e-9, "{fields:?}");
}

/// Zoom positions: each gives the lens of a file with that position's values in their places.
#[test]
fn zoom_positions_are_chosen_by_number() {
    let head = "RDM; DIM M; WL 587.6; YAN 0 8; SO 0 1e13; EPD 6\n";
    let body = "S 60 5 NBK7_SCHOTT\nS -60 9\nS 0 50\nSTO\nSI 0 0\n";
    let zoom = "ZOO 3\nZOO TIT 'wide' 'mid' 'tele'\nZOO THC S2 0 0 0\nZOO THI S2 9 4 2.5\n\
                ZOO EPD 6 7 8\nZOO YAN F2 8 6 4\nZOO THI SO 1e13 1e13 500\nGO";
    let text = format!("{head}{body}{zoom}");
    let read = |position| read_position(&text, &Catalogue::default(), position);
    let third = read(Some("3")).unwrap();
    assert_eq!(third.surfaces[1].thickness, 2.5);
    assert_eq!(third.aperture, Aperture::EntrancePupil(8.0));
    assert_eq!(third.fields.values, [0.0, 4.0]);
    assert_eq!(third.object, Object::Distance(500.0));
    let first = read(None).unwrap();
    assert_eq!((first.surfaces[1].thickness, &first.fields.values[..]), (9.0, &[0.0, 8.0][..]));
    assert!(first.notes.iter().any(|n| n.contains("zoom position 1 of 3")), "{:?}", first.notes);
    let error = read(Some("4")).unwrap_err().to_string();
    assert!(error.contains("zoom positions 1 to 3"), "{error}");
}

#[test]
fn fields_are_of_one_kind() {
    let read = |fields: &str| {
        let text = format!(
            "RDM; EPD 6; DIM M; WL 587.6; {fields}; SO 0 900; S 80 5 NBK7_SCHOTT; STO; S -80 75; \
             SI 0 0"
        );
        read(&text, &Catalogue::default())
    };
    let error = read("YAN 0 10; XOB 1 2").unwrap_err().to_string();
    assert!(error.contains("XOB: fields of another kind") && error.contains("line 1"), "{error}");
    let places = |fields: &str| read(fields).unwrap().fields.places;
    assert_eq!(places("XAN 0 0; YOB 0 10"), [[0.0, 0.0], [0.0, 10.0]]);
    assert_eq!(places("YOB 0 10; XAN 0 0"), [[0.0, 0.0], [0.0, 10.0]]);
    assert_eq!(places("YAN 0 10; YOB 3"), [[0.0, 3.0]]);
    assert_eq!(places("XOB 1 2"), [[1.0, 0.0], [2.0, 0.0]]);
}

#[test]
fn a_surface_behind_the_image_is_refused() {
    let text = "RDM; EPD 6; DIM M; WL 587.6; YAN 0; SO 0 1e13; S 80 5 NBK7_SCHOTT; STO; S -80 75\n\
                SI 0 0\nS 0 5\nGO";
    let error = read(text, &Catalogue::default()).unwrap_err().to_string();
    assert!(error.contains("behind the image (SI)") && error.contains("line 3"), "{error}");
}

#[test]
fn a_vignetting_factor_in_x_is_for_both_sides() {
    let vignetting =
        |factors: &str| lens("RDM; EPD 6", &format!("STO; {factors}")).unwrap().fields.vignetting;
    assert_eq!(vignetting("VUX 0.2"), [[0.2, 0.2, 0.0, 0.0]]);
    assert_eq!(vignetting("VUX 0.2; VLX 0.1; VUY 0.3"), [[0.2, 0.1, 0.3, 0.0]]);
}

/// Apertures of one command, kind and label are one: the last value counts, as with any command.
#[test]
fn an_aperture_that_is_given_again_replaces_the_first() {
    let clips = |more: &str, position| {
        let text = format!(
            "RDM; EPD 6; WL 550; YAN 0; SO 0 1e13\nS 0 1\nS 80 5 1.5:60; STO\nS -80 75\n\
             SI 0 0\n{more}"
        );
        let lens = read_position(&text, &Catalogue::default(), position).unwrap();
        lens.surfaces[0].clips.clone()
    };
    let zoomed = "CIR S1 4; ZOO 2\nZOO CIR S1 4 8";
    assert_eq!(clips(zoomed, None), [Clip::circle(4.0)]);
    assert_eq!(clips(zoomed, Some("2")), [Clip::circle(8.0)]);
    let wide = "REX S1 4; REY S1 3; ZOO 2\nZOO REX S1 4 8\nZOO REY S1 3 6";
    assert_eq!(clips(wide, Some("2")), [Clip::opening(Shape::Rectangle, [8.0, 6.0])]);
    let width = "ELX S1 4; ELY S1 3; ZOO 2\nZOO ELX S1 4 8";
    assert_eq!(clips(width, Some("2")), [Clip::opening(Shape::Ellipse, [8.0, 3.0])]);
    assert_eq!(clips("CIR S1 4; CIR S1 8", None), [Clip::circle(8.0)]);
    let several = "CIR S1 8; CIR S1 OBS 1; CIR S1 L'A' 7; CIR S1 OBS 2; REX S1 6; REY S1 5";
    let expected = [
        Clip::circle(8.0),
        Clip::circle(2.0).obstacle(),
        Clip::circle(7.0),
        Clip::opening(Shape::Rectangle, [6.0, 5.0]),
    ];
    assert_eq!(clips(several, None), expected);
}

/// The value that a solve has in the file is that of the first position.
#[test]
fn a_kept_solve_is_no_value_of_another_zoom_position() {
    let read = |solve: &str, position| {
        let text = format!(
            "RDM; EPD 6; DIM M; WL 587.6; YAN 0; SO 0 1e13\nS 60 5 NBK7_SCHOTT; STO\nS -60 9\n\
             S 0 50\n{solve}\nSI 0 0\nZOO 2\nZOO THI S2 9 4\nGO"
        );
        read_position(&text, &Catalogue::default(), position)
    };
    assert_eq!(read("", Some("2")).unwrap().surfaces[1].thickness, 4.0);
    for solve in ["PIM", "THI HMY 0.0", "PIK"] {
        assert_eq!(read(solve, Some("1")).unwrap(), read(solve, None).unwrap(), "{solve}");
        let error = read(solve, Some("2")).unwrap_err().to_string();
        assert!(error.contains("zoom position 2") && error.contains("line 5"), "{error}");
        assert!(error.contains(solve.trim_end_matches(" 0.0")), "{error}");
    }
}

/// CODE V of 2023 on writes `DOR`, and solves for the length of a part.
#[test]
fn the_default_order_and_the_solve_for_a_length_change_nothing() {
    let plain = lens("RDM; EPD 6", "STO").unwrap();
    let with = |more: &str| lens("RDM; EPD 6", more).unwrap();
    assert_eq!(with("STO; DOR 1.15 1.05"), plain);
    let solved = with("STO; THI S1 OAL S1..2 80");
    assert_eq!(solved.surfaces, plain.surfaces);
    assert!(solved.notes[0].contains("THI OAL is not solved again"), "{:?}", solved.notes);
}

#[test]
fn a_zoom_position_is_chosen_by_its_title() {
    let read = |titles: &str, wanted| {
        let text = format!(
            "RDM; EPD 6; DIM M; WL 550; YAN 0\nSO 0 1e13\nS 80 5 1.5:60; STO\nS -80 75\nSI 0 0\n\
             ZOO 2; {titles}\nZOO THI S1 5 4\n"
        );
        read_position(&text, &Catalogue::default(), Some(wanted))
    };
    for titles in ["ZOO TIT; TIT Z1 \"\"FAR\"\"; TIT Z2 \"\"NEAR\"\"", "ZOO TIT 'far' 'near'"] {
        assert_eq!(read(titles, "Near").unwrap().surfaces[0].thickness, 4.0, "{titles}");
        assert_eq!(read(titles, "FAR").unwrap().surfaces[0].thickness, 5.0, "{titles}");
        let error = read(titles, "MACRO").unwrap_err().to_string();
        assert!(error.to_ascii_uppercase().contains("\"NEAR\""), "{error}");
    }
}

/// Factors that no aperture behind a stop in front can meet make an ellipse of the pupil.
#[test]
fn factors_that_apertures_cannot_meet_make_an_ellipse() {
    let text = "RDM; EPD 10; DIM M; WL 587.6; YAN 0 10; VUY 0 0; VLY 0 0.6\nSO 0 1e13\nS 0 30; \
                STO\nS 60 5 1.5:60\nS -60 50\nSI 0 0\n";
    let lens = read(text, &Catalogue::default()).unwrap();
    let system = System::new(lens, Conditions::default()).unwrap();
    let pupil = system.vignetted[1];
    assert!((pupil.centre - 0.3).abs() < 1e-12 && (pupil.half[1] - 0.7).abs() < 1e-12);
    assert!(system.prescription.surfaces.iter().all(|s| s.clips.is_empty()));
}

#[test]
fn words_that_nothing_takes_are_refused() {
    let text = "RDM; EPD 6; DIM M\nWL 550 600; WTW 1 2; REF 1; YAN 0\nSO 0 1e13\n\
                S 80 5 1.5:60; STO\nS -80 75\nSI 0 0\n";
    let read = |text: &str| read(text, &Catalogue::default());
    assert!(read(text).is_ok());
    for (from, to, words) in [
        ("EPD 6", "EPD 6 20", "EPD: \"20\" is not understood"),
        ("EPD 6", "FNO 5 6", "FNO: \"6\" is not understood"),
        ("DIM M", "DIM M I", "DIM: \"I\" is not understood"),
        ("REF 1", "REF 1 2", "REF: \"2\" is not understood"),
        ("WTW 1 2", "WTW 1 2 3", "WTW has 3 weights for 2 wavelengths"),
        ("S 80 5 1.5:60", "S 80 5 1.5:60 REFR 7", "S: \"7\" is not understood"),
        ("SI 0 0", "SI 0 0 N-BK7", "the image lies in N-BK7"),
        ("SI 0 0", "SI 0 0 AIR 4", "SI: \"4\" is not understood"),
        ("SI 0 0", "SI 0 0; THI SI 1 2", "THI: \"2\" is not understood"),
        ("YAN 0", "YAN 0; VUY F1 0.1 0.2", "VUY: \"0.2\" is not understood"),
    ] {
        let error = read(&text.replace(from, to)).unwrap_err().to_string();
        assert!(error.contains(words), "{to}: {error}");
    }
}

#[test]
fn a_reference_wavelength_that_is_not_given_is_told() {
    let notes = |head: &str| {
        let text = format!(
            "RDM; EPD 6; DIM M; YAN 0; {head}; SO 0 1e13; S 80 5 1.5:60; STO; S -80 75; SI 0 0"
        );
        read(&text, &Catalogue::default()).unwrap().notes
    };
    assert_eq!(
        notes("WL 650 550"),
        ["REF is not given: the first wavelength, 650 nm, is taken as the reference"]
    );
    assert_eq!(notes("WL 650 550; REF 1"), [""; 0]);
    assert_eq!(notes("WL 650"), [""; 0]);
}
