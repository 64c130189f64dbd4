//! Colours of red, green and blue: what codes mean as light, and the spectra that may have them.
//!
//! Codes become linear sRGB by a [`transfer`] and the primaries of a [`space`]. Each colour has the
//! [`smoothest`] spectrum that gives it, in the bands of
//! [`Bands::VISIBLE`](camrig_base::Bands::VISIBLE): a reflectance between 0 and 1, or an emission
//! over the spectrum of D65. [`spectra`] finds those of a whole picture, [`mixture`] makes them
//! mixtures of a few components for the channels of a sensor. Colours that no spectrum has are
//! moved to their grey.

mod basis;
mod channel_planes;
mod cubes;
mod gamut;
mod lattice;
pub mod mixture;
pub mod smoothest;
pub mod space;
pub mod spectra;
#[cfg(test)]
mod tests;
pub mod transfer;
