//! Simulated capture sets, from equations independent of the sensor model, each with one nuisance.

use super::*;
use camrig_base::Plane;
use camrig_captures::CaptureSet;
use camrig_formats::{Facts, Format, Frames};
use rand_distr::{Distribution, Exp, Normal, Poisson};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use std::path::Path;

const W: usize = 64;
const H: usize = 48;
const BLACK: f64 = 80.0;
/// DN per electron.
const K: f64 = 0.5;
const READ_E: f64 = 4.0;

/// A stack to simulate: id, electrons of light, exposure, frames.
type Plan = (&'static str, f64, f64, usize);

const PLAN: [Plan; 8] = [
    ("dark-a", 0.0, 0.02, 16),
    ("dark-b", 0.0, 2.0, 16),
    ("flat-a", 400.0, 0.02, 12),
    ("flat-b", 1200.0, 0.02, 12),
    ("flat-c", 2100.0, 0.02, 12),
    ("flat-d", 3300.0, 0.02, 12),
    ("flat-e", 4700.0, 0.02, 12),
    ("flat-f", 6000.0, 0.02, 12),
];

type Random = Xoshiro256PlusPlus;

/// Changes a frame's electrons, given its stack and number.
type OnElectrons<'a> = dyn FnMut(&mut [f64], &Plan, usize) + 'a;
/// Changes a frame's DN, given its number.
type OnCodes<'a> = dyn FnMut(&mut [f64], usize) + 'a;

/// Changes to each frame: to the mean electrons of light, the electrons with noise, the DN.
#[derive(Default)]
struct Hooks<'a> {
    light: Option<&'a dyn Fn(f64, usize, usize) -> f64>,
    electrons: Option<&'a mut OnElectrons<'a>>,
    codes: Option<&'a mut OnCodes<'a>>,
}

/// Simulates a set; `stated` gives the stated over the true light of each stack.
fn set(
    folder: &Path,
    seed: u64,
    plan: &[Plan],
    mut hooks: Hooks<'_>,
    stated: &dyn Fn(&str) -> f64,
) -> CaptureSet {
    let mut random = Random::seed_from_u64(seed);
    let unit = Normal::new(0.0, 1.0).unwrap();
    let gains: Vec<f64> = (0..W * H).map(|_| 1.0 + 0.006 * unit.sample(&mut random)).collect();
    let mut text = format!(
        "format = \"captures/1\"\n[sensor]\nwidth = {W}\nheight = {H}\nbits = 12\n\
         black_level_dn = {BLACK}\n"
    );
    for (id, light_e, exposure_s, frames) in plan {
        let mut planes = Vec::new();
        for i in 0..*frames {
            let light = hooks.light.map_or(*light_e, |f| f(*light_e, i, *frames));
            let mut e: Vec<f64> = gains
                .iter()
                .map(|g| {
                    let mean = light * g + 10.0 * exposure_s;
                    Poisson::new(mean).unwrap().sample(&mut random)
                        + READ_E * unit.sample(&mut random)
                })
                .collect();
            if let Some(f) = &mut hooks.electrons {
                f(&mut e, &(*id, *light_e, *exposure_s, *frames), i);
            }
            let mut dn: Vec<f64> = e.iter().map(|e| (BLACK + K * e).round()).collect();
            if let Some(f) = &mut hooks.codes {
                f(&mut dn, i);
            }
            let data = dn.iter().map(|v| v.round().clamp(0.0, 4095.0) as u16).collect();
            planes.push(Plane { width: W, height: H, data });
        }
        let bytes = Format::Npy.encode(&Frames { planes, facts: Facts::default() }).unwrap();
        std::fs::write(folder.join(format!("{id}.npy")), bytes).unwrap();
        let role = if *light_e > 0.0 { "flat" } else { "dark" };
        text += &format!(
            "[[capture]]\nid = \"{id}\"\nrole = \"{role}\"\nfiles = \"{id}.npy\"\n\
             exposure_s = {exposure_s}\ntemperature_c = 20\n"
        );
        if *light_e > 0.0 {
            let photons = light_e / 0.5 / exposure_s * stated(id);
            text += &format!(
                "[capture.light]\nphotons_per_pixel_per_s = {photons}\nwavelength_nm = 530\n"
            );
        }
    }
    std::fs::write(folder.join("captures.toml"), text).unwrap();
    CaptureSet::load(folder).unwrap()
}

fn inspected(seed: u64, hooks: Hooks<'_>) -> Cleaned {
    let folder = tempfile::tempdir().unwrap();
    let set = set(folder.path(), seed, &PLAN, hooks, &|_| 1.0);
    let cleaned = Cleaned::inspect(set, &Options::default()).unwrap();
    // Frames are read again while the folder exists.
    let variance = dark_variance(&cleaned);
    let expected = K * K * (READ_E * READ_E + 0.2) + 1.0 / 12.0;
    let unsteady = |f: &Finding| !matches!(f.kind, Kind::ParticleHits | Kind::DefectsAppear);
    if !cleaned.findings.iter().any(unsteady) {
        assert!((variance / expected - 1.0).abs() < 0.04, "{variance} of {expected}");
    }
    cleaned
}

/// Mean over pixels of the variance over time of the first stack, frames level, DN².
fn dark_variance(cleaned: &Cleaned) -> f64 {
    let mut frames: Vec<Vec<f64>> = Vec::new();
    cleaned
        .for_each_batch(0, |planes| {
            frames.extend(
                planes.iter().map(|p| p.data.iter().map(|&v| f64::from(v)).collect::<Vec<_>>()),
            );
            Ok(())
        })
        .unwrap();
    let n = frames.len() as f64;
    let mut sum = 0.0;
    for p in 0..W * H {
        let mean = frames.iter().map(|f| f[p]).sum::<f64>() / n;
        sum += frames.iter().map(|f| (f[p] - mean).powi(2)).sum::<f64>() / (n - 1.0);
    }
    sum / (W * H) as f64
}

fn only(cleaned: &Cleaned) -> &Finding {
    assert_eq!(cleaned.findings.len(), 1, "{:#?}", cleaned.findings);
    &cleaned.findings[0]
}

#[test]
fn nothing_is_found_in_clean_sets() {
    for seed in 1..6 {
        let clean = inspected(seed, Hooks::default());
        assert_eq!(clean.findings, [], "seed {seed}");
    }
}

/// Rows from 30 on of two frames of the longer dark stack have 1 s less of a dark current of 10
/// e⁻/s: 5 DN.
#[test]
fn torn_frames_are_named_with_their_rows_and_left_out() {
    let mut tear = |e: &mut [f64], plan: &Plan, i: usize| {
        if plan.0 == "dark-b" && [3, 8].contains(&i) {
            e[30 * W..].iter_mut().for_each(|v| *v -= 10.0);
        }
    };
    let folder = tempfile::tempdir().unwrap();
    let hooks = Hooks { electrons: Some(&mut tear), ..Hooks::default() };
    let set = set(folder.path(), 77, &PLAN, hooks, &|_| 1.0);
    let cleaned = Cleaned::inspect(set, &Options::default()).unwrap();
    let found = only(&cleaned);
    assert_eq!(
        (found.kind, &found.place[..], &found.frames[..]),
        (Kind::TornFrames, "dark-b", &[3, 8][..])
    );
    assert!(found.description.contains("3 from row 30 on"), "{}", found.description);
    assert!((found.amount.unwrap() - 5.0).abs() < 0.2, "{found:?}");
    let captures = &cleaned.set().captures;
    assert_eq!(cleaned.set().count(&captures[1]).unwrap(), 14);
    assert_eq!(cleaned.for_each_batch(1, |_| Ok(())).unwrap(), 14);
}

/// A level that walks from row to row, anew in each frame, has steps everywhere.
#[test]
fn noise_that_follows_itself_over_rows_is_no_tear() {
    let mut random = Random::seed_from_u64(5);
    let unit = Normal::new(0.0, 1.0).unwrap();
    let mut walk = |e: &mut [f64], _: &Plan, _: usize| {
        let mut level = 0.0;
        for row in e.chunks_mut(W) {
            level += unit.sample(&mut random);
            row.iter_mut().for_each(|v| *v += level);
        }
    };
    let folder = tempfile::tempdir().unwrap();
    let hooks = Hooks { electrons: Some(&mut walk), ..Hooks::default() };
    let set = set(folder.path(), 78, &PLAN, hooks, &|_| 1.0);
    let cleaned = Cleaned::inspect(set, &Options::default()).unwrap();
    assert!(
        cleaned.findings().iter().all(|f| f.kind != Kind::TornFrames),
        "{:?}",
        cleaned.findings()
    );
}

#[test]
fn random_offsets_of_frames_are_neither_a_curve_nor_events() {
    let mut random = Random::seed_from_u64(77);
    let unit = Normal::new(0.0, 1.0).unwrap();
    let mut offsets = |e: &mut [f64], _: &Plan, _: usize| {
        let z: f64 = unit.sample(&mut random);
        e.iter_mut().for_each(|v| *v += 3.0 * z);
    };
    let found = findings_of(7, Hooks { electrons: Some(&mut offsets), ..Hooks::default() });
    assert_eq!(found, []);
}

#[test]
fn particle_hits_are_counted_and_excluded() {
    let mut random = Random::seed_from_u64(88);
    let charge = Exp::new(1.0 / 500.0).unwrap();
    let mut hits = |e: &mut [f64], (_, _, exposure_s, _): &Plan, _: usize| {
        let n: f64 = Poisson::new(1.0 + 2.0 * exposure_s).unwrap().sample(&mut random);
        for _ in 0..n as usize {
            let at: f64 =
                rand_distr::Uniform::new(0.0, (W * H - 4) as f64).unwrap().sample(&mut random);
            let q: f64 = charge.sample(&mut random);
            // Two thirds in one pixel, a third in the next.
            e[at as usize] += 0.67 * q;
            e[at as usize + 1] += 0.33 * q;
        }
    };
    let clean = inspected(8, Hooks { electrons: Some(&mut hits), ..Hooks::default() });
    let found = only(&clean);
    assert_eq!((found.kind, found.done), (Kind::ParticleHits, Done::Excluded));
    let hit = &found.hits[0];
    assert!(hit.charge_dn > 0.0 && hit.pixel == found.pixels[0], "{hit:?}");
    let rate = found.rate.unwrap();
    let (b, se) = (rate.per_s.unwrap(), rate.per_s_std_error.unwrap());
    // Small charges stay below the limit: a tenth in the darks.
    assert!((b - 1.8).abs() < 3.5 * se, "{rate:?}");
    assert!((rate.per_frame - 0.9).abs() < 3.5 * rate.per_frame_std_error, "{rate:?}");
}

#[test]
fn telegraph_noise_and_heavy_tails_are_not_hits() {
    let mut random = Random::seed_from_u64(99);
    let even = rand_distr::Uniform::new(0.0, 1.0).unwrap();
    let pixels: Vec<usize> = (0..25).map(|i| (i * 977 + 31) % (W * H)).collect();
    let mut jumps = |e: &mut [f64], _: &Plan, _: usize| {
        for &p in &pixels {
            if even.sample(&mut random) < 0.15 {
                e[p] += 250.0;
            }
        }
    };
    let clean = findings_of(9, Hooks { electrons: Some(&mut jumps), ..Hooks::default() });
    assert!(clean.is_empty(), "{clean:#?}");
    let mut random = Random::seed_from_u64(98);
    let mut tails = |e: &mut [f64], _: &Plan, _: usize| {
        for v in e {
            let u: f64 = even.sample(&mut random);
            *v += if u < 5e-4 {
                90.0
            } else if u < 1e-3 {
                -90.0
            } else {
                0.0
            };
        }
    };
    let clean = findings_of(10, Hooks { electrons: Some(&mut tails), ..Hooks::default() });
    assert!(clean.is_empty(), "{clean:#?}");
}

fn findings_of(seed: u64, hooks: Hooks<'_>) -> Vec<Finding> {
    let folder = tempfile::tempdir().unwrap();
    let set = set(folder.path(), seed, &PLAN, hooks, &|_| 1.0);
    Cleaned::inspect(set, &Options::default()).unwrap().findings
}

#[test]
fn a_wrong_label_is_found_and_corrected() {
    let folder = tempfile::tempdir().unwrap();
    let wrong = |id: &str| if id == "flat-d" { 0.94 } else { 1.0 };
    let set = set(folder.path(), 11, &PLAN, Hooks::default(), &wrong);
    let stated = set.captures[5].light.as_ref().unwrap().photons_per_pixel_per_s.unwrap();
    let clean = Cleaned::new(set, &Options::default()).unwrap();
    let found = only(&clean);
    assert_eq!((found.kind, found.place.as_str()), (Kind::LightLabel, "flat-d"));
    assert!((found.amount.unwrap() - 0.94).abs() < 2e-3, "{found:?}");
    let now = clean.set().captures[5].light.as_ref().unwrap().photons_per_pixel_per_s.unwrap();
    assert!((now / stated * 0.94 - 1.0).abs() < 2e-3);
}

/// Light stated in two units, by a camera that warms up while the flats are taken.
#[test]
fn a_label_is_judged_in_any_unit_and_at_any_temperature() {
    let folder = tempfile::tempdir().unwrap();
    let wrong = |id: &str| if id == "flat-d" { 0.94 } else { 1.0 };
    set(folder.path(), 12, &PLAN, Hooks::default(), &wrong);
    let manifest = folder.path().join("captures.toml");
    let text = std::fs::read_to_string(&manifest).unwrap();
    let mut warm = 20.0;
    let lines = text.lines().map(|line| match line.split_once(" = ") {
        Some(("photons_per_pixel_per_s", photons)) => {
            let photons: f64 = photons.parse().unwrap();
            format!("{line}\nirradiance_w_m2 = {:e}\n", photons * 3.7e-7)
        }
        Some(("temperature_c", _)) => {
            warm += 0.7;
            format!("temperature_c = {warm}\n")
        }
        _ => format!("{line}\n"),
    });
    std::fs::write(&manifest, lines.collect::<String>()).unwrap();
    let set = CaptureSet::load(folder.path()).unwrap();
    let clean = Cleaned::new(set, &Options::default()).unwrap();
    let found = only(&clean);
    assert_eq!((found.kind, found.place.as_str()), (Kind::LightLabel, "flat-d"));
    assert!((found.amount.unwrap() - 0.94).abs() < 2e-3, "{found:?}");
    let [mended, other] = [5, 6].map(|i| clean.set().captures[i].light.clone().unwrap());
    let ratio = |l: &camrig_captures::Light| {
        l.irradiance_w_m2.unwrap() / l.photons_per_pixel_per_s.unwrap()
    };
    assert!((ratio(&mended) / ratio(&other) - 1.0).abs() < 1e-12, "both units are mended");
}

#[test]
fn pixels_that_break_are_found_with_their_frame() {
    let broken: Vec<usize> = (0..14).map(|i| (i * 211 + 100) % (W * H)).collect();
    let mut damage = |e: &mut [f64], (.., frames): &Plan, i: usize| {
        if i >= frames / 2 {
            broken.iter().for_each(|&p| e[p] += 110.0);
        }
    };
    let clean = inspected(12, Hooks { electrons: Some(&mut damage), ..Hooks::default() });
    let found = only(&clean);
    assert_eq!((found.kind, found.count), (Kind::DefectsAppear, 14));
    assert!(found.frames.contains(&8) && found.frames.contains(&6), "{found:?}");
    let (by, se) = (found.amount.unwrap(), found.std_error.unwrap());
    assert!((by - 110.0 * K).abs() < 4.0 * se + 0.5, "{by} ± {se}");
}

#[test]
fn start_up_and_drift_of_the_lamp_have_their_amplitudes() {
    let mut first = |e: &mut [f64], _: &Plan, i: usize| {
        let more = 7.0 * (-(i as f64) / 2.0).exp();
        e.iter_mut().for_each(|v| *v += more);
    };
    let clean = inspected(13, Hooks { electrons: Some(&mut first), ..Hooks::default() });
    let found = only(&clean);
    assert_eq!(found.kind, Kind::StartUp);
    assert!((found.amount.unwrap() - 7.0 * K).abs() < 0.15, "{found:?}");
    let CurveShape::Decay(tau) = clean.curve().unwrap().shape else {
        panic!("{:?}", clean.curve())
    };
    assert!((tau - 2.0).abs() < 0.2, "{tau}");

    let lamp =
        |light: f64, i: usize, n: usize| light * (1.0 + 0.012 * i as f64 / (n as f64 - 1.0));
    let clean = inspected(14, Hooks { light: Some(&lamp), ..Hooks::default() });
    let found = only(&clean);
    assert_eq!(found.kind, Kind::LampDrift);
    assert!((found.amount.unwrap() - 1.2).abs() < 0.1, "{found:?}");
}

#[test]
fn processed_frames_are_found() {
    let mut smooth = |dn: &mut [f64], _: usize| {
        let old = dn.to_vec();
        for y in 0..H {
            for x in 0..W {
                let at = |dx: isize, dy: isize| {
                    let u = (x as isize + dx).clamp(0, W as isize - 1) as usize;
                    let v = (y as isize + dy).clamp(0, H as isize - 1) as usize;
                    old[v * W + u]
                };
                let around: f64 = (-1..2)
                    .flat_map(|dy| (-1..2).map(move |dx| (dx, dy)))
                    .map(|(dx, dy)| at(dx, dy))
                    .sum();
                dn[y * W + x] = 0.6 * old[y * W + x] + 0.4 * around / 9.0;
            }
        }
    };
    let found = findings_of(15, Hooks { codes: Some(&mut smooth), ..Hooks::default() });
    assert!(found.len() == 1 && found[0].kind == Kind::ProcessedFrames, "{found:#?}");

    // The green of a demosaiced picture: between its pixels, means of their neighbours.
    let mut interpolate = |dn: &mut [f64], _: usize| {
        for y in 1..H - 1 {
            for x in (1..W - 1).filter(|x| (x + y) % 2 == 0) {
                let i = y * W + x;
                dn[i] = (dn[i - 1] + dn[i + 1] + dn[i - W] + dn[i + W]) / 4.0;
            }
        }
    };
    let found = findings_of(17, Hooks { codes: Some(&mut interpolate), ..Hooks::default() });
    assert!(found.len() == 1 && found[0].kind == Kind::ProcessedFrames, "{found:#?}");
    assert!(found[0].description.contains("demosaiced"), "{found:#?}");
    // A quarter of the variance, except for the border, which is unchanged; rounding adds a twelfth
    // of a DN² to the 1 DN² of the darks.
    let inside = ((W - 2) * (H - 2)) as f64 / (W * H) as f64;
    let expected = 1.0 - 0.75 * inside;
    assert!((found[0].amount.unwrap() - expected).abs() < 0.03, "{found:#?}");

    // Blocks whose highest frequencies were dropped on steps of 6 DN.
    let basis: Vec<Vec<f64>> = (0..8)
        .map(|k| {
            let norm = (if k == 0 { 1.0f64 } else { 2.0 } / 8.0).sqrt();
            (0..8)
                .map(|i| {
                    norm * (std::f64::consts::PI * (2 * i + 1) as f64 * k as f64 / 16.0).cos()
                })
                .collect()
        })
        .collect();
    let mut compress = |dn: &mut [f64], _: usize| {
        for by in (0..H).step_by(8) {
            for bx in (0..W).step_by(8) {
                let mut c = [[0.0; 8]; 8];
                for (a, row) in c.iter_mut().enumerate() {
                    for (b, c) in row.iter_mut().enumerate() {
                        let sum: f64 = (0..64)
                            .map(|i| {
                                basis[a][i / 8]
                                    * basis[b][i % 8]
                                    * dn[(by + i / 8) * W + bx + i % 8]
                            })
                            .sum();
                        *c = (sum / 6.0).round() * 6.0;
                    }
                }
                for i in 0..64 {
                    dn[(by + i / 8) * W + bx + i % 8] = (0..64)
                        .map(|k| basis[k / 8][i / 8] * basis[k % 8][i % 8] * c[k / 8][k % 8])
                        .sum();
                }
            }
        }
    };
    let found = findings_of(16, Hooks { codes: Some(&mut compress), ..Hooks::default() });
    let marks: Vec<&Finding> = found.iter().filter(|f| f.kind == Kind::ProcessedFrames).collect();
    assert_eq!(marks.len(), 1, "{found:#?}");
    assert!((marks[0].amount.unwrap() - 6.0).abs() < 0.2, "{found:#?}");
}

#[test]
fn left_justified_samples_are_divided() {
    let mut shifted =
        |dn: &mut [f64], _: usize| dn.iter_mut().for_each(|v| *v = (*v / 8.0).floor() * 8.0);
    let folder = tempfile::tempdir().unwrap();
    let set = set(
        folder.path(),
        17,
        &PLAN,
        Hooks { codes: Some(&mut shifted), ..Hooks::default() },
        &|_| 1.0,
    );
    let clean = Cleaned::new(set, &Options::default()).unwrap();
    let found = only(&clean);
    assert_eq!((found.kind, found.amount), (Kind::CodeStep, Some(8.0)));
    assert_eq!((clean.set().sensor.bits, clean.set().sensor.white_level_dn), (9, 511));
    let mut largest = 0;
    clean
        .for_each_batch(7, |planes| {
            largest = planes.iter().flat_map(|p| &p.data).copied().fold(largest, u16::max);
            Ok(())
        })
        .unwrap();
    assert!((390..512).contains(&largest), "{largest}");
}

#[test]
fn samples_that_pile_up_below_the_white_level_are_saturated() {
    // A converter that ends at 2800 of 4095 DN: half of the brightest stack, at 3080 DN, or a few
    // samples of a stack whose mean is two standard deviations below.
    for (top, piled) in [(2800.0, true), (3156.0, true), (3300.0, false)] {
        let mut clip = |dn: &mut [f64], _: usize| dn.iter_mut().for_each(|v| *v = v.min(top));
        let found = findings_of(18, Hooks { codes: Some(&mut clip), ..Hooks::default() });
        let tops: Vec<&Finding> = found.iter().filter(|f| f.kind == Kind::TopCode).collect();
        assert_eq!(
            tops.iter().map(|f| f.amount).collect::<Vec<_>>(),
            match piled {
                true => vec![Some(top)],
                false => vec![],
            }
        );
        assert!(piled || found.is_empty(), "{found:#?}");
    }
}

/// Where charge ends, and noise of the amplifier follows, no code stands out: the stack lies about
/// 80 + 0.5 x 5000 = 2580 DN with a noise of 4 e⁻, of which 1 % lies 2.33 standard deviations below.
#[test]
fn saturation_before_the_noise_of_the_amplifier_is_found() {
    let mut random = Random::seed_from_u64(3);
    let unit = Normal::new(0.0, 1.0).unwrap();
    let mut clip = |e: &mut [f64], _: &Plan, _: usize| {
        e.iter_mut().for_each(|v| *v = v.min(5000.0) + READ_E * unit.sample(&mut random));
    };
    let found = findings_of(18, Hooks { electrons: Some(&mut clip), ..Hooks::default() });
    let tops: Vec<&Finding> = found.iter().filter(|f| f.kind == Kind::TopCode).collect();
    let [Finding { amount: Some(amount), place, .. }] = tops[..] else { panic!("{found:#?}") };
    assert!((amount - (2580.0 - 2.33 * K * READ_E)).abs() <= 1.0, "{amount}");
    assert_eq!(place, "flat-f");
}

/// Codes behind a logarithm have less noise the brighter they are, and are not saturated.
#[test]
fn compressed_codes_are_not_taken_for_saturated_ones() {
    let mut log = |dn: &mut [f64], _: usize| {
        dn.iter_mut().for_each(|v| *v = BLACK + 200.0 * f64::ln_1p((*v - BLACK) / 200.0));
    };
    let found = findings_of(18, Hooks { codes: Some(&mut log), ..Hooks::default() });
    assert!(found.iter().all(|f| f.kind != Kind::TopCode), "{found:#?}");
}

/// Beyond the analogue gain codes are multiplied: all stacks of that gain have the step, apart from
/// saturated samples, and those of another gain do not hide it.
#[test]
fn codes_multiplied_at_one_gain_are_a_digital_gain() {
    let folder = tempfile::tempdir().unwrap();
    let mut frame = 0;
    let mut doubled = |dn: &mut [f64], _: usize| {
        // The first half of the frames are those of the first half of the stacks.
        if frame < 16 + 16 + 12 {
            dn.iter_mut().for_each(|v| *v = 2.0 * (*v - BLACK) + BLACK);
            dn[0] = 4095.0;
        }
        frame += 1;
    };
    let plan = [PLAN[0], PLAN[1], PLAN[2], ("dark-c", 0.0, 0.02, 16), PLAN[3], PLAN[5]];
    let hooks = Hooks { codes: Some(&mut doubled), ..Hooks::default() };
    set(folder.path(), 27, &plan, hooks, &|_| 1.0);
    let manifest = folder.path().join("captures.toml");
    let mut text = std::fs::read_to_string(&manifest).unwrap();
    for id in ["dark-a", "dark-b", "flat-a"] {
        text = text.replace(&format!("id = \"{id}\""), &format!("id = \"{id}\"\nanalog_gain = 2"));
    }
    std::fs::write(&manifest, text).unwrap();
    let set = CaptureSet::load(folder.path()).unwrap();
    let found = Cleaned::inspect(set, &Options::default()).unwrap().findings;
    let steps: Vec<&Finding> = found.iter().filter(|f| f.kind == Kind::CodeStep).collect();
    assert_eq!(steps.len(), 1, "{found:#?}");
    assert_eq!((steps[0].amount, steps[0].done), (Some(2.0), Done::Reported));
    assert_eq!(steps[0].place, "dark-a, dark-b, flat-a");
    assert!(steps[0].description.contains("digital gain"), "{}", steps[0].description);
}

/// A table of the square root: codes are 2 DN apart from 500 DN on, and 4 DN from 2000 DN on.
#[test]
fn codes_whose_step_depends_on_the_level_are_found() {
    let mut table = |dn: &mut [f64], _: usize| {
        for v in dn {
            let step = if *v < 500.0 {
                1.0
            } else if *v < 2000.0 {
                2.0
            } else {
                4.0
            };
            *v = (*v / step).floor() * step;
        }
    };
    let found = findings_of(19, Hooks { codes: Some(&mut table), ..Hooks::default() });
    let steps: Vec<&Finding> = found.iter().filter(|f| f.kind == Kind::Requantised).collect();
    assert_eq!(steps.iter().map(|f| f.amount).collect::<Vec<_>>(), [Some(4.0)], "{found:#?}");
    // As the effect has them: each range begins with the lowest of its codes that a flat shows.
    let [[_, 1.0], [second, 2.0], [third, 4.0]] = steps[0].steps[..] else { panic!("{found:#?}") };
    assert!((480.0..2000.0).contains(&second) && second % 2.0 == 0.0, "{second}");
    assert!(third >= 1980.0 && third % 4.0 == 0.0, "{third}");
    for words in ["1 DN from", "2 DN from", "4 DN from"] {
        assert!(steps[0].description.contains(words), "{}", steps[0].description);
    }
}

/// A table whose step lies between whole numbers: codes 1 and 2 DN apart in turn from 300 DN on,
/// and 2 and 3 DN from 1200 DN on, are one range each.
#[test]
fn codes_that_alternate_are_one_step() {
    let again = |v: f64, from: f64, step: f64| {
        from + (((v - from) / step + 0.5).floor() * step - 0.5).ceil()
    };
    let mut table = |dn: &mut [f64], _: usize| {
        for v in dn {
            *v = match *v {
                ..300.0 => *v,
                ..1200.0 => again(*v, 300.0, 1.5),
                _ => again(*v, 1200.0, 2.5),
            };
        }
    };
    let found = findings_of(19, Hooks { codes: Some(&mut table), ..Hooks::default() });
    let steps: Vec<&Finding> = found.iter().filter(|f| f.kind == Kind::Requantised).collect();
    let [[_, 1.0], [second, 1.5], [third, 2.5]] = steps[0].steps[..] else { panic!("{found:#?}") };
    // In phase: multiples of 3 DN and of 5 DN after the begin are in the table.
    assert!((280.0..1200.0).contains(&second) && (second - 300.0) % 3.0 == 0.0, "{second}");
    assert!(third >= 1180.0 && (third - 1200.0) % 5.0 == 0.0, "{third}");
    assert!(steps[0].description.contains("1.5 DN in the mean from"), "{}", steps[0].description);
}

/// A sensor that takes bright pixels from a capture of an eighth of the exposure: their shot noise
/// is eight times that of the others at equal light, and their codes are 8 DN apart.
#[test]
fn captures_that_the_sensor_merged_are_refused() {
    let mut random = Random::seed_from_u64(3);
    let unit = Normal::new(0.0, 1.0).unwrap();
    let mut merged = |dn: &mut [f64], _: usize| {
        for v in dn.iter_mut().filter(|v| **v > 1000.0) {
            let more = (7.0 * K * (*v - BLACK)).sqrt() * unit.sample(&mut random);
            *v = ((*v + more - BLACK) / 8.0).round() * 8.0 + BLACK;
        }
    };
    let folder = tempfile::tempdir().unwrap();
    let hooks = Hooks { codes: Some(&mut merged), ..Hooks::default() };
    let set = set(folder.path(), 20, &PLAN, hooks, &|_| 1.0);
    let error = Cleaned::new(set, &Options::default()).map(|_| ()).unwrap_err();
    let said = format!("{error}; {}", error.remedy().unwrap_or_default());
    assert!(said.contains("merged captures") && said.contains("one by one"), "{said}");
}
