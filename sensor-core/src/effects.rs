//! Effects: the stages of the signal chain, one file each, and their catalogue.
//!
//! Everything the sensor does to the mean photo-electrons of a row is an effect: the base model of
//! Chen et al. 2009 (shot noise, PRNU, dark current, full well, fixed pattern, read noise) as well as
//! what a camera file adds with `[[effect]]`. An effect belongs to a [`Domain`]; domains run in the
//! order of the physics, effects of one domain in the order in which they are listed.
//!
//! # Adding an effect
//! One file `effects/NAME.rs` with the [`effect!`] declaration (equation, source, parameters with units
//! and ranges) and its [`Stage`]; one line in the [`catalogue!`] below; one test.
//! Numbers in the catalogue name random streams and travel over the rig's link: never reuse one.

mod context;
mod declare;

pub use context::Context;
pub(crate) use declare::{catalogue, effect};

use crate::arith::{Arith, BLOCK, Block};
use crate::stream::{LANES, Lanes};

/// Where in the signal chain an effect acts. Signals are in electrons everywhere, referred to the
/// input: the voltage is signal x conversion gain x analog gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Domain {
    /// Mean photo-electrons before shot noise.
    Light,
    /// Photo-electrons with their shot noise.
    Photo,
    /// All collected charge.
    Charge,
    /// The signal on its way to the converter.
    Voltage,
}

/// What an effect reads beside the pixel itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// Nothing.
    Pixel,
    /// The rows above and below at the same point of the chain.
    Neighbours,
    /// The mean photo-electrons of the same row in the previous frame.
    PreviousFrame,
}

/// What an effect may read. Rows are in blocks; `here` is the row as it came in.
pub struct Inputs<'a, S> {
    /// The row above ([`Needs::Neighbours`]; beyond the edge the edge row itself), else empty.
    pub above: &'a [Block<S>],
    /// The row as it came in ([`Needs::Neighbours`]), else empty.
    pub here: &'a [Block<S>],
    /// The row below ([`Needs::Neighbours`]), else empty.
    pub below: &'a [Block<S>],
    /// The row's mean photo-electrons in the frame before ([`Needs::PreviousFrame`]), else empty.
    pub previous: &'a [Block<S>],
}

/// A stage of the signal chain.
pub trait Stage {
    /// Changes a row in place. Must not panic, and must depend on nothing but its arguments.
    fn apply<A: Arith>(
        &self,
        cx: &Context,
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
    /// What it is.
    pub doc: &'static str,
    /// Smallest value allowed.
    pub min: f32,
    /// Largest value allowed.
    pub max: f32,
    /// Value when left out; `None`: must be given.
    pub default: Option<f32>,
}

/// An entry of the catalogue.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Number in random streams and on the link.
    pub id: u8,
    /// Name in camera files.
    pub kind: &'static str,
    /// First lines of its documentation.
    pub doc: &'static str,
    /// Where it acts.
    pub domain: Domain,
    /// What it reads.
    pub needs: Needs,
    /// Its parameters in order.
    pub parameters: &'static [Parameter],
}

/// Most parameters an effect may have.
pub const MAX_PARAMETERS: usize = 8;

catalogue! {
    1 => shot_noise::ShotNoise,
    2 => prnu::Prnu,
    3 => dark_current::DarkCurrent,
    4 => full_well::FullWell,
    5 => row_offset_fpn::RowOffsetFpn,
    6 => read_noise::ReadNoise,
    7 => charge_coupling::ChargeCoupling,
    8 => hot_pixels::HotPixels,
    9 => defective_pixels::DefectivePixels,
    10 => stuck_pixels::StuckPixels,
    11 => row_temporal_noise::RowTemporalNoise,
    12 => column_offset_fpn::ColumnOffsetFpn,
}

/// Chooses each pixel of a block with probability `fraction` (to 2⁻³²); uses two draws.
#[inline(always)]
pub(crate) fn chosen(lanes: &mut Lanes, fraction: f32) -> Block<bool> {
    let limit = (f64::from(fraction) * 4_294_967_296.0) as u64;
    let (a, b) = (lanes.draw(), lanes.draw());
    let mut out = [false; BLOCK];
    for (i, out) in out.iter_mut().enumerate() {
        let word = if i < LANES { a[i] } else { b[i - LANES] };
        *out = u64::from(word) < limit;
    }
    out
}
