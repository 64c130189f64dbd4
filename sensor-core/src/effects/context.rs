//! What a stage knows of the row that it works on, and its random streams.

use crate::arith::{BLOCK, Counts};
use crate::at_gain::AtGain;
use crate::config::Pattern;
use crate::math;
use crate::stream::{Key, Lanes};
use rand_core::Rng;

/// What a stage knows of one row of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Context<'a> {
    /// Pixels in a row.
    pub width: u32,
    /// Rows in a frame.
    pub height: u32,
    /// This row, 0 at the top.
    pub row: u32,
    /// Frame number.
    pub frame: u32,
    /// Actual integration time, s.
    pub exposure_s: f32,
    /// Requested integration time, s.
    pub nominal_exposure_s: f32,
    /// Sensor temperature, °C.
    pub temperature_c: f32,
    /// Analogue gain, as DN per electron over those at unity gain: [`AtGain::relative_gain`].
    pub analog_gain: f32,
    /// DN per input-referred electron at this gain.
    pub dn_per_e: f32,
    /// What the sensor is at the frame's gain.
    pub at_gain: AtGain,
    /// Gain that the signal has had before this stage, of `analog_gain`: see the effect
    /// `gain-stage`. Without it, all gain is at the converter.
    pub passed_gain: f32,
    /// Full well, e⁻: that of the chain's last effect `full-well`, or else the end of the
    /// converter's range at unity gain.
    pub full_well_e: f32,
    /// Charge at which the converter's range ends at unity gain, e⁻.
    pub full_scale_e: f32,
    /// Black level: the DN of zero signal.
    pub black_level_dn: f32,
    /// Largest DN.
    pub max_dn: u16,
    /// Colour filter pattern.
    pub pattern: &'a Pattern,
    /// Tables of the sensor's effects.
    #[cfg(feature = "empirical")]
    pub(crate) table: &'a [f32],
    /// Spread of read noise over pixels (σ of its logarithm), and the root of its streams.
    #[cfg(feature = "read-noise-spread")]
    pub(crate) read_noise_spread: Option<(f32, Key)>,
    /// Root of the streams of exact shot noise, if the chain has that effect.
    #[cfg(feature = "exact-shot-noise")]
    pub(crate) exact_shot_noise: Option<Key>,
    /// Root of this stage's streams on this physical sensor.
    pub(crate) key: Key,
    /// Number of the photodiode or capture whose patterns these are, and of the window or capture
    /// whose noise.
    pub(crate) pattern_of: u8,
    pub(crate) noise_of: u8,
}

/// What a stream depends on in addition to sensor and stage.
#[derive(Clone, Copy)]
enum Over {
    Pixel = 1,
    PixelFrame,
    Column,
    Row,
    RowFrame,
    Frame,
    Sensor,
    ColumnFrame,
    Count,
    CountNormal,
    Word,
    #[cfg(feature = "empirical")]
    Cell,
}

/// The indices before and after `i` of `count`. Beyond its edges the array continues as its mirror
/// image, as in a sensor with dummy pixels around it: the colours of a Bayer pattern keep their
/// order (those of a quad Bayer pattern do not).
#[inline(always)]
pub(crate) fn beside(i: u32, count: u32) -> [u32; 2] {
    let last = count.saturating_sub(1);
    [
        if i > 0 { i - 1 } else { last.min(1) },
        if i < last { i + 1 } else { last.saturating_sub(1) },
    ]
}

impl Context<'_> {
    /// DN per electron of the signal at this stage.
    pub fn dn_per_e_here(&self) -> f32 {
        self.dn_per_e / self.passed_gain
    }

    /// Analogue gain between this stage and the converter.
    pub fn gain_to_come(&self) -> f32 {
        self.analog_gain / self.passed_gain
    }

    /// Signal of this stage at which the converter's range ends.
    pub fn range_e(&self) -> f32 {
        self.full_scale_e / self.gain_to_come()
    }

    /// The factor on noise that is proportional to a power of the gain.
    pub(crate) fn power_of_gain(&self, exponent: f32) -> f32 {
        if exponent == 0.0 { 1.0 } else { math::pow(self.gain_to_come(), exponent) }
    }

    fn stream(&self, part: u32, over: Over) -> Key {
        let number = match over {
            Over::Pixel | Over::Column | Over::Row | Over::Sensor => self.pattern_of,
            _ => self.noise_of,
        };
        let key = self.key.with(part).with(over as u32);
        if number > 0 { key.with(u32::from(number)) } else { key }
    }

    /// Fixed pattern: values per pixel of this physical sensor. `part` distinguishes the draws of
    /// one stage.
    #[inline(always)]
    pub fn per_pixel(&self, part: u32) -> Lanes {
        self.per_pixel_of(part, self.row)
    }

    /// The same for any row: for what a pixel shares with its neighbours.
    #[inline(always)]
    pub fn per_pixel_of(&self, part: u32, row: u32) -> Lanes {
        self.stream(part, Over::Pixel).with(row).lanes()
    }

    /// Temporal noise: values per pixel and frame.
    #[inline(always)]
    pub fn per_pixel_and_frame(&self, part: u32) -> Lanes {
        self.lanes(part, Over::PixelFrame)
    }

    /// The same for any row: for noise that pixels share down a column.
    #[cfg(feature = "empirical")]
    pub(crate) fn per_pixel_and_frame_of(&self, part: u32, row: u32) -> Lanes {
        self.stream(part, Over::PixelFrame).with(self.frame).with(row).lanes()
    }

    /// A standard normal number for a cell of a column in this frame.
    #[cfg(feature = "empirical")]
    pub(crate) fn normal_of_cell(&self, part: u32, cell: u32, column: u32) -> f32 {
        let key = self.stream(part, Over::Cell).with(self.frame).with(cell).with(column);
        let [a, b] = key.words();
        math::box_muller(a, b).0
    }

    /// Values per pixel of this row and frame.
    #[inline(always)]
    fn lanes(&self, part: u32, over: Over) -> Lanes {
        self.stream(part, over).with(self.frame).with(self.row).lanes()
    }

    /// Poisson counts per pixel and frame; see [`Counts::new`].
    #[inline(always)]
    pub fn counts(&self, part: u32, low: bool, high: bool) -> Counts {
        Counts::new(self.lanes(part, Over::Count), self.lanes(part, Over::CountNormal), low, high)
    }

    /// Values per column, the same in each row and frame.
    #[inline(always)]
    pub fn per_column(&self, part: u32) -> Lanes {
        self.stream(part, Over::Column).lanes()
    }

    /// Values per column and frame, the same in each row.
    #[inline(always)]
    pub fn per_column_and_frame(&self, part: u32) -> Lanes {
        self.stream(part, Over::ColumnFrame).with(self.frame).lanes()
    }

    /// Stream of a row (any row, as correlated noise needs its neighbours'), the same in each
    /// frame.
    pub fn per_row(&self, part: u32, row: u32) -> impl Rng + use<> {
        self.stream(part, Over::Row).with(row).scalar()
    }

    /// Stream of a row and frame.
    pub fn per_row_and_frame(&self, part: u32, row: u32) -> impl Rng + use<> {
        self.stream(part, Over::RowFrame).with(self.frame).with(row).scalar()
    }

    /// Stream of a frame (any frame), for the whole sensor.
    pub fn per_frame(&self, part: u32, frame: u32) -> impl Rng + use<> {
        self.stream(part, Over::Frame).with(frame).scalar()
    }

    /// Stream of the sensor.
    pub fn per_sensor(&self, part: u32) -> impl Rng + use<> {
        self.stream(part, Over::Sensor).scalar()
    }

    /// One 32-bit word for a pixel in any frame: for effects on few pixels that depend on other
    /// frames.
    pub fn word(&self, part: u32, frame: u32, column: u32) -> u32 {
        let key = self.stream(part, Over::Word).with(frame).with(self.row).with(column);
        key.scalar().next_u32()
    }

    /// Whether the defect of a pixel is in its upper level: in each frame it is renewed with the
    /// chance `renewal`, and then is up with the chance `duty`. Any frame can be computed without
    /// the others: the last renewal is sought up to 128 frames back (at 0.03 one defect in fifty
    /// reaches that limit and starts afresh).
    #[cfg(any(feature = "random-telegraph-noise", feature = "dark-current-telegraph-noise"))]
    pub(crate) fn telegraph_is_up(&self, column: u32, renewal: f32, duty: f32) -> bool {
        const MEMORY: u32 = 128;
        let mut frame = self.frame;
        for _ in 1..MEMORY {
            if unit(self.word(0, frame, column)) < renewal {
                break;
            }
            frame = frame.wrapping_sub(1);
        }
        unit(self.word(1, frame, column)) < duty
    }

    /// A number of this frame from a first-order autoregression over the frames, of mean 0 and
    /// variance 1: o_n = φ o_(n−1) + √(1−φ²) z_n. Any frame can be computed without the others: o_n
    /// is the sum of the last frames' innovations until their weight falls below 0.001, which
    /// leaves out its square, 1e-6, of the variance.
    #[cfg(any(feature = "frame-offset-noise", feature = "frame-offset-by-site"))]
    pub(crate) fn wandering(&self, part: u32, correlation: f32) -> f32 {
        const MIN_WEIGHT: f32 = 1e-3;
        let (mut sum, mut total, mut weight, mut frame) = (0.0, 0.0, 1.0, self.frame);
        while weight > MIN_WEIGHT {
            sum += weight * normal(&mut self.per_frame(part, frame));
            total += weight * weight;
            weight *= correlation;
            frame = frame.wrapping_sub(1);
        }
        sum * math::rsqrt(total)
    }

    /// Channel of the pixel in this column of this row.
    #[inline(always)]
    pub fn channel(&self, column: usize) -> usize {
        self.pattern.channel(column, self.row as usize)
    }

    /// Square of the distance from the centre, 1 at the corners; `u` is the position along the
    /// row,
    /// -1..1.
    #[inline(always)]
    pub fn field2(&self, u: f32) -> f32 {
        let (w, h) = (self.width as f32, self.height as f32);
        let (dx, dy) = (u * w, self.y() * h);
        (dx * dx + dy * dy) / (w * w + h * h)
    }

    /// Position of pixel `i` of block `block` in -1..1 over the sensor's half width.
    #[inline(always)]
    pub fn x(&self, block: usize, i: usize) -> f32 {
        ((block * BLOCK + i) as f32 + 0.5) / self.width as f32 * 2.0 - 1.0
    }

    /// Position of the row in -1..1 over the sensor's half height, down.
    #[inline(always)]
    pub fn y(&self) -> f32 {
        (self.row as f32 + 0.5) / self.height as f32 * 2.0 - 1.0
    }
}

/// A uniform number in the open interval 0 to 1 from 32 bits.
#[inline(always)]
pub(crate) fn unit(word: u32) -> f32 {
    // Its upper 24 bits, so that rounding cannot reach 1.
    ((word >> 8) as f32 + 0.5) * (1.0 / 16_777_216.0)
}

/// Above −ln u of the smallest number of [`unit`], 2⁻²⁵: 17.33.
pub(crate) const MAX_EXPONENTIAL: f32 = 17.4;

/// One standard normal number from a scalar stream.
pub(crate) fn normal(rng: &mut impl Rng) -> f32 {
    math::box_muller(rng.next_u32(), rng.next_u32()).0
}
