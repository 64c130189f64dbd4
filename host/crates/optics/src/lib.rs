//! Lens descriptions and the engine that turns scene radiance into sensor irradiance.
//!
//! [`engine`] renders any [`Lens`]: [`Diffraction`] (key parameters only) or [`Characterisation`]
//! (tables over field and wavelength, exported by a lens program or traced from a prescription by
//! [`lens`]), with [`departures`] from its description where a camera file names [`effects`].
//! [`mod@reference`] is the same physics by direct sums; [`content`] keys results for the cache.
//!
//! # Conventions
//! The choices that cost others their accuracy, and the test that holds each of ours.
//!
//! | matter | here | held by |
//! |---|---|---|
//! | pixel centres | (i + ½)·pitch; image centre at width/2, height/2; y down; the optical axis may be offset | `points_land_where_distortion_and_lateral_colour_say` |
//! | PSF centre | chief ray at sample n/2 (integer division), n even or odd; rows rise away from the axis | `kernels_keep_place_shape_and_aperture_whatever_the_rotation` |
//! | lateral colour | in the distortion of each wavelength only; PSFs are centred on their own chief ray | `points_land_where_...` |
//! | distortion | tables are forward (paraxial → real); rendering inverts a monotone curve | `distortion_is_inverted_...` |
//! | order | distort, blur at the real place, then illumination | `the_engine_agrees_through_...` |
//! | illumination | applied once, at the pixel centre, relative to the axis; includes cos⁴; radiance is *resampled*, so no Jacobian | `uniform_scenes_come_out_as_equation_7_says`, `no_light_is_lost_or_made_between_nodes` |
//! | index of tables | paraxial height in files; the engine goes from real to paraxial height by the inverse distortion | `distortion_is_inverted_...` |
//! | scatter | the PSF belongs to the source's place, so energy is conserved where PSFs vary | `equals_the_defining_sum`, `no_light_is_lost_...` |
//! | PSFs between nodes | bilinear; node distance by a tolerance, the error reached is measured and reported | `the_engine_agrees_through_a_varying_field_with_the_same_nodes_everywhere`, `what_interpolation_between_nodes_costs_...` |
//! | PSFs between heights | linear; a traced lens gets heights by a tolerance, the error of given data is estimated from them | `heights_are_added_only_where_psfs_change_...`, `the_estimate_between_heights_is_the_error_there` |
//! | sampling | scene cells are area averages, PSF samples and the pixel's square are integrated; the cell average is divided out, so the aperture acts once | `the_two_ways_to_blur_agree` |
//! | eq. 7 | tan-defined N, πL·T/(1 + 4(N(1+|m|/P))²), P the pupil magnification (1 unless known) | `irradiance_agrees_with_another_program` |
//! | borders | by default the scene goes on beyond the frame; black, edge and mirror on request | `the_engine_agrees_through_an_otf_with_every_departure_and_border` |
//! | support | kernels are finite and the margin holds them whole: light beyond the frame's edge is lost, none wraps around | `nothing_wraps_around_to_the_opposite_border` |
//!
//! # Not modelled
//! Diffraction by the pixels, polarisation, coherence, ghosts (veiling glare is a constant share),
//! lenses without rotational symmetry, change of the local magnification within a cell.

pub mod characterisation;
pub mod content;
pub mod departures;
pub mod diffraction;
pub mod effects;
pub mod engine;
pub mod interpolate;
pub mod reference;

pub use characterisation::{Between, Characterisation, PsfGrid};
pub use departures::{Departed, Departures, Distortion};
pub use diffraction::{Diffraction, Illumination};
pub use effects::OpticalEffect;
pub use engine::{
    Blur, Border, Device, DeviceChoice, Lens, Misplaced, NodeReport, Options, Otf, Report,
    SensorGrid, irradiance,
};
