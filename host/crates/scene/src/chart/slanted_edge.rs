//! A slanted edge through the centre of the frame, as ISO 12233 measures it.

use super::{BANDS, Geometry, Options};
use crate::painting::Painting;
use crate::shape::Shape;
use camrig_base::{Result, Spectrum};

/// `slanted-edge[:angle=5,contrast=4,bright=0.8,edge=vertical]`: dark left (or above), bright
/// right (or below). `angle` is in degrees from the vertical (or horizontal), positive clockwise;
/// `contrast` is bright over dark (ISO 12233:2017 asks for 4).
pub(super) fn from_options(options: &mut Options) -> Result<Painting> {
    let (angle, horizontal) = turn(options)?;
    let contrast = options.number("contrast", 4.0, 1.0..=1e6)?;
    let bright = options.number("bright", 0.8, 0.0..=1.0)?;
    let radians = (angle + if horizontal { 90.0 } else { 0.0 }).to_radians();
    let mut painting = Painting::new(BANDS, &Spectrum::constant(bright / contrast));
    let material = painting.material(&Spectrum::constant(bright));
    let normal = [libm::cos(radians), libm::sin(radians)];
    painting.lay(Shape::HalfPlane { origin: [0.0; 2], normal }, material, Painting::GROUND);
    Ok(painting)
}

/// Angle in degrees, and whether the edge is nearly horizontal.
fn turn(options: &mut Options) -> Result<(f64, bool)> {
    let angle = options.number("angle", 5.0, -45.0..=45.0)?;
    Ok((angle, options.word("edge", &["vertical", "horizontal"])? == "horizontal"))
}

/// Where the edge lies.
pub(super) fn geometry(options: &mut Options) -> Result<Geometry> {
    let (angle_deg, horizontal) = turn(options)?;
    Ok(Geometry::Edge { angle_deg, horizontal })
}

#[cfg(test)]
mod tests {
    use crate::{Grid, chart::open};

    /// Row by row the sum of a slanted edge gives the edge's place: u = −v tan(angle).
    #[test]
    fn edge_lies_exactly_where_it_should() {
        let grid = Grid { width: 400, height: 300, left: -0.5, top: -0.375, cell: 0.0025 };
        let plane = open("slanted-edge:angle=5").unwrap().unwrap().plane(3, &grid).unwrap();
        for y in [0, 77, 150, 299] {
            let sum: f64 = plane.row(y).iter().map(|&v| f64::from(v)).sum();
            let bright = (sum * grid.cell - 0.2) / (0.8 - 0.2);
            let v = grid.top + (y as f64 + 0.5) * grid.cell;
            let expected = 0.5 + v * 5f64.to_radians().tan();
            // 400 values in f32.
            assert!((bright - expected).abs() < 1e-6, "row {y}: {bright} for {expected}");
        }
        let mean = plane.data.iter().map(|&v| f64::from(v)).sum::<f64>() / 120_000.0;
        assert!((mean - 0.5).abs() < 1e-6);
    }

    #[test]
    fn horizontal_edge_is_bright_below() {
        let grid = Grid { width: 4, height: 4, left: -0.5, top: -0.5, cell: 0.25 };
        let plane = open("slanted-edge:angle=0,edge=horizontal")
            .unwrap()
            .unwrap()
            .plane(0, &grid)
            .unwrap();
        assert!((plane.at(0, 0) - 0.2).abs() < 1e-6 && (plane.at(3, 3) - 0.8).abs() < 1e-6);
    }
}
