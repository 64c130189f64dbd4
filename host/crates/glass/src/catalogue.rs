//! Which glass a name stands for.
//!
//! Makers use each other's names for different glasses, so a name alone may not do: catalogues
//! that a lens file names come first, and a glass of any other is taken only with a note, or not at
//! all where several differ.

use crate::agf;
use crate::lines::{C_LINE, D_LINE, F_LINE};
use crate::table::{built_in, note_on};
use crate::text::number;
use crate::{Glass, key};
use camrig_base::{Error, ErrorCode, Result};
use std::collections::BTreeMap;

/// Difference of index at the C, d and F lines up to which two glasses are the same one.
const ALIKE: f64 = 1e-4;
/// Difference of index up to which a glass replaces another without a note: the last
/// digit of makers' catalogues.
const SAME: f64 = 1e-6;
/// Materials that belong to no maker.
const NO_MAKER: &str = "misc";

/// The glasses that a name may refer to: the built-in table, catalogue files, and glasses that a
/// lens file or a person defines.
#[derive(Clone, Debug, Default)]
pub struct Catalogue {
    own: BTreeMap<String, Glass>,
    files: Vec<agf::File>,
}

/// A glass, and what a person should know about how it was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The glass.
    pub glass: Glass,
    /// What was assumed.
    pub note: Option<String>,
    /// The built-in glass in whose place a catalogue file's is taken.
    pub replaced: Option<Replaced>,
}

/// A built-in glass that gives way to one of a catalogue file.
#[derive(Clone, Debug, PartialEq)]
pub struct Replaced {
    /// Name of the file's catalogue, in small letters.
    pub catalogue: String,
    /// Maker of the built-in glass, in capitals.
    pub maker: String,
    /// The built-in glass.
    pub glass: Glass,
}

impl Found {
    /// The glass, as it was asked for, with nothing to tell.
    pub(crate) fn plain(glass: Glass) -> Self {
        Self { glass, note: None, replaced: None }
    }

    /// The glass of a lens that has these wavelengths, nm; notes on it are added to
    /// `notes`, once.
    #[must_use]
    pub fn noted(self, wavelengths_nm: &[f64], notes: &mut Vec<String>) -> Glass {
        let replaced = self.replaced.and_then(|r| r.note(&self.glass, wavelengths_nm));
        let told = self.note.into_iter().chain(replaced);
        let new: Vec<String> = told.filter(|note| !notes.contains(note)).collect();
        notes.extend(new);
        self.glass
    }
}

impl Replaced {
    /// A word on `glass`, taken in place of this one, where the two differ at the wavelengths, nm,
    /// at which both are known.
    fn note(&self, glass: &Glass, wavelengths_nm: &[f64]) -> Option<String> {
        let difference = |nm: f64| Some(glass.index(nm).ok()? - self.glass.index(nm).ok()?);
        let all = wavelengths_nm.iter().filter_map(|nm| difference(*nm));
        let most = all.fold(0.0, |most: f64, d| if d.abs() > most.abs() { d } else { most });
        let ((nd, _), (built_in, _)) = (glass.nd_vd(), self.glass.nd_vd());
        (most.abs() > SAME).then(|| {
            format!(
                "glass {} is that of {}.agf, not the built-in one of {}: n_d {nd:.6} instead of \
                 {built_in:.6} ({:+.1e}); at the wavelengths of the lens the index differs by up \
                 to {most:+.1e}",
                glass.name,
                self.catalogue,
                self.maker,
                nd - built_in
            )
        })
    }
}

/// Names that other programs use for glasses of the built-in table, and their names in the table.
/// The Chinese catalogue renamed its lead-free glasses H-…; the `C` names are those older files
/// use.
const ALIASES: &[(&str, &str)] = &[
    ("BK7", "N-BK7"),
    ("F_SILICA", "SILICA"),
    ("ACRYLIC", "PMMA"),
    ("POLYCARBONATE", "POLYCARB"),
    ("POLYSTYRENE", "POLYSTYR"),
    ("GE", "GERMANIUM"),
    ("SI", "SILICON"),
    ("ZEONEX_E48R", "E48R"),
    ("ZEONEX_330R", "330R"),
    ("ZEONEX_F52R", "F52R"),
    ("ZEONEX_K26R", "K26R"),
    ("LAK1C", "H-LAK1"),
    ("LAK10C", "H-LAK10"),
    ("LAF1C", "H-LAF1"),
    ("ZF7C", "ZF7"),
    ("ZK9C", "H-ZK9A"),
    ("L-TIM28_MOLD", "L-TIM28"),
];

/// A glass that has the name, and whose it is.
#[derive(Clone)]
struct Candidate {
    maker: String,
    /// It comes from a catalogue file.
    filed: bool,
    found: Found,
}

impl Candidate {
    fn maker(&self) -> String {
        self.maker.to_ascii_uppercase()
    }

    /// Remembers a built-in glass in whose place this one of a file is taken, the first of several.
    fn replaces(&mut self, old: &Self) {
        let catalogue = &self.maker;
        self.found.replaced.get_or_insert_with(|| Replaced {
            catalogue: catalogue.clone(),
            maker: old.maker(),
            glass: old.found.glass.clone(),
        });
    }

    /// Whether a lens file that names the catalogue `wanted` means this one: `SCHOTT` is in the
    /// table, and may be a file `schott-2019.agf`; `NIKON-HIKARI` is Hikari's.
    fn belongs_to(&self, wanted: &str) -> bool {
        let wanted = wanted.to_ascii_lowercase();
        match self.filed {
            true => !wanted.is_empty() && self.maker.starts_with(&wanted),
            false => wanted.contains(self.maker.as_str()),
        }
    }
}

impl Catalogue {
    /// Adds a glass under a name; it takes precedence over all others.
    pub fn insert(&mut self, name: &str, glass: Glass) {
        self.own.insert(key(name), glass);
    }

    /// Adds the glasses of a catalogue file (`.agf`) under the name of the catalogue. They come
    /// before built-in ones of the same maker. A glass that is wrong is reported when it is asked
    /// for.
    pub fn insert_agf(&mut self, name: &str, text: &str) {
        self.files.push(agf::read(name, text));
    }

    /// The glass called `name`. Of several makers' glasses of that name, the one whose maker comes
    /// first in `makers`; with none of them, one on which all makers agree, with a note. Case,
    /// dashes and spaces do not matter. Also understood: `1.5168:64.17` (n_d:V_d), six digits
    /// `517642` or `517.642` (n_d − 1 and V_d), `NAME_MAKER`.
    ///
    /// # Errors
    /// An unknown glass (the message names the most similar known ones); makers that differ.
    pub fn find(&self, name: &str, makers: &[String]) -> Result<Found> {
        let wanted = key(name);
        if let Some(glass) = self.own.get(&wanted) {
            return Ok(Found::plain(glass.clone()));
        }
        let candidates = self.candidates(name)?;
        if !candidates.is_empty() {
            return choose(name, makers, candidates);
        }
        if let Some((stem, maker)) = name.rsplit_once('_') {
            let candidates = self.candidates(stem)?;
            if !candidates.is_empty() {
                return choose(stem, &[maker.to_ascii_lowercase()], candidates);
            }
        }
        if let Some(model) = model_from_name(name) {
            return Ok(Found::plain(model?));
        }
        Err(Error::input(format!("no glass called \"{name}\""))
            .help(format!(
                "nearest known: {}; or put its maker's catalogue (.agf) beside the lens file, \
                 give n_d:V_d in its place, or define it",
                self.nearest(&wanted).join(", ")
            ))
            .with_code(ErrorCode::UnknownGlass))
    }

    /// All glasses of a name: those of files, then built-in ones, then those under other names.
    fn candidates(&self, name: &str) -> Result<Vec<Candidate>> {
        let wanted = key(name);
        let mut all = Vec::new();
        for file in &self.files {
            if let Some(found) = file.find(&wanted) {
                let found = found.map_err(|e| e.at(format!("{}.agf", file.name)))?;
                all.push(Candidate { maker: file.name.clone(), filed: true, found });
            }
        }
        let alias = ALIASES.iter().find(|(other, _)| key(other) == wanted);
        for (wanted, renamed) in [(Some(wanted), false), (alias.map(|a| key(a.1)), true)] {
            for (maker, glass) in wanted.and_then(|w| built_in().get(&w)).into_iter().flatten() {
                let mut glass = glass.clone();
                let note = note_on(maker, &glass);
                if renamed {
                    glass.name = name.to_owned();
                }
                let found = Found { glass, note, replaced: None };
                all.push(Candidate { maker: maker.clone(), filed: false, found });
            }
        }
        Ok(all)
    }

    fn nearest(&self, wanted: &str) -> Vec<String> {
        let own = self.own.values();
        let all = own.chain(built_in().values().flatten().map(|(_, glass)| glass));
        let mut scored: Vec<(usize, &str)> = all
            .map(|g| (strsim::damerau_levenshtein(wanted, &key(&g.name)), &g.name[..]))
            .collect();
        scored.sort();
        scored.dedup();
        scored.into_iter().take(3).map(|(_, name)| name.to_owned()).collect()
    }
}

/// One of several glasses of the name `name`; `makers` are those a lens file names.
fn choose(name: &str, makers: &[String], mut candidates: Vec<Candidate>) -> Result<Found> {
    replace_built_in(&mut candidates);
    let named = makers.iter().find_map(|m| candidates.iter().find(|c| c.belongs_to(m)));
    // A catalogue file that a person put there counts before what belongs to no maker.
    let filed = makers.is_empty() && candidates[0].filed;
    let free = || candidates.iter().find(|c| c.maker == NO_MAKER && !filed);
    if let Some(candidate) = named.or_else(free) {
        return Ok(candidate.found.clone());
    }
    let mut first = candidates[0].clone();
    let agree = candidates.iter().all(|c| alike(&c.found.glass, &first.found.glass));
    let owners = || {
        let mut owners: Vec<String> = candidates.iter().map(Candidate::maker).collect();
        owners.dedup();
        owners.join(", ")
    };
    let listed = makers.join(", ").to_ascii_uppercase();
    let note = match (agree, makers.is_empty()) {
        (true, true) => {
            let built_in = candidates.iter().find(|c| !c.filed && first.filed);
            built_in.into_iter().for_each(|old| first.replaces(old));
            return Ok(first.found);
        }
        (true, false) => format!(
            "glass {name} is in no catalogue that the file names ({listed}): that of {} is taken",
            first.maker()
        ),
        (false, true) if first.filed || first.maker == "schott" => format!(
            "glasses called {name} differ ({}), and the file names no catalogue: that of {} is \
             taken",
            owners(),
            first.maker()
        ),
        _ => {
            let places = match makers.is_empty() {
                true => "the file names no catalogue".to_owned(),
                false => format!("it is in none that the file names ({listed})"),
            };
            return Err(Error::input(format!(
                "glass {name} is in the catalogues of {}, which differ, and {places}",
                owners()
            ))
            .help(format!(
                "name one of these catalogues in the file, put the right one (.agf) beside it, \
                 or give n_d:V_d in place of {name}"
            ))
            .with_code(ErrorCode::UnknownGlass));
        }
    };
    let more = first.found.note.iter().map(|more| format!("; {more}"));
    let note = [note].into_iter().chain(more).collect::<String>();
    Ok(Found { note: Some(note), ..first.found })
}

/// Takes a built-in glass out where a file has one of its maker, which remembers it.
fn replace_built_in(candidates: &mut Vec<Candidate>) {
    let (filed, built_in): (Vec<_>, Vec<_>) = candidates.drain(..).partition(|c| c.filed);
    *candidates = filed;
    for old in built_in {
        match candidates.iter_mut().find(|c| c.filed && c.maker.contains(&old.maker)) {
            None => candidates.push(old),
            Some(new) => new.replaces(&old),
        }
    }
}

/// Whether two glasses are one under two makers' names.
fn alike(a: &Glass, b: &Glass) -> bool {
    let near = |um| (a.dispersion.index(um) - b.dispersion.index(um)).abs() < ALIKE;
    a.dispersion == b.dispersion || [C_LINE, D_LINE, F_LINE].into_iter().all(near)
}

/// `1.5168:64.17`, `517.642`, `517642`, `1.5168/64.17`.
fn model_from_name(name: &str) -> Option<Result<Glass>> {
    if let Some((nd, vd)) = name.split_once([':', '/']) {
        let pair = number("n_d", nd).and_then(|nd| Ok((nd, number("V_d", vd)?)));
        return Some(pair.and_then(|(nd, vd)| Glass::model(nd, vd)));
    }
    let (n, v) = match name.split_once('.') {
        Some(halves) => halves,
        None if name.len() == 6 && name.is_ascii() => name.split_at(3),
        None => return None,
    };
    let digits = |s: &str| s.len() >= 3 && s.bytes().all(|b| b.is_ascii_digit());
    let fraction = |s: &str| format!("0.{s}").parse::<f64>().ok();
    (digits(n) && digits(v))
        .then(|| Some(Glass::model(1.0 + fraction(n)?, 100.0 * fraction(v)?)))
        .flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(name: &str, makers: &[&str]) -> Result<Found> {
        let makers: Vec<String> = makers.iter().map(|m| (*m).to_owned()).collect();
        Catalogue::default().find(name, &makers)
    }

    #[test]
    fn names_in_all_their_dialects() {
        let find = |name, makers: &[&str]| find(name, makers).map(|f| f.glass);
        assert_eq!(find("NBK7_SCHOTT", &[]).unwrap().name, "N-BK7");
        assert_eq!(find("n-sk16_schott", &[]).unwrap().name, "N-SK16");
        assert_eq!(find("500.700", &[]).unwrap().nd_vd().0, 1.5);
        assert!((find("517642", &[]).unwrap().index(587.5618).unwrap() - 1.517).abs() < 1e-12);
        let own = find("SF5", &["hikari"]).unwrap();
        assert_ne!(own.dispersion, find("SF5", &["SCHOTT"]).unwrap().dispersion);
        let error = find("N-BK8", &[]).unwrap_err().to_string();
        assert!(error.contains("N-BK7") && error.contains(".agf"), "{error}");
    }

    /// n_d of the makers' catalogues: BAF4 of Schott and Hikari 1.60562, of CDGM 1.58271; F6 of
    /// Schott 1.63636; BK10 of Schott 1.49782, of LZOS 1.56889.
    #[test]
    fn the_maker_that_the_file_names_decides() {
        for (name, makers, nd) in [
            ("BAF4", &["schott"][..], 1.60562),
            ("BAF4", &["hikari", "cdgm"], 1.60562),
            ("BAF4", &["CDGM-ZEMAX"], 1.58271),
            ("BAF4_CDGM", &["schott"], 1.58271),
            ("F6", &["misc", "schott"], 1.63636),
            ("BK10_SCHOTT", &[], 1.49782),
            ("BK10", &["lzos"], 1.56889),
            ("WATER", &["schott"], 1.33340),
            ("SAPPHIRE", &[], 1.76817),
        ] {
            let found = find(name, makers).unwrap();
            let n = found.glass.nd_vd().0;
            assert!((n - nd).abs() < 6e-6, "{name} of {makers:?}: {n}");
        }
    }

    #[test]
    fn another_makers_glass_is_said_or_refused() {
        let found = find("S-BSM14", &["schott"]).unwrap();
        let note = found.note.unwrap();
        assert!(note.contains("OHARA") && note.contains("SCHOTT"), "{note}");
        assert_eq!(find("S-BSM14", &["ohara"]).unwrap().note, None);
        let note = find("BK10", &["SCHOTT"]).unwrap().note.unwrap();
        assert!(note.contains("no longer made"), "{note}");
        let error = find("F6", &["ohara"]).unwrap_err().to_string();
        assert!(error.contains("CDGM, LZOS") && error.contains("OHARA"), "{error}");
        assert!(find("F6", &[]).unwrap().note.unwrap().contains("that of SCHOTT is"));
    }

    #[test]
    fn a_catalogue_file_comes_before_the_table() {
        let mut glasses = Catalogue::default();
        let agf = "CC own\nNM F6 2 0 1.5 60 0 1 0\nCD 1.25 0 0 0 0 0\nLD 0.35 2\n";
        glasses.insert_agf("melts", agf);
        let find = |name: &str, makers: &[&str]| {
            let makers: Vec<String> = makers.iter().map(|m| (*m).to_owned()).collect();
            glasses.find(name, &makers).unwrap()
        };
        assert_eq!(find("F6", &["melts"]).glass.nd_vd().0, 1.5);
        assert_eq!(find("F6", &["MELTS", "schott"]).note, None);
        assert!((find("F6", &["schott", "melts"]).glass.nd_vd().0 - 1.63636).abs() < 1e-9);
        assert!(find("F6", &[]).note.unwrap().contains("that of MELTS is"));
    }

    /// Schott's N-BK7 (2017) by formula 2 with B1 larger by 0.003: d(n²) = 0.003·λ²/(λ² − C1).
    #[test]
    fn a_file_that_replaces_a_built_in_glass_of_its_maker_says_by_how_much() {
        let told = |file: &str, b1: f64, makers: &[&str]| {
            let text = format!(
                "CC x\nNM N-BK7 2 517642 0 64.2 0 1 0\nCD {b1} 0.00600069867 0.231792344 \
                 0.0200179144 1.01046945 103.560653\nLD 0.31 2.5\n"
            );
            let mut glasses = Catalogue::default();
            glasses.insert_agf(file, &text);
            let makers: Vec<String> = makers.iter().map(|m| (*m).to_owned()).collect();
            let mut notes = Vec::new();
            let found = glasses.find("N-BK7", &makers).unwrap();
            let _ = found.noted(&[486.1327, 587.5618], &mut notes);
            notes
        };
        const SCHOTT: f64 = 1.03961212;
        for makers in [&["schott"][..], &[]] {
            let notes = told("Schott-Melt", SCHOTT + 0.003, makers);
            let words = "glass N-BK7 is that of schott-melt.agf, not the built-in one of SCHOTT: \
                         n_d 1.517806 instead of 1.516800 (+1.0e-3)";
            assert!(notes.len() == 1 && notes[0].starts_with(words), "{notes:?}");
            // The same glass to the last digit that makers print.
            assert_eq!(told("schott", SCHOTT + 1e-6, makers), [""; 0]);
        }
        assert_eq!(told("schott", SCHOTT - 1e-5, &["schott"]).len(), 1);
        // Where the file names no catalogue, a glass that is nearly the same has a note too.
        let notes = told("melts", SCHOTT + 1e-4, &[]);
        assert!(notes.len() == 1 && notes[0].contains("that of melts.agf"), "{notes:?}");
        assert_eq!(told("melts", SCHOTT + 1e-4, &["melts"]), [""; 0]);
    }

    #[test]
    fn a_catalogue_file_comes_before_what_belongs_to_no_maker() {
        let mut glasses = Catalogue::default();
        glasses.insert_agf("own", "NM WATER 2 0 1.5 60 0 1 0\nCD 1.25 0 0 0 0 0\nLD 0.35 2\n");
        let found = glasses.find("WATER", &[]).unwrap();
        assert_eq!(found.glass.nd_vd().0, 1.5);
        assert!(found.note.unwrap().contains("that of OWN is"));
        // A lens file that names other catalogues means what it does without the file.
        assert!(glasses.find("WATER", &["schott".into()]).unwrap().glass.nd_vd().0 < 1.34);
    }
}
