//! `FTYP`: kinds of fields and flags of the system.

use super::{File, count};
use crate::refuse;
use camrig_base::{Error, Result};
use camrig_prescription::{FieldKind, Fields};

/// The kind of field given by theodolite angles.
const THEODOLITE: usize = 4;

/// `FTYP kind telecentric fields wavelengths norm iterate afocal`: whether the system is
/// telecentric on the object's side, whatever its stop. Refuses afocal systems.
pub(super) fn telecentric(words: &[&str]) -> Result<bool> {
    let flag = |i: usize| match words.len() > i {
        true => count(words, i, "FTYP"),
        false => Ok(0),
    };
    if flag(6)? != 0 {
        refuse("an afocal system (FTYP)")?;
    }
    Ok(flag(1)? != 0)
}

/// Angle with the axis of a direction by theodolite angles, degrees: azimuth x, elevation y.
fn theodolite(x: f64, y: f64) -> f64 {
    if x == 0.0 || y == 0.0 {
        return x.abs() + y.abs();
    }
    let [x, y] = [x, y].map(|v| libm::cos(v.to_radians()));
    libm::acos(x * y).to_degrees()
}

/// Projections on the planes of x–z and y–z, degrees, of a direction by theodolite angles.
fn projections([x, y]: [f64; 2]) -> [f64; 2] {
    let (x_rad, y_rad) = (x.to_radians(), y.to_radians());
    [x, libm::atan(libm::tan(y_rad) / libm::cos(x_rad)).to_degrees()]
}

impl File {
    pub(super) fn fields(&mut self, scale: f64) -> Result<Fields> {
        // Without their number, up to the last that is not on the axis: lists are filled up with 0.
        let lists = [&self.fields_x, &self.fields_y];
        let last = lists.iter().filter_map(|list| list.iter().rposition(|v| *v != 0.0)).max();
        let used = match self.counts[0] {
            0 => last.map_or(1, |last| last + 1),
            n => n,
        };
        // A lens with one field on the axis may do without them.
        let given = lists.iter().map(|list| list.len()).filter(|n| *n > 0).min();
        let given = given.unwrap_or(1);
        if given < used && self.counts[0] > 0 {
            return Err(Error::input(format!("{used} fields (FTYP), of which {given} are given"))
                .help("give as many values in XFLN and YFLN as FTYP says"));
        }
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
        let place = |i| {
            let place = [at(&self.fields_x, i), at(&self.fields_y, i)];
            match self.field_kind {
                THEODOLITE => projections(place),
                _ => place.map(|v| v * unit),
            }
        };
        let places: Vec<[f64; 2]> = (0..used).map(place).collect();
        // Decentre and compression of the pupil, as losses on each side.
        let [dx, dy, cx, cy] = &self.vignetting;
        let losses = |i| {
            let (dx, dy, cx, cy) = (at(dx, i), at(dy, i), at(cx, i), at(cy, i));
            [cx - dx, cx + dx, cy - dy, cy + dy]
        };
        let vignetting: Vec<[f64; 4]> = (0..used).map(losses).collect();
        let any = vignetting.iter().flatten().any(|v| *v != 0.0);
        if self.fields_x.iter().any(|v| *v != 0.0) {
            let note = "fields off the y axis are taken at their distance from the axis, where the \
                        lens is rotationally symmetric";
            self.notes.push(note.into());
        }
        let vignetting = if any { vignetting } else { Vec::new() };
        Ok(Fields { kind, values, places, vignetting, elliptical: true })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theodolite_angles() {
        assert!((theodolite(3.0, 4.0) - 4.998_537).abs() < 1e-6, "{}", theodolite(3.0, 4.0));
        // The projections of the same direction lie as far off the axis.
        let [x, y] = projections([3.0, 4.0]);
        assert!((FieldKind::Angle.off_axis(x, y) - theodolite(3.0, 4.0)).abs() < 1e-12);
        assert_eq!((theodolite(0.0, -4.0), theodolite(3.0, 0.0)), (4.0, 3.0));
    }
}
