//! What each command of a `.seq` file says about the lens.

use super::apertures;
use super::known::{Known, known};
use super::lexer::{Command, Kind, Word};
use super::zoom;
use super::{Draft, File, first, no_more, numbers};
use crate::refuse;
use camrig_base::{Error, Result};
use camrig_prescription::{Aperture, FieldKind};

/// Air of CODE V's default environment: 20 °C and 760 mm Hg, and the room temperatures that files
/// state; an index changes by some 1e-6 for each kelvin.
const ROOM_C: std::ops::RangeInclusive<f64> = 19.0..=25.0;
const PRESSURE_MM_HG: f64 = 760.0;

/// Values of all fields, or with `F2` that of one.
fn set_fields(list: &mut Vec<f64>, keyword: &str, words: &[Word]) -> Result<()> {
    let name = capitals(words, 0);
    let field = name.strip_prefix('F').and_then(|n| n.parse::<usize>().ok());
    let Some(field) = field.filter(|n| (1..=MAX_FIELDS).contains(n)) else {
        *list = numbers(keyword, words)?;
        return Ok(());
    };
    list.resize(list.len().max(field), 0.0);
    list[field - 1] = only(&words[1..], keyword)?;
    Ok(())
}

/// Most fields that a command may name: more than CODE V has.
const MAX_FIELDS: usize = 1000;

/// A word in capitals, and nothing where there is none.
fn capitals(words: &[Word], i: usize) -> String {
    words.get(i).map(|w| w.text.to_ascii_uppercase()).unwrap_or_default()
}

impl File {
    pub(super) fn command(&mut self, command: &Command) -> Result<()> {
        let Command { keyword, words, .. } = command;
        if matches!(keyword.as_str(), "TITLE" | "TIT") {
            // `TIT Z2 ...` is that of a zoom position.
            if words.first().and_then(zoom::position_of).is_none() {
                let texts: Vec<&str> = words.iter().map(|w| w.text.as_str()).collect();
                self.title = texts.join(" ");
            }
            return Ok(());
        }
        if command.open_quote && known(keyword) != Known::Harmless {
            return Err(Error::input(format!("{keyword}: a quotation mark is not closed"))
                .help("close it on the same line"));
        }
        if keyword == "ZOO" {
            return self.zoom(command);
        }
        if self.private.takes(keyword, words)? || self.of_system(keyword, words)? {
            return Ok(());
        }
        match keyword.as_str() {
            "SO" => {
                let bend = first(words, keyword)?;
                self.object = Some((bend, distance(&words[1..], "SO (thickness)")?));
                self.object_glass = words.get(2).map(|w| w.text.to_ascii_uppercase());
                no_more(keyword, words, 3)
            }
            "SI" => {
                let values = numbers(keyword, &words[..words.len().min(2)])?;
                self.image_bent = values.first().is_some_and(|v| *v != 0.0);
                self.image = Some(values.get(1).copied().unwrap_or(0.0));
                image_in_air(words)
            }
            "S" if self.image.is_some() => {
                Err(Error::input("a surface (S) behind the image (SI)")
                    .help("the image is the last surface: put SI at the end of the lens"))
            }
            "S" => {
                let draft = Draft {
                    line: command.line,
                    bend: first(words, keyword)?,
                    thickness: first(&words[1..], "S (thickness)")?,
                    glass: words.get(2).map(|w| w.text.clone()),
                    ..Draft::default()
                };
                self.surfaces.push(draft);
                no_more(keyword, words, 4)?;
                match words.get(3..).filter(|rest| !rest.is_empty()) {
                    Some(rest) => self.mode(self.surfaces.len() - 1, &rest[0].text),
                    None => Ok(()),
                }
            }
            _ => self.of_surface(command),
        }
    }

    /// Commands of the whole system; whether this is one.
    fn of_system(&mut self, keyword: &str, words: &[Word]) -> Result<bool> {
        let off = capitals(words, 0).starts_with('N');
        match keyword {
            "RDM" => self.radius_mode = Some(!off),
            "DIM" => {
                no_more(keyword, words, 1)?;
                self.scale = match capitals(words, 0).as_str() {
                    "M" | "MM" => 1.0,
                    "C" | "CM" => 10.0,
                    "I" | "IN" => 25.4,
                    other => {
                        return Err(Error::unsupported(format!("DIM {other}"))
                            .help("known are M (millimetre), C (centimetre) and I (inch)"));
                    }
                };
            }
            "EPD" => self.aperture = Some(Aperture::EntrancePupil(only(words, keyword)?)),
            "FNO" => self.aperture = Some(Aperture::WorkingFNumber(only(words, keyword)?)),
            "NA" => self.aperture = Some(Aperture::ImageNa(only(words, keyword)?)),
            "NAO" => self.aperture = Some(Aperture::ObjectNa(only(words, keyword)?)),
            "WL" => self.waves = numbers(keyword, words)?,
            "WTW" => self.weights = numbers(keyword, words)?,
            "REF" => {
                let value = only(words, keyword)?;
                if !(value.fract() == 0.0 && (1.0..=100.0).contains(&value)) {
                    return Err(Error::input(format!("REF {value}"))
                        .help("it is the number of a wavelength, from 1"));
                }
                self.reference = Some(value as usize);
            }
            "YAN" | "YOB" | "YIM" | "YRI" | "XAN" | "XOB" | "XIM" | "XRI" => {
                self.set_field(keyword, words)?;
            }
            "VUX" => set_fields(&mut self.vignetting[0], keyword, words)?,
            "VLX" => set_fields(&mut self.vignetting[1], keyword, words)?,
            "VUY" => set_fields(&mut self.vignetting[2], keyword, words)?,
            "VLY" => set_fields(&mut self.vignetting[3], keyword, words)?,
            "TEM" => {
                let celsius = numbers(keyword, words)?;
                if celsius.iter().any(|t| !ROOM_C.contains(t)) {
                    self.notes.push(format!("TEM {celsius:?} is ignored: {AT_ROOM}"));
                }
            }
            "PRE" => {
                let pressures = numbers(keyword, words)?;
                if pressures.iter().any(|p| *p != PRESSURE_MM_HG) {
                    self.notes.push(format!("PRE {pressures:?} is ignored: {AT_ROOM}"));
                }
            }
            "TEL" | "AFC" | "AFI" | "AFO" | "POL" if off => {}
            "POL" => self.notes.push("POL is passed over: polarisation is not traced".into()),
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Fields in x or y; both are of one kind, whatever those are of which all values are 0.
    fn set_field(&mut self, keyword: &str, words: &[Word]) -> Result<()> {
        let kind = kind_of(keyword);
        let axis = usize::from(keyword.starts_with('Y'));
        let (known, lists) = self.fields.get_or_insert_with(|| (kind, Default::default()));
        if *known != kind {
            lists[axis].clear();
        }
        set_fields(&mut lists[axis], keyword, words)?;
        let on_axis = |list: &[f64]| list.iter().all(|v| *v == 0.0);
        if *known != kind && !on_axis(&lists[axis]) {
            if !on_axis(&lists[1 - axis]) {
                return Err(Error::input(format!("{keyword}: fields of another kind before"))
                    .help("give x and y of all fields as angles, or as heights of one kind"));
            }
            *known = kind;
        }
        Ok(())
    }

    /// Commands that belong to a surface: the one that `S3` names, or the one above them.
    fn of_surface(&mut self, command: &Command) -> Result<()> {
        let Command { line, keyword, .. } = command;
        if let Some(solve) = solve(command) {
            self.zoom.keeps(&solve, *line);
            self.notes.push(format!(
                "line {line}: {solve} is not solved again; the value in the file is kept"
            ));
            return Ok(());
        }
        let keyword = if keyword == "STOP" { "STO" } else { keyword.as_str() };
        match known(keyword) {
            Known::Harmless | Known::Solve => return Ok(()),
            Known::Refused(what) => return refuse(&format!("{keyword} ({what})")),
            Known::Unknown => {}
        }
        let (place, words) = self.place(&command.words)?;
        let of_object = matches!(capitals(&command.words, 0).as_str(), "SO" | "S0")
            || place.is_none() && self.image.is_none();
        let decentre = match place {
            Some(index) => &mut self.surfaces[index].decentre,
            None => &mut self.image_decentre,
        };
        if decentre.takes(keyword, words)? {
            return match of_object {
                true => refuse(&format!("{keyword} (a tilt or decentre) of the object")),
                false => Ok(()),
            };
        }
        if apertures::is_about(keyword) && apertures::is_of_edge(words) {
            return Ok(());
        }
        match place {
            Some(index) if keyword == "STO" => {
                self.stop = Some(index);
                no_more(keyword, words, 0)
            }
            Some(index) => self.change(index, keyword, words),
            None if apertures::is_about(keyword) => {
                self.notes.push(format!(
                    "line {line}: {keyword} on the object or the image is passed over"
                ));
                Ok(())
            }
            None if keyword == "THI" => self.end_distance(of_object, words),
            None if keyword == "STO" => Err(Error::input("the stop is the object or the image")
                .help("it is one of the surfaces between them")),
            None if matches!(keyword, "CON" | "ASP") => Ok(()),
            None if keyword == "K" && numbers(keyword, words)?.iter().all(|v| *v == 0.0) => Ok(()),
            None => Err(unknown(keyword)
                .at("the object or the image")
                .help("it stands behind no surface of the lens")),
        }
    }

    /// `THI` of the object or the image.
    fn end_distance(&mut self, of_object: bool, words: &[Word]) -> Result<()> {
        no_more("THI", words, 1)?;
        if of_object {
            let bend = self.object.map_or(0.0, |(bend, _)| bend);
            self.object = Some((bend, distance(words, "THI")?));
        } else {
            self.image = Some(first(words, "THI")?);
        }
        Ok(())
    }

    /// The surface that a command is about (none: object, image, or no surface yet), and its words
    /// without the surface's name.
    fn place<'a>(&self, words: &'a [Word]) -> Result<(Option<usize>, &'a [Word])> {
        let above = match self.image {
            Some(_) => None,
            None => self.surfaces.len().checked_sub(1),
        };
        let name = capitals(words, 0);
        let Some(rest) = name.strip_prefix('S').filter(|_| words[0].kind == Kind::Plain) else {
            return Ok((above, words));
        };
        if matches!(rest, "O" | "I") {
            return Ok((None, &words[1..]));
        }
        match rest.parse::<usize>() {
            Ok(0) => Ok((None, &words[1..])),
            Ok(n) if n <= self.surfaces.len() => Ok((Some(n - 1), &words[1..])),
            Ok(n) if self.image.is_some() && n == self.surfaces.len() + 1 => {
                Ok((None, &words[1..]))
            }
            _ => Err(Error::input(format!("{name} is no surface so far"))
                .help(format!("surfaces up to here are S1 to S{}", self.surfaces.len()))),
        }
    }

    /// Changes surface `index`.
    fn change(&mut self, index: usize, keyword: &str, words: &[Word]) -> Result<()> {
        let radius_mode = self.radius_mode;
        let surface = &mut self.surfaces[index];
        match keyword {
            _ if apertures::is_about(keyword) => return surface.apertures.set(keyword, words),
            "GLA" | "GL1" => {
                let name = words.first().ok_or_else(|| {
                    Error::input("GLA without a glass").help("the line is cut short")
                })?;
                surface.glass = Some(name.text.clone());
            }
            "RFL" | "REFL" => surface.glass = Some("REFL".into()),
            "RMD" => return self.mode(index, &capitals(words, 0)),
            "THI" => surface.thickness = first(words, keyword)?,
            "RDY" | "CUY" => {
                let (value, radii) = (first(words, keyword)?, radius_mode == Some(true));
                surface.bend = match (keyword == "RDY") == radii || value == 0.0 {
                    true => value,
                    false => 1.0 / value,
                };
                if radius_mode.is_none() {
                    return Err(Error::input(format!("{keyword} without RDM"))
                        .help("say RDM or RDM N at the start: are surfaces given by radius?"));
                }
            }
            "CON" | "ASP" => {}
            "SPH" => surface.sphere(),
            "AAS" | "CYL" => {
                surface.across.get_or_insert_default();
            }
            "CUX" | "RDX" | "KX" => surface.across(keyword, first(words, keyword)?)?,
            "AR" | "BR" | "CR" | "DR" | "AP" | "BP" | "CP" | "DP" => {
                if surface.across.is_none() || first(words, keyword)? != 0.0 {
                    return refuse(&format!(
                        "{keyword} (polynomial terms of an anamorphic asphere)"
                    ));
                }
            }
            "K" | "KY" => surface.conic = first(words, keyword)?,
            "A" | "B" | "C" | "D" | "E" | "F" | "G" | "H" | "J" => {
                // A is the coefficient of r^4; the letter I is left out.
                let power = "ABCDEFGHJ".find(keyword).unwrap_or(0) + 2;
                surface.even.resize(surface.even.len().max(power), 0.0);
                surface.even[power - 1] = first(words, keyword)?;
            }
            "SPS" if capitals(words, 0) == "ODD" => {}
            "SPS" => {
                return refuse(&format!("a special surface (SPS {})", capitals(words, 0)));
            }
            "SCO" => return surface.special(words),
            _ => return Err(unknown(keyword)),
        }
        let taken = match keyword {
            "SPS" => words.len(),
            "CON" | "ASP" | "SPH" | "AAS" | "CYL" | "RFL" | "REFL" => 0,
            _ => 1,
        };
        no_more(keyword, words, taken)
    }

    /// `RMD`: whether a surface refracts or reflects.
    fn mode(&mut self, index: usize, mode: &str) -> Result<()> {
        match mode.to_ascii_uppercase().as_str() {
            "REFL" => self.surfaces[index].glass = Some("REFL".into()),
            "REFR" => {}
            other => return refuse(&format!("a surface with the mode {other}")),
        }
        Ok(())
    }
}

/// What is said of another temperature or pressure.
const AT_ROOM: &str = "indices are those at 20 °C in air";

fn unknown(keyword: &str) -> Error {
    Error::unsupported(format!("{keyword} is not known, and may change the image"))
        .help("remove the command if it has no effect on the image")
}

/// The value of a command that has one.
fn only(words: &[Word], keyword: &str) -> Result<f64> {
    no_more(keyword, words, 1)?;
    first(words, keyword)
}

/// The distance of the object, which may be written as infinite in words.
fn distance(words: &[Word], what: &str) -> Result<f64> {
    match capitals(words, 0).as_str() {
        "INF" | "INFINITY" => Ok(f64::INFINITY),
        _ => first(words, what),
    }
}

/// What a command solves for, if it is a solve: `PIM`, or `THI S3 HMY 0.0`, whose word stands in
/// place of a value.
fn solve(command: &Command) -> Option<String> {
    let Command { keyword, words, .. } = command;
    if known(keyword) == Known::Solve {
        return Some(keyword.clone());
    }
    if !["THI", "CUY", "CUX", "RDY", "RDX"].contains(&keyword.as_str()) {
        return None;
    }
    // The first word may name the surface.
    let word = (0..2).map(|i| capitals(words, i)).find(|word| known(word) == Known::Solve)?;
    Some(format!("{keyword} {word}"))
}

/// Refuses an image that lies in a glass.
fn image_in_air(words: &[Word]) -> Result<()> {
    no_more("SI", words, 3)?;
    match capitals(words, 2).as_str() {
        "" | "AIR" => Ok(()),
        glass => Err(Error::unsupported(format!("the image lies in {glass}"))
            .help("sensors lie in air: add the surface behind the glass")),
    }
}

fn kind_of(keyword: &str) -> FieldKind {
    match &keyword[1..] {
        "OB" => FieldKind::ObjectHeight,
        "IM" => FieldKind::ParaxialImageHeight,
        "RI" => FieldKind::RealImageHeight,
        _ => FieldKind::Angle,
    }
}

impl Draft {
    /// `CUX`, `RDX`, `KX`: curvature, radius and conic constant in x.
    fn across(&mut self, keyword: &str, value: f64) -> Result<()> {
        let Some(across) = &mut self.across else {
            return Err(Error::unsupported(format!("{keyword} without AAS or CYL"))
                .help("a surface with two curvatures is a biconic (AAS) or a cylinder (CYL)"));
        };
        match keyword {
            "KX" => across.conic = value,
            "RDX" if value != 0.0 => across.curvature = Some(1.0 / value),
            _ => across.curvature = Some(value),
        }
        Ok(())
    }

    fn sphere(&mut self) {
        self.conic = 0.0;
        self.across = None;
        self.even.clear();
        self.odd_terms.clear();
    }

    /// `SCO K v`, `SCO Ci v` of an odd polynomial: C1 is the conic constant, C2 the coefficient of
    /// r, C3 of r², ...
    fn special(&mut self, words: &[Word]) -> Result<()> {
        let name = capitals(words, 0);
        let value = first(words.get(1..).unwrap_or(&[]), "SCO")?;
        let slot = match name.as_str() {
            "K" => Some(1),
            _ => name.strip_prefix('C').and_then(|n| n.parse().ok()),
        };
        match slot {
            Some(1) => self.conic = value,
            Some(n @ 2..=60) => {
                self.odd_terms.resize(self.odd_terms.len().max(n - 1), 0.0);
                self.odd_terms[n - 2] = value;
            }
            _ => {
                return Err(
                    Error::input(format!("SCO {name}")).help("coefficients are K and C1 to C60")
                );
            }
        }
        no_more("SCO", words, 2)
    }
}
