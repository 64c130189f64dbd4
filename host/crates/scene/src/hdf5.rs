//! MATLAB files of version 7.3, which are HDF5 files: arrays and structs (groups), read with
//! `hdf5-pure`.

use super::cube::BandSource;
use super::matlab::{Array, Value};
use camrig_base::{Error, Plane, Result};
use hdf5_pure::{File, Group};
use std::path::{Path, PathBuf};

fn refused(error: hdf5_pure::Error) -> Error {
    Error::input(format!("not a readable MATLAB file: {error}"))
        .help("a .mat file is read in versions 5 (save -v6, -v7) and 7.3")
}

/// Groups within groups that are read; ISETCam's scenes have three levels.
const MAX_DEPTH: usize = 8;

/// Reads the named variables except three-dimensional arrays (see [`large`]).
pub fn read(path: &Path, wanted: &[&str]) -> Result<Vec<(String, Value)>> {
    let file = File::open_streaming(path).map_err(refused)?;
    struct_of(&file.root(), 0, Some(wanted))
}

/// The three-dimensional arrays among the named variables, which are read plane by plane.
pub fn large(path: &Path, wanted: &[&str]) -> Result<Vec<(String, Box<dyn BandSource>)>> {
    let file = File::open_streaming(path).map_err(refused)?;
    let names = file.root().datasets().map_err(refused)?;
    let mut found: Vec<(String, Box<dyn BandSource>)> = Vec::new();
    for name in names.into_iter().filter(|n| wanted.contains(&n.as_str())) {
        let shape = file.dataset(&name).and_then(|d| d.shape()).map_err(refused)?;
        // HDF5 lists the slowest axis first: bands, columns, rows.
        if let [bands, width, height] = shape.iter().map(|&n| n as usize).collect::<Vec<_>>()[..] {
            let planes = Planes { path: path.into(), name: name.clone(), width, height, bands };
            found.push((name, Box::new(planes)));
        }
    }
    Ok(found)
}

struct Planes {
    path: PathBuf,
    name: String,
    width: usize,
    height: usize,
    bands: usize,
}

impl BandSource for Planes {
    fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    fn bands(&self) -> usize {
        self.bands
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let file = File::open_streaming(&self.path).map_err(refused)?;
        let dataset = file.dataset(&self.name).map_err(refused)?;
        let columns = dataset.read_f64_rows(band as u64, 1).map_err(refused)?;
        if columns.len() != self.width * self.height {
            return Err(Error::input(format!("band {band} of {} is cut off", self.name)));
        }
        let height = self.height;
        Ok(Plane::from_fn(self.width, height, |x, y| columns[x * height + y] as f32))
    }
}

fn struct_of(
    group: &Group,
    depth: usize,
    wanted: Option<&[&str]>,
) -> Result<Vec<(String, Value)>> {
    let keep = |name: &String| wanted.is_none_or(|wanted| wanted.contains(&name.as_str()));
    let mut fields = Vec::new();
    for name in group.datasets().map_err(refused)?.into_iter().filter(keep) {
        let dataset = group.dataset(&name).map_err(refused)?;
        let mut shape: Vec<usize> =
            dataset.shape().map_err(refused)?.into_iter().map(|n| n as usize).collect();
        if shape.len() > 2 {
            continue;
        }
        shape.reverse();
        // Text and references are not numbers.
        let value = match dataset.read_f64() {
            Ok(numbers) => Value::Array(Array::doubles(shape, numbers)),
            Err(_) => Value::Other,
        };
        fields.push((name, value));
    }
    if depth < MAX_DEPTH {
        for name in group.groups().map_err(refused)?.into_iter().filter(keep) {
            let inner = group.group(&name).map_err(refused)?;
            fields.push((name, Value::Struct(struct_of(&inner, depth + 1, None)?)));
        }
    }
    Ok(fields)
}
