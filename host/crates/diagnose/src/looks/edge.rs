//! The response along a slanted edge.

use super::{Figure, Found, Picture};
use crate::statistics::Scale;
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_measure::mtf::{self, Roi};

/// Parts of the edge that are measured apart: lenses differ over the field.
const PARTS: usize = 3;
/// Frequencies, tenths of a cycle per pixel.
const TENTHS: [u8; 5] = [1, 2, 3, 4, 5];

/// The figures of an edge.
pub fn figures(
    camera: &Camera,
    angle_deg: f64,
    horizontal: bool,
    picture: &Picture,
) -> Result<Vec<Found>> {
    let (cfa, black) = (&camera.sensor.cfa, camera.sensor.black_level_dn);
    let frequencies = TENTHS.map(|t| f64::from(t) / 10.0);
    let full = ((1u32 << camera.sensor.bits) - 1) as u16;
    let mut out = Vec::new();
    for part in 0..PARTS {
        let roi = region(&picture.mean, angle_deg, horizontal, part);
        for (channel, &letter) in cfa.channels().iter().enumerate() {
            let r = mtf::response(&picture.mean, cfa, letter, roi, Some(full), &frequencies)?;
            for (tenths, (value, sd)) in TENTHS.iter().zip(r.at) {
                let figure = Figure::Response(part as u8, channel as u8, *tenths);
                out.push((figure, value, sd, Scale::Linear));
            }
            if part == PARTS / 2 {
                for (side, (level, sd)) in r.levels.iter().enumerate() {
                    let figure = Figure::EdgeLevel(side as u8, channel as u8);
                    out.push((figure, level - black, *sd, Scale::Linear));
                }
            }
        }
    }
    Ok(out)
}

/// A part of the edge with half the frame across it.
fn region(frame: &camrig_base::Plane<f32>, angle_deg: f64, horizontal: bool, part: usize) -> Roi {
    let (across, along) = match horizontal {
        true => (frame.height, frame.width),
        false => (frame.width, frame.height),
    };
    let (half, third) = (across / 2, along / PARTS);
    // A turn clockwise moves the lower end of an upright edge to the left, the right end of a lying one down.
    let from_middle = (part as f64 - (PARTS / 2) as f64) * third as f64;
    let shift = from_middle * angle_deg.to_radians().tan() * if horizontal { 1.0 } else { -1.0 };
    let middle = (across / 2) as f64 + shift;
    let first = (middle - half as f64 / 2.0).clamp(0.0, (across - half) as f64) as usize;
    match horizontal {
        true => Roi { x: part * third, y: first, width: third, height: half },
        false => Roi { x: first, y: part * third, width: half, height: third },
    }
}
