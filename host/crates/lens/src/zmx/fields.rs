//! `FTYP`: kinds of fields and flags of the system.

use super::{File, count};
use crate::prescription::{FieldKind, Fields};
use crate::text::refuse;
use camrig_base::{Error, Result};

/// The kind of field given by theodolite angles.
const THEODOLITE: usize = 4;

/// `FTYP kind telecentric fields wavelengths norm iterate afocal`: refuses the systems that these
/// flags make of the lens.
pub(super) fn check_flags(words: &[&str]) -> Result<()> {
    let flag = |i: usize| match words.len() > i {
        true => count(words, i, "FTYP"),
        false => Ok(0),
    };
    if flag(1)? != 0 {
        return Err(Error::unsupported(
            "FTYP: the system is telecentric on the object's side, whatever its stop",
        )
        .help("such lenses are not traced; clear the flag if the stop is to decide"));
    }
    if flag(6)? != 0 {
        return refuse("an afocal system (FTYP)");
    }
    Ok(())
}

/// Angle with the axis of a direction by theodolite angles, degrees: azimuth x, elevation y.
fn theodolite(x: f64, y: f64) -> f64 {
    if x == 0.0 || y == 0.0 {
        return x.abs() + y.abs();
    }
    let [x, y] = [x, y].map(|v| libm::cos(v.to_radians()));
    libm::acos(x * y).to_degrees()
}

impl File {
    pub(super) fn fields(&mut self, scale: f64) -> Result<Fields> {
        let used = match self.counts[0] {
            0 => self.fields_y.len().max(self.fields_x.len()).clamp(1, 3),
            n => n,
        };
        let at = |list: &[f64], i: usize| list.get(i).copied().unwrap_or(0.0);
        let (kind, unit) = match self.field_kind {
            0 | THEODOLITE => (FieldKind::Angle, 1.0),
            1 => (FieldKind::ObjectHeight, scale),
            2 => (FieldKind::ParaxialImageHeight, scale),
            3 => (FieldKind::RealImageHeight, scale),
            other => {
                return Err(Error::unsupported(format!("fields of kind {other} (FTYP)"))
                    .help("known are angles, object heights and image heights, FTYP 0 to 4"));
            }
        };
        let radial = |i| {
            let (x, y) = (at(&self.fields_x, i), at(&self.fields_y, i));
            match self.field_kind {
                THEODOLITE => theodolite(x, y),
                _ => kind.off_axis(x, y) * unit,
            }
        };
        let values: Vec<f64> = (0..used).map(radial).collect();
        // Decentre and compression of the pupil, as losses on each side.
        let [dx, dy, cx, cy] = &self.vignetting;
        let losses = |i| {
            let (dx, dy, cx, cy) = (at(dx, i), at(dy, i), at(cx, i), at(cy, i));
            [cx - dx, cx + dx, cy - dy, cy + dy]
        };
        let vignetting: Vec<[f64; 4]> = (0..used).map(losses).collect();
        let any = vignetting.iter().flatten().any(|v| *v != 0.0);
        if self.fields_x.iter().any(|v| *v != 0.0) {
            let note = "fields off the y axis are taken at their distance from the axis";
            self.notes.push(note.into());
        }
        Ok(Fields { kind, values, vignetting: if any { vignetting } else { Vec::new() } })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theodolite_angles() {
        assert!((theodolite(3.0, 4.0) - 4.998_537).abs() < 1e-6, "{}", theodolite(3.0, 4.0));
        assert_eq!((theodolite(0.0, -4.0), theodolite(3.0, 0.0)), (4.0, 3.0));
    }
}
