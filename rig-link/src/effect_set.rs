//! Which effects of the sensor model a device has.

use core::fmt;
use serde::de::{Error, SeqAccess, Visitor};
use serde::ser::SerializeTuple;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Numbers that a set holds: all of a `u8`.
const NUMBERS: usize = 256;
/// Bits in a byte of the link.
const BITS: usize = 7;
/// Longest set on the link, bytes.
const MAX_BYTES: usize = NUMBERS.div_ceil(BITS);

/// A set of effects, by their numbers in the catalogue of `camrig-sensor-core`.
///
/// On the link it is an integer with bit `i` for number `i`, in the encoding of the other
/// integers: 7 bits a byte, the lowest first, and the top bit in all bytes but the last. It is as
/// long as its largest number needs, so that a set of numbers below 64 has the bytes of a `u64`.
///
/// ```
/// use camrig_rig_link::message::EffectSet;
/// let effects: EffectSet = [1, 6, 200].into_iter().collect();
/// assert!(effects.contains(200) && !effects.contains(2));
/// assert_eq!(effects.iter().count(), 3);
/// ```
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub struct EffectSet([u8; NUMBERS / 8]);

impl EffectSet {
    /// Whether an effect is in the set.
    pub const fn contains(&self, number: u8) -> bool {
        self.0[number as usize / 8] >> (number % 8) & 1 == 1
    }

    /// Its numbers, rising.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = u8> + '_ {
        (0..=u8::MAX).filter(|&number| self.contains(number))
    }

    fn insert(&mut self, number: u8) {
        self.0[usize::from(number) / 8] |= 1 << (number % 8);
    }
}

impl FromIterator<u8> for EffectSet {
    fn from_iter<T: IntoIterator<Item = u8>>(numbers: T) -> Self {
        let mut set = Self::default();
        numbers.into_iter().for_each(|number| set.insert(number));
        set
    }
}

impl fmt::Debug for EffectSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

impl Serialize for EffectSet {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let bytes = self.iter().next_back().map_or(1, |largest| usize::from(largest) / BITS + 1);
        let mut tuple = serializer.serialize_tuple(bytes)?;
        for byte in 0..bytes {
            let more = u8::from(byte + 1 < bytes) << BITS;
            let numbers = (byte * BITS..(byte + 1) * BITS).enumerate();
            let bits = numbers.filter_map(|(bit, n)| Some((bit, u8::try_from(n).ok()?)));
            let bits = bits.fold(0, |bits, (bit, n)| bits | u8::from(self.contains(n)) << bit);
            tuple.serialize_element(&(more | bits))?;
        }
        tuple.end()
    }
}

impl<'de> Deserialize<'de> for EffectSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_tuple(MAX_BYTES, Bytes)
    }
}

struct Bytes;

impl<'de> Visitor<'de> for Bytes {
    type Value = EffectSet;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a set of effects in at most {MAX_BYTES} bytes")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut bytes: A) -> Result<EffectSet, A::Error> {
        let mut set = EffectSet::default();
        let mut first = 0;
        while let Some(byte) = bytes.next_element::<u8>()? {
            for bit in (0..BITS).filter(|bit| byte >> bit & 1 == 1) {
                let number = u8::try_from(first + bit);
                set.insert(number.map_err(|_| A::Error::invalid_length(first, &self))?);
            }
            if byte >> BITS == 0 {
                return Ok(set);
            }
            first += BITS;
        }
        Err(A::Error::invalid_length(MAX_BYTES, &self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_of_numbers_below_64_has_the_bytes_of_a_u64() {
        for bits in [0, 1, 2, 0x80, 0xfe, 1 << 35, 1 << 63, u64::MAX, 0x0007_ffff_ffff_fffe] {
            let set: EffectSet = (0..64).filter(|number| bits >> number & 1 == 1).collect();
            let (mut as_set, mut as_number) = ([0; MAX_BYTES], [0; MAX_BYTES]);
            let as_set = postcard::to_slice(&set, &mut as_set).unwrap();
            assert_eq!(as_set, postcard::to_slice(&bits, &mut as_number).unwrap(), "{bits:#x}");
            assert_eq!(postcard::from_bytes::<EffectSet>(as_set).unwrap(), set);
        }
    }

    #[test]
    fn any_set_survives_the_link_and_what_is_none_is_refused() {
        let all: [u8; NUMBERS] = core::array::from_fn(|number| number as u8);
        for numbers in [&[255][..], &[64], &[6, 7, 8, 200], &all] {
            let set: EffectSet = numbers.iter().copied().collect();
            let mut bytes = [0; MAX_BYTES];
            let bytes = postcard::to_slice(&set, &mut bytes).unwrap();
            assert_eq!(bytes.len(), usize::from(*numbers.last().unwrap()) / BITS + 1);
            assert_eq!(postcard::from_bytes::<EffectSet>(bytes).unwrap(), set);
            assert!(set.iter().eq(numbers.iter().copied()));
        }
        // Bit 256, a set without an end, and one that goes on beyond the longest.
        let mut large = [0x80; MAX_BYTES + 1];
        large[MAX_BYTES - 1] = 1 << 4;
        assert!(postcard::from_bytes::<EffectSet>(&large).is_err());
        assert!(postcard::from_bytes::<EffectSet>(&[0xff; 3]).is_err());
        assert!(postcard::from_bytes::<EffectSet>(&[0x80; MAX_BYTES + 1]).is_err());
    }
}
