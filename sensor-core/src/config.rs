//! What a sensor is: everything that stays fixed from frame to frame, and the settings of one
//! frame.

use crate::arith::MAX_SIGNAL_E;
pub use crate::at_gain::AtGain;
use crate::effects::{Class, Domain, Effect, Entry, MAX_PARAMETERS, MAX_TABLE, Needs, Parameter};
use core::fmt;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Number of the effect `shot-noise` in the catalogue.
const SHOT_NOISE: u8 = 1;

/// Largest number of effects in a chain that read their neighbours.
pub const MAX_WINDOWS: usize = 4;

/// Largest number of channels of a colour filter array: 25, which are 6.3 KiB of
/// [`SensorConfig::response`], with the feature `multispectral`, else 4.
pub const MAX_CHANNELS: usize = if cfg!(feature = "multispectral") { 25 } else { 4 };
/// Largest number of spectral bands.
pub const MAX_BANDS: usize = 64;
/// Largest number of effects in a chain.
pub const MAX_EFFECTS: usize = 32;
/// Largest side of a repeating colour filter pattern.
pub const MAX_PATTERN: usize = 8;
/// Numbers of columns of a repeating colour filter pattern: with 5 where there may be that many
/// channels.
pub const PATTERN_WIDTHS: &[u8] =
    if cfg!(feature = "multispectral") { &[1, 2, 3, 4, 5, 6, 8] } else { &[1, 2, 3, 4, 6, 8] };
/// Largest width and height, pixels.
pub const MAX_SIDE: u32 = 32_768;

/// A colour filter pattern: the channel of each pixel of a tile that repeats over the sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Pattern {
    /// Columns of the tile, one of [`PATTERN_WIDTHS`].
    pub width: u8,
    /// Rows of the tile.
    pub height: u8,
    /// Channels, row-major, `width * height` of them.
    pub channels: heapless::Vec<u8, { MAX_PATTERN * MAX_PATTERN }>,
}

impl Pattern {
    /// A tile of `width` columns and `height` rows with these channels, row by row:
    /// `Pattern::new(2, 2, [0, 1, 1, 2])` is red, green, green, blue. [`SensorConfig::check`]
    /// refuses a list that is too long or too short.
    pub fn new(width: u8, height: u8, channels: impl IntoIterator<Item = u8>) -> Self {
        let channels = channels.into_iter().take(MAX_PATTERN * MAX_PATTERN).collect();
        Self { width, height, channels }
    }

    /// The channel at column x, row y.
    #[inline(always)]
    pub fn channel(&self, x: usize, y: usize) -> usize {
        let (w, h) = (usize::from(self.width).max(1), usize::from(self.height).max(1));
        self.channels.get((y % h) * w + x % w).map_or(0, |&c| usize::from(c))
    }
}

/// A sensor. [`SensorConfig::new`] makes a simple one, whose fields are then set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SensorConfig {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Colour filter pattern.
    pub pattern: Pattern,
    /// Number of channels of the colour filter array.
    pub channels: u8,
    /// Number of spectral bands.
    pub bands: u8,
    /// Centre of band 0, nm.
    pub first_band_nm: f32,
    /// Distance between the centres of bands, nm.
    pub band_step_nm: f32,
    /// Electrons per second for an irradiance of 1 W m⁻² nm⁻¹ in a band, `[channel * bands +
    /// band]`: A QE(λ) S(λ) λ/(hc) Δλ with A the photosensitive area (eq. 8 and 9).
    pub response: heapless::Vec<f32, { MAX_CHANNELS * MAX_BANDS }>,
    /// Charge at which the converter's range ends at unity gain, e⁻: W of eq. 11. What a pixel
    /// holds is a parameter of the effect [`full-well`](crate::effects::full_well).
    pub full_well_e: f32,
    /// Bits of the converter, 8 to 16.
    pub bits: u8,
    /// Black level: the DN of zero signal.
    pub black_level_dn: f32,
    /// Seed of this physical sensor: determines every fixed pattern.
    pub seed: u64,
    /// The signal chain, in the order of the physics (see [`SensorConfig::check`]).
    pub effects: heapless::Vec<Effect, MAX_EFFECTS>,
    /// Which capture of a pixel it is. On the link it follows the configuration.
    #[serde(skip)]
    pub streams: Streams,
    /// Tables of effects that have one ([`empirical`](crate::effects::empirical),
    /// [`gain_table`](crate::effects::gain_table)), each as the number of its words, then the words.
    /// On the link it follows the crosstalk table.
    #[serde(skip)]
    pub table: heapless::Vec<f32, MAX_TABLE>,
}

/// Which capture of a pixel a sensor is, where several are taken ([`hdr`](crate::hdr)). Random
/// numbers depend on it; those of capture 0 are those of a sensor with one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Streams {
    /// The photodiode: fixed patterns of light and charge.
    pub photodiode: u8,
    /// The window, one integration of a photodiode: counts of light and charge, which all captures
    /// of the window share.
    pub window: u8,
    /// The capture: patterns and noise of the voltage.
    pub capture: u8,
}

/// What may change from frame to frame. [`FrameSettings::new`] makes those of a first frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct FrameSettings {
    /// Frame number: selects the temporal noise.
    pub frame: u32,
    /// Integration time, s.
    pub exposure_s: f32,
    /// Analogue gain, 1 = unity.
    pub analog_gain: f32,
    /// Sensor temperature, °C.
    pub temperature_c: f32,
    /// Integration time of the previous frame, s, for effects that remember it; `None` where it is
    /// that of this frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub previous_exposure_s: Option<f32>,
}

/// Why a sensor, the settings of a frame or the memory for it were refused.
///
/// The text ([`fmt::Display`]) says what is wrong, where, and what would be accepted.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum ConfigError {
    /// Width or height is 0 or above [`MAX_SIDE`].
    Size,
    /// The pattern is incomplete, or refers to a channel that the sensor does not have.
    Pattern,
    /// The bands' wavelengths are not finite.
    Bands,
    /// The response does not have one finite value of 0 or more per channel and band.
    Response,
    /// Full well is not within 1 to 524287 e⁻, bits not within 8 to 16, or the black level not on
    /// the converter's scale.
    Converter,
    /// Exposure or gain is not a positive number, or the temperature not finite.
    Settings,
    /// The memory handed in is too small.
    Memory,
    /// The crosstalk table is not a complete rectangular grid of finite factors of 0 or more.
    Crosstalk,
    /// A parameter of an effect is not finite or out of its range.
    Parameter {
        /// Position of the effect in [`SensorConfig::effects`], from 0.
        position: usize,
        /// The effect.
        effect: &'static Entry,
        /// The parameter, with its unit and the accepted range.
        parameter: &'static Parameter,
        /// The value that was refused, in the parameter's unit.
        value: f32,
    },
    /// An effect comes after one of a later [`Domain`], or one on light after shot noise.
    Order {
        /// Position of the effect in [`SensorConfig::effects`], from 0.
        position: usize,
        /// The effect, and where it acts.
        effect: (&'static Entry, Domain),
        /// The effect just before it, which acts later in the signal chain.
        after: (&'static Entry, Domain),
    },
    /// The table of an effect that has one is missing or not one of its shape, or its quantity has no
    /// such shape.
    Table {
        /// Position of the effect in [`SensorConfig::effects`], from 0.
        position: usize,
    },
    /// More than [`MAX_WINDOWS`] effects read neighbouring rows.
    Windows {
        /// How many do.
        count: usize,
    },
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size => write!(f, "width and height must be 1 to {MAX_SIDE} pixels"),
            Self::Pattern => write!(
                f,
                "the colour filter pattern must be one of {PATTERN_WIDTHS:?} columns wide and name \
                 a channel of the sensor in each cell"
            ),
            Self::Bands => f.write_str("the wavelengths of the bands must be finite, in nm"),
            Self::Response => write!(
                f,
                "the response must have one finite value of 0 or more for each of 1 to \
                 {MAX_CHANNELS} channels and 1 to {MAX_BANDS} bands"
            ),
            Self::Converter => write!(
                f,
                "full well must be 1 to {MAX_SIGNAL_E} e-, the converter must have 8 to 16 bits, \
                 and the black level must lie between 0 and the largest DN"
            ),
            Self::Settings => f.write_str(
                "exposure (s) and analogue gain must be positive numbers, the temperature (degC) \
                 finite",
            ),
            Self::Memory => f.write_str(
                "the memory is too small; pipeline::memory_blocks says how much is needed",
            ),
            Self::Crosstalk => f.write_str(
                "the crosstalk table must be a complete grid of finite factors of 0 or more, its \
                 positions and wavelengths rising",
            ),
            Self::Parameter { position, effect, parameter: p, value } => write!(
                f,
                "effect {position} ({}): {} = {value}; it must be {} to {} {}",
                effect.kind, p.key, p.min, p.max, p.unit
            ),
            Self::Order { position, effect, after } => write!(
                f,
                "effect {position} ({}) acts on {}, but follows {}, which acts on {}; the order \
                 is light, shot noise, photo-electrons, charge, voltage",
                effect.0.kind, effect.1, after.0.kind, after.1
            ),
            Self::Table { position } => write!(
                f,
                "effect {position} has no table of its form, or a shape that its quantity does \
                 not have"
            ),
            Self::Windows { count } => write!(
                f,
                "{count} effects read neighbouring rows; a chain takes at most {MAX_WINDOWS}"
            ),
        }
    }
}

impl core::error::Error for ConfigError {}

impl ConfigError {
    /// A name for programs, which does not change when the text does: `size`, `pattern`, `bands`,
    /// `response`, `converter`, `settings`, `memory`, `crosstalk`, `parameter`, `order`, `table` or
    /// `windows`.
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Size => "size",
            Self::Pattern => "pattern",
            Self::Bands => "bands",
            Self::Response => "response",
            Self::Converter => "converter",
            Self::Settings => "settings",
            Self::Memory => "memory",
            Self::Crosstalk => "crosstalk",
            Self::Parameter { .. } => "parameter",
            Self::Order { .. } => "order",
            Self::Table { .. } => "table",
            Self::Windows { .. } => "windows",
        }
    }
}

impl SensorConfig {
    /// A monochrome sensor without noise, to be changed field by field: one band at 550 nm with a
    /// response of 1 e⁻/s per W m⁻² nm⁻¹, 12 bits over a full well of 10 000 e⁻, a black level of
    /// 64 DN, seed 0, and no effects.
    ///
    /// ```
    /// use camrig_sensor_core::config::{Pattern, SensorConfig};
    /// let mut sensor = SensorConfig::new(640, 480);
    /// sensor.pattern = Pattern::new(2, 2, [0, 1, 1, 2]);
    /// sensor.channels = 3;
    /// sensor.response = [1e6, 2e6, 1e6].into_iter().collect();
    /// assert_eq!(sensor.check(), Ok(()));
    /// ```
    pub fn new(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            pattern: Pattern::new(1, 1, [0]),
            channels: 1,
            bands: 1,
            first_band_nm: 550.0,
            band_step_nm: 10.0,
            response: [1.0].into_iter().collect(),
            full_well_e: 10_000.0,
            bits: 12,
            black_level_dn: 64.0,
            seed: 0,
            effects: heapless::Vec::new(),
            streams: Streams::default(),
            table: heapless::Vec::new(),
        }
    }

    /// Checks everything that the row loop relies on: sizes, pattern, response, converter, and the
    /// chain of effects.
    ///
    /// Effects must come in the order of the physics: their [domains](crate::effects::Domain) must
    /// not fall along the chain, and shot noise is the last of those on light. Within a domain they
    /// act in the order in which they are listed.
    ///
    /// # Errors
    /// The first thing found wrong.
    pub fn check(&self) -> Result<(), ConfigError> {
        if !(1..=MAX_SIDE).contains(&self.width) || !(1..=MAX_SIDE).contains(&self.height) {
            return Err(ConfigError::Size);
        }
        let (pw, ph) = (usize::from(self.pattern.width), usize::from(self.pattern.height));
        if !PATTERN_WIDTHS.contains(&self.pattern.width)
            || ph == 0
            || self.pattern.channels.len() != pw * ph
            || self.pattern.channels.iter().any(|&c| c >= self.channels)
        {
            return Err(ConfigError::Pattern);
        }
        let (channels, bands) = (usize::from(self.channels), usize::from(self.bands));
        if !(1..=MAX_CHANNELS).contains(&channels)
            || !(1..=MAX_BANDS).contains(&bands)
            || self.response.len() != channels * bands
            || !self.response.iter().all(|w| w.is_finite() && *w >= 0.0)
        {
            return Err(ConfigError::Response);
        }
        if !self.first_band_nm.is_finite() || !self.band_step_nm.is_finite() {
            return Err(ConfigError::Bands);
        }
        let max_dn = self.max_dn();
        if !(1.0..=MAX_SIGNAL_E).contains(&self.full_well_e)
            || !(8..=16).contains(&self.bits)
            || !(0.0..f32::from(max_dn)).contains(&self.black_level_dn)
        {
            return Err(ConfigError::Converter);
        }
        self.check_effects()
    }

    /// Parameters within their ranges, domains in order, and windows few enough.
    fn check_effects(&self) -> Result<(), ConfigError> {
        let mut before: Option<(&'static Entry, Domain)> = None;
        for (position, effect) in self.effects.iter().enumerate() {
            let entry = effect.entry();
            for (parameter, value) in entry.parameters.iter().zip(effect.values()) {
                if !parameter.accepts(value) {
                    return Err(ConfigError::Parameter {
                        position,
                        effect: entry,
                        parameter,
                        value,
                    });
                }
            }
            let has_its_table = match effect {
                #[cfg(feature = "empirical")]
                Effect::Empirical(e) => e.fits(&self.table),
                #[cfg(feature = "gain-table")]
                Effect::GainTable(e) => e.fits(&self.table),
                _ => true,
            };
            if !has_its_table {
                return Err(ConfigError::Table { position });
            }
            let here = (entry, effect.domain());
            // What changes light changes its shot noise with it.
            let counted = |after: &'static Entry| {
                after.id == SHOT_NOISE && here.1 == Domain::Light && entry.class != Class::Shot
            };
            if let Some(after) = before
                && (here.1 < after.1 || counted(after.0))
            {
                return Err(ConfigError::Order { position, effect: here, after });
            }
            before = Some(here);
        }
        let reads_neighbours = |e: &&Effect| e.entry().needs == Needs::Neighbours;
        let count = self.effects.iter().filter(reads_neighbours).count();
        if count > MAX_WINDOWS {
            return Err(ConfigError::Windows { count });
        }
        Ok(())
    }

    /// Largest DN, 2^bits − 1.
    pub fn max_dn(&self) -> u16 {
        ((1u32 << self.bits.clamp(1, 16)) - 1) as u16
    }

    /// Charge at which the converter's range ends at unity gain, e⁻: W, or (2^bits − 1) over the DN
    /// per electron of a gain table.
    pub(crate) fn full_scale_e(&self) -> f32 {
        let (_, [_, dn_per_e, ..]) = self.by_table(1.0);
        dn_per_e.map_or(self.full_well_e, |k| f32::from(self.max_dn()) / k)
    }

    /// The analogue part of a gain, and the values there of the chain's (first)
    /// [`gain-table`](crate::effects::gain_table), as far as it has one.
    fn by_table(&self, gain: f32) -> (f32, [Option<f32>; AtGain::PLACE - 1]) {
        #[cfg(feature = "gain-table")]
        for effect in &self.effects {
            if let Effect::GainTable(e) = effect {
                let analog_gain = gain.min(e.digital_above);
                return (analog_gain, e.values_at(&self.table, analog_gain));
            }
        }
        (gain, [None; AtGain::PLACE - 1])
    }

    /// What the sensor is at a gain: its DN per electron is G (2^bits − 1) / W (eq. 11: the step of
    /// the converter is full well x conversion gain / (2^bits − 1) volts), unless the chain has a
    /// [`gain-table`](crate::effects::gain_table).
    pub fn at_gain(&self, gain: f32) -> AtGain {
        let (analog_gain, [read_e, dn_per_e, black_level_dn, well_e]) = self.by_table(gain);
        let in_proportion = analog_gain * f32::from(self.max_dn()) / self.full_well_e;
        let (_, [_, at_unity, ..]) = self.by_table(1.0);
        let relative = |dn_per_e: f32| at_unity.map(|at_unity| dn_per_e / at_unity);
        AtGain {
            analog_gain,
            digital_gain: gain / analog_gain,
            dn_per_e: dn_per_e.unwrap_or(in_proportion),
            relative_gain: dn_per_e.and_then(relative).unwrap_or(analog_gain),
            black_level_dn: black_level_dn.unwrap_or(self.black_level_dn),
            read_e,
            well_e,
        }
    }

    /// DN per input-referred electron at a gain, its digital part included.
    pub fn dn_per_e(&self, gain: f32) -> f32 {
        let at = self.at_gain(gain);
        at.dn_per_e * at.digital_gain
    }
}

impl FrameSettings {
    /// Frame 0 with this integration time, s, at unity gain and 25 °C.
    pub const fn new(exposure_s: f32) -> Self {
        Self {
            frame: 0,
            exposure_s,
            analog_gain: 1.0,
            temperature_c: 25.0,
            previous_exposure_s: None,
        }
    }

    /// The same with another frame number.
    #[must_use]
    pub const fn with_frame(self, frame: u32) -> Self {
        Self { frame, ..self }
    }

    /// The same with another integration time, s.
    #[must_use]
    pub const fn with_exposure(self, exposure_s: f32) -> Self {
        Self { exposure_s, ..self }
    }

    /// The same after a frame with this integration time, s.
    #[must_use]
    pub const fn after_exposure(self, previous_exposure_s: f32) -> Self {
        Self { previous_exposure_s: Some(previous_exposure_s), ..self }
    }

    /// The settings of the frame before, as far as effects remember it.
    pub(crate) fn previous(&self) -> Self {
        let exposure_s = self.previous_exposure_s.unwrap_or(self.exposure_s);
        Self { frame: self.frame.wrapping_sub(1), exposure_s, ..*self }
    }

    /// The same with another analogue gain, 1 = unity.
    #[must_use]
    pub const fn with_gain(self, analog_gain: f32) -> Self {
        Self { analog_gain, ..self }
    }

    /// The same at another temperature, °C.
    #[must_use]
    pub const fn with_temperature(self, temperature_c: f32) -> Self {
        Self { temperature_c, ..self }
    }

    /// Checks that exposures and gain are positive finite numbers and the temperature is finite.
    ///
    /// # Errors
    /// [`ConfigError::Settings`].
    pub fn check(&self) -> Result<(), ConfigError> {
        let positive = |v: f32| v.is_finite() && v > 0.0;
        if positive(self.exposure_s)
            && positive(self.analog_gain)
            && self.temperature_c.is_finite()
            && self.previous_exposure_s.is_none_or(positive)
        {
            Ok(())
        } else {
            Err(ConfigError::Settings)
        }
    }
}

/// On the link an effect is its number in the catalogue and its values.
#[derive(Serialize, Deserialize)]
struct WireEffect {
    id: u8,
    values: heapless::Vec<f32, MAX_PARAMETERS>,
}

impl Serialize for Effect {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        WireEffect { id: self.entry().id, values: self.values() }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Effect {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let wire = WireEffect::deserialize(deserializer)?;
        Effect::new(wire.id, &wire.values).ok_or_else(|| {
            serde::de::Error::custom(
                "an effect that this build does not have, or a parameter out of its range",
            )
        })
    }
}
