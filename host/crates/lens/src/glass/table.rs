//! The built-in glasses.

use super::{Dispersion, Glass, key, model};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// Schott's lead glasses that are no longer made and whose names other makers use for other
/// glasses: n_d and V_d. The figures are those of Schott's catalogue, where six-digit code and
/// formula agree with them; the quadratic model of Robb and Mercado (Appl. Opt. 22, 1198 (1983))
/// gives n_d to 1e-5 and V_d to 0.13. Dispersion follows by the normal line.
const OLD_SCHOTT: &[(&str, f64, f64)] = &[
    ("BAF4", 1.60562, 43.93),
    ("BK6", 1.53113, 62.15),
    ("BK8", 1.52015, 63.69),
    ("BK10", 1.49782, 66.95),
    ("F1", 1.62588, 35.70),
    ("F3", 1.61293, 37.04),
    ("F4", 1.61659, 36.63),
    ("F6", 1.63636, 35.34),
    ("F7", 1.62536, 35.56),
    ("F13", 1.62237, 36.04),
];

/// What to say of a glass whose dispersion is not tabulated.
pub(super) fn note_on(maker: &str, glass: &Glass) -> Option<String> {
    let old = maker == "schott" && OLD_SCHOTT.iter().any(|(name, ..)| *name == glass.name);
    old.then(|| {
        format!(
            "{} is Schott's glass of that name, no longer made; its dispersion follows from n_d \
             and V_d",
            glass.name
        )
    })
}

/// The glasses of one name: maker and glass.
pub(super) type Makers = Vec<(String, Glass)>;

/// The built-in table, by [`key`]; makers in the table's order (Schott first).
pub(super) fn built_in() -> &'static BTreeMap<String, Makers> {
    static TABLE: OnceLock<BTreeMap<String, Makers>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let mut table = BTreeMap::<String, Makers>::new();
        let lines = include_str!("../glasses.csv").lines().filter(|l| !l.starts_with('#'));
        for (maker, glass) in lines.filter_map(parse_row) {
            table.entry(key(&glass.name)).or_default().push((maker, glass));
        }
        for &(name, nd, vd) in OLD_SCHOTT {
            let glass = Glass { name: name.to_owned(), ..model(nd, vd, 0.0) };
            table.entry(key(name)).or_default().push(("schott".to_owned(), glass));
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
        "n" => Dispersion::Table(pairs(&values).iter().map(|p| [p[0] * 1e3, p[1]]).collect()),
        _ => return None,
    };
    let range_nm = [low.parse::<f64>().ok()? * 1e3, high.parse::<f64>().ok()? * 1e3];
    Some((maker.to_owned(), Glass { name: name.to_owned(), dispersion, range_nm }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_of_the_table_is_understood_and_physical() {
        let rows: Vec<&str> =
            include_str!("../glasses.csv").lines().filter(|l| !l.starts_with('#')).collect();
        for row in &rows {
            let (_, glass) = parse_row(row).unwrap_or_else(|| panic!("{row}"));
            let middle = glass.range_nm[0].max(400.0).min(glass.range_nm[1]);
            let n = glass.index(middle).unwrap();
            assert!((1.3..4.2).contains(&n), "{row}: {n}");
        }
        assert!(rows.len() > 1000);
    }
}
