//! Scenes from a real camera (Chen et al. 2009, section II): its response curve from a chart shot at
//! several exposures, those exposures merged to one radiance frame, and spectra from its channels.

mod align;
pub mod ceiling;
pub mod exposures;
pub mod hdr;
pub mod response;
pub mod spectral;
pub mod view;
