//! A view's reflectance spectra: a linear frame of a known camera, with the light taken out.
//!
//! The light's strength comes from a ColorChecker or a white of known reflectance in view;
//! [`super::spectral`] has the estimator.

use crate::files::HdrFile;
use crate::hdr::Flag;
use crate::response::SATURATION;
use crate::spectral::{self, Channels, Estimator, Method, Report};
use crate::view::{Region, View, fit_chart};
use camrig_base::table::{SpectralTable, Wanted};
use camrig_base::{Bands, Cfa, Error, Plane, Result};
use camrig_camera::Camera;
use camrig_light::Illuminant;
use camrig_scene::Quantity;
use camrig_scene::chart::colorchecker;
use camrig_scene_files::numpy;
use camrig_scene_files::stored::{self, Description};
use std::path::Path;

/// Reflectance of the white that [`Reference::White`] is of.
const WHITE: f64 = 0.9;

/// A linear raw frame: signal above black (DN or DN/s), infinite where it is saturated.
#[derive(Clone, Debug)]
pub struct LinearFrame {
    /// The samples.
    pub signal: Plane<f32>,
    /// The colour filter pattern.
    pub cfa: Cfa,
}

impl LinearFrame {
    /// Reads the directory of a merged frame ([`crate::hdr`]), or a raw frame whose file states its
    /// black level and pattern.
    ///
    /// # Errors
    /// A file that is missing or cannot be read.
    pub fn read(path: &Path) -> Result<Self> {
        if path.is_dir() {
            let about = HdrFile::read(path)?;
            let mut signal = numpy::read_plane(&path.join("radiance.npy"))?;
            let flags = numpy::read_plane(&path.join("flags.npy"))?;
            for (value, flag) in signal.data.iter_mut().zip(&flags.data) {
                if *flag == f32::from(Flag::Saturated as u8) {
                    *value = f32::INFINITY;
                }
            }
            return Ok(Self { signal, cfa: Cfa::parse(&about.cfa)? });
        }
        let raw = camrig_formats::read(path)?.raw(0)?;
        let range = f64::from(raw.white_level_dn) - raw.black_level_dn;
        let limit = raw.black_level_dn + SATURATION * range;
        let linear = raw.data.iter().map(|&dn| match f64::from(dn) {
            dn if dn > limit => f32::INFINITY,
            dn => (dn - raw.black_level_dn) as f32,
        });
        let signal = Plane { width: raw.width, height: raw.height, data: linear.collect() };
        Ok(Self { signal, cfa: raw.cfa })
    }
}

/// What in view has a known reflectance; rectangles in raw pixels.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Reference {
    /// A ColorChecker: the rectangle around its 24 patches.
    Chart(Region),
    /// A white of 90 %.
    White(Region),
}

/// How spectra are estimated.
pub struct Settings<'a> {
    /// Where the light's strength is read.
    pub reference: Reference,
    /// The light, or several of which a chart chooses the one that fits it best.
    pub lights: Vec<Illuminant>,
    /// Principal components; those of least error by cross-validation unless given.
    pub components: Option<usize>,
    /// Training reflectances in addition to those of the ColorChecker, in [`Bands::VISIBLE`], see
    /// [`read_training`].
    pub training: &'a [Vec<f64>],
    /// Relative noise that the estimate allows for, 1 = 100 %.
    pub noise: f64,
    /// A ColorChecker under several lights, measured: what the camera sees is taken from these, not
    /// from its quantum efficiency, where there are some ([`spectral::sensitivities`]).
    pub exitances: &'a [MeasuredChart],
}

/// The patches of a ColorChecker under one light.
pub struct MeasuredChart {
    /// Exitance of each in [`Bands::VISIBLE`], on one scale for all lights.
    exitances: Vec<Vec<f64>>,
    /// Signal of each in every channel, on one scale for all lights.
    signals: Vec<Vec<f64>>,
}

impl MeasuredChart {
    /// Exitances that a spectroradiometer measured, as CSV of `wavelength_nm` and the 24 patches in
    /// their order, and a frame of the chart in the same light.
    ///
    /// # Errors
    /// Files that are missing or of another kind; not 24 spectra over [`Bands::VISIBLE`].
    pub fn read(exitances: &Path, frame: &Path, chart: &Region) -> Result<Self> {
        let table = SpectralTable::read(exitances)?;
        let bands = Bands::VISIBLE;
        let spectra = table
            .must_cover([bands.nm(0), bands.nm(bands.count - 1)])
            .and_then(|()| spectra(&table, &bands))
            .map_err(|e| e.at(exitances.display()))?;
        if spectra.len() != PATCHES || spectra.iter().flatten().any(|v| *v < 0.0) {
            return Err(Error::input(format!("{} spectra", spectra.len()))
                .at(exitances.display())
                .help("give the exitances of the 24 patches, 0 or more, in their order"));
        }
        let frame = LinearFrame::read(frame)?;
        let signals = View::new(&frame.signal, &frame.cfa).patches(chart)?;
        Ok(Self { exitances: spectra, signals })
    }
}

/// Patches of a ColorChecker.
const PATCHES: usize = 24;
/// Components of exitances, as the paper found adequate.
const EXITANCE_COMPONENTS: usize = 6;

/// Reads training reflectances: a CSV file of `wavelength_nm,NAME,...` in fractions or per cent, in
/// [`Bands::VISIBLE`]; and notes on what was assumed of it.
///
/// # Errors
/// A file that is missing, is no table, holds other values than fractions or per cent, or leaves
/// part of the bands out.
pub fn read_training(path: &Path) -> Result<(Vec<Vec<f64>>, Vec<String>)> {
    training(SpectralTable::read(path)?).map_err(|e| e.at(path.display()))
}

fn training(mut table: SpectralTable) -> Result<(Vec<Vec<f64>>, Vec<String>)> {
    let bands = Bands::VISIBLE;
    table.convert_to_fractions(Wanted::Fraction)?;
    table.must_cover([bands.nm(0), bands.nm(bands.count - 1)])?;
    Ok((spectra(&table, &bands)?, table.remarks))
}

/// An estimate for a whole view.
pub struct Reflectance {
    /// The light that was taken out.
    pub light: Illuminant,
    /// Signal of a perfect white per channel.
    pub white: Vec<f64>,
    /// How well the chart fits, see [`crate::view::ChartFit::residual`].
    pub chart_residual: Option<f64>,
    /// Principal components used.
    pub components: usize,
    /// Errors on the ColorChecker's patches, each estimated without it.
    pub leave_one_out: Report,
    /// The same of the plain pseudo-inverse, for comparison.
    pub pseudo_inverse: Report,
    estimator: Estimator,
    /// A plane per channel, relative to white.
    channels: Vec<Vec<f32>>,
    letters: usize,
    size: (usize, usize),
    bands: Bands,
}

impl Reflectance {
    /// Estimates the spectra of a frame that `camera` took, in [`Bands::VISIBLE`].
    ///
    /// # Errors
    /// A camera without the frame's channels, a reference that is not there or saturated, several
    /// lights without a chart, more components than training spectra allow.
    pub fn estimate(
        frame: &LinearFrame,
        camera: &Camera,
        settings: &Settings<'_>,
    ) -> Result<Self> {
        let bands = Bands::VISIBLE;
        let view = View::new(&frame.signal, &frame.cfa);
        let all = |of: fn(&MeasuredChart) -> &[Vec<f64>]| -> Vec<Vec<f64>> {
            settings.exitances.iter().flat_map(|chart| of(chart).to_vec()).collect()
        };
        let sensitivity = match settings.exitances {
            [] => sensitivity(camera, &view.letters, &bands)?,
            _ => {
                let (spectra, signals) = (all(|c| &c.exitances), all(|c| &c.signals));
                if signals.iter().any(|s| s.len() != view.letters.len()) {
                    return Err(Error::disagreement("frames of different channels"));
                }
                spectral::sensitivities(&spectra, &signals, EXITANCE_COMPONENTS)?
            }
        };
        let Scale { light, white, chart_residual, patches: measured } =
            Scale::of(&view, &sensitivity, &bands, settings)?;
        let channels = Channels::new(&sensitivity, &light.in_bands(&bands))?;
        let patches = spectra(&colorchecker::reflectances(), &bands)?;
        let (more, noise) = (settings.training, settings.noise);
        let components = match settings.components {
            None => spectral::choose_components(&channels, &bands, &patches, more, noise)?,
            Some(components) => components,
        };
        let score = |method| {
            let measured = measured.as_deref();
            let estimates =
                spectral::leave_one_out(&channels, &patches, more, components, method, measured)?;
            spectral::report(&bands, &patches, &estimates)
        };
        let leave_one_out = score(Method::Regularised(noise))?;
        let pseudo_inverse = score(Method::PseudoInverse)?;
        let training: Vec<Vec<f64>> = patches.iter().chain(more).cloned().collect();
        let estimator = Estimator::regularised(&channels, &training, components, noise)?;
        let relative = |(plane, white): (&Plane<f32>, &f64)| {
            plane.data.iter().map(|v| v / *white as f32).collect()
        };
        Ok(Self {
            channels: view.planes.iter().zip(&white).map(relative).collect(),
            letters: view.letters.len(),
            size: (view.planes[0].width, view.planes[0].height),
            light,
            white,
            chart_residual,
            components,
            leave_one_out,
            pseudo_inverse,
            estimator,
            bands,
        })
    }

    /// Writes the estimate as a stored scene of reflectances called `name`; `source` states where
    /// it comes from.
    ///
    /// # Errors
    /// A directory that cannot be written to.
    pub fn write(&self, directory: &Path, name: &str, source: String) -> Result<()> {
        let mut about = Description::new(name, Quantity::Reflectance, self.size, &self.bands);
        about.source = source;
        about.description = format!("reflectance estimated from {} channels", self.letters);
        let channels: Vec<&[f32]> = self.channels.iter().map(Vec::as_slice).collect();
        stored::write(directory, &about, |band, plane| {
            self.estimator.band(band, &channels, &mut plane.data);
            Ok(())
        })
    }
}

/// The light of a view, and its strength in every channel.
struct Scale {
    light: Illuminant,
    white: Vec<f64>,
    chart_residual: Option<f64>,
    /// Signals of the chart's patches relative to white.
    patches: Option<Vec<Vec<f64>>>,
}

impl Scale {
    fn of(
        view: &View,
        sensitivity: &[Vec<f64>],
        bands: &Bands,
        settings: &Settings<'_>,
    ) -> Result<Self> {
        match (&settings.reference, &settings.lights[..]) {
            (Reference::Chart(region), lights) => {
                let patches = view.patches(region)?;
                let fit = fit_chart(&patches, sensitivity, bands, lights)?;
                let relative =
                    |p: &Vec<f64>| p.iter().zip(&fit.white).map(|(m, w)| m / w).collect();
                let patches = Some(patches.iter().map(relative).collect());
                let light = Illuminant::parse(&fit.illuminant)?;
                Ok(Self { light, white: fit.white, chart_residual: Some(fit.residual), patches })
            }
            (Reference::White(region), [light]) => {
                let mean = view.mean(region, "the white")?;
                let white = mean.into_iter().map(|v| v / WHITE).collect();
                Ok(Self { light: light.clone(), white, chart_residual: None, patches: None })
            }
            (Reference::White(_), _) => {
                Err(Error::input("a white alone does not determine the light")
                    .help("name the light, or use a chart"))
            }
        }
    }
}

/// Electrons per energy of the view's channels; `gr` and `gb` apart are averaged.
fn sensitivity(camera: &Camera, letters: &[char], bands: &Bands) -> Result<Vec<Vec<f64>>> {
    let all = camera.sensor.response(bands);
    let of_letter = |&letter: &char| {
        let letter = letter.to_lowercase().to_string();
        let own: Vec<&Vec<f64>> = camera
            .sensor
            .channel_names
            .iter()
            .zip(&all)
            .filter(|(name, _)| {
                **name == letter || (letter == "g" && matches!(name.as_str(), "gr" | "gb"))
            })
            .map(|(_, curve)| curve)
            .collect();
        if own.is_empty() {
            return Err(Error::disagreement(format!(
                "camera {} has no channel {letter}",
                camera.name
            ))
            .help("use the camera file of the camera that took the frame"));
        }
        let lens = |b: usize| camera.lens.transmittance.at(bands.nm(b));
        Ok((0..bands.count)
            .map(|b| lens(b) * own.iter().map(|c| c[b]).sum::<f64>() / own.len() as f64)
            .collect())
    };
    letters.iter().map(of_letter).collect()
}

fn spectra(table: &SpectralTable, bands: &Bands) -> Result<Vec<Vec<f64>>> {
    let spectra = (0..table.curves.len()).map(|i| Ok(table.spectrum(i)?.in_bands(bands)));
    spectra.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<(Vec<Vec<f64>>, Vec<String>)> {
        training(SpectralTable::parse(text)?)
    }

    #[test]
    fn training_is_of_fractions_or_per_cent_and_covers_the_bands() {
        let flat =
            |value: f64, from: u32| format!("wavelength_nm,a\n{from},{value}\n700,{value}\n");
        for (value, told) in [(0.25, false), (25.0, true), (1.004, false)] {
            let (spectra, notes) = read(&flat(value, 400)).unwrap();
            let right = if told { value / 100.0 } else { value };
            assert!(spectra[0].iter().all(|v| (v - right).abs() < 1e-12), "{value}: {spectra:?}");
            assert_eq!(notes.iter().any(|note| note.contains("per cent")), told, "{notes:?}");
        }
        for (text, says) in [
            (flat(-0.25, 400), "fractions, 0 to 1"),
            (flat(1.5, 400), "fractions, 0 to 1"),
            (flat(0.25, 500), "at least 400 to 700 nm"),
        ] {
            let error = read(&text).expect_err(&text).to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
