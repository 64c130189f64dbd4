//! `MNUM` and the lines of the multi-configuration editor behind it.
//!
//! `MNUM count active` is followed by `OPERAND place configuration value ... "text" n`, one line
//! per operand and configuration; the surfaces hold the values of the active one. Another one is
//! made by setting its values, as long as the reader knows all operands in which the two differ
//! ([`File::number`]), and nothing in the file follows from them by a solve.

use super::{File, count};
use camrig_base::{Error, Result};
use camrig_glass::text::number;

/// Operands without effect on the image: comments, titles, switched-off lines, drawing.
const WITHOUT_EFFECT: [&str; 4] = ["MOFF", "MCOM", "LTTL", "CHZN"];
/// Relative difference up to which a value of the editor is that of a surface: digits of a file.
const SAME: f64 = 1e-9;
/// Most parameters of a surface: no type has as many.
const MAX_PARAMETERS: usize = 1000;
/// The operand whose text is the title of a configuration.
const TITLE: &str = "LTTL";
/// Keywords of a surface that say nothing of solves and pickups (`VDSZ`, `VPAR`: variables).
pub(super) const PLAIN: [&str; 33] = [
    "TYPE", "CURV", "CONI", "DISZ", "PARM", "XDAT", "GLAS", "DIAM", "MEMA", "OEMA", "FLAP",
    "CLAP", "OBSC", "OBDC", "SCBD", "STOP", "COMM", "HIDE", "MIRR", "SLAB", "POPS", "COAT",
    "FIMP", "SQAP", "ELAP", "SQOB", "ELOB", "SPID", "UDAP", "UDOB", "VDSZ", "VPAR", "IGNR",
];

/// A value of one operand in one configuration.
struct Value {
    line: usize,
    operand: String,
    /// Surface, field or wavelength, and a second number that some operands have.
    place: [String; 2],
    configuration: usize,
    value: String,
    text: String,
}

impl Value {
    /// Whether it may change the image; the thickness behind the image surface does not.
    fn has_effect(&self, image: usize) -> bool {
        let behind = self.operand == "THIC" && self.place[0].parse() == Ok(image);
        !(behind || WITHOUT_EFFECT.contains(&&self.operand[..]))
    }
}

impl File {
    /// The number that an operand of the editor is about, in the file's unit; `None` for operands
    /// that are not known, and for diameters that the file does not give, unless `create`d.
    fn number(&mut self, value: &Value, create: bool) -> Option<&mut f64> {
        let [first, second] = [0, 1].map(|i| value.place[i].parse::<usize>().ok());
        let place = first?;
        let of_fields = match &value.operand[..] {
            "XFIE" => Some(&mut self.fields_x),
            "YFIE" => Some(&mut self.fields_y),
            "FVDX" => Some(&mut self.vignetting[0]),
            "FVDY" => Some(&mut self.vignetting[1]),
            "FVCX" => Some(&mut self.vignetting[2]),
            "FVCY" => Some(&mut self.vignetting[3]),
            _ => None,
        };
        if let Some(list) = of_fields {
            return list.get_mut(place.checked_sub(1)?);
        }
        let surface = self.surfaces.get_mut(place)?;
        match &value.operand[..] {
            "THIC" => Some(&mut surface.thickness),
            "CRVT" => Some(&mut surface.curvature),
            "CONN" => Some(&mut surface.conic),
            "SDIA" if create => Some(&mut surface.diameter.get_or_insert_default().0),
            "SDIA" => surface.diameter.as_mut().map(|(radius, _)| radius),
            "PRAM" => {
                let slot = second?.checked_sub(1).filter(|slot| *slot < MAX_PARAMETERS)?;
                // Those that a file does not give are 0.
                let given = surface.parameters.len().max(slot + 1);
                surface.parameters.resize(given, 0.0);
                surface.parameters.get_mut(slot)
            }
            _ => None,
        }
    }
}

/// What a file says about its configurations.
#[derive(Default)]
pub(super) struct Configurations {
    count: usize,
    /// The active one, where the file says it (`MNUM` of older files does not).
    active: Option<usize>,
    values: Vec<Value>,
    /// The first line of a surface that a solve may govern.
    solved: Option<(usize, String)>,
}

impl Configurations {
    /// `MNUM count active`.
    pub(super) fn number(&mut self, rest: &[&str]) -> Result<()> {
        self.count = count(rest, 0, "MNUM")?;
        self.active = (rest.len() > 1).then(|| count(rest, 1, "MNUM")).transpose()?;
        Ok(())
    }

    /// Whether `MNUM` came already: lines behind it are the editor's.
    pub(super) fn have_begun(&self) -> bool {
        self.count > 0
    }

    /// A line behind `MNUM` that is not about surfaces.
    pub(super) fn line(&mut self, keyword: &str, rest: &[&str], line: usize) {
        let whole = |i: usize| rest.get(i).and_then(|w| w.parse::<usize>().ok());
        let (Some(_), Some(configuration), true) = (whole(0), whole(1), rest.len() > 2) else {
            return;
        };
        if self.count < 2 || !(1..=self.count).contains(&configuration) {
            return;
        }
        let all = rest.join(" ");
        let text = all.split('"').nth(1).unwrap_or_default().to_owned();
        let words = [0, 4].map(|i| rest.get(i).copied().unwrap_or_default().to_owned());
        self.values.push(Value {
            line,
            operand: keyword.to_owned(),
            place: words,
            configuration,
            value: rest[2].to_owned(),
            text,
        });
    }

    /// A line of a surface: remembers one that a solve may govern.
    pub(super) fn surface_line(&mut self, keyword: &str, rest: &[&str], line: usize) {
        // `CURV value kind ...`: 0 is fixed, 1 variable, others are solves.
        let solve = !PLAIN.contains(&keyword)
            || keyword == "CURV" && rest.get(1).is_some_and(|kind| !["0", "1"].contains(kind));
        if solve && self.solved.is_none() {
            self.solved = Some((line, keyword.to_owned()));
        }
    }

    /// The number of the configuration of this number or title.
    fn find(&self, wanted: &str) -> Result<usize> {
        let count = self.count.max(1);
        if let Some(number) = wanted.parse().ok().filter(|n| (1..=count).contains(n)) {
            return Ok(number);
        }
        let titles = || self.values.iter().filter(|v| v.operand == TITLE);
        let title = |v: &Value| if v.text.is_empty() { v.value.clone() } else { v.text.clone() };
        if let Some(value) = titles().find(|v| title(v).eq_ignore_ascii_case(wanted)) {
            return Ok(value.configuration);
        }
        let named: Vec<String> =
            titles().map(|v| format!("{} \"{}\"", v.configuration, title(v))).collect();
        let known = match named.is_empty() {
            true => format!("the file has configurations 1 to {count}, without titles"),
            false => format!("the file has {}", named.join(", ")),
        };
        Err(Error::input(format!("no configuration \"{wanted}\"")).help(known))
    }

    /// Sets the file to the configuration `wanted` (the active one unless given), and says
    /// which was taken.
    pub(super) fn apply(&self, wanted: Option<&str>, file: &mut File) -> Result<()> {
        let count = self.count;
        let wanted = wanted.map(|w| self.find(w)).transpose()?;
        if count < 2 {
            return Ok(());
        }
        let Some(active) = self.active.or_else(|| self.held(file)) else {
            let why = "the file does not say which is active (MNUM), nor do its surfaces";
            if let Some(wanted) = wanted {
                return Err(self.refuse(wanted, why));
            }
            file.notes.push(format!(
                "the values of the file are taken as they stand, with {count} configurations: {why}"
            ));
            return Ok(());
        };
        let holds = self.holds(active, file);
        let wanted = wanted.unwrap_or(active);
        if wanted == active {
            file.notes.push(format!(
                "configuration {active} of {count} is taken: it is the active one, {}",
                match holds {
                    true => "whose values the surfaces have",
                    false => "but the surfaces have other values than its lines, and keep them",
                }
            ));
            return Ok(());
        }
        if !holds {
            let why = format!("the surfaces do not have the values of the active one ({active})");
            return Err(self.refuse(wanted, &why));
        }
        let values = || self.values.iter().filter(|v| v.configuration == wanted);
        if values().next().is_none() {
            return Err(self.refuse(wanted, "the file has no values for it"));
        }
        if let Some(lone) = self.without_value(wanted, file.surfaces.len() - 1) {
            let (operand, place) = (&lone.operand, &lone.place[0]);
            let why = format!("line {}: {operand} {place} has no value for it", lone.line);
            return Err(self.refuse(wanted, &why));
        }
        let mut set = Vec::new();
        let image = file.surfaces.len() - 1;
        for value in values().filter(|v| v.has_effect(image)) {
            let same = |v: &&Value| {
                v.configuration == active && v.operand == value.operand && v.place == value.place
            };
            let before = self.values.iter().find(same);
            if before.is_some_and(|b| b.value == value.value && b.text == value.text) {
                continue;
            }
            self.set(value, file)?;
            set.push(format!("{} {} = {}", value.operand, value.place[0], value.value));
        }
        if let (Some((line, keyword)), false) = (&self.solved, set.is_empty()) {
            let why =
                format!("line {line}: {keyword} may be a solve that follows from its values");
            return Err(self.refuse(wanted, &why));
        }
        file.notes.push(format!(
            "configuration {wanted} of {count} is taken instead of the active one ({active}): {}",
            match set.is_empty() {
                true => "the two trace alike".to_owned(),
                false => set.join(", "),
            }
        ));
        Ok(())
    }

    /// The one configuration whose values the file has; `None` where several may be.
    fn held(&self, file: &mut File) -> Option<usize> {
        let mut held = (1..=self.count).filter(|number| self.holds(*number, file));
        held.next().filter(|_| held.next().is_none())
    }

    /// A value of another configuration of which there is none in this one.
    fn without_value(&self, wanted: usize, image: usize) -> Option<&Value> {
        let same = |a: &Value, b: &Value| a.operand == b.operand && a.place == b.place;
        let given = |value: &Value| {
            self.values.iter().any(|v| v.configuration == wanted && same(v, value))
        };
        let in_effect = |v: &&Value| v.has_effect(image);
        self.values.iter().filter(in_effect).find(|value| !given(value))
    }

    /// Whether the file has what is known of this configuration's values.
    fn holds(&self, configuration: usize, file: &mut File) -> bool {
        let image = file.surfaces.len() - 1;
        let mut values = self.values.iter().filter(|v| v.configuration == configuration);
        values.all(|value| {
            let wanted: Option<f64> = value.value.parse().ok();
            let here = file.number(value, false).filter(|_| value.has_effect(image));
            let (Some(here), Some(wanted)) = (here, wanted) else { return true };
            let infinite = here.abs().min(wanted.abs()) >= super::INFINITE;
            infinite || (*here - wanted).abs() <= SAME * wanted.abs()
        })
    }

    fn set(&self, value: &Value, file: &mut File) -> Result<()> {
        if let Some(here) = file.number(value, true) {
            *here = number(&value.operand, &value.value)?;
            return Ok(());
        }
        let why = format!(
            "line {}: it differs from the active one in {} {}, which is not known",
            value.line, value.operand, value.place[0]
        );
        Err(self.refuse(value.configuration, &why))
    }

    fn refuse(&self, wanted: usize, why: &str) -> Error {
        Error::unsupported(format!(
            "configuration {wanted} of {} cannot be set: {why}",
            self.count
        ))
        .help(
            "make it the active one in the lens program and save the file (thicknesses, \
                 curvatures, conics, semi-diameters, parameters and fields are set here)",
        )
    }
}
