//! What names and units say of the values of a scene and of its wavelengths: one rule for files of
//! all kinds.

use super::Quantity;
use super::sidecar::{Own, Sidecar};
use camrig_base::{Error, Result};

/// Speed of light in nm · GHz (exact by the SI's definition of the metre).
const LIGHT_NM_GHZ: f64 = 299_792_458.0;
/// Parts of units of spectral radiance: which of the four it is (power, area, solid angle,
/// wavelength), its name, its power, and what it is in W, m⁻², sr⁻¹ and nm⁻¹.
const OF_RADIANCE: [(usize, &str, i32, f64); 8] = [
    (0, "W", 1, 1.0),
    (0, "mW", 1, 1e-3),
    (0, "uW", 1, 1e-6),
    (1, "m", -2, 1.0),
    (1, "cm", -2, 1e4),
    (2, "sr", -1, 1.0),
    (3, "nm", -1, 1.0),
    (3, "um", -1, 1e-3),
];

/// The quantity that the user says, else that of the name of an array or channel.
///
/// # Errors
/// The name of an irradiance, which no scene holds.
pub fn quantity_of(name: &str, sidecar: &Sidecar) -> Result<Option<Quantity>> {
    let word = name.to_lowercase();
    match sidecar.quantity {
        None if word.contains("irradiance") => {
            Err(Error::input(format!("{name:?} is an irradiance by its name")).help(
                "a scene is radiance or reflectance: give quantity=radiance or \
                 quantity=reflectance if it is one",
            ))
        }
        None => {
            let all = [Quantity::Reflectance, Quantity::Radiance];
            Ok(all.into_iter().find(|quantity| word.contains(quantity.name())))
        }
        said => Ok(said),
    }
}

/// What radiance in a unit such as `mW.cm^-2.sr^-1.um^-1` or `W/(m2 sr nm)` is multiplied by to be
/// in W m⁻² sr⁻¹ nm⁻¹; none where the unit is another one.
pub fn radiance_factor(unit: &str) -> Option<f64> {
    let plain = unit.replace(['µ', 'μ'], "u").replace('⁻', "-");
    let plain = plain.replace('¹', "1").replace('²', "2");
    let (mut factor, mut found) = (1.0, [false; 4]);
    for (part, text) in plain.split('/').enumerate() {
        let sign = if part == 0 { 1 } else { -1 };
        for word in text.split([' ', '.', '*', '·', '(', ')']).filter(|word| !word.is_empty()) {
            let name = word.trim_end_matches(|c: char| c.is_ascii_digit() || "^-".contains(c));
            let power = match word[name.len()..].trim_start_matches('^') {
                "" => sign,
                power => sign * power.parse::<i32>().ok()?,
            };
            let same = |of: &&(usize, &str, i32, f64)| (of.1, of.2) == (name, power);
            let (place, .., of) = OF_RADIANCE.iter().find(same)?;
            if std::mem::replace(&mut found[*place], true) {
                return None;
            }
            factor *= of;
        }
    }
    (found == [true; 4]).then_some(factor)
}

/// What samples of radiance are multiplied by: the user's scale, else as their `unit` demands,
/// which is `said_by` a file.
pub fn radiance_scale(said_by: &str, unit: &str, sidecar: &Sidecar, own: &mut Own) -> f32 {
    match (radiance_factor(unit), sidecar.scale) {
        (Some(1.0), scale) => scale.unwrap_or(1.0),
        (_, Some(scale)) => {
            own.notes.push(format!("{said_by} {unit:?} gives way to the scale given"));
            scale
        }
        (Some(factor), None) => {
            own.understood.push(format!("samples times {factor}, as {said_by} {unit:?} says"));
            factor as f32
        }
        (None, None) => {
            own.notes.push(format!(
                "{said_by} {unit:?} is taken as W m⁻² sr⁻¹ nm⁻¹ \
                 (scale=FACTOR if it is not)"
            ));
            1.0
        }
    }
}

/// What makes nm of wavelengths in a unit; none where the unit is not known.
pub fn to_nm(unit: &str) -> Option<fn(f64) -> f64> {
    let to_nm: fn(f64) -> f64 = match unit.trim().to_lowercase().as_str() {
        "nanometers" | "nanometres" | "nanometer" | "nanometre" | "nm" => |nm| nm,
        "micrometers" | "micrometres" | "micrometer" | "micrometre" | "microns" | "um" | "µm"
        | "μm" => |um| um * 1e3,
        "angstroms" | "angstrom" | "å" => |angstroms| angstroms * 0.1,
        "wavenumber" | "1/cm" | "cm-1" | "cm^-1" => |per_cm| 1e7 / per_cm,
        "ghz" => |ghz| LIGHT_NM_GHZ / ghz,
        _ => return None,
    };
    Some(to_nm)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 mW/cm² is 10 W/m², and 1 /µm is 0.001 /nm.
    #[test]
    fn units_of_radiance_in_use_are_understood() {
        for (unit, factor) in [
            ("W.m^-2.sr^-1.nm^-1", Some(1.0)),
            ("mW.m^-2.sr^-1.nm^-1", Some(1e-3)),
            ("W m-2 sr-1 um-1", Some(1e-3)),
            ("µW/cm^2/sr/nm", Some(1e-2)),
            ("mW/(cm² sr µm)", Some(1e-2)),
            ("W·m⁻²·sr⁻¹·nm⁻¹", Some(1.0)),
            ("W.m^-2.sr^-1", None),
            ("W.m^-2.nm^-1", None),
            ("W.m^2.sr^-1.nm^-1", None),
            ("W.m^-2.sr^-1.nm^-1.nm^-1", None),
            ("1", None),
            ("", None),
        ] {
            let found = radiance_factor(unit);
            let near = |(a, b): (f64, f64)| (a / b - 1.0).abs() < 1e-12;
            assert_eq!(found.is_some(), factor.is_some(), "{unit}: {found:?}");
            assert!(found.zip(factor).is_none_or(near), "{unit}: {found:?}");
        }
    }

    #[test]
    fn names_say_the_quantity_unless_the_user_does() {
        let unsaid = Sidecar::default();
        for (name, quantity) in [
            ("cube/Radiance", Some(Quantity::Radiance)),
            ("reflectances", Some(Quantity::Reflectance)),
            ("cube", None),
        ] {
            assert_eq!(quantity_of(name, &unsaid).unwrap(), quantity, "{name}");
        }
        let error = quantity_of("Irradiance", &unsaid).unwrap_err().to_string();
        assert!(error.contains("quantity=radiance"), "{error}");
        let said = Sidecar::read("none".as_ref(), "quantity=radiance").unwrap();
        assert_eq!(quantity_of("irradiance", &said).unwrap(), Some(Quantity::Radiance));
    }
}
