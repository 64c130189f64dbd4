//! Effects: the stages of the signal chain, one file each, and their catalogue.
//!
//! Everything the sensor does to the mean photo-electrons of a row is an effect: the base model of
//! Chen et al. 2009 (shot noise, PRNU, dark current, full well, fixed pattern, read noise) as well
//! as what a camera file adds with `[[effect]]`. An effect belongs to a [`Domain`]. Domains must
//! come in the order of the physics ([`SensorConfig::check`](crate::config::SensorConfig::check)
//! refuses any other); effects of one domain act in the order in which they are listed.
//!
//! # Adding an effect
//! One file `effects/NAME.rs` with the `effect!` declaration (equation, source, closed form, domain,
//! class, parameters with units and ranges) and its [`Stage`]; one line in the `catalogue!` below; one
//! feature in `Cargo.toml`; one test. Numbers in the catalogue name random streams and travel over
//! the rig's link, and so do the parameters by their order: neither ever changes. Another parameter
//! comes last, with a default that leaves the effect what it was: older hosts do not send it.
//!
//! # Leaving effects out
//! The base model, effects 1 to 7, is always compiled: eq. 10 of Chen et al. 2009 and the coupling
//! of neighbours. Every other effect is compiled with the cargo feature of its name; `catalogue`
//! is all of them. [`Effect::CATALOGUE`] lists what this build has.

mod context;
mod declare;

pub use context::Context;
pub(crate) use context::beside;
pub(crate) use declare::{catalogue, effect};

use crate::arith::{Arith, BLOCK, Block, EXPANSION_FROM_E};
use crate::at_gain::AtGain;
use crate::stream::{LANES, Lanes};
use core::fmt;

/// Where in the signal chain an effect acts. Signals are in electrons everywhere, referred to the
/// input: the voltage is signal x conversion gain x analog gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Domain {
    /// Mean photo-electrons before shot noise, e⁻.
    Light,
    /// Photo-electrons with their shot noise, e⁻.
    Photo,
    /// All collected charge, photo-electrons and dark charge, e⁻.
    Charge,
    /// The signal on its way to the converter, input-referred, e⁻.
    Voltage,
}

impl Domain {
    /// The quantity that effects of this domain act on.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Photo => "photo-electrons",
            Self::Charge => "charge",
            Self::Voltage => "voltage",
        }
    }

    /// Whether its signals are in the range of light ([`Arith::Light`]), else in that of charge.
    pub(crate) const fn is_of_light(self) -> bool {
        matches!(self, Self::Light | Self::Photo)
    }
}

impl fmt::Display for Domain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What an effect is to a picture: how light becomes signal, or a kind of noise or pattern on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Class {
    /// Shapes the mean signal: full well, non-linearity, crosstalk, illumination and the like.
    Response,
    /// Shot noise of light.
    Shot,
    /// Any other noise that changes from frame to frame.
    Temporal,
    /// Fixed pattern: differences between pixels, rows or columns that stay.
    Pattern,
    /// Signal without light: dark current, glow.
    Dark,
    /// Single pixels that are out of order.
    Defect,
}

/// What an effect reads in addition to the pixel itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Needs {
    /// Nothing.
    Pixel,
    /// The rows above and below at the same point of the chain.
    Neighbours,
    /// The light of the same row in the previous frame, as the effect would have found it there.
    PreviousFrame,
    /// The charge that all earlier frames left in the row's traps, which the source of the light
    /// keeps ([`MeanRows::traps`](crate::pipeline::MeanRows::traps)).
    EarlierFrames,
}

/// What an effect may read in addition to the row that it changes. Rows are in blocks, signals in
/// e⁻.
#[non_exhaustive]
pub struct Inputs<'a, S> {
    /// The row above ([`Needs::Neighbours`]; at the upper edge the row below), else empty.
    pub above: &'a [Block<S>],
    /// The row itself before this effect ([`Needs::Neighbours`]), else empty.
    pub here: &'a [Block<S>],
    /// The row below ([`Needs::Neighbours`]; at the lower edge the row above), else empty.
    pub below: &'a [Block<S>],
    /// The row's light in the previous frame, before this effect ([`Needs::PreviousFrame`]), else
    /// empty.
    pub previous: &'a [Block<S>],
}

/// A stage of the signal chain.
pub trait Stage {
    /// Changes the context of the frame's stages, once before its first row: for effects that alter
    /// the settings of other stages instead of the signal. Does nothing by default. Effects are
    /// prepared in the order of the chain; `cx` has this effect's own random streams.
    fn prepare(&self, cx: &mut Context<'_>) {
        let _ = cx;
    }

    /// Changes a row in place; signals are in electrons (e⁻). Must not panic, and must depend on
    /// nothing but its arguments.
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        inputs: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    );
}

/// A parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Key in a camera file.
    pub key: &'static str,
    /// Unit ("1" where it has none).
    pub unit: &'static str,
    /// What it is (empty without the feature `texts`).
    pub doc: &'static str,
    /// Smallest value allowed, in the unit.
    pub min: f32,
    /// Largest value allowed, in the unit.
    pub max: f32,
    /// Value when a camera file leaves it out; `None`: it must be given.
    pub default: Option<f32>,
}

impl Parameter {
    /// Whether a value is finite and within the range.
    pub fn accepts(&self, value: f32) -> bool {
        (self.min..=self.max).contains(&value)
    }
}

/// An entry of the catalogue.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Entry {
    /// Number in random streams and on the link.
    pub id: u8,
    /// Name in camera files.
    pub kind: &'static str,
    /// Its documentation: what it is, equation, source (empty without the feature `texts`).
    pub doc: &'static str,
    /// Where it acts.
    pub domain: Domain,
    /// What it is to a picture.
    pub class: Class,
    /// What it reads.
    pub needs: Needs,
    /// Its parameters in order.
    pub parameters: &'static [Parameter],
}

/// Largest number of parameters of an effect.
pub const MAX_PARAMETERS: usize = 10;

/// Words (f32) of the tables of all effects of a sensor that have one: 4 KiB; in a build without
/// empirical effects those of one gain table, or none.
pub const MAX_TABLE: usize = if cfg!(feature = "empirical") {
    1024
} else if cfg!(feature = "gain-table") {
    1 + AtGain::PLACE * AtGain::MAX_PLACES
} else {
    0
};

/// The words of a sensor's table that begin at `start` with their number.
#[cfg(any(feature = "empirical", feature = "gain-table"))]
fn own_table(table: &[f32], start: f32) -> &[f32] {
    let from = table.get(start as usize..).unwrap_or(&[]);
    let Some((count, rest)) = from.split_first() else { return &[] };
    rest.get(..*count as usize).unwrap_or(&[])
}

/// A text of the catalogue with the feature `texts`, else an empty one.
const fn text(text: &'static str) -> &'static str {
    if cfg!(feature = "texts") { text } else { "" }
}

catalogue! {
    1 => shot_noise::ShotNoise,
    2 => prnu::Prnu,
    3 => dark_current::DarkCurrent,
    4 => full_well::FullWell,
    5 => row_offset_fpn::RowOffsetFpn,
    6 => read_noise::ReadNoise,
    7 => charge_coupling::ChargeCoupling,
    8 => hot_pixels::HotPixels if "hot-pixels",
    9 => defective_pixels::DefectivePixels if "defective-pixels",
    10 => stuck_pixels::StuckPixels if "stuck-pixels",
    11 => row_temporal_noise::RowTemporalNoise if "row-temporal-noise",
    12 => column_offset_fpn::ColumnOffsetFpn if "column-offset-fpn",
    13 => column_temporal_noise::ColumnTemporalNoise if "column-temporal-noise",
    14 => row_correlated_noise::RowCorrelatedNoise if "row-correlated-noise",
    15 => periodic_pattern_noise::PeriodicPatternNoise if "periodic-pattern-noise",
    16 => read_noise_spread::ReadNoiseSpread if "read-noise-spread",
    17 => random_telegraph_noise::RandomTelegraphNoise if "random-telegraph-noise",
    18 => heavy_tailed_read_noise::HeavyTailedReadNoise if "heavy-tailed-read-noise",
    19 => reset_noise::ResetNoise if "reset-noise",
    20 => frame_offset_noise::FrameOffsetNoise if "frame-offset-noise",
    21 => readout_channel_mismatch::ReadoutChannelMismatch if "readout-channel-mismatch",
    22 => readout_channel_crosstalk::ReadoutChannelCrosstalk if "readout-channel-crosstalk",
    23 => pixel_offset_fpn::PixelOffsetFpn if "pixel-offset-fpn",
    24 => amp_glow::AmpGlow if "amp-glow",
    25 => dark_current_gradient::DarkCurrentGradient if "dark-current-gradient",
    26 => black_level_offset::BlackLevelOffset if "black-level-offset",
    27 => column_gain_fpn::ColumnGainFpn if "column-gain-fpn",
    28 => prnu_low_frequency::PrnuLowFrequency if "prnu-low-frequency",
    29 => nonlinearity::Nonlinearity if "nonlinearity",
    30 => brighter_fatter::BrighterFatter if "brighter-fatter",
    31 => optical_crosstalk::OpticalCrosstalk if "optical-crosstalk",
    32 => adc_nonlinearity::AdcNonlinearity if "adc-nonlinearity",
    33 => companding::Companding if "companding",
    34 => image_lag::ImageLag if "image-lag",
    35 => black_sun::BlackSun if "black-sun",
    36 => exposure_offset::ExposureOffset if "exposure-offset",
    37 => fringing::Fringing if "fringing",
    38 => green_imbalance::GreenImbalance if "green-imbalance",
    39 => pdaf_pattern::PdafPattern if "pdaf-pattern",
    40 => flicker_banding::FlickerBanding if "flicker-banding",
    41 => light_flicker::LightFlicker if "light-flicker",
    42 => colour_shading::ColourShading if "colour-shading",
    43 => relative_illumination::RelativeIllumination if "relative-illumination",
    44 => offset_clipping::OffsetClipping if "offset-clipping",
    45 => blooming::Blooming if "blooming",
    46 => exact_shot_noise::ExactShotNoise if "exact-shot-noise",
    47 => system_gain::SystemGain if "system-gain",
    48 => quantum_efficiency::QuantumEfficiency if "quantum-efficiency",
    49 => prnu_correlated::PrnuCorrelated if "prnu-correlated",
    50 => empirical::Empirical if "empirical",
    51 => gain_stage::GainStage if "gain-stage",
    52 => gain_table::GainTable if "gain-table",
    53 => dark_current_telegraph_noise::DarkCurrentTelegraphNoise if "dark-current-telegraph-noise",
    54 => defective_columns::DefectiveColumns if "defective-columns",
    55 => particle_hits::ParticleHits if "particle-hits",
    56 => frame_offset_by_site::FrameOffsetBySite if "frame-offset-by-site",
    57 => dark_current_by_site::DarkCurrentBySite if "dark-current-by-site",
    58 => defective_areas::DefectiveAreas if "defective-areas",
    59 => charge_transfer_inefficiency::ChargeTransferInefficiency if "charge-transfer-inefficiency",
    60 => persistence::Persistence if "persistence",
    61 => requantised::Requantised if "requantised",
    62 => gain_by_site::GainBySite if "gain-by-site",
}

impl Effect {
    /// Where it acts: the domain of its entry, except that of an empirical effect, which depends
    /// on its quantity.
    pub const fn domain(&self) -> Domain {
        match self {
            #[cfg(feature = "empirical")]
            Effect::Empirical(e) => e.domain(),
            _ => self.entry().domain,
        }
    }

    /// What it is to a picture: the class of its entry, except that of an empirical effect, which
    /// depends on its quantity.
    pub const fn class(&self) -> Class {
        match self {
            #[cfg(feature = "empirical")]
            Effect::Empirical(e) => e.class(),
            _ => self.entry().class,
        }
    }
}

/// Selects each pixel of a block with probability `fraction` (in steps of 2⁻³²); uses two draws.
#[inline(always)]
pub(crate) fn chosen(lanes: &mut Lanes, fraction: f32) -> Block<bool> {
    let limit = (f64::from(fraction) * 4_294_967_296.0) as u64;
    let words = words(lanes);
    let mut out = [false; BLOCK];
    for i in 0..BLOCK {
        out[i] = u64::from(words[i]) < limit;
    }
    out
}

/// The words of two draws, as one block.
#[inline(always)]
pub(crate) fn words(lanes: &mut Lanes) -> Block<u32> {
    let mut out = [0; BLOCK];
    let (a, b) = out.split_at_mut(LANES);
    a.copy_from_slice(&lanes.draw());
    b.copy_from_slice(&lanes.draw());
    out
}

/// v += σ z, z standard normal, for each pixel.
#[inline(always)]
fn add_normals<A: Arith>(row: &mut [Block<A::Signal>], sigma_e: f32, mut lanes: Lanes) {
    let sigma = A::signal(sigma_e);
    for block in row {
        let z = A::normals(&mut lanes);
        for i in 0..BLOCK {
            block[i] = A::add(block[i], A::scale(sigma, z[i]));
        }
    }
}

/// v *= 1 + σ z, z standard normal, for each pixel.
#[inline(always)]
fn scale_by_normals<A: Arith>(row: &mut [Block<A::Signal>], sigma: f32, mut lanes: Lanes) {
    let sigma = A::factor(sigma);
    for block in row {
        let z = A::normals(&mut lanes);
        for i in 0..BLOCK {
            block[i] = A::scale(block[i], A::gain(sigma, z[i]));
        }
    }
}

/// v += offset for the whole row.
#[inline(always)]
fn add_offset<A: Arith>(row: &mut [Block<A::Signal>], offset_e: f32) {
    let offset = A::signal(offset_e);
    for v in row.as_flattened_mut() {
        *v = A::add(*v, offset);
    }
}

/// v *= gain for the whole row.
#[inline(always)]
fn scale_all<A: Arith>(row: &mut [Block<A::Signal>], gain: f32) {
    for v in row.as_flattened_mut() {
        *v = A::times(*v, gain);
    }
}

/// v *= gain(column, position in -1..1) for each pixel.
#[inline(always)]
fn scale_by_place<A: Arith>(
    cx: &Context<'_>,
    row: &mut [Block<A::Signal>],
    gain: impl Fn(usize, f32) -> f32,
) {
    for (b, block) in row.iter_mut().enumerate() {
        for (i, v) in block.iter_mut().enumerate() {
            *v = A::times(*v, gain(b * BLOCK + i, cx.x(b, i)));
        }
    }
}

/// v += Poisson(mean(position in -1..1)) for each pixel; means are at most `largest_e` (e⁻).
#[inline(always)]
fn add_counts<A: Arith>(
    cx: &Context<'_>,
    row: &mut [Block<A::Signal>],
    largest_e: f32,
    mean: impl Fn(f32) -> f32,
) {
    let mut counts = cx.counts(0, true, largest_e >= EXPANSION_FROM_E);
    for (b, block) in row.iter_mut().enumerate() {
        let mut extra = [A::Signal::default(); BLOCK];
        for (i, extra) in extra.iter_mut().enumerate() {
            *extra = A::signal(mean(cx.x(b, i)));
        }
        A::poisson(core::slice::from_mut(&mut extra), &mut counts);
        for (v, e) in block.iter_mut().zip(extra) {
            *v = A::add(*v, e);
        }
    }
}

/// |x| from which exp(−|x|) is below half a unit in the last place of 1 in f32: 2⁻²⁴ is
/// exp(−16.6).
const EXP_VANISHES: f32 = 17.0;

/// Soft knee: min(q, limit) with a transition over `width`, q − w ln(1 + exp((q − limit)/w)).
#[inline(always)]
fn soft_min(q: f32, limit: f32, width: f32) -> f32 {
    let t = (q - limit) / width;
    if t < -EXP_VANISHES {
        q
    } else if t > EXP_VANISHES {
        limit
    } else {
        q - width * crate::math::ln(1.0 + crate::math::exp(t))
    }
}
