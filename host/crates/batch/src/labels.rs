//! Labels of pictures, carried through the lens to the frames of a camera that sees the pictures.
//!
//! For a scene `STEM.jpg`, the folder of labels has `STEM.json`, shapes as LabelMe writes them
//! (`point`, `line`, `linestrip`, `polygon`, `rectangle`), or `STEM.png`, a grey picture of as many
//! pixels with a number for each class, or both. Shapes come out in the same form, in pixels of
//! the frame with the origin in its corner. Where the lens distorts, lines get corners every
//! [`PIECE`] pixels, and a rectangle becomes the upright one that its outline touches. Shapes may
//! reach beyond the frame; those that are wholly outside are left out. A mask's pixel is that of
//! the picture which the centre of the frame's pixel sees; beyond the picture, its edge goes on.

use camrig_base::{Error, Plane, Result};
use camrig_formats::{Facts, Frames, png};
use camrig_render::places::Places;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Longest straight piece of a line through a lens that bends it, pixels of the picture. A trade:
/// over 8 pixels, a bow of a tenth of a picture's side departs by less than a tenth of a pixel.
const PIECE: f64 = 8.0;

/// The files with the labels of a picture: shapes, mask.
///
/// # Errors
/// A picture without either.
pub fn files(folder: &Path, picture: &Path) -> Result<Vec<PathBuf>> {
    let stem = picture.file_stem().unwrap_or_default().to_string_lossy();
    let beside = |ending| folder.join(format!("{stem}.{ending}"));
    // A picture beside its labels is not its own mask.
    let own = picture.canonicalize().ok();
    let is_other = |path: &PathBuf| path.is_file() && path.canonicalize().ok() != own;
    let found: Vec<PathBuf> = ["json", "png"].map(beside).into_iter().filter(is_other).collect();
    match found.is_empty() {
        true => Err(Error::input(format!("no labels of {}", picture.display())).help(format!(
            "{} has shapes (LabelMe), or the same name with .png a mask",
            beside("json").display()
        ))),
        false => Ok(found),
    }
}

/// The labels in `files` as a camera sees them, with the endings of their files. `picture` and
/// `frame` are sizes in pixels.
///
/// # Errors
/// Files that are no labels of a picture of this size.
pub fn carried(
    files: &[PathBuf],
    places: &Places,
    picture: (usize, usize),
    frame: (usize, usize),
) -> Result<Vec<(&'static str, Vec<u8>)>> {
    let mut carried = Vec::new();
    for path in files {
        let bytes = std::fs::read(path).map_err(|e| Error::io("read", path, e))?;
        let made = match path.extension().is_some_and(|e| e == "json") {
            true => shapes(&bytes, places, picture, frame).map(|b| ("labels.json", b)),
            false => mask(&bytes, places, picture, frame).map(|b| ("mask.png", b)),
        };
        carried.push(made.map_err(|e| e.at(path.display()))?);
    }
    Ok(carried)
}

fn wrong_size(found: impl std::fmt::Display, (width, height): (usize, usize)) -> Error {
    Error::disagreement(format!("labels of {found} pixels for a picture of {width} x {height}"))
        .help("give labels of this picture")
}

fn shapes(
    bytes: &[u8],
    places: &Places,
    picture: (usize, usize),
    frame: (usize, usize),
) -> Result<Vec<u8>> {
    let mut file: Value = serde_json::from_slice(bytes)
        .map_err(|e| Error::input(format!("no JSON: {e}")).help("LabelMe writes such files"))?;
    let size = [&file["imageWidth"], &file["imageHeight"]].map(Value::as_u64);
    if size != [picture.0 as u64, picture.1 as u64].map(Some) {
        let found = format!("{} x {}", file["imageWidth"], file["imageHeight"]);
        return Err(wrong_size(found, picture));
    }
    let none = || Error::input("no \"shapes\"").help("LabelMe writes such files");
    let shapes = file["shapes"].as_array().ok_or_else(none)?;
    let mut seen = Vec::new();
    for (number, shape) in shapes.iter().enumerate() {
        let at = |e: Error| e.at(format!("shape {number}"));
        let outline = outline(shape, places.is_linear()).map_err(at)?;
        let imaged: Vec<_> = outline.into_iter().map(|place| places.imaged(place)).collect();
        let inside = |[x, y]: [f64; 2]| {
            (0.0..=frame.0 as f64).contains(&x) && (0.0..=frame.1 as f64).contains(&y)
        };
        let kind = shape["shape_type"].as_str().unwrap_or("polygon");
        let bounds = bounds(imaged.iter().flatten());
        // An outline may go round the frame.
        let outside = match kind {
            "point" | "line" | "linestrip" => !imaged.iter().flatten().any(|&place| inside(place)),
            _ => {
                let [[left, top], [right, bottom]] = bounds;
                right < 0.0 || bottom < 0.0 || left > frame.0 as f64 || top > frame.1 as f64
            }
        };
        if outside {
            continue;
        }
        let whole: Option<Vec<[f64; 2]>> = imaged.into_iter().collect();
        let points = whole.ok_or_else(|| {
            at(Error::unsupported("a shape of which the lens images a part alone"))
                .help("crop it to what the camera sees")
        })?;
        let mut shape = shape.clone();
        shape["points"] = if kind == "rectangle" { json!(bounds) } else { json!(points) };
        seen.push(shape);
    }
    file["shapes"] = seen.into();
    file["imageWidth"] = frame.0.into();
    file["imageHeight"] = frame.1.into();
    // The picture itself, and its name.
    file["imageData"] = Value::Null;
    file["imagePath"] = Value::Null;
    Ok(format!("{file}\n").into_bytes())
}

/// The points of a shape; with as many more on its lines as one that is bent needs.
fn outline(shape: &Value, straight: bool) -> Result<Vec<[f64; 2]>> {
    let kind = shape["shape_type"].as_str().unwrap_or("polygon");
    let points: Vec<[f64; 2]> = serde_json::from_value(shape["points"].clone())
        .map_err(|_| Error::input("\"points\" are no pairs of numbers"))?;
    let (corners, closed) = match (kind, &points[..]) {
        ("point", [_]) => return Ok(points),
        ("rectangle", &[[left, top], [right, bottom]]) => {
            (vec![[left, top], [right, top], [right, bottom], [left, bottom]], true)
        }
        ("polygon", [_, _, ..]) => (points, true),
        ("line" | "linestrip", [_, _, ..]) => (points, false),
        _ => {
            let found = format!("a shape {kind:?} of {} points", points.len());
            return Err(Error::unsupported(found)
                .help("use point, line, linestrip, polygon or rectangle (two corners)"));
        }
    };
    if straight {
        return Ok(corners);
    }
    let mut all = Vec::new();
    let lines = corners.len() - usize::from(!closed);
    for (from, to) in (0..lines).map(|i| (corners[i], corners[(i + 1) % corners.len()])) {
        let [right, down] = [to[0] - from[0], to[1] - from[1]];
        let pieces = (libm::hypot(right, down) / PIECE).ceil().clamp(1.0, 1e4);
        let parts = (0..pieces as usize).map(|k| k as f64 / pieces);
        all.extend(parts.map(|part| [from[0] + part * right, from[1] + part * down]));
    }
    all.extend(corners.last().filter(|_| !closed));
    Ok(all)
}

/// Corners of the smallest upright rectangle about points.
fn bounds<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> [[f64; 2]; 2] {
    points.fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[low, high], point| {
        [[0, 1].map(|i| point[i].min(low[i])), [0, 1].map(|i| point[i].max(high[i]))]
    })
}

fn mask(
    bytes: &[u8],
    places: &Places,
    picture: (usize, usize),
    frame: (usize, usize),
) -> Result<Vec<u8>> {
    let classes = png::decode(bytes)
        .map_err(|e| e.help("a mask is a grey PNG of 8 or 16 bits, a number for each class"))?;
    let plane = &classes.planes[0];
    if (plane.width, plane.height) != picture {
        return Err(wrong_size(format!("{} x {}", plane.width, plane.height), picture));
    }
    let pixel = |place: f64, count: usize| (place.max(0.0) as usize).min(count - 1);
    let seen = Plane::from_fn(frame.0, frame.1, |x, y| {
        let [x, y] = places.seen([x as f64 + 0.5, y as f64 + 0.5]);
        plane.data[pixel(y, plane.height) * plane.width + pixel(x, plane.width)]
    });
    let bits = classes.facts.bits;
    png::encode(&Frames { planes: vec![seen], facts: Facts { bits, ..Facts::default() } })
}
