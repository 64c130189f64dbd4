//! Irradiance that changes while rows collect light: means over each row's exposure.

use super::irradiance::{IrradianceCube, IrradianceWriter};
use camrig_base::{Error, Plane, Result};
use camrig_sensor_core::spectral::decode;
use rayon::prelude::*;

/// Sum of cubes with a weight for each of their rows: Σ w_i(y) E_i(x, y), rounded as any cube is.
/// A weight may be negative, to take away what another cube has; what rounding leaves below 0 is 0.
///
/// # Errors
/// No cubes, cubes that are not alike, or not of as many rows as there are weights; a file of a
/// cube that cannot be read.
pub fn weighted(cubes: &[(&IrradianceCube, Vec<f64>)]) -> Result<IrradianceCube> {
    let Some((first, _)) = cubes.first() else {
        return Err(Error::internal("a sum of no irradiance"));
    };
    let header = &first.header;
    let (width, height) = (header.width, header.height);
    for (cube, weights) in cubes {
        let other = &cube.header;
        let alike = (other.width, other.height) == (width, height)
            && other.spectral_bands() == header.spectral_bands()
            && other.level == header.level;
        if !alike || weights.len() != height {
            return Err(Error::internal("a sum of irradiance of different cubes"));
        }
    }
    let mut writer = IrradianceWriter::new(header.clone())?;
    for band in 0..header.bands {
        let chunks = cubes.iter().map(|(cube, _)| cube.chunk(band, 0, height));
        let chunks = chunks.collect::<Result<Vec<_>>>()?;
        let mut plane = Plane { width, height, data: vec![0.0; width * height] };
        plane.data.par_chunks_mut(width).enumerate().for_each(|(y, sum)| {
            let mut row = vec![0.0; width];
            for (chunk, (_, weights)) in chunks.iter().zip(cubes) {
                let weight = weights[y] as f32;
                if weight != 0.0 {
                    decode(chunk.row(width, y), &mut row);
                    sum.iter_mut().zip(&row).for_each(|(s, v)| *s += weight * v);
                }
            }
            sum.iter_mut().for_each(|s| *s = s.max(0.0));
        });
        writer.push(&plane)?;
    }
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::super::CubeHeader;
    use super::*;
    use camrig_base::Bands;

    fn cube(level: f64, value: impl Fn(usize, usize) -> f32) -> IrradianceCube {
        let header = CubeHeader {
            level,
            ..CubeHeader::new((33, 4), &Bands { start_nm: 500.0, step_nm: 50.0, count: 2 }, "")
        };
        let mut writer = IrradianceWriter::new(header).unwrap();
        for band in 1..3 {
            let plane = Plane::from_fn(33, 4, |x, y| band as f32 * value(x, y));
            writer.push(&plane).unwrap();
        }
        writer.finish().unwrap()
    }

    fn values(cube: &IrradianceCube, band: usize, y: usize) -> Vec<f32> {
        let mut row = vec![0.0; 33];
        decode(cube.chunk(band, y, 1).unwrap().row(33, y), &mut row);
        row
    }

    #[test]
    fn rows_are_sums_with_their_own_weights() {
        let a = cube(1.0, |x, y| 1.0 + x as f32 + 40.0 * y as f32);
        let b = cube(1.0, |x, _| 200.0 - x as f32);
        let weights = [vec![1.0, 0.5, 0.0, 0.25], vec![0.0, 0.5, 1.0, 0.5]];
        let [of_a, of_b] = weights.clone();
        let sum = weighted(&[(&a, of_a), (&b, of_b)]).unwrap();
        for band in 0..2 {
            for y in 0..4 {
                let (a, b) = (values(&a, band, y), values(&b, band, y));
                for (x, v) in values(&sum, band, y).into_iter().enumerate() {
                    let exact = weights[0][y] as f32 * a[x] + weights[1][y] as f32 * b[x];
                    // Block floating point: 2⁻¹⁷ of the largest of 16 neighbours.
                    assert!((v - exact).abs() <= 400.0 / 131_072.0, "{band} {x} {y}");
                }
            }
        }
    }

    /// A cube alone with weights of 1 is the same to the bit.
    #[test]
    fn a_scene_at_rest_stays_as_it_is() {
        let a = cube(1.0, |x, y| 0.37 + 1.7 * x as f32 + 40.3 * y as f32);
        let same = weighted(&[(&a, vec![1.0; 4])]).unwrap();
        for (band, y) in [(0, 0), (1, 3)] {
            assert_eq!(values(&a, band, y), values(&same, band, y));
        }
        assert!(weighted(&[(&a, vec![1.0; 3])]).is_err());
        assert!(weighted(&[(&a, vec![1.0; 4]), (&cube(2.0, |_, _| 1.0), vec![1.0; 4])]).is_err());
        assert!(weighted(&[]).is_err());
    }
}
