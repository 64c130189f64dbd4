//! The revision of cached results.

use super::*;
use crate::content::REVISION;

/// Squares of light, one of them a lamp, through lenses of each route; on the processor.
#[test]
fn planes_are_those_of_the_revision() {
    let square = |lamp: f64| {
        let average = move |g: &Grid, x: usize, y: usize| {
            let (u, v) = (g.left + (x as f64 + 0.5) * g.cell, g.top + (y as f64 + 0.5) * g.cell);
            let inside = (u + 0.21).abs() < 0.05 && (v - 0.11).abs() < 0.04;
            if inside { lamp } else { 10.0 + 5.0 * u - 3.0 * v }
        };
        Exact { bands: one_band(550.0), average }
    };
    let grid = SensorGrid { width: 40, height: 30, pitch_um: 2.2, fill_factor: 0.8 };
    // FNV-1a.
    let mut digest = 0xcbf2_9ce4_8422_2325u64;
    let lenses: [&dyn Lens; 3] = [
        &perfect(2.8),
        &GaussianOtf { sigma_um: 1.1, table: false },
        &GaussianOtf { sigma_um: 1.1, table: true },
    ];
    for lens in lenses {
        for (lamp, oversample) in [(20.0, 1), (20.0, 2), (1e9, 1)] {
            let options = Options { oversample: Some(oversample), ..Options::default() };
            for value in &render(&square(lamp), lens, &grid, &options)[0].data {
                for byte in value.to_bits().to_le_bytes() {
                    digest = (digest ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
                }
            }
        }
    }
    let right = (5, 12_985_769_360_371_309_380);
    assert_eq!(
        (REVISION, digest),
        right,
        "the same input gives other planes than those in caches: raise REVISION in content.rs, and \
         put it and the digest here"
    );
}
