//! The tracer and the readers against files of other programs and their figures.

use super::*;
use camrig_glass::text;
use camrig_lens::characterise;
use camrig_lens::pupil::{Beam, Bundle};
use camrig_prescription::Conditions;
pub(super) use camrig_testing::shared;
use serde_json::Value;

fn json(path: &Path) -> Value {
    // Python writes NaN, which JSON has not.
    let text = std::fs::read_to_string(path).unwrap().replace("NaN", "null");
    serde_json::from_str(&text).unwrap()
}

fn list(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// A golden lens (JSON) rewritten as our TOML, and read.
pub(super) fn golden_lens(lens: &Value) -> Prescription {
    let mut text = format!(
        "format = \"camrig-prescription/1\"\nwavelengths_nm = [{0:?}]\nfields_deg = [0.0, {1:?}]\n\
         [aperture]\nentrance_pupil_mm = {2:?}\n",
        lens["ref_wvl_nm"].as_f64().unwrap(),
        lens["fields_deg_max"].as_f64().unwrap(),
        lens["epd"].as_f64().unwrap()
    );
    for s in lens["surfaces"].as_array().unwrap() {
        text += &format!("[[surface]]\ncurvature = {:?}\n", s["c"].as_f64().unwrap());
        text += &format!("thickness_mm = {:?}\n", s["t"].as_f64().unwrap());
        if s["glass"] != "air" {
            text += &format!("glass = {}\n", s["glass"]);
        }
        if let Some(k) = s["k"].as_f64() {
            text += &format!("conic = {k:?}\n");
        }
        if let Some(sd) = s["sd"].as_f64() {
            text += &format!("aperture_radius_mm = {sd:?}\n");
        }
        if s["stop"] == true {
            text += "stop = true\n";
        }
        if s["poly_odd_even_from_r1"].is_array() {
            let all = list(&s["poly_odd_even_from_r1"]);
            let every =
                |from: usize| all.iter().skip(from).step_by(2).copied().collect::<Vec<_>>();
            text += &format!("odd = {:?}\neven = {:?}\n", every(0), every(1));
        }
    }
    let table = &lens["n_table"];
    for (name, n) in table.as_object().unwrap() {
        if name != "wvl_nm" && !lens["glasses"].is_object() {
            let rows: Vec<[f64; 2]> =
                list(&table["wvl_nm"]).into_iter().zip(list(n)).map(|(a, b)| [a, b]).collect();
            text += &format!("[glass.\"{name}\"]\ntable_nm = {rows:?}\n");
        }
    }
    toml::read(&text, &Catalogue::default()).unwrap()
}

/// Chief rays, their angles and relative illumination of the golden lenses, which an independent
/// program traced; tolerances as agreed for such comparisons.
#[test]
fn golden_lenses_chief_rays_and_illumination() {
    let Some(dir) = shared("golden/lenses") else { return };
    for name in ["double_gauss", "phone80"] {
        let oracle = json(&dir.join(format!("oracle_{name}.json")));
        let lens = golden_lens(&json(&dir.join(format!("lens_{name}.json"))));
        let system = System::new(lens, Conditions::default()).unwrap();
        let paraxial = &oracle["paraxial_ref"];
        let p = system.paraxial;
        assert!((p.efl_mm - paraxial["efl"].as_f64().unwrap()).abs() < 1e-9);
        assert!((p.bfl_mm - paraxial["bfl"].as_f64().unwrap()).abs() < 1e-9);
        let pupil = paraxial["entrance_pupil_z_from_s1"].as_f64().unwrap();
        assert!((p.entrance_z_mm - pupil).abs() < 1e-9);
        assert!((system.f_number() - paraxial["fno"].as_f64().unwrap()).abs() < 1e-9);
        let stop = oracle["settings"]["stop_radius_mm"].as_f64().unwrap();
        assert!((system.stop_radius_mm - stop).abs() < 1e-9);
        let mut worst = [0.0_f64; 3];
        for (w, nm) in list(&oracle["wvl_nm"]).into_iter().enumerate() {
            let train = system.at(nm).unwrap();
            let axis = Beam::aim(&train, 0.0).unwrap().outline(256).unwrap();
            for (f, deg) in list(&oracle["theta_deg"]).into_iter().enumerate() {
                let beam = Beam::aim(&train, deg).unwrap();
                let at = |key: &str| oracle[key][f][w].as_f64().unwrap();
                let illumination = beam.outline(256).unwrap().projected_solid_angle()
                    / axis.projected_solid_angle();
                for (i, difference) in [
                    beam.height_mm() - at("chief_y_mm"),
                    beam.chief_ray_angle_deg() - at("cra_deg"),
                    illumination - at("rel_illum"),
                ]
                .into_iter()
                .enumerate()
                {
                    worst[i] = worst[i].max(difference.abs());
                }
                let radius = at("ref_sphere_R_mm");
                assert!((beam.reference_sphere_mm() - radius).abs() < 1e-9 * radius);
            }
        }
        println!("{name}: height {:.1e} mm, CRA {:.1e}°, RI {:.1e}", worst[0], worst[1], worst[2]);
        assert!(worst[0] < 1e-6 && worst[1] < 1e-4 && worst[2] < 1e-4, "{name}: {worst:?}");
    }
}

/// PSFs of the golden lenses after binning to pixels of 8 samples; OPD; and the fast PSF against
/// the plain sum. 1 % of the peak is what the golden data's own convergence allows, for spots
/// below 20 µm rms.
#[test]
fn golden_lenses_psfs_and_wavefronts() {
    use camrig_lens::{psf, samples::PupilSamples};
    let Some(dir) = shared("golden/lenses") else { return };
    for name in ["double_gauss", "phone80"] {
        let oracle = json(&dir.join(format!("oracle_{name}.json")));
        let lens = golden_lens(&json(&dir.join(format!("lens_{name}.json"))));
        let system = System::new(lens, Conditions::default()).unwrap();
        let spacing_mm = oracle["settings"]["psf_spacing_mm"].as_f64().unwrap();
        let window = psf::Window { size: 128, spacing_mm };
        let golden = golden_psfs(&dir.join(format!("oracle_{name}_psf.npz")));
        for (f, w) in [(0, 0), (0, 3), (2, 1), (5, 3), (5, 6), (8, 2), (10, 3)] {
            let deg = oracle["theta_deg"][f].as_f64().unwrap();
            let nm = oracle["wvl_nm"][w].as_f64().unwrap();
            let train = system.at(nm).unwrap();
            let beam = Beam::aim(&train, deg).unwrap();
            let outline = beam.outline(256).unwrap();
            let cells = psf::cells_across(&beam, &outline, &window).unwrap();
            let samples = PupilSamples::trace(&beam, &outline, cells);
            let (rms, _) = PupilSamples::trace(&beam, &outline, 513).opd_rms_pv();
            let fast = psf::diffraction(&samples, nm, &window);
            let theirs = &golden[(f * 7 + w) * 128 * 128..][..128 * 128];
            let pixels = |data: &[f64]| {
                let mut sums = vec![0.0; 16 * 16];
                for (i, v) in data.iter().enumerate() {
                    sums[i / 128 / 8 * 16 + i % 128 / 8] += v;
                }
                sums
            };
            let (a, b) = (pixels(&fast.data), pixels(theirs));
            let peak = b.iter().copied().fold(0.0, f64::max);
            let worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / peak;
            let at = |key: &str| oracle[key][f][w].as_f64().unwrap();
            // The golden grid is a set of whole cells, ours ends at the rim: of 30 waves' slope
            // there little remains in the mean square.
            assert!((rms - at("opd_rms_waves")).abs() < 1e-3, "{name} {deg}° {nm} nm: OPD");
            assert!(
                worst < 0.01 || samples.spot_rms_mm() > 0.02,
                "{name} {deg}° {nm} nm: {worst}"
            );
            if f == 5 {
                let window = psf::Window { size: 33, ..window };
                let fast = psf::diffraction(&samples, nm, &window);
                let slow = psf::direct(&samples, nm, &window);
                let peak = slow.data.iter().copied().fold(0.0, f64::max);
                let off = fast.data.iter().zip(&slow.data).map(|(a, b)| (a - b).abs() / peak);
                let off = off.fold(0.0, f64::max);
                assert!(off < 1e-6, "{name} {deg}° {nm} nm: fast against direct {off}");
                assert!((fast.captured - slow.captured).abs() < 1e-6);
            }
            println!(
                "{name} {deg}° {nm} nm: spot {:.4} mm, PSF {worst:.1e} of the peak, \
                 OPD rms {:.1e} waves",
                samples.spot_rms_mm(),
                rms - at("opd_rms_waves")
            );
        }
    }
}

/// The golden PSF archive as one flat list [field][wavelength][row][column].
pub(super) fn golden_psfs(path: &Path) -> Vec<f64> {
    use std::io::Read;
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let index = (0..archive.len())
        .find(|i| archive.by_index(*i).unwrap().name().unwrap().starts_with("psf"))
        .unwrap();
    let mut bytes = Vec::new();
    archive.by_index(index).unwrap().read_to_end(&mut bytes).unwrap();
    let file = &mut &bytes[..];
    let header = camrig_base::npy::Header::read(file).unwrap();
    let samples = header.samples::<f32>(file, bytes.len() as u64).unwrap();
    samples.into_iter().map(f64::from).collect()
}

/// A phone lens with odd and even powers of r (US 7,535,658), whose chief rays two programs
/// traced: the reference's own figures are met, and optiland's within the tolerance of its aiming.
#[test]
fn odd_polynomials_agree_with_two_other_programs() {
    let Some(dir) = shared("golden/lenses") else { return };
    let Some(file) = shared("data/lenses/lens_phone_us7535658.json") else { return };
    let lens = golden_lens(&json(&file));
    assert!(lens.surfaces.iter().any(|s| !s.odd.is_empty()));
    let widest = lens.fields.values[1];
    let system = System::new(lens, Conditions::default()).unwrap();
    let checks = &json(&dir.join("xcheck_optiland.json"))["lens_phone_us7535658.json"]["chief"];
    for row in checks.as_array().unwrap() {
        let [nm, part, height, optiland, angle, _] = list(row)[..] else { panic!("{row}") };
        let train = system.at(nm).unwrap();
        let beam = Beam::aim(&train, part * widest).unwrap();
        assert!((beam.height_mm() - height).abs() < 1e-6, "{nm} nm, {part}: {}", beam.height_mm());
        assert!((beam.height_mm() - optiland).abs() < 1e-6);
        assert!((beam.chief_ray_angle_deg() - angle).abs() < 1e-4);
    }
}

/// A paraboloid mirror images an axial point without aberration: its PSF is the Airy pattern, or
/// the ring pattern of an obscured pupil (Born and Wolf, 8.5.2 and 8.6.2), and the outline's solid
/// angle is that of the ring.
#[test]
fn a_perfect_mirror_gives_the_airy_pattern() {
    use camrig_lens::{psf, samples::PupilSamples};
    // J1 by its integral (2/π)∫ sin(x sin t) sin t over 0..π/2: the trapezoid rule converges fast.
    let j1 = |x: f64| {
        let n = 400;
        let f = |i: usize| {
            let t = std::f64::consts::FRAC_PI_2 * i as f64 / n as f64;
            (x * t.sin()).sin() * t.sin() * if i == 0 || i == n { 0.5 } else { 1.0 }
        };
        (0..=n).map(f).sum::<f64>() / n as f64
    };
    let airy = |x: f64| if x.abs() < 1e-9 { 1.0 } else { 2.0 * j1(x) / x };
    for obscured in [0.0, 1.0] {
        let text = format!(
            "format = \"camrig-prescription/1\"\nwavelengths_nm = [550.0]\nfields_deg = [0.0]\n\
             [aperture]\nstop_radius_mm = 2.5\n[[surface]]\nradius_mm = -200.0\nconic = -1.0\n\
             thickness_mm = -100.0\nglass = \"mirror\"\nstop = true\n\
             obscuration_radius_mm = {obscured:?}\n"
        );
        let lens = toml::read(&text, &Catalogue::default()).unwrap();
        let system = System::new(lens, Conditions::default()).unwrap();
        let train = system.at(550.0).unwrap();
        let beam = Beam::aim(&train, 0.0).unwrap();
        let outline = beam.outline(256).unwrap();
        // Sine of the angle of a ray at height y of a paraboloid: y/(f + y²/4f).
        let sine = |y: f64| y / (100.0 + y * y / 400.0);
        let (outer, inner) = (sine(2.5), sine(obscured));
        let exact = std::f64::consts::PI * (outer * outer - inner * inner);
        assert!((outline.projected_solid_angle() / exact - 1.0).abs() < 5e-5);
        let window = psf::Window { size: 96, spacing_mm: 1e-3 };
        let cells = psf::cells_across(&beam, &outline, &window).unwrap();
        let samples = PupilSamples::trace(&beam, &outline, cells.max(128));
        assert!(samples.opd_rms_pv().1 < 1e-6);
        let psf = psf::diffraction(&samples, 550.0, &window);
        let (part, peak) = (inner / outer, psf.data[48 * 96 + 48]);
        for (k, v) in psf.data.iter().enumerate() {
            let (y, x) = ((k / 96) as f64 - 48.0, (k % 96) as f64 - 48.0);
            let r = (x * x + y * y).sqrt() * 1e-3;
            let q = std::f64::consts::TAU * r * outer / 550e-6;
            let field = (airy(q) - part * part * airy(part * q)) / (1.0 - part * part);
            // The mirror is no aplanat: amplitudes differ from uniform by (y/2f)² = 1.6e-4 at the
            // rim.
            assert!((v / peak - field * field).abs() < 5e-4, "{obscured} {x} {y}: {}", v / peak);
        }
        assert!((0.85..1.0).contains(&psf.captured));
    }
}

/// A fisheye whose two front menisci bend light from behind its front into the stop: chief rays
/// against a tracer of its own in NumPy, which meets spheres by geometry and finds the centre of
/// the stop by bisection.
#[test]
fn a_fisheye_sees_behind_itself() {
    // Radius, thickness and index behind; the stop is plane.
    const FISHEYE: [[f64; 3]; 19] = [
        [20.0, 1.0, 1.713],
        [8.0, 5.0, 1.0],
        [25.0764, 0.7848, 1.713],
        [4.0938, 3.4518, 1.0],
        [20.568, 0.5886, 1.62],
        [4.704, 1.2972, 1.0],
        [5.763, 2.076, 1.669],
        [-16.0716, 0.2592, 1.0],
        [-9.5208, 0.3708, 1.694],
        [4.6938, 1.4826, 1.668],
        [-20.8134, 0.1854, 1.0],
        [6000.0, 0.5562, 1.518],
        [6000.0, 0.5118, 1.0],
        [0.0, 0.6, 1.0],
        [-317.142, 1.2606, 1.497],
        [-6.828, 0.0372, 1.0],
        [39.6732, 1.8534, 1.487],
        [-3.81, 0.3708, 1.805],
        [-7.6494, 9.3, 1.0],
    ];
    let mut text = String::from(
        "format = \"camrig-prescription/1\"\nwavelengths_nm = [550.0]\nfields_deg = [0.0, 105.0]\n\
         [aperture]\nstop_radius_mm = 0.3\n",
    );
    for [radius, thickness, index] in FISHEYE {
        text += &format!("[[surface]]\nradius_mm = {radius:?}\nthickness_mm = {thickness:?}\n");
        if index > 1.0 {
            text += &format!("glass = \"n{index}\"\n");
        }
        if radius == 0.0 {
            text += "stop = true\n";
        }
    }
    for index in [1.713, 1.62, 1.669, 1.694, 1.668, 1.518, 1.497, 1.487, 1.805] {
        text += &format!("[glass.\"n{index}\"]\nnd = {index:?}\n");
    }
    let lens = toml::read(&text, &Catalogue::default()).unwrap();
    let system = System::new(lens, Conditions::default()).unwrap();
    // Field, height and angle of the chief ray on the image.
    let known = [
        [30.0, 1.624061287196, 7.2255261259],
        [60.0, 3.221086015253, 14.0847230795],
        [85.0, 4.473969543786, 19.1556128505],
        [95.0, 4.924546775495, 20.8939335260],
        [105.0, 5.321316184500, 22.3827798339],
    ];
    let fields: Vec<f64> = known.iter().map(|k| k[0]).collect();
    let points = characterise::field_points(&system, &fields, &[550.0]).unwrap();
    for (point, [deg, height, angle]) in points.iter().zip(known) {
        assert!((point.chief_ray_height_mm - height).abs() < 1e-9, "{deg}: {point:?}");
        assert!((point.cra_deg - angle).abs() < 1e-7, "{deg}: {point:?}");
        assert_eq!(point.distortion_percent.is_nan(), deg >= 90.0);
        assert!((0.1..2.0).contains(&point.relative_illumination), "{point:?}");
    }
    // Heights that only such fields reach are found too.
    let deg = system.field_of_real_height(known[4][1]).unwrap();
    assert!((deg - 105.0).abs() < 1e-7, "{deg}");
    // A plane in front of the lens ends before 90°.
    let mut near = system.prescription.clone();
    near.object = camrig_prescription::Object::Distance(500.0);
    let near = System::new(near, Conditions::default()).unwrap();
    let error = characterise::field_points(&near, &[95.0], &[550.0]).unwrap_err().to_string();
    assert!(error.contains("between -90° and 90°"), "{error}");
}

/// Prescriptions and listings with bytes changed, dropped or doubled: an error or a lens, never a
/// panic, and no lens that panics when traced.
mod fuzz {
    use super::*;
    use proptest::prelude::*;

    const ZMX: &str = include_str!("fuzz/lens.zmx");
    const SEQ: &str = include_str!("fuzz/lens.seq");
    const TOML: &str = include_str!("fuzz/lens.toml");
    const AGF: &str = "CC own\nNM OWN 2 517642 1.5168 64.2 0 1 0\nED 7 8 2 0 0\n\
                       CD 1.04 0.006 0.23 0.02 1.01 103.6\nTD 0 0 0\nLD 0.3 2.5\n";

    /// Lines removed, repeated, swapped, and words replaced.
    fn mutated(text: &'static str) -> impl Strategy<Value = String> {
        let lines = text.lines().count();
        let word = prop_oneof![
            Just("0"),
            Just("-1"),
            Just("1e308"),
            Just("-1e308"),
            Just("1e-308"),
            Just("NaN"),
            Just("INFINITY"),
            Just("99999999999999999999"),
            Just(""),
            Just("x"),
            Just("-"),
            Just("MIRROR"),
            Just("true"),
            Just("\u{b5}"),
        ];
        let edit = (0..lines, 0..8usize, 0..4u8, word);
        prop::collection::vec(edit, 1..6).prop_map(move |edits| {
            let mut all: Vec<String> = text.lines().map(str::to_owned).collect();
            for (line, place, kind, word) in edits {
                let line = line.min(all.len().saturating_sub(1));
                if all.is_empty() {
                    break;
                }
                match kind {
                    0 => drop(all.remove(line)),
                    1 => all.insert(line, all[line].clone()),
                    _ => {
                        let indent: String = all[line].chars().take_while(|c| *c == ' ').collect();
                        let mut words: Vec<&str> = all[line].split_whitespace().collect();
                        if !words.is_empty() {
                            let place = place % words.len();
                            words[place] = word;
                        }
                        all[line] = indent + &words.join(" ");
                    }
                }
            }
            all.join("\n")
        })
    }

    fn survive(read: fn(&str, &Catalogue) -> Result<Prescription>, text: &str) {
        let Ok(lens) = read(text, &Catalogue::default()) else { return };
        let Ok(system) = System::new(lens, Conditions::default()) else { return };
        let _ = characterise::field_points(&system, &[0.0, 5.0], &[550.0]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]
        #[test]
        fn zmx(text in mutated(ZMX)) { survive(zmx::read, &text) }
        #[test]
        fn seq(text in mutated(SEQ)) { survive(seq::read, &text) }
        #[test]
        fn toml(text in mutated(TOML)) { survive(camrig_prescription::toml::read, &text) }
        #[test]
        fn agf(text in mutated(AGF)) {
            let mut glasses = Catalogue::default();
            glasses.insert_agf("own", &text);
            if let Ok(found) = glasses.find("OWN", &[]) {
                let _ = found.glass.index(550.0);
            }
        }
        #[test]
        fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let text = text::decode(&bytes);
            survive(zmx::read, &text);
            survive(seq::read, &text);
            let _ = import::listing::psf(&text);
            let _ = import::listing::grid_distortion(&text);
        }
    }

    /// The three files are one lens, told in three ways.
    #[test]
    fn the_same_lens_in_three_formats() {
        let read = |read: fn(&str, &Catalogue) -> Result<Prescription>, text| {
            System::new(read(text, &Catalogue::default()).unwrap(), Conditions::default()).unwrap()
        };
        let all = [
            read(zmx::read, ZMX),
            read(seq::read, SEQ),
            read(camrig_prescription::toml::read, TOML),
        ];
        for system in &all {
            let mut shares = system.prescription.shares();
            shares.sort_by(|a, b| a.0.total_cmp(&b.0));
            assert_eq!(shares, [(486.1, 0.375), (587.6, 0.5), (656.3, 0.125)]);
        }
        let points = |s: &System| {
            characterise::field_points(s, &[0.0, 8.0, 14.0], &[486.1, 587.6]).unwrap()
        };
        let first = points(&all[0]);
        assert!(first[5].relative_illumination < 0.9);
        for other in &all[1..] {
            for (a, b) in first.iter().zip(points(other)) {
                assert!((a.chief_ray_height_mm - b.chief_ray_height_mm).abs() < 1e-9);
                assert!((a.relative_illumination - b.relative_illumination).abs() < 1e-7);
                assert!((a.opd_rms_waves - b.opd_rms_waves).abs() < 1e-6);
            }
        }
    }
}
