//! A folder whose pictures or cubes are taken while another program writes them, in natural order.
//!
//! A file counts once it is complete: its size and time of change stay the same from one look to
//! the next, and it can be read to its end. Files must come in order: one that sorts before another
//! that was taken is an error, and numbers go up by one. The sequence ends when a file `end` lies
//! in the folder and all others are taken, or when for a stated time nothing new has come.

use super::folder::{check_one_kind, kind_of_options, list, name_of, numbered, spec, times};
use super::{SceneFrame, SceneSequence};
use crate::cube::Cube;
use crate::open_file;
use camrig_base::{Error, Result, natural_order};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// Time between two looks. A trade: short compared with a frame's rendering, long enough that a
/// writer at work changes the file in between; what cannot be read is tried again in any case.
const LOOK: Duration = Duration::from_millis(100);
/// Name of the file that ends a sequence.
const END: &str = "end";

/// A folder that is being written.
pub struct Watched {
    folder: PathBuf,
    name: String,
    options: String,
    rate_hz: Option<f64>,
    wait: Duration,
    taken: BTreeSet<PathBuf>,
    newest: Option<PathBuf>,
    notes: Vec<String>,
}

/// What a look at the folder found.
enum Look {
    /// The next file, which is complete.
    Taken(PathBuf, Cube),
    /// All files are taken, and no more will come.
    End,
    /// The next file is not there.
    Nothing,
    /// It is there, or a later one is, and this is the matter.
    Not(Error),
}

/// Size and time of change of a file.
type Stamp = (PathBuf, u64, Option<SystemTime>);

impl Watched {
    /// Watches a folder; `options` are those of each of its files. It waits for each as long as
    /// `wait` says.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn open(
        folder: &Path,
        options: &str,
        rate_hz: Option<f64>,
        wait: Duration,
    ) -> Result<Self> {
        list(folder)?;
        Ok(Self {
            folder: folder.into(),
            name: folder.display().to_string(),
            options: kind_of_options(options)?.1,
            rate_hz,
            wait,
            taken: BTreeSet::new(),
            newest: None,
            notes: Vec::new(),
        })
    }

    /// Looks once; `before` is what the look before saw of the next file.
    fn look(&self, before: &mut Option<Stamp>) -> Result<Look> {
        let files = list(&self.folder)?.files;
        check_one_kind(&self.folder, &files)?;
        let mut left = files.into_iter().filter(|file| !self.taken.contains(file));
        let Some(next) = left.next() else {
            let ended = self.folder.join(END).exists();
            return Ok(if ended { Look::End } else { Look::Nothing });
        };
        if let Some(newest) = &self.newest {
            let (newest_name, next_name) = (name_of(newest), name_of(&next));
            if natural_order(&next_name) < natural_order(&newest_name) {
                return Err(Error::input(format!("{next_name} came after {newest_name}"))
                    .at(&self.name)
                    .help("while a folder is watched, its files must come in natural order"));
            }
            if let (Some((_, last)), Some((_, number))) = (numbered(newest), numbered(&next))
                && Some(number) != last.checked_add(1)
            {
                return Ok(Look::Not(
                    Error::input(format!("{next_name} follows {newest_name}"))
                        .at(&self.name)
                        .help("while a folder is watched, numbers go up by one"),
                ));
            }
        }
        let about = std::fs::metadata(&next).map_err(|e| Error::io("read", &next, e))?;
        let stamp = (next.clone(), about.len(), about.modified().ok());
        if before.replace(stamp.clone()) != Some(stamp) {
            return Ok(Look::Nothing);
        }
        // A cube's samples are read when they are asked for: one band tells whether they are there.
        let opened = open_file(&spec(&next, &self.options))
            .and_then(|cube| cube.band(0).map(|_| cube))
            .map_err(|e| e.at(next.display()));
        Ok(opened.map_or_else(Look::Not, |cube| Look::Taken(next, cube)))
    }
}

impl SceneSequence for Watched {
    fn name(&self) -> &str {
        &self.name
    }

    fn is_timed(&self) -> bool {
        self.rate_hz.is_some()
    }

    fn next_frame(&mut self) -> Result<Option<SceneFrame>> {
        let (mut before, mut refused) = (None, None);
        let mut changed = Instant::now();
        loop {
            let seen = before.clone();
            match self.look(&mut before)? {
                Look::End => return Ok(None),
                Look::Taken(file, cube) => {
                    let number = self.taken.len() as u64;
                    let name = spec(&file, &self.options);
                    self.taken.insert(file.clone());
                    self.newest = Some(file);
                    let times = times(number, self.rate_hz);
                    return Ok(Some(SceneFrame::new(number, times, name, || Ok(cube))));
                }
                Look::Not(error) => refused = Some(error),
                Look::Nothing => {}
            }
            if before != seen {
                changed = Instant::now();
            }
            if changed.elapsed() >= self.wait {
                break;
            }
            std::thread::sleep(LOOK.min(self.wait));
        }
        let waited = self.wait.as_secs_f64();
        if let Some(error) = refused {
            let help = format!("nothing has changed for {waited} s: its writer may have stopped");
            return Err(error.help(help));
        }
        let Some(newest) = &self.newest else {
            return Err(Error::input(format!("no scene came in {waited} s"))
                .at(&self.name)
                .help("wait longer, or see whether its writer writes into this folder"));
        };
        self.notes.push(format!(
            "nothing came after {} for {waited} s: the sequence ends there (a file called {END:?} \
             in the folder ends it at once)",
            name_of(newest)
        ));
        Ok(None)
    }

    fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn png(code: u8) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 4, 3);
        encoder.set_color(png::ColorType::Rgb);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&[code; 36]).unwrap();
        writer.finish().unwrap();
        bytes
    }

    fn watch(folder: &Path, wait_ms: u64) -> Watched {
        Watched::open(folder, "", Some(10.0), Duration::from_millis(wait_ms)).unwrap()
    }

    #[test]
    fn files_count_once_they_are_whole_and_a_file_ends_the_sequence() {
        let dir = tempfile::tempdir().unwrap();
        let (at, bytes) = (dir.path().to_owned(), png(128));
        let half = bytes.len() / 2;
        let writer = std::thread::spawn(move || {
            for number in 9..12 {
                let file = at.join(format!("f{number}.png"));
                fs::write(&file, &bytes[..half]).unwrap();
                std::thread::sleep(Duration::from_millis(350));
                fs::write(&file, &bytes).unwrap();
            }
            fs::write(at.join("end"), "").unwrap();
        });
        let mut watched = watch(dir.path(), 20_000);
        for number in 0..3u64 {
            let frame = watched.next_frame().unwrap().unwrap();
            assert_eq!(frame.start_s, number as f64 / 10.0);
            assert!(frame.name.ends_with(&format!("f{}.png", number + 9)), "{}", frame.name);
            assert_eq!(frame.open().unwrap().size(), (4, 3));
        }
        let began = Instant::now();
        assert!(watched.next_frame().unwrap().is_none());
        assert!(began.elapsed() < Duration::from_secs(10), "it did not wait");
        writer.join().unwrap();
        assert!(watched.notes().is_empty());
    }

    #[test]
    fn a_writer_that_stops_or_leaves_one_out_is_told() {
        let dir = tempfile::tempdir().unwrap();
        let said = |watched: &mut Watched| watched.next_frame().err().unwrap().to_string();
        assert!(said(&mut watch(dir.path(), 50)).contains("no scene came in 0.05 s"));
        let put = |name: &str, bytes: &[u8]| fs::write(dir.path().join(name), bytes).unwrap();
        put("a1.png", &png(1));
        let mut watched = watch(dir.path(), 300);
        assert!(watched.next_frame().unwrap().is_some());
        assert!(watched.next_frame().unwrap().is_none());
        let notes = watched.notes().join("");
        assert!(notes.contains("after a1.png for 0.3 s"), "{notes}");
        put("a3.png", &png(1));
        let gap = said(&mut watched);
        assert!(gap.contains("a3.png follows a1.png"), "{gap}");
        put("a2.png", &png(1)[..40]);
        let half = said(&mut watched);
        assert!(half.contains("a2.png") && half.contains("nothing has changed"), "{half}");
        put("a0.png", &png(1));
        let late = said(&mut watched);
        assert!(late.contains("a0.png came after a1.png"), "{late}");
    }
}
