//! DNG opcode lists: corrections that a raw converter is asked to make.
//!
//! Source: Adobe Digital Negative Specification 1.4, chapter 7. Lists are big-endian whatever the
//! byte order of the file. Only the opcodes that a simulated sensor needs are here: known
//! bad pixels (list 1, on stored values) and lens shading (list 2, on linear values before
//! demosaicing).

use super::truncated;
use camrig_base::{Cfa, Error, Result};

/// Version 1.3.0.0, in which both opcodes appeared.
const VERSION: u32 = 0x0103_0000;
/// Opcode of a list of bad pixels.
const FIX_BAD_PIXELS_LIST: u32 = 5;
/// Opcode of a gain map.
const GAIN_MAP: u32 = 9;

/// One correction.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Opcode {
    /// Pixels to interpolate from their neighbours of the same colour.
    FixBadPixelsList {
        /// Colour of the top-left pixel: 0 red, 1 green in a red row, 2 green in a blue row, 3
        /// blue.
        bayer_phase: u32,
        /// (row, column) of each bad pixel.
        points: Vec<(u32, u32)>,
    },
    /// Gains on a regular grid, bilinear between, for every `pitch`-th pixel of an area.
    GainMap(GainMap),
}

impl Opcode {
    /// The correction of an area (top, left, bottom, right) of the frame that it is of; `None`
    /// where nothing is left, and for gain maps, whose grid is of the whole frame.
    pub fn cropped(self, [top, left, bottom, right]: [u32; 4]) -> Option<Self> {
        let Self::FixBadPixelsList { bayer_phase, points } = self else { return None };
        let inside = |&(row, column): &(u32, u32)| {
            (top..bottom).contains(&row) && (left..right).contains(&column)
        };
        let points: Vec<_> =
            points.into_iter().filter(inside).map(|(y, x)| (y - top, x - left)).collect();
        // The phase's lowest bit is that of its columns, the next one that of its rows.
        let bayer_phase = bayer_phase ^ (left & 1 | (top & 1) << 1);
        (!points.is_empty()).then_some(Self::FixBadPixelsList { bayer_phase, points })
    }
}

/// A gain map for one phase of the colour filter pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct GainMap {
    /// Top, left, bottom, right of the area in pixels (bottom and right excluded); top and left
    /// choose the phase.
    pub area: [u32; 4],
    /// Distance between the pixels that the map applies to: rows, columns.
    pub pitch: [u32; 2],
    /// Number of grid nodes: vertical, horizontal.
    pub points: [u32; 2],
    /// Distance between nodes, relative to the image's height and width.
    pub spacing: [f64; 2],
    /// Position of the first node, relative to the image's height and width.
    pub origin: [f64; 2],
    /// Gains, row-major, `points[0] * points[1]` of them.
    pub gains: Vec<f32>,
}

/// The opcode for the bad pixels of a Bayer sensor, given as (row, column); `None` for other
/// patterns, for which it is not defined, and for an empty list.
pub fn bad_pixels(cfa: &Cfa, points: Vec<(u32, u32)>) -> Option<Opcode> {
    let phases = ["RGGB", "GRBG", "GBRG", "BGGR"];
    let bayer_phase = phases.iter().position(|p| *p == cfa.to_string())? as u32;
    (!points.is_empty()).then_some(Opcode::FixBadPixelsList { bayer_phase, points })
}

/// The same gain map for every cell of the pattern, as one opcode per cell. `nodes` (rows,
/// columns, at least 2 each) span the image from edge to edge; `gain` takes (x, y) from 0 to 1
/// over width and height.
pub fn gain_maps(
    cfa: &Cfa,
    [width, height]: [usize; 2],
    nodes: [u32; 2],
    gain: impl Fn(f64, f64) -> f64,
) -> Vec<Opcode> {
    let [rows, columns] = nodes;
    let spacing = nodes.map(|n| 1.0 / f64::from(n - 1));
    let node = |i: u32| {
        gain(f64::from(i % columns) * spacing[1], f64::from(i / columns) * spacing[0]) as f32
    };
    let gains: Vec<f32> = (0..rows * columns).map(node).collect();
    let map = |top: usize, left: usize| GainMap {
        area: [top, left, height, width].map(|v| v as u32),
        pitch: [cfa.height as u32, cfa.width as u32],
        points: nodes,
        spacing,
        origin: [0.0; 2],
        gains: gains.clone(),
    };
    let cells = (0..cfa.height).flat_map(|y| (0..cfa.width).map(move |x| (y, x)));
    cells.map(|(y, x)| Opcode::GainMap(map(y, x))).collect()
}

/// The bytes of an opcode list.
pub fn encode(opcodes: &[Opcode]) -> Vec<u8> {
    let mut bytes = (opcodes.len() as u32).to_be_bytes().to_vec();
    for opcode in opcodes {
        let mut body = Vec::new();
        let id = match opcode {
            Opcode::FixBadPixelsList { bayer_phase, points } => {
                put(&mut body, &[*bayer_phase, points.len() as u32, 0]);
                points.iter().for_each(|&(row, column)| put(&mut body, &[row, column]));
                FIX_BAD_PIXELS_LIST
            }
            Opcode::GainMap(map) => {
                put(&mut body, &map.area);
                put(&mut body, &[0, 1]); // plane, planes
                put(&mut body, &map.pitch);
                put(&mut body, &map.points);
                let grid = map.spacing.iter().chain(&map.origin);
                grid.for_each(|v| body.extend(v.to_be_bytes()));
                put(&mut body, &[1]); // map planes
                map.gains.iter().for_each(|g| body.extend(g.to_be_bytes()));
                GAIN_MAP
            }
        };
        put(&mut bytes, &[id, VERSION, 0, body.len() as u32]);
        bytes.extend(body);
    }
    bytes
}

fn put(bytes: &mut Vec<u8>, values: &[u32]) {
    values.iter().for_each(|v| bytes.extend(v.to_be_bytes()));
}

/// Names of the opcodes by number, from 1 (chapter 7 and, from 14 on, that of version 1.6).
const NAMES: [&str; 14] = [
    "WarpRectilinear",
    "WarpFisheye",
    "FixVignetteRadial",
    "FixBadPixelsConstant",
    "FixBadPixelsList",
    "TrimBounds",
    "MapTable",
    "MapPolynomial",
    "GainMap",
    "DeltaPerRow",
    "DeltaPerColumn",
    "ScalePerRow",
    "ScalePerColumn",
    "WarpRectilinear2",
];

/// The name of an opcode, or its number.
fn name(id: u32) -> String {
    let known = id.checked_sub(1).and_then(|i| NAMES.get(i as usize));
    known.map_or_else(|| format!("opcode {id}"), ToString::to_string)
}

/// The opcodes of a list: number and parameters of each.
fn entries(bytes: &[u8]) -> Result<Vec<(u32, &[u8])>> {
    let mut rest = Reader(bytes);
    let count = rest.u32()?;
    let entry = |_| {
        let [id, _version, _flags, length] = rest.u32s()?;
        Ok((id, rest.take(length as usize)?))
    };
    (0..count).map(entry).collect()
}

/// The names of the opcodes of a list.
///
/// # Errors
/// A list that is cut off.
pub fn names(bytes: &[u8]) -> Result<Vec<String>> {
    Ok(entries(bytes)?.into_iter().map(|(id, _)| name(id)).collect())
}

/// Reads an opcode list. Names of what is passed over, which is opcodes of other kinds and
/// rectangles of bad pixels, are added to `skipped`.
///
/// # Errors
/// A list that is cut off, or a gain map of several planes.
pub fn decode(bytes: &[u8], skipped: &mut Vec<String>) -> Result<Vec<Opcode>> {
    let mut opcodes = Vec::new();
    for (id, body) in entries(bytes)? {
        let mut body = Reader(body);
        match id {
            FIX_BAD_PIXELS_LIST => {
                let [bayer_phase, points, rectangles] = body.u32s()?;
                if rectangles > 0 {
                    skipped.push(format!("{rectangles} rectangle(s) of {}", name(id)));
                }
                let points = (0..points)
                    .map(|_| body.u32s().map(|[row, column]| (row, column)))
                    .collect::<Result<_>>()?;
                opcodes.push(Opcode::FixBadPixelsList { bayer_phase, points });
            }
            GAIN_MAP => {
                let (area, [_plane, _planes], pitch, points) =
                    (body.u32s()?, body.u32s()?, body.u32s()?, body.u32s()?);
                let (spacing, origin) = (body.f64s()?, body.f64s()?);
                let planes = body.u32()?;
                let count = points[0] as usize * points[1] as usize;
                let gains = body.take(count.saturating_mul(4 * planes as usize))?;
                if planes != 1 {
                    return Err(Error::unsupported(format!("a gain map of {planes} planes"))
                        .help("gain maps for colour filter arrays have one"));
                }
                let gains =
                    gains.chunks_exact(4).map(|b| f32::from_be_bytes([b[0], b[1], b[2], b[3]]));
                let gains = gains.collect();
                let map = GainMap { area, pitch, points, spacing, origin, gains };
                opcodes.push(Opcode::GainMap(map));
            }
            _ => skipped.push(name(id)),
        }
    }
    Ok(opcodes)
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, length: usize) -> Result<&'a [u8]> {
        if length > self.0.len() {
            return Err(truncated(length, self.0.len()).at("DNG opcode list"));
        }
        let (head, tail) = self.0.split_at(length);
        self.0 = tail;
        Ok(head)
    }

    fn u32(&mut self) -> Result<u32> {
        let b = self.take(4)?;
        Ok(u32::from_be_bytes([b[0], b[1], b[2], b[3]]))
    }

    fn u32s<const N: usize>(&mut self) -> Result<[u32; N]> {
        let mut values = [0; N];
        for value in &mut values {
            *value = self.u32()?;
        }
        Ok(values)
    }

    fn f64s(&mut self) -> Result<[f64; 2]> {
        let [a, b, c, d] = self.u32s()?;
        let join = |high: u32, low: u32| f64::from_bits(u64::from(high) << 32 | u64::from(low));
        Ok([join(a, b), join(c, d)])
    }
}
