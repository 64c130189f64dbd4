//! `kind = "prescription"`: a lens file, and how the lens is used.

use super::Folder;
use super::file::LensFile;
use super::named_files::FileName;
use camrig_base::alternatives::Alternatives;
use camrig_base::toml_text::place_of_key;
use camrig_base::{Error, Result};
use camrig_prescription::{Conditions, Focus, Glass, Setup};

/// The prescription of a camera file; `None` where the file has no name.
pub(super) fn setup(file: &LensFile, text: &str, folder: &Folder<'_>) -> Result<Option<Setup>> {
    let Some(FileName(name)) = &file.file else { return Ok(None) };
    let place = |key| place_of_key(text, "lens", key);
    let focus = match (file.focus_distance_mm, file.focus_mtf_per_mm) {
        (Some(_), Some(_)) => {
            return Err(Error::input("both focus_distance_mm and focus_mtf_per_mm")
                .at(place("focus_mtf_per_mm"))
                .help("give one of them: each says where the sensor is"));
        }
        (Some(mm), None) => Focus::At(mm),
        (None, Some(per_mm)) => Focus::BestMtf(per_mm),
        (None, None) => Focus::AsDesigned,
    };
    let conditions = Conditions {
        object_distance_mm: file.object_distance_mm,
        focus,
        sensor_shift_mm: file.sensor_shift_mm.unwrap_or(0.0),
        stop_radius_mm: file.stop_radius_mm,
        reference_nm: file.reference_nm,
    };
    fn texts(list: &Option<Alternatives<String>>) -> &[String] {
        list.as_ref().map_or(&[], Alternatives::as_slice)
    }
    let glasses: Result<Vec<(String, Glass)>> = texts(&file.glass)
        .iter()
        .map(|text| Glass::named(text).map_err(|e| e.at(place("glass"))))
        .collect();
    Ok(Some(Setup {
        file: folder.path(name),
        glasses: glasses?,
        catalogues: texts(&file.glass_catalogue).iter().map(|name| folder.path(name)).collect(),
        configuration: file.configuration.as_ref().map(ToString::to_string),
        conditions,
    }))
}

#[cfg(test)]
mod tests {
    use crate::{Camera, Folder, LensKind};
    use camrig_base::Result;
    use camrig_prescription::{Conditions, Focus, Setup};
    use std::path::Path;

    fn setup(keys: &str) -> Result<Setup> {
        let text = crate::presets::file("mt9v024.toml").unwrap();
        let (head, rest) = text.split_once("[lens]").unwrap();
        let sensor = rest.split_once("[sensor]").unwrap().1;
        let lens = format!("[lens]\nkind = 'prescription'\nfile = 'a.zmx'\n{keys}\n");
        let text = format!("{head}{lens}[sensor]{sensor}");
        match Camera::parse(&text, "x", &Folder::BuiltIn)?.lens.kind {
            LensKind::Prescription(setup) => Ok(*setup),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_key_reaches_the_setup() {
        let keys = "object_distance_mm = 200.0\nfocus_distance_mm = inf\nsensor_shift_mm = -0.9\n\
                    stop_radius_mm = 0.5\nreference_nm = 550\nconfiguration = 2\n\
                    glass = ['HARZ=1.561:55', 'B=1.5:60']\nglass_catalogue = 'glasses'\n";
        let made = setup(keys).unwrap();
        assert_eq!(made.file, Path::new("a.zmx"));
        assert_eq!(made.catalogues, [Path::new("glasses")]);
        assert_eq!(made.configuration.as_deref(), Some("2"));
        let names: Vec<&str> = made.glasses.iter().map(|(name, _)| &name[..]).collect();
        assert_eq!(names, ["HARZ", "B"]);
        let conditions = Conditions {
            object_distance_mm: Some(200.0),
            focus: Focus::At(f64::INFINITY),
            sensor_shift_mm: -0.9,
            stop_radius_mm: Some(0.5),
            reference_nm: Some(550.0),
        };
        assert_eq!(made.conditions, conditions);
        let other = setup("focus_mtf_per_mm = 40\nconfiguration = 'tele'").unwrap();
        assert_eq!(other.conditions.focus, Focus::BestMtf(40.0));
        assert_eq!(other.configuration.as_deref(), Some("tele"));
    }

    #[test]
    fn what_a_key_cannot_mean_is_refused() {
        for (keys, words) in [
            ("focus_mtf_per_mm = 40\nfocus_distance_mm = 500", "give one of them"),
            ("object_distance_mm = -200.0", "object_distance_mm = -200"),
            ("stop_radius_mm = 0", "stop_radius_mm = 0"),
            ("glass = 'HARZ=1.561'", "key \"glass\""),
            ("sensor_shift_mm = nan", "sensor_shift_mm"),
        ] {
            let error = setup(keys).unwrap_err().to_string();
            assert!(error.contains(words), "{keys}: {error}");
        }
        let change = [("lens.stop_radius_mm", 0.5)];
        let error = Camera::load_with("mt9v024", change).unwrap_err().to_string();
        assert!(error.contains("means nothing for kind"), "{error}");
    }
}
