//! Mean photo-electrons against a sum in f64, for all widths of colour filter patterns, with nodes
//! of the crosstalk table inside groups of pixels, between them, and several in one group.

mod common;

use camrig_sensor_core::arith::{Arith, BLOCK, blocks};
use camrig_sensor_core::config::{MAX_CHANNELS, PATTERN_WIDTHS, Pattern, SensorConfig};
use camrig_sensor_core::pipeline::MeanRows;
use common::light::{Band, Collected, Table, mean_electrons};
use common::{SETTINGS, monochrome, uniforms};

in_both_arithmetics! { sums_agree_with_f64 }

fn check<A: Arith>(config: &SensorConfig, table: Option<&Table>, next: &mut impl FnMut() -> f64) {
    let mut row = || {
        let band = |_| {
            // Some pixels dark, some far brighter than the rest of their group.
            let value = |_| (next() * if next() < 0.1 { 20.0 } else { 1.0 } * 1e-3) as f32;
            Band::new((0..config.width).map(value).collect())
        };
        (0..config.bands).map(band).collect()
    };
    let cube: Vec<Vec<Band>> = (0..config.height).map(|_| row()).collect();
    let want = mean_electrons(config, &SETTINGS, table, &cube);
    let mut means = Collected::<A>::new(config, &SETTINGS, table, &cube);
    let width = config.width as usize;
    let mut out = vec![[A::Signal::default(); BLOCK]; blocks(width)];
    for (y, want) in want.chunks(width).enumerate() {
        MeanRows::<A>::mean_row(&mut means, y as u32, &mut out);
        for (x, (got, want)) in out.as_flattened().iter().zip(want).enumerate() {
            let got = f64::from(A::electrons(*got));
            // Positions of pixels and nodes are good to 1e-7 of the width, cells down to 1/80 of
            // it wide, factors up to 2: 1e-5 of the mean at most. Fixed point: a step of 2⁻¹² e⁻
            // and 2⁻³⁰ of the largest weight per band.
            let allowed = 1e-5 * want + 3e-4;
            assert!(
                (got - want).abs() < allowed,
                "pattern {} wide, column {x} of {width}, row {y}: {got}, expected {want}",
                config.pattern.width
            );
        }
    }
}

fn sums_agree_with_f64<A: Arith>() {
    let mut next = uniforms(3);
    for &pattern_width in PATTERN_WIDTHS {
        for (width, bands) in [(1u32, 1u8), (17, 5), (100, 3), (333, 31)] {
            let pattern_height = 1 + (next() * 5.0) as u8;
            let cells = usize::from(pattern_width * pattern_height);
            // As many as there may be: a mosaic where each pixel has its own.
            let channels = cells.min(MAX_CHANNELS) as u8;
            let tile = (0..cells).map(|i| match u8::try_from(i) {
                Ok(own) if own < channels => own,
                _ => (next() * f64::from(channels)) as u8,
            });
            let pattern = Pattern::new(pattern_width, pattern_height, tile);
            let count = usize::from(channels) * usize::from(bands);
            let mut config = monochrome(width, 3, &[]);
            config.pattern = pattern;
            config.channels = channels;
            config.bands = bands;
            config.first_band_nm = 400.0;
            config.response = (0..count).map(|_| (1e6 * next()) as f32).collect();
            check::<A>(&config, None, &mut next);
            for nodes in [1usize, 2, 5, 33] {
                let mut rising = |n: usize, low: f64, high: f64| {
                    let step = (high - low) / n as f64;
                    let node = |i| (low + step * (i as f64 + 0.6 * next())) as f32;
                    (0..n).map(node).collect::<Vec<f32>>()
                };
                let (x, y, nm) =
                    (rising(nodes, -1.0, 1.0), rising(2, -1.0, 1.0), rising(3, 390.0, 700.0));
                let count = usize::from(channels) * x.len() * y.len() * nm.len();
                let factors = (0..count).map(|_| (2.0 * next()) as f32).collect();
                check::<A>(&config, Some(&Table { x, y, nm, factors }), &mut next);
            }
        }
    }
}
