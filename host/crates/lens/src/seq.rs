//! CODE V lens files (`.seq`).
//!
//! Read: spherical, conic and aspheric surfaces (`ASP` with K, A to J; odd polynomials `SPS ODD`),
//! mirrors, catalogue, fictitious and n_d:V_d glasses, EPD/FNO/NA/NAO, angular and height fields,
//! vignetting factors, circular apertures. Refused: tilts and decentres, other special surfaces,
//! apertures that are not circular, zoom. `RDM` says that surfaces are given by radius, `RDM N` or
//! nothing by curvature; where nothing is said and curvatures would make spheres smaller than the
//! beam, they are taken as radii, with a note.

use super::glass::Catalogue;
use super::prescription::{
    Aperture, Clip, FieldKind, Fields, Medium, Object, Prescription, Surface,
};
use super::text::{number, numbers};
use camrig_base::{Error, Result};

/// Distances that CODE V takes for infinity, in the file's unit (its own default is 1e13).
const INFINITE: f64 = 1e10;

#[derive(Default)]
struct File {
    title: String,
    radius_mode: Option<bool>,
    scale: f64,
    aperture: Option<Aperture>,
    waves: Vec<f64>,
    reference: usize,
    fields: Option<(FieldKind, Vec<f64>)>,
    fields_x: Vec<f64>,
    vignetting: [Vec<f64>; 4],
    object: Option<(f64, f64)>,
    surfaces: Vec<Draft>,
    image: Option<f64>,
    image_bent: bool,
    stop: Option<usize>,
    notes: Vec<String>,
}

#[derive(Default)]
struct Draft {
    line: usize,
    bend: f64,
    thickness: f64,
    glass: Option<String>,
    conic: f64,
    even: Vec<f64>,
    odd_terms: Vec<f64>,
    clips: Vec<Clip>,
}

/// A prescription from the text of a `.seq` file.
///
/// # Errors
/// What is unsupported or wrong, with its line.
pub fn read(text: &str, glasses: &Catalogue) -> Result<Prescription> {
    let mut file = File { scale: 1.0, reference: 1, ..File::default() };
    for (i, line) in text.lines().enumerate() {
        for command in commands(line) {
            let words: Vec<&str> = command.split_whitespace().collect();
            let Some((keyword, rest)) = words.split_first() else { continue };
            file.command(&keyword.to_ascii_uppercase(), rest, command, i + 1)
                .map_err(|e| e.at(format!("line {}", i + 1)))?;
        }
    }
    file.finish(glasses)
}

/// The commands of a line: without its comment, split at semicolons, both outside quotes.
fn commands(line: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    let (mut start, mut quote) = (0, None);
    for (i, c) in line.char_indices() {
        match (quote, c) {
            (Some(q), c) if c == q => quote = None,
            (Some(_), _) => {}
            (None, '\'' | '"') => quote = Some(c),
            (None, ';' | '!') => {
                parts.push(&line[start..i]);
                start = i + 1;
                if c == '!' {
                    return parts;
                }
            }
            _ => {}
        }
    }
    parts.push(&line[start..]);
    parts
}

fn first(rest: &[&str], keyword: &str) -> Result<f64> {
    let word = rest.first().ok_or_else(|| {
        Error::input(format!("{keyword} has no value")).help("the line is cut short")
    })?;
    number(keyword, word)
}

fn refuse(what: &str) -> Result<()> {
    Err(Error::unsupported(format!("{what} cannot be traced"))
        .help("only lenses that are rotationally symmetric about one axis are supported"))
}

impl File {
    fn command(&mut self, keyword: &str, rest: &[&str], text: &str, line: usize) -> Result<()> {
        match keyword {
            "RDM" => {
                let no = rest.first().is_some_and(|w| w.to_ascii_uppercase().starts_with('N'));
                self.radius_mode = Some(!no);
            }
            "TITLE" | "TIT" => {
                let title = text.trim()[keyword.len()..].trim();
                self.title = title.trim_matches(['\'', '"']).to_owned();
            }
            "DIM" => {
                self.scale = match rest.first().map(|w| w.to_ascii_uppercase()).as_deref() {
                    Some("M") => 1.0,
                    Some("C") => 10.0,
                    Some("I") => 25.4,
                    other => {
                        return Err(Error::unsupported(format!("DIM {}", other.unwrap_or("")))
                            .help("known are M (millimetre), C (centimetre) and I (inch)"));
                    }
                };
            }
            "EPD" => self.aperture = Some(Aperture::EntrancePupil(first(rest, keyword)?)),
            "FNO" => self.aperture = Some(Aperture::WorkingFNumber(first(rest, keyword)?)),
            "NA" => self.aperture = Some(Aperture::ImageNa(first(rest, keyword)?)),
            "NAO" => self.aperture = Some(Aperture::ObjectNa(first(rest, keyword)?)),
            "WL" => self.waves = numbers(keyword, rest)?,
            "REF" => {
                let value = first(rest, keyword)?;
                if !(value.fract() == 0.0 && (1.0..=100.0).contains(&value)) {
                    return Err(Error::input(format!("REF {value}"))
                        .help("it is the number of a wavelength, from 1"));
                }
                self.reference = value as usize;
            }
            "YAN" | "YOB" | "YIM" | "YRI" => {
                self.fields = Some((kind_of(keyword), numbers(keyword, rest)?));
            }
            "XAN" | "XOB" | "XIM" | "XRI" => {
                self.fields_x = numbers(keyword, rest)?;
                if self.fields.is_none() && self.fields_x.iter().any(|v| *v != 0.0) {
                    self.fields = Some((kind_of(keyword), vec![0.0; self.fields_x.len()]));
                }
            }
            "VUX" => self.vignetting[0] = numbers(keyword, rest)?,
            "VLX" => self.vignetting[1] = numbers(keyword, rest)?,
            "VUY" => self.vignetting[2] = numbers(keyword, rest)?,
            "VLY" => self.vignetting[3] = numbers(keyword, rest)?,
            "SO" => {
                let bend = first(rest, keyword)?;
                self.object = Some((bend, first(&rest[1..], "SO (thickness)")?));
            }
            "SI" => {
                let values = numbers(keyword, rest)?;
                self.image_bent = values.first().is_some_and(|v| *v != 0.0);
                self.image = Some(values.get(1).copied().unwrap_or(0.0));
            }
            "S" => self.surfaces.push(Draft {
                line,
                bend: first(rest, keyword)?,
                thickness: first(&rest[1..], "S (thickness)")?,
                glass: rest.get(2).map(|name| (*name).to_owned()),
                ..Draft::default()
            }),
            "ZOO" => return refuse("a zoom system"),
            "AFC" | "AFI" => return refuse("an afocal system"),
            "XDE" | "YDE" | "ZDE" | "ADE" | "BDE" | "CDE" => {
                if numbers(keyword, &rest[..rest.len().min(1)])?.iter().any(|v| *v != 0.0) {
                    return refuse("a tilt or decentre");
                }
            }
            "DAR" | "BEN" | "REV" | "RET" | "GRT" | "DIF" | "TOR" | "CYL" | "GRI" => {
                return refuse(&format!("a surface with {keyword}"));
            }
            _ => return self.of_surface(keyword, rest, line),
        }
        Ok(())
    }

    /// Commands that belong to the surface above them.
    fn of_surface(&mut self, keyword: &str, rest: &[&str], line: usize) -> Result<()> {
        let after_image = self.image.is_some();
        let number_of_surface = self.surfaces.len();
        let Some(surface) = self.surfaces.last_mut().filter(|_| !after_image) else {
            if !ADMINISTRATIVE.contains(&keyword) {
                self.notes.push(format!("line {line}: {keyword} is passed over"));
            }
            return Ok(());
        };
        match keyword {
            "STO" => self.stop = Some(number_of_surface - 1),
            "CIR" => {
                // `CIR EDG`: where the glass ends, not what light passes; `CIR OBS`: an obstacle.
                match rest.first().map(|w| w.to_ascii_uppercase()).as_deref() {
                    Some("EDG" | "HOL") => {}
                    Some("OBS") => {
                        let inner = first(&rest[1..], "CIR OBS")?;
                        surface.clips.push(Clip { inner, outer: f64::INFINITY });
                    }
                    Some("CLR") => surface.clips.push(Clip::circle(first(&rest[1..], "CIR CLR")?)),
                    _ => surface.clips.push(Clip::circle(first(rest, keyword)?)),
                }
            }
            "REX" | "REY" | "ELX" | "ELY" => return refuse("an aperture that is not circular"),
            "GLA" | "GL1" => surface.glass = rest.first().map(|name| (*name).to_owned()),
            "RFL" | "REFL" => surface.glass = Some("REFL".into()),
            "THI" => surface.thickness = first(rest, keyword)?,
            "CON" | "ASP" => {}
            "K" => surface.conic = first(rest, keyword)?,
            "A" | "B" | "C" | "D" | "E" | "F" | "G" | "H" | "J" => {
                // A is the coefficient of r^4; the letter I is left out.
                let power = "ABCDEFGHJ".find(keyword).unwrap_or(0) + 2;
                surface.even.resize(surface.even.len().max(power), 0.0);
                surface.even[power - 1] = first(rest, keyword)?;
            }
            "SPS" if rest.first().is_some_and(|w| w.eq_ignore_ascii_case("ODD")) => {}
            "SPS" => return refuse(&format!("a special surface SPS {}", rest.join(" "))),
            // Odd polynomial: C1 is the conic constant, C2 the coefficient of r, C3 of r², ...
            "SCO" => {
                let name = rest.first().map(|w| w.to_ascii_uppercase()).unwrap_or_default();
                let value = first(rest.get(1..).unwrap_or(&[]), "SCO")?;
                let slot = if name == "K" {
                    Some(1)
                } else {
                    name.strip_prefix('C').and_then(|n| n.parse().ok())
                };
                match slot {
                    Some(1) => surface.conic = value,
                    Some(n @ 2..=60) => {
                        surface.odd_terms.resize(surface.odd_terms.len().max(n - 1), 0.0);
                        surface.odd_terms[n - 2] = value;
                    }
                    _ => {
                        return Err(Error::input(format!("SCO {name}"))
                            .help("coefficients are K and C1 to C60"));
                    }
                }
            }
            _ if ADMINISTRATIVE.contains(&keyword) => {}
            _ => self.notes.push(format!("line {line}: {keyword} is passed over")),
        }
        Ok(())
    }
}

/// Commands that do not concern the path of light: labels, weights, solves, tolerances, buffers.
const ADMINISTRATIVE: &[&str] = &[
    "LEN", "INI", "WTW", "WTF", "WTX", "WTY", "TEM", "PRE", "SLB", "CCY", "THC", "GLC", "KC",
    "AC", "BC", "CC", "DC", "EC", "FC", "GC", "HC", "JC", "SCC", "PIM", "CUM", "DER", "GO", "CA",
    "DDM", "RAT", "PFR", "PTP", "POR", "RMD", "CIN", "SPT", "MFL", "COM", "TCE", "UID", "SAV",
    "OUT", "STP", "IC", "CUF",
];

fn kind_of(keyword: &str) -> FieldKind {
    match &keyword[1..] {
        "OB" => FieldKind::ObjectHeight,
        "IM" => FieldKind::ParaxialImageHeight,
        "RI" => FieldKind::RealImageHeight,
        _ => FieldKind::Angle,
    }
}

impl File {
    fn finish(mut self, glasses: &Catalogue) -> Result<Prescription> {
        let Some((object_bend, object)) = self.object else {
            return Err(
                Error::input("no object (SO)").help("is this a CODE V lens file, and complete?")
            );
        };
        let Some(defocus) = self.image else {
            return Err(
                Error::input("no image (SI)").help("the file ends before its last surface")
            );
        };
        if self.image_bent {
            return Err(Error::unsupported("the image surface is curved").help("sensors are flat"));
        }
        if object_bend != 0.0 && object.abs() < INFINITE {
            return Err(Error::unsupported("the object surface is curved")
                .help("only flat objects are traced"));
        }
        let stop = self.stop.unwrap_or_else(|| {
            self.notes
                .push("STO is not given: the first surface is the stop, as in CODE V".into());
            0
        });
        let Some(aperture) = self.aperture else {
            return Err(Error::input("no aperture").help("EPD, FNO, NA or NAO gives one"));
        };
        let scale = self.scale;
        let finite = object.abs() < INFINITE;
        let aperture = match aperture {
            Aperture::EntrancePupil(d) => Aperture::EntrancePupil(d * scale),
            // With the object at infinity the f-number is EFL/EPD.
            Aperture::WorkingFNumber(n) if !finite => Aperture::FNumber(n),
            other => other,
        };
        let radius_mode = self.radius_mode();
        let last = self.surfaces.len().saturating_sub(1);
        let mut surfaces = Vec::with_capacity(self.surfaces.len());
        for (i, draft) in self.surfaces.iter().enumerate() {
            let mut surface = draft
                .surface(radius_mode, scale, glasses)
                .map_err(|e| e.at(format!("surface {} (line {})", i + 1, draft.line)))?;
            if i == last {
                surface.thickness += defocus * scale;
            }
            surfaces.push(surface);
        }
        let Some(&reference_nm) = self.waves.get(self.reference - 1) else {
            return Err(Error::input(format!(
                "reference wavelength {} of {}",
                self.reference,
                self.waves.len()
            ))
            .help("REF names one of the values of WL"));
        };
        let (kind, y) = self.fields.take().unwrap_or((FieldKind::Angle, vec![0.0]));
        let unit = if kind == FieldKind::Angle { 1.0 } else { scale };
        let at = |list: &[f64], i: usize| list.get(i).copied().unwrap_or(0.0);
        let values: Vec<f64> = (0..y.len())
            .map(|i| (at(&self.fields_x, i).powi(2) + y[i].powi(2)).sqrt() * unit)
            .collect();
        let any = self.vignetting.iter().flatten().any(|v| *v != 0.0);
        let vignetting = match any {
            true => {
                (0..y.len()).map(|i| [0, 1, 2, 3].map(|k| at(&self.vignetting[k], i))).collect()
            }
            false => Vec::new(),
        };
        let prescription = Prescription {
            name: self.title,
            surfaces,
            stop,
            object: if finite { Object::Distance(object * scale) } else { Object::Infinity },
            aperture,
            wavelengths_nm: self.waves,
            reference_nm,
            fields: Fields { kind, values, vignetting },
            notes: self.notes,
        };
        prescription.validate()?;
        Ok(prescription)
    }

    /// Whether surfaces are given by radius.
    fn radius_mode(&mut self) -> bool {
        if let Some(mode) = self.radius_mode {
            return mode;
        }
        let beam = match self.aperture {
            Some(Aperture::EntrancePupil(d)) => d,
            _ => 0.0,
        };
        let impossible = self.surfaces.iter().any(|s| s.bend.abs() * beam > 2.0);
        self.notes.push(match impossible {
            true => {
                "RDM is not given: taken as radii, since as curvatures the beam would miss".into()
            }
            false => "RDM is not given: surfaces are taken by curvature, as CODE V does".into(),
        });
        impossible
    }
}

impl Draft {
    fn surface(&self, radius_mode: bool, scale: f64, glasses: &Catalogue) -> Result<Surface> {
        let curvature = match (radius_mode, self.bend) {
            (false, c) => c / scale,
            (true, 0.0) => 0.0,
            (true, r) => 1.0 / (r * scale),
        };
        let in_mm = |a: f64, power: usize| a * scale / scale.powi(power as i32);
        let mut even: Vec<f64> =
            self.even.iter().enumerate().map(|(i, a)| in_mm(*a, 2 * i + 2)).collect();
        let mut odd = Vec::new();
        for (i, a) in self.odd_terms.iter().enumerate() {
            let a = in_mm(*a, i + 1);
            if i % 2 == 0 {
                odd.push(a);
            } else {
                even.resize(even.len().max(i / 2 + 1), 0.0);
                even[i / 2] += a;
            }
        }
        let medium = match self.glass.as_deref() {
            None => Medium::Air,
            Some(name) if name.eq_ignore_ascii_case("AIR") => Medium::Air,
            Some(name) if name.to_ascii_uppercase().starts_with("REFL") => Medium::Mirror,
            Some(name) => Medium::Glass(glasses.find(name, &[])?),
        };
        let clips =
            self.clips.iter().map(|c| Clip { inner: c.inner * scale, outer: c.outer * scale });
        Ok(Surface {
            curvature,
            conic: self.conic,
            even,
            odd,
            thickness: self.thickness * scale,
            medium,
            clips: clips.collect(),
        })
    }
}
