//! How bright a traced lens is: the solid angle of its real rays in closed form, behind apertures
//! and obscurations of every shape.

use camrig_base::Result;
use camrig_lens::characterise::{Plan, PsfMethod, characterise, field_points};
use camrig_lens::field::{self, PlanePlan};
use camrig_lens::prescription::{Aperture, Clip, Shape};
use camrig_lens::{Catalogue, Conditions, Prescription, System};
use camrig_lens_files::{seq, zmx};
use camrig_optics::Lens;
use camrig_prescription::toml;
use std::f64::consts::{PI, TAU};

/// Distance from the last vertex to the focus, half of the beam's width, and half of what obscures
/// it, mm.
const FOCUS_MM: f64 = 10.0;
const HALF_MM: f64 = 2.5;
const OBSCURED_MM: f64 = 1.0;

/// A plane and a hyperboloid of eccentricity n = 1.5, R = −5 mm, f/2: rays parallel to the axis
/// meet in the focus. The plane is the stop; these apertures lie on it, or on a plane before it.
fn lens_of(before: &str, on_stop: &str) -> Prescription {
    let text = format!(
        "UNIT MM\nENPD {}\nFTYP 0 0 1 1\nXFLN 0\nYFLN 0\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  \
         DISZ INFINITY\nSURF 1\n  DISZ 1\n{before}SURF 2\n  STOP\n{on_stop}  DISZ 3\n  \
         GLAS ___BLANK 1 0 1.5 0 0 0\nSURF 3\n  CURV -0.2\n  CONI -2.25\n  DISZ {FOCUS_MM}\n\
         SURF 4\n  DISZ 0\n",
        2.0 * HALF_MM
    );
    zmx::read(&text, &Catalogue::default()).unwrap()
}

fn lens(apertures: &str) -> Prescription {
    lens_of(apertures, "")
}

fn solid_angle(lens: Prescription) -> Result<f64> {
    let system = System::new(lens, Conditions::default())?;
    let map = field::Map::of(&system)?;
    Ok(field::points(&system, &map, &[[0.0; 2]], &[550.0])?[0].projected_solid_angle_sr)
}

/// sin² of the angle at which the ray of this height meets the axis: the hyperboloid's sag s makes
/// tan θ = h/(focus − s).
fn sine_squared(height_mm: f64) -> f64 {
    let c = -0.2;
    let root = (1.0 + 1.25 * c * c * height_mm * height_mm).sqrt();
    let slope = height_mm / (FOCUS_MM - c * height_mm * height_mm / (1.0 + root));
    slope * slope / (1.0 + slope * slope)
}

/// ∮ ½ sin² θ dφ over the outline `radius(φ)` of what light passes.
fn of_outline(radius: impl Fn(f64) -> f64) -> f64 {
    const STEPS: usize = 100_000;
    let angle = |i: usize| TAU * (i as f64 + 0.5) / STEPS as f64;
    (0..STEPS).map(|i| sine_squared(radius(angle(i)))).sum::<f64>() * PI / STEPS as f64
}

/// Distance to the side of a rectangle about (x, y), half as wide as (a, b).
fn rectangle([a, b]: [f64; 2], [x, y]: [f64; 2]) -> impl Fn(f64) -> f64 {
    move |angle: f64| {
        let (sine, cosine) = angle.sin_cos();
        let to_side =
            |half: f64, centre: f64, way: f64| (half + centre * way.signum()) / way.abs();
        to_side(a, x, cosine).min(to_side(b, y, sine))
    }
}

fn ellipse([a, b]: [f64; 2]) -> impl Fn(f64) -> f64 {
    move |angle: f64| ((angle.cos() / a).powi(2) + (angle.sin() / b).powi(2)).sqrt().recip()
}

#[test]
fn rectangles_and_ellipses_pass_their_solid_angle() {
    let beam = of_outline(|_| HALF_MM);
    let cases = [
        ("  SQAP 1.6 0.9 0\n", of_outline(rectangle([1.6, 0.9], [0.0; 2]))),
        ("  SQAP 1.2 0.9 0\n  OBDC 0.3 -0.5\n", of_outline(rectangle([1.2, 0.9], [0.3, -0.5]))),
        ("  ELAP 0.7 2.1 0\n", of_outline(ellipse([0.7, 2.1]))),
        // Wider than the beam in y: the narrower of both decides.
        ("  SQAP 1.6 4 0\n", of_outline(|p| rectangle([1.6, 4.0], [0.0; 2])(p).min(HALF_MM))),
        ("  SQOB 1.5 0.5 0\n", beam - of_outline(rectangle([1.5, 0.5], [0.0; 2]))),
        ("  ELOB 0.5 1.5 0\n", beam - of_outline(ellipse([0.5, 1.5]))),
        (
            "  ELOB 0.5 0.7 0\n  SQAP 2 1.4 0\n",
            of_outline(|p| rectangle([2.0, 1.4], [0.0; 2])(p).min(HALF_MM))
                - of_outline(ellipse([0.5, 0.7])),
        ),
    ];
    for (apertures, expected) in cases {
        let lens = lens(apertures);
        assert!(lens.asymmetry().unwrap().contains("surface 1 has a"), "{apertures}");
        // 512 azimuths: 2.5e-5 of a circle, some 1e-4 where corners fall between them.
        let found = solid_angle(lens).unwrap();
        assert!((found / expected - 1.0).abs() < 3e-4, "{apertures}: {found}, not {expected}");
    }
}

/// Slits between whose corners azimuths fall: a hundred times as wide as high, 9 % of the light was
/// lost in silence.
#[test]
fn slits_have_their_light_or_are_refused() {
    for (half_height, resolved) in [(0.3, true), (0.1, true), (0.02, false), (1e-6, false)] {
        match solid_angle(lens(&format!("  SQAP 2 {half_height} 0\n"))) {
            Ok(found) => {
                let expected = of_outline(rectangle([2.0, half_height], [0.0; 2]));
                assert!(
                    resolved && (found / expected - 1.0).abs() < 0.01,
                    "{half_height}: {found}"
                );
            }
            Err(error) => {
                let error = error.to_string();
                assert!(!resolved && error.contains("too narrow"), "{half_height}: {error}");
            }
        }
    }
}

/// Found by fuzzing: what passes the first surface is stopped by the last. What rounding left of
/// the pupil asked for more cells than there is memory, and gave relative illuminations of 1e15.
#[test]
fn a_pupil_without_light_on_the_axis_is_refused() {
    let blocked = include_str!("../../../../../fuzz/seeds/zmx/sliver.zmx");
    let lens = zmx::read(blocked, &Catalogue::default()).unwrap();
    let system = System::new(lens, Conditions::default()).unwrap();
    let error = field_points(&system, &[0.0, 5.0], &[550.0]).unwrap_err().to_string();
    assert!(error.contains("no light") && error.contains("field 0.0000°"), "{error}");
}

/// What light passes behind an obstacle beside the middle cannot be told from an outline.
#[test]
fn an_obstacle_beside_the_middle_of_the_pupil_is_refused() {
    for obstacle in ["  OBSC 0 0.3 0\n  OBDC 1.5 0\n", "  SQOB 0.3 0.3 0\n  OBDC 0 1\n"] {
        let error = solid_angle(lens(obstacle)).unwrap_err().to_string();
        assert!(error.contains("does not cover the middle of the pupil"), "{error}");
    }
    assert!(solid_angle(lens("  OBSC 0 0.3 0\n  OBDC 0.2 0\n")).is_ok());
}

#[test]
fn code_v_and_zemax_files_say_the_same_apertures() {
    let told = |apertures: &str| {
        let text = format!(
            "RDM\nEPD 5\nWL 550\nYAN 0\nSO 0 1e13\nS 0 1\n{apertures}S 0 3 1.5:60\nSTO\nS -5 10\n\
             SI 0 0\nGO\n"
        );
        Ok::<_, camrig_base::Error>(
            seq::read(&text, &Catalogue::default())?.surfaces[0].clips.clone(),
        )
    };
    for (code_v, zemax) in [
        ("REX 1.2; REY 0.9\nADX 0.3; ADY -0.5\n", "  SQAP 1.2 0.9 0\n  OBDC 0.3 -0.5\n"),
        ("ELX CLR L'A' 0.7\nELY CLR L'A' 2.1\n", "  ELAP 0.7 2.1 0\n"),
        ("REX OBS L'B' 1.5\nREY OBS L'B' 0.5\n", "  SQOB 1.5 0.5 0\n"),
        ("ELX OBS 0.5\nELY OBS 1.5\n", "  ELOB 0.5 1.5 0\n"),
        ("REX EDG 3\nREY EDG 2\n", ""),
    ] {
        assert_eq!(told(code_v).unwrap(), lens(zemax).surfaces[0].clips, "{code_v}");
    }
    let clip = Clip::opening(Shape::Rectangle, [2.0, 1.0]);
    assert!(clip.excess(1.9, 0.9) < 0.0 && clip.excess(1.9, 1.1) > 0.0);
    for (wrong, words) in [
        ("REY 2\n", "REY without the width in x"),
        ("REX 2\n", "widths in x and y"),
        ("REX 2\nELY 2\n", "ELY without"),
        ("REX 2\nREY 0\n", "widths in x and y"),
        ("REX 2 3\nREY 1\n", "not understood"),
    ] {
        let error = told(wrong).unwrap_err().to_string();
        assert!(error.contains(words), "{wrong}: {error}");
    }
}

/// The lens with keys of a TOML prescription for its apertures.
fn in_toml(keys: &str) -> Result<Prescription> {
    let text = format!(
        "format = 'camrig-prescription/1'\nwavelengths_nm = [550.0]\nfields_deg = [0.0]\n\
         [aperture]\nentrance_pupil_mm = {}\n[[surface]]\nthickness_mm = 1.0\n{keys}\
         [[surface]]\nstop = true\nthickness_mm = 3.0\nglass = 'flat'\n[[surface]]\n\
         radius_mm = -5.0\nconic = -2.25\nthickness_mm = {FOCUS_MM}\n[glass.flat]\nnd = 1.5\n",
        2.0 * HALF_MM
    );
    toml::read(&text, &Catalogue::default())
}

/// Rays on a grid over the first surface and the solid angle behind it.
#[test]
fn a_toml_prescription_clips_the_rays_that_the_zemax_file_clips() {
    for (keys, zemax) in [
        ("aperture_rectangle_mm = [1.6, 0.9]\n", "  SQAP 1.6 0.9 0\n"),
        (
            "aperture_rectangle_mm = [1.2, 0.9]\naperture_centre_mm = [0.3, -0.5]\n",
            "  SQAP 1.2 0.9 0\n  OBDC 0.3 -0.5\n",
        ),
        ("aperture_ellipse_mm = [0.7, 2.1]\n", "  ELAP 0.7 2.1 0\n"),
        ("obscuration_rectangle_mm = [1.5, 0.5]\n", "  SQOB 1.5 0.5 0\n"),
        (
            "obscuration_ellipse_mm = [0.5, 0.7]\naperture_rectangle_mm = [2.0, 1.4]\n\
             aperture_radius_mm = 2.2\n",
            "  ELOB 0.5 0.7 0\n  SQAP 2 1.4 0\n  CLAP 0 2.2 0\n",
        ),
    ] {
        let (ours, theirs) = (in_toml(keys).unwrap(), lens(zemax));
        let passes = |lens: &Prescription, x: f64, y: f64| {
            lens.surfaces[0].clips.iter().all(|clip| clip.excess(x, y) <= 0.0)
        };
        let rays = || (0..41 * 41).map(|i| [i % 41, i / 41].map(|k| 0.125 * (k - 20) as f64));
        assert!(rays().any(|[x, y]| passes(&theirs, x, y)), "{keys}");
        assert!(rays().any(|[x, y]| !passes(&theirs, x, y)), "{keys}");
        for [x, y] in rays() {
            assert_eq!(passes(&ours, x, y), passes(&theirs, x, y), "{keys} at ({x}, {y})");
        }
        let [ours, theirs] = [ours, theirs].map(|lens| solid_angle(lens).unwrap());
        assert!((ours / theirs - 1.0).abs() < 1e-12, "{keys}: {ours}, not {theirs}");
    }
}

#[test]
fn apertures_that_make_no_sense_are_refused_with_their_surface() {
    for (keys, words) in [
        ("aperture_rectangle_mm = [-1.0, 2.0]\n", "aperture_rectangle_mm = [-1.0, 2.0]"),
        ("aperture_ellipse_mm = [1.0, nan]\n", "aperture_ellipse_mm = [1.0, NaN]"),
        ("obscuration_ellipse_mm = [0.0, 1.0]\n", "each above 0"),
        ("obscuration_rectangle_mm = [1.0, inf]\n", "each above 0"),
        ("aperture_rectangle_mm = [1.0]\n", "line 8"),
        ("aperture_radius_mm = -inf\n", "aperture from 0 to -inf"),
        ("aperture_radius_mm = nan\n", "to NaN"),
        ("aperture_radius_mm = 1.0\nobscuration_radius_mm = 2.0\n", "from 2 to 1"),
        (
            "aperture_rectangle_mm = [1.0, 2.0]\nobscuration_rectangle_mm = [1.5, 2.5]\n",
            "covers the whole aperture",
        ),
        (
            "aperture_rectangle_mm = [0.6, 0.7]\nobscuration_ellipse_mm = [1.0, 1.0]\n",
            "covers the whole aperture",
        ),
        (
            "aperture_ellipse_mm = [1.0, 2.0]\nobscuration_rectangle_mm = [1.0, 2.0]\n",
            "covers the whole aperture",
        ),
    ] {
        let error = in_toml(keys).unwrap_err().to_string();
        let placed = error.contains("surface 1") || error.contains("line 8");
        assert!(error.contains(words) && placed, "{keys}: {error}");
    }
    // The corners stand out.
    let corners = "aperture_rectangle_mm = [0.8, 0.8]\nobscuration_ellipse_mm = [1.0, 1.0]\n";
    assert!(in_toml(corners).is_ok());
}

fn system(on_stop: &str) -> System {
    System::new(lens_of("", on_stop), Conditions::default()).unwrap()
}

/// The solid angle of a characterisation over heights.
fn steradians_over_heights(system: &System) -> f64 {
    characterise(system, &plan_of_heights(), &|_, _| ()).unwrap().steradians(550.0)
}

fn plan_of_heights() -> Plan {
    Plan {
        heights: 2,
        density: None,
        max_field_deg: 1.0,
        wavelengths_nm: vec![550.0],
        psf_size: 16,
        psf_spacing_um: None,
        method: PsfMethod::Geometric,
    }
}

fn plan_of_plane() -> PlanePlan {
    PlanePlan {
        frame_mm: [0.2, 0.2],
        density: None,
        wavelengths_nm: vec![550.0],
        psf_size: 16,
        psf_spacing_um: None,
        method: PsfMethod::Geometric,
    }
}

fn steradians(system: &System) -> [f64; 2] {
    let plane = field::characterise(system, &plan_of_plane(), &|_, _| ()).unwrap();
    [steradians_over_heights(system), plane.steradians(550.0)]
}

/// Over heights and over the plane alike.
#[test]
fn a_traced_lens_has_the_solid_angle_of_its_real_cone() {
    let real = PI * sine_squared(HALF_MM);
    let paraxial = PI / (1.0 + 4.0 * 4.0);
    assert!(real / paraxial < 0.95, "{real} {paraxial}");
    // The outline is a polygon of 255 sides over half a circle: 2.5e-5 too small.
    for found in steradians(&system("")) {
        assert!((found / real - 1.0).abs() < 1e-4, "{found} instead of {real}");
    }
    let obscured = real - PI * sine_squared(OBSCURED_MM);
    for found in steradians(&system(&format!("  OBSC 0 {OBSCURED_MM} 0\n"))) {
        assert!((found / obscured - 1.0).abs() < 1e-4, "{found} instead of {obscured}");
    }
}

/// Height on the front plane, 3 mm before the vertex in the glass, of the ray that leaves the
/// hyperboloid at the angle θ with the axis for the axis' point `sensor_mm` behind the vertex.
fn height_on_stop(theta: f64, sensor_mm: f64) -> f64 {
    let (c, n) = (-0.2, 1.5);
    let root = |h: f64| (1.0 + 1.25 * c * c * h * h).sqrt();
    let sag = |h: f64| c * h * h / (1.0 + root(h));
    let h = bisected(|h| h - (sensor_mm - sag(h)) * theta.tan(), 6.0);
    // Snell's law about the normal, which is turned by the slope of the surface.
    let normal = (-c * h / root(h)).atan();
    let inside = ((theta + normal).sin() / n).asin() - normal;
    h + (3.0 + sag(h)) * inside.tan()
}

/// Where a rising function crosses 0 between 0 and `high`.
fn bisected(f: impl Fn(f64) -> f64, mut high: f64) -> f64 {
    let mut low = 0.0;
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if f(middle) < 0.0 { &mut low } else { &mut high }) = middle;
    }
    0.5 * (low + high)
}

/// By the invariance of radiance a scene without detail lights the sensor's axis by the rays that
/// reach it through the stop, found backwards: at f/5, and a millimetre out of focus by a sixth
/// less than in the cone that meets in the focus.
#[test]
fn a_sensor_out_of_focus_gets_the_light_of_the_rays_that_reach_it() {
    let half_mm = 1.0;
    let lens = |shift_mm: f64| {
        let mut lens = lens_of("", "");
        lens.aperture = Aperture::EntrancePupil(2.0 * half_mm);
        let conditions = Conditions { sensor_shift_mm: shift_mm, ..Conditions::default() };
        steradians(&System::new(lens, conditions).unwrap())
    };
    for (shift_mm, tolerance) in [(0.0, 1e-4), (-0.5, 2e-3), (0.5, 2e-3), (1.0, 4e-3)] {
        let sensor_mm = FOCUS_MM + shift_mm;
        let theta = bisected(|theta| height_on_stop(theta, sensor_mm) - half_mm, 0.5);
        let right = PI * theta.sin().powi(2);
        for found in lens(shift_mm) {
            assert!((found / right - 1.0).abs() < tolerance, "{shift_mm}: {found}, not {right}");
        }
    }
    assert!(lens(1.0)[0] < 0.87 * lens(0.0)[0]);
}

/// Projected solid angle of a disc of radius `a` seen from `r` off its axis in a plane `d` away
/// (Foote, Bull. Bureau of Standards 12, 583, 1916), sr.
fn disc(a: f64, d: f64, r: f64) -> f64 {
    let sum = d * d + r * r;
    0.5 * PI * (1.0 - (sum - a * a) / ((sum + a * a).powi(2) - 4.0 * r * r * a * a).sqrt())
}

/// A stop behind the lens is its exit pupil: every place of the sensor sees it as a disc, in focus
/// or not, and where the image of a singlet is curved away from the sensor.
#[test]
fn a_stop_behind_the_lens_lights_the_sensor_as_a_disc() {
    let (radius_mm, focus_mm) = (4.0, 43.6);
    for shift_mm in [0.0, -2.0, 2.0] {
        let distance_mm = focus_mm + shift_mm;
        let text = format!(
            "format = 'camrig-prescription/1'\nwavelengths_nm = [550.0]\nfields_deg = [0.0]\n\
             [aperture]\nstop_radius_mm = {radius_mm}\n[[surface]]\nradius_mm = 50.0\n\
             thickness_mm = 3.0\nglass = 'N-BK7'\n[[surface]]\nradius_mm = -50.0\n\
             thickness_mm = 4.0\n[[surface]]\nstop = true\nthickness_mm = {distance_mm}\n"
        );
        let lens = toml::read(&text, &Catalogue::default()).unwrap();
        let system = System::new(lens, Conditions::default()).unwrap();
        let plan = Plan { max_field_deg: 12.0, heights: 4, ..plan_of_heights() };
        let over_heights = characterise(&system, &plan, &|_, _| ()).unwrap();
        let plan = PlanePlan { frame_mm: [12.0, 9.0], ..plan_of_plane() };
        let over_plane = field::characterise(&system, &plan, &|_, _| ()).unwrap();
        let heights = over_heights.real_height_mm.iter().zip(&over_heights.relative_illumination);
        let heights = heights.map(|(r, part)| (*r, part * over_heights.steradians(550.0)));
        let places = over_plane.real_x_mm.iter().zip(&over_plane.real_y_mm);
        let places = places.zip(&over_plane.relative_illumination);
        let places =
            places.map(|((x, y), part)| (x.hypot(*y), part * over_plane.steradians(550.0)));
        for (r, found) in heights.chain(places) {
            let right = disc(radius_mm, distance_mm, r);
            assert!((found / right - 1.0).abs() < 1e-4, "{distance_mm} {r}: {found} {right}");
        }
    }
}
