//! Zemax lens files (`.zmx`), in any of their encodings.
//!
//! Read: standard, even-asphere, odd-asphere, extended-asphere, Forbes, biconic, toroidal and
//! paraxial surfaces, coordinate breaks, mirrors, catalogue and model glasses, angles and heights
//! as fields, circular, elliptical and rectangular apertures and obscurations (`SQAP` and its like
//! give half widths), telecentric object space, configurations. Refused: other surface types,
//! spiders and polygons, tilts and decentres of single surfaces' properties, cone angles, afocal
//! systems. Keywords of editing, drawing, tolerancing and merit functions are ignored (`known.rs`),
//! others that are not read are reported; values that a pickup or solve governs are taken as they
//! stand. Lines of surfaces are known by their keywords too, where their indentation is lost.

mod configurations;
mod fields;
mod known;
mod material;
mod said;
mod shape;
mod waves;

use crate::refuse;
use camrig_base::{Error, Result};
use camrig_glass::text::{number, numbers};
use camrig_glass::{Catalogue, Glass};
use camrig_prescription::{Aperture, Clip, Form, Medium, Object};
use camrig_prescription::{Prescription, Shape, Surface};
use configurations::Configurations;
use material::Glasses;
use said::Said;
use std::collections::BTreeMap;

/// Object distances from which on the object counts as at infinity, in the file's unit: programs
/// write 1e10 where they do not write INFINITY.
const INFINITE: f64 = 1e10;

/// A surface as the file describes it.
#[derive(Default)]
struct Draft {
    line: usize,
    kind: String,
    curvature: f64,
    conic: f64,
    parameters: Vec<f64>,
    extra: Vec<f64>,
    /// To the next surface; infinite unless given.
    thickness: f64,
    glass: Option<(usize, Vec<String>)>,
    diameter: Option<(f64, bool)>,
    clips: Vec<Clip>,
    centre: [f64; 2],
    clear: bool,
    stop: bool,
    coated: bool,
}

#[derive(Default)]
struct File {
    name: String,
    scale: Option<f64>,
    aperture: Option<(usize, Vec<String>)>,
    field_kind: usize,
    telecentric: bool,
    counts: [usize; 2],
    fields_x: Vec<f64>,
    fields_y: Vec<f64>,
    vignetting: [Vec<f64>; 4],
    /// Wavelengths, nm, and their weights by number.
    waves: BTreeMap<usize, (f64, f64)>,
    /// Those of files without a line for each wavelength.
    old_waves: Vec<f64>,
    old_weights: Vec<f64>,
    primary: Option<usize>,
    makers: Vec<String>,
    surfaces: Vec<Draft>,
    configurations: Configurations,
    said: Said,
    /// Lines behind `SURF` of which nothing is known: they are the surface's where another of its
    /// lines follows, and an editor's behind the last surface.
    doubtful: Vec<(usize, String)>,
    notes: Vec<String>,
}

/// A prescription from the text of a `.zmx` file.
///
/// # Errors
/// What is unsupported or wrong, with its line.
pub fn read(text: &str, glasses: &Catalogue) -> Result<Prescription> {
    read_configuration(text, glasses, None)
}

/// A prescription from the text of a `.zmx` file in one of its configurations, by number from 1 or
/// by title; `None` takes the active one.
///
/// # Errors
/// Those of [`read`]; a configuration that the file does not have, or that differs from the active
/// one in more than thicknesses, curvatures and conics.
pub fn read_configuration(
    text: &str,
    glasses: &Catalogue,
    configuration: Option<&str>,
) -> Result<Prescription> {
    let mut file = File::default();
    for (i, line) in text.lines().enumerate() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let Some((keyword, rest)) = words.split_first() else { continue };
        // Editors and web pages strip the indentation of a surface's lines.
        let indented = line.starts_with([' ', '\t']);
        file.line(indented, keyword, rest, i + 1).map_err(|e| e.at(format!("line {}", i + 1)))?;
    }
    file.finish(glasses, configuration)
}

fn word<'a>(words: &[&'a str], i: usize, keyword: &str) -> Result<&'a str> {
    words.get(i).copied().ok_or_else(|| {
        Error::input(format!("{keyword} has no value {}", i + 1)).help("the line is cut short")
    })
}

fn value(words: &[&str], i: usize, keyword: &str) -> Result<f64> {
    number(keyword, word(words, i, keyword)?)
}

fn count(words: &[&str], i: usize, keyword: &str) -> Result<usize> {
    let v = value(words, i, keyword)?;
    if v.fract() == 0.0 && (0.0..=1000.0).contains(&v) {
        return Ok(v as usize);
    }
    Err(Error::input(format!("{keyword}: {v}")).help("a small whole number is expected"))
}

impl File {
    /// A line; behind `SURF` it is the surface's if it is indented or by its keyword.
    fn line(&mut self, indented: bool, keyword: &str, rest: &[&str], line: usize) -> Result<()> {
        self.said.take(keyword, rest, (line, self.surfaces.len()))?;
        let by_name = !self.configurations.have_begun() && known::is_of_surface(keyword);
        if by_name || keyword == "SURF" {
            for (line, keyword) in std::mem::take(&mut self.doubtful) {
                self.configurations.surface_line(&keyword, &[], line);
                self.unknown(&keyword, "of a surface", line);
            }
        }
        let Some(surface) = self.surfaces.last_mut().filter(|_| indented || by_name) else {
            return self.keyword(keyword, rest, line);
        };
        self.configurations.surface_line(keyword, rest, line);
        if !surface.keyword(keyword, rest, line)? {
            self.unknown(keyword, "of a surface", line);
        }
        Ok(())
    }

    fn keyword(&mut self, keyword: &str, rest: &[&str], line: usize) -> Result<()> {
        match keyword {
            "MODE" if word(rest, 0, keyword)? != "SEQ" => {
                return refuse("a non-sequential system");
            }
            "NAME" => self.name = rest.join(" "),
            "UNIT" => {
                self.scale = Some(match word(rest, 0, keyword)? {
                    "MM" => 1.0,
                    "CM" => 10.0,
                    "IN" => 25.4,
                    "M" | "METER" => 1000.0,
                    unit => {
                        return Err(Error::unsupported(format!("unit \"{unit}\""))
                            .help("known units are MM, CM, IN and METER"));
                    }
                });
            }
            _ if said::is_unused_aperture(keyword, rest) && self.aperture.is_some() => {}
            "ENPD" | "FNUM" | "OBNA" | "FLOA" => {
                let words = [keyword].iter().chain(rest).map(|w| (*w).to_owned()).collect();
                self.aperture = Some((line, words));
            }
            "FTYP" => {
                self.field_kind = count(rest, 0, keyword)?;
                if rest.len() > 3 {
                    self.counts = [count(rest, 2, keyword)?, count(rest, 3, keyword)?];
                }
                self.telecentric = fields::telecentric(rest)?;
            }
            "XFLN" => self.fields_x = numbers(keyword, rest)?,
            "YFLN" => self.fields_y = numbers(keyword, rest)?,
            "XFLD" if self.fields_x.is_empty() => self.fields_x = numbers(keyword, rest)?,
            "YFLD" if self.fields_y.is_empty() => self.fields_y = numbers(keyword, rest)?,
            "VDXN" | "ZVDX" => self.vignetting(keyword, 0, rest)?,
            "VDYN" | "ZVDY" => self.vignetting(keyword, 1, rest)?,
            "VCXN" | "ZVCX" => self.vignetting(keyword, 2, rest)?,
            "VCYN" | "ZVCY" => self.vignetting(keyword, 3, rest)?,
            "WAVM" => self.wave(rest)?,
            "WAVL" => self.old_waves = numbers(keyword, rest)?,
            "WWGT" => self.old_weights = numbers(keyword, rest)?,
            "PWAV" => self.primary = Some(count(rest, 0, keyword)?),
            "GCAT" => self.makers = rest.iter().map(|m| m.to_ascii_lowercase()).collect(),
            "SURF" => {
                let index = count(rest, 0, keyword)?;
                if index != self.surfaces.len() {
                    return Err(Error::input(format!(
                        "surface {index} follows {} surfaces",
                        self.surfaces.len()
                    ))
                    .help("surfaces count up from 0; is a part of the file missing?"));
                }
                let kind = "STANDARD".to_owned();
                let thickness = f64::INFINITY;
                self.surfaces.push(Draft { line, kind, thickness, ..Draft::default() });
            }
            "AFOC" => return refuse("an afocal system"),
            "VANN" if numbers(keyword, rest)?.iter().any(|deg| *deg != 0.0) => {
                return refuse("a vignetted pupil that is turned (VANN)");
            }
            "MNUM" => self.configurations.number(rest)?,
            "RAIM" if rest.get(1) == Some(&"0") => self.notes.push(format!(
                "line {line}: ray aiming is off in the file (RAIM), so that its program fills the \
                 paraxial entrance pupil; rays are aimed at the real stop, and figures of wide \
                 fields differ"
            )),
            "GFAC" if value(rest, 0, keyword)? != 0.0 => self.notes.push(format!(
                "line {line}: GFAC is ignored: the pupil is taken as evenly bright"
            )),
            "ENVD" if rest.len() > 2 && rest[2] == "1" => self.notes.push(format!(
                "line {line}: temperature and pressure are ignored; indices are those at 20 °C"
            )),
            _ => {
                let begun = self.configurations.have_begun();
                if !begun && !known::harmless_of_system(keyword, rest) {
                    match self.surfaces.is_empty() {
                        true => self.unknown(keyword, "of the system", line),
                        false => self.doubtful.push((line, keyword.to_owned())),
                    }
                }
                self.configurations.line(keyword, rest, line);
            }
        }
        Ok(())
    }

    /// Decentre or compression of the pupil at each field; the older form (ZVDX) counts where the
    /// newer (VDXN) is not there.
    fn vignetting(&mut self, keyword: &str, i: usize, rest: &[&str]) -> Result<()> {
        if !keyword.starts_with('Z') || self.vignetting[i].is_empty() {
            self.vignetting[i] = numbers(keyword, rest)?;
        }
        Ok(())
    }

    /// Notes a keyword of which nothing is known, once.
    fn unknown(&mut self, keyword: &str, whose: &str, line: usize) {
        let note = format!("{keyword} {whose} is not known, and not used");
        if !self.notes.iter().any(|told| told.ends_with(&note)) {
            self.notes.push(format!("line {line}: {note}"));
        }
    }
}

impl Draft {
    /// Reads a line; whether anything is known of its keyword.
    fn keyword(&mut self, keyword: &str, rest: &[&str], line: usize) -> Result<bool> {
        match keyword {
            "TYPE" => self.kind = word(rest, 0, keyword)?.to_owned(),
            "CURV" => self.curvature = value(rest, 0, keyword)?,
            "CONI" => self.conic = value(rest, 0, keyword)?,
            "DISZ" => {
                self.thickness = match word(rest, 0, keyword)? {
                    "INFINITY" => f64::INFINITY,
                    _ => value(rest, 0, keyword)?,
                };
            }
            "PARM" => place(&mut self.parameters, rest, keyword)?,
            "XDAT" => place(&mut self.extra, rest, keyword)?,
            "GLAS" => self.glass = Some((line, rest.iter().map(|w| (*w).to_owned()).collect())),
            "DIAM" | "MEMA" if self.diameter.is_none() || keyword == "DIAM" => {
                let fixed = keyword == "DIAM" && rest.get(1) == Some(&"1");
                self.diameter = Some((value(rest, 0, keyword)?, fixed));
            }
            "FLAP" | "CLAP" => {
                self.clear = true;
                let radii = (value(rest, 0, keyword)?, value(rest, 1, keyword)?);
                self.clips.push(Clip::ring(radii.0, radii.1));
            }
            "OBSC" => {
                let (inner, outer) = (value(rest, 0, keyword)?, value(rest, 1, keyword)?);
                if inner > 0.0 {
                    return Err(Error::unsupported("a ring-shaped obscuration cannot be traced")
                        .help("only obscurations that start at the axis are supported"));
                }
                self.clips.push(Clip::ring(outer, f64::INFINITY));
            }
            "SQAP" | "ELAP" | "SQOB" | "ELOB" => {
                let half = [value(rest, 0, keyword)?, value(rest, 1, keyword)?];
                let square = keyword.starts_with("SQ");
                let shape = if square { Shape::Rectangle } else { Shape::Ellipse };
                let (opening, clear) = (Clip::opening(shape, half), keyword.ends_with("AP"));
                self.clear |= clear;
                self.clips.push(if clear { opening } else { opening.obstacle() });
            }
            "SPID" | "UDAP" | "UDOB" => {
                let what = format!("a spider or an aperture drawn by its corners ({keyword})");
                return Err(Error::unsupported(what)
                    .help("give circles, ellipses and rectangles, or leave it out"));
            }
            "OBDC" => self.centre = [value(rest, 0, keyword)?, value(rest, 1, keyword)?],
            "SCBD"
                if rest.len() > 3 && numbers(keyword, &rest[3..])?.iter().any(|v| *v != 0.0) =>
            {
                refuse("a tilt or decentre among a surface's properties (SCBD)")?;
            }
            "STOP" => self.stop = true,
            "COAT" => self.coated = !rest.is_empty(),
            "IGNR" if numbers(keyword, rest)?.iter().any(|ignored| *ignored != 0.0) => {
                refuse("a surface that its program leaves out (IGNR)")?;
            }
            _ => return Ok(known::harmless_of_surface(keyword, rest)),
        }
        Ok(true)
    }

    fn surface(
        &self,
        scale: f64,
        glasses: &Glasses<'_>,
        notes: &mut Vec<String>,
    ) -> Result<Surface> {
        let thickness = self.thickness;
        if thickness.abs() >= INFINITE {
            return Err(Error::input("infinite thickness behind a surface of the lens")
                .help("only the object may be at infinity"));
        }
        let centre = self.centre.map(|v| v * scale);
        let mut surface = Surface {
            curvature: self.curvature / scale,
            conic: self.conic,
            clips: self.clips.iter().map(|clip| clip.placed(scale, centre)).collect(),
            ..Surface::plane(thickness * scale)
        };
        self.shape(&mut surface, scale)?;
        notes.extend(self.unread().map(|what| format!("line {}: {what}", self.line)));
        // A coordinate break stays in the medium in front of it, whatever its line says.
        if surface.form == Form::Break {
            return Ok(surface);
        }
        if let Some((line, words)) = &self.glass {
            surface.medium = material::medium(words, glasses, notes)
                .map_err(|e| e.at(format!("line {line}")))?;
        }
        Ok(surface)
    }
}

/// The glass that the object lies in, if it is not air.
fn object_glass(
    draft: &Draft,
    glasses: &Glasses<'_>,
    notes: &mut Vec<String>,
) -> Result<Option<Glass>> {
    let Some((line, words)) = &draft.glass else { return Ok(None) };
    let at = |e: Error| e.at(format!("line {line}"));
    match material::medium(words, glasses, notes).map_err(at)? {
        Medium::Air => Ok(None),
        Medium::Glass(glass) => Ok(Some(glass)),
        Medium::Mirror => {
            Err(at(Error::input("the object is a mirror").help("give the first mirror a surface")))
        }
    }
}

/// `PARM i v`, `XDAT i v`: puts v at place i, counted from 1.
fn place(values: &mut Vec<f64>, rest: &[&str], keyword: &str) -> Result<()> {
    let slot = count(rest, 0, keyword)?;
    if slot == 0 {
        return Ok(());
    }
    if values.len() < slot {
        values.resize(slot, 0.0);
    }
    values[slot - 1] = value(rest, 1, keyword)?;
    Ok(())
}

impl File {
    fn finish(mut self, glasses: &Catalogue, configuration: Option<&str>) -> Result<Prescription> {
        if self.surfaces.len() < 3 {
            return Err(Error::input(format!("{} surfaces", self.surfaces.len())).help(
                "a lens file has at least an object, one surface and an image: is it complete?",
            ));
        }
        let scale = self.scale.unwrap_or_else(|| {
            self.notes
                .push("the file does not say its unit (UNIT): millimetres are assumed".into());
            1.0
        });
        std::mem::take(&mut self.configurations).apply(configuration, &mut self)?;
        let drafts = std::mem::take(&mut self.surfaces);
        let image = drafts.len() - 1;
        let lens = &drafts[1..image];
        let object = match drafts[0].thickness {
            d if d.abs() >= INFINITE => Object::Infinity,
            d => Object::Distance(d * scale),
        };
        let behind = drafts[image].thickness;
        if behind != 0.0 && behind.is_finite() {
            return Err(Error::input(format!("the last surface is followed by {behind}"))
                .at(format!("surface {image} (line {})", drafts[image].line))
                .help("the last surface is the image, with DISZ 0: is the file cut short?"));
        }
        for end in [&drafts[0], &drafts[image]] {
            if end.kind != "STANDARD" && end.parameters.iter().any(|v| *v != 0.0) {
                return Err(Error::unsupported(format!(
                    "object or image is of type {}",
                    end.kind
                ))
                .at(format!("line {}", end.line))
                .help("object and image are flat; tilt them by a coordinate break before"));
            }
        }
        if drafts[0].curvature != 0.0 && object != Object::Infinity {
            return Err(Error::unsupported("the object surface is curved")
                .at(format!("line {}", drafts[0].line))
                .help("only flat objects are traced"));
        }
        if drafts[image].curvature != 0.0 {
            return Err(Error::unsupported("the image surface is curved")
                .at(format!("line {}", drafts[image].line))
                .help("sensors are flat: set its curvature to 0"));
        }
        let (waves, wavelength_weights) = self.wavelengths()?;
        let reference_nm = self.reference(&waves)?;
        let glasses = Glasses { catalogue: glasses, makers: &self.makers, wavelengths_nm: &waves };
        let object_glass = object_glass(&drafts[0], &glasses, &mut self.notes)?;
        let mut surfaces = Vec::with_capacity(lens.len());
        let mut open = object_glass.is_none();
        let mut drawn = Vec::new();
        for (i, draft) in lens.iter().enumerate() {
            let mut surface = draft
                .surface(scale, &glasses, &mut self.notes)
                .map_err(|e| e.at(format!("surface {} (line {})", i + 1, draft.line)))?;
            // A fixed semi-diameter of a refracting surface is an aperture too (the program makes
            // it a "floating" one); a plane in air with one is only drawn so.
            let refracts = !(open && surface.medium == Medium::Air) && surface.form != Form::Break;
            // Behind a mirror lies the medium in front of it.
            if surface.form != Form::Break && surface.medium != Medium::Mirror {
                open = surface.medium == Medium::Air;
            }
            if let (false, Some((radius, true))) = (draft.clear, draft.diameter)
                && radius > 0.0
            {
                match refracts {
                    true => surface.clips.push(Clip::circle(radius * scale)),
                    false if !draft.stop => drawn.push((i + 1).to_string()),
                    false => {}
                }
            }
            surfaces.push(surface);
        }
        if !drawn.is_empty() {
            self.notes.push(format!(
                "fixed semi-diameters of planes in air cut no light, as in their program (surface \
                 {}): give baffles an aperture (FLAP)",
                drawn.join(", ")
            ));
        }
        if drafts.iter().any(|draft| draft.coated) {
            let note = "coatings (COAT) are not traced: surfaces pass all light";
            self.notes.push(note.into());
        }
        if let [_, second, ..] = drafts.iter().filter(|d| d.stop).collect::<Vec<_>>()[..] {
            return Err(Error::input("a second surface is the stop")
                .at(format!("line {}", second.line))
                .help("mark one surface with STOP"));
        }
        let Some(stop) = lens.iter().position(|d| d.stop) else {
            return Err(Error::input("no surface is the stop")
                .help("mark one with STOP (not the object or the image)"));
        };
        let aperture = self.aperture(scale, &lens[stop])?;
        let fields = self.fields(scale)?;
        let prescription = Prescription {
            name: self.name,
            surfaces,
            stop,
            object,
            object_glass,
            aperture,
            telecentric: self.telecentric,
            wavelengths_nm: waves,
            wavelength_weights,
            reference_nm,
            fields,
            notes: self.notes,
        };
        prescription.validate()?;
        Ok(prescription)
    }

    fn aperture(&self, scale: f64, stop: &Draft) -> Result<Aperture> {
        let Some((line, words)) = &self.aperture else {
            return Err(Error::input("no aperture").help("ENPD, FNUM, OBNA or FLOA gives one"));
        };
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let read = || {
            let flag = if words.len() > 2 { count(&words, 2, words[0])? } else { 0 };
            Ok(match words[0] {
                "ENPD" => Aperture::EntrancePupil(value(&words, 1, "ENPD")? * scale),
                "OBNA" if flag == 0 => Aperture::ObjectNa(value(&words, 1, "OBNA")?),
                "FNUM" if flag == 0 => Aperture::FNumber(value(&words, 1, "FNUM")?),
                "FNUM" if flag == 1 => Aperture::WorkingFNumber(value(&words, 1, "FNUM")?),
                "OBNA" | "FNUM" => {
                    return Err(Error::unsupported(format!(
                        "an aperture of another kind ({})",
                        words.join(" ")
                    ))
                    .help(
                        "the flag of OBNA is 0 for a numerical aperture (1 is taken for a cone \
                         angle), that of FNUM 0 or 1; state the aperture in another way",
                    ));
                }
                _ => match stop.diameter {
                    Some((radius, _)) => Aperture::StopRadius(radius * scale),
                    None => {
                        return Err(Error::input("the stop fixes the aperture but has no DIAM")
                            .help("give the stop surface a semi-diameter"));
                    }
                },
            })
        };
        read().map_err(|e| e.at(format!("line {line}")))
    }
}
