//! Noise models of other programs, as values of a camera file and back.
//!
//! | form | what it has | source |
//! |---|---|---|
//! | noise profile | per gain (S, O): variance S x + O of a signal x, 0 at black and 1 at white; Noise Flow's β₁, β₂ | DNG 1.4, NoiseProfile; Abdelhamed et al. 2019 |
//! | darktable | per ISO and channel the same a, b, of demosaiced pictures | darktable, data/noiseprofiles.json |
//! | ELD, PMN | σ = exp(k ln K + b) of a Gaussian or Tukey lambda read noise and of rows, in DN, over the system gain K, DN/e⁻ | Wei et al. 2020; Feng et al. 2022 |
//! | libcamera | `rpi.noise`: standard deviation over the root of the mean, and `rpi.black_level`, on 16 bits; `rpi.alsc`: gains against fall-off | libcamera, Raspberry Pi tuning guide |
//!
//! With R = white − black and K = R S: `full_well_e` = (2^bits − 1) g/K, read noise √(O R² − 1/12)/K
//! at gain g. A power of K is a power of the gain: `gain_exponent` k − 1 of the effects, and a
//! straight line in logarithms between two places of `[sensor.gains]`.
//!
//! A file tells its form by what is in it, not by its name.

mod imported;
mod lines;
mod profiles;
mod tuning;

pub use imported::{Beside, Imported};
pub use lines::{to_lines, tukey_sd};
pub use profiles::{Profile, to_darktable, to_table};
pub use tuning::to_tuning;

use camrig_base::{Error, Result};
use serde_json::Value as Json;
use std::path::Path;

/// What all forms are, for messages.
const FORMS: &str = "DNG files, a table of noise profiles (CSV), or a JSON object of darktable \
                     (noiseprofiles), ELD (Profile-1), PMN (sigTLk or sigGsk) or libcamera \
                     (algorithms)";

/// Reads what files say: DNGs of one camera at one or several ISOs, or one file of another form.
///
/// # Errors
/// Files that cannot be read, are of no form or of several, or say nothing of noise; what the form
/// leaves open and `beside` does not say.
pub fn read(files: &[impl AsRef<Path>], beside: &Beside) -> Result<Imported> {
    let [first, others @ ..] = files else { return Err(Error::input("no file")) };
    let first = first.as_ref();
    let bytes = std::fs::read(first).map_err(|e| Error::io("read", first, e))?;
    if bytes.starts_with(b"II*\0") || bytes.starts_with(b"MM\0*") {
        return profiles::of_dngs(files);
    }
    let place = |e: Error| e.at(first.display());
    if !others.is_empty() {
        return Err(place(Error::input("several files, and this one is no DNG"))
            .help("give one file, or DNGs of one camera"));
    }
    if bytes.starts_with(b"\x93NUMPY") {
        return Err(place(Error::unsupported(
            "a NumPy file of Python objects (pickle), which may run any program when it is read",
        ))
        .help(
            "if you trust it, write its dictionary as JSON: python3 -c 'import json, numpy, sys; \
             print(json.dumps(numpy.load(sys.argv[1], allow_pickle=True).item(), \
             default=lambda v: v.tolist()))' FILE.npy > FILE.json",
        ));
    }
    let text = std::str::from_utf8(&bytes)
        .map_err(|_| place(Error::input("no noise model")).help(FORMS))?;
    read_text(text, beside).map_err(place)
}

/// Reads the text of a file: all forms but DNG.
///
/// # Errors
/// Those of [`read`].
pub fn read_text(text: &str, beside: &Beside) -> Result<Imported> {
    if !text.trim_start().starts_with('{') {
        return profiles::of_table(text)
            .ok_or_else(|| Error::input("no noise model").help(FORMS))?;
    }
    let json: Json = serde_json::from_str(text).map_err(|e| Error::input(e.to_string()))?;
    let has = |keys: &[&str]| keys.iter().any(|key| json.get(key).is_some());
    match [
        has(&["algorithms"]),
        has(&["noiseprofiles"]),
        has(&["Profile-1"]),
        has(&["sigTLk", "sigGsk"]),
    ] {
        [true, false, false, false] => tuning::read(&json, beside),
        [false, true, false, false] => profiles::of_darktable(&json, beside),
        [false, false, true, false] => lines::read(&json, lines::By::Eld, beside),
        [false, false, false, true] => lines::read(&json, lines::By::Pmn, beside),
        [false, false, false, false] => Err(Error::input("no noise model").help(FORMS)),
        _ => Err(Error::input("a noise model of several forms").help(FORMS)),
    }
}

#[cfg(test)]
mod tests;
