//! Files that come with the program: cameras, tables that cameras name, and the facts on
//! sensors that the other built-in cameras are made of.

/// Names of the cameras that are files of their own.
pub const NAMES: [&str; 3] = ["mt9t012", "mt9v024", "mobile"];

/// Names of those with several captures of each pixel.
pub const HDR_NAMES: [&str; 6] =
    ["imx585-clear-hdr", "imx415-dol", "ox03c10", "imx490", "imx708-hdr", "split-pixel-lfm"];

macro_rules! files {
    ($($name:literal),* $(,)?) => { [$(($name, include_str!(concat!("../presets/", $name)))),*] };
}

const FILES: [(&str, &str); 22] = files![
    "mt9t012.toml",
    "mt9v024.toml",
    "mobile.toml",
    "imx585-clear-hdr.toml",
    "imx415-dol.toml",
    "ox03c10.toml",
    "imx490.toml",
    "imx708-hdr.toml",
    "split-pixel-lfm.toml",
    "mt9m131-qe.csv",
    "mt9v024-qe.csv",
    "mobile-qe.csv",
    "ir-cut-690.csv",
    "gsense400bsi-qe.csv",
    "imx183-qe.csv",
    "imx219-relative-qe.csv",
    "imx426-qe.csv",
    "imx455-qe.csv",
    "kaf8300-qe.csv",
    "mt9v024-mono-qe.csv",
    "ov5647-qe.csv",
    "sensors.csv",
];

/// The text of a file, `None` for a name that is not built in.
pub fn file(name: &str) -> Option<&'static str> {
    FILES.iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}
