//! Interpolation of tabulated figures over the plane of the image.

/// A smooth surface through values on a rectangular grid: cubic Hermite along both axes, with
/// parabolic slopes, continued beyond the grid along its end slopes. Third-order accurate.
#[derive(Clone, Debug, PartialEq)]
pub struct BicubicTable {
    x: Vec<f64>,
    y: Vec<f64>,
    /// Value and derivatives by x, by y and by both, `[y][x]`.
    nodes: Vec<[f64; 4]>,
}

impl BicubicTable {
    /// The surface through `values[row · x.len() + column]` at `(x[column], y[row])`; both axes
    /// rise strictly.
    ///
    /// # Panics
    /// When the lengths differ or are 0: callers hold validated tables.
    #[must_use]
    pub fn new(x: Vec<f64>, y: Vec<f64>, values: &[f64]) -> Self {
        let (across, down) = (x.len(), y.len());
        assert!(across * down > 0 && across * down == values.len(), "one value per node");
        let along_x = |values: &[f64]| -> Vec<f64> {
            values.chunks_exact(across).flat_map(|row| slopes(&x, row)).collect()
        };
        let along_y = |values: &[f64]| -> Vec<f64> {
            let columns: Vec<Vec<f64>> = (0..across)
                .map(|i| values.iter().skip(i).step_by(across).copied().collect::<Vec<f64>>())
                .map(|column| slopes(&y, &column))
                .collect();
            (0..across * down).map(|k| columns[k % across][k / across]).collect()
        };
        let (by_x, by_y) = (along_x(values), along_y(values));
        let by_both = along_y(&by_x);
        let nodes =
            (0..across * down).map(|k| [values[k], by_x[k], by_y[k], by_both[k]]).collect();
        Self { x, y, nodes }
    }

    /// The value at (x, y).
    #[must_use]
    pub fn at(&self, x: f64, y: f64) -> f64 {
        let (columns, by_x) = basis(&self.x, x);
        let (rows, by_y) = basis(&self.y, y);
        let mut sum = 0.0;
        for (row, [value_y, slope_y]) in rows.into_iter().zip(by_y) {
            for (column, [value_x, slope_x]) in columns.into_iter().zip(by_x) {
                let [f, fx, fy, fxy] = self.nodes[row * self.x.len() + column];
                sum += value_y * (value_x * f + slope_x * fx)
                    + slope_y * (value_x * fy + slope_x * fxy);
            }
        }
        sum
    }
}

/// The two nodes of `axis` about `x`, and the weights of the value and the slope at each.
fn basis(axis: &[f64], x: f64) -> ([usize; 2], [[f64; 2]; 2]) {
    let last = axis.len() - 1;
    for end in [0, last] {
        let beyond = if end == 0 { x <= axis[0] } else { x >= axis[last] };
        if beyond {
            return ([end, end], [[1.0, x - axis[end]], [0.0, 0.0]]);
        }
    }
    let i = axis.partition_point(|&v| v <= x) - 1;
    let h = axis[i + 1] - axis[i];
    let t = (x - axis[i]) / h;
    let (t2, t3) = (t * t, t * t * t);
    let (before, after) = (2.0 * t3 - 3.0 * t2 + 1.0, 3.0 * t2 - 2.0 * t3);
    ([i, i + 1], [[before, h * (t3 - 2.0 * t2 + t)], [after, h * (t3 - t2)]])
}

/// Slopes of the parabolas through each point and its neighbours; at the ends, of those next to
/// them.
fn slopes(x: &[f64], values: &[f64]) -> Vec<f64> {
    let last = x.len() - 1;
    if last == 0 {
        return vec![0.0];
    }
    let secant = |i: usize| (values[i + 1] - values[i]) / (x[i + 1] - x[i]);
    if last == 1 {
        return vec![secant(0); 2];
    }
    let slope = |i: usize| {
        let middle = i.clamp(1, last - 1);
        let (before, after) = (secant(middle - 1), secant(middle));
        let bend = (after - before) / (x[middle + 1] - x[middle - 1]);
        before + bend * (2.0 * x[i] - x[middle] - x[middle - 1])
    };
    (0..=last).map(slope).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_parabolas_are_exact_and_go_on_straight_beyond_the_grid() {
        let x = vec![-2.0, -0.5, 0.0, 1.5, 2.0];
        let y = vec![-1.0, 0.5, 1.0, 3.0];
        let f = |x: f64, y: f64| (1.0 + 0.5 * x - 0.25 * x * x) * (2.0 - y + 0.125 * y * y);
        let values: Vec<f64> = y.iter().flat_map(|&y| x.iter().map(move |&x| f(x, y))).collect();
        let table = BicubicTable::new(x, y, &values);
        for k in 0..=400 {
            let (x, y) = (f64::from(k % 21) * 0.2 - 2.0, f64::from(k / 21) * 0.2 - 1.0);
            assert!((table.at(x, y) - f(x, y)).abs() < 1e-12, "({x}, {y})");
        }
        // The slope by x at the right edge is 0.5 − 0.5·2, of a factor 1 there.
        let beyond = table.at(2.5, 0.3);
        let right = (1.0 - 0.5 * 0.5) * (2.0 - 0.3 + 0.125 * 0.09);
        assert!((beyond - right).abs() < 1e-12, "{beyond} instead of {right}");
    }
}
