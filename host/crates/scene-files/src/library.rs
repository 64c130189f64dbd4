//! A library of scenes: a directory of stored scenes with a manifest `library.toml` that lists
//! them in order.
//! ```toml
//! format = "scene-library/1"
//! scenes = ["fruit", "street-at-night"]   # sub-directories, each a stored scene
//! ```

use super::Scene;
use super::cube::Cube;
use super::level::check_absolute;
use super::preview;
use super::stored::{self, Description};
use camrig_base::output::{OutputDir, write_file};
use camrig_base::{Error, ErrorCode, Result, toml_text};
use camrig_formats::png;
use camrig_light::Illuminant;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const MANIFEST: &str = "library.toml";
const FORMAT: &str = "scene-library/1";
/// Longest side of a scene's preview, pixels.
const PREVIEW: usize = 512;

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    format: String,
    scenes: Vec<String>,
}

/// A library of stored scenes.
#[derive(Debug)]
pub struct Library {
    directory: PathBuf,
    scenes: Vec<String>,
}

impl Library {
    /// Opens a library.
    ///
    /// # Errors
    /// No manifest, or one that cannot be read.
    pub fn open(directory: &Path) -> Result<Self> {
        let path = directory.join(MANIFEST);
        let text = std::fs::read_to_string(&path).map_err(|e| {
            Error::io("read", &path, e)
                .help("add a scene to make it")
                .with_code(ErrorCode::NoLibrary)
        })?;
        let manifest: Manifest = toml_text::read(&text).map_err(|e| e.at(path.display()))?;
        if manifest.format != FORMAT {
            return Err(Error::unsupported(format!("format = {:?}", manifest.format))
                .at(path.display())
                .help(format!("this program reads {FORMAT}")));
        }
        Ok(Self { directory: directory.into(), scenes: manifest.scenes })
    }

    /// Opens a library, or starts an empty one where there is none yet; nothing is written before
    /// the first scene is added.
    ///
    /// # Errors
    /// A manifest that cannot be read.
    pub fn open_or_new(directory: &Path) -> Result<Self> {
        if directory.join(MANIFEST).exists() {
            return Self::open(directory);
        }
        Ok(Self { directory: directory.into(), scenes: Vec::new() })
    }

    /// The descriptions of the scenes with their directories, in the manifest's order.
    ///
    /// # Errors
    /// A description that cannot be read.
    pub fn scenes(&self) -> Result<Vec<(PathBuf, Description)>> {
        let directories = self.scenes.iter().map(|name| self.directory.join(name));
        directories.map(|d| Ok((d.clone(), Description::read(&d)?))).collect()
    }

    /// Stores a cube with its preview and lists it in the manifest; returns the scene's directory.
    /// `progress` is called with the index of each band before it is written.
    ///
    /// # Errors
    /// A name that is no file name, a scene of that name unless `force`, a radiance without an
    /// absolute scale, values that the cube refuses, files that cannot be written.
    pub fn add(
        &mut self,
        cube: &Cube,
        about: &Description,
        force: bool,
        mut progress: impl FnMut(usize),
    ) -> Result<PathBuf> {
        let name = &about.name;
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if name.is_empty() || name.starts_with('.') || !name.chars().all(plain) {
            return Err(Error::input(format!("a scene named {name:?}"))
                .help("use letters, digits, '-', '_' and '.': the name is that of a directory"));
        }
        check_absolute(cube)?;
        std::fs::create_dir_all(&self.directory)
            .map_err(|e| Error::io("create", &self.directory, e))?;
        let place = self.directory.join(name);
        let output = OutputDir::create(&place, force)?;
        stored::write(output.path(), about, |band, plane| {
            progress(band);
            *plane = cube.band(band)?;
            Ok(())
        })?;
        let picture = preview::render(cube, &Illuminant::parse("D65")?, PREVIEW)?;
        output.write("preview.png", &png::encode_rgb(&picture)?)?;
        output.finish()?;
        if !self.scenes.contains(name) {
            self.scenes.push(name.clone());
            let manifest = Manifest { format: FORMAT.into(), scenes: self.scenes.clone() };
            let text = toml::to_string(&manifest)
                .map_err(|e| Error::internal(format!("cannot write {MANIFEST}: {e}")))?;
            write_file(&self.directory.join(MANIFEST), true, text.as_bytes())?;
        }
        Ok(place)
    }
}

/// A description for a cube, with empty texts.
pub fn describe(cube: &Cube, name: &str) -> Description {
    Description::new(name, cube.quantity(), cube.size(), &cube.bands())
}
