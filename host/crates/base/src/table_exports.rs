//! Exports of light meters and colour instruments that are no lines of a wavelength and its values,
//! rewritten as such lines.
//!
//! | export | how it is known |
//! | --- | --- |
//! | SPDX, IES TM-27-14 and -20 | an XML element `IESTM2714` |
//! | CGATS.17 and ISO 28178: Argyll `.sp`, i1Profiler | a line `BEGIN_DATA_FORMAT` |
//! | Sekonic, UPRtek and other lists | three or more lines such as `Spectral Data 380[nm],0.05` |

use crate::numbers::counted;
use crate::{Error, Result};
use std::collections::BTreeMap;

/// A header without a name for its column; wavelengths are in nm.
const UNNAMED: &str = ">>> nm";
/// Fewest lines of a list of labels with wavelengths.
const MIN_LABELS: usize = 3;
/// Numbers in names that are wavelengths, nm.
const NM: std::ops::RangeInclusive<f64> = 200.0..=3000.0;

/// An export as a table.
pub struct Export {
    /// The table's text.
    pub text: String,
    /// What was passed over.
    pub remark: Option<String>,
}

/// The table in an export; `None` for a text that is none.
///
/// # Errors
/// An export without spectra, or with fields that do not fit its own description.
pub fn table_of(text: &str) -> Result<Option<Export>> {
    if text.trim_start().starts_with('<') && text.contains("IESTM27") {
        return of_xml(text).map(Some);
    }
    if text.lines().any(|line| line.trim() == "BEGIN_DATA_FORMAT") {
        return of_cgats(text).map(Some);
    }
    Ok(of_labels(text))
}

fn unreadable(what: impl Into<String>) -> Error {
    Error::input(what).help("export it as CSV: wavelength_nm,NAME,... and below it the values")
}

/// `<SpectralData wavelength="380">0.05</SpectralData>`, whatever prefix the elements have.
fn of_xml(text: &str) -> Result<Export> {
    let (mut quantity, mut lines) = (String::new(), String::new());
    for piece in without_comments(text).split('<') {
        let Some((tag, content)) = piece.split_once('>') else { continue };
        let name = tag.split_whitespace().next().filter(|name| !name.starts_with('/'));
        let Some(name) = name else { continue };
        match name.rsplit(':').next().unwrap_or(name) {
            "SpectralQuantity" => quantity = content.trim().to_lowercase(),
            "SpectralData" => {
                let nm = tag.split_once("wavelength=").and_then(|(_, rest)| {
                    rest.get(1..)?.split(['"', '\'']).next().map(str::to_string)
                });
                let nm = nm.ok_or_else(|| unreadable("SpectralData without a wavelength"))?;
                lines.push_str(&format!("{nm};{}\n", content.trim()));
            }
            _ => {}
        }
    }
    if lines.is_empty() {
        return Err(unreadable("an SPDX file without SpectralData"));
    }
    let header = match &*quantity {
        "" => UNNAMED.to_string(),
        "relative" => "wavelength_nm;relative power".into(),
        "r-values" => "wavelength_nm;reflectance".into(),
        "t-values" => "wavelength_nm;transmittance".into(),
        named => format!("wavelength_nm;{named}"),
    };
    Ok(Export { text: format!("{header}\n{lines}"), remark: None })
}

fn without_comments(text: &str) -> String {
    let mut pieces = text.split("<!--");
    let first = pieces.next().unwrap_or("").to_string();
    let rest = pieces.filter_map(|piece| Some(piece.split_once("-->")?.1));
    rest.fold(first, |all, piece| all + piece)
}

/// Fields such as `SPEC_380` or `nm380`; each set of data is a curve.
fn of_cgats(text: &str) -> Result<Export> {
    let between = |begin: &str, end: &str| -> Vec<String> {
        let lines = text.lines().map(str::trim).skip_while(|line| *line != begin).skip(1);
        lines.take_while(|line| *line != end).flat_map(words).collect()
    };
    let fields = between("BEGIN_DATA_FORMAT", "END_DATA_FORMAT");
    let data = between("BEGIN_DATA", "END_DATA");
    let spectral = longest_group(fields.iter().enumerate().filter_map(|(at, field)| {
        let digits = field.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.').len();
        let nm: f64 = field[digits..].parse().ok()?;
        NM.contains(&nm).then(|| (field[..digits].to_lowercase(), (nm, at)))
    }));
    if spectral.len() < 2 {
        return Err(unreadable("CGATS data without fields of wavelengths (SPEC_380, nm380, ...)"));
    }
    if data.is_empty() || !data.len().is_multiple_of(fields.len()) {
        let what = format!("{} values in CGATS data of {} fields", data.len(), fields.len());
        return Err(unreadable(what));
    }
    let norm = text.lines().find_map(|line| line.trim().strip_prefix("SPECTRAL_NORM"));
    let norm: f64 = norm.and_then(|n| n.trim().trim_matches('"').parse().ok()).unwrap_or(1.0);
    let sets: Vec<&[String]> = data.chunks_exact(fields.len()).collect();
    let name = |set: usize| {
        let names = ["SAMPLE_NAME", "SAMPLE_ID", "SAMPLEID"];
        let at = names.iter().find_map(|name| fields.iter().position(|field| field == name));
        at.map_or_else(|| format!("set {}", set + 1), |at| sets[set][at].clone())
    };
    let mut table = match sets.len() {
        1 => UNNAMED.to_string(),
        _ => (0..sets.len()).fold("wavelength_nm".to_string(), |all, set| all + ";" + &name(set)),
    };
    for (nm, at) in spectral {
        table.push_str(&format!("\n{nm}"));
        for set in &sets {
            let value: f64 = set[at].parse().map_err(|_| {
                unreadable(format!("{:?} in field {} is no number", set[at], fields[at]))
            })?;
            table.push_str(&format!(";{}", value / norm));
        }
    }
    Ok(Export { text: table, remark: None })
}

/// The words of a line, of which those in quotes may have blanks.
fn words(line: &str) -> Vec<String> {
    let quoted = line.split('"').enumerate();
    quoted
        .flat_map(|(i, piece)| match i % 2 {
            1 => vec![piece.to_string()],
            _ => piece.split_whitespace().map(str::to_string).collect(),
        })
        .collect()
}

/// Lines whose first fields are alike but for a wavelength in nm. Others become blank, so that
/// lines keep their numbers.
fn of_labels(text: &str) -> Option<Export> {
    let lines: Vec<&str> = text.lines().collect();
    let listed = longest_group(lines.iter().enumerate().filter_map(|(line, text)| {
        let (label, values) = text.split_once(['\t', ';', ','])?;
        let separator = &text[label.len()..text.len() - values.len()];
        let (label, nm) = labelled(label)?;
        Some((format!("{label}{separator}"), (line, format!("{nm}{separator}{values}"))))
    }));
    if listed.len() < MIN_LABELS {
        return None;
    }
    let rest = lines.len() - listed.len();
    let columns = listed[0].1.split(['\t', ';']).count();
    let mut table = vec![String::new(); lines.len()];
    if let Some(above) = listed[0].0.checked_sub(1).filter(|_| columns <= 2) {
        table[above] = UNNAMED.into();
    }
    for (line, row) in listed {
        table[line] = row;
    }
    let remark =
        format!("{} beside its list of wavelengths are passed over", counted(rest, "line"));
    Some(Export { text: table.join("\n"), remark: (rest > 0).then_some(remark) })
}

/// A label without its wavelength, and that, in nm: `Spectral Data 380[nm]`.
fn labelled(label: &str) -> Option<(String, f64)> {
    let end = label.to_ascii_lowercase().rfind("nm")?;
    let before = label[..end].trim_end_matches([' ', '[', '(']);
    let is_number = |c: char| c.is_ascii_digit() || c == '.';
    let start = before.trim_end_matches(is_number).len();
    let nm: f64 = before[start..].parse().ok()?;
    let rest = format!("{}{}", &before[..start], &label[before.len()..]);
    NM.contains(&nm).then_some((rest, nm))
}

/// The members of the largest group, in their order.
fn longest_group<T>(members: impl Iterator<Item = (String, T)>) -> Vec<T> {
    let mut groups: BTreeMap<String, Vec<T>> = BTreeMap::new();
    for (group, member) in members {
        groups.entry(group).or_default().push(member);
    }
    groups.into_values().max_by_key(Vec::len).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use crate::table::{SpectralTable, Wanted};

    const VALUES: [f64; 3] = [0.5, 0.25, 0.75];

    fn read(text: &str) -> SpectralTable {
        let mut table = SpectralTable::parse(text).unwrap_or_else(|e| panic!("{text}: {e}"));
        table.convert(Wanted::Power).unwrap_or_else(|e| panic!("{text}: {e}"));
        table
    }

    #[test]
    fn exports_of_light_meters_are_read() {
        let cgats = "NUMBER_OF_FIELDS 3\nBEGIN_DATA_FORMAT\nSPEC_380 SPEC_385 SPEC_390\n\
                     END_DATA_FORMAT\nNUMBER_OF_SETS 1\nBEGIN_DATA\n";
        for text in [
            "<?xml version=\"1.0\"?>\n<IESTM2714 xmlns=\"http://x\">\n<!-- <SpectralData \
             wavelength=\"1\">9</SpectralData> --><SpectralQuantity>irradiance</SpectralQuantity>\
             <SpectralData wavelength=\"380\">0.5</SpectralData>\n\
             <SpectralData wavelength=\"385\"> 0.25 </SpectralData>\
             <SpectralData wavelength=\"390\">0.75</SpectralData></IESTM2714>",
            "<t:IESTM2714 xmlns:t='http://x'><t:SpectralQuantity>relative</t:SpectralQuantity>\
             <t:SpectralData wavelength='380'>0.5</t:SpectralData><t:SpectralData \
             wavelength='385'>2.5e-1</t:SpectralData><t:SpectralData \
             wavelength='390'>0.75</t:SpectralData></t:IESTM2714>",
            &format!("SPECT\n\nSPECTRAL_NORM \"1.0\"\n{cgats}0.5 0.25 0.75\nEND_DATA\n"),
            &format!("SPECT\nSPECTRAL_NORM \"100\"\n{cgats}50 25\n75\nEND_DATA\n"),
            "CGATS.17\nBEGIN_DATA_FORMAT\nSAMPLE_ID SAMPLE_NAME nm380 nm385 nm390\n\
             END_DATA_FORMAT\nBEGIN_DATA\n1 \"a b\" 0.5 0.25 0.75\nEND_DATA\n",
            "Date Saved,01/01/2020\nTcp [K],3262\nPeak [nm],555\nSpectral Data 380[nm],0.5\n\
             Spectral Data 385[nm],0.25\nSpectral Data 390[nm],0.75\nTail,1\n",
            "Model Name\tMK350\nLUX\t695\n380nm\t0.5\n385nm\t0.25\n390nm\t0.75\n",
            "380 nm;0,5\r\n385 nm;0,25\r\n390 nm;0,75\r\n",
        ] {
            let table = read(text);
            assert_eq!(table.wavelength_nm, [380.0, 385.0, 390.0], "{text}");
            assert_eq!(table.curves.len(), 1, "{text}");
            assert_eq!(table.curves[0].1, VALUES, "{text}");
        }
    }

    #[test]
    fn one_of_several_sets_is_chosen_by_its_name() {
        let text = "CGATS.17\nBEGIN_DATA_FORMAT\nSAMPLE_NAME nm400 nm500\nEND_DATA_FORMAT\n\
                    BEGIN_DATA\nlamp 1 2\n\"the sky\" 3 4\nEND_DATA\n";
        let table = SpectralTable::parse(text).unwrap();
        assert_eq!(table.column("the sky"), Some(1));
        let mut sky = SpectralTable::parse_column(text, Some("The Sky")).unwrap();
        sky.convert(Wanted::Power).unwrap();
        assert_eq!(sky.curves, [("the sky".to_string(), vec![3.0, 4.0])]);
    }

    #[test]
    fn exports_without_spectra_are_refused() {
        for (text, said) in [
            ("<IESTM2714></IESTM2714>", "without SpectralData"),
            (
                "A\nBEGIN_DATA_FORMAT\nLAB_L LAB_A\nEND_DATA_FORMAT\nBEGIN_DATA\n1 2\nEND_DATA",
                "CGATS",
            ),
            (
                "A\nBEGIN_DATA_FORMAT\nnm400 nm500\nEND_DATA_FORMAT\nBEGIN_DATA\n1 2 3\nEND_DATA",
                "3 values",
            ),
        ] {
            let error = SpectralTable::parse(text).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
