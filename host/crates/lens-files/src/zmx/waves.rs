//! `WAVM`, or `WAVL` and `WWGT` of old files: wavelengths; and `PWAV`, which of them is the
//! reference.

use super::{File, count, value};
use camrig_base::{Error, Result};

/// Nanometres from micrometres, rounded to 1e-6 nm, so that 0.55 µm is 550 nm exactly.
fn nanometres(um: f64) -> f64 {
    (um * 1e9).round() / 1e6
}

impl File {
    /// `WAVM number wavelength weight`; those beyond the number in use hold defaults.
    pub(super) fn wave(&mut self, rest: &[&str]) -> Result<()> {
        let number = count(rest, 0, "WAVM")?;
        let weight = if rest.len() > 2 { value(rest, 2, "WAVM")? } else { 1.0 };
        self.waves.insert(number, (nanometres(value(rest, 1, "WAVM")?), weight));
        Ok(())
    }

    /// The wavelengths in use, nm, and their weights.
    pub(super) fn wavelengths(&mut self) -> Result<(Vec<f64>, Vec<f64>)> {
        let mut used = self.counts[1];
        if self.waves.is_empty() {
            let waves = self.old_waves.iter().copied().map(nanometres);
            used = used.max(waves.len());
            if self.old_weights.is_empty() {
                self.old_weights = vec![1.0; used];
            }
            self.waves = (1..).zip(waves.zip(self.old_weights.iter().copied())).collect();
        } else if used == 0 {
            used = self.waves.len();
            if used > 1 {
                self.notes.push(format!(
                    "the file does not say how many wavelengths are in use (FTYP): all {used} are \
                     taken"
                ));
            }
        }
        let wave = |number| {
            self.waves.get(&number).copied().ok_or_else(|| {
                Error::input(format!("wavelength {number} of {used} (FTYP) is not given"))
                    .help("each has a line WAVM, or values in WAVL and WWGT")
            })
        };
        let all = (1..=used).map(wave).collect::<Result<Vec<_>>>()?;
        Ok(all.into_iter().unzip())
    }

    /// The reference wavelength, nm, of these in use.
    pub(super) fn reference(&mut self, waves: &[f64]) -> Result<f64> {
        if let (None, [first, _, ..]) = (self.primary, waves) {
            let note = format!(
                "PWAV is not given: the first wavelength, {first} nm, is taken as the reference"
            );
            self.notes.push(note);
        }
        let primary = self.primary.unwrap_or(1);
        primary.checked_sub(1).and_then(|i| waves.get(i)).copied().ok_or_else(|| {
            Error::input(format!("primary wavelength {primary} of {}", waves.len()))
                .help("PWAV names one of the WAVM lines")
        })
    }
}
