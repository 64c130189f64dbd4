//! One linear number from the captures of a pixel.

use super::HdrError;
use serde::{Deserialize, Serialize};

/// Largest number of captures of a pixel.
pub const MAX_CAPTURES: usize = 4;

/// Weights of a hand-over and gains have this many bits after the point.
const FRACTION: u32 = 8;
const ONE: i64 = 1 << FRACTION;
const HALF: i64 = ONE / 2;

/// What brings the codes of a capture to the scale of the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Level {
    /// Its black level, DN.
    pub black_dn: u16,
    /// Linear DN per DN, in 1/256.
    pub gain: u32,
}

/// Where the merge goes on to the next capture: a ramp over the code of one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hand {
    /// The capture whose code decides.
    pub decide: u8,
    /// Up to this code the next capture has no weight, DN.
    pub low_dn: u16,
    /// From this code on it has all.
    pub high_dn: u16,
}

/// A capture that is taken where it exceeds the merged signal: lamps with pulses that the others
/// may have missed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Flicker {
    /// The capture, open long enough to see every pulse.
    pub capture: u8,
    /// By how much it has to exceed the others, linear DN.
    pub margin_dn: u32,
}

/// The merge of 2 to 4 captures, the most sensitive first.
///
/// With l_c = ((DN_c − b_c) g_c + 128) >> 8 and M = l_1, each hand-over k has the weight w =
/// clamp(⌊256 (DN_d − low)/(high − low)⌋, 0, 256) and M becomes (M (256 − w) + l_k w + 128) >> 8;
/// shifts round towards −∞. The linear signal is clamp(M + pedestal, 0, 2^bits − 1): nothing is cut
/// before it, so that the mean of the dark stays where it is.
///
/// Threshold pairs on one capture's code with a ramp between them are those of the IMX585
/// (`imx585.c`) and of `hi_isp_wdr_combine_attr`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Merge {
    levels: heapless::Vec<Level, MAX_CAPTURES>,
    hands: heapless::Vec<Hand, MAX_CAPTURES>,
    linear_bits: u8,
    pedestal_dn: u32,
    flicker: Option<Flicker>,
}

impl Merge {
    /// A merge of captures with these levels to `linear_bits` (16, 20 or 24) with a pedestal;
    /// `hands` lead from the first capture to the second and so on.
    ///
    /// # Errors
    /// [`HdrError::Captures`], [`HdrError::HandOver`], [`HdrError::Linear`].
    pub fn new(
        levels: &[Level],
        hands: &[Hand],
        linear_bits: u8,
        pedestal_dn: u32,
    ) -> Result<Self, HdrError> {
        if levels.len() > MAX_CAPTURES || hands.len() > MAX_CAPTURES {
            return Err(HdrError::Captures);
        }
        let merge = Self {
            levels: levels.iter().copied().collect(),
            hands: hands.iter().copied().collect(),
            linear_bits,
            pedestal_dn,
            flicker: None,
        };
        merge.check().map(|()| merge)
    }

    /// Checks a merge that came from elsewhere, as [`Self::new`] does.
    ///
    /// # Errors
    /// [`HdrError::Captures`], [`HdrError::HandOver`], [`HdrError::Linear`].
    pub fn check(&self) -> Result<(), HdrError> {
        let captures = self.levels.len();
        let lamp = self.flicker.map_or(0, |flicker| usize::from(flicker.capture));
        if captures < 2 || self.hands.len() + 1 != captures || lamp >= captures {
            return Err(HdrError::Captures);
        }
        let wrong = |(i, hand): (usize, &Hand)| {
            usize::from(hand.decide) > i || hand.high_dn <= hand.low_dn
        };
        if let Some(i) = self.hands.iter().enumerate().position(wrong) {
            return Err(HdrError::HandOver(i));
        }
        if ![16, 20, 24].contains(&self.linear_bits) || self.pedestal_dn >= 1 << self.linear_bits {
            return Err(HdrError::Linear);
        }
        Ok(())
    }

    /// The same merge with a capture for lamps that flicker.
    ///
    /// # Errors
    /// [`HdrError::Captures`] for a capture that there is not.
    pub fn with_flicker(self, flicker: Flicker) -> Result<Self, HdrError> {
        let merge = Self { flicker: Some(flicker), ..self };
        merge.check().map(|()| merge)
    }

    /// Number of captures.
    pub fn captures(&self) -> usize {
        self.levels.len()
    }

    /// The levels of the captures.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// The capture for lamps that flicker.
    pub fn flicker(&self) -> Option<Flicker> {
        self.flicker
    }

    /// The hand-overs from the first capture on.
    pub fn hands(&self) -> &[Hand] {
        &self.hands
    }

    /// Bits of the linear signal: 16, 20 or 24.
    pub fn linear_bits(&self) -> u8 {
        self.linear_bits
    }

    /// The largest linear DN.
    pub fn max_dn(&self) -> u32 {
        (1 << self.linear_bits) - 1
    }

    /// The DN of no signal.
    pub fn pedestal_dn(&self) -> u32 {
        self.pedestal_dn
    }

    /// The code of a capture on the common scale, linear DN above black.
    #[inline(always)]
    fn level(&self, capture: usize, codes: &[u16]) -> i64 {
        let code = codes.get(capture).map_or(0, |&code| i64::from(code));
        self.levels.get(capture).map_or(0, |level| {
            ((code - i64::from(level.black_dn)) * i64::from(level.gain) + HALF) >> FRACTION
        })
    }

    /// The merged signal of a pixel before the pedestal, linear DN above black; `codes` are those
    /// of its captures in order.
    #[inline(always)]
    pub fn above_black(&self, codes: &[u16]) -> i64 {
        let mut merged = self.level(0, codes);
        for (k, hand) in self.hands.iter().enumerate() {
            let code = codes.get(usize::from(hand.decide)).copied().unwrap_or(0);
            if code <= hand.low_dn {
                continue;
            }
            let next = self.level(k + 1, codes);
            if code >= hand.high_dn {
                merged = next;
                continue;
            }
            let [above, ramp] = [code, hand.high_dn].map(|dn| u32::from(dn - hand.low_dn));
            let weight = i64::from((above << FRACTION) / ramp);
            merged = (merged * (ONE - weight) + next * weight + HALF) >> FRACTION;
        }
        match self.flicker {
            None => merged,
            Some(flicker) => {
                let lamp = self.level(usize::from(flicker.capture), codes);
                if lamp > merged + i64::from(flicker.margin_dn) { lamp } else { merged }
            }
        }
    }

    /// The linear signal of a pixel, DN.
    #[inline(always)]
    pub fn linear(&self, codes: &[u16]) -> u32 {
        let linear = self.above_black(codes) + i64::from(self.pedestal_dn);
        linear.clamp(0, i64::from(self.max_dn())) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn three() -> Merge {
        let level = |gain| Level { black_dn: 168, gain };
        let hand = |decide| Hand { decide, low_dn: 3000, high_dn: 3600 };
        let levels = [level(256), level(16 * 256), level(256 * 256)];
        Merge::new(&levels, &[hand(0), hand(1)], 20, 168).unwrap()
    }

    #[test]
    fn a_merge_is_linear_in_light_outside_its_ramps() {
        let merge = three();
        assert_eq!(merge.linear(&[168, 168, 168]), 168, "dark");
        assert_eq!(merge.linear(&[160, 168, 168]), 160, "below black is kept");
        assert_eq!(merge.linear(&[0, 0, 0]), 0, "and cut at the output only");
        assert_eq!(merge.linear(&[3000, 345, 179]), 3000);
        assert_eq!(merge.linear(&[3600, 383, 181]), 168 + 215 * 16);
        assert_eq!(merge.linear(&[4095, 4095, 4095]), 168 + 3927 * 256);
    }

    #[test]
    fn in_a_ramp_the_weight_is_the_place_of_the_deciding_code() {
        let merge = three();
        // ⌊256 (3300 − 3000)/600⌋ = 128: the mean of the two.
        assert_eq!(merge.above_black(&[3300, 368, 0]), (3132 + 3200) / 2);
        assert_eq!(merge.above_black(&[3302, 368, 0]), (3134 * 128 + 3200 * 128 + 128) >> 8);
        // 3303: ⌊129.28⌋ = 129.
        assert_eq!(merge.above_black(&[3303, 368, 0]), (3135 * 127 + 3200 * 129 + 128) >> 8);
    }

    #[test]
    fn a_lamp_that_the_others_missed_is_taken_from_the_capture_that_saw_it() {
        let merge = three().with_flicker(Flicker { capture: 1, margin_dn: 100 }).unwrap();
        assert_eq!(merge.above_black(&[268, 174, 168]), 100, "96 does not exceed 100");
        assert_eq!(merge.above_black(&[268, 181, 168]), 208);
        assert_eq!(merge.above_black(&[268, 180, 168]), 100, "192 exceeds it by 92");
    }

    #[test]
    fn what_cannot_be_merged_is_refused() {
        let level = Level { black_dn: 64, gain: 256 };
        let hand = Hand { decide: 0, low_dn: 3000, high_dn: 3600 };
        let new = |levels: &[Level], hands: &[Hand]| Merge::new(levels, hands, 16, 0);
        assert_eq!(new(&[level], &[]), Err(HdrError::Captures));
        assert_eq!(new(&[level; 3], &[hand]), Err(HdrError::Captures));
        assert_eq!(new(&[level; 5], &[hand; 4]), Err(HdrError::Captures));
        let later = Hand { decide: 1, ..hand };
        assert_eq!(new(&[level; 2], &[later]), Err(HdrError::HandOver(0)));
        let flat = Hand { high_dn: 3000, ..hand };
        assert_eq!(new(&[level; 3], &[hand, flat]), Err(HdrError::HandOver(1)));
        assert_eq!(Merge::new(&[level; 2], &[hand], 18, 0), Err(HdrError::Linear));
        assert_eq!(Merge::new(&[level; 2], &[hand], 16, 65_536), Err(HdrError::Linear));
        let merge = Merge::new(&[level; 2], &[hand], 16, 0).unwrap();
        let no_capture = Flicker { capture: 2, margin_dn: 0 };
        assert_eq!(merge.with_flicker(no_capture), Err(HdrError::Captures));
    }
}
