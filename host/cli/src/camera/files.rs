//! The files of a drafted camera: the camera file and the tables that it names.

use camrig_base::output::OutputFile;
use camrig_base::{Error, Result};
use camrig_camera::draft::{Draft, Grade};
use camrig_camera::is_preset;
use camrig_fit::OPEN;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Refuses names of presets.
pub fn check_name(output: &Path) -> Result<()> {
    if is_preset(&output.to_string_lossy()) {
        return Err(Error::input(format!("a camera file called {}", output.display()))
            .help("names without a dot are reserved for presets: call it FILE.toml"));
    }
    Ok(())
}

/// Writes the file and its tables, all or none, and returns which: an existing identical table,
/// shared with another camera, is kept.
pub fn write(draft: &Draft, output: &Path, force: bool) -> Result<Vec<PathBuf>> {
    let directory = output.parent().unwrap_or(Path::new(""));
    // A file with open questions is no camera yet.
    if open(draft).is_empty() {
        draft.camera(directory).map_err(|e| e.at(format!("{} to be", output.display())))?;
    }
    let mut files = vec![(output.to_owned(), draft.text())];
    files.extend(draft.tables().into_iter().map(|(name, text)| (directory.join(name), text)));
    files.retain(|(path, text)| std::fs::read_to_string(path).ok().as_ref() != Some(text));
    let mut outputs = Vec::new();
    for (path, text) in &files {
        let mut output = OutputFile::create(path, force)?;
        output.write_all(text.as_bytes()).map_err(|e| Error::io("write", path, e))?;
        outputs.push(output);
    }
    outputs.into_iter().try_for_each(OutputFile::finish)?;
    Ok(files.into_iter().map(|(path, _)| path).collect())
}

/// Keys whose value is a question.
pub fn open(draft: &Draft) -> Vec<&str> {
    let plain = draft.entries.iter().map(|entry| (entry.key.path(), &entry.value));
    let more = draft.more.iter().map(|known| (&known.change.key[..], &known.change.value));
    let open = plain.chain(more).filter(|(_, value)| value.as_str() == Some(OPEN));
    open.map(|(key, _)| key).collect()
}

/// Prints what was written, and which values are typical.
pub fn tell(draft: &Draft, output: &Path, files: &[PathBuf]) {
    let names: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
    match names.is_empty() {
        true => eprintln!("{} already exists, unchanged", output.display()),
        false => eprintln!("wrote {}", names.join(", ")),
    }
    let typical = draft.entries.iter().filter(|entry| entry.basis.grade == Grade::Typical);
    let typical: Vec<String> =
        typical.map(|e| format!("{} = {}", e.key.name(), e.value)).collect();
    eprintln!(
        "{} of {} values are typical: {}",
        typical.len(),
        draft.entries.len(),
        typical.join(", ")
    );
}
