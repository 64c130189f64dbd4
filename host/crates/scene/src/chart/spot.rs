//! A point of light, or a bright disc, on a dark ground: for PSFs, flare and blooming.

use super::{BANDS, Options};
use crate::painting::Painting;
use crate::shape::Shape;
use camrig_base::{Result, Spectrum};

/// `point[:size=0.0002,level=1,x=0,y=0,ground=0]`: a disc far smaller than a pixel.
pub(super) fn point(options: &mut Options) -> Result<Painting> {
    spot(options, 2e-4, 0.0)
}

/// `bright-spot[:size=0.05,level=1,x=0,y=0,ground=0.02]`.
pub(super) fn bright_spot(options: &mut Options) -> Result<Painting> {
    spot(options, 0.05, 0.02)
}

/// `size` is the diameter in sensor widths; `level` the radiance relative to a perfect white in
/// the scene's light. Above 1 the spot is a light source, not a surface.
fn spot(options: &mut Options, size: f64, ground: f64) -> Result<Painting> {
    let radius = options.number("size", size, 1e-6..=10.0)? / 2.0;
    let level = options.number("level", 1.0, 0.0..=1e9)?;
    let centre =
        [options.number("x", 0.0, -10.0..=10.0)?, options.number("y", 0.0, -10.0..=10.0)?];
    let ground = options.number("ground", ground, 0.0..=1.0)?;
    let mut painting = Painting::new(BANDS, &Spectrum::constant(ground));
    let light = painting.material(&Spectrum::constant(level));
    painting.lay(Shape::Disc { centre, radius }, light, Painting::GROUND);
    Ok(painting)
}

#[cfg(test)]
mod tests {
    use crate::{Grid, chart::open};

    #[test]
    fn a_point_keeps_its_light_whatever_the_grid() {
        let point = open("point:size=0.001,level=1000,x=0.1,y=-0.03").unwrap().unwrap();
        for width in [10, 333, 4000] {
            let cell = 1.0 / width as f64;
            let grid = Grid { width, height: width, left: -0.5, top: -0.5, cell };
            let plane = point.plane(0, &grid).unwrap();
            let light = plane.data.iter().map(|&v| f64::from(v)).sum::<f64>() * cell * cell;
            let expected = 1000.0 * std::f64::consts::PI * 0.0005f64.powi(2);
            assert!((light / expected - 1.0).abs() < 1e-6, "{width}: {light}");
        }
    }
}
