//! Paths in a manifest: names of scenes and illuminants, and patterns of frames.

use crate::{CapturedScene, Light};
use camrig_base::{Error, Result};
use camrig_light::Illuminant;
use camrig_scene as scene;
use std::path::{Path, PathBuf};

/// Makes names of files in a capture's light and scene relative to `folder`; names of built-in
/// illuminants and scenes are kept.
pub fn resolve(folder: &Path, light: &mut Option<Light>, captured: &mut Option<CapturedScene>) {
    let from = |name: &str| folder.join(name).to_string_lossy().into_owned();
    if let Some(illuminant) = light.as_mut().and_then(|l| l.illuminant.as_mut())
        && Illuminant::is_file(illuminant)
    {
        *illuminant = from(illuminant);
    }
    if let Some(captured) = captured
        && scene::is_file(&captured.scene)
    {
        captured.scene = from(&captured.scene);
    }
}

/// The files that names and patterns below `root` match, in the order given.
pub fn expand_all(root: &Path, names: &[PathBuf]) -> Result<Vec<PathBuf>> {
    if names.is_empty() {
        return Err(Error::input("no files").at("key \"files\"").help("name the frames' files"));
    }
    let expanded: Vec<_> = names.iter().map(|name| expand(root, name)).collect::<Result<_>>()?;
    let files: Vec<PathBuf> = expanded.into_iter().flatten().collect();
    for (i, file) in files.iter().enumerate() {
        if files[..i].contains(file) {
            return Err(Error::input(format!("{} twice in one list", file.display()))
                .at("key \"files\"")
                .help("a frame counts once"));
        }
    }
    Ok(files)
}

/// The files below `root` that match `pattern`, sorted by name.
fn expand(root: &Path, pattern: &Path) -> Result<Vec<PathBuf>> {
    let base = glob::Pattern::escape(&root.to_string_lossy());
    let full = Path::new(&base).join(pattern);
    let wrong = |what: String| Error::input(what).at("key \"files\"");
    let paths = glob::glob(&full.to_string_lossy())
        .map_err(|e| wrong(format!("pattern {pattern:?}: {}", e.msg)))?;
    let mut files = Vec::new();
    for path in paths {
        files.push(path.map_err(|e| wrong(format!("cannot read {:?}: {e}", e.path())))?);
    }
    if files.is_empty() {
        return Err(wrong(format!("no file matches {pattern:?}"))
            .help(format!("the pattern is relative to {}", root.display())));
    }
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_relative_to_the_set_and_built_in_names_are_kept() {
        let named = |illuminant: &str, scene: &str| {
            let mut light =
                Some(Light { illuminant: Some(illuminant.into()), ..Light::default() });
            let mut seen = Some(CapturedScene { scene: scene.into(), angle_deg: None });
            resolve(Path::new("set"), &mut light, &mut seen);
            (light.and_then(|l| l.illuminant).unwrap(), seen.unwrap().scene)
        };
        for (illuminant, scene) in [("D65", "dots:pitch=0.05"), ("blackbody:3200", "uniform:0.18")]
        {
            assert_eq!(named(illuminant, scene), (illuminant.into(), scene.into()));
        }
        assert_eq!(named("lamp.csv", "a/b.mat"), ("set/lamp.csv".into(), "set/a/b.mat".into()));
        assert_eq!(named("/lamp.csv", "/b.mat").0, "/lamp.csv");
    }
}
