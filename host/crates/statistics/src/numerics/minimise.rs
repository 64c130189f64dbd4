//! Minimises functions of one and two variables within ranges, without derivatives.
//!
//! The functions are negative log-likelihoods and sums of squares: cheap and smooth, but with
//! valleys that a descent from one start may miss. Hence a grid that contracts, and golden section
//! where there is a single minimum.

/// Contractions of the grid of [`lowest`]: the last step is 0.4⁷ of the first, 1/600.
const CONTRACTIONS: usize = 8;
/// Ratio of the steps of successive grids. Above 1/4, so that a grid of four steps to either side
/// contains the neighbours of the point that it contracts to.
const CONTRACTION: f64 = 0.4;

/// The minimum of a function of two variables within ranges: on nine by nine points over the
/// ranges, then on as many around the lowest of them, closer together.
pub fn lowest(of: impl Fn(f64, f64) -> f64, [x0, x1]: [f64; 2], [y0, y1]: [f64; 2]) -> (f64, f64) {
    let (mut x, mut y) = ((x0 + x1) / 2.0, (y0 + y1) / 2.0);
    let (mut dx, mut dy) = ((x1 - x0) / 8.0, (y1 - y0) / 8.0);
    for _ in 0..CONTRACTIONS {
        let around = |m: f64, d: f64, [from, to]: [f64; 2]| {
            (-4..=4).map(move |i| (m + f64::from(i) * d).clamp(from, to))
        };
        let mut least = f64::INFINITY;
        let (mx, my) = (x, y);
        for i in around(mx, dx, [x0, x1]) {
            for j in around(my, dy, [y0, y1]) {
                let value = of(i, j);
                if value < least {
                    (least, x, y) = (value, i, j);
                }
            }
        }
        (dx, dy) = (dx * CONTRACTION, dy * CONTRACTION);
    }
    (x, y)
}

/// The minimum of a function with a single one between `low` and `high`, by golden section: each of
/// `turns` iterations reduces the range by 0.618.
pub fn minimum(mut low: f64, mut high: f64, turns: usize, f: impl Fn(f64) -> f64) -> f64 {
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..turns {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if f(a) < f(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::{lowest, minimum};

    #[test]
    fn a_curved_valley_is_followed_to_its_minimum() {
        let valley = |x: f64, y: f64| (x - 0.3).powi(2) + 10.0 * (y - x * x).powi(2);
        let (x, y) = lowest(valley, [-1.0, 1.0], [-1.0, 1.0]);
        // The last step is 0.25 · 0.4⁷.
        assert!((x - 0.3).abs() < 1e-3 && (y - 0.09).abs() < 1e-3, "{x} {y}");
        // On an edge too.
        assert_eq!(lowest(|x, y| x - y, [0.0, 1.0], [2.0, 3.0]), (0.0, 3.0));
        let root = minimum(0.0, 2.0, 60, |x| (x * x - 2.0).powi(2));
        assert!((root - 2f64.sqrt()).abs() < 1e-6, "{root}");
    }
}
