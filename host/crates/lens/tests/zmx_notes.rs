//! What a `.zmx` file says that is not used is told with its line; what changes nothing is not.

use camrig_lens::{Catalogue, zmx};

/// A lens with what public files hold beside: lines of the system, of a surface, and of editors.
fn notes(system: &str, surface: &str, behind: &str) -> Vec<String> {
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
    zmx::read(&text, &Catalogue::default()).unwrap().notes
}

#[test]
fn what_changes_nothing_is_not_told() {
    assert_eq!(notes("", "", ""), [""; 0]);
}

#[test]
fn keywords_of_which_nothing_is_known_are_told_once_with_their_line() {
    for (system, surface, words) in [
        ("ABCD 1\nABCD 2\n", "", "line 34: ABCD of the system is not known"),
        ("VANN 0 30\n", "", "line 34: VANN of the system is not known"),
        ("HYPR 1\n", "", "line 34: HYPR of the system is not known"),
        ("", "  WXYZ 1\n  WXYZ 2\n", "line 46: WXYZ of a surface is not known"),
        ("", "  IGNR 1\n", "line 46: IGNR of a surface is not known"),
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
    let notes = |text: &str| zmx::read(text, &Catalogue::default()).unwrap().notes;
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
             SURF 0\n  DISZ INFINITY\nSURF 1\n  STOP\n  CURV 0.025\n  DISZ 4\n  GLAS 1.5:60\nSURF 2\n  \
             DISZ 75\nSURF 3\n  DISZ 0\n"
        );
        zmx::read(&text, &Catalogue::default()).unwrap().fields.vignetting
    };
    let (old, new) = ("ZVCY 0 0.2\n", "VCYN 0 0.3\n");
    assert_eq!(read(old)[1], [0.0, 0.0, 0.2, 0.2]);
    for both in [format!("{old}{new}"), format!("{new}{old}")] {
        assert_eq!(read(&both)[1], [0.0, 0.0, 0.3, 0.3]);
    }
}
