//! Colour spaces from ICC profiles: those of a matrix and three curves, or of one grey curve,
//! which are almost all that pictures carry.

use super::code_points::code_points;
use super::picture::Said;
use camrig_light::colour::space::{SRGB, Space};
use camrig_light::colour::transfer::Transfer;
use moxcms::{ColorProfile, DataColorSpace, ProfileText, ToneReprCurve, TransferCharacteristics};

/// What a profile says.
pub fn said(profile: &[u8]) -> Said {
    let Ok(profile) = ColorProfile::new_from_slice(profile) else {
        return Said::Unknown("an ICC profile that cannot be read".into());
    };
    // With these code points, a profile's curves are for programs that do not know them.
    let pq_or_hlg = [TransferCharacteristics::Smpte2084, TransferCharacteristics::Hlg];
    if let Some(code) = profile.cicp
        && pq_or_hlg.contains(&code.transfer_characteristics)
    {
        let (primaries, transfer) = (code.color_primaries, code.transfer_characteristics);
        return code_points(primaries as u8, transfer as u8)
            .map_or_else(|error| Said::Refused(error.at("its ICC profile")), Said::Space);
    }
    let name = profile.description.as_ref().and_then(text);
    let tables = [
        &profile.lut_a_to_b_perceptual,
        &profile.lut_a_to_b_colorimetric,
        &profile.lut_a_to_b_saturation,
    ];
    let has_tables = tables.into_iter().any(Option::is_some);
    let part = if has_tables { " (its matrix, not its tables)" } else { "" };
    let name = format!("the ICC profile {:?}{part}", name.unwrap_or_default());
    let space = match profile.color_space {
        DataColorSpace::Rgb => of_matrix(&name, &profile),
        DataColorSpace::Gray => of_grey(&name, &profile),
        _ => None,
    };
    space.map_or_else(
        || Said::Unknown(format!("{name}, which is no matrix with curves")),
        Said::Space,
    )
}

fn of_matrix(name: &str, profile: &ColorProfile) -> Option<Space> {
    let curves = [&profile.red_trc, &profile.green_trc, &profile.blue_trc];
    let [Some(red), Some(green), Some(blue)] = curves.map(|c| c.as_ref().and_then(transfer))
    else {
        return None;
    };
    let [r, g, b] = [profile.red_colorant, profile.green_colorant, profile.blue_colorant];
    let columns = [[r.x, g.x, b.x], [r.y, g.y, b.y], [r.z, g.z, b.z]];
    let lit = columns.iter().all(|row| row.iter().sum::<f64>() > 0.0);
    lit.then(|| Space::of_columns(name, &columns, [red, green, blue]))
}

fn of_grey(name: &str, profile: &ColorProfile) -> Option<Space> {
    let transfer = profile.gray_trc.as_ref().and_then(transfer)?;
    Space::of(name, &SRGB, transfer).ok()
}

/// A profile's curve (ICC.1:2022, 10.6 and 10.18).
fn transfer(curve: &ToneReprCurve) -> Option<Transfer> {
    match curve {
        ToneReprCurve::Lut(table) => Some(match table[..] {
            [] => Transfer::Linear,
            [gamma] => Transfer::Gamma(f64::from(gamma) / 256.0),
            _ => Transfer::Table(table.clone()),
        }),
        ToneReprCurve::Parametric(parameters) => {
            let p: Vec<f64> = parameters.iter().map(|&v| f64::from(v)).collect();
            Some(Transfer::Parametric(match p[..] {
                [g] => [g, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                [g, a, b] => [g, a, b, 0.0, -b / a, 0.0, 0.0],
                [g, a, b, c] => [g, a, b, 0.0, -b / a, c, c],
                [g, a, b, c, d] => [g, a, b, c, d, 0.0, 0.0],
                [g, a, b, c, d, e, f] => [g, a, b, c, d, e, f],
                _ => return None,
            }))
        }
    }
}

fn text(text: &ProfileText) -> Option<String> {
    let found = match text {
        ProfileText::PlainString(text) => text.clone(),
        ProfileText::Localizable(texts) => texts.first()?.value.clone(),
        ProfileText::Description(text) => text.ascii_string.clone(),
    };
    Some(found.trim_matches(['\0', ' ']).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn space(profile: ColorProfile) -> Space {
        match said(&profile.encode().unwrap()) {
            Said::Space(space) => space,
            _ => panic!("not understood"),
        }
    }

    #[test]
    fn profiles_of_a_matrix_are_understood() {
        let srgb = space(ColorProfile::new_srgb());
        assert_eq!(srgb.to_srgb, None);
        let grey = srgb.transfer[1].linear(118.0 / 255.0);
        assert!((grey - 0.181_164).abs() < 1e-4, "{grey}");
        let p3 = space(ColorProfile::new_display_p3());
        let expected =
            Space::of("", &camrig_light::colour::space::DISPLAY_P3, Transfer::Srgb).unwrap();
        let (found, expected) = (p3.to_srgb.unwrap(), expected.to_srgb.unwrap());
        for i in 0..9 {
            let (r, c) = (i / 3, i % 3);
            assert!((found[r][c] - expected[r][c]).abs() < 1e-3, "{found:?}, not {expected:?}");
        }
        assert!(matches!(said(b"no profile"), Said::Unknown(_)));
        assert!(matches!(
            said(&ColorProfile::new_bt2020_pq().encode().unwrap()),
            Said::Refused(_)
        ));
    }
}
