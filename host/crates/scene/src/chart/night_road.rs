//! A road at night, for sensors of high dynamic range: a pedestrian beside it, an oncoming car, a
//! sign of light-emitting diodes.

use super::{BANDS, Options};
use crate::painting::Painting;
use crate::shape::Shape;
use camrig_base::{Result, Spectrum};

/// Strokes of the digits on the sign, sensor widths.
const STROKE: f64 = 0.006;
/// Size of a digit.
const DIGIT: [f64; 2] = [0.026, 0.05];

/// `night-road[:headlights=3.1e6,sign=1.6e4]`: radiance of the lights relative to a perfect white
/// in the scene's light. In 1 lx a perfect white has 1/π cd/m²: the headlights have 1e6 cd/m²,
/// the sign 5000, the pedestrian (reflectance 0.3) 0.1.
pub(super) fn from_options(options: &mut Options) -> Result<Painting> {
    let headlights = options.number("headlights", 3.1e6, 0.0..=1e9)?;
    let sign = options.number("sign", 1.6e4, 0.0..=1e9)?;
    let sky = Painting::GROUND;
    let mut painting = Painting::new(BANDS, &Spectrum::constant(0.002));
    let mut grey = |reflectance| painting.material(&Spectrum::constant(reflectance));
    let [verge, road, mark, clothes, car] = [0.03, 0.06, 0.7, 0.3, 0.02].map(&mut grey);
    let (panel, headlights, sign) = (grey(0.02), grey(headlights), grey(sign));
    let mut lay = |shape, material, beneath| painting.lay(shape, material, beneath);
    lay(rect(-20.0, 0.0, 40.0, 20.0), verge, sky);
    let half_width = |v: f64| 0.02 + 1.4 * v;
    let across = |v: [f64; 2], part: f64| {
        let [near, far] = v.map(|v| part * half_width(v));
        Shape::Polygon(vec![[-near, v[0]], [near, v[0]], [far, v[1]], [-far, v[1]]])
    };
    lay(across([0.0, 2.0], 1.0), road, verge);
    for dash in [[0.02, 0.03], [0.045, 0.07], [0.11, 0.16], [0.24, 0.36]] {
        lay(across(dash, 0.03), mark, road);
    }
    lay(rect(0.29, 0.03, 0.04, 0.14), clothes, verge);
    lay(Shape::Disc { centre: [0.31, 0.017], radius: 0.011 }, clothes, verge);
    lay(rect(-0.095, 0.06, 0.07, 0.05), car, road);
    for u in [-0.082, -0.038] {
        lay(Shape::Disc { centre: [u, 0.09], radius: 0.005 }, headlights, car);
    }
    lay(rect(0.2, -0.2, 0.1, 0.1), panel, sky);
    for stroke in digits() {
        lay(stroke, sign, panel);
    }
    Ok(painting)
}

fn rect(left: f64, top: f64, width: f64, height: f64) -> Shape {
    Shape::Rect { left, top, width, height }
}

/// The strokes of "50", side by side without overlap.
fn digits() -> impl Iterator<Item = Shape> {
    let [width, height] = DIGIT;
    let half = 0.5 * (height - 3.0 * STROKE);
    let across = move |x: f64, y: f64| rect(x, y, width, STROKE);
    let down = move |x: f64, y: f64, length: f64| rect(x, y, STROKE, length);
    let (top, five, zero) = (-0.175, 0.216, 0.258);
    let right = width - STROKE;
    [
        across(five, top),
        down(five, top + STROKE, half),
        across(five, top + STROKE + half),
        down(five + right, top + 2.0 * STROKE + half, half),
        across(five, top + height - STROKE),
        across(zero, top),
        down(zero, top + STROKE, height - 2.0 * STROKE),
        down(zero + right, top + STROKE, height - 2.0 * STROKE),
        across(zero, top + height - STROKE),
    ]
    .into_iter()
}

#[cfg(test)]
mod tests {
    use crate::{Grid, chart::open};

    /// Every mark lies on what is said to be beneath it, so that nothing is brighter or darker than
    /// its material.
    #[test]
    fn nothing_is_counted_twice() {
        let scene = open("night-road:headlights=0.9,sign=0.8").unwrap().unwrap();
        let grid =
            Grid { width: 1600, height: 1000, left: -0.5, top: -0.3125, cell: 1.0 / 1600.0 };
        let plane = scene.plane(0, &grid).unwrap();
        let (least, most) =
            plane.data.iter().fold((1f32, 0f32), |(l, m), &v| (l.min(v), m.max(v)));
        assert!(least > 0.0019 && most < 0.9001, "{least} {most}");
        let at = |u: f64, v: f64| {
            plane.row(((v + 0.3125) * 1600.0) as usize)[((u + 0.5) * 1600.0) as usize]
        };
        for ((u, v), level) in
            [((0.31, 0.1), 0.3), ((-0.082, 0.09), 0.9), ((0.22, -0.173), 0.8), ((0.0, 0.3), 0.7)]
        {
            assert!((at(u, v) - level).abs() < 1e-3, "{u} {v}: {}", at(u, v));
        }
    }
}
