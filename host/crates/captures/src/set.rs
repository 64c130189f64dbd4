//! A capture set.

use super::manifest::DraftStack;
use super::{Capture, Held, Role, frames, manifest, open};
use camrig_base::{Cfa, Error, ErrorCode, Plane, Result};
use std::path::{Path, PathBuf};

/// A capture set whose manifest was checked. Frames are read on demand.
#[derive(Clone, Debug)]
pub struct CaptureSet {
    /// The directory of `captures.toml`.
    pub root: PathBuf,
    /// The base model of the set's camera: a path that can be opened, or the name of a preset.
    pub camera: Option<PathBuf>,
    /// The format of the frames.
    pub sensor: SensorFacts,
    /// The stacks, in the order of the file.
    pub captures: Vec<Capture>,
}

/// The format of a set's frames.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorFacts {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bits per sample.
    pub bits: u32,
    /// Colour filter pattern; `None` where the manifest has none.
    pub cfa: Option<Cfa>,
    /// Nominal mean without light, DN; `None` where the manifest has none.
    pub black_level_dn: Option<f64>,
    /// Level at which samples saturate, DN.
    pub white_level_dn: u16,
    /// Pixel pitch, µm.
    pub pitch_um: Option<f64>,
    /// The region of the frames that is read; `None` for whole frames.
    pub window: Option<Window>,
}

/// A region of the stored frames, of [`SensorFacts::width`] columns and [`SensorFacts::height`]
/// rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns and rows of the whole frames.
    pub of: [usize; 2],
}

impl CaptureSet {
    /// Reads `DIR/captures.toml` (or that file itself) and finds every frame's file.
    ///
    /// # Errors
    /// A manifest that is missing or wrong (unknown keys, values out of range, repeated ids), and
    /// patterns that match no file. The frames themselves are not read yet.
    pub fn load(path: &Path) -> Result<Self> {
        let file = if path.is_dir() { path.join("captures.toml") } else { path.to_owned() };
        let text = std::fs::read_to_string(&file).map_err(|e| {
            Error::io("read", &file, e).help("a capture set is a directory with captures.toml")
        })?;
        manifest::parse(&text, &file)
    }

    /// The dark stacks of a manifest with values that are not filled in yet.
    /// `None` of a manifest that has all values.
    ///
    /// # Errors
    /// Those of [`Self::load`] about ids, roles and files.
    pub fn darks_of_draft(path: &Path) -> Result<Option<Vec<DraftStack>>> {
        let file = path.join("captures.toml");
        let text = std::fs::read_to_string(&file).map_err(|e| Error::io("read", &file, e))?;
        manifest::darks_of_draft(&text, path).map_err(|e| e.at(file.display()))
    }

    /// Its name: that of its directory.
    #[must_use]
    pub fn name(&self) -> String {
        let root = std::fs::canonicalize(&self.root).unwrap_or_else(|_| self.root.clone());
        root.file_name().unwrap_or(root.as_os_str()).to_string_lossy().into_owned()
    }

    /// The set restricted to `width` columns from `x` on and `height` rows from `y` on of every
    /// frame, as if the sensor had no others.
    ///
    /// # Errors
    /// A region that is empty, not inside the frames, or does not start at a whole period of the
    /// colour filter pattern.
    pub fn within(mut self, [x, y, width, height]: [usize; 4]) -> Result<Self> {
        let whole = [self.sensor.width, self.sensor.height];
        let inside = |start: usize, length: usize, all: usize| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= all)
        };
        let region = format!("region {x},{y},{width},{height}");
        if !inside(x, width, whole[0]) || !inside(y, height, whole[1]) {
            return Err(Error::input(format!("{region} of {} x {}", whole[0], whole[1]))
                .help("give a region inside the frames")
                .with_code(ErrorCode::RegionOutside));
        }
        let cfa = self.cfa();
        if !x.is_multiple_of(cfa.width) || !y.is_multiple_of(cfa.height) {
            return Err(Error::unsupported(format!("{region} inside a period of {cfa}")).help(
                format!("start at multiples of {} columns and {} rows", cfa.width, cfa.height),
            ));
        }
        (self.sensor.width, self.sensor.height) = (width, height);
        self.sensor.window = Some(Window { x, y, of: whole });
        Ok(self)
    }

    /// The colour filter pattern, monochrome where the manifest has none.
    pub fn cfa(&self) -> Cfa {
        let mono = || Cfa { width: 1, height: 1, letters: vec!['M'] };
        self.sensor.cfa.clone().unwrap_or_else(mono)
    }

    /// The captures of one role, in the order of the file.
    pub fn with_role(&self, role: Role) -> impl Iterator<Item = &Capture> {
        self.captures.iter().filter(move |c| c.role == role)
    }

    /// Number of frames of a capture that are read.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn count(&self, capture: &Capture) -> Result<usize> {
        let in_files: usize =
            capture.files.iter().map(|f| Ok(open(f)?.len())).sum::<Result<_>>()?;
        let all = in_files + capture.held.as_ref().map_or(0, Held::count);
        Ok(all - capture.left_out.len())
    }

    /// Calls `each` with the capture's frames in order of time, a few at a time. Files of a batch
    /// are decoded in parallel. Returns the number of frames.
    ///
    /// # Errors
    /// A file that cannot be read, or a frame whose size or largest sample contradicts `[sensor]`.
    pub fn for_each_batch(
        &self,
        capture: &Capture,
        each: impl FnMut(&[Plane<u16>]) -> Result<()>,
    ) -> Result<usize> {
        frames::for_each_batch(&self.sensor, capture, each)
            .map_err(|e| e.at(format!("capture {:?}", capture.id)))
    }
}
