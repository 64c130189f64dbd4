//! The fast path of the optics: components of a scene, through kernels that were collapsed over
//! the bands, to mean electrons on every pixel.
//!
//! Its result is a cube of one band whose values are electrons per second of exposure, each for
//! its own pixel's colour filter; the header names the response they were made for. The sensor
//! stage takes it as it takes any cube, so that simulate, expose and rigs agree byte for byte.
//! What it cannot serve is another response or another light, and a response that differs from
//! place to place (a crosstalk table): these are computed band by band.

use super::cache::{self, OneLens};
use super::{About, SceneInLight, made_for, sensor_grid};
use camrig_base::{Error, Plane, Result};
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube, IrradianceWriter};
use camrig_optics::engine::collapsed::{Collapsed, Mixture};
use camrig_optics::{Options, Report};
use camrig_scene::{Bands, LitScene};
use serde::Serialize;

/// How light comes from a scene to the sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OpticsPath {
    /// Band by band: an irradiance cube, for any scene, that serves other responses, too.
    #[default]
    Bands,
    /// Components to electrons, as many components as keep what they leave out below what is not
    /// known of a picture's spectra.
    Components,
    /// Components to electrons, one per channel: for live pictures.
    Live,
}

/// Components of [`OpticsPath::Components`].
const COMPONENTS: usize = 12;

impl OpticsPath {
    /// All choices, in the order of a list for people.
    pub const ALL: [Self; 3] = [Self::Bands, Self::Components, Self::Live];

    /// The name in files and on command lines.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bands => "bands",
            Self::Components => "components",
            Self::Live => "live",
        }
    }
}

impl std::fmt::Display for OpticsPath {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for OpticsPath {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        camrig_base::choice::by_name("path", text, &Self::ALL, Self::name)
    }
}

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
        options: &Options,
        directory: Option<&std::path::Path>,
        path: OpticsPath,
    ) -> Result<Self> {
        if camera.sensor.crosstalk.is_some() {
            return Err(Error::unsupported(format!(
                "path {path} for a sensor with a crosstalk table"
            ))
            .help("its response differs from place to place: compute it by path bands")
            .with_code("path-unsupported"));
        }
        Ok(Self { lens: OneLens::new(camera, bands, options, directory)?, path, kept: None })
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
        let (header, white) = cache::header(camera, &opened.lit(), about)?;
        let bands = opened.scene.bands();
        let config = camera.sensor_config(&bands)?;
        let responses: Vec<Vec<f64>> = config
            .response
            .chunks_exact(bands.count)
            .map(|channel| channel.iter().zip(&white).map(|(r, w)| f64::from(*r) * w).collect())
            .collect();
        let count = match self.path {
            OpticsPath::Live => responses.len(),
            _ => COMPONENTS.max(responses.len()),
        };
        let components = opened.scene.components(&responses, count)?.ok_or_else(|| {
            Error::unsupported(format!("path {} for {:?}", self.path, opened.spec))
                .help(
                    "it takes pictures, and sequences of them, that are neither moved nor lit part \
                     by part: use path bands",
                )
                .with_code("path-unsupported")
        })?;
        let weights: Vec<Vec<Vec<f64>>> = responses
            .iter()
            .map(|seen| components.basis.iter().map(|curve| product(seen, curve)).collect())
            .collect();
        if self.kept.as_ref().is_none_or(|kept| kept.weights != weights) {
            let mixture = Mixture { bands, weights };
            let grid = sensor_grid(camera);
            let collapsed = Collapsed::new(self.lens.lens(), &grid, options, &mixture)?;
            self.kept = Some(Kept { weights: mixture.weights, collapsed });
        }
        let Some(kept) = &mut self.kept else {
            return Err(Error::internal("a lens that was not collapsed"));
        };
        let unlit = vec![1.0; components.basis.len()];
        let lit = LitScene { scene: &*components.planes, white: unlit };
        let channels = kept.collapsed.channels(self.lens.lens(), &lit)?;
        let pixels = Plane::from_fn(header.width, header.height, |x, y| {
            channels[config.pattern.channel(x, y)].at(x, y)
        });
        let mut writer = IrradianceWriter::new(of_electrons(header, camera, &bands)?)?;
        writer.push(&pixels)?;
        let report = CollapseReport {
            components: components.basis.len(),
            left_out: components.left_out,
            lateral_um: kept.collapsed.lateral_um(),
        };
        Ok((writer.finish()?, kept.collapsed.report().clone(), report))
    }
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

/// The header of electrons: one band as wide as all.
fn of_electrons(header: CubeHeader, camera: &Camera, bands: &Bands) -> Result<CubeHeader> {
    let mut made_for = header.made_for;
    made_for.insert(made_for::RESPONSE.into(), made_for::response(camera)?);
    Ok(CubeHeader {
        first_band_nm: bands.nm(bands.count / 2),
        band_step_nm: bands.step_nm * bands.count as f64,
        bands: 1,
        made_for,
        ..header
    })
}

/// Bands of the light that a cube is of. Electrons are of pictures, in bands of the usual width.
#[must_use]
pub fn light_bands(header: &CubeHeader) -> Bands {
    if !made_for::holds_electrons(header) {
        return header.spectral_bands();
    }
    let step_nm = Bands::VISIBLE.step_nm;
    let count = (header.band_step_nm / step_nm).round().max(1.0) as usize;
    let start_nm = header.first_band_nm - (count / 2) as f64 * step_nm;
    Bands { start_nm, step_nm, count }
}

#[cfg(test)]
mod tests;
