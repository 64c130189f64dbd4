//! The MTF along a slanted edge (ISO 12233), and the levels of its sides.

use super::measured::MeasuredFigure;
use super::picture::Picture;
use crate::statistic::Figure;
use camrig_base::{Plane, Result};
use camrig_camera::Camera;
use camrig_measure::mtf::{self, Roi};

/// Parts of the edge that are measured separately, since a lens differs over the field.
const PARTS: usize = 3;
/// Spatial frequencies, tenths of a cycle per pixel, up to the Nyquist frequency.
const TENTHS: [u8; 5] = [1, 2, 3, 4, 5];

/// The figures of an edge.
pub fn figures(
    camera: &Camera,
    angle_deg: f64,
    horizontal: bool,
    picture: &Picture,
) -> Result<Vec<MeasuredFigure>> {
    let (cfa, black) = (&camera.sensor.cfa, camera.sensor.black_level_dn);
    let frequencies = TENTHS.map(|t| f64::from(t) / 10.0);
    let full = ((1u32 << camera.sensor.bits) - 1) as u16;
    let mut out = Vec::new();
    for part in 0..PARTS {
        let roi = region(&picture.mean, angle_deg, horizontal, part);
        for (channel, &letter) in cfa.channels().iter().enumerate() {
            let r = mtf::response(&picture.mean, cfa, letter, roi, Some(full), &frequencies)?;
            for (tenths, response) in TENTHS.iter().zip(r.at) {
                let (part, channel, tenths) = (part as u8, channel as u8, *tenths);
                let figure = Figure::Response { part, channel, tenths };
                out.push(MeasuredFigure::linear(figure, response.value, response.std_error));
            }
            if part == PARTS / 2 {
                for (side, level) in r.levels_dn.iter().enumerate() {
                    let (side, channel) = (side as u8, channel as u8);
                    let figure = Figure::EdgeLevel { side, channel };
                    out.push(MeasuredFigure::linear(figure, level.value - black, level.std_error));
                }
            }
        }
    }
    Ok(out)
}

/// Region of a part of the edge, as wide as half the frame across the edge.
fn region(frame: &Plane<f32>, angle_deg: f64, horizontal: bool, part: usize) -> Roi {
    let (across, along) = match horizontal {
        true => (frame.height, frame.width),
        false => (frame.width, frame.height),
    };
    let (half, third) = (across / 2, along / PARTS);
    // A clockwise rotation moves the lower end of a vertical edge to the left, the right end of a
    // horizontal edge down.
    let from_middle = (part as f64 - (PARTS / 2) as f64) * third as f64;
    let shift =
        from_middle * libm::tan(angle_deg.to_radians()) * if horizontal { 1.0 } else { -1.0 };
    let middle = (across / 2) as f64 + shift;
    let first = (middle - half as f64 / 2.0).clamp(0.0, (across - half) as f64) as usize;
    match horizontal {
        true => Roi { x: part * third, y: first, width: third, height: half },
        false => Roi { x: first, y: part * third, width: half, height: third },
    }
}
