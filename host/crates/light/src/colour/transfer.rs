//! From the codes of a picture, 0 to 1, to linear light.

use camrig_base::{Error, Result};

/// A transfer: code to linear light.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Transfer {
    /// Samples are linear.
    Linear,
    /// IEC 61966-2-1.
    Srgb,
    /// The inverse of the camera curve of ITU-R BT.709 and BT.2020.
    Bt2020,
    /// A power.
    Gamma(f64),
    /// An ICC parametric curve of any type, as its most general one: g, a, b, c, d, e, f with
    /// (a x + b)^g + e from d on, and c x + f below.
    Parametric([f64; 7]),
    /// An ICC table over 0 to 1, linear between its entries, 65535 being 1.
    Table(Vec<u16>),
}

/// Names of transfers that can be asked for.
const NAMES: [&str; 3] = ["linear", "srgb", "bt2020"];

impl Transfer {
    /// The transfer of that name; a number is a power.
    ///
    /// # Errors
    /// An unknown name.
    pub fn parse(name: &str) -> Result<Self> {
        Ok(match name {
            "linear" => Self::Linear,
            "srgb" => Self::Srgb,
            "bt2020" => Self::Bt2020,
            _ => match name.parse::<f64>() {
                Ok(gamma) if gamma > 0.0 && gamma.is_finite() => Self::Gamma(gamma),
                _ => {
                    return Err(Error::input(format!("transfer {name:?}")).help(format!(
                        "the transfers are {} or a power such as 2.2",
                        NAMES.join(", ")
                    )));
                }
            },
        })
    }

    /// In words.
    pub fn name(&self) -> String {
        match self {
            Self::Linear => "linear".into(),
            Self::Srgb => "sRGB".into(),
            Self::Bt2020 => "BT.2020".into(),
            Self::Gamma(gamma) => format!("power {gamma}"),
            Self::Parametric(_) => "a parametric curve".into(),
            Self::Table(table) => format!("a table of {} entries", table.len()),
        }
    }

    /// Linear light of a code. Codes outside 0 to 1, which floats may have, follow the curve above
    /// 1 and its reflection below 0.
    pub fn linear(&self, code: f64) -> f64 {
        if code < 0.0 {
            return -self.linear(-code);
        }
        match self {
            Self::Linear => code,
            Self::Srgb if code <= 0.04045 => code / 12.92,
            Self::Srgb => libm::pow((code + 0.055) / 1.055, 2.4),
            // ITU-R BT.2020, table 4, with the constants of 12 bits.
            Self::Bt2020 if code < 4.5 * 0.018_053_968_510_807 => code / 4.5,
            Self::Bt2020 => {
                let alpha = 1.099_296_826_809_44;
                libm::pow((code + alpha - 1.0) / alpha, 1.0 / 0.45)
            }
            Self::Gamma(gamma) => libm::pow(code, *gamma),
            Self::Parametric([g, a, b, c, d, e, f]) => {
                if code >= *d {
                    libm::pow((a * code + b).max(0.0), *g) + e
                } else {
                    c * code + f
                }
            }
            Self::Table(table) => {
                let last = table.len() - 1;
                let at = code.min(1.0) * last as f64;
                let before = (at as usize).min(last.saturating_sub(1));
                let share = at - before as f64;
                let entry = |i: usize| f64::from(table[i.min(last)]);
                (entry(before) * (1.0 - share) + entry(before + 1) * share) / 65535.0
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_go_through_known_points() {
        for (transfer, code, linear) in [
            (Transfer::Srgb, 118.0 / 255.0, 0.181_164),
            (Transfer::Srgb, 0.04, 0.04 / 12.92),
            (Transfer::Bt2020, 0.5, 0.259_72),
            (Transfer::Bt2020, 0.045, 0.01),
            (Transfer::Gamma(2.0), 0.5, 0.25),
            (Transfer::Table(vec![0, 16384, 65535]), 0.75, (16384.0 + 65535.0) / 2.0 / 65535.0),
            (Transfer::Table(vec![0, 65535]), 1.0, 1.0),
            (Transfer::Parametric([2.0, 0.5, 0.5, 0.1, 0.2, 0.0, 0.0]), 1.0, 1.0),
            (Transfer::Parametric([2.0, 0.5, 0.5, 0.1, 0.2, 0.0, 0.0]), 0.1, 0.01),
        ] {
            let got = transfer.linear(code);
            assert!((got - linear).abs() < 2e-5, "{transfer:?} {code}: {got}, not {linear}");
        }
        // The two parts of BT.2020 meet; below 0 and above 1 the curve goes on.
        let knee = 4.5 * 0.018_053_968_510_807;
        let step = Transfer::Bt2020.linear(knee + 1e-9) - Transfer::Bt2020.linear(knee - 1e-9);
        assert!(step.abs() < 1e-6, "{step}");
        assert_eq!(Transfer::Srgb.linear(-0.5), -Transfer::Srgb.linear(0.5));
        assert!(Transfer::Srgb.linear(1.5) > 2.0);
        assert!(Transfer::parse("2.2").unwrap() == Transfer::Gamma(2.2));
        assert!(Transfer::parse("cineon").is_err() && Transfer::parse("-1").is_err());
    }
}
