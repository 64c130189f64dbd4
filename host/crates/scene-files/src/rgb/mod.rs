//! Pictures of red, green and blue, and renders, as scenes: PNG, JPEG, TIFF, OpenEXR, Radiance.
//!
//! Samples become linear sRGB, and each colour the smoothest spectrum that has it, in the bands of
//! [`Bands::VISIBLE`]: a reflectance between 0 and 1, or a radiance over the spectrum of D65.
//! Colours that no spectrum has are moved to their grey, which the notes say with their number and
//! the largest ΔE2000.
//!
//! A colour does not tell a spectrum. What that costs a camera, in its raw values, is in
//! `docs/guide/scene.md` and in the tests of [`camrig_light::colour`]; a raw frame with a
//! ColorChecker in it gives better spectra.
//!
//! # Light
//! A reflectance takes an illuminant as any other scene does. A radiance has in each unit of Y the
//! luminance that the user (`scale`) or the file states; where neither does, a level in lux or
//! cd/m² must be asked for. A level is that of the picture's white ([`White`]).

mod code_points;
mod icc;
pub(super) mod picture;
mod read_exr;
mod read_jpeg;
pub(super) mod read_png;
mod read_radiance;
mod read_tiff;

use super::cube::{BandSource, Cube};
use super::{Bands, Beyond, Components, Quantity, White};
use camrig_base::numbers::counted;
use camrig_base::{Error, Plane, Result, options};
use camrig_light::colour::mixture::Mixer;
use camrig_light::colour::smoothest::{self, Domain};
use camrig_light::colour::space::{
    ACESCG, ADOBE_GAMMA, ADOBE_RGB, DISPLAY_P3, REC2020, Space, luminance,
};
use camrig_light::colour::spectra::{Moved, Spectra};
use camrig_light::colour::transfer::Transfer;
use picture::{Picture, Said, Samples};
use rayon::prelude::*;
use serde::Deserialize;
use std::path::Path;

/// Share of pixels that may have a negative luminance, which a renderer's filter leaves next to
/// highlights; they are black.
const MAX_NEGATIVE: f64 = 1e-4;
/// Percentile of Y that is the white of a picture brighter than 1.
const WHITE_PERCENTILE: usize = 99;
/// Names of primaries.
const PRIMARIES: &str = "srgb, linear-srgb, rec2020, acescg, xyz, display-p3 and adobe-rgb";

/// What the user says of a picture, behind its name. Pictures have no sidecar: a file of the same
/// name next to a photograph or a render is often another program's.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Options {
    #[serde(rename = "as")]
    quantity: Option<String>,
    primaries: Option<String>,
    transfer: Option<toml::Value>,
    /// Luminance of a unit of Y, cd/m².
    scale: Option<f64>,
    /// Column, row, width and height of a patch that is white.
    white: Option<String>,
    /// Layer or part of an OpenEXR file.
    array: Option<String>,
    /// What lies outside the bands of its spectra.
    #[serde(default, deserialize_with = "crate::sidecar::beyond")]
    beyond: Beyond,
}

/// Whether a file is a picture, and no cube, by its ending and what it holds.
pub(super) fn is_picture(path: &Path, extension: &str) -> Result<bool> {
    match extension {
        "png" | "jpg" | "jpeg" => Ok(true),
        "hdr" => Ok(read_radiance::is_picture(path)),
        "tif" | "tiff" => read_tiff::is_picture(path),
        "exr" => read_exr::is_picture(path),
        _ => Ok(false),
    }
}

/// Opens a picture.
pub(super) fn open(path: &Path, extension: &str, options: &str) -> Result<Cube> {
    let options = Options::parse(options)?;
    let picture = match extension {
        "png" => read_png::read(path),
        "jpg" | "jpeg" => read_jpeg::read(path),
        "hdr" => read_radiance::read(path),
        "exr" => read_exr::read(path, options.array.as_deref()),
        _ => read_tiff::read(path),
    }?;
    if options.array.is_some() && extension != "exr" {
        return Err(Error::input("array= of a picture that has no layers"));
    }
    scene_of(picture, &options)
}

/// Refuses options that pictures do not have.
pub(super) fn check_options(options: &str) -> Result<()> {
    Options::parse(options).map(drop)
}

/// The scene of a decoded picture.
pub(super) fn of_picture(picture: Picture, options: &str) -> Result<Cube> {
    scene_of(picture, &Options::parse(options)?)
}

fn scene_of(mut picture: Picture, options: &Options) -> Result<Cube> {
    let quantity = options.quantity(&picture)?;
    let space = options.space(&mut picture)?;
    let (size, mut pixels) = picture.upright(linear(&picture, &space));
    check_numbers(&pixels, size)?;
    let mut notes = std::mem::take(&mut picture.notes);
    notes.extend(without_negative(&mut pixels)?);
    let domain = match quantity {
        Quantity::Reflectance => Domain::Reflectance,
        Quantity::Radiance => Domain::Emission,
    };
    let (spectra, moved) = Spectra::of(size, &pixels, domain)?;
    notes.extend(moved_note(moved, pixels.len(), domain));
    notes.push(metamerism_note(quantity));
    let mut understood = std::mem::take(&mut picture.understood);
    understood.push(format!("{} x {} pixels, colours: {}", size.0, size.1, space.name));
    understood.push(
        "each colour has the smoothest spectrum, 400 to 700 nm, that gives it under D65".into(),
    );
    let (units, white) = match quantity {
        Quantity::Reflectance => {
            options.no_light_of_its_own()?;
            ([1.0; smoothest::COUNT], None)
        }
        Quantity::Radiance => {
            let unit = options.scale()?.or(picture.white_luminance);
            let white = options.white(&pixels, size, unit)?;
            understood.push(unit.map_or(
                "radiance without an absolute scale: a light level is needed".into(),
                |unit| format!("radiance, {unit} cd/m² for a luminance of 1"),
            ));
            (smoothest::white()?.map(|v| v * unit.unwrap_or(1.0)), Some(white))
        }
    };
    let source = Lit { spectra, units };
    let cube = Cube::new(Box::new(source), Bands::VISIBLE.centres().collect(), quantity)?;
    cube.with(false, understood, notes).with_white(white).with_beyond(options.beyond)
}

/// Spectra of a picture in the unit of the scene.
struct Lit {
    spectra: Spectra,
    /// What the values of each band are multiplied by.
    units: smoothest::Curve,
}

impl BandSource for Lit {
    fn size(&self) -> (usize, usize) {
        self.spectra.size()
    }

    fn bands(&self) -> usize {
        smoothest::COUNT
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        Ok(self.spectra.plane(band, self.units[band]))
    }

    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        let quantity = match self.spectra.domain() {
            Domain::Reflectance => Quantity::Reflectance,
            Domain::Emission => Quantity::Radiance,
        };
        let mixed = mixer.mix(&self.spectra, &self.units)?;
        Ok(Some(Components::of_planes(mixed, quantity)))
    }
}

impl Options {
    fn parse(options: &str) -> Result<Self> {
        let help = "the keys of a picture are as (reflectance or radiance), primaries, transfer, \
                    scale, white, array and beyond";
        options::read(None, options, help)
    }

    fn quantity(&self, picture: &Picture) -> Result<Quantity> {
        match (&self.quantity, &picture.samples) {
            (Some(name), _) => Quantity::parse(name).ok_or_else(|| {
                Error::input(format!("as={name}"))
                    .help("a picture is as=reflectance or as=radiance")
            }),
            (None, Samples::Codes { .. }) => Ok(Quantity::Reflectance),
            (None, Samples::Floats(_)) => Ok(Quantity::Radiance),
        }
    }

    /// What the samples mean: as the user says, else the file, else what is usual for its kind.
    fn space(&self, picture: &mut Picture) -> Result<Space> {
        let floats = matches!(picture.samples, Samples::Floats(_));
        let said = std::mem::replace(&mut picture.said, Said::Nothing);
        let usual = if floats { Space::linear_srgb() } else { Space::srgb() };
        let mut assume = |what: &str| {
            picture.notes.push(format!(
                "{what}: {} is assumed (primaries= and transfer= say otherwise)",
                usual.name
            ));
            usual.clone()
        };
        let space = match (&self.primaries, said) {
            (Some(name), _) => named(name, floats)?,
            (None, Said::Space(space)) => space,
            (None, Said::Nothing) => assume("the file does not say what its colours are"),
            (None, Said::Unknown(what)) => assume(&format!("the file has {what}")),
            (None, Said::Refused(error)) => return Err(error),
        };
        let Some(transfer) = &self.transfer else { return Ok(space) };
        let name = transfer.as_str().map_or_else(|| transfer.to_string(), str::to_owned);
        Ok(space.with(&Transfer::parse(&name)?))
    }

    fn scale(&self) -> Result<Option<f64>> {
        match self.scale {
            Some(scale) if !(scale > 0.0 && scale.is_finite()) => {
                Err(Error::input(format!("scale={scale}"))
                    .help("give the luminance of a unit of Y, cd/m²"))
            }
            scale => Ok(scale),
        }
    }

    fn no_light_of_its_own(&self) -> Result<()> {
        let given = [self.scale.map(|_| "scale"), self.white.as_ref().map(|_| "white")];
        given.into_iter().flatten().next().map_or(Ok(()), |key| {
            Err(Error::input(format!("{key}= of a picture of reflectances"))
                .help("it belongs to as=radiance; a reflectance is lit by an illuminant"))
        })
    }

    /// The white of a picture of radiance: the patch that is stated, else 1 or the brightest
    /// percentile.
    fn white(
        &self,
        pixels: &[[f32; 3]],
        size: (usize, usize),
        unit: Option<f64>,
    ) -> Result<White> {
        let y = |pixel: &[f32; 3]| luminance(pixel.map(f64::from));
        let (words, value) = match &self.white {
            Some(text) => {
                let [left, top, width, height] = patch(text, size)?;
                let rows = pixels.chunks(size.0).skip(top).take(height);
                let sum: f64 = rows.flat_map(|row| &row[left..left + width]).map(y).sum();
                (format!("the patch white={text}"), sum / (width * height) as f64)
            }
            None => {
                let mut all: Vec<f64> = pixels.iter().map(y).collect();
                let at = (all.len() - 1) * WHITE_PERCENTILE / 100;
                let brightest = *all.select_nth_unstable_by(at, f64::total_cmp).1;
                if brightest > 1.0 {
                    (
                        format!("the {WHITE_PERCENTILE}th percentile of Y, {brightest:.4}"),
                        brightest,
                    )
                } else {
                    ("a Y of 1".into(), 1.0)
                }
            }
        };
        if value <= 0.0 {
            return Err(
                Error::input(format!("{words} is black")).help("state a patch that is lit")
            );
        }
        Ok(White { luminance: value * unit.unwrap_or(1.0), absolute: unit.is_some(), words })
    }
}

/// A patch `x,y,w,h` within a picture.
fn patch(text: &str, (width, height): (usize, usize)) -> Result<[usize; 4]> {
    let numbers: Vec<usize> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    let wrong = || {
        Error::input(format!("white={text} in {width} x {height} pixels"))
            .help("give column, row, width and height of a patch: white=10,20,32,32")
    };
    let patch: [usize; 4] = numbers.try_into().map_err(|_| wrong())?;
    let [x, y, w, h] = patch;
    let inside = |at: usize, n: usize, all| n > 0 && at.checked_add(n).is_some_and(|e| e <= all);
    if inside(x, w, width) && inside(y, h, height) { Ok(patch) } else { Err(wrong()) }
}

/// The space of a name; integers of Rec. 2020 have its camera curve, floats are linear.
fn named(name: &str, floats: bool) -> Result<Space> {
    let unless_linear = |transfer| if floats { Transfer::Linear } else { transfer };
    match name {
        "srgb" => Ok(Space::srgb()),
        "linear-srgb" => Ok(Space::linear_srgb()),
        "rec2020" => Space::of("Rec. 2020", &REC2020, unless_linear(Transfer::Bt2020)),
        "acescg" => Space::of("ACEScg, linear", &ACESCG, Transfer::Linear),
        "xyz" => Ok(Space::xyz()),
        "display-p3" => Space::of("Display P3", &DISPLAY_P3, unless_linear(Transfer::Srgb)),
        "adobe-rgb" => {
            let curve = unless_linear(Transfer::Gamma(ADOBE_GAMMA));
            Space::of("Adobe RGB", &ADOBE_RGB, curve)
        }
        _ => Err(Error::input(format!("primaries={name}"))
            .help(format!("the primaries are {PRIMARIES}"))),
    }
}

/// Linear sRGB of all pixels.
fn linear(picture: &Picture, space: &Space) -> Vec<[f32; 3]> {
    let to_srgb = |rgb: [f64; 3]| space.linear_srgb_of(rgb).map(|v| v as f32);
    match &picture.samples {
        Samples::Codes { data, most } => {
            let curve = |transfer: &Transfer| -> Vec<f64> {
                let code = |code: u16| transfer.linear(f64::from(code) / f64::from(*most));
                (0..=*most).map(code).collect()
            };
            let [r, g, b] = space.transfer.each_ref().map(curve);
            let of = |p: &[u16]| [r[p[0] as usize], g[p[1] as usize], b[p[2] as usize]];
            data.par_chunks_exact(3).map(|p| to_srgb(of(p))).collect()
        }
        Samples::Floats(data) => {
            let of = |p: &[f32]| [0, 1, 2].map(|c| space.transfer[c].linear(f64::from(p[c])));
            data.par_chunks_exact(3).map(|p| to_srgb(of(p))).collect()
        }
    }
}

/// Pixels that a thread looks at together.
const TOGETHER: usize = 4096;

fn check_numbers(pixels: &[[f32; 3]], (width, _): (usize, usize)) -> Result<()> {
    let wrong = |p: &&[f32; 3]| p.iter().any(|v| !v.is_finite());
    let all_finite = |pixels: &[[f32; 3]]| !pixels.iter().any(|p| wrong(&p));
    if pixels.par_chunks(TOGETHER).all(all_finite) {
        return Ok(());
    }
    let at = pixels.iter().position(|p| wrong(&p)).unwrap_or_default();
    let count = pixels.iter().filter(wrong).count();
    Err(Error::input(format!("{} without finite numbers", counted(count, "pixel")))
        .at(format!("column {}, row {}", at % width, at / width))
        .help("replace them first: a renderer leaves them where it failed"))
}

/// Makes pixels of negative luminance black, and says how many there were.
fn without_negative(pixels: &mut [[f32; 3]]) -> Result<Option<String>> {
    let most = (pixels.len() as f64 * MAX_NEGATIVE) as usize;
    let in_chunk = |pixels: &mut [[f32; 3]]| {
        let (mut count, mut least) = (0, 0.0f64);
        for pixel in pixels.iter_mut().filter(|p| p.iter().any(|v| *v < 0.0)) {
            let y = luminance(pixel.map(f64::from));
            if y < 0.0 {
                (count, least) = (count + 1, least.min(y));
                *pixel = [0.0; 3];
            }
        }
        (count, least)
    };
    let sum = |a: (usize, f64), b: (usize, f64)| (a.0 + b.0, a.1.min(b.1));
    let (count, least) = pixels.par_chunks_mut(TOGETHER).map(in_chunk).reduce(|| (0, 0.0), sum);
    if count > most.max(1) {
        return Err(Error::input(format!(
            "{} of negative luminance, down to {least:.4}",
            counted(count, "pixel")
        ))
        .help("light cannot be negative: is this a picture of something else?"));
    }
    Ok((count > 0).then(|| {
        let pixels = counted(count, "pixel");
        format!("taken as black: {pixels} of negative luminance, down to {least:.4}")
    }))
}

fn moved_note(moved: Moved, pixels: usize, domain: Domain) -> Option<String> {
    (moved.pixels > 0).then(|| {
        let what = match domain {
            Domain::Reflectance => "reflectance",
            Domain::Emission => "light",
        };
        format!(
            "{} pixels ({:.2} %) have colours that no {what} has; they were moved to their greys, \
             by a ΔE2000 of {:.1} at most",
            moved.pixels,
            100.0 * moved.pixels as f64 / pixels as f64,
            moved.delta_e
        )
    })
}

/// What not knowing the spectra costs: figures of the tests of `camrig_light::colour`.
fn metamerism_note(quantity: Quantity) -> String {
    let cost = match quantity {
        Quantity::Reflectance => {
            "by 1 % in the median and below 9 % for 95 % of measured surfaces"
        }
        Quantity::Radiance => {
            "by 1 % in the median in daylight, 3 % in tungsten and 8 % in fluorescent light"
        }
    };
    format!(
        "its spectra are estimated from three numbers a pixel: raw values differ from the true \
         ones {cost}; spectra from a raw frame with a ColorChecker in it are better"
    )
}
