//! Built-in charts, named `NAME[:KEY=VALUE,...]`. Their area averages are exact at any resolution.

pub mod checkerboard;
pub mod colorchecker;
pub mod dots;
mod night_road;
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

/// Names of the charts; they are read without regard to case.
pub const NAMES: &[&str] = &[
    "colorchecker",
    "colorchecker-isetcam",
    "slanted-edge",
    "dots",
    "ramp",
    "uniform",
    "checkerboard",
    "resolution",
    "point",
    "bright-spot",
    "night-road",
];

/// The chart that a scene's name (`NAME[:OPTIONS]`) names; `None` where no chart has it.
pub fn open(spec: &str) -> Option<Result<Box<dyn Scene>>> {
    let (name, options) = spec.split_once(':').unwrap_or((spec, ""));
    Some(open_told(name, options)?.map(|(scene, _)| scene))
}

/// A chart, and what was understood of it in words.
pub type Told = (Box<dyn Scene>, Vec<String>);

/// The chart of a name with what was understood of it, `None` where no chart has it.
pub fn open_told(name: &str, options: &str) -> Option<Result<Told>> {
    let name = name.to_ascii_lowercase();
    let open: fn(&mut Options) -> Result<Box<dyn Scene>> = match &*name {
        "colorchecker" => {
            |o| Ok(Box::new(colorchecker::from_options(o, &colorchecker::reflectances())?))
        }
        "colorchecker-isetcam" => {
            |o| Ok(Box::new(colorchecker::from_options(o, &colorchecker::isetcam_reflectances())?))
        }
        "slanted-edge" => |o| Ok(Box::new(slanted_edge::from_options(o)?)),
        "dots" => |o| Ok(Box::new(dots::from_options(o)?)),
        "ramp" => |o| Ok(Box::new(ramp::from_options(o)?)),
        "uniform" => |o| Ok(Box::new(uniform(o)?)),
        "checkerboard" => |o| Ok(Box::new(checkerboard::from_options(o)?)),
        "resolution" => |_| Ok(Box::new(resolution::chart())),
        "point" => |o| Ok(Box::new(spot::point(o)?)),
        "bright-spot" => |o| Ok(Box::new(spot::bright_spot(o)?)),
        "night-road" => |o| Ok(Box::new(night_road::from_options(o)?)),
        _ => return None,
    };
    Some(Options::parse(options).and_then(|mut options| {
        let scene = open(&mut options)?;
        let mut understood = vec![ABOUT.iter().find(|(n, _)| *n == &*name).map_or("", |(_, s)| s)];
        let used = options.used().join(",");
        if !used.is_empty() {
            understood.push(&used);
        }
        let understood = understood.into_iter().map(str::to_owned).collect();
        options.finish()?;
        Ok((scene, understood))
    }))
}

/// What charts show.
const ABOUT: &[(&str, &str)] = &[
    ("colorchecker", "24 patches, averages of 30 charts, on their card, on a grey ground of 0.18"),
    ("colorchecker-isetcam", "the same with the reflectances of ISETCam's chart"),
    ("slanted-edge", "an edge through the centre, dark left or above, bright right or below"),
    ("dots", "a square grid of dots over the whole plane"),
    ("ramp", "grey that rises linearly over the frame's width, or in steps"),
    ("uniform", "one reflectance everywhere"),
    ("checkerboard", "squares over the whole plane, a corner in the centre"),
    ("resolution", "elements of ISO 12233, 0.04 on 0.8, for frames from 4:3 to 16:9"),
    ("point", "a disc of size sensor widths; a level above 1 is a light source"),
    ("bright-spot", "a disc of size sensor widths; a level above 1 is a light source"),
    ("night-road", "a pedestrian beside a road, headlights and a sign, for a scene of 1 lx"),
];

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
    Ok(Some(match &*name.to_ascii_lowercase() {
        "slanted-edge" => slanted_edge::geometry(&mut options)?,
        "colorchecker" | "colorchecker-isetcam" => {
            Geometry::Patches { card_width: colorchecker::width(&mut options)? }
        }
        "dots" => Geometry::Dots(dots::from_options(&mut options)?),
        _ => return Ok(None),
    }))
}

/// `uniform:0.18` or `uniform:reflectance=0.18`: one reflectance everywhere (default 0.18).
fn uniform(options: &mut Options) -> Result<Painting> {
    let reflectance = options.first_or_number("reflectance", 0.18, 0.0..=1.0)?;
    Ok(Painting::new(BANDS, &Spectrum::constant(reflectance)))
}
