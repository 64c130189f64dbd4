//! Descriptions of the program for shells, editors and manuals: completions, manual pages, schema,
//! explanations.

use super::{camrig, camrig_ok, small_camera};
use camrig_tests::client;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn text(output: std::process::Output) -> String {
    String::from_utf8(output.stdout).unwrap()
}

fn json(arguments: &str) -> Value {
    let dir = tempfile::tempdir().unwrap();
    serde_json::from_slice(&camrig_ok(dir.path(), arguments).stdout).unwrap()
}

/// Names of the subcommands, from the help.
fn commands() -> Vec<String> {
    let help = text(camrig_ok(Path::new("."), "--help"));
    let after = help.split("Commands:").nth(1).expect("a list of commands");
    let list = after.split("Options:").next().unwrap();
    list.lines()
        .filter(|l| l.starts_with("  ") && !l.starts_with("   "))
        .filter_map(|l| l.split_whitespace().next().map(str::to_string))
        .collect()
}

#[test]
fn every_command_has_a_manual_page_and_an_example() {
    let dir = tempfile::tempdir().unwrap();
    camrig_ok(dir.path(), "man -o man");
    let commands = commands();
    assert!(commands.len() > 15, "{commands:?}");
    for command in commands.iter().filter(|c| *c != "help") {
        let page = std::fs::read_to_string(dir.path().join(format!("man/camrig-{command}.1")));
        let page = page.unwrap_or_else(|e| panic!("{command}: {e}"));
        assert!(page.contains(".TH") && page.contains(".SH SYNOPSIS"), "{command}");
        let help = text(camrig_ok(dir.path(), &format!("{command} --help")));
        assert!(help.contains("Example") || help.contains("Commands:"), "{command}:\n{help}");
    }
}

/// Bash loads the completions and completes a command and an option with them.
#[test]
fn bash_completes() {
    let Some(bash) = client("bash") else { return };
    let dir = tempfile::tempdir().unwrap();
    let script = text(camrig_ok(dir.path(), "completions bash"));
    std::fs::write(dir.path().join("camrig.bash"), script).unwrap();
    let complete = |words: &str, last: &str, before: &str| {
        let ask = format!(
            "source ./camrig.bash; COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); \
             _camrig camrig '{last}' '{before}'; printf '%s\\n' \"${{COMPREPLY[@]}}\""
        );
        let output = Command::new(&bash).args(["-c", &ask]).current_dir(dir.path()).output();
        text(output.unwrap())
    };
    assert_eq!(complete("camrig simu", "simu", "camrig").trim(), "simulate");
    assert_eq!(complete("camrig simulate --expo", "--expo", "simulate").trim(), "--exposure");
    for shell in ["zsh", "fish", "powershell", "elvish"] {
        let script = text(camrig_ok(dir.path(), &format!("completions {shell}")));
        assert!(script.contains("simulate") && script.contains("exposure"), "{shell}");
    }
}

/// Every effect and every key is explained, and the schema names them.
#[test]
fn explanations_and_schema_are_of_the_whole_catalogue() {
    let effects = json("effects --json");
    let kinds: Vec<&str> = effects["effects"]
        .as_array()
        .unwrap()
        .iter()
        .map(|e| e["kind"].as_str().unwrap())
        .collect();
    assert!(kinds.contains(&"defocus") && kinds.contains(&"row-temporal-noise"));
    let schema = json("schema");
    let forms = schema["properties"]["effect"]["items"]["oneOf"].as_array().unwrap();
    let named: Vec<&str> =
        forms.iter().map(|f| f["properties"]["kind"]["const"].as_str().unwrap()).collect();
    assert_eq!(named, kinds);
    for kind in kinds {
        let told = text(camrig_ok(Path::new("."), &format!("explain effect.{kind}")));
        assert!(told.contains(&format!("kind = {kind:?}")), "{told}");
    }
    let all = json("explain --json");
    for key in all["keys"].as_array().unwrap() {
        let key = key["key"].as_str().unwrap();
        let told = text(camrig_ok(Path::new("."), &format!("explain {key}")));
        assert!(told.contains(key), "{told}");
    }
    let output = camrig(Path::new("."), "explain sensor.noise.raed_e");
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && told.contains("sensor.noise.read_e"), "{told}");
}

/// An independent checker of schemas: every preset passes; a misspelt key and a value out of range
/// do not.
#[test]
fn presets_pass_the_schema() {
    let Some(python) = client("jsonschema") else { return };
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("schema.json"), text(camrig_ok(dir.path(), "schema"))).unwrap();
    let presets = text(camrig_ok(dir.path(), "presets"));
    let mut names: Vec<String> = Vec::new();
    for name in presets.lines().filter_map(|l| l.split_whitespace().next()) {
        let file = text(camrig_ok(dir.path(), &format!("presets {name}")));
        std::fs::write(dir.path().join(format!("{name}.toml")), file).unwrap();
        names.push(name.to_string());
    }
    let good = std::fs::read_to_string(dir.path().join(format!("{}.toml", names[0]))).unwrap();
    let effect = "\n[[effect]]\nkind = \"defocus\"\nshift_um = ";
    for (name, file) in [
        ("good", format!("{good}{effect}5.0\n")),
        ("beyond", format!("{good}{effect}5000.0\n")),
        ("misspelt", format!("{good}{effect}5.0\nshift = 1\n")),
        ("key", good.replacen("width", "widht", 1)),
    ] {
        std::fs::write(dir.path().join(format!("{name}.toml")), file).unwrap();
    }
    names.push("good".into());
    let check = "import json, jsonschema, sys, tomllib\n\
        schema = json.load(open('schema.json'))\n\
        jsonschema.Draft202012Validator.check_schema(schema)\n\
        check = jsonschema.Draft202012Validator(schema)\n\
        for name in sys.argv[1:]:\n\
        \x20   print(name, check.is_valid(tomllib.load(open(name + '.toml', 'rb'))))\n";
    let all = names.iter().map(String::as_str).chain(["beyond", "misspelt", "key"]);
    let output = Command::new(python)
        .args(["-c", check])
        .args(all)
        .current_dir(dir.path())
        .output()
        .unwrap();
    let told = text(output);
    for name in &names {
        assert!(told.contains(&format!("{name} True")), "{told}");
    }
    for name in ["beyond", "misspelt", "key"] {
        assert!(told.contains(&format!("{name} False")), "{told}");
    }
}

/// On a terminal messages are coloured unless NO_COLOR is set.
#[test]
fn colours_obey_no_color() {
    let Some(script) = client("script") else { return };
    let dir = tempfile::tempdir().unwrap();
    let program = env!("CARGO_BIN_EXE_camrig-under-test");
    for arguments in
        ["--help", "simulate --bad", "simulate --camera nowhere.toml --scene ramp -o a.dng"]
    {
        let on_a_terminal = |no_color: bool| {
            let mut command = Command::new(&script);
            command.args(["-qec", &format!("{program} {arguments}"), "/dev/null"]);
            command.current_dir(dir.path()).env("TERM", "xterm").env_remove("NO_COLOR");
            if no_color {
                command.env("NO_COLOR", "1");
            }
            text(command.output().unwrap())
        };
        assert!(on_a_terminal(false).contains("\x1b["), "{arguments}");
        assert!(!on_a_terminal(true).contains("\x1b["), "{arguments}");
    }
}

/// The page of keys is what the program prints, and an independent checker accepts each schema and
/// the built-in files of its kind.
#[test]
fn the_reference_is_up_to_date_and_the_schemas_hold() {
    let page = include_str!("../../../docs/reference.md");
    let printed = text(camrig_ok(Path::new("."), "schema --markdown"));
    assert!(page == printed, "camrig schema --markdown > docs/reference.md");
    let Some(python) = client("jsonschema") else { return };
    let dir = tempfile::tempdir().unwrap();
    for name in ["captures", "plan", "sweep", "script", "lens"] {
        let schema = text(camrig_ok(dir.path(), &format!("schema {name}")));
        std::fs::write(dir.path().join(format!("{name}.json")), schema).unwrap();
    }
    let plans = concat!(env!("CARGO_MANIFEST_DIR"), "/../host/crates/capture/plans");
    std::fs::write(dir.path().join("c.toml"), small_camera(64, 48, &[])).unwrap();
    camrig_ok(dir.path(), "capture --camera c.toml --plan optics --frames 1 -o captures");
    let check = "import glob, json, jsonschema, sys, tomllib\n\
        def check(name):\n\
        \x20   schema = json.load(open(name + '.json'))\n\
        \x20   jsonschema.Draft202012Validator.check_schema(schema)\n\
        \x20   return jsonschema.Draft202012Validator(schema)\n\
        good = {'plan': glob.glob(sys.argv[1] + '/*.toml'), 'captures': ['captures/captures.toml']}\n\
        for name in ['captures', 'plan', 'sweep', 'script', 'lens']:\n\
        \x20   validator = check(name)\n\
        \x20   for file in good.get(name, []):\n\
        \x20       value = tomllib.load(open(file, 'rb'))\n\
        \x20       validator.validate(value)\n\
        \x20       assert not validator.is_valid(value | {'frmat': 1})\n\
        \x20       print(name, file)\n";
    let output =
        Command::new(python).args(["-c", check, plans]).current_dir(dir.path()).output().unwrap();
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{told}");
    assert_eq!(String::from_utf8_lossy(&output.stdout).lines().count(), 6, "five plans and a set");
}
