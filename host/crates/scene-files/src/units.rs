//! What names and units say of the values of a scene and of its wavelengths: one rule for files of
//! all kinds.

use super::Quantity;
use super::sidecar::{Own, Sidecar};
use camrig_base::unit::Unit;
use camrig_base::{Error, Result};

/// What to say where the unit of radiance is not stated, or not one.
pub const STATE_THE_UNIT: &str = "state the unit of its samples, such as unit=W/m2/sr/um, or what they are multiplied by to be \
     in W m⁻² sr⁻¹ nm⁻¹, scale=FACTOR";

/// The quantity that the user says, else that of the name of an array or channel.
///
/// # Errors
/// The name of an irradiance, which no scene holds; that of a radiance whose unit nothing states.
pub fn quantity_of(name: &str, has_unit: bool, sidecar: &Sidecar) -> Result<Option<Quantity>> {
    let word = name.to_lowercase();
    if sidecar.quantity.is_some() {
        return Ok(sidecar.quantity);
    }
    if word.contains("irradiance") {
        return Err(Error::input(format!("{name:?} is an irradiance by its name")).help(
            "a scene is radiance or reflectance: give quantity=radiance or quantity=reflectance \
             if it is one",
        ));
    }
    let all = [Quantity::Reflectance, Quantity::Radiance];
    let named = all.into_iter().find(|quantity| word.contains(quantity.name()));
    if named == Some(Quantity::Radiance) && !has_unit && sidecar.scale.is_none() {
        return Err(Error::input(format!("{name:?} is a radiance by its name, of unknown unit"))
            .help(STATE_THE_UNIT));
    }
    Ok(named)
}

/// What samples are multiplied by, as their `unit` demands, which is `said_by` a file; `None` where
/// that is 1, or the user says the scale. A unit of radiance makes radiance of what nothing else
/// says.
///
/// # Errors
/// A unit that is not understood, or is not one of what the samples are.
pub fn scale(said_by: &str, unit: &str, sidecar: &Sidecar, own: &mut Own) -> Result<Option<f32>> {
    let parsed = Unit::parse(unit);
    let quantity = sidecar.quantity.or(own.quantity);
    let factor = match (&parsed, quantity) {
        (Ok(unit), Some(Quantity::Radiance)) => unit.radiance(),
        (Ok(unit), _) if unit.is_dimensionless() => Some(unit.factor()),
        (Ok(unit), None) => {
            own.quantity = unit.radiance().map(|_| Quantity::Radiance);
            unit.radiance()
        }
        _ => None,
    };
    match (factor, sidecar.scale) {
        (Some(1.0), _) => Ok(None),
        (_, Some(_)) => {
            own.notes.push(format!("{said_by} {unit:?} gives way to the scale given"));
            Ok(None)
        }
        (Some(factor), None) => {
            own.understood.push(format!("samples times {factor}, as {said_by} {unit:?} says"));
            Ok(Some(factor as f32))
        }
        (None, None) => {
            let kind = match quantity {
                _ if parsed.is_err() => "not understood",
                Some(Quantity::Radiance) => "no unit of spectral radiance",
                Some(Quantity::Reflectance) => "no unit of reflectance",
                None => "no unit of reflectance or spectral radiance",
            };
            Err(Error::input(format!("{said_by} {unit:?} is {kind}")).help(STATE_THE_UNIT))
        }
    }
}

/// Wavelengths that a name may state, nm: others are widths of bands.
pub const NAMED_NM: std::ops::RangeInclusive<f64> = 200.0..=2500.0;

/// The wavelength in a name such as `450 nm` or `Band 3 (0.45 µm)`, nm; `None` where it states none
/// or several, as an interval does.
pub fn wavelength_in(name: &str) -> Option<f64> {
    let is_number = |c: char| c.is_ascii_digit() || c == '.';
    let starts = name
        .char_indices()
        .filter(|(i, c)| c.is_ascii_digit() && !name[..*i].ends_with(is_number));
    let stated = starts.filter_map(|(start, _)| {
        let text = &name[start..];
        let (number, rest) = text.split_at(text.find(|c| !is_number(c)).unwrap_or(text.len()));
        let unit: String = rest.trim_start().chars().take_while(|c| c.is_alphabetic()).collect();
        let nm = Unit::parse(&unit).ok()?.to_nm(number.parse().ok()?)?;
        let is_end = name[..start].trim_end().ends_with(['-', '–', '…']);
        NAMED_NM.contains(&nm).then_some((nm, is_end))
    });
    match stated.collect::<Vec<_>>()[..] {
        [(nm, false)] => Some(nm),
        _ => None,
    }
}

/// The wavelengths that the names of all bands state, nm; an error where only some do.
pub fn wavelengths_in<'a>(names: impl Iterator<Item = &'a str>) -> Result<Option<Vec<f64>>> {
    let stated: Vec<Option<f64>> = names.map(wavelength_in).collect();
    let count = stated.iter().flatten().count();
    if count > 0 && count < stated.len() {
        return Err(Error::input(format!(
            "{count} of {} names of bands state a wavelength",
            stated.len()
        ))
        .help("give wavelength_nm, or start_nm and step_nm"));
    }
    Ok(stated.into_iter().collect::<Option<Vec<f64>>>().filter(|nm| !nm.is_empty()))
}

/// Whether the names of bands may state wavelengths without their unit: each has one number, and
/// these rise within the wavelengths of scenes.
pub fn may_state_wavelengths<'a>(names: impl Iterator<Item = &'a str>) -> bool {
    let number = |name: &'a str| {
        let mut numbers = name.split(|c: char| !c.is_ascii_digit() && c != '.');
        let number = numbers.find(|text| !text.is_empty())?.parse::<f64>().ok()?;
        let one = numbers.all(str::is_empty) && NAMED_NM.contains(&number);
        one.then_some(number)
    };
    let stated: Option<Vec<f64>> = names.map(number).collect();
    stated.is_some_and(|list| list.len() > 1 && list.is_sorted_by(|a, b| a < b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_the_quantity_unless_the_user_does() {
        let unsaid = Sidecar::default();
        for (name, quantity) in [
            ("cube/Radiance", Some(Quantity::Radiance)),
            ("reflectances", Some(Quantity::Reflectance)),
            ("cube", None),
        ] {
            assert_eq!(quantity_of(name, true, &unsaid).unwrap(), quantity, "{name}");
        }
        let error = quantity_of("Irradiance", true, &unsaid).unwrap_err().to_string();
        assert!(error.contains("quantity=radiance"), "{error}");
        let said = Sidecar::read("none".as_ref(), "quantity=radiance").unwrap();
        assert_eq!(quantity_of("irradiance", false, &said).unwrap(), Some(Quantity::Radiance));
        let error = quantity_of("Radiance", false, &unsaid).unwrap_err().to_string();
        assert!(error.contains("unit=W/m2/sr/um"), "{error}");
    }

    #[test]
    fn names_of_bands_state_wavelengths() {
        for (name, nm) in [
            ("450 nm", Some(450.0)),
            ("Band 3 (0.45 µm)", Some(450.0)),
            ("b12: 450.5nm, FWHM 10 nm", Some(450.5)),
            ("450-460 nm", None),
            ("450 nm - 460 nm", None),
            ("Band 3", None),
            ("450", None),
        ] {
            assert_eq!(wavelength_in(name), nm, "{name}");
        }
        let of = |names: &[&str]| wavelengths_in(names.iter().copied());
        assert_eq!(of(&["450 nm", "460 nm"]).unwrap(), Some(vec![450.0, 460.0]));
        assert_eq!(of(&["Band 1", "Band 2"]).unwrap(), None);
        assert!(of(&["450 nm", "Band 2"]).is_err());
        let may = |names: &[&str]| may_state_wavelengths(names.iter().copied());
        assert!(may(&["L420", "L430"]) && may(&["420", "430.5"]));
        assert!(!may(&["B1", "B2"]) && !may(&["L430", "L420"]) && !may(&["x", "L420"]));
    }

    #[test]
    fn units_scale_samples_or_are_refused() {
        let of = |unit: &str, quantity: Option<Quantity>, options: &str| {
            let mut own = Own { quantity, ..Own::default() };
            let sidecar = Sidecar::read("none".as_ref(), options).unwrap();
            scale("units", unit, &sidecar, &mut own).map(|scale| (scale, own.quantity))
        };
        let (radiance, reflectance) = (Some(Quantity::Radiance), Some(Quantity::Reflectance));
        assert_eq!(of("uW/cm^2/SR/nm", radiance, "").unwrap(), (Some(0.01), radiance));
        assert_eq!(of("W/m2/sr/um", None, "").unwrap(), (Some(0.001), radiance));
        assert_eq!(of("%", None, "").unwrap(), (Some(0.01), None));
        assert_eq!(of("%", reflectance, "").unwrap(), (Some(0.01), reflectance));
        assert_eq!(of("DN", radiance, "unit=W/m2/sr/um").unwrap().0, None);
        assert_eq!(of("DN", None, "scale=0.5").unwrap(), (None, None));
        for (unit, quantity) in [
            ("DN", radiance),
            ("DN", None),
            ("photons/s/m^2/sr/nm", radiance),
            ("furlongs", radiance),
            ("1", radiance),
            ("W/m2/sr/nm", reflectance),
        ] {
            let error = of(unit, quantity, "").unwrap_err().to_string();
            assert!(error.contains("unit=W/m2/sr/um") && error.contains(unit), "{unit}: {error}");
        }
    }
}
