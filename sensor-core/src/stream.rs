//! Random streams: 32 xoshiro128++ generators in parallel, keyed by where their numbers are used.
//!
//! A [`Key`] identifies a stream by sensor seed, stage, and what it depends on: frame, row, or
//! neither. No state passes from one row to the next, so rows can be computed in any order, on any
//! number of threads, repeatedly, or on another machine, and give the same numbers.
//!
//! **Definition.** Key words are folded into 64 bits by the SplitMix64 finaliser (Steele et al.
//! 2014). Lane j (0..32) of a stream is `Xoshiro128PlusPlus::seed_from_u64(key + j * LANE_STEP)`
//! of the `rand_xoshiro` crate (Blackman & Vigna 2021). Draw n of a stream is the n-th output of
//! all lanes; within a block of 64 pixels the first draw serves pixels 0..32, the second 32..64.
//! The states are stored word by word, so that one vector instruction serves all lanes; a test
//! compares them with the crate's own generator.

use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;

/// Generators in parallel: two of the widest vectors (512 bits), half a block.
pub const LANES: usize = 32;

/// Difference between the seeds of neighbouring lanes; odd, so that no two lanes of a stream share
/// a seed.
const LANE_STEP: u64 = 0xD134_2543_DE82_EF95;
/// 2⁶⁴ over the golden ratio: the increment of SplitMix64 (Steele et al. 2014).
const PHI: u64 = 0x9E37_79B9_7F4A_7C15;

/// Output function of SplitMix64.
#[inline(always)]
const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Identifies a random stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key(u64);

impl Key {
    /// The root of all streams of one physical sensor.
    #[inline(always)]
    pub const fn new(sensor_seed: u64) -> Self {
        Key(mix(sensor_seed ^ PHI))
    }

    /// The stream with this number below the present one. The order of words matters.
    #[inline(always)]
    pub const fn with(self, word: u32) -> Self {
        Key(mix(self.0.wrapping_add(PHI) ^ (word as u64)))
    }

    /// The key itself as two words: for one number that needs no generator.
    #[cfg(feature = "empirical")]
    #[inline(always)]
    pub(crate) const fn words(self) -> [u32; 2] {
        [(self.0 >> 32) as u32, self.0 as u32]
    }

    /// Parallel generators for values per pixel.
    #[inline(always)]
    pub fn lanes(self) -> Lanes {
        Lanes::new(self.0)
    }

    /// One generator for values per row or per frame.
    #[inline(always)]
    pub fn scalar(self) -> Xoshiro128PlusPlus {
        Xoshiro128PlusPlus::seed_from_u64(self.0)
    }
}

/// [`LANES`] xoshiro128++ generators, their states stored word by word.
#[derive(Clone, Debug)]
pub struct Lanes {
    s: [[u32; LANES]; 4],
}

impl Lanes {
    #[cfg_attr(target_os = "none", inline(never))]
    #[cfg_attr(not(target_os = "none"), inline(always))]
    fn new(key: u64) -> Self {
        let mut s = [[0; LANES]; 4];
        for j in 0..LANES {
            let seed = key.wrapping_add((j as u64).wrapping_mul(LANE_STEP));
            let low = mix(seed.wrapping_add(PHI));
            let high = mix(seed.wrapping_add(PHI.wrapping_mul(2)));
            s[0][j] = low as u32;
            s[1][j] = (low >> 32) as u32;
            s[2][j] = high as u32;
            s[3][j] = (high >> 32) as u32;
        }
        Self { s }
    }

    /// The next 32 bits of each lane.
    #[cfg_attr(target_os = "none", inline(never))]
    #[cfg_attr(not(target_os = "none"), inline(always))]
    pub fn draw(&mut self) -> [u32; LANES] {
        let mut out = [0; LANES];
        let [s0, s1, s2, s3] = &mut self.s;
        for j in 0..LANES {
            out[j] = s0[j].wrapping_add(s3[j]).rotate_left(7).wrapping_add(s0[j]);
            let t = s1[j] << 9;
            s2[j] ^= s0[j];
            s3[j] ^= s1[j];
            s1[j] ^= s2[j];
            s0[j] ^= s3[j];
            s2[j] ^= t;
            s3[j] = s3[j].rotate_left(11);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::Rng;

    #[test]
    fn lanes_are_the_streams_of_rand_xoshiro() {
        let key = Key::new(42).with(7).with(1000);
        let mut lanes = key.lanes();
        let mut peers: [Xoshiro128PlusPlus; LANES] = core::array::from_fn(|j| {
            Xoshiro128PlusPlus::seed_from_u64(
                key.0.wrapping_add((j as u64).wrapping_mul(LANE_STEP)),
            )
        });
        for _ in 0..1000 {
            assert_eq!(lanes.draw(), core::array::from_fn(|j| peers[j].next_u32()));
        }
    }

    #[test]
    fn order_of_words_matters() {
        let root = Key::new(1);
        assert_ne!(root.with(1).with(2), root.with(2).with(1));
        assert_ne!(root.with(0), root);
        assert_ne!(Key::new(0), Key::new(1));
    }
}
