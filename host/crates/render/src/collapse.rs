//! The fast path of the optics: components of a scene, through kernels that were collapsed over
//! the bands, to mean electrons on every pixel.
//!
//! Its result is a cube of one band whose values are electrons per second of exposure, each for
//! its own pixel's colour filter; the header names the response they were made for. The sensor
//! stage takes it as it takes any cube, so that simulate, expose and rigs agree byte for byte.
//! What it cannot serve is another response or another light, and a response that differs from
//! place to place (a crosstalk table): these are computed band by band.

use super::cache::{self, OneLens};
use super::{About, MadeFor, SceneInLight, made_for, sensor_grid};
use camrig_base::{Error, ErrorCode, Plane, Result};
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube, IrradianceWriter};
use camrig_light::Illuminant;
use camrig_light::colour::mixture::{Components, Mixer};
use camrig_optics::engine::collapsed::{Collapsed, Mixture};
use camrig_optics::{Options, Report};
use camrig_scene::{Bands, LitScene};
use camrig_sensor_core::config::{Pattern, SensorConfig};
use rayon::prelude::*;
use serde::Serialize;

/// How light comes from a scene to the sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum OpticsPath {
    /// Band by band: an irradiance cube, for any scene, that serves other responses, too.
    #[default]
    Bands,
    /// Components to electrons, as many components as keep what they leave out below what is not
    /// known of a picture's spectra.
    Components,
    /// What each channel of the sensor sees to electrons, blurred as white is: for live pictures.
    Live,
}

/// Components of [`OpticsPath::Components`].
const COMPONENTS: usize = 12;

camrig_base::choices!(OpticsPath, "path":
    Bands = "bands", Components = "components", Live = "live"
);

/// What a fast path leaves out against that band by band.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CollapseReport {
    /// Components.
    pub components: usize,
    /// Bound on what they leave out of a channel at an edge, as a part of white; even areas are
    /// kept.
    pub left_out: f64,
    /// Largest distance between where two bands land, which is in the kernels, µm; 0 where they
    /// land on one another and nothing is approximated.
    pub lateral_um: f64,
}

impl CollapseReport {
    /// The report in words.
    #[must_use]
    pub fn words(&self) -> String {
        let Self { components, left_out, lateral_um } = self;
        let lateral = if *lateral_um == 0.0 {
            "bands land on one another, and differ from band by band by cells, margins and nodes \
             that all share here: 1e-5 of the peak where these are the same, some 1e-4 where not"
                .to_owned()
        } else {
            format!(
                "bands land up to {lateral_um:.2} µm apart, which is in the kernels: edges differ \
                 by some 1e-3 to 1e-2 of the peak from band by band"
            )
        };
        format!(
            "optics in {components} components in place of bands: even areas are kept, at an edge \
             they leave out at most {left_out:.1e} of white; {lateral}"
        )
    }
}

/// Makes electrons of scene after scene, in one light through one lens.
pub(crate) struct Collapse {
    pub lens: OneLens,
    path: OpticsPath,
    sensor: SensorConfig,
    /// What irradiance and electrons on this sensor are made for.
    made_for: MadeFor,
    mixer: Option<Mixer>,
    kept: Option<Kept>,
}

/// A collapsed lens, and what it was collapsed for.
struct Kept {
    weights: Vec<Vec<Vec<f64>>>,
    collapsed: Collapsed,
}

impl Collapse {
    /// For scenes of these bands.
    pub fn new(
        camera: &Camera,
        bands: &Bands,
        illuminant: Option<&Illuminant>,
        options: &Options,
        directory: Option<&std::path::Path>,
        path: OpticsPath,
    ) -> Result<Self> {
        if camera.sensor.differs_over_the_field() {
            return Err(Error::unsupported(format!(
                "path {path} for a sensor with a crosstalk table or an interference filter"
            ))
            .help("its response differs from place to place: compute it by path bands")
            .with_code(ErrorCode::PathUnsupported));
        }
        let lens = OneLens::new(camera, bands, illuminant, options, directory)?;
        let mut made_for = lens.made_for.clone();
        made_for.insert(CubeHeader::RESPONSE.into(), made_for::response(camera));
        let sensor = camera.sensor_config_for(&lens.light, bands)?;
        Ok(Self { lens, path, sensor, made_for, mixer: None, kept: None })
    }

    /// Electrons per second on every pixel.
    ///
    /// # Errors
    /// A scene whose spectra are not mixtures of a few; those of the engine.
    pub fn run(
        &mut self,
        camera: &Camera,
        opened: &SceneInLight,
        options: &Options,
        about: About,
    ) -> Result<(IrradianceCube, Report, CollapseReport)> {
        let of_lens = (self.made_for.clone(), self.lens.light.clone());
        let (header, white) = cache::header(camera, &opened.lit(), about, of_lens)?;
        let bands = opened.scene.bands();
        let components = self.components(opened, &white)?;
        let collapsed = self.collapsed(camera, bands, &components.curves, options)?;
        let count = components.planes.bands().count;
        let lit = LitScene { scene: &*components.planes, white: vec![1.0; count] };
        let channels = collapsed.channels(&lit)?;
        let report = CollapseReport {
            components: count,
            left_out: components.left_out,
            lateral_um: collapsed.lateral_um(),
        };
        let optics = collapsed.report().clone();
        let mut writer = IrradianceWriter::new(of_electrons(header, &bands))?;
        writer.push(&mosaic(&self.sensor.pattern, &channels))?;
        Ok((writer.finish()?, optics, report))
    }

    /// The scene as a mixture for what the channels see in this light.
    fn components(
        &mut self,
        opened: &SceneInLight,
        white: &[f64],
    ) -> Result<camrig_scene::Components> {
        let channels = self.sensor.response.chunks_exact(white.len());
        let in_light = |channel: &[f32]| -> Vec<f64> {
            channel.iter().zip(white).map(|(r, w)| f64::from(*r) * w).collect()
        };
        let seen: Vec<Vec<f64>> = channels.map(in_light).collect();
        let mixer = match self.mixer.take().filter(|mixer| mixer.seen() == seen) {
            Some(mixer) => self.mixer.insert(mixer),
            None => {
                let components = match self.path {
                    OpticsPath::Live => Components::PerChannel,
                    _ => Components::Shared(COMPONENTS.max(seen.len())),
                };
                self.mixer.insert(Mixer::new(seen, components))
            }
        };
        opened.scene.components(mixer)?.ok_or_else(|| {
            Error::unsupported(format!("path {} for {:?}", self.path, opened.spec))
                .help("it takes no scene whose bands were joined to fewer: use path bands")
                .with_code(ErrorCode::PathUnsupported)
        })
    }

    /// The lens, collapsed for components with these curves, `[channel][component][band]`.
    fn collapsed(
        &mut self,
        camera: &Camera,
        bands: Bands,
        curves: &[Vec<Vec<f64>>],
        options: &Options,
    ) -> Result<&mut Collapsed> {
        let seen = self.mixer.iter().flat_map(Mixer::seen);
        let of_channel = |(seen, curves): (&Vec<f64>, &Vec<Vec<f64>>)| -> Vec<Vec<f64>> {
            curves.iter().map(|curve| product(seen, curve)).collect()
        };
        let weights: Vec<Vec<Vec<f64>>> = seen.zip(curves).map(of_channel).collect();
        let kept = match self.kept.take().filter(|kept| kept.weights == weights) {
            Some(kept) => self.kept.insert(kept),
            None => {
                let mixture = Mixture { bands, weights };
                let grid = sensor_grid(camera);
                let collapsed = Collapsed::new(self.lens.lens(), &grid, options, &mixture)?;
                self.kept.insert(Kept { weights: mixture.weights, collapsed })
            }
        };
        Ok(&mut kept.collapsed)
    }
}

/// Every pixel of the channel of its own filter.
fn mosaic(pattern: &Pattern, channels: &[Plane<f32>]) -> Plane<f32> {
    let Plane { width, height, .. } = channels[0];
    let mut pixels = Plane::filled(width, height, 0.0);
    pixels.data.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let period = usize::from(pattern.width);
        for first in 0..period.min(width) {
            let channel = channels[pattern.channel(first, y)].row(y);
            let own = row.iter_mut().zip(channel).skip(first).step_by(period);
            own.for_each(|(pixel, value)| *pixel = *value);
        }
    });
    pixels
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

/// The header of electrons: one band as wide as all.
fn of_electrons(header: CubeHeader, bands: &Bands) -> CubeHeader {
    CubeHeader {
        first_band_nm: bands.nm(bands.count / 2),
        band_step_nm: bands.step_nm * bands.count as f64,
        bands: 1,
        ..header
    }
}

/// Bands of the light that a cube is of. Electrons are of pictures, in bands of the usual width.
#[must_use]
pub fn light_bands(header: &CubeHeader) -> Bands {
    if !header.holds_electrons() {
        return header.spectral_bands();
    }
    let step_nm = Bands::VISIBLE.step_nm;
    let count = (header.band_step_nm / step_nm).round().max(1.0) as usize;
    let start_nm = header.first_band_nm - (count / 2) as f64 * step_nm;
    Bands { start_nm, step_nm, count }
}

#[cfg(test)]
mod tests;
