//! The `[sensor]` of a manifest, from what the files have in common.

use super::file::FrameFile;
use super::stacks::Stack;
use super::{Based, Known};
use crate::Role;
use camrig_base::Cfa;
use camrig_base::toml_text::seven_figures;
use std::fmt::Display;

/// Largest difference between the four positions in 2 x 2 pixels, relative to the signal, at which
/// they have the same filter: a quarter of a million samples agree to less than a tenth of it.
const MAX_MONO_DIFFERENCE: f64 = 0.01;
/// Bits of a word, which some formats state whatever the range of the samples.
const WORD_BITS: u32 = 16;

/// The `[sensor]` of a manifest.
#[derive(Clone, Debug)]
pub struct Sensor {
    /// Columns and rows.
    pub size: (usize, usize),
    /// Bits of a sample.
    pub bits: Based<u32>,
    /// Colour filters; unknown where no lit frame shows them.
    pub cfa: Based<Cfa>,
    /// Whether the set would be misinterpreted without `cfa`.
    pub cfa_matters: bool,
    /// Mean without light, DN.
    pub black_level_dn: Based<f64>,
    /// Value at which a sample saturates, DN.
    pub white_level_dn: Based<u16>,
    /// Distance of neighbouring pixels, µm.
    pub pitch_um: Based<f64>,
}

impl Sensor {
    /// From all files.
    pub fn of(files: &[FrameFile], stacks: &[Stack], known: &Known) -> Self {
        let bits = bits(files, known);
        let black = black_by_place(files)
            .or_else(|| agreed(files, |s| s.facts.black_level_dn))
            .or_else(|| {
                let share = files.iter().find_map(|s| s.sidecar.black_share.clone())?;
                let dn = share.value * f64::from(1u32 << bits.value?);
                Some(Based::new(seven_figures(dn), share.by))
            })
            .or_else(|| Some(Based::new(known.black_level_dn?, "given")));
        let white = agreed(files, |s| s.facts.white_level_dn)
            .or_else(|| Some(Based::new(known.white_level_dn?, "given")));
        let pitch = files.iter().find_map(|s| s.facts.taken.pitch_um.clone()).map(Based::from);
        let (cfa, cfa_matters) = cfa(files, stacks, known);
        Self {
            size: files[0].size,
            bits,
            cfa,
            cfa_matters,
            black_level_dn: black
                .unwrap_or_else(|| Based::unknown("not in the files: measured from dark frames")),
            white_level_dn: white
                .unwrap_or_else(|| Based::unknown("not in the files: full scale is used")),
            pitch_um: pitch.or_else(|| Some(Based::new(known.pitch_um?, "given"))).unwrap_or_else(
                || Based::unknown("not in the files: needed for cycles/mm and photons per area"),
            ),
        }
    }
}

/// Black levels that differ between the positions of the pattern are not one for the whole sensor.
fn black_by_place(files: &[FrameFile]) -> Option<Based<f64>> {
    let levels = files.iter().find_map(|s| s.facts.black_levels_that_differ())?;
    let levels: Vec<String> = levels.iter().map(f64::to_string).collect();
    Some(Based::unknown(format!(
        "the files have {} by position of the pattern: measured from dark frames",
        levels.join(", ")
    )))
}

/// The value in all files that have one; unknown where they disagree.
fn agreed<T>(files: &[FrameFile], of: impl Fn(&FrameFile) -> Option<T>) -> Option<Based<T>>
where
    T: PartialEq + Display,
{
    let mut found: Vec<(T, &FrameFile)> = Vec::new();
    for file in files {
        if let Some(value) = of(file).filter(|value| found.iter().all(|s| s.0 != *value)) {
            found.push((value, file));
        }
    }
    if found.len() > 1 {
        let each: Vec<String> =
            found.iter().take(4).map(|(v, s)| format!("{v} in {}", s.name.display())).collect();
        return Some(Based::unknown(format!("the files differ: {}", each.join(", "))));
    }
    found.pop().map(|(value, _)| Based::new(value, "the files"))
}

fn bits(files: &[FrameFile], known: &Known) -> Based<u32> {
    // 16-bit words may hold samples of fewer bits.
    let sure =
        |s: &FrameFile| s.facts.bits.filter(|bits| *bits != WORD_BITS || s.facts.taken.noted);
    let largest = files.iter().map(|s| s.levels.largest).max().unwrap_or(0);
    let needed = u16::BITS - largest.leading_zeros();
    if let Some(found) = agreed(files, sure) {
        return found;
    }
    if let Some(bits) = known.bits {
        return Based::new(bits, "given");
    }
    if needed == WORD_BITS {
        return Based::new(WORD_BITS, format!("samples up to {largest}"));
    }
    if needed >= 8 && u32::from(largest) + 1 == 1 << needed {
        let full = format!("the largest sample is {largest} = 2^{needed} - 1, probably saturated");
        return Based::new(needed, full);
    }
    Based::unknown(format!("not in the files; samples reach {largest}: at least {needed}"))
}

/// The pattern, and whether the set would be misinterpreted without it.
fn cfa(files: &[FrameFile], stacks: &[Stack], known: &Known) -> (Based<Cfa>, bool) {
    if let Some(found) = agreed(files, |s| s.facts.cfa.clone()) {
        return (found, true);
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
        let why = if matters { "" } else { "; monochrome is assumed, as darks do not show it" };
        return (Based::unknown(format!("not in the files{why}")), matters);
    };
    let signal = flat.mean - black.unwrap_or(0.0);
    let low = flat.cells.iter().copied().fold(f64::INFINITY, f64::min);
    let high = flat.cells.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if signal > 0.0 && high - low < MAX_MONO_DIFFERENCE * signal {
        let mono = Cfa { width: 1, height: 1, letters: vec!['M'] };
        return (
            Based::new(mono, "the four positions in 2 x 2 pixels have the same signal in a flat"),
            true,
        );
    }
    let means = flat.cells.map(|c| format!("{c:.0}")).join(" ");
    let why = format!("not in the files; the means in 2 x 2 pixels of a flat are {means} DN");
    (Based::unknown(why), true)
}
