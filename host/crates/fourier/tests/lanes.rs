//! Transforms of sixteen sequences side by side.

use camrig_fourier::lanes::{Fft, LANES, Lanes, Real, Split, good_length, transpose};
use std::f64::consts::TAU;

fn noise(seed: usize) -> f32 {
    ((seed.wrapping_mul(2_654_435_761) >> 7) % 1000) as f32 / 500.0 - 1.0
}

#[test]
fn equals_the_sum_that_defines_it() {
    equals_the_sum::<f32>(f64::from(f32::EPSILON) / 2.0);
    equals_the_sum::<f64>(16.0 * f64::EPSILON);
}

fn equals_the_sum<T: Real + Into<f64>>(rounding: f64) {
    for n in [1, 2, 3, 4, 5, 6, 8, 9, 12, 16, 20, 45, 60, 96, 108, 144, 150] {
        let fft = Fft::<T>::new(n);
        let mut data = Split::zeros(n);
        for i in 0..n {
            for l in 0..LANES {
                data.re[i].0[l] = T::wide(noise(i * 31 + l));
                data.im[i].0[l] = T::wide(noise(i * 57 + l + 9));
            }
        }
        let before = data.clone();
        let mut scratch = Split::zeros(n);
        fft.forward(&mut data, &mut scratch);
        for l in [0, 7, 15] {
            for k in 0..n {
                let (mut re, mut im) = (0.0, 0.0);
                for i in 0..n {
                    let (s, c) = (-TAU * ((i * k) % n) as f64 / n as f64).sin_cos();
                    let (a, b): (f64, f64) = (before.re[i].0[l].into(), before.im[i].0[l].into());
                    re += a * c - b * s;
                    im += a * s + b * c;
                }
                // A few roundings of the norm √n per stage; for f64, those of this sum too.
                let tolerance = 16.0 * rounding * ((n as f64).sqrt() + 1.0);
                assert!((data.re[k].0[l].into() - re).abs() < tolerance, "n {n} k {k}");
                assert!((data.im[k].0[l].into() - im).abs() < tolerance, "n {n} k {k}");
            }
        }
        fft.backward(&mut data, &mut scratch);
        for i in 0..n {
            for l in 0..LANES {
                let back = data.re[i].0[l].into() / n as f64;
                assert!((back - before.re[i].0[l].into()).abs() < 48.0 * rounding, "n {n}");
            }
        }
    }
}

#[test]
fn good_lengths_have_small_factors() {
    assert_eq!([1, 7, 11, 13, 97, 127].map(good_length), [1, 8, 12, 15, 100, 128]);
}

#[test]
fn transposing_exchanges_rows_and_columns() {
    let row = |r: usize| Lanes(std::array::from_fn(|c| (r * LANES + c) as f32));
    let rows: [Lanes; LANES] = std::array::from_fn(row);
    let mut turned = [Lanes::ZERO; LANES];
    transpose(&rows, &mut turned);
    for r in 0..LANES {
        for c in 0..LANES {
            assert_eq!(turned[r].0[c], rows[c].0[r]);
        }
    }
}
