//! Groups files into stacks and finds the conditions of each.

use super::file::{FrameFile, Levels};
use super::names::{self, Found};
use super::{Based, Known};
use crate::Role;
use camrig_base::toml_text::seven_figures;
use camrig_base::unit::Unit;
use std::path::{Path, PathBuf};

/// Relative change of the signal from one frame to the next above which another stack begins: lamps
/// flicker by less, levels of a series differ by more.
const MAX_LEVEL_CHANGE: f64 = 0.1;
/// Change of temperature above which another stack begins, °C.
const MAX_TEMPERATURE_CHANGE: f64 = 1.0;
/// Largest signal of a dark as a share of the range from black to white.
const MAX_DARK_SHARE: f64 = 0.005;
/// Smallest signal of a lit frame as a share of the range. Between the two, levels alone do not
/// determine the role.
const MIN_LIT_SHARE: f64 = 0.05;
/// Largest spread of an even field's blocks relative to its mean: lens shading is less.
const MAX_EVEN_SPREAD: f64 = 0.4;
/// Largest spread of each side of an edge relative to its step.
const MAX_SIDE_SPREAD: f64 = 0.1;
/// Smallest share of blocks on each side of an edge, and on both together.
const MIN_SIDE: f64 = 0.15;
const MIN_BOTH_SIDES: f64 = 0.85;

/// A drafted stack.
#[derive(Clone, Debug)]
pub struct Stack {
    /// Unique name.
    pub id: String,
    /// Its purpose.
    pub role: Based<Role>,
    /// Names or patterns of its files in order of time.
    pub files: Vec<String>,
    /// Number of frames.
    pub frames: usize,
    /// Exposure time, s.
    pub exposure_s: Based<f64>,
    /// Gain before the converter.
    pub analog_gain: Based<f64>,
    /// Temperature, °C.
    pub temperature_c: Based<f64>,
    /// Levels of the first frame of each file.
    pub levels: Vec<Levels>,
    /// Inconsistencies.
    pub notes: Vec<String>,
}

/// The conditions of a file's frames.
#[derive(Clone)]
struct Conditions {
    role: Based<Role>,
    exposure_s: Based<f64>,
    analog_gain: Based<f64>,
    temperature_c: Based<f64>,
}

/// Groups the files of frames into stacks; `all` are the names of all files.
pub fn of(files: &[FrameFile], known: &Known, all: &[PathBuf]) -> Vec<Stack> {
    let scale = Scale::of(files, known);
    let mut groups: Vec<(Key, Vec<(&FrameFile, Conditions)>)> = Vec::new();
    for file in files {
        let conditions = Conditions::of(file, known, &scale);
        let key = Key::of(file, &conditions);
        match groups.iter_mut().find(|(other, _)| *other == key) {
            Some((_, group)) => group.push((file, conditions)),
            None => groups.push((key, vec![(file, conditions)])),
        }
    }
    let runs: Vec<_> =
        groups.iter().flat_map(|(_, group)| group.chunk_by(|a, b| scale.alike(a, b))).collect();
    let mut stacks: Vec<Stack> = runs.iter().map(|run| stack(run, &scale, all)).collect();
    name(&mut stacks, &runs);
    stacks
}

/// What the files of a stack have in common.
#[derive(PartialEq)]
struct Key {
    folder: PathBuf,
    /// The name without its last number; the whole name for a file of several frames.
    name: String,
    role: Option<Role>,
    exposure: Option<u64>,
    gain: Option<u64>,
}

impl Key {
    fn of(file: &FrameFile, conditions: &Conditions) -> Self {
        let whole = file.name.file_name().map_or_else(String::new, |n| n.to_string_lossy().into());
        let (before, after) = around_number(&whole);
        let name = if file.frames > 1 { whole.clone() } else { format!("{before}#{after}") };
        Self {
            folder: folder_of(file),
            name,
            role: conditions.role.value,
            exposure: conditions.exposure_s.value.map(f64::to_bits),
            gain: conditions.analog_gain.value.map(f64::to_bits),
        }
    }
}

fn folder_of(file: &FrameFile) -> PathBuf {
    file.name.parent().unwrap_or(Path::new("")).to_owned()
}

/// The text before and after the number of a frame in a file's name: the last word that is only
/// digits, otherwise the last digits that end a word, otherwise the last that begin one. The digits
/// of a quantity, as of `0.1sec` and `120s`, are none.
fn around_number(file: &str) -> (&str, &str) {
    let stem = file.rfind('.').unwrap_or(file.len());
    let name = &file[..stem];
    let is_digit = |c: char| c.is_ascii_digit();
    let is_point = |mut next: [Option<char>; 2]| {
        next[0].take_if(|c| matches!(c, '.' | ',')).is_some() && next[1].is_some_and(is_digit)
    };
    let (mut best, mut end) = (None, stem);
    while let Some(last) = name[..end].rfind(is_digit) {
        let to = last + 1;
        let from = name[..to].trim_end_matches(is_digit).len();
        end = from;
        let (mut back, mut on) = (name[..from].chars().rev(), name[to..].chars());
        let (before, after) = ([back.next(), back.next()], [on.next(), on.next()]);
        let unit = name[to..].split(|c: char| !c.is_alphabetic()).next().unwrap_or("");
        let separate = |c: [Option<char>; 2]| !c[0].is_some_and(char::is_alphanumeric);
        let rank = match (separate(before), separate(after)) {
            _ if is_point(before) || is_point(after) => 0,
            (true, true) => 3,
            (false, true) => 2,
            (true, false) if Unit::parse(&unit.to_lowercase()).is_err() => 1,
            _ => 0,
        };
        if rank > best.map_or(0, |(rank, _)| rank) {
            best = Some((rank, [from, to]));
        }
    }
    best.map_or((name, &file[stem..]), |(_, [from, to])| (&file[..from], &file[to..]))
}

impl Conditions {
    fn of(file: &FrameFile, known: &Known, scale: &Scale) -> Self {
        let taken = &file.facts.taken;
        let by_field = taken.kind.as_ref().and_then(|kind| {
            let named = names::role_of(&kind.value)?;
            Some((Based::new(named.role, format!("{} = {:?}", kind.by, kind.value)), named.bias))
        });
        let by_name = || {
            let Found { value, part } = names::role(&file.name)?;
            Some((Based::new(value.role, format!("the name {part:?}")), value.bias))
        };
        let (role, bias) =
            by_field.or_else(by_name).unwrap_or_else(|| (scale.role(&file.levels), false));
        let given = |value: Option<f64>| value.map(|v| Based::new(v, "given"));
        let field = |field: &Option<camrig_formats::Said<f64>>| {
            let finite = field.clone().filter(|s| s.value.is_finite());
            finite.map(|s| Based::from(s).map(seven_figures))
        };
        let positive = |b: &Based<f64>| b.value.is_some_and(|v| v > 0.0);
        let by_name = || {
            let Found { value, part } = names::exposure_s(&file.name)?;
            Some(Based::new(seven_figures(value), format!("the name {part:?}")))
        };
        let exposure_s = field(&taken.exposure_s)
            .filter(positive)
            .or_else(|| field(&file.sidecar.exposure_s).filter(positive))
            .or_else(|| bias.then(|| Based::new(0.0, "bias frames have none")))
            .or_else(|| given(known.exposure_s))
            .or_else(by_name)
            .unwrap_or_else(|| Based::unknown("not in the files or their names"));
        let remarks = taken.remarks.join(", ");
        let why = if remarks.is_empty() {
            "not in the files".into()
        } else {
            format!("not in the files; {remarks} is in arbitrary units of the camera")
        };
        Self {
            role,
            exposure_s,
            analog_gain: field(&taken.analog_gain)
                .or_else(|| field(&file.sidecar.analog_gain))
                .filter(positive)
                .or_else(|| given(known.analog_gain))
                .unwrap_or_else(|| Based::unknown(why)),
            temperature_c: field(&taken.temperature_c)
                .or_else(|| field(&file.sidecar.temperature_c))
                .or_else(|| given(known.temperature_c))
                .unwrap_or_else(|| Based::unknown("not in the files")),
        }
    }
}

/// Black and white level of the set, as far as known.
struct Scale {
    black: Option<f64>,
    white: f64,
}

impl Scale {
    fn of(files: &[FrameFile], known: &Known) -> Self {
        let named_dark = |s: &&FrameFile| {
            let by_field =
                s.facts.taken.kind.as_ref().and_then(|kind| names::role_of(&kind.value));
            let named = by_field.or_else(|| Some(names::role(&s.name)?.value));
            named.is_some_and(|n| n.role == Role::Dark)
        };
        let of_files = files.iter().find_map(|s| s.facts.black_level_dn);
        let lowest = || files.iter().filter(named_dark).map(|s| s.levels.mean).reduce(f64::min);
        let white =
            known.white_level_dn.or_else(|| files.iter().find_map(|s| s.facts.white_level_dn));
        let largest = || files.iter().map(|s| s.levels.largest).max();
        Self {
            black: known.black_level_dn.or(of_files).or_else(lowest),
            white: white.or_else(largest).unwrap_or(u16::MAX).into(),
        }
    }

    /// A level as a share of the range from black to white; `None` where black is unknown.
    fn share(&self, level: f64) -> Option<f64> {
        let black = self.black?;
        Some((level - black) / (self.white - black).max(1.0))
    }

    /// The role of a frame according to its levels.
    fn role(&self, levels: &Levels) -> Based<Role> {
        let by = "no name has its role";
        let Some(share) = self.share(levels.mean) else {
            return Based::unknown(format!("{by}, and the black level is unknown"));
        };
        let black = self.black.unwrap_or_default();
        let mut blocks: Vec<f64> = levels.blocks.iter().map(|b| b - black).collect();
        blocks.sort_by(f64::total_cmp);
        let at = |share: f64| blocks[((blocks.len() - 1) as f64 * share).round() as usize];
        let (low, high, mean) = (at(0.05), at(0.95), levels.mean - black);
        let spread = high - low;
        let side = |level: f64| {
            let near = blocks.iter().filter(|b| (**b - level).abs() < MAX_SIDE_SPREAD * spread);
            near.count() as f64 / blocks.len() as f64
        };
        let guess = |role, what: &str| {
            Based::new(role, format!("by its levels: {what} of {mean:.1} DN above black"))
        };
        if share.abs() <= MAX_DARK_SHARE && spread <= MAX_DARK_SHARE * self.white {
            guess(Role::Dark, "a mean")
        } else if share >= MIN_LIT_SHARE && spread < MAX_EVEN_SPREAD * mean {
            guess(Role::Flat, "an even field")
        } else if share >= MIN_LIT_SHARE
            && side(low).min(side(high)) >= MIN_SIDE
            && side(low) + side(high) >= MIN_BOTH_SIDES
        {
            guess(Role::Edge, "two even sides, a mean")
        } else {
            Based::unknown(format!("{by}, and its levels do not determine it"))
        }
    }

    /// Whether successive files belong to one stack.
    fn alike(&self, a: &(&FrameFile, Conditions), b: &(&FrameFile, Conditions)) -> bool {
        let black = self.black.unwrap_or(0.0);
        let (first, second) = (a.0.levels.mean - black, b.0.levels.mean - black);
        let jump = (first - second).abs();
        // Nothing but exposure, gain and temperature tells darks apart.
        let same_level = a.1.role.is(&Role::Dark)
            || jump <= MAX_LEVEL_CHANGE * first.abs().max(second.abs())
            || jump <= MAX_DARK_SHARE * (self.white - black);
        let same_temperature = match (a.1.temperature_c.value, b.1.temperature_c.value) {
            (Some(a), Some(b)) => (a - b).abs() <= MAX_TEMPERATURE_CHANGE,
            (a, b) => a.is_none() == b.is_none(),
        };
        same_level && same_temperature
    }
}

/// The stack of a run of files.
fn stack(run: &[(&FrameFile, Conditions)], scale: &Scale, all: &[PathBuf]) -> Stack {
    let (first, conditions) = &run[0];
    let temperatures: Vec<f64> = run.iter().filter_map(|r| r.1.temperature_c.value).collect();
    let mut temperature_c = conditions.temperature_c.clone();
    if let (Some(low), Some(high)) = (
        temperatures.iter().copied().reduce(f64::min),
        temperatures.iter().copied().reduce(f64::max),
    ) && low < high
    {
        let mean = temperatures.iter().sum::<f64>() / temperatures.len() as f64;
        temperature_c = Based::new(
            seven_figures(mean),
            format!("mean of {low} to {high}: {}", temperature_c.on),
        );
    }
    let levels: Vec<Levels> = run.iter().map(|r| r.0.levels.clone()).collect();
    let mut notes = Vec::new();
    let mean = levels.iter().map(|l| l.mean).sum::<f64>() / levels.len() as f64;
    if conditions.role.is(&Role::Dark)
        && scale.share(mean).is_some_and(|share| share > MIN_LIT_SHARE)
    {
        notes.push(format!(
            "{}: a mean of {:.1} DN above black is high for a dark (role from {})",
            first.name.display(),
            mean - scale.black.unwrap_or_default(),
            conditions.role.on
        ));
    }
    Stack {
        id: String::new(),
        role: conditions.role.clone(),
        files: files(run, all),
        frames: run.iter().map(|r| r.0.frames).sum(),
        exposure_s: conditions.exposure_s.clone(),
        analog_gain: conditions.analog_gain.clone(),
        temperature_c,
        levels,
        notes,
    }
}

/// A pattern that matches exactly the files of a stack in their order, otherwise all their names.
fn files(run: &[(&FrameFile, Conditions)], all: &[PathBuf]) -> Vec<String> {
    let names: Vec<&PathBuf> = run.iter().map(|r| &r.0.name).collect();
    let escaped = |name: &Path| {
        let text = name.to_string_lossy().replace(std::path::MAIN_SEPARATOR, "/");
        glob::Pattern::escape(&text)
    };
    let in_order = names.windows(2).all(|pair| pair[0] < pair[1]);
    if names.len() > 1 && in_order {
        let folder = folder_of(run[0].0);
        let file = names[0].file_name().map_or_else(String::new, |n| n.to_string_lossy().into());
        let (before, after) = around_number(&file);
        let ending = file.rfind('.').map_or("", |at| &file[at..]);
        for (before, after) in [("", ending), (before, after)] {
            let [before, after] = [before, after].map(glob::Pattern::escape);
            let inside = escaped(&folder);
            let joint = if inside.is_empty() { "" } else { "/" };
            let pattern = format!("{inside}{joint}{before}*{after}");
            let Ok(glob) = glob::Pattern::new(&pattern) else { continue };
            let options = glob::MatchOptions {
                require_literal_separator: true,
                require_literal_leading_dot: true,
                case_sensitive: true,
            };
            let fits = |path: &&PathBuf| glob.matches_path_with(path, options);
            if all.iter().filter(fits).eq(names.iter().copied()) {
                return vec![pattern];
            }
        }
    }
    names.iter().map(|name| escaped(name)).collect()
}

/// Gives each stack a unique name: that of its folder or of its files, with the exposure where
/// several would have the same.
fn name(stacks: &mut [Stack], runs: &[&[(&FrameFile, Conditions)]]) {
    let folders: Vec<PathBuf> = runs.iter().map(|run| folder_of(run[0].0)).collect();
    let base = |i: usize| {
        let folder = folders[i].to_string_lossy().replace(['/', '\\'], "-");
        let only = folders.iter().filter(|f| **f == folders[i]).count() == 1;
        let file = runs[i][0].0.name.with_extension("");
        let file = file.file_name().map_or_else(String::new, |n| n.to_string_lossy().into());
        let file = if runs[i].len() > 1 { around_number(&file).0.to_string() } else { file };
        let both = match (only && !folder.is_empty(), folder.is_empty()) {
            (true, _) => folder,
            (false, true) => file,
            (false, false) => format!("{folder}-{file}"),
        };
        let trimmed = both.trim_matches(|c: char| !c.is_alphanumeric()).to_string();
        if trimmed.is_empty() { "frames".to_string() } else { trimmed }
    };
    let names: Vec<String> = (0..stacks.len()).map(base).collect();
    for (i, name) in names.iter().enumerate() {
        let several = names.iter().filter(|other| *other == name).count() > 1;
        let exposure = stacks[i].exposure_s.value.filter(|_| several);
        let wanted = match exposure {
            Some(seconds) => format!("{name}-{}us", seven_figures(seconds * 1e6)),
            None => name.clone(),
        };
        let taken = |id: &str| stacks[..i].iter().any(|s| s.id == id);
        let numbered = (2..).map(|n| format!("{wanted}-{n}"));
        let id = std::iter::once(wanted.clone()).chain(numbered).find(|id| !taken(id));
        stacks[i].id = id.unwrap_or(wanted);
    }
}

#[cfg(test)]
mod tests {
    use super::around_number;

    #[test]
    fn the_number_of_a_frame_in_its_name() {
        for (name, before, after) in [
            ("0001.dng", "", ".dng"),
            ("IMG0012.dng", "IMG", ".dng"),
            ("L00_f1.tiff", "L00_f", ".tiff"),
            ("0001_640x480_SGRBG10P.raw", "", "_640x480_SGRBG10P.raw"),
            ("dark_100ms_1.fits", "dark_100ms_", ".fits"),
            ("flat-1-2.png", "flat-1-", ".png"),
            ("dark.npy", "dark", ".npy"),
            ("dark_0.1sec_frame0001.fit", "dark_0.1sec_frame", ".fit"),
            ("dark_0.1sec.fit", "dark_0.1sec", ".fit"),
            ("DarkBefore-001D120s.fit", "DarkBefore-", "D120s.fit"),
            ("dark_120s.fit", "dark_120s", ".fit"),
            ("flat_12_0.25s.fit", "flat_", "_0.25s.fit"),
            ("dark.0001.fit", "dark.", ".fit"),
        ] {
            assert_eq!(around_number(name), (before, after), "{name}");
        }
    }
}
