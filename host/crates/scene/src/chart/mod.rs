//! Built-in charts, named `NAME[:KEY=VALUE,...]`. Their area averages are exact at any resolution.

pub mod checkerboard;
pub mod colorchecker;
pub mod dots;
mod options;
pub mod ramp;
pub mod resolution;
pub mod slanted_edge;
pub mod spot;

use super::Scene;
use super::painting::Painting;
use camrig_base::{Bands, Result, Spectrum};
use options::Options;

/// The bands in which charts are given.
pub const BANDS: Bands = Bands::VISIBLE;

/// Names of the charts.
pub const NAMES: &[&str] = &[
    "colorchecker",
    "slanted-edge",
    "dots",
    "ramp",
    "uniform",
    "checkerboard",
    "resolution",
    "point",
    "bright-spot",
];

/// The chart of a name, `None` where no chart has it.
pub fn open(name: &str, options: &str) -> Option<Result<Box<dyn Scene>>> {
    let open: fn(&mut Options) -> Result<Box<dyn Scene>> = match name {
        "colorchecker" => |o| Ok(Box::new(colorchecker::from_options(o)?)),
        "slanted-edge" => |o| Ok(Box::new(slanted_edge::from_options(o)?)),
        "dots" => |o| Ok(Box::new(dots::from_options(o)?)),
        "ramp" => |o| Ok(Box::new(ramp::from_options(o)?)),
        "uniform" => |o| Ok(Box::new(uniform(o)?)),
        "checkerboard" => |o| Ok(Box::new(checkerboard::from_options(o)?)),
        "resolution" => |_| Ok(Box::new(resolution::chart())),
        "point" => |o| Ok(Box::new(spot::point(o)?)),
        "bright-spot" => |o| Ok(Box::new(spot::bright_spot(o)?)),
        _ => return None,
    };
    Some(Options::parse(options).and_then(|mut options| {
        let scene = open(&mut options)?;
        options.finish()?;
        Ok(scene)
    }))
}

/// Where the targets of a chart lie, for measurements.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// An edge through the centre, near the vertical or the horizontal.
    Edge {
        /// Rotation, clockwise, degrees.
        angle_deg: f64,
        /// Whether the edge is nearly horizontal.
        horizontal: bool,
    },
    /// A ColorChecker.
    Patches {
        /// Width of the card, sensor widths.
        card_width: f64,
    },
    /// A grid of dots.
    Dots(dots::Dots),
}

/// The geometry of a chart by its scene's name with options, `None` for others.
///
/// # Errors
/// Options that the chart does not have.
pub fn geometry(spec: &str) -> Result<Option<Geometry>> {
    let (name, options) = spec.split_once(':').unwrap_or((spec, ""));
    let mut options = Options::parse(options)?;
    Ok(Some(match name {
        "slanted-edge" => slanted_edge::geometry(&mut options)?,
        "colorchecker" => Geometry::Patches { card_width: colorchecker::width(&mut options)? },
        "dots" => Geometry::Dots(dots::from_options(&mut options)?),
        _ => return Ok(None),
    }))
}

/// `uniform:0.18` or `uniform:reflectance=0.18`: one reflectance everywhere (default 0.18).
fn uniform(options: &mut Options) -> Result<Painting> {
    let reflectance = options.first_or_number("reflectance", 0.18, 0.0..=1.0)?;
    Ok(Painting::new(BANDS, &Spectrum::constant(reflectance)))
}
