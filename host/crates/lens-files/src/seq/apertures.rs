//! Apertures and obscurations of a surface: `CIR`, `REX` to `ELY`, and where they lie (`ADX`,
//! `ADY`). Several on one surface are distinguished by their kind (`CLR`, `OBS`) and label
//! (`L'A'`).

use super::lexer::{Kind, Word};
use super::{first, no_more};
use camrig_base::{Error, Result};
use camrig_prescription::{Clip, Shape};

/// Commands of apertures; with `EDG` they say where the glass ends, not what light passes.
const COMMANDS: &[&str] = &["CIR", "REX", "REY", "ELX", "ELY", "ADX", "ADY"];

/// Whether a command is about apertures.
pub(super) fn is_about(keyword: &str) -> bool {
    COMMANDS.contains(&keyword)
}

/// Whether a command of apertures is about the edge or the hole of the glass.
pub(super) fn is_of_edge(words: &[Word]) -> bool {
    ["EDG", "HOL"].contains(&&kind(words)[..])
}

/// The word of an aperture command that says what it is, labels aside.
fn kind(words: &[Word]) -> String {
    let word = words.iter().find(|w| w.kind != Kind::Label);
    word.map(|w| w.text.to_ascii_uppercase()).unwrap_or_default()
}

/// The apertures of one surface as far as they are read.
#[derive(Default)]
pub(super) struct Apertures {
    openings: Vec<Opening>,
    centres: Vec<Centre>,
}

/// An aperture or an obscuration.
struct Opening {
    /// The start of its command: `CI`, `RE` or `EL`.
    form: String,
    obstacle: bool,
    label: String,
    /// Half of its widths in x and y; a circle has one, and others none in y until it is given.
    half: [f64; 2],
}

impl Opening {
    fn clip(&self) -> Clip {
        let clip = match self.form.as_str() {
            "CI" => Clip::circle(self.half[0]),
            "RE" => Clip::opening(Shape::Rectangle, self.half),
            _ => Clip::opening(Shape::Ellipse, self.half),
        };
        if self.obstacle { clip.obstacle() } else { clip }
    }
}

/// `ADX` or `ADY`. It may stand before what it moves, so it is resolved at the end.
struct Centre {
    /// As it is written.
    text: String,
    axis: usize,
    /// Whether an obscuration is meant; `None` where only a label says what is.
    obstacle: Option<bool>,
    label: String,
    value: f64,
}

impl Apertures {
    /// `CIR [CLR|OBS] [L'NAME'] radius`: an opening, or an obstacle; likewise half of the width in
    /// x of a rectangle (`REX`) or an ellipse (`ELX`), which `REY` and `ELY` of the same kind and
    /// label complete, and the centre in x (`ADX`) and y (`ADY`). A second value of the same
    /// command, kind and label (another zoom position) takes the place of the first.
    pub(super) fn set(&mut self, keyword: &str, words: &[Word]) -> Result<()> {
        let (labels, rest): (Vec<Word>, Vec<Word>) =
            words.iter().cloned().partition(|w| w.kind == Kind::Label);
        let label = labels.first().map(|w| w.text.to_ascii_uppercase()).unwrap_or_default();
        let kind = kind(words);
        let named = ["OBS", "CLR"].contains(&&kind[..]);
        let used = usize::from(named);
        let value = first(&rest[used..], keyword)?;
        no_more(keyword, &rest, used + 1)?;
        let obstacle = kind == "OBS";
        if keyword.starts_with("AD") {
            let texts: Vec<&str> = words.iter().map(|w| w.text.as_str()).collect();
            self.centres.push(Centre {
                text: format!("{keyword} {}", texts.join(" ")),
                axis: usize::from(keyword.ends_with('Y')),
                obstacle: (named || label.is_empty()).then_some(obstacle),
                label,
                value,
            });
            return Ok(());
        }
        let form = keyword[..2].to_owned();
        let axis = usize::from(keyword.ends_with('Y'));
        let same = |o: &Opening| o.form == form && o.obstacle == obstacle && o.label == label;
        match self.openings.iter().position(same) {
            Some(known) => self.openings[known].half[axis] = value,
            None if axis == 1 => {
                return Err(Error::input(format!("{keyword} without the width in x"))
                    .help("REX stands before REY, ELX before ELY, of the same kind and label"));
            }
            None => self.openings.push(Opening { form, obstacle, label, half: [value, f64::NAN] }),
        }
        Ok(())
    }

    /// All of them where they lie, in mm; lengths in the file are `scale` mm.
    ///
    /// # Errors
    /// A centre of an aperture that is not there, or of one among several.
    pub(super) fn clips(&self, scale: f64) -> Result<Vec<Clip>> {
        let mut centres = vec![[0.0; 2]; self.openings.len()];
        for centre in &self.centres {
            let found = self.meant(centre);
            match found[..] {
                [one] => centres[one][centre.axis] = centre.value * scale,
                // Files write zeros for what is not moved.
                _ if centre.value == 0.0
                    && found.iter().all(|i| centres[*i][centre.axis] == 0.0) => {}
                _ => return Err(centre.refused(found.len())),
            }
        }
        let placed = |(o, centre): (&Opening, [f64; 2])| o.clip().placed(scale, centre);
        Ok(self.openings.iter().zip(centres).map(placed).collect())
    }

    /// Which of the openings a centre may be of. Of several without a label, one that has none
    /// itself is meant.
    fn meant(&self, centre: &Centre) -> Vec<usize> {
        let fits = |o: &Opening, label: &str| {
            centre.obstacle.is_none_or(|obstacle| o.obstacle == obstacle) && o.label == label
        };
        let all = || self.openings.iter().enumerate();
        let named: Vec<usize> =
            all().filter(|(_, o)| fits(o, &centre.label)).map(|(i, _)| i).collect();
        if !(named.is_empty() && centre.label.is_empty()) {
            return named;
        }
        all().filter(|(_, o)| fits(o, &o.label)).map(|(i, _)| i).collect()
    }
}

impl Centre {
    fn refused(&self, found: usize) -> Error {
        let what = match self.obstacle {
            Some(true) => "obscuration",
            Some(false) => "clear aperture",
            None => "aperture of that label",
        };
        let count = if found == 0 { "no".to_owned() } else { found.to_string() };
        let plural = if found > 1 { "s" } else { "" };
        Error::input(format!("{}: the surface has {count} {what}{plural}", self.text)).help(
            "ADX and ADY move the one clear aperture; after OBS the obscuration, after L'NAME' \
             what CIR, REX or ELX gave that label",
        )
    }
}
