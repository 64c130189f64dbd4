//! Frames of a capture, streamed.

use super::{Capture, SensorFacts};
use crate::{Error, Plane, Result, formats};
use rayon::prelude::*;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// The frames of one file. Stacks (`N x H x W` NPY) are read lazily, one frame at a time.
pub struct FrameReader(Kind);

enum Kind {
    Read(std::vec::IntoIter<Plane<u16>>),
    Npy(NpyStack),
}

impl FrameReader {
    /// Frames that are still to come.
    pub fn frames_left(&self) -> usize {
        match &self.0 {
            Kind::Read(frames) => frames.len(),
            Kind::Npy(stack) => stack.left as usize,
        }
    }
}

impl Iterator for FrameReader {
    type Item = Result<Plane<u16>>;

    fn next(&mut self) -> Option<Self::Item> {
        match &mut self.0 {
            Kind::Read(frames) => frames.next().map(Ok),
            Kind::Npy(stack) => stack.next(),
        }
    }
}

/// Opens a file of one or more frames: NPY stacks lazily, every other format of
/// [`formats`](crate::formats) whole.
///
/// # Errors
/// Files that cannot be read, formats that are not known, and samples that are not 8 or 16 bit
/// unsigned.
pub fn open(path: &Path) -> Result<FrameReader> {
    let npy = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy"));
    let stack = if npy { NpyStack::open(path).map_err(|e| e.at(path.display()))? } else { None };
    let kind = match stack {
        Some(stack) => Ok(Kind::Npy(stack)),
        None => formats::read(path).map(|f| Kind::Read(f.planes.into_iter())),
    };
    kind.map(FrameReader).map_err(|e| e.at(path.display()))
}

/// Calls `each` with batches of frames; see [`super::CaptureSet::for_each_batch`].
pub fn for_each_batch(
    sensor: &SensorFacts,
    capture: &Capture,
    mut each: impl FnMut(&[Plane<u16>]) -> Result<()>,
) -> Result<usize> {
    let size = 2 * rayon::current_num_threads();
    let mut batch: Vec<Plane<u16>> = Vec::with_capacity(size);
    let mut count = 0;
    for files in capture.files.chunks(size) {
        let readers: Vec<FrameReader> = files.par_iter().map(|f| open(f)).collect::<Result<_>>()?;
        for (file, reader) in files.iter().zip(readers) {
            for frame in reader {
                let frame = frame
                    .and_then(|f| check(sensor, &f).map(|()| f))
                    .map_err(|e| e.at(file.display()))?;
                batch.push(frame);
                if batch.len() == size {
                    count += batch.len();
                    each(&batch)?;
                    batch.clear();
                }
            }
        }
    }
    if !batch.is_empty() {
        count += batch.len();
        each(&batch)?;
    }
    Ok(count)
}

fn check(sensor: &SensorFacts, frame: &Plane<u16>) -> Result<()> {
    if (frame.width, frame.height) != (sensor.width, sensor.height) {
        return Err(Error::input(format!(
            "a frame of {} x {} in a set of {} x {}",
            frame.width, frame.height, sensor.width, sensor.height
        ))
        .help("every frame has the width and height of [sensor]"));
    }
    let largest = frame.data.iter().copied().max().unwrap_or(0);
    if u32::from(largest) >> sensor.bits != 0 {
        return Err(Error::input(format!("a sample of {largest} DN in {} bits", sensor.bits))
            .help("set bits in [sensor] to the samples' true range"));
    }
    Ok(())
}

/// A NPY file of `N x H x W` samples, read frame by frame.
struct NpyStack {
    data: Box<dyn Iterator<Item = std::io::Result<u16>> + Send>,
    width: usize,
    height: usize,
    left: u64,
}

impl NpyStack {
    /// `None` for an array that is no stack.
    fn open(path: &Path) -> Result<Option<Self>> {
        let file = File::open(path).map_err(|e| Error::io("read", path, e))?;
        let length = file.metadata().map_err(|e| Error::io("read", path, e))?.len();
        let broken = |e: std::io::Error| Error::input(format!("not a readable NPY file: {e}"));
        let npy = npyz::NpyFile::new(BufReader::new(file)).map_err(broken)?;
        let shape = npy.shape().to_vec();
        let [frames, height, width] = shape[..] else { return Ok(None) };
        if npy.order() != npyz::Order::C {
            return Err(Error::input("a stack stored columns first (Fortran order)")
                .help("save it with numpy.ascontiguousarray"));
        }
        // A header may claim any size; the file bounds it before anything is reserved.
        let samples = frames.checked_mul(height).and_then(|n| n.checked_mul(width));
        if samples.is_none_or(|n| n == 0 || n > length) {
            return Err(Error::input(format!("shape {shape:?} in a file of {length} bytes")));
        }
        let data: Box<dyn Iterator<Item = std::io::Result<u16>> + Send> = match npy.dtype().descr()
        {
            d if d.contains("u1") => {
                Box::new(npy.data::<u8>().map_err(wrong_type)?.map(|s| s.map(u16::from)))
            }
            _ => Box::new(npy.data::<u16>().map_err(wrong_type)?),
        };
        let (width, height) = (width as usize, height as usize);
        Ok(Some(Self { data, width, height, left: frames }))
    }

    fn next(&mut self) -> Option<Result<Plane<u16>>> {
        if self.left == 0 {
            return None;
        }
        self.left -= 1;
        let count = self.width * self.height;
        let data: std::io::Result<Vec<u16>> = self.data.by_ref().take(count).collect();
        Some(match data {
            Ok(data) if data.len() == count => {
                Ok(Plane { width: self.width, height: self.height, data })
            }
            Ok(_) => Err(Error::input("the file ends before its last frame")),
            Err(e) => Err(Error::input(format!("cannot read samples: {e}"))),
        })
    }
}

fn wrong_type(e: impl std::fmt::Display) -> Error {
    Error::input(format!("samples are not 8 or 16 bit unsigned: {e}")).help("save frames as uint16")
}
