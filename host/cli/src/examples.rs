//! Tests of the examples in the texts of `--help`: each command has one, each parses, and none is
//! wrapped, so that it can be copied. tests/suite/examples.rs runs them.

use super::Cli;
use clap::{Command, CommandFactory, Parser};

/// Widest line of help, `max_term_width`.
const WIDTH: usize = 100;

/// Every command that does something, with its name and the text below its options.
fn commands() -> Vec<(String, String)> {
    fn add(command: &Command, name: &str, all: &mut Vec<(String, String)>) {
        if !command.has_subcommands() {
            let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            all.push((name.to_string(), text));
        }
        for inner in command.get_subcommands() {
            add(inner, &format!("{name} {}", inner.get_name()), all);
        }
    }
    let mut all = Vec::new();
    add(&Cli::command(), "camrig", &mut all);
    all
}

/// The words of each call of the program in a text. What follows two spaces is a remark.
fn calls(text: &str) -> Vec<Vec<String>> {
    let joined = text.replace("\\\n", " \u{1}");
    let mut calls = Vec::new();
    for line in joined.lines() {
        let Some(line) = line.strip_prefix("  camrig ") else { continue };
        let line: String = line.split('\u{1}').map(str::trim).collect::<Vec<_>>().join(" ");
        let command = format!("camrig {}", line.split("  ").next().unwrap_or_default());
        for part in command.split("&&").flat_map(|part| part.split('|')) {
            let words = part.split_whitespace().take_while(|w| !w.starts_with(['<', '>']));
            let words: Vec<String> =
                words.map(|word| word.replace("$SLURM_ARRAY_TASK_ID", "1")).collect();
            calls.extend((words.first().map(String::as_str) == Some("camrig")).then_some(words));
        }
    }
    calls
}

#[test]
fn every_command_has_an_example_and_every_example_parses() {
    let mut wrong = Vec::new();
    for (name, text) in commands() {
        let calls = calls(&text);
        let own = calls
            .iter()
            .any(|words| format!("{} ", words.join(" ")).starts_with(&format!("{name} ")));
        if !own {
            wrong.push(format!("{name} has no example of its own"));
        }
        for words in &calls {
            if let Err(e) = Cli::try_parse_from(words) {
                wrong.push(format!("{}: {e}", words.join(" ")));
            }
        }
        let long =
            text.lines().filter(|line| line.starts_with("  ") && line.chars().count() > WIDTH);
        wrong.extend(long.map(|line| format!("{name}: wider than a terminal: {line}")));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
