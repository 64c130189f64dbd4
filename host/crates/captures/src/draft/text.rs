//! The text of a drafted manifest.

use super::stacks::Stack;
use super::{Based, Draft};
use crate::Role;
use crate::manifest::UNKNOWN;
use std::collections::BTreeMap;
use std::fmt::Display;

/// Columns before the comment of a line.
const COMMENT_AT: usize = 32;

impl Draft {
    /// The manifest in TOML, preceded by the lines of `head` as comments.
    #[must_use]
    pub fn text(&self, head: &[&str]) -> String {
        self.write(head).0
    }

    /// Number of unknown values by key.
    #[must_use]
    pub fn unknown(&self) -> BTreeMap<&'static str, usize> {
        self.write(&[]).1
    }

    fn write(&self, head: &[&str]) -> (String, BTreeMap<&'static str, usize>) {
        let mut out = Lines::default();
        head.iter().for_each(|line| out.text += &format!("# {line}\n"));
        out.text += "format = \"captures/1\"\n\n[sensor]\n";
        let s = &self.sensor;
        out.required("width", &Based::new(s.size.0, "the files"), |v| v.to_string());
        out.required("height", &Based::new(s.size.1, "the files"), |v| v.to_string());
        out.required("bits", &s.bits, u32::to_string);
        let quoted = |v: &dyn Display| format!("{:?}", v.to_string());
        if s.cfa_matters {
            out.required("cfa", &s.cfa, |v| quoted(v));
        } else {
            out.optional("cfa", &s.cfa, |v| quoted(v));
        }
        out.optional("black_level_dn", &s.black_level_dn, f64::to_string);
        out.optional("white_level_dn", &s.white_level_dn, u16::to_string);
        out.optional("pitch_um", &s.pitch_um, f64::to_string);
        self.stacks.iter().for_each(|stack| out.stack(stack));
        (out.text, out.unknown)
    }
}

/// The lines written.
#[derive(Default)]
struct Lines {
    text: String,
    unknown: BTreeMap<&'static str, usize>,
}

impl Lines {
    fn stack(&mut self, stack: &Stack) {
        let mean = stack.levels.iter().map(|l| l.mean).sum::<f64>() / stack.levels.len() as f64;
        let plural = if stack.frames == 1 { "" } else { "s" };
        self.text += &format!(
            "\n[[capture]] # {} frame{plural}, mean {mean:.1} DN\nid = {:?}\n",
            stack.frames, stack.id
        );
        self.required("role", &stack.role, |role| {
            serde_json::to_string(role).unwrap_or_default() // a word in quotes, as in TOML
        });
        self.text += &match &stack.files[..] {
            [one] => format!("files = {one:?}\n"),
            several => {
                let names: Vec<String> = several.iter().map(|f| format!("    {f:?},\n")).collect();
                format!("files = [\n{}]\n", names.concat())
            }
        };
        self.required("exposure_s", &stack.exposure_s, f64::to_string);
        self.required("analog_gain", &stack.analog_gain, f64::to_string);
        self.optional("temperature_c", &stack.temperature_c, f64::to_string);
        let light = "[capture.light]: omitted, not in the files";
        match stack.role.value {
            Some(Role::Dark) | None => {}
            Some(Role::Flat) => {
                self.text += &format!("# {light}; needed for quantum efficiency\n")
            }
            Some(_) => self.text += &format!("# {light}; nor is [capture.scene]\n"),
        }
    }

    /// Writes a required key.
    fn required<T>(&mut self, key: &'static str, based: &Based<T>, show: impl Fn(&T) -> String) {
        let value = based.value.as_ref().map_or_else(
            || {
                *self.unknown.entry(key).or_default() += 1;
                format!("{UNKNOWN:?}")
            },
            show,
        );
        let line = format!("{key} = {value}");
        self.text += &format!("{line:COMMENT_AT$}# {}\n", based.on);
    }

    /// Writes an optional key, or a comment that it is omitted.
    fn optional<T>(&mut self, key: &'static str, based: &Based<T>, show: impl Fn(&T) -> String) {
        match &based.value {
            Some(_) => self.required(key, based, show),
            None => self.text += &format!("# {key}: omitted, {}\n", based.on),
        }
    }
}
