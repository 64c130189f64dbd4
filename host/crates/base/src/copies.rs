//! Whether a frame is a copy of another: the same samples again. Two frames of a sensor never are,
//! unless it has no noise.

use crate::Plane;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Share of samples that differ from the next one of their colour in the row from which the same
/// frame again is no frame of a sensor without noise: pixels lie everywhere between two codes, so
/// that noise of a thousandth of a code would change some. Chosen: a simulated dark without any
/// pattern has none.
const STRUCTURE: f64 = 0.1;

/// What a frame shares with its copies alone: two independent hashes of its samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Print([u64; 2]);

impl Print {
    /// Of a frame whose colours recur every `across` columns; `None` where a sensor without noise
    /// may give the same frame again.
    pub fn of(frame: &Plane<u16>, across: usize) -> Option<Self> {
        let differing =
            |row: &[u16]| row.windows(across + 1).filter(|p| p[0] != p[across]).count();
        let differing: usize = frame.data.chunks(frame.width).map(differing).sum();
        if (differing as f64) < STRUCTURE * frame.data.len() as f64 {
            return None;
        }
        Some(Self([0u8, 1].map(|salt| {
            let mut hasher = DefaultHasher::new();
            salt.hash(&mut hasher);
            frame.data.hash(&mut hasher);
            hasher.finish()
        })))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_are_told_from_other_frames_and_from_frames_without_noise() {
        let frame = |k: usize| Plane::from_fn(8, 6, |x, y| (x * x + k * y) as u16);
        let print = |k| Print::of(&frame(k), 1);
        assert!(print(1).is_some() && print(1) == print(1) && print(1) != print(2));
        // Two colours of one level each: the pattern of the filters is none of the pixels.
        let flat = Plane::from_fn(8, 6, |x, _| if x % 2 == 0 { 500 } else { 900 });
        assert_eq!(Print::of(&flat, 2), None);
        assert!(Print::of(&flat, 1).is_some());
    }
}
