//! What the frames of a set have in common.

use super::file::Seen;
use super::stacks::Stack;
use super::{Based, Known};
use crate::Role;
use camrig_base::Cfa;
use camrig_base::toml_text::seven_figures;
use std::fmt::Display;

/// Difference of the four places in 2 x 2 pixels over the signal, below which they have one
/// filter: a quarter of a million samples agree to less than a tenth of it.
const ONE_FILTER: f64 = 0.01;
/// Bits of a word, which containers say whatever the samples have.
const WORD: u32 = 16;

/// The `[sensor]` of a manifest.
#[derive(Clone, Debug)]
pub struct Sensor {
    /// Columns and rows.
    pub size: (usize, usize),
    /// Bits of a sample.
    pub bits: Based<u32>,
    /// Colour filters; without a value where no frame has light to show them.
    pub cfa: Based<Cfa>,
    /// Whether a set without `cfa` would be read wrongly.
    pub cfa_matters: bool,
    /// Mean without light, DN.
    pub black_level_dn: Based<f64>,
    /// Value at which a sample saturates, DN.
    pub white_level_dn: Based<u16>,
    /// Distance of neighbouring pixels, µm.
    pub pitch_um: Based<f64>,
}

impl Sensor {
    /// What the files have in common.
    pub fn of(seen: &[Seen], stacks: &[Stack], known: &Known) -> Self {
        let bits = bits(seen, known);
        let black = black_by_place(seen)
            .or_else(|| agreed(seen, |s| s.facts.black_level_dn))
            .or_else(|| {
                let share = seen.iter().find_map(|s| s.beside.black_share.clone())?;
                let dn = share.value * f64::from(1u32 << bits.value?);
                Some(Based::new(seven_figures(dn), share.by))
            })
            .or_else(|| Some(Based::new(known.black_level_dn?, "given")));
        let white = agreed(seen, |s| s.facts.white_level_dn)
            .or_else(|| Some(Based::new(known.white_level_dn?, "given")));
        let pitch = seen.iter().find_map(|s| s.facts.taken.pitch_um.clone()).map(Based::from);
        let (cfa, cfa_matters) = cfa(seen, stacks, known);
        Self {
            size: seen[0].size,
            bits,
            cfa,
            cfa_matters,
            black_level_dn: black
                .unwrap_or_else(|| Based::unknown("not in the files: dark frames tell")),
            white_level_dn: white.unwrap_or_else(|| {
                Based::unknown("not in the files: full scale of bits is taken")
            }),
            pitch_um: pitch.or_else(|| Some(Based::new(known.pitch_um?, "given"))).unwrap_or_else(
                || Based::unknown("not in the files: cycles/mm and photons per area need it"),
            ),
        }
    }
}

/// A black level that files give for each place of their pattern is none of the whole sensor.
fn black_by_place(seen: &[Seen]) -> Option<Based<f64>> {
    let levels = seen.iter().find_map(|s| s.facts.black_levels_that_differ())?;
    let levels: Vec<String> = levels.iter().map(f64::to_string).collect();
    Some(Based::unknown(format!(
        "the files say {} by place of the pattern: dark frames tell",
        levels.join(", ")
    )))
}

/// A value that all files say which say one; a value unknown where they contradict one another.
fn agreed<T>(seen: &[Seen], of: impl Fn(&Seen) -> Option<T>) -> Option<Based<T>>
where
    T: PartialEq + Display,
{
    let mut said: Vec<(T, &Seen)> = Vec::new();
    for one in seen {
        if let Some(value) = of(one).filter(|value| said.iter().all(|s| s.0 != *value)) {
            said.push((value, one));
        }
    }
    if said.len() > 1 {
        let each: Vec<String> =
            said.iter().take(4).map(|(v, s)| format!("{v} in {}", s.name.display())).collect();
        return Some(Based::unknown(format!("the files differ: {}", each.join(", "))));
    }
    said.pop().map(|(value, _)| Based::new(value, "the files"))
}

fn bits(seen: &[Seen], known: &Known) -> Based<u32> {
    // Words of 16 bits may hold samples of fewer.
    let sure = |s: &Seen| s.facts.bits.filter(|bits| *bits != WORD || s.facts.taken.noted);
    let largest = seen.iter().map(|s| s.levels.largest).max().unwrap_or(0);
    let needed = u16::BITS - largest.leading_zeros();
    if let Some(said) = agreed(seen, sure) {
        return said;
    }
    if let Some(bits) = known.bits {
        return Based::new(bits, "given");
    }
    if needed == WORD {
        return Based::new(WORD, format!("samples up to {largest}"));
    }
    if needed >= 8 && u32::from(largest) + 1 == 1 << needed {
        let full =
            format!("the largest sample is {largest} = 2^{needed} - 1, as where it saturates");
        return Based::new(needed, full);
    }
    Based::unknown(format!("not in the files; samples reach {largest}: at least {needed}"))
}

/// The pattern, and whether it matters.
fn cfa(seen: &[Seen], stacks: &[Stack], known: &Known) -> (Based<Cfa>, bool) {
    if let Some(said) = agreed(seen, |s| s.facts.cfa.clone()) {
        return (said, true);
    }
    if let Some(cfa) = &known.cfa {
        return (Based::new(cfa.clone(), "given"), true);
    }
    let dark = stacks.iter().filter(|s| s.role.is(&Role::Dark)).map(|s| s.levels[0].mean);
    let black = dark.reduce(f64::min);
    let lit = stacks.iter().filter(|s| s.role.is(&Role::Flat)).map(|s| &s.levels[0]);
    let brightest = lit.max_by(|a, b| a.mean.total_cmp(&b.mean));
    let Some(flat) = brightest else {
        let matters = stacks.iter().any(|s| !s.role.is(&Role::Dark));
        let why = if matters { "" } else { ", and darks do not show it: one colour is taken" };
        return (Based::unknown(format!("not in the files{why}")), matters);
    };
    let signal = flat.mean - black.unwrap_or(0.0);
    let low = flat.cells.iter().copied().fold(f64::INFINITY, f64::min);
    let high = flat.cells.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if signal > 0.0 && high - low < ONE_FILTER * signal {
        let mono = Cfa { width: 1, height: 1, letters: vec!['M'] };
        return (Based::new(mono, "the four places in 2 x 2 pixels see the same of a flat"), true);
    }
    let means = flat.cells.map(|c| format!("{c:.0}")).join(" ");
    let why = format!("not in the files; the means in 2 x 2 pixels of a flat are {means} DN");
    (Based::unknown(why), true)
}
