//! What every crate of camrig shares, above all [`RawFrame`]: samples of a sensor in digital
//! numbers (DN), with what is needed to interpret them.
//!
//! * [`Error`]: what is wrong, of which [`ErrorKind`], where, and what would be right;
//! * [`Plane`] and [`Cfa`]: rectangles of values, row by row from the top; colour filter patterns;
//! * [`Spectrum`], [`Bands`] and [`table`]: curves over wavelength (nm) and their CSV files;
//!   [`unit`](mod@unit): the units of instruments and files;
//! * [`output`]: files and directories that appear whole or not at all, and outputs that are read
//!   while they are written;
//! * [`alternatives`], [`choice`] and [`toml_text`]: values, names and errors in TOML files;
//!   [`options`]: those behind a name, `KEY=VALUE,...`;
//! * [`color`]: matrices between colour spaces; [`npy`]: NumPy arrays; [`Sample`]: types of
//!   numbers in files; [`median`];
//!   [`natural_order`] of names; [`copies`]: the same frame again; and [`platform`] for what
//!   operating systems do differently.
//!
//! ```
//! use camrig_base::{Bands, Cfa, RawFrame, Spectrum};
//!
//! // A quantum efficiency that falls from blue to red, in the 31 bands of Chen et al. 2009.
//! let curve = Spectrum::new(vec![400.0, 700.0], vec![0.6, 0.3])?;
//! assert_eq!(curve.sample(&Bands::VISIBLE).len(), 31);
//! assert!((curve.at(550.0) - 0.45).abs() < 1e-12);
//!
//! let frame: RawFrame = RawFrame {
//!     width: 2,
//!     height: 2,
//!     bits: 10,
//!     cfa: Cfa::parse("RGGB")?,
//!     black_level_dn: 64.0,
//!     white_level_dn: 1023,
//!     data: vec![500, 900, 1023, 300],
//! };
//! let green = &frame.channel_means()[1];
//! assert_eq!((&*green.name, green.mean_dn, green.saturated), ("g", 961.5, 0.5));
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod alternatives;
mod cfa;
pub mod choice;
pub mod color;
pub mod copies;
mod error;
mod error_code;
mod frame;
pub mod median;
pub mod mistakes;
mod natural_order;
pub mod npy;
pub mod numbers;
pub mod options;
pub mod output;
mod plane;
pub mod platform;
mod sample;
mod schema_check;
pub mod schema_words;
mod spectrum;
pub mod table;
mod table_column;
mod table_exports;
mod table_form;
mod table_fractions;
mod table_marks;
mod table_quantity;
pub mod tails;
pub mod toml_text;
pub mod unit;
mod value;

pub use cfa::Cfa;
pub use error::{Error, ErrorKind, Result};
pub use error_code::ErrorCode;
pub use frame::{ChannelMean, Dn, RawFrame};
pub use natural_order::natural_order;
pub use plane::Plane;
pub use sample::Sample;
pub use spectrum::{Bands, Outside, Spectrum, integral_of_product, weighted_means};
pub use value::Value;
