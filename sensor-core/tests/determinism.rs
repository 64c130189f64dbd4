//! The same frame whatever the order of rows and the chunks, and the same bytes as ever.

mod common;

use camrig_sensor_core::arith::{Arith, Fixed, Float};
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::effects::*;
use common::*;

in_both_arithmetics! { rows_come_out_the_same_in_any_order }

/// A chain with three windows, one in each of three domains.
fn windows() -> Vec<Effect> {
    vec![
        optical_crosstalk::OpticalCrosstalk { side: 0.02, vertical: 0.03, diagonal: 0.005 }.into(),
        shot_noise::ShotNoise {}.into(),
        prnu::Prnu { sigma: 0.01 }.into(),
        dark_current::DarkCurrent {
            mean_e_per_s: 900.0,
            dsnu_e_per_s: 400.0,
            doubling_c: 7.0,
            reference_c: 25.0,
        }
        .into(),
        brighter_fatter::BrighterFatter { coefficient: 1e-6 }.into(),
        charge_coupling::ChargeCoupling { side: 0.01, vertical: 0.02, diagonal: 0.001 }.into(),
        row_offset_fpn::RowOffsetFpn::from_values(&[2.0]).into(),
        read_noise::ReadNoise { read_e: 4.0, read_e_post: 1.0 }.into(),
    ]
}

fn scene(x: u32, y: u32) -> f32 {
    // Means on either side of where the Poisson method changes.
    ((x * 37 + y * 101) % 97) as f32 * if x.is_multiple_of(5) { 0.2 } else { 20.0 }
}

fn rows_come_out_the_same_in_any_order<A: Arith>() {
    let all = windows();
    for effects in [&all[..], &all[1..5], &all[1..3]] {
        for (width, height) in [(1, 1), (1, 7), (63, 2), (64, 9), (65, 12), (200, 5)] {
            let config = monochrome(width, height, effects);
            let whole = frame::<A>(&config, &SETTINGS, &mut Means(scene));
            let row = |y: u32| &whole[(y * width) as usize..((y + 1) * width) as usize];
            let mut next = uniforms(u64::from(width * height));
            let random = (0..30).map(|_| (next() * f64::from(height)) as u32).collect();
            let orders: [Vec<u32>; 5] = [
                (0..height).rev().collect(),
                (0..height).flat_map(|y| [y, y]).collect(),
                (0..height).step_by(2).chain((1..height).step_by(2)).collect(),
                (height / 2..height).chain(0..height).collect(),
                random,
            ];
            for order in orders {
                let got = rows_of::<A>(&config, &SETTINGS, &mut Means(scene), &order);
                for (y, got) in order.iter().zip(got.chunks(width as usize)) {
                    assert_eq!(got, row(*y), "row {y} of {width} x {height} in order {order:?}");
                }
            }
            for y in 0..height {
                let alone = rows_of::<A>(&config, &SETTINGS, &mut Means(scene), &[y]);
                assert_eq!(alone, row(y), "row {y} alone");
            }
        }
    }
}

/// The base chain, and each effect that was there when the figures were pinned, with shot and read
/// noise.
fn everything() -> Vec<Vec<Effect>> {
    let base = windows();
    let mut chains = vec![vec![], base.clone()];
    let pinned = Effect::CATALOGUE.iter().filter(|e| e.id <= 45);
    chains.extend(pinned.map(|entry| {
        let values: Vec<f32> = entry
            .parameters
            .iter()
            .map(|p| p.default.unwrap_or((p.min + 0.6 * (p.max - p.min)).min(0.5).max(p.min)))
            .collect();
        let effect = Effect::new(entry.id, &values).expect(entry.kind);
        let mut chain = vec![
            shot_noise::ShotNoise {}.into(),
            effect,
            read_noise::ReadNoise { read_e: 3.0, read_e_post: 0.0 }.into(),
        ];
        if entry.domain == Domain::Light {
            chain.swap(0, 1);
        }
        chain
    }));
    chains
}

/// One figure for the frames of all chains.
fn digest_of<A: Arith>(config: impl Fn(&[Effect]) -> SensorConfig) -> u64 {
    everything().iter().fold(0, |sum, effects| {
        let settings =
            FrameSettings::new(0.02).with_frame(7).with_gain(2.0).with_temperature(31.0);
        let dn = frame::<A>(&config(effects), &settings, &mut Means(scene));
        sum.rotate_left(7) ^ digest(&dn)
    })
}

/// Bit-exact: these figures are the same on every machine, and change only when the numbers of the
/// model do (a changelog entry).
#[test]
fn pinned_digests() {
    let mono = |effects: &[Effect]| monochrome(100, 6, effects);
    let colour = |effects: &[Effect]| {
        let mut config = bayer(131, 7, effects);
        config.bits = 12;
        config.full_well_e = 9000.0;
        config.black_level_dn = 64.0;
        config.seed = 99;
        config
    };
    let got = [
        digest_of::<Float>(mono),
        digest_of::<Float>(colour),
        digest_of::<Fixed>(mono),
        digest_of::<Fixed>(colour),
    ];
    let pinned: [u64; 4] =
        [0xd5e13b4a59cca033, 0x254740f0f4ca8cca, 0xcda8e694bf6ccc41, 0x314a1981d4f9d4a3];
    assert_eq!(got.map(|d| format!("{d:#018x}")), pinned.map(|d| format!("{d:#018x}")));
}
