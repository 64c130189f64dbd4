//! A view's reflectance spectra: a linear frame of a known camera, with the light taken out.
//!
//! The light's strength comes from a ColorChecker or a white of known reflectance in view;
//! [`super::spectral`] has the estimator.

use crate::files::HdrFile;
use crate::hdr::Flag;
use crate::response::SATURATION;
use crate::spectral::{self, Channels, Estimator, Method, Report};
use crate::view::{Region, View, fit_chart, is_chart};
use camrig_base::table::{SpectralTable, Wanted};
use camrig_base::{Bands, Cfa, Error, Plane, Result};
use camrig_camera::Camera;
use camrig_formats::Frames;
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
    scale: SignalScale,
}

/// What a signal is relative to.
#[derive(Clone, Copy, Debug)]
enum SignalScale {
    /// Of a merged frame: DN/s.
    PerSecond,
    /// Of a raw frame: DN at an exposure and gain, as far as its file says them.
    Exposed { exposure_s: Option<f64>, analog_gain: Option<f64> },
}

/// Exposures and gains are the same to this part: files write them with rounded digits.
const SAME: f64 = 1e-3;

impl SignalScale {
    /// In what two differ, where that is known.
    fn difference(&self, other: &Self) -> Option<String> {
        use SignalScale::{Exposed, PerSecond};
        let differ = |what: &str, a: Option<f64>, b: Option<f64>, unit: &str| {
            let (a, b) = (a?, b?);
            let text = || format!("frames of {what} {a}{unit} and {b}{unit}");
            ((a / b - 1.0).abs() > SAME).then(text)
        };
        match (*self, *other) {
            (PerSecond, PerSecond) => None,
            (
                Exposed { exposure_s, analog_gain },
                Exposed { exposure_s: other_s, analog_gain: other_gain },
            ) => differ("exposure", exposure_s, other_s, " s")
                .or_else(|| differ("gain", analog_gain, other_gain, "")),
            _ => Some("a frame of one exposure and a merged one".into()),
        }
    }
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
            let cfa = Cfa::parse(&about.cfa)?;
            return Ok(Self { signal, cfa, scale: SignalScale::PerSecond });
        }
        Self::of(&camrig_formats::read(path)?)
    }

    /// The first of raw frames that state their black level and pattern.
    fn of(frames: &Frames) -> Result<Self> {
        let raw = frames.raw(0)?;
        let range = f64::from(raw.white_level_dn) - raw.black_level_dn;
        let limit = raw.black_level_dn + SATURATION * range;
        let linear = raw.data.iter().map(|&dn| match f64::from(dn) {
            dn if dn > limit => f32::INFINITY,
            dn => (dn - raw.black_level_dn) as f32,
        });
        let signal = Plane { width: raw.width, height: raw.height, data: linear.collect() };
        let taken = &frames.facts.taken;
        let scale = SignalScale::Exposed {
            exposure_s: taken.exposure_s.as_ref().map(|said| said.value),
            analog_gain: taken.analog_gain.as_ref().map(|said| said.value),
        };
        Ok(Self { signal, cfa: raw.cfa, scale })
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
    scale: SignalScale,
    /// Where the signals are from.
    frame: String,
}

impl MeasuredChart {
    /// Exitances that a spectroradiometer measured, as CSV of `wavelength_nm` and the 24 patches in
    /// their order, and a frame of the chart in the same light.
    ///
    /// # Errors
    /// Files that are missing or of another kind; not 24 spectra of 0 or more over
    /// [`Bands::VISIBLE`]; a frame without the chart there.
    pub fn read(exitances: &Path, frame: &Path, chart: &Region) -> Result<Self> {
        let spectra = SpectralTable::read(exitances)
            .and_then(|table| measured_exitances(&table))
            .map_err(|e| e.at(exitances.display()))?;
        let linear = LinearFrame::read(frame)?;
        Self::of(spectra, &linear, chart, frame.display().to_string())
    }

    /// Of 24 spectra and a frame from a place.
    fn of(
        exitances: Vec<Vec<f64>>,
        frame: &LinearFrame,
        chart: &Region,
        place: String,
    ) -> Result<Self> {
        let signals = View::new(&frame.signal, &frame.cfa).patches(chart);
        let signals = signals.map_err(|e| e.at(&place))?;
        spectral::unexplained(&exitances, &signals, EXITANCE_COMPONENTS)
            .and_then(is_chart)
            .map_err(|e| e.at(format!("{place}, the rectangle {chart}")))?;
        Ok(Self { exitances, signals, scale: frame.scale, frame: place })
    }

    /// Checks that the signals of charts are on one scale.
    fn check_scales(charts: &[Self]) -> Result<()> {
        for (i, chart) in charts.iter().enumerate() {
            for before in &charts[..i] {
                if let Some(what) = before.scale.difference(&chart.scale) {
                    return Err(Error::disagreement(what)
                        .at(format!("{} and {}", before.frame, chart.frame))
                        .help(
                            "take the frames of the charts at one exposure and gain, or merge \
                             several exposures of each",
                        ));
                }
            }
        }
        Ok(())
    }
}

fn measured_exitances(table: &SpectralTable) -> Result<Vec<Vec<f64>>> {
    let bands = Bands::VISIBLE;
    table.must_cover([bands.nm(0), bands.nm(bands.count - 1)])?;
    let spectra = spectra(table, &bands)?;
    if spectra.len() != PATCHES {
        return Err(Error::input(format!("{} spectra", spectra.len()))
            .help("give the exitances of the 24 patches of a ColorChecker in their order"));
    }
    for (name, values) in &table.curves {
        let mut all = table.wavelength_nm.iter().zip(values);
        if let Some((nm, value)) = all.find(|(_, value)| **value < 0.0) {
            return Err(Error::input(format!("an exitance of {value}"))
                .at(format!("column {name:?}, {nm} nm"))
                .help("exitances are 0 or more; set what noise left below 0 to 0"));
        }
    }
    Ok(spectra)
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
    /// lights without a chart, more components than training spectra allow, charts measured at
    /// different exposures or gains.
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
            charts => {
                MeasuredChart::check_scales(charts)?;
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
    use camrig_base::RawFrame;
    use camrig_formats::{Said, Taken};

    fn read(text: &str) -> Result<(Vec<Vec<f64>>, Vec<String>)> {
        training(SpectralTable::parse(text)?)
    }

    /// The exitances of a ColorChecker in a light, W m⁻² nm⁻¹ on any scale.
    fn exitances(light: &str) -> Vec<Vec<f64>> {
        let light = Illuminant::parse(light).unwrap().in_bands(&Bands::VISIBLE);
        let patches = spectra(&colorchecker::reflectances(), &Bands::VISIBLE).unwrap();
        patches.iter().map(|p| p.iter().zip(&light).map(|(r, l)| r * l).collect()).collect()
    }

    /// Raw frames of 12 bits from the DN of a place.
    fn frames(said: [Option<f64>; 2], dn: impl Fn(usize, usize) -> f64) -> Frames {
        let cfa = Cfa::parse("RGGB").unwrap();
        let data = (0..320 * 240).map(|i| dn(i % 320, i / 320).round() as u16).collect();
        let raw = RawFrame {
            width: 320,
            height: 240,
            bits: 12,
            cfa,
            black_level_dn: 64.0,
            white_level_dn: 4095,
            data,
        };
        let mut frames = Frames::from_raw(&raw);
        let [exposure_s, analog_gain] = said.map(|v| v.map(|v| Said::new(v, "test")));
        frames.facts.taken = Taken { exposure_s, analog_gain, ..Taken::default() };
        frames
    }

    /// A frame of the built-in chart, that the camera mt9v024 sees in a light, with the rectangle
    /// around its patches.
    fn chart(light: &str, said: [Option<f64>; 2]) -> (LinearFrame, Region) {
        let sensitivity = Camera::load("mt9v024").unwrap().sensor.response(&Bands::VISIBLE);
        let light = Illuminant::parse(light).unwrap().in_bands(&Bands::VISIBLE);
        let channels = Channels::new(&sensitivity, &light).unwrap();
        let scene = camrig_scene::chart::open("colorchecker").unwrap().unwrap();
        let grid = camrig_scene::Grid {
            width: 320,
            height: 240,
            left: -0.5,
            top: -0.375,
            cell: 1.0 / 320.0,
        };
        let planes: Vec<Plane<f32>> =
            (0..Bands::VISIBLE.count).map(|b| scene.plane(b, &grid).unwrap()).collect();
        let cfa = Cfa::parse("RGGB").unwrap();
        let frames = frames(said, |x, y| {
            let reflectance: Vec<f64> = planes.iter().map(|p| f64::from(p.at(x, y))).collect();
            64.0 + 3000.0 * channels.see(&reflectance)[cfa.channel(x, y)]
        });
        // Patches span from (0.5 − 0.4 · 5.86 / 6.5) of the width.
        let width = 320.0 * 0.8 * 5.86 / 6.5;
        let height = width * 3.86 / 5.86;
        let (left, top) = (160.0 - width / 2.0, 120.0 - height / 2.0);
        let region = format!("{left},{top},{width},{height}").parse().unwrap();
        (LinearFrame::of(&frames).unwrap(), region)
    }

    fn refusal(result: Result<impl Sized>, says: &[&str]) {
        let error = result.err().unwrap().to_string();
        for words in says {
            assert!(error.contains(words), "should say {words:?}: {error}");
        }
    }

    #[test]
    fn exitances_are_24_of_0_or_more() {
        let table = |count: usize, first: f64| {
            let names: Vec<String> = (1..=count).map(|i| format!(",p{i}")).collect();
            let row = |nm: u32| format!("{nm},{first}{}\n", ",0.5".repeat(count - 1));
            let text = format!("wavelength_nm{}\n{}{}", names.concat(), row(380), row(720));
            measured_exitances(&SpectralTable::parse(&text).unwrap())
        };
        assert_eq!(table(24, 0.0).unwrap().len(), 24);
        refusal(table(24, -0.01), &["an exitance of -0.01", "\"p1\", 380 nm", "0 or more"]);
        refusal(table(23, 0.5), &["23 spectra", "24 patches"]);
    }

    #[test]
    fn a_frame_of_measured_exitances_has_the_chart_in_its_rectangle() {
        let (frame, region) = chart("A", [None; 2]);
        let of = |frame: &LinearFrame, region: &Region| {
            MeasuredChart::of(exitances("A"), frame, region, "a.dng".into())
        };
        assert!(of(&frame, &region).is_ok());
        let no_chart = ["no ColorChecker", "where: a.dng, the rectangle 44.", "24 patches"];
        for (dn, off) in [(64.0, "there\n"), (1000.0, "% of white\n")] {
            let even = LinearFrame::of(&frames([None; 2], |_, _| dn)).unwrap();
            refusal(of(&even, &region), &no_chart);
            refusal(of(&even, &region), &[off]);
        }
        let beside = "85,44,231,152".parse().unwrap();
        refusal(of(&frame, &beside), &["no ColorChecker", "the rectangle 85,44,231,152"]);
        let beyond = "200,44,231,152".parse().unwrap();
        let says = ["patch 4 (foliage) lies at 326.7,", "where: a.dng", "320 x 240 pixels"];
        refusal(of(&frame, &beyond), &says);
    }

    #[test]
    fn charts_are_measured_at_one_exposure_and_gain() {
        let measured = |light: &str, said: [Option<f64>; 2]| {
            let (frame, region) = chart(light, said);
            MeasuredChart::of(exitances(light), &frame, &region, format!("{light}.dng")).unwrap()
        };
        let all = |second: [Option<f64>; 2]| {
            let unknown = measured("D65", [None; 2]);
            let charts =
                [unknown, measured("A", [Some(0.01), Some(1.0)]), measured("F11", second)];
            MeasuredChart::check_scales(&charts)
        };
        assert!(all([Some(0.010001), Some(1.0)]).is_ok());
        assert!(all([None, None]).is_ok());
        let says = ["exposure 0.01 s and 0.02 s", "where: A.dng and F11.dng", "at one exposure"];
        refusal(all([Some(0.02), Some(1.0)]), &says);
        refusal(all([Some(0.01), Some(4.0)]), &["gain 1 and 4", "A.dng and F11.dng"]);
        let mut merged = measured("D65", [None; 2]);
        merged.scale = SignalScale::PerSecond;
        let charts = [measured("A", [None; 2]), merged];
        refusal(MeasuredChart::check_scales(&charts), &["a merged one", "A.dng and D65.dng"]);
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
