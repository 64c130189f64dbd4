//! Departing lenses against closed forms.

use super::*;
use crate::Catalogue;
use crate::prescription::toml;

/// A plane and a hyperboloid of eccentricity n, free of aberration for an object at infinity:
/// n − 1 = 0.5 and R = −10, focal length 20. The stop lies in the air behind it.
const PERFECT: &str = r#"format = "camrig-prescription/1"
wavelengths_nm = [500.0]
fields_deg = [0.0]
[aperture]
f_number = 10.0
[[surface]]
thickness_mm = 1.0
glass = "flat"
[[surface]]
radius_mm = -10.0
conic = -2.25
thickness_mm = 5.0
[[surface]]
thickness_mm = 15.0
stop = true
[glass.flat]
nd = 1.5
"#;

const TRIPLET: &str = r#"format = "camrig-prescription/1"
wavelengths_nm = [486.1, 587.6, 656.3]
fields_deg = [0.0, 14.0]
[aperture]
f_number = 5.0
[[surface]]
radius_mm = 22.01359
thickness_mm = 3.25896
glass = "N-SK16"
[[surface]]
radius_mm = -435.76044
thickness_mm = 6.00755
[[surface]]
radius_mm = -22.21328
thickness_mm = 0.99997
glass = "F2"
[[surface]]
radius_mm = 20.29192
thickness_mm = 4.75041
stop = true
[[surface]]
radius_mm = 79.6836
thickness_mm = 2.95208
glass = "N-SK16"
[[surface]]
radius_mm = -18.39533
thickness_mm = 42.20778
"#;

const NONE: Tolerances = Tolerances {
    thickness_mm: 0.0,
    index: 0.0,
    radius_percent: 0.0,
    decentre_mm: 0.0,
    tilt_arcmin: 0.0,
};

fn system(text: &str) -> System {
    System::new(toml::read(text, &Catalogue::default()).unwrap(), Conditions::default()).unwrap()
}

fn plan(tolerances: Tolerances, lenses: usize, fields: &[f64]) -> Plan {
    Plan {
        tolerances,
        lenses,
        seed: 7,
        refocus: false,
        frequency_per_mm: None,
        fields_deg: fields.to_vec(),
    }
}

fn quiet(system: &System, plan: &Plan) -> Report {
    report(system, plan, &|_, _| ()).unwrap()
}

/// OTF of a circular pupil of f-number N, defocused by δ (Hopkins 1955): the mean over the overlap
/// of two discs, s apart in units of the radius, of cos(2π/λ·δ·s·x/(4N²))·…, by direct summation.
fn defocused_mtf(per_mm: f64, f_number: f64, defocus_mm: f64, wavelength_mm: f64) -> f64 {
    let s = 2.0 * wavelength_mm * f_number * per_mm;
    // Phase δ·r²/(8N²) of the rim's unit radius: the difference between x ± s/2 is linear in x.
    let waves = defocus_mm / (8.0 * f_number * f_number * wavelength_mm) * 2.0 * s;
    let (n, mut sum) = (2000, 0.0);
    for i in 0..n {
        let x = (2.0 * i as f64 + 1.0) / n as f64 - 1.0;
        let edge = 1.0 - (x.abs() + 0.5 * s).powi(2);
        let height = 2.0 * edge.max(0.0).sqrt();
        sum += height * (std::f64::consts::TAU * waves * x).cos() * 2.0 / n as f64;
    }
    (sum / std::f64::consts::PI).abs()
}

/// An error of the air space is a defocus of the same amount.
#[test]
fn a_thickness_error_defocuses_as_the_closed_form_says() {
    let system = system(PERFECT);
    let cut_off = otf::cut_off_per_mm(&system).unwrap();
    for defocus in [0.0, 0.05, 0.1, 0.2] {
        let mut departing = Departing::new(&system.prescription);
        departing.lens.surfaces[1].thickness += defocus;
        let mut plan = plan(Tolerances { thickness_mm: 1.0, ..NONE }, 1, &[0.0]);
        for per_mm in [20.0, 40.0, 80.0] {
            plan.frequency_per_mm = Some(per_mm);
            let study = Study::new(&system, &plan).unwrap();
            let figures = study.figures(&departing).unwrap();
            // The stop, which keeps its size, comes nearer to the focus, 15 mm behind it.
            let f_number = (1.0 - defocus / 15.0) / (cut_off * 500e-6);
            let expected = defocused_mtf(per_mm, f_number, defocus, 500e-6);
            for [_, mtf] in figures[0] {
                assert!((mtf - expected).abs() < 4e-3, "{defocus} {per_mm}: {mtf} {expected}");
            }
        }
    }
}

/// An index error moves the focus as the lensmaker's equation says, and refocusing mends it.
#[test]
fn refocusing_follows_the_paraxial_image() {
    let system = system(PERFECT);
    let mut departing = Departing::new(&system.prescription);
    let index = Perturbation { kind: Kind::Index, first: 0, last: 0, tolerance: 2e-3 };
    index.apply(&mut departing, [1.0, 0.0]);
    let mut plan = plan(Tolerances { index: 2e-3, ..NONE }, 1, &[0.0]);
    plan.frequency_per_mm = Some(40.0);
    let mtf = |plan: &Plan| {
        let study = Study::new(&system, plan).unwrap();
        study.figures(&departing).unwrap()[0][0][1]
    };
    // f = 10/(n − 1): 20 mm become 19.9203 mm.
    let cut_off = otf::cut_off_per_mm(&system).unwrap();
    let defocused = defocused_mtf(40.0, 1.0 / (cut_off * 500e-6), 0.0797, 500e-6);
    assert!((mtf(&plan) - defocused).abs() < 6e-3, "{} {defocused}", mtf(&plan));
    plan.refocus = true;
    let sharp = defocused_mtf(40.0, 1.0 / (cut_off * 500e-6), 0.0, 500e-6);
    assert!((mtf(&plan) - sharp).abs() < 6e-3, "{} {sharp}", mtf(&plan));
}

/// A perfect lens that is decentred as a whole stays perfect; tilted, it has coma and astigmatism.
#[test]
fn a_decentred_perfect_lens_stays_perfect() {
    let system = system(PERFECT);
    let study_plan = Plan { frequency_per_mm: Some(40.0), ..plan(NONE, 1, &[0.0]) };
    let study = Study::new(&system, &study_plan).unwrap();
    let moved = |kind, tolerance| {
        let mut departing = Departing::new(&system.prescription);
        let perturbation = Perturbation { kind, first: 0, last: 1, tolerance };
        perturbation.apply(&mut departing, [0.6, 0.8]);
        study.figures(&departing).unwrap()[0].map(|[_, mtf]| mtf)
    };
    let still = moved(Kind::Decentre, 0.0);
    let decentred = moved(Kind::Decentre, 0.05);
    assert!(still.iter().zip(decentred).all(|(a, b)| (a - b).abs() < 2e-3), "{decentred:?}");
    let tilted = moved(Kind::Tilt, 300.0);
    assert!(still.iter().zip(tilted).all(|(a, b)| a - b > 0.01), "{still:?} {tilted:?}");
}

/// A wavelength of weight 0 is as one that is not there.
#[test]
fn wavelengths_count_by_their_weights() {
    let figures = |waves: &str| {
        let system = system(&TRIPLET.replace("wavelengths_nm = [486.1, 587.6, 656.3]", waves));
        let plan = Plan { frequency_per_mm: Some(40.0), ..plan(NONE, 1, &[0.0, 10.0]) };
        let study = Study::new(&system, &plan).unwrap();
        study.figures(&Departing::new(&system.prescription)).unwrap()
    };
    let all = "wavelengths_nm = [486.1, 587.6, 656.3]\nwavelength_weights";
    let green = figures("wavelengths_nm = [587.6]");
    assert_eq!(figures(&format!("{all} = [0, 2, 0]")), green);
    assert_ne!(figures(&format!("{all} = [1, 2, 1]")), green);
}

/// The MTF of the prescription agrees with that of its diffraction PSF, off the axis and in
/// colours.
#[test]
fn the_mtf_is_that_of_the_psf() {
    use crate::characterise::{Plan as Grid, PsfMethod, characterise};
    let system = system(TRIPLET);
    let grid = Grid {
        heights: 2,
        density: None,
        max_field_deg: 10.0,
        wavelengths_nm: vec![587.6],
        psf_size: 128,
        psf_spacing_um: Some(1.0),
        method: PsfMethod::Diffraction,
    };
    let lens = characterise(&system, &grid, &|_, _| ()).unwrap();
    let mut one = system.prescription.clone();
    one.wavelengths_nm = vec![587.6];
    let one = System::new(one, Conditions::default()).unwrap();
    let still = vec![Displacement::default(); one.prescription.surfaces.len()];
    for (h, deg) in [(0, 0.0), (1, 10.0)] {
        let psf = lens.psf.psf(h, 0);
        let waves = Waves::trace(&one, &still, deg, 5.0).unwrap();
        for m in [2, 4, 8] {
            for (azimuth, along_rows) in [(Azimuth::Tangential, true), (Azimuth::Sagittal, false)]
            {
                let mut sum = [0.0; 2];
                for (k, v) in psf.iter().enumerate() {
                    let place = if along_rows { k / 128 } else { k % 128 };
                    let angle = std::f64::consts::TAU * 5e-3 * m as f64 * place as f64;
                    sum[0] += f64::from(*v) * angle.cos();
                    sum[1] += f64::from(*v) * angle.sin();
                }
                let expected = sum[0].hypot(sum[1]);
                let mtf = waves.mtf(azimuth, m);
                assert!((mtf - expected).abs() < 0.02, "{deg} {m} {azimuth:?}: {mtf} {expected}");
            }
        }
    }
}

#[test]
fn any_number_of_threads_makes_the_same_lenses() {
    let system = system(TRIPLET);
    let tolerances = Tolerances { thickness_mm: 0.02, decentre_mm: 0.02, ..NONE };
    let plan = plan(tolerances, 4, &[14.0]);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| quiet(&system, &plan))
    };
    let (one, three) = (with(1), with(3));
    assert_eq!(one, three);
    let spread = one.fields[0].tangential.mtf50_per_mm;
    assert!(spread.percentiles[0] < spread.percentiles[4], "{spread:?}");
    assert!(one.sensitivities.windows(2).all(|s| s[0].loss >= s[1].loss));
    assert!(one.sensitivities[0].loss > 0.0);
}

/// Six radii, three glasses, five spaces, three elements with two departures each.
#[test]
fn every_surface_space_and_element_departs() {
    let tolerances = Tolerances {
        thickness_mm: 0.02,
        index: 5e-4,
        radius_percent: 0.1,
        decentre_mm: 0.02,
        tilt_arcmin: 2.0,
    };
    let all = tolerances.perturbations(&system(TRIPLET).prescription).unwrap();
    let count = |kind| all.iter().filter(|p| p.kind == kind).count();
    let kinds = [Kind::Radius, Kind::Index, Kind::Thickness, Kind::Decentre, Kind::Tilt];
    assert_eq!(kinds.map(count), [6, 3, 5, 3, 3]);
    let elements = all.iter().filter(|p| p.kind == Kind::Tilt).map(|p| (p.first, p.last));
    assert_eq!(elements.collect::<Vec<_>>(), [(0, 1), (2, 3), (4, 5)]);
}

#[test]
fn draws_are_even() {
    let n = 20_000;
    let draws = |disc| (0..n).map(move |i| draw(1, i, 3, disc));
    let mean = draws(false).map(|d| d[0]).sum::<f64>() / n as f64;
    let square = draws(false).map(|d| d[0] * d[0]).sum::<f64>() / n as f64;
    assert!(mean.abs() < 0.015 && (square - 1.0 / 3.0).abs() < 0.01);
    // Over a disc half of the places lie within 1/√2.
    let radius = |d: [f64; 2]| d[0].hypot(d[1]);
    let inner = draws(true).filter(|d| radius(*d) < 0.5_f64.sqrt()).count();
    assert!((inner as f64 / n as f64 - 0.5).abs() < 0.015);
    assert!(draws(true).all(|d| radius(d) <= 1.0));
}

#[test]
fn percentiles_lie_between_the_values() {
    let values: Vec<f64> = (0..=100).rev().map(f64::from).collect();
    assert_eq!(percentiles(values), [2.0, 10.0, 50.0, 90.0, 98.0]);
    assert_eq!(percentiles(vec![3.0]), [3.0; 5]);
}

#[test]
fn what_has_no_meaning_is_refused() {
    let system = system(PERFECT);
    let refused = |plan: Plan, word: &str| {
        let error = report(&system, &plan, &|_, _| ()).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    };
    let some = Tolerances { thickness_mm: 0.01, ..NONE };
    refused(plan(NONE, 3, &[0.0]), "no tolerance");
    refused(plan(Tolerances { index: -1.0, ..NONE }, 3, &[0.0]), "index");
    refused(plan(Tolerances { radius_percent: f64::NAN, ..NONE }, 3, &[0.0]), "radius");
    // The stop lies a quarter of the way to the focus: its image moves by 0.25 mm of 1 mm.
    refused(plan(Tolerances { decentre_mm: 1.0, ..NONE }, 1, &[0.0]), "the pupil moves");
    let near = PERFECT
        .replace("fields_deg", "object_distance_mm = 60.0\ntelecentric = true\nfields_deg")
        .replace("f_number = 10.0", "object_na = 0.02");
    let near = self::system(&near);
    let error = report(&near, &plan(some, 1, &[0.0]), &|_, _| ()).unwrap_err().to_string();
    assert!(error.contains("telecentric in object space"), "{error}");
    refused(plan(some, 0, &[0.0]), "0 lenses");
    refused(plan(some, 1, &[]), "0 fields");
    refused(Plan { frequency_per_mm: Some(1e4), ..plan(some, 1, &[0.0]) }, "cut-off");
}
