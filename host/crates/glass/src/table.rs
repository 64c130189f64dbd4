//! The built-in glasses.

use crate::{Dispersion, Glass, key};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// What to say of a glass whose dispersion is not a maker's formula.
pub(super) fn note_on(maker: &str, glass: &Glass) -> Option<String> {
    let name = &glass.name;
    let old = match maker {
        "schott" => format!("{name} is Schott's glass of that name, no longer made"),
        _ => format!("{name} is the material of {}", maker.to_ascii_uppercase()),
    };
    match glass.dispersion {
        Dispersion::Model { .. } => {
            Some(format!("{old}; its dispersion follows from n_d and V_d"))
        }
        Dispersion::Buchdahl(_) => Some(format!(
            "{old}; its index follows the fit of Robb and Mercado (1983), good to 1e-4 from 400 \
             to 700 nm"
        )),
        _ => None,
    }
}

/// The glasses of one name: maker and glass.
pub(super) type Makers = Vec<(String, Glass)>;

/// The built-in table, by [`key`]; makers in the table's order (Schott first).
pub(super) fn built_in() -> &'static BTreeMap<String, Makers> {
    static TABLE: OnceLock<BTreeMap<String, Makers>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let mut table = BTreeMap::<String, Makers>::new();
        let lines = include_str!("glasses.csv").lines().filter(|l| !l.starts_with('#'));
        for (maker, glass) in lines.filter_map(parse_row) {
            table.entry(key(&glass.name)).or_default().push((maker, glass));
        }
        for makers in table.values_mut() {
            makers.sort_by_key(|(maker, _)| maker != "schott");
        }
        table
    })
}

/// A row of `glasses.csv`; a test checks that every row is understood.
fn parse_row(line: &str) -> Option<(String, Glass)> {
    let fields: Vec<&str> = line.split(',').collect();
    let [maker, name, formula, low, high, coefficients] = fields[..] else { return None };
    let values: Vec<f64> =
        coefficients.split(' ').map(str::parse).collect::<std::result::Result<_, _>>().ok()?;
    let pairs = |v: &[f64]| v.chunks_exact(2).map(|p| [p[0], p[1]]).collect::<Vec<_>>();
    let series = |squared| {
        let terms = [vec![[values[0], 0.0]], pairs(&values[1..])].concat();
        Dispersion::PowerSeries { squared, terms }
    };
    let dispersion = match formula {
        "1" | "2" => {
            let mut terms = pairs(&values[1..]);
            if formula == "1" {
                terms.iter_mut().for_each(|t| t[1] *= t[1]);
            }
            Dispersion::Sellmeier { offset: values[0], terms, poles: Vec::new(), square: 0.0 }
        }
        "3" => series(true),
        "5" => series(false),
        "b" => Dispersion::Buchdahl(<[f64; 3]>::try_from(values).ok()?),
        "m" => match values[..] {
            [nd, vd] => Dispersion::Model { nd, vd, dpgf: 0.0 },
            _ => return None,
        },
        "n" => Dispersion::Table(pairs(&values).iter().map(|p| [p[0] * 1e3, p[1]]).collect()),
        _ => return None,
    };
    let range_nm = [low.parse::<f64>().ok()? * 1e3, high.parse::<f64>().ok()? * 1e3];
    Some((maker.to_owned(), Glass { name: name.to_owned(), dispersion, range_nm }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Indices that another program computes from the makers' spreadsheets.
    #[test]
    fn indices_agree_with_another_program_reading_other_files() {
        let rows: Vec<&str> =
            include_str!("makers.csv").lines().filter(|l| !l.starts_with('#')).collect();
        assert!(rows.len() > 300);
        for row in rows {
            let fields: Vec<&str> = row.split(',').collect();
            let makers = &built_in()[&key(fields[1])];
            let (_, glass) = makers.iter().find(|(maker, _)| maker == fields[0]).unwrap();
            for (nm, known) in [404.6561, 587.5618, 852.1].into_iter().zip(&fields[2..]) {
                let n = glass.index(nm).unwrap();
                assert!((n - known.parse::<f64>().unwrap()).abs() < 1e-6, "{row}: {n} at {nm} nm");
            }
        }
    }

    /// Old Schott glasses: n_d and V_d of Schott's catalogue of 1983.
    #[test]
    fn old_glasses_have_the_figures_of_their_catalogue() {
        for (name, nd, vd) in [
            ("SK16", 1.62041, 60.33),
            ("LAK9", 1.69100, 54.71),
            ("BAK4", 1.56883, 56.13),
            ("LAFN2", 1.74400, 44.72),
            ("SF8", 1.68893, 31.18),
            ("BAFN10", 1.67003, 47.11),
            ("KF9", 1.52341, 51.49),
        ] {
            let (maker, glass) = &built_in()[&key(name)][0];
            let (n, v) = glass.nd_vd();
            assert!(maker == "schott" && (n - nd).abs() < 1.5e-5, "{name}: {n}");
            assert!((v - vd).abs() < 0.3, "{name}: {v}");
            assert!(note_on(maker, glass).unwrap().contains("no longer made"));
        }
    }

    /// Measurements other than the sources of the table: germanium by Icenogle (1976), silicon by
    /// Edwards and Ochoa (1980; 4e-3 apart), fluorite by Li (1980); zinc selenide and sulphide as
    /// their makers print them; IRG26 of Schott is IG6 of Vitron.
    #[test]
    fn infrared_materials_agree_with_other_measurements() {
        for (name, um, n, most) in [
            ("GERMANIUM", 10.0, 4.0043, 1e-3),
            ("SILICON", 5.0, 3.4261, 5e-3),
            ("ZNSE", 10.6, 2.4028, 1e-4),
            ("ZNS", 10.0, 2.2002, 1e-3),
            ("CAF2", 5.0, 1.3990, 1e-4),
            ("IG6", 10.0, 2.7781, 1e-4),
            ("IRG26", 10.0, 2.7781, 1e-4),
        ] {
            let (_, glass) = &built_in()[&key(name)][0];
            let found = glass.index(um * 1e3).unwrap();
            assert!((found - n).abs() < most, "{name}: {found}");
        }
    }

    #[test]
    fn every_row_of_the_table_is_understood_and_physical() {
        let rows: Vec<&str> =
            include_str!("glasses.csv").lines().filter(|l| !l.starts_with('#')).collect();
        for row in &rows {
            let (_, glass) = parse_row(row).unwrap_or_else(|| panic!("{row}"));
            let middle = glass.range_nm[0].max(400.0).min(glass.range_nm[1]);
            let n = glass.index(middle).unwrap();
            assert!((1.3..4.2).contains(&n), "{row}: {n}");
        }
        assert!(rows.len() > 1900);
    }
}
