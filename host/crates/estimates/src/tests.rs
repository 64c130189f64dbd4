//! A real sensor at four crops, against figures of another program; and sensors of known figures.

use super::*;
use camrig_base::Plane;
use camrig_captures::CaptureSet;
use rand_distr::{Distribution, Poisson, StandardNormal, Uniform};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use serde_json::Value as Json;

const BAYER: Sites = Sites { across: 2, down: 2 };

/// The stacks of a set within a region.
fn read(set: CaptureSet, region: [usize; 4]) -> Vec<Stack> {
    let set = set.within(region).unwrap();
    let read = |capture: &camrig_captures::Capture| {
        let mut frames = Vec::new();
        set.for_each_batch(capture, |batch| {
            frames.extend_from_slice(batch);
            Ok(())
        })
        .unwrap();
        Stack::new(&capture.id, capture.role, capture.exposure_s, frames)
    };
    set.captures.iter().map(read).collect()
}

/// Collects what departs from the golden figures by more than three errors of both.
struct Golden<'a> {
    figures: &'a Json,
    crop: &'a str,
    wrong: Vec<String>,
}

impl Golden<'_> {
    fn check(&mut self, name: &str, found: Value) {
        let right = &self.figures["quantities"][name][self.crop];
        let (value, error) = (right["value"].as_f64().unwrap(), right["error"].as_f64().unwrap());
        if !((found.value - value).abs() <= 3.0 * error.max(1e-12)) {
            self.wrong.push(format!("{}: {name}: {found:?}, right {value} ± {error}", self.crop));
        }
        // Errors are those of the golden figures, by other means: bootstrap there.
        let ratio = found.std_error / error;
        if !(0.3..3.0).contains(&ratio) {
            self.wrong.push(format!("{}: error of {name}: {found:?}, {error}", self.crop));
        }
    }
}

#[test]
fn a_real_sensor_has_the_figures_of_another_program_at_every_crop() {
    let (Some(folder), Some(golden)) = (
        camrig_testing::shared("data/captures/asi120_zwo"),
        camrig_testing::shared("golden/asi120/asi120.json"),
    ) else {
        return;
    };
    let figures: Json = serde_json::from_slice(&std::fs::read(golden).unwrap()).unwrap();
    let mut wrong = Vec::new();
    for (crop, [width, height]) in [
        ("64x64", [64, 64]),
        ("128x128", [128, 128]),
        ("192x160", [192, 160]),
        ("320x240", [320, 240]),
    ] {
        let at = |axis: &str| figures["crops"][crop][axis].as_u64().unwrap() as usize;
        let set = CaptureSet::load(&folder).unwrap();
        let stacks = read(set, [at("x"), at("y"), width, height]);
        let found = estimate(&stacks, BAYER, 0.27).unwrap();
        let mut golden = Golden { figures: &figures, crop, wrong: Vec::new() };
        let flat = &found.flats[0];
        let dark = found.dark_current.as_ref().unwrap();
        let bias = &found.bias;
        for (site, name) in ["G(0,0)", "R(0,1)", "B(1,0)", "G(1,1)"].iter().enumerate() {
            for stack in ["bias", "dark-0.1s", "dark-1s"] {
                let of = stacks.iter().find(|s| s.id == stack).unwrap();
                let level = bias::levels_by_site(of, BAYER)[site];
                golden.check(&format!("black {stack} {name}"), level);
            }
            golden.check(&format!("gain {name}"), flat.sites[site].gain);
            let read = bias.read_noise_variance_by_site[site];
            golden.check(&format!("read variance {name}"), read);
            golden.check(&format!("dark current median {name}"), dark.median_by_site[site]);
            golden.check(&format!("prnu {name}"), flat.sites[site].prnu_variance.sqrt().unwrap());
        }
        golden.check("gain", found.gain.unwrap());
        golden.check("read_var_median", bias.read_noise_variance);
        golden.check("read_var_mean", bias.mean_variance);
        golden.check("read_spread_ln_sd", bias.read_noise_spread);
        golden.check("read_noisy_share", bias.noisy_share);
        golden.check("row_common_var", bias.row_variance);
        golden.check("row_anti_var", bias.opposite_row_variance);
        golden.check("col_temp_var", bias.column_variance);
        golden.check("frame_site_offset_var", bias.frame_site_variance.unwrap());
        golden.check("frame_var", bias.frame_variance);
        golden.check("bias_fpn_pix_var", bias.pattern.pixels);
        golden.check("bias_fpn_col_var", bias.pattern.columns);
        golden.check("bias_fpn_row_var", bias.pattern.rows);
        golden.check("dark_median_dn_s", dark.median);
        golden.check("dark_mean_dn_s", dark.mean);
        golden.check("dark_clipped_mean_dn_s", dark.clipped_mean);
        golden.check("dsnu_core_var", dark.pattern_variance);
        golden.check("hot_share", dark.hot_share);
        golden.check("dark_intercept_minus_bias", dark.intercept_above_bias);
        let [frequency, depth] = flat.flicker.fit.unwrap();
        golden.check("flicker_cycles_per_row_flat", frequency);
        golden.check("flicker_depth_flat", depth);
        golden.check("flat_frame_sd_flat", flat.frame_sd);
        for (k, name) in ["right", "down", "right2", "down2"].iter().enumerate() {
            golden.check(&format!("gaincorr_{name}_flat"), flat.gain_correlation[k]);
        }
        wrong.extend(golden.wrong);

        let top = figures["crops"][crop]["y"].as_u64().unwrap() as usize;
        for stack in &stacks {
            let right = figures["torn"][crop][&stack.id].as_array().cloned().unwrap_or_default();
            let right: Vec<[usize; 2]> = right
                .iter()
                .map(|t| ["frame", "row"].map(|k| t[k].as_u64().unwrap() as usize))
                .collect();
            let own = found.torn.iter().filter(|t| t.stack == stack.id);
            let own: Vec<[usize; 2]> = own.map(|t| [t.frame, t.row + top]).collect();
            if own != right {
                wrong.push(format!("{crop}: {} is torn at {own:?}, right {right:?}", stack.id));
            }
        }
        println!("{crop}: {:?}", found.telegraph);
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// A sensor of known figures. Amounts are electrons, of dark current electrons per second.
#[derive(Clone)]
struct Sensor {
    sites: Sites,
    gain: f64,
    read_noise: f64,
    /// Standard deviation over pixels of ln of the read noise.
    spread: f64,
    dark_current: f64,
    pattern: f64,
    prnu: f64,
    row_noise: f64,
    opposite_row_noise: f64,
    frame_offset: f64,
    /// Amplitude and cycles per row.
    flicker: [f64; 2],
    /// Of each site over that amplitude.
    /// Of each site, the ratio of its depth and the angle by which it lags in degrees.
    flicker_of_sites: [[f64; 2]; 4],
    hot_share: f64,
    /// Share and jump of pixels that blink: of the read-out, e⁻; of the dark current, e⁻/s.
    readout_telegraph: [f64; 2],
    dark_telegraph: [f64; 2],
    /// Row from which frame 0 of the longest dark stack is of an exposure of one second.
    torn_row: Option<usize>,
    dead_column: Option<usize>,
    dead_row: Option<usize>,
    /// One pixel in so many with 0.4 of the gain.
    defective_every: Option<usize>,
    /// A row, and a square of four pixels by four, with more dark current.
    hot_row: Option<usize>,
    hot_corner: Option<[usize; 2]>,
    /// Dark current of each site beside that of all.
    site_rates: [f64; 4],
    /// What stays behind at each transfer, along rows and down columns.
    inefficiency: [f64; 2],
    /// Memory of the frame offset.
    memory: f64,
    /// Noise of pixels behind the gain, and a pattern of columns there, DN.
    behind_dn: [f64; 2],
    /// Standard deviation of the pixels' offsets, e⁻.
    offsets: f64,
}

const SENSOR: Sensor = Sensor {
    sites: BAYER,
    gain: 0.27,
    read_noise: 6.0,
    spread: 0.13,
    dark_current: 2.0,
    pattern: 0.3,
    prnu: 0.008,
    row_noise: 0.0,
    opposite_row_noise: 0.0,
    frame_offset: 0.0,
    flicker: [0.0, 0.02],
    flicker_of_sites: [[1.0, 0.0]; 4],
    hot_share: 0.0,
    readout_telegraph: [0.0, 0.0],
    dark_telegraph: [0.0, 0.0],
    torn_row: None,
    dead_column: None,
    dead_row: None,
    defective_every: None,
    hot_row: None,
    hot_corner: None,
    site_rates: [0.0; 4],
    inefficiency: [0.0; 2],
    memory: 0.0,
    behind_dn: [0.0; 2],
    offsets: 0.0,
};

impl Sensor {
    fn stacks(&self, [width, height]: [usize; 2], seed: u64) -> Vec<Stack> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut normal = {
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed + 1000);
            move || -> f64 { StandardNormal.sample(&mut rng) }
        };
        let uniform = Uniform::new(0.0, 1.0).unwrap();
        let pixels = width * height;
        let mut chosen = |share: f64| -> Vec<bool> {
            (0..pixels).map(|_| uniform.sample(&mut rng) < share).collect()
        };
        let (hot, blinking) = (chosen(self.hot_share), chosen(self.readout_telegraph[0]));
        let dark_blinking = chosen(self.dark_telegraph[0]);
        let read: Vec<f64> =
            (0..pixels).map(|_| self.read_noise * (self.spread * normal()).exp()).collect();
        let rate: Vec<f64> = (0..pixels)
            .map(|p| {
                let (x, y) = (p % width, p / width);
                let in_corner = |[left, top]: [usize; 2]| {
                    (left..left + 4).contains(&x) && (top..top + 4).contains(&y)
                };
                let is_hot =
                    hot[p] || self.hot_row == Some(y) || self.hot_corner.is_some_and(in_corner);
                (self.dark_current + self.pattern * normal()).max(0.0)
                    + self.site_rates[y % 2 * 2 + x % 2]
                    + if is_hot { 20.0 } else { 0.0 }
            })
            .collect();
        let columns: Vec<f64> = (0..width).map(|_| self.behind_dn[1] * normal()).collect();
        let mut of_pixels = Xoshiro256PlusPlus::seed_from_u64(seed + 3000);
        let offsets: Vec<f64> = (0..pixels)
            .map(|_| self.offsets * Distribution::<f64>::sample(&StandardNormal, &mut of_pixels))
            .collect();
        let relative: Vec<f64> = (0..pixels)
            .map(|p| {
                let dead = self.dead_column == Some(p % width);
                let dead = if dead { 0.5 } else { 1.0 };
                let row = if self.dead_row == Some(p / width) { 0.0 } else { 1.0 };
                let is_defective = self.defective_every.is_some_and(|n| p % n == 0);
                let defect = if is_defective { 0.4 } else { 1.0 };
                (1.0 + self.prnu * normal()) * dead * row * defect
            })
            .collect();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed + 2000);
        let plan = [0.0, 5.0, 10.0, 30.0, 50.0, 100.0]
            .map(|t| (Role::Dark, t, if t == 0.0 { 16 } else { 6 }));
        plan.into_iter()
            .chain([(Role::Flat, 0.005, 12)])
            .map(|(role, exposure, count)| {
                let mut wandering = normal();
                let frames = (0..count).map(|i| {
                    let phase = uniform.sample(&mut rng);
                    wandering = self.memory * wandering
                        + (1.0 - self.memory * self.memory).sqrt() * normal();
                    let offset = self.frame_offset * wandering;
                    let rows: Vec<[f64; 2]> = (0..height)
                        .map(|_| {
                            let (a, b) =
                                (self.row_noise * normal(), self.opposite_row_noise * normal());
                            [a + b, a - b]
                        })
                        .collect();
                    let charge = |p: usize| -> f64 {
                        let y = p / width;
                        let torn = role == Role::Dark
                            && exposure == 100.0
                            && i == 0
                            && self.torn_row.is_some_and(|row| y >= row);
                        let time = if torn { 1.0 } else { exposure };
                        let wave = std::f64::consts::TAU * (self.flicker[1] * y as f64 + phase);
                        let light = match role {
                            Role::Flat => {
                                let [own, lag] = self.flicker_of_sites[y % 2 * 2 + p % width % 2];
                                let wave = (wave - f64::to_radians(lag)).sin();
                                6200.0 * relative[p] * (1.0 + own * self.flicker[0] * wave)
                            }
                            _ => 0.0,
                        };
                        let jump = if dark_blinking[p] && uniform.sample(&mut rng) < 0.5 {
                            self.dark_telegraph[1]
                        } else {
                            0.0
                        };
                        let mean = light + (rate[p] + jump) * time;
                        if mean > 0.0 { Poisson::new(mean).unwrap().sample(&mut rng) } else { 0.0 }
                    };
                    let mut charges: Vec<f64> = (0..pixels).map(charge).collect();
                    self.transfer(&mut charges, width);
                    Plane::from_fn(width, height, |x, y| {
                        let p = y * width + x;
                        let state = if blinking[p] && uniform.sample(&mut rng) < 0.5 {
                            self.readout_telegraph[1]
                        } else {
                            0.0
                        };
                        let electrons = charges[p]
                            + offsets[p]
                            + read[p] * normal()
                            + state
                            + offset
                            + rows[y][x % 2];
                        let behind = self.behind_dn[0] * normal() + columns[x];
                        (144.0 + self.gain * electrons + behind).round().clamp(0.0, 4095.0) as u16
                    })
                });
                let frames: Vec<Plane<u16>> = frames.collect();
                Stack::new(format!("{role:?}-{exposure}"), role, exposure, frames)
            })
            .collect()
    }

    /// Leaves behind what each transfer does, one after the other, for the next packet.
    fn transfer(&self, charges: &mut [f64], width: usize) {
        let [serial, parallel] = self.inefficiency;
        let mut trail = |share: f64, place: &dyn Fn(usize) -> usize, step: usize| {
            for p in (0..charges.len()).rev() {
                let lost = 1.0 - libm::pow(1.0 - share, place(p) as f64 + 1.0);
                let left = lost * charges[p];
                charges[p] -= left;
                if p + step < charges.len() && place(p + step) == place(p) + 1 {
                    charges[p + step] += left;
                }
            }
        };
        trail(parallel, &|p| p / width, width);
        trail(serial, &|p| p % width, 1);
    }

    fn found(&self, size: [usize; 2], seed: u64) -> Estimates {
        estimate(&self.stacks(size, seed), self.sites, 0.27).unwrap()
    }
}

/// Within four standard errors, and within a part of the value.
#[track_caller]
fn assert_is(found: Value, right: f64, part: f64) {
    let off = (found.value - right).abs();
    assert!(off < 4.0 * found.std_error + 1e-3 * right.abs(), "{found:?}, right {right}");
    assert!(found.std_error < part * right.abs(), "{found:?} says little of {right}");
}

#[test]
fn figures_of_a_known_sensor_are_within_their_errors() {
    let found = SENSOR.found([96, 80], 1);
    let variance = (0.27f64 * 6.0).powi(2);
    assert_is(found.gain.unwrap(), 0.27, 0.02);
    assert_is(found.bias.read_noise_variance, variance, 0.02);
    assert_is(found.bias.read_noise_spread, 0.13, 0.2);
    let dark = found.dark_current.as_ref().unwrap();
    assert_is(dark.median, 0.27 * 2.0, 0.01);
    assert_is(dark.pattern_variance, (0.27f64 * 0.3).powi(2), 0.1);
    for site in &found.flats[0].sites {
        assert_is(site.prnu_variance.sqrt().unwrap(), 0.008, 0.05);
        assert_is(site.gain, 0.27, 0.03);
    }
    // Nothing else is there.
    assert!(found.torn.is_empty() && found.flats[0].defective_columns.is_empty());
    assert!(found.bias.row_variance.value.abs() < 5.0 * found.bias.row_variance_null);
    assert!(found.frame_offsets.unwrap().deviation < 5.0);
    assert!(found.flats[0].flicker.power_ratio < 30.0);
    assert!(found.telegraph.share.unwrap().value < 3e-4 && dark.hot_share.value < 3e-4);
}

#[test]
fn a_monochrome_sensor_has_one_site() {
    let found = Sensor { sites: Sites { across: 1, down: 1 }, ..SENSOR }.found([96, 80], 2);
    assert_is(found.gain.unwrap(), 0.27, 0.02);
    assert!(found.bias.frame_site_variance.is_none() && found.flats[0].sites.len() == 1);
}

#[test]
fn noise_of_rows_and_frames_is_told_from_that_of_pixels() {
    let sensor = Sensor { row_noise: 1.0, opposite_row_noise: 0.7, frame_offset: 0.8, ..SENSOR };
    let found = sensor.found([128, 96], 3);
    assert_is(found.bias.row_variance, (0.27f64 * 1.0).powi(2), 0.1);
    assert_is(found.bias.opposite_row_variance, (0.27f64 * 0.7).powi(2), 0.2);
    assert_is(found.bias.read_noise_variance, (0.27f64 * 6.0).powi(2), 0.02);
    let offsets = found.frame_offsets.unwrap();
    assert!(offsets.deviation > 5.0, "{offsets:?}");
    assert_is(offsets.sd, 0.27 * 0.8, 0.2);
}

#[test]
fn flicker_leaves_gain_and_prnu_as_they_are() {
    let sensor = Sensor { flicker: [0.2, 0.0145], dead_column: Some(17), ..SENSOR };
    let found = sensor.found([96, 96], 4);
    let flat = &found.flats[0];
    let [frequency, depth] = flat.flicker.fit.unwrap();
    assert_is(frequency, 0.0145, 0.02);
    assert_is(depth, 0.2, 0.05);
    assert_is(found.gain.unwrap(), 0.27, 0.02);
    assert_eq!(flat.defective_columns, [17]);
    assert_is(flat.sites[0].prnu_variance.sqrt().unwrap(), 0.008, 0.1);
}

#[test]
fn flicker_has_an_amplitude_and_a_phase_of_its_own_at_each_site() {
    let sites = [[1.0, 0.0], [0.8, 8.0], [1.3, -12.0], [1.0, 2.0]];
    let sensor = Sensor { flicker: [0.2, 0.0145], flicker_of_sites: sites, ..SENSOR };
    let found = sensor.found([96, 96], 4);
    let flicker = &found.flats[0].flicker;
    // The wave of all is the mean of theirs.
    let part = |of: fn(f64) -> f64| -> f64 {
        sites.iter().map(|[depth, lag]| depth * of(lag.to_radians()) / 4.0).sum()
    };
    let (re, im) = (part(f64::cos), part(f64::sin));
    for (own, [depth, lag]) in flicker.by_site.iter().zip(sites) {
        assert_is(own.depth, depth / re.hypot(im), 0.02);
        assert!((own.lag_deg.value - (lag - im.atan2(re).to_degrees())).abs() < 0.7, "{own:?}");
        assert!(own.lag_deg.std_error < 0.5, "{own:?}");
    }
}

#[test]
fn defective_pixels_are_no_part_of_the_prnu() {
    let prnu = |sensor: Sensor| {
        let found = sensor.found([96, 96], 4);
        Value::combine(found.flats[0].sites.iter().map(|s| s.prnu_variance)).unwrap().value.sqrt()
    };
    let (without, with) = (prnu(SENSOR), prnu(Sensor { defective_every: Some(499), ..SENSOR }));
    assert!((with / without - 1.0).abs() < 0.01, "{with} {without}");
}

#[test]
fn a_torn_frame_is_named_with_its_row_and_leaves_the_dark_current() {
    let found = Sensor { torn_row: Some(50), ..SENSOR }.found([64, 96], 5);
    let torn = &found.torn;
    assert_eq!((torn.len(), &torn[0].stack[..], torn[0].frame), (1, "Dark-100", 0), "{torn:?}");
    assert!(torn[0].row.abs_diff(50) <= 1, "{torn:?}");
    assert_is(found.dark_current.unwrap().median, 0.27 * 2.0, 0.01);
}

#[test]
fn telegraph_noise_of_read_out_and_dark_current_have_their_exponents() {
    let sensor = Sensor { readout_telegraph: [0.01, 60.0], ..SENSOR };
    let found = sensor.found([96, 96], 6).telegraph;
    let law = found.chosen_in_bias.unwrap();
    let exponent = law.exponent.unwrap();
    assert!(exponent.value.abs() < 0.3, "{law:?}");
    let excess = law.excess[0].1;
    let right = (0.27f64 * 30.0).powi(2);
    assert!((excess.value / right - 1.0).abs() < 0.25, "{excess:?}, right {right}");

    let sensor = Sensor { dark_telegraph: [0.005, 10.0], ..SENSOR };
    let found = sensor.found([96, 96], 7).telegraph;
    let law = found.chosen_in_longest.as_ref().unwrap();
    assert!((law.exponent.unwrap().value - 1.0).abs() < 0.3, "{law:?}");
    assert!((found.median_jump.unwrap().value / 2.7 - 1.0).abs() < 0.3, "{found:?}");
    assert!(found.chosen_in_bias.is_none_or(|l| l.pixels < 20));
}

#[test]
fn hot_pixels_are_counted() {
    let found = Sensor { hot_share: 0.01, ..SENSOR }.found([96, 96], 8);
    let dark = found.dark_current.unwrap();
    assert!((dark.hot_share.value - 0.01).abs() < 4.0 * dark.hot_share.std_error, "{dark:?}");
    assert_is(dark.median, 0.27 * 2.006, 0.01);
}

/// Darks of 5 s and more, in which hot pixels have 100 e⁻ and the others differ by 1.5 e⁻:
/// offsets are within four errors, none or 1 e⁻.
#[test]
fn dark_charge_of_any_law_is_no_offset() {
    for seed in 20..28 {
        let offsets = f64::from(seed % 2);
        let sensor = Sensor { hot_share: 0.01, offsets, ..SENSOR };
        let mut stacks = sensor.stacks([96, 96], seed as u64);
        stacks.retain(|s| s.role == Role::Flat || s.exposure_s > 0.0);
        let found = estimate(&stacks, BAYER, 0.27).unwrap();
        let variance = found.pixel_offsets.unwrap();
        let off = variance.value - (0.27 * offsets).powi(2);
        assert!(off.abs() < 4.0 * variance.std_error, "seed {seed}: {variance:?}");
        // In the shortest dark they are one pattern with the dark charge.
        assert!(found.bias.pattern.pixels.z() > 8.0);
        stacks.retain(|s| s.exposure_s <= 5.0);
        assert!(estimate(&stacks, BAYER, 0.27).unwrap().pixel_offsets.is_none());
    }
}

#[test]
fn rows_and_clusters_that_are_dead_or_hot_are_areas_and_leave_the_rest_as_it_is() {
    let sensor = Sensor {
        dead_row: Some(31),
        hot_row: Some(60),
        hot_corner: Some([20, 40]),
        hot_share: 0.005,
        ..SENSOR
    };
    let found = sensor.found([96, 80], 9);
    let place = |a: &areas::Area| [a.left, a.top, a.width, a.height];
    let (flat, dark) = (&found.flats[0], found.dark_current.as_ref().unwrap());
    let dead: Vec<_> = flat.defective_areas.iter().map(place).collect();
    assert_eq!(dead, [[0, 31, 96, 1]]);
    assert!(flat.defective_areas[0].value.value.abs() < 0.01, "{:?}", flat.defective_areas);
    let hot: Vec<_> = dark.hot_areas.iter().map(place).collect();
    assert_eq!(hot, [[0, 60, 96, 1], [20, 40, 4, 4]]);
    for area in &dark.hot_areas {
        assert!((area.value.value / (0.27 * 20.0) - 1.0).abs() < 0.1, "{area:?}");
    }
    assert!((dark.hot_share.value - 0.005).abs() < 4.0 * dark.hot_share.std_error, "{dark:?}");
    assert_is(found.gain.unwrap(), 0.27, 0.02);
    assert_is(flat.sites[0].prnu_variance.sqrt().unwrap(), 0.008, 0.1);
    let nothing = SENSOR.found([96, 80], 9);
    assert!(nothing.flats[0].defective_areas.is_empty());
    assert!(nothing.dark_current.unwrap().hot_areas.is_empty());
}

#[test]
fn sites_of_other_dark_currents_are_neither_hot_nor_a_spread() {
    let found = Sensor { site_rates: [0.0, 0.0, 0.0, 4.0], ..SENSOR }.found([96, 80], 10);
    let dark = found.dark_current.unwrap();
    for (site, rate) in [2.0, 2.0, 2.0, 6.0].into_iter().enumerate() {
        assert_is(dark.median_by_site[site], 0.27 * rate, 0.02);
    }
    assert!(dark.hot_share.value < 3e-4 && dark.hot_areas.is_empty(), "{dark:?}");
    assert_is(dark.variance_within_sites, (0.27f64 * 0.3).powi(2), 0.1);
}

#[test]
fn charge_that_stays_behind_is_the_slope_of_the_correlation_of_neighbours() {
    let found = Sensor { inefficiency: [0.002, 0.001], ..SENSOR }.found([128, 112], 11);
    let [serial, parallel] = found.flats[0].transfer_inefficiency.map(Option::unwrap);
    assert_is(serial, 0.002, 0.1);
    assert_is(parallel, 0.001, 0.2);
    for flat in &SENSOR.found([96, 80], 12).flats {
        let z = flat.transfer_inefficiency.map(|v| v.unwrap().z());
        assert!(z.iter().all(|z| z.abs() < 4.0), "{z:?}");
    }
}

#[test]
fn a_level_that_wanders_has_a_memory_and_white_offsets_have_none() {
    let sensor = Sensor { frame_offset: 1.0, memory: 0.8, ..SENSOR };
    let found = sensor.found([96, 80], 13).frame_offsets.unwrap();
    let drift = found.drift.unwrap();
    assert!(
        (drift.correlation.value - 0.8).abs() < 3.0 * drift.correlation.std_error,
        "{drift:?}"
    );
    assert!((drift.sd.value - 0.27).abs() < 3.0 * drift.sd.std_error, "{drift:?}");
    let white = Sensor { frame_offset: 1.0, ..SENSOR }.found([96, 80], 14).frame_offsets.unwrap();
    assert!(white.drift.is_none() && white.deviation > 5.0, "{white:?}");
}

/// The bias of the same sensor at four times the gain.
fn with_another_gain(sensor: &Sensor, seed: u64) -> Estimates {
    let mut stacks = sensor.stacks([96, 80], seed);
    let high = Sensor { gain: 4.0 * sensor.gain, ..sensor.clone() };
    let bias = high.stacks([96, 80], seed).swap_remove(0);
    stacks.push(Stack { id: "high".into(), ..bias.at_gain(4.0) });
    estimate(&stacks, sensor.sites, 0.27).unwrap()
}

#[test]
fn what_is_behind_the_gain_does_not_grow_with_it() {
    let sensor = Sensor { behind_dn: [1.2, 0.4], row_noise: 1.0, ..SENSOR };
    let found = with_another_gain(&sensor, 15).behind_gain.unwrap();
    assert_is(found.read_noise.behind, 1.44, 0.1);
    assert_is(found.read_noise.before, (0.27f64 * 6.0).powi(2), 0.1);
    // Unity is where most is known: the error of the sum is that of the frames there.
    let whole = found.read_noise.at_unity;
    assert_is(whole, 1.44 + (0.27f64 * 6.0).powi(2), 0.05);
    assert!(whole.std_error <= found.read_noise.behind.std_error, "{found:?}");
    assert_is(found.column_pattern.behind, 0.16, 0.3);
    assert_is(found.rows.before, 0.27f64.powi(2), 0.2);
    assert!(found.rows.behind.z().abs() < 4.0, "{found:?}");
    let offsets = Sensor { frame_offset: 1.0, ..SENSOR };
    assert!(!with_another_gain(&offsets, 17).behind_gain.unwrap().frames_are_behind);
    assert!(SENSOR.found([96, 80], 16).behind_gain.is_none());
    let nothing = with_another_gain(&SENSOR, 17).behind_gain.unwrap();
    let all = [nothing.read_noise, nothing.rows, nothing.column_pattern, nothing.pixel_pattern];
    assert!(all.iter().all(|p| p.behind.z().abs() < 4.0), "{nothing:?}");
}

#[test]
fn what_cannot_be_estimated_is_refused() {
    assert!(estimate(&[], BAYER, 0.27).is_err());
    let frames = |side| vec![Plane::filled(side, side, 64u16); 4];
    assert!(estimate(&[Stack::new("a", Role::Dark, 0.0, frames(8))], BAYER, 0.27).is_err());
    let dark = Stack::new("a", Role::Dark, 0.0, frames(32));
    let flat = Stack::new("b", Role::Flat, 0.0, frames(64));
    assert!(estimate(&[dark, flat], BAYER, 0.27).is_err());
}
