//! A line plot as SVG: named curves over two linear axes with round ticks.

use super::page::escape;

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 420.0;
/// Left, top, right and bottom margin.
const MARGINS: [f64; 4] = [60.0, 20.0, 20.0, 45.0];

/// A curve: its name, its colour, its points.
pub type Curve<'a> = (&'a str, &'a str, Vec<[f64; 2]>);

/// Draws curves; `x` and `y` label the axes.
pub fn plot(x: &str, y: &str, curves: &[Curve]) -> String {
    let range = |axis: usize| {
        let values = curves.iter().flat_map(|c| &c.2).map(|p| p[axis]).filter(|v| v.is_finite());
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if high > low { (low, high) } else { (0.0, 1.0) }
    };
    let (xs, ys) = (range(0), range(1));
    let [left, top, right, bottom] = MARGINS;
    let at = |p: [f64; 2]| {
        [
            left + (p[0] - xs.0) / (xs.1 - xs.0) * (WIDTH - left - right),
            HEIGHT - bottom - (p[1] - ys.0) / (ys.1 - ys.0) * (HEIGHT - top - bottom),
        ]
    };
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n"
    );
    for (axis, span) in [xs, ys].into_iter().enumerate() {
        for tick in ticks(span) {
            let on_axis = if axis == 0 { [tick, ys.0] } else { [xs.0, tick] };
            let across = if axis == 0 { [tick, ys.1] } else { [xs.1, tick] };
            let ([x0, y0], [x1, y1]) = (at(on_axis), at(across));
            let (tx, ty, anchor) =
                if axis == 0 { (x0, y0 + 16.0, "middle") } else { (x0 - 6.0, y0 + 4.0, "end") };
            svg.push_str(&format!(
                "<path d=\"M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}\" stroke=\"#ddd\"/>\
                 <text x=\"{tx:.1}\" y=\"{ty:.1}\" text-anchor=\"{anchor}\">{tick}</text>\n"
            ));
        }
    }
    for (index, (name, colour, points)) in curves.iter().enumerate() {
        let points = points.iter().map(|&p| at(p)).map(|[x, y]| format!("{x:.1},{y:.1}"));
        let points = points.collect::<Vec<_>>().join(" ");
        svg.push_str(&format!(
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\">{}</text>\n",
            left + 10.0,
            top + 16.0 * (index as f64 + 1.0),
            escape(name)
        ));
    }
    svg.push_str(&format!(
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
         <text transform=\"translate(14 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n</svg>\n",
        WIDTH / 2.0,
        HEIGHT - 8.0,
        escape(x),
        HEIGHT / 2.0,
        escape(y)
    ));
    svg
}

/// Round numbers within a range, four to ten of them.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let rough = (high - low) / 6.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough);
    let step = step.unwrap_or(rough);
    let digits = (-step.log10().floor()).max(0.0) as i32;
    let round = |v: f64| (v * 10f64.powi(digits)).round() / 10f64.powi(digits);
    let first = (low / step).ceil() as i64;
    (first..).map(|i| i as f64 * step).take_while(|t| *t <= high + 1e-9 * step).map(round).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(ticks((0.0, 1.0)), [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]);
        assert_eq!(ticks((-3.0, 250.0)), [0.0, 50.0, 100.0, 150.0, 200.0, 250.0]);
    }

    #[test]
    fn a_plot_without_points_is_still_a_plot() {
        let svg = plot("x", "y < 1", &[("none", "red", vec![])]);
        assert!(svg.ends_with("</svg>\n") && svg.contains("y &lt; 1") && !svg.contains("NaN"));
    }
}
