//! Measuring: captures in, figures out. Nothing here sees a camera model: measured and simulated
//! frames are treated alike.

pub mod compare;
pub mod correlation;
pub mod coupling;
pub mod crosstalk;
pub mod dark;
pub mod emva;
pub mod fit;
pub mod gains;
pub mod ladder;
pub mod maps;
pub mod moments;
pub mod mtf;
pub mod patches;
pub mod picture;
pub mod profile;
pub mod ptc;
pub mod rates;
pub mod response;
pub mod rounding;
pub mod site;
pub mod spatial;
pub mod spectrogram;
pub mod stack;
mod strips;
mod sums;
pub mod transfer;
pub mod value;

pub use value::Value;

#[cfg(test)]
pub(crate) mod synthetic;
