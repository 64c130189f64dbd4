//! Sums of many `f32` in a fixed number of lanes, so that processors can vectorise them with the
//! same result on every machine, and rounding errors stay small.

const LANES: usize = 16;

fn total(lanes: [f32; LANES]) -> f64 {
    lanes.into_iter().map(f64::from).sum()
}

/// Sum of values.
#[inline(always)]
pub fn sum(values: &[f32]) -> f64 {
    let (whole, rest) = values.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for chunk in whole {
        lanes.iter_mut().zip(chunk).for_each(|(l, v)| *l += v);
    }
    lanes.iter_mut().zip(rest).for_each(|(l, v)| *l += v);
    total(lanes)
}

/// Sum of products.
#[inline(always)]
pub fn dot(a: &[f32], b: &[f32]) -> f64 {
    let (whole_a, rest_a) = a.as_chunks::<LANES>();
    let (whole_b, rest_b) = b.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for (a, b) in whole_a.iter().zip(whole_b) {
        for i in 0..LANES {
            lanes[i] += a[i] * b[i];
        }
    }
    lanes.iter_mut().zip(rest_a).zip(rest_b).for_each(|((l, a), b)| *l += a * b);
    total(lanes)
}

#[cfg(test)]
mod tests {
    #[test]
    fn sums_are_exact_for_small_integers() {
        // Whole numbers below 2^24: exact in any order.
        for n in [0, 1, 15, 16, 17, 100] {
            let a: Vec<f32> = (0..n).map(|i| i as f32).collect();
            let b: Vec<f32> = (0..n).map(|i| (3 * i % 7) as f32).collect();
            assert_eq!(super::sum(&a), (0..n).sum::<usize>() as f64);
            assert_eq!(super::dot(&a, &b), (0..n).map(|i| i * (3 * i % 7)).sum::<usize>() as f64);
        }
    }
}
