//! Reads the frames of a capture in bounded memory.

use super::held::Shared;
use super::{Capture, Held, SensorFacts};
use bytemuck::cast_slice_mut;
use camrig_base::platform::read_at;
use camrig_base::{Error, Plane, Result, Sample};
use camrig_formats::npy::Layout;
use camrig_formats::{Facts, Format, read};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most frames of a batch whose samples are still in their files, which limits the open files.
const MAX_OPEN_FILES: usize = 128;
/// Most pixels in memory at once, unless a single plane is larger: 64 MiB.
const MAX_PIXELS: usize = 1 << 25;

/// A frame of a file or of an array. Its samples are in memory, or are read on demand from a file
/// that stores them uncompressed.
pub struct StoredFrame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples of a stored row.
    stride: usize,
    /// First column and row that are read.
    origin: [usize; 2],
    path: Arc<Path>,
    samples: Samples,
}

enum Samples {
    Memory(Vec<u16>),
    /// From a sample of frames on that others share.
    Held {
        samples: Shared,
        start: usize,
    },
    File {
        file: Arc<File>,
        offset: u64,
        sample: Sample,
        big_endian: bool,
    },
}

impl StoredFrame {
    /// A frame that is in memory, of the file or place `path`.
    pub fn new(plane: Plane<u16>, path: Arc<Path>) -> Self {
        Self {
            width: plane.width,
            height: plane.height,
            stride: plane.width,
            origin: [0; 2],
            path,
            samples: Samples::Memory(plane.data),
        }
    }

    /// The frames of a capture of this name that are in memory.
    fn held(held: &Held, id: &str) -> impl Iterator<Item = Self> {
        let (width, height) = (held.width, held.height);
        let path: Arc<Path> = Path::new(id).into();
        (0..held.count()).map(move |n| {
            let samples = held.samples.clone();
            let samples = Samples::Held { samples, start: n * width * height };
            Self { width, height, stride: width, origin: [0; 2], path: path.clone(), samples }
        })
    }

    /// Fills `out`, a whole number of rows, from row `first` on.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn read_rows(&self, first: usize, out: &mut [u16]) -> Result<()> {
        let [left, top] = self.origin;
        if self.width == self.stride {
            return self.read_samples((top + first) * self.stride, out);
        }
        for (y, row) in (top + first..).zip(out.chunks_mut(self.width)) {
            self.read_samples(y * self.stride + left, row)?;
        }
        Ok(())
    }

    /// Fills `out` from sample `start` of the stored frame on.
    fn read_samples(&self, start: usize, out: &mut [u16]) -> Result<()> {
        let (file, offset, sample, big_endian) = match &self.samples {
            Samples::Memory(data) => {
                out.copy_from_slice(&data[start..start + out.len()]);
                return Ok(());
            }
            Samples::Held { samples, start: first } => {
                let data = &(**samples).as_ref()[first + start..];
                out.copy_from_slice(&data[..out.len()]);
                return Ok(());
            }
            Samples::File { file, offset, sample, big_endian } => {
                (file, *offset, *sample, *big_endian)
            }
        };
        let offset = offset + (start * sample.bytes()) as u64;
        let failed = |e| Error::io("read", &self.path, e);
        if sample == Sample::U8 {
            let mut bytes = vec![0; out.len()];
            read_at(file, &mut bytes, offset).map_err(failed)?;
            out.iter_mut().zip(bytes).for_each(|(dn, b)| *dn = b.into());
        } else {
            read_at(file, cast_slice_mut(out), offset).map_err(failed)?;
            if big_endian == cfg!(target_endian = "little") {
                out.iter_mut().for_each(|dn| *dn = dn.swap_bytes());
            }
        }
        Ok(())
    }

    /// The whole frame.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn plane(&self) -> Result<Plane<u16>> {
        let mut data = vec![0; self.width * self.height];
        self.read_rows(0, &mut data)?;
        Ok(Plane { width: self.width, height: self.height, data })
    }

    /// Checks that the largest sample of a frame fits the bits of the sensor.
    ///
    /// # Errors
    /// A sample with more bits.
    pub fn check_largest(&self, sensor: &SensorFacts, largest: u16) -> Result<()> {
        if u32::from(largest) >> sensor.bits == 0 {
            return Ok(());
        }
        Err(Error::disagreement(format!("a sample of {largest} DN in {} bits", sensor.bits))
            .at(self.path.display())
            .help("set bits in [sensor] to the samples' true range"))
    }
}

/// Opens a file of one or more frames. Samples of NPY files are read on demand; files of the other
/// [`formats`](camrig_formats) are decoded as a whole.
///
/// # Errors
/// Files that cannot be read, unknown formats, and samples that are not raw DN.
pub fn open(path: &Path) -> Result<Vec<StoredFrame>> {
    Ok(open_with_facts(path)?.0)
}

/// [`open`], with the file's metadata.
///
/// # Errors
/// As [`open`].
pub fn open_with_facts(path: &Path) -> Result<(Vec<StoredFrame>, Facts)> {
    let shared: Arc<Path> = path.into();
    if let Some(found) = uncompressed(path, &shared).map_err(|e| e.at(path.display()))? {
        return Ok(found);
    }
    let read = read(path)?;
    let frame = |plane| StoredFrame::new(plane, shared.clone());
    Ok((read.planes.into_iter().map(frame).collect(), read.facts))
}

/// The frames of a file whose samples can be read on demand; `None` for other files.
fn uncompressed(path: &Path, shared: &Arc<Path>) -> Result<Option<(Vec<StoredFrame>, Facts)>> {
    let failed = |e| Error::io("read", path, e);
    let mut file = File::open(path).map_err(failed)?;
    let mut magic = [0; 8];
    if file.read_exact(&mut magic).is_err() || Format::sniff(&magic) != Some(Format::Npy) {
        return Ok(None);
    }
    file.rewind().map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    let layout = Layout::read(&mut BufReader::new(&file), length)?;
    let Layout { count, height, width, sample, big_endian, offset, .. } = layout;
    if layout.fortran || !matches!(sample, Sample::U8 | Sample::U16) {
        return Ok(None);
    }
    let file = Arc::new(file);
    let bytes = (width * height * sample.bytes()) as u64;
    let frame = |n| StoredFrame {
        width,
        height,
        stride: width,
        origin: [0; 2],
        path: shared.clone(),
        samples: Samples::File {
            file: file.clone(),
            offset: offset + n * bytes,
            sample,
            big_endian,
        },
    };
    let bits = (sample == Sample::U8).then_some(8);
    let facts = Facts { bits, ..Facts::default() };
    Ok(Some(((0..count as u64).map(frame).collect(), facts)))
}

/// Reads the frames of a capture in order of time, a few at a time.
pub struct Batches<'a> {
    sensor: &'a SensorFacts,
    held: Option<(&'a Held, &'a str)>,
    files: &'a [PathBuf],
    left_out: &'a [usize],
    opened: usize,
    waiting: VecDeque<StoredFrame>,
}

impl<'a> Batches<'a> {
    /// For a capture of this sensor.
    pub fn new(sensor: &'a SensorFacts, capture: &'a Capture) -> Self {
        let (files, left_out) = (&capture.files[..], &capture.left_out[..]);
        let held = capture.held.as_ref().map(|held| (held, &*capture.id));
        Self { sensor, held, files, left_out, opened: 0, waiting: VecDeque::new() }
    }

    /// Whether all frames have been returned.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty() && self.files.is_empty() && self.held.is_none()
    }

    /// The next frames; empty at the end. Files are opened in parallel, only a few at a time if
    /// they must be decoded.
    ///
    /// # Errors
    /// A file that cannot be read, or a frame whose size contradicts `[sensor]`.
    pub fn next_batch(&mut self) -> Result<Vec<StoredFrame>> {
        let few = 2 * rayon::current_num_threads();
        let in_memory = |f: &StoredFrame| matches!(f.samples, Samples::Memory(_));
        if let Some((held, id)) = self.held.take() {
            self.take(StoredFrame::held(held, id))?;
        }
        while self.waiting.len() < MAX_OPEN_FILES
            && self.waiting.iter().filter(|f| in_memory(f)).count() < few
            && !self.files.is_empty()
        {
            let (now, later) = self.files.split_at(few.min(self.files.len()));
            self.files = later;
            let opened: Vec<_> = now.par_iter().map(|f| open(f)).collect::<Result<_>>()?;
            self.take(opened.into_iter().flatten())?;
        }
        let most = if self.waiting.iter().any(in_memory) { few } else { MAX_OPEN_FILES };
        Ok(self.waiting.drain(..most.min(self.waiting.len())).collect())
    }

    /// Puts frames that are not left out behind those that wait.
    fn take(&mut self, frames: impl Iterator<Item = StoredFrame>) -> Result<()> {
        for frame in frames {
            self.check_size(&frame)?;
            if !self.left_out.contains(&self.opened) {
                self.waiting.push_back(self.sensor.region_of(frame));
            }
            self.opened += 1;
        }
        Ok(())
    }

    fn check_size(&self, frame: &StoredFrame) -> Result<()> {
        let (width, height) = self.sensor.stored_size();
        if (frame.width, frame.height) == (width, height) {
            return Ok(());
        }
        Err(Error::disagreement(format!(
            "a frame of {} x {} in a set of {width} x {height}",
            frame.width, frame.height
        ))
        .at(frame.path.display())
        .help("every frame must have the width and height of [sensor]"))
    }
}

impl SensorFacts {
    /// Columns and rows of the stored frames.
    fn stored_size(&self) -> (usize, usize) {
        self.window.map_or((self.width, self.height), |w| (w.of[0], w.of[1]))
    }

    /// The region of a stored frame that is read.
    fn region_of(&self, frame: StoredFrame) -> StoredFrame {
        let origin = self.window.map_or([0; 2], |w| [w.x, w.y]);
        StoredFrame { width: self.width, height: self.height, origin, ..frame }
    }
}

/// Most planes in memory at once: few where frames are large.
fn max_planes(sensor: &SensorFacts) -> usize {
    let pixels = (sensor.width * sensor.height).max(1);
    (MAX_PIXELS / pixels).clamp(1, 2 * rayon::current_num_threads())
}

/// Calls `each` with batches of frames; see [`super::CaptureSet::for_each_batch`].
pub fn for_each_batch(
    sensor: &SensorFacts,
    capture: &Capture,
    mut each: impl FnMut(&[Plane<u16>]) -> Result<()>,
) -> Result<usize> {
    let few = max_planes(sensor);
    let mut batches = Batches::new(sensor, capture);
    let mut count = 0;
    while !batches.is_empty() {
        for frames in batches.next_batch()?.chunks(few) {
            let planes = frames.par_iter().map(|frame| {
                let plane = frame.plane()?;
                frame.check_largest(sensor, plane.data.iter().copied().max().unwrap_or(0))?;
                Ok(plane)
            });
            let planes: Vec<_> = planes.collect::<Result<_>>()?;
            count += planes.len();
            each(&planes)?;
        }
    }
    Ok(count)
}

#[cfg(test)]
mod tests {
    use crate::{CaptureSet, Role};
    use camrig_base::Plane;
    use camrig_formats::{Facts, Format, Frames};

    #[test]
    fn a_region_is_the_same_part_of_decoded_and_of_stored_frames() {
        let folder = tempfile::tempdir().unwrap();
        let frame = |k: u16| Plane::from_fn(10, 8, |x, y| 1000 * k + 10 * y as u16 + x as u16);
        let facts = Facts { bits: Some(12), ..Facts::default() };
        for (name, format, k) in [("a.npy", Format::Npy, 1), ("b.tiff", Format::Tiff, 2)] {
            let frames = Frames { planes: vec![frame(k)], facts: facts.clone() };
            std::fs::write(folder.path().join(name), format.encode(&frames).unwrap()).unwrap();
        }
        let manifest = "format = \"captures/1\"\n[sensor]\nwidth = 10\nheight = 8\nbits = 12\n\
                        cfa = \"RGGB\"\n[[capture]]\nid = \"dark\"\nrole = \"dark\"\n\
                        files = \"?.*\"\nexposure_s = 0.01\n";
        std::fs::write(folder.path().join("captures.toml"), manifest).unwrap();
        let set = CaptureSet::load(folder.path()).unwrap();
        let part = set.clone().within([4, 2, 5, 3]).unwrap();
        let mut read = Vec::new();
        let dark = part.with_role(Role::Dark).next().unwrap();
        part.for_each_batch(dark, |planes| {
            read.extend_from_slice(planes);
            Ok(())
        })
        .unwrap();
        let value = |k: u16, x: usize, y: usize| 1000 * k + 10 * (y + 2) as u16 + (x + 4) as u16;
        let expected: Vec<_> =
            [1, 2].map(|k| Plane::from_fn(5, 3, |x, y| value(k, x, y))).to_vec();
        assert_eq!(read, expected);
        // Half a period of the pattern, none of it, and beyond its end.
        for wrong in
            [[3, 2, 5, 3], [4, 1, 5, 3], [4, 2, 0, 3], [4, 2, 7, 3], [4, 8, 5, usize::MAX]]
        {
            assert!(set.clone().within(wrong).is_err(), "{wrong:?}");
        }
    }
}
