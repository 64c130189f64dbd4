//! OpenEXR pictures: channels R, G, B or X, Y, Z or a grey Y, of halves or floats, in any part.
//!
//! Attributes that are read: `chromaticities` (without them the file's default, Rec. 709) and
//! `whiteLuminance`, the luminance of R = G = B = 1 in cd/m².

use super::picture::{MAX_PIXELS, Picture, Said, Samples};
use crate::cube::BandSource;
use crate::exr::{Channels, Window, is_spectral, part_name, refused};
use ::exr::meta::attribute::SampleType;
use ::exr::meta::header::Header;
use ::exr::prelude::{MetaData, Vec2};
use camrig_base::{Error, Result};
use camrig_light::colour::space::{Chromaticities, Space};
use std::path::Path;

/// Names of the channels of a picture, in order of preference.
const CHANNELS: [&[&str]; 3] = [&["R", "G", "B"], &["X", "Y", "Z"], &["Y"]];
/// Names of layers with the picture itself, in order of preference.
const PREFERRED: [&str; 10] =
    ["", "combined", "composite", "beauty", "rgba", "rgb", "c", "ci", "color", "colour"];
/// Beginnings and whole names of layers and parts that hold directions or places, and no light,
/// in small letters.
const DIRECTIONS: [&str; 7] =
    ["normal", "position", "vector", "motion", "velocity", "tangent", "worldnormal"];
const SHORT_DIRECTIONS: [&str; 8] = ["n", "ng", "ns", "p", "pref", "vec", "uv", "st"];
/// The chromaticities that mean CIE XYZ.
const XYZ: [[f32; 2]; 3] = [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]];

/// Whether an image has channels of a picture and none of spectra.
pub fn is_picture(path: &Path) -> Result<bool> {
    let meta = MetaData::read_from_file(path, false).map_err(refused)?;
    let names = meta.headers.iter().flat_map(|header| &header.channels.list);
    let spectra = names.map(|channel| channel.name.to_string()).any(|n| is_spectral(&n));
    Ok(!spectra && (!found(&meta).is_empty() || has_chroma(&meta)))
}

/// Whether there is a picture of luminance and chroma, which at half the resolution is no picture
/// of three channels.
fn has_chroma(meta: &MetaData) -> bool {
    let mut names = meta.headers.iter().flat_map(|header| &header.channels.list);
    let last = |name: String| name.rsplit('.').next().is_some_and(|n| ["RY", "BY"].contains(&n));
    names.any(|channel| last(channel.name.to_string()))
}

/// The channels of one picture in a part.
struct Found {
    part: usize,
    /// The name of its layer, else of its part.
    place: String,
    names: &'static [&'static str],
    channels: Vec<usize>,
    /// Its places in the lists of channels and of names.
    rank: (usize, usize),
}

pub fn read(path: &Path, wanted: Option<&str>) -> Result<Picture> {
    let meta = MetaData::read_from_file(path, false).map_err(refused)?;
    let mut pictures = found(&meta);
    if pictures.is_empty() && has_chroma(&meta) {
        return Err(Error::unsupported("a picture of luminance and chroma (Y, RY, BY)")
            .help("convert it to R, G and B"));
    }
    let tie = pictures.iter().filter(|f| f.rank == pictures[0].rank).count() > 1;
    if tie && wanted.is_none() && pictures[0].rank.1 == PREFERRED.len() {
        return Err(Error::input("several pictures, none of which is named as the image")
            .help(format!("choose one by array=NAME: {}", names_of(&pictures))));
    }
    let named = |f: &Found| wanted.is_none_or(|wanted| f.place == wanted);
    let Some(chosen) = pictures.iter().position(named) else {
        return Err(Error::input(format!("no picture in a layer or part {wanted:?}"))
            .help(format!("the layers with pictures are {}", names_of(&pictures))));
    };
    let chosen = pictures.remove(chosen);
    let header = &meta.headers[chosen.part];
    let types: Vec<SampleType> = header.channels.list.iter().map(|c| c.sample_type).collect();
    if chosen.channels.iter().any(|at| types[*at] == SampleType::U32) {
        return Err(Error::unsupported("colours of whole numbers (UINT)")
            .help("they have no unit: save them as halves or floats, 1 for white"));
    }
    let window = Window::of(path, header, chosen.channels.len(), MAX_PIXELS)?;
    let size = window.size;
    let source = Channels {
        path: path.into(),
        window,
        part: chosen.part,
        types,
        channels: chosen.channels.clone(),
    };
    let mut data = vec![0.0f32; 3 * size.0 * size.1];
    for colour in 0..3 {
        let plane = source.read(colour.min(chosen.channels.len() - 1))?;
        data.iter_mut().skip(colour).step_by(3).zip(plane.data).for_each(|(v, p)| *v = p);
    }
    let mut understood = vec![format!("OpenEXR, channels {}", chosen.names.join(", "))];
    if !chosen.place.is_empty() {
        understood[0].push_str(&format!(" of {:?}", chosen.place));
    }
    let mut notes = unused(header, &chosen, &pictures);
    notes.extend(window.note());
    let stated = header.own_attributes.white_luminance.map(f64::from);
    let white_luminance = stated.filter(|luminance| *luminance > 0.0 && luminance.is_finite());
    if let (Some(stated), None) = (stated, white_luminance) {
        notes.push(format!("a whiteLuminance of {stated} is no luminance, and not used"));
    }
    Ok(Picture {
        size,
        samples: Samples::Floats(data),
        said: said(header, chosen.names),
        orientation: 1,
        white_luminance,
        understood,
        notes,
    })
}

fn names_of(pictures: &[Found]) -> String {
    pictures.iter().map(|f| format!("{:?}", f.place)).collect::<Vec<_>>().join(", ")
}

/// All pictures of a file, the likeliest first.
fn found(meta: &MetaData) -> Vec<Found> {
    let mut pictures = Vec::new();
    for (part, header) in meta.headers.iter().enumerate().filter(|(_, header)| !header.deep) {
        let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
        let at = |name: &str| {
            let at = names.iter().position(|n| n == name)?;
            (header.channels.list[at].sampling == Vec2(1, 1)).then_some(at)
        };
        let mut layers: Vec<&str> =
            names.iter().map(|n| n.rsplit_once('.').map_or("", |(layer, _)| layer)).collect();
        layers.sort_unstable();
        layers.dedup();
        for layer in layers {
            let full = |name: &&str| match layer {
                "" => name.to_string(),
                _ => format!("{layer}.{name}"),
            };
            // Luminance with chroma at half the resolution is no grey picture.
            let chroma = names.contains(&full(&"RY"));
            let place = match (layer, part_name(header)) {
                ("", Some(part)) => part,
                _ => layer.to_string(),
            };
            if is_direction(layer) || part_name(header).is_some_and(|part| is_direction(&part)) {
                continue;
            }
            let word = place.rsplit('.').next().unwrap_or("").to_lowercase();
            let alone = layer.is_empty() && meta.headers.len() == 1;
            let preferred = PREFERRED.iter().position(|name| alone || *name == word);
            let kinds = CHANNELS.iter().enumerate();
            let picture = kinds.filter(|_| !chroma).find_map(|(kind, names)| {
                let channels = names.iter().map(|name| at(&full(name))).collect::<Option<_>>()?;
                let rank = (kind, preferred.unwrap_or(PREFERRED.len()));
                Some(Found { part, place: place.clone(), names, channels, rank })
            });
            pictures.extend(picture);
        }
    }
    pictures.sort_by_key(|f| f.rank);
    pictures
}

/// Whether a layer or part holds directions or places by its name.
fn is_direction(name: &str) -> bool {
    let word = name.rsplit('.').next().unwrap_or(name).to_lowercase();
    SHORT_DIRECTIONS.contains(&&*word) || DIRECTIONS.iter().any(|start| word.starts_with(start))
}

fn said(header: &Header, names: &[&str]) -> Said {
    let own = header.shared_attributes.chromaticities;
    let pair = |v: Vec2<f32>| [v.0, v.1];
    let xyz = own.is_some_and(|c| [c.red, c.green, c.blue].map(pair) == XYZ);
    if names == CHANNELS[1] || xyz {
        return Said::Space(Space::xyz());
    }
    let Some(c) = own else { return Said::Nothing };
    let primaries: Chromaticities =
        [c.red, c.green, c.blue, c.white].map(|v| pair(v).map(f64::from));
    Said::of_linear("its attribute chromaticities", &primaries)
}

fn unused(header: &Header, chosen: &Found, others: &[Found]) -> Vec<String> {
    let mut notes = Vec::new();
    let list = header.channels.list.iter().enumerate();
    let left = list.filter(|(at, _)| !chosen.channels.contains(at));
    let left: Vec<String> = left.map(|(_, channel)| channel.name.to_string()).collect();
    if !left.is_empty() {
        notes.push(format!("channels that were not used: {}", left.join(", ")));
    }
    if !others.is_empty() {
        let name = |f: &Found| match &*f.place {
            "" => "no layer".to_string(),
            place => format!("{place:?}"),
        };
        let more: Vec<String> = others.iter().map(name).collect();
        notes.push(format!(
            "the picture is that of {}; array=NAME chooses another: {}",
            name(chosen),
            more.join(", ")
        ));
    }
    notes
}
