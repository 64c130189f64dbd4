//! Point values from averages over cells, for kernels: no light is made, lost or negative.
//!
//! A kernel that is known as averages over cells, such as what a cell receives of a PSF, is
//! sharpened by a flow of light between neighbouring cells, from the lower to the higher. What
//! follows is exact for polynomials up to degree 5: (9a₋₂ − 116a₋₁ + 2134a₀ − 116a₁ + 9a₂)/1920.
//! No cell gives more than it has, so that a kernel narrower than a cell stays as it is. (Flows
//! limited for the sake of the sign: Zalesak 1979, J. Comput. Phys. 31, 335.)

/// Flow of light between two cells, as shares of the difference of the two, and of that of the
/// next two.
const FLOWS: [f64; 2] = [29.0 / 480.0 - 3.0 / 640.0, -3.0 / 640.0];

/// Point values from averages over `n` x `n` cells, along rows and columns.
pub fn sharpened(averages: &[f64], n: usize) -> Vec<f64> {
    let mut rows = averages.to_vec();
    rows.chunks_exact_mut(n).for_each(sharpen);
    let mut turned = transposed(&rows, n);
    turned.chunks_exact_mut(n).for_each(sharpen);
    transposed(&turned, n)
}

fn transposed(values: &[f64], n: usize) -> Vec<f64> {
    (0..n * n).map(|k| values[k % n * n + k / n]).collect()
}

fn sharpen(line: &mut [f64]) {
    let at = |i: usize| i.checked_sub(1).and_then(|i| line.get(i)).copied().unwrap_or(0.0);
    // From cell i to the next; places of `at` count from the cell before the first.
    let flow = |i: usize| FLOWS[0] * (at(i + 2) - at(i + 1)) + FLOWS[1] * (at(i + 3) - at(i));
    let mut flows: Vec<f64> = (0..line.len().saturating_sub(1)).map(flow).collect();
    let before = |flows: &[f64], i: usize| if i > 0 { flows[i - 1] } else { 0.0 };
    let shares: Vec<f64> = (0..line.len())
        .map(|i| {
            let after = flows.get(i).copied().unwrap_or(0.0);
            let given = after.max(0.0) - before(&flows, i).min(0.0);
            if given > line[i] { line[i] / given } else { 1.0 }
        })
        .collect();
    for (i, flow) in flows.iter_mut().enumerate() {
        *flow *= shares[if *flow > 0.0 { i } else { i + 1 }];
    }
    for (i, value) in line.iter_mut().enumerate() {
        let after = flows.get(i).copied().unwrap_or(0.0);
        *value = (*value + before(&flows, i) - after).max(0.0);
    }
}

/// Sums over squares of `side` of `n` x `n` values, wherever they lie whole.
pub fn box_sums(values: &[f64], n: usize, side: usize) -> Vec<f64> {
    let size = n + 1 - side;
    let sum = |k: usize| {
        let corner = k / size * n + k % size;
        (0..side).map(|j| values[corner + j * n..][..side].iter().sum::<f64>()).sum()
    };
    (0..size * size).map(sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sharpening_makes_averages_points() {
        // Averages over unit cells of (x−8)⁴ are moments: check the value at the middle cell.
        let average = |i: f64| ((i + 0.5).powi(5) - (i - 0.5).powi(5)) / 5.0;
        let n = 17;
        let values: Vec<f64> = (0..n * n).map(|k| average((k % n) as f64 - 8.0)).collect();
        let sharp = sharpened(&values, n);
        for x in 3..14 {
            let exact = (x as f64 - 8.0).powi(4);
            assert!((sharp[8 * n + x] - exact).abs() < 1e-9);
        }
    }
}
