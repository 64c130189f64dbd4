//! A lens file and how it is used: what a camera file and the command line say alike.

use super::{Catalogue, Conditions, Glass, Prescription, System, read_configuration};
use camrig_base::Result;
use camrig_glass::files;
use std::path::PathBuf;

/// A prescription in a file, the glasses it needs, and how the lens is used.
///
/// # Example
/// A singlet of which the camera is focused at half a metre:
/// ```no_run
/// use camrig_lens::system::Focus;
/// use camrig_lens::{Conditions, Setup};
///
/// let conditions = Conditions { focus: Focus::At(500.0), ..Conditions::default() };
/// let setup = Setup { file: "singlet.toml".into(), conditions, ..Setup::default() };
/// println!("image at {} mm", setup.system()?.paraxial.image_distance_mm);
/// # Ok::<(), camrig_base::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Setup {
    /// The prescription: `.zmx`, `.seq` or `.toml`.
    pub file: PathBuf,
    /// Glasses under names that the file uses, before those of all catalogues
    /// ([`Glass::named`]).
    pub glasses: Vec<(String, Glass)>,
    /// Glass catalogues (`.agf`) or folders of them, before those beside the file.
    pub catalogues: Vec<PathBuf>,
    /// Configuration of a file with several, by number from 1 or by name; `None` takes the active
    /// one.
    pub configuration: Option<String>,
    /// How the lens is used.
    pub conditions: Conditions,
}

impl Setup {
    /// The lens as the file has it.
    ///
    /// # Errors
    /// A file or catalogue that cannot be read, what is wrong in it, a configuration that it does
    /// not have.
    pub fn prescription(&self) -> Result<Prescription> {
        let mut glasses = Catalogue::default();
        for (name, glass) in &self.glasses {
            glasses.insert(name, glass.clone());
        }
        for file in self.catalogue_files()? {
            files::add(&mut glasses, &file)?;
        }
        read_configuration(&self.file, &glasses, self.configuration.as_deref())
    }

    /// The lens ready to trace.
    ///
    /// # Errors
    /// Those of [`Self::prescription`] and [`System::new`].
    pub fn system(&self) -> Result<System> {
        System::new(self.prescription()?, self.conditions).map_err(|e| e.at(self.file.display()))
    }

    /// The files among [`Self::catalogues`] and in their folders.
    ///
    /// # Errors
    /// A name that does not exist, a folder without a catalogue.
    pub fn catalogue_files(&self) -> Result<Vec<PathBuf>> {
        let files: Result<Vec<Vec<PathBuf>>> =
            self.catalogues.iter().map(|path| files::named(path)).collect();
        Ok(files?.concat())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: &str = "RDM; EPD 2; DIM M; WL 550; YAN 0; SO 0 1e13; S 10 2 OWN; S -10 9; SI 0 0";
    /// n = 1.5 by formula 2.
    const AGF: &str = "CC own\nNM OWN 2 500600 1.5 60 0 1 0\nCD 1.25 0 0 0 0 0\nLD 0.4 0.7\n";

    #[test]
    fn glasses_come_from_catalogues_elsewhere_and_from_the_setup() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["lens", "glass", "none"] {
            std::fs::create_dir(at(name)).unwrap();
        }
        std::fs::write(at("lens/lens.seq"), LENS).unwrap();
        std::fs::write(at("glass/melts.AGF"), AGF).unwrap();
        let plain = Setup { file: at("lens/lens.seq"), ..Setup::default() };
        assert!(plain.system().unwrap_err().to_string().contains("no glass called \"OWN\""));
        let with =
            |catalogue: &str| Setup { catalogues: vec![at(catalogue)], ..plain.clone() }.system();
        // Thick lens, n 1.5, radii 10 and -10, 2 mm thick: 1/f = 0.5 (0.2 - 0.5·2/(1.5·100)).
        for catalogue in ["glass", "glass/melts.AGF"] {
            let efl = with(catalogue).unwrap().paraxial.efl_mm;
            assert!((efl - 300.0 / 29.0).abs() < 1e-9, "{efl}");
        }
        assert!(with("none").unwrap_err().to_string().contains("no glass catalogue"));
        assert!(with("nowhere").unwrap_err().to_string().contains("nowhere"));
        let glasses = vec![Glass::named("OWN=1.5:200").unwrap()];
        let own = Setup { glasses, catalogues: vec![at("glass")], ..plain }.prescription();
        assert_eq!(own.unwrap().surfaces.len(), 2);
    }

    #[test]
    fn a_file_with_one_configuration_has_no_second() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("lens.seq");
        std::fs::write(&file, LENS.replace("OWN", "NBK7")).unwrap();
        let with = |name: &str| Setup {
            file: file.clone(),
            configuration: Some(name.into()),
            ..Setup::default()
        };
        assert!(with("1").system().is_ok());
        assert!(with("2").system().unwrap_err().to_string().contains("configuration \"2\""));
    }
}
