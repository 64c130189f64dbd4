//! PSFs and characterisations over the plane against the rotational ones and another tracer.

use super::super::{Beam, tests::TILTED};
use super::*;
use crate::psf::{self, Psf};
use crate::pupil::Extent;
use crate::{Catalogue, Conditions, characterise as radial, pupil};
use camrig_lens_files::seq;
use camrig_optics::Lens;

fn system(text: &str) -> System {
    System::new(seq::read(text, &Catalogue::default()).unwrap(), Conditions::default()).unwrap()
}

/// A lens of two elements in focus, and the same without symmetry by next to nothing.
fn round() -> [System; 2] {
    let text = "RDM; EPD 4; DIM M; WL 550; XAN 0; YAN 6; SO 0 1e13\nS 60 5 620.603; CIR 5\n\
                S -90 3\nS 0 4; STO\nS -140 2 620.364\nS 160 82.9; CIR 4.5\nSI 0 0";
    [system(text), system(&text.replace("CIR 4.5", "CIR 4.5; ADX 1e-12"))]
}

fn largest_difference(a: &Psf, b: &Psf) -> f64 {
    let peak = b.data.iter().copied().fold(0.0, f64::max);
    a.data.iter().zip(&b.data).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / peak
}

/// One PSF by half a pupil and its mirror image and by the whole pupil, and both against the plain
/// sum.
#[test]
fn whole_pupils_give_the_psfs_of_mirrored_halves() {
    let [round, turned] = round();
    let (train, other) = (round.at(550.0).unwrap(), turned.at(550.0).unwrap());
    let window = Window { size: 32, spacing_mm: 2e-3 };
    let half = pupil::Beam::aim(&train, 6.0).unwrap();
    let whole = Beam::aim(&other, [0.0, libm::tan(6.0_f64.to_radians())]).unwrap();
    let (half_outline, outline) = (half.outline(256).unwrap(), whole.outline().unwrap());
    assert_eq!(outline.extent, Extent::Whole);
    let by_half = PupilSamples::trace(&half, &half_outline, 160);
    let by_whole = PupilSamples::trace(&whole, &outline, 160);
    let ratio = by_whole.power / by_half.power;
    assert!((ratio - 1.0).abs() < 1e-4, "{ratio}");
    let spots = by_whole.spot_rms_mm() / by_half.spot_rms_mm();
    assert!((spots - 1.0).abs() < 2e-3, "{spots}");
    let (a, b) =
        (psf::diffraction(&by_whole, 550.0, &window), psf::diffraction(&by_half, 550.0, &window));
    let worst = largest_difference(&a, &b);
    println!("diffraction: {worst:.1e} of the peak");
    // Two grids of 160 cells across the pupil, which cut its rim differently.
    assert!(worst < 1e-4, "{worst}");
    assert!((a.captured / b.captured - 1.0).abs() < 2e-3, "{} {}", a.captured, b.captured);
    let off = largest_difference(&a, &psf::direct(&by_whole, 550.0, &window));
    assert!(off < 1e-6, "{off}");
}

const RAY_OPTICS: [[f64; 9]; 9] = [
    [0.00020, 0.00012, 0.00030, 0.00042, 0.00079, 0.00064, 0.00114, 0.00061, 0.00051],
    [0.00025, 0.00045, 0.00034, 0.00260, 0.00362, 0.00463, 0.00432, 0.00276, 0.00135],
    [0.00036, 0.00089, 0.00209, 0.00835, 0.01579, 0.02723, 0.02446, 0.01148, 0.00358],
    [0.00217, 0.00557, 0.01378, 0.03580, 0.05896, 0.06523, 0.06756, 0.02332, 0.00516],
    [0.00446, 0.01274, 0.03333, 0.04398, 0.01836, 0.02282, 0.03704, 0.01466, 0.00419],
    [0.00865, 0.02499, 0.04050, 0.01494, 0.05130, 0.03001, 0.01861, 0.00717, 0.00216],
    [0.00864, 0.02429, 0.03386, 0.02756, 0.02566, 0.00941, 0.00647, 0.00193, 0.00054],
    [0.00555, 0.01129, 0.01447, 0.01065, 0.00699, 0.00240, 0.00310, 0.00148, 0.00061],
    [0.00198, 0.00368, 0.00401, 0.00349, 0.00168, 0.00142, 0.00088, 0.00079, 0.00044],
];

/// The PSF of a tilted, decentred and folded lens at the field point (3°, 2°), by ray-optics
/// 0.9.8: paths and directions of its rays on a grid of 72 x 72, summed as plane waves in Python;
/// samples 20 µm apart about the chief ray, of unit sum.
#[test]
fn the_psf_of_a_tilted_lens_is_that_of_the_rays_of_ray_optics() {
    let text = TILTED.replace("EPD 8.0", "EPD 4.0").replace("S 50.0 -60.0", "S 50.0 -100.0");
    let system = system(&text);
    let train = system.at(587.5618).unwrap();
    let tangents = [3.0_f64, 2.0].map(|deg| libm::tan(deg.to_radians()));
    let beam = Beam::aim(&train, tangents).unwrap();
    let window = Window { size: 64, spacing_mm: 5e-3 };
    let outline = beam.outline().unwrap();
    let cells = psf::cells_across(&beam, &outline, &window).unwrap();
    let traced = psf::diffraction(&PupilSamples::trace(&beam, &outline, cells), 587.5618, &window);
    let sample = |j: usize, i: usize| traced.data[(16 + 4 * j) * 64 + 16 + 4 * i];
    let ours: Vec<f64> = (0..81).map(|k| sample(k / 9, k % 9)).collect();
    let sum: f64 = ours.iter().sum();
    let right = RAY_OPTICS.as_flattened();
    let peak = right.iter().copied().fold(0.0, f64::max);
    let off = ours.iter().zip(right).map(|(a, b)| (a / sum - b).abs()).fold(0.0, f64::max) / peak;
    println!("{off:.1e} of the peak");
    assert!(off < 5e-3, "{off}");
}

/// A round lens characterised over the plane has the places and illumination of the one over
/// heights; a frame that its rays do not reach is refused.
#[test]
fn a_round_lens_has_the_same_tables_over_heights_and_over_the_plane() {
    let [round, turned] = round();
    let plan = PlanePlan {
        frame_mm: [8.0, 6.0],
        density: None,
        wavelengths_nm: vec![550.0],
        psf_size: 32,
        psf_spacing_um: Some(2.0),
        method: PsfMethod::Auto,
    };
    let plane = characterise(&turned, &plan, &|_, _| ()).unwrap();
    assert_eq!((plane.x_mm.len(), plane.y_mm.len()), (5, 5));
    let places: Vec<[f64; 2]> =
        [2.0, 3.5].iter().flat_map(|&x| [[x, 1.0], [-x, 2.5], [x, -2.0]]).collect();
    let (ratios, ideal) = (plane.illumination(550.0).unwrap(), plane.ideal_place(550.0).unwrap());
    let scale = round.paraxial.efl_mm / plane.principal_distance_mm;
    // The plane's unit is the lens as it stands, at its sensor's distance; that of heights its
    // focal length.
    assert!((scale - 1.0).abs() < 0.05, "{scale}");
    for [x, y] in places {
        let (a, b) = ideal.at(x, y);
        let field = libm::atan(f64::hypot(a, b) / plane.principal_distance_mm).to_degrees();
        let point = radial::field_points(&round, &[field], &[550.0]).unwrap()[0];
        let off = point.chief_ray_height_mm - f64::hypot(x, y);
        assert!(off.abs() < 2e-4, "({x}, {y}): {off} mm");
        assert!((a * y - b * x).abs() < 1e-3, "({x}, {y}) is not in the direction of ({a}, {b})");
        let heights = radial::Plan {
            heights: 2,
            density: None,
            max_field_deg: field,
            wavelengths_nm: vec![550.0],
            psf_size: 16,
            psf_spacing_um: Some(2.0),
            method: PsfMethod::Geometric,
        };
        let over_heights = radial::characterise(&round, &heights, &|_, _| ()).unwrap();
        let light = ratios.at(x, y) - over_heights.relative_illumination[1];
        assert!(light.abs() < 1e-3, "({x}, {y}): {light}");
    }
    let wide = PlanePlan { frame_mm: [400.0, 300.0], ..plan };
    assert!(characterise(&turned, &wide, &|_, _| ()).is_err());
}
