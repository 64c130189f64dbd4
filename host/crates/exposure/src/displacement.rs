//! How far things move on the sensor from one irradiance to the next, by comparing blocks.
//!
//! Blocks that have changed most are looked for in the second irradiance by their normalised
//! cross-correlation, in which light that becomes brighter or darker plays no part. What is found
//! is a lower bound: other things may move farther than is looked, turn, or come out of nothing,
//! and blocks are looked for as far as the edges of the plane are away.

use super::irradiance::IrradianceCube;
use camrig_base::{Plane, Result};
use camrig_sensor_core::spectral::decode;
use rayon::prelude::*;

/// Side of a block, pixels: several widths of a sharp edge.
const BLOCK: usize = 16;
/// How far blocks are looked for, pixels: a trade between the time it takes and what is found.
const REACH: isize = 24;
/// Blocks that are looked for. They are those that have changed most, and one is enough.
const BLOCKS: usize = 48;
/// Contrast of a block, deviation over mean, from which on it has something that can be found.
const CONTRAST: f64 = 0.02;
/// What is left of the difference, 1 - correlation, where a block is found again. Half a pixel of
/// one and a half leaves a ninth.
const LEFT: f64 = 0.2;
/// Least difference of a block that has changed.
const CHANGED: f64 = 0.02;

/// How far something moves at least from one irradiance to the next, pixels, to whole ones; 0 where
/// nothing is found that does.
///
/// # Errors
/// A file of a cube that cannot be read.
///
/// # Panics
/// Never for cubes of one size.
pub fn displacement(first: &IrradianceCube, second: &IrradianceCube) -> Result<f64> {
    let (a, b) = (light(first)?, light(second)?);
    let corners = |size: usize| (0..size / BLOCK).map(|i| i * BLOCK);
    let places = corners(a.height).flat_map(|y| corners(a.width).map(move |x| (x, y)));
    let changed = |(x, y): (usize, usize)| {
        let block = Block::of(&a, x, y).filter(|block| block.contrast() > CONTRAST)?;
        let difference = block.difference(&b, x, y)?;
        (difference > CHANGED).then_some((difference, block, x, y))
    };
    let mut blocks: Vec<_> = places.filter_map(changed).collect();
    blocks.sort_by(|a, b| b.0.total_cmp(&a.0));
    blocks.truncate(BLOCKS);
    let shifts = shifts();
    let moved = blocks.par_iter().map(|(here, block, x, y)| {
        let mut best = (LEFT * here, 0.0);
        for (dx, dy, length) in &shifts {
            let place = x.checked_add_signed(*dx).zip(y.checked_add_signed(*dy));
            // Beyond the edge it may have been nearer than where it is found again inside.
            let Some(difference) = place.and_then(|(x, y)| block.difference(&b, x, y)) else {
                break;
            };
            // Along an edge many are as good: the nearest is taken.
            if difference < 0.8 * best.0 {
                best = (difference, *length);
            }
        }
        best.1
    });
    Ok(moved.reduce(|| 0.0, f64::max))
}

/// Shifts within reach with their lengths, the shortest first.
fn shifts() -> Vec<(isize, isize, f64)> {
    let all = (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| (dx, dy)));
    let mut all: Vec<_> =
        all.map(|(dx, dy)| (dx, dy, ((dx * dx + dy * dy) as f64).sqrt())).collect();
    all.retain(|(_, _, length)| *length > 0.0 && *length <= REACH as f64);
    all.sort_by(|a, b| a.2.total_cmp(&b.2));
    all
}

/// Light in three bands over the spectrum together.
fn light(cube: &IrradianceCube) -> Result<Plane<f32>> {
    let (width, height, bands) = (cube.header.width, cube.header.height, cube.header.bands);
    let mut sum = Plane { width, height, data: vec![0.0; width * height] };
    let mut row = vec![0.0; width];
    for quarter in 1..=3 {
        let chunk = cube.chunk(quarter * bands / 4, 0, height)?;
        for (y, sum) in sum.data.chunks_mut(width).enumerate() {
            decode(chunk.row(width, y), &mut row);
            sum.iter_mut().zip(&row).for_each(|(sum, v)| *sum += v);
        }
    }
    Ok(sum)
}

/// A block less its mean.
struct Block {
    mean: f64,
    deviations: Vec<f64>,
    /// Sum of their squares.
    square: f64,
}

/// Samples of a block.
const SAMPLES: f64 = (BLOCK * BLOCK) as f64;

/// The samples of the block whose upper left corner lies there, row by row; none beyond the plane.
fn samples(plane: &Plane<f32>, x: usize, y: usize) -> Option<impl Iterator<Item = f64>> {
    let inside = x + BLOCK <= plane.width && y + BLOCK <= plane.height;
    let row = move |dy: usize| &plane.data[(y + dy) * plane.width + x..][..BLOCK];
    inside.then(|| (0..BLOCK).flat_map(move |dy| row(dy).iter().map(|v| f64::from(*v))))
}

impl Block {
    fn of(plane: &Plane<f32>, x: usize, y: usize) -> Option<Self> {
        let mut deviations: Vec<f64> = samples(plane, x, y)?.collect();
        let mean = deviations.iter().sum::<f64>() / SAMPLES;
        deviations.iter_mut().for_each(|v| *v -= mean);
        let square = deviations.iter().map(|v| v * v).sum();
        Some(Self { mean, deviations, square })
    }

    fn contrast(&self) -> f64 {
        (self.square / SAMPLES).sqrt() / self.mean.max(f64::MIN_POSITIVE)
    }

    /// 1 - correlation with the block of another plane; none beyond that, 1 where nothing is there.
    fn difference(&self, plane: &Plane<f32>, x: usize, y: usize) -> Option<f64> {
        let [mut product, mut sum, mut square] = [0.0; 3];
        for (own, other) in self.deviations.iter().zip(samples(plane, x, y)?) {
            product += own * other;
            sum += other;
            square += other * other;
        }
        let scale = (self.square * (square - sum * sum / SAMPLES)).sqrt();
        Some(if scale > 0.0 { 1.0 - product / scale } else { 1.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CubeHeader, IrradianceWriter};
    use super::*;
    use camrig_base::Bands;

    /// One band of a scene's light.
    fn cube(value: impl Fn(f64, f64) -> f64) -> IrradianceCube {
        let header =
            CubeHeader::new((96, 64), &Bands { start_nm: 500.0, step_nm: 50.0, count: 1 }, "");
        let mut writer = IrradianceWriter::new(header).unwrap();
        let plane = Plane::from_fn(96, 64, |x, y| value(x as f64, y as f64) as f32);
        writer.push(&plane).unwrap();
        writer.finish().unwrap()
    }

    /// A soft disk on a slope of light.
    fn disk(x: f64, y: f64, centre: [f64; 2]) -> f64 {
        let away = ((x - centre[0]).powi(2) + (y - centre[1]).powi(2)).sqrt();
        1.0 + 0.002 * x + 1.0 / (1.0 + (away - 6.0).exp())
    }

    #[test]
    fn what_moves_is_measured_and_what_only_fades_is_not() {
        let at = |centre: [f64; 2]| cube(move |x, y| disk(x, y, centre));
        let first = at([40.0, 32.0]);
        for (centre, expected) in [
            ([40.0, 32.0], 0.0),
            ([44.0, 32.0], 4.0),
            ([40.0, 42.0], 10.0),
            ([34.0, 40.0], 10.0),
            ([55.0, 32.0], 15.0),
        ] {
            let found = displacement(&first, &at(centre)).unwrap();
            assert!((found - expected).abs() <= 1.0, "{centre:?}: {found}");
        }
        let brighter = cube(|x, y| 3.0 * disk(x, y, [40.0, 32.0]));
        assert_eq!(displacement(&first, &brighter).unwrap(), 0.0);
        let dark = cube(|_, _| 0.0);
        assert_eq!(displacement(&first, &dark).unwrap(), 0.0);
        assert_eq!(displacement(&dark, &first).unwrap(), 0.0);
    }

    /// A slit of a grating: along it every shift is as good, across it those of whole periods.
    #[test]
    fn of_shifts_that_are_as_good_the_nearest_counts() {
        let grating = |shift: f64| {
            cube(move |x, _| 2.0 + (std::f64::consts::TAU * (x - shift) / 12.0).sin())
        };
        assert_eq!(displacement(&grating(0.0), &grating(3.0)).unwrap(), 3.0);
        assert_eq!(displacement(&grating(0.0), &grating(12.0)).unwrap(), 0.0);
    }
}
