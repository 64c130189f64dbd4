//! Frames of a set as bytes: reading them is the least that any analysis does.

use camrig::captures::CaptureSet;
use std::path::Path;

/// Reads the bytes of every frame, piece by piece, into one buffer per thread.
pub fn read_all(set: &Path) {
    use rayon::prelude::*;
    let set = CaptureSet::load(set).expect("the set loads");
    let files: Vec<_> = set.captures.iter().flat_map(|c| &c.files).collect();
    files.into_par_iter().for_each_init(
        || vec![0; 1 << 15],
        |buffer, file| {
            let mut file = std::fs::File::open(file).expect("the frame is there");
            while std::io::Read::read(&mut file, buffer).expect("the frame can be read") > 0 {}
        },
    );
}
