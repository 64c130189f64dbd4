//! What a file says about its samples, and the one-line note that carries it in formats that have
//! no fields for it (TIFF, PNG, PGM, FITS).

use super::{DngInfo, Taken};
use camrig_base::{Cfa, Dn, RawFrame};

/// What is known about the samples of a file; `None` where the file does not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts<S = u16> {
    /// Bits per sample.
    pub bits: Option<u32>,
    /// Colour filter pattern.
    pub cfa: Option<Cfa>,
    /// Black level: mean of no light, DN.
    pub black_level_dn: Option<f64>,
    /// White level: value at which a sample saturates, DN.
    pub white_level_dn: Option<S>,
    /// Camera, exposure and colour, where the file is a DNG.
    pub dng: Option<DngInfo>,
    /// How the frames were taken, where the file says it in a form that is read.
    pub taken: Taken,
    /// Remarks of the reader for a person: what it took for granted, and what it did not apply.
    pub notes: Vec<String>,
}

impl<S: Dn> Facts<S> {
    /// The facts of a raw frame.
    pub fn of(frame: &RawFrame<S>) -> Self {
        Self {
            bits: Some(frame.bits),
            cfa: Some(frame.cfa.clone()),
            black_level_dn: Some(frame.black_level_dn),
            white_level_dn: Some(frame.white_level_dn),
            ..Self::default()
        }
    }

    /// The black levels by place of the pattern, DN, where a DNG has others at other places.
    #[must_use]
    pub fn black_levels_that_differ(&self) -> Option<&[f64]> {
        let levels = &self.dng.as_ref()?.black_levels_dn[..];
        levels.iter().any(|level| *level != levels[0]).then_some(levels)
    }

    /// The note `camrig bits=10 cfa=GRBG black=42 white=1023 exposure=0.02 iso=100`, without facts
    /// that are not known.
    pub(super) fn note(&self) -> String {
        let mut text = String::from("camrig");
        let mut add = |key: &str, value: Option<String>| {
            if let Some(value) = value {
                text.push_str(&format!(" {key}={value}"));
            }
        };
        add("bits", self.bits.map(|v| v.to_string()));
        add("cfa", self.cfa.as_ref().map(Cfa::to_string));
        add("black", self.black_level_dn.map(|v| v.to_string()));
        add("white", self.white_level_dn.map(|v| v.to_string()));
        add("exposure", self.exposure_to_say().map(|v| v.to_string()));
        add("iso", self.iso_to_say().map(|v| v.to_string()));
        text
    }

    /// Takes over the facts of a note. Notes of other programs are ignored, malformed values are
    /// taken as not known.
    pub(super) fn merge_note(&mut self, note: &str) {
        let mut words = note.split_ascii_whitespace();
        if words.next() != Some("camrig") {
            return;
        }
        for (key, value) in words.filter_map(|w| w.split_once('=')) {
            match key {
                "bits" => {
                    let bits = value.parse().ok().filter(|b| (1..=S::MAX_BITS).contains(b));
                    self.taken.noted |= bits.is_some();
                    self.bits = bits.or(self.bits.take());
                }
                "cfa" => self.cfa = Cfa::parse(value).ok(),
                "black" => {
                    self.black_level_dn = value.parse().ok().filter(|v: &f64| v.is_finite());
                }
                "white" => self.white_level_dn = value.parse().ok(),
                _ => self.taken.take_word(key, value),
            }
        }
    }
}
