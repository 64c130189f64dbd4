//! Lens models, and the engine that turns scene radiance into irradiance on the sensor. The
//! principal type is [`Lens`], which every model is.
//!
//! [`irradiance`] renders a lit scene (spectral radiance, W m⁻² sr⁻¹ nm⁻¹) through any [`Lens`]
//! onto a [`SensorGrid`] and returns the mean irradiance over each pixel's photosensitive square,
//! W m⁻² nm⁻¹, band by band. A lens is
//! - [`Diffraction`]: f-number, focal length, transmittance, defocus; a circular pupil without
//!   aberrations; or
//! - [`Characterisation`]: tables of distortion, illumination and PSFs over field height and
//!   wavelength, as a lens program exports them or `camrig-lens` traces them; or
//! - [`PlaneCharacterisation`]: the same over places of the image, of a lens without rotational
//!   symmetry; or
//! - any of them with [`Departures`], which a camera file names as effects.
//!
//! [`mod@reference`] computes the same physics by direct sums; [`content`] makes keys for a cache
//! of results. Lengths on the sensor are in µm where their names say so and in mm elsewhere,
//! wavelengths in nm, frequencies in cycles/mm.
//!
//! ```
//! use camrig_base::Spectrum;
//! use camrig_optics::{Characterisation, Diffraction, Illumination};
//!
//! let lens = Diffraction {
//!     f_number: 2.8,
//!     focal_length_mm: 4.0,
//!     magnification: 0.0,
//!     transmittance: Spectrum::constant(0.9),
//!     illumination: Illumination::Cos4,
//!     defocus_um: 0.0,
//! };
//! // Contrast at the Nyquist frequency of 2 µm pixels in green light.
//! let mtf = lens.otf(550.0, 250.0);
//! assert!((mtf - 0.52).abs() < 0.01);
//! assert!((lens.cutoff_per_mm(550.0) - 649.4).abs() < 0.1);
//!
//! // A lens as tables: 17 x 17 PSF samples, 0.5 µm apart.
//! let tables = Characterisation::example(17, 0.5);
//! let corner = tables.distortion(550.0).at(0.5);
//! assert!((corner - 0.475).abs() < 1e-9); // 5 % of barrel distortion, mm
//! ```
//!
//! # Conventions
//! Those that decide the accuracy, and the tests that check them.
//!
//! - **Pixel centres** lie at (i + ½)·pitch, the image centre at width/2, height/2; y points down;
//!   the optical axis may be offset. `points_land_where_distortion_and_lateral_colour_say`
//! - **PSF centre**: the chief ray is at sample n/2 (integer division), for even and odd n; rows
//!   rise away from the axis. `kernels_keep_place_shape_and_aperture_whatever_the_rotation`
//! - **Lateral colour** is part of the distortion of each wavelength only; PSFs are centred on
//!   their own chief ray. `points_land_where_distortion_and_lateral_colour_say`
//! - **Distortion** tables are forward (paraxial to real height); rendering inverts a monotone
//!   curve. `distortion_is_inverted_and_lateral_colour_sits_between_its_samples`
//! - **Order**: distort, blur at the real place, then apply relative illumination.
//!   `the_engine_agrees_through_a_varying_field_with_the_same_nodes_everywhere`
//! - **Illumination** is applied once, at the pixel centre, relative to the axis, and includes
//!   cos⁴. Radiance is resampled, so there is no Jacobian.
//!   `uniform_scenes_come_out_as_equation_7_says`, `no_light_is_lost_or_made_between_nodes`
//! - **Index of tables**: paraxial height in files; the engine goes from real to paraxial height
//!   by the inverse distortion.
//!   `distortion_is_inverted_and_lateral_colour_sits_between_its_samples`
//! - **Scattering**: the PSF belongs to the place of the source, so energy is conserved where PSFs
//!   vary. `equals_the_defining_sum`, `no_light_is_lost_or_made_between_nodes`
//! - **PSFs between nodes** are blended bilinearly. The distance of nodes follows from a
//!   tolerance; the error reached is measured and reported.
//!   `the_engine_agrees_through_a_varying_field_with_the_same_nodes_everywhere`
//! - **PSFs between heights** are blended linearly. The heights of a traced lens follow from a
//!   tolerance; the error of given tables is estimated from them.
//!   `heights_are_added_only_where_psfs_change_until_the_tolerance_is_kept`
//! - **Sampling**: scene cells are area averages; PSF samples and the pixel's square are
//!   integrated; the cell average is divided out, so that the aperture acts once.
//!   `the_two_ways_to_blur_agree`
//! - **Eq. 7** has the tan-defined f-number: πL·T/(1 + 4(N(1+|m|/P))²), with P the pupil
//!   magnification (1 unless known). `irradiance_agrees_with_another_program`
//! - **Borders**: by default the scene continues beyond the frame; black, edge and mirror on
//!   request. `the_engine_agrees_through_an_otf_with_every_departure_and_border`
//! - **Support**: kernels are finite and the margin holds them whole; light beyond the edge of the
//!   frame is lost, and none wraps around. `nothing_wraps_around_to_the_opposite_border`
//!
//! # Not modelled
//! Diffraction by the pixels, polarisation, coherence, ghosts (veiling glare is a constant share),
//! change of the local magnification within a cell.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod bicubic;
pub mod characterisation;
pub mod content;
pub mod departures;
pub mod diffraction;
pub mod engine;
pub mod interpolate;
pub mod reference;

pub use characterisation::plane::PlaneCharacterisation;
pub use characterisation::tables::LensTables;
pub use characterisation::{Between, Characterisation, PsfGrid};
pub use departures::{Departed, Departures, Distortion};
pub use diffraction::{Diffraction, Illumination};
pub use engine::{
    Blur, Border, Device, DeviceChoice, Lens, Misplaced, NodeReport, Options, Otf, OverField,
    Report, SensorGrid, irradiance,
};
