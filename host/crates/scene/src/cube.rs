//! Spectral cubes: images with one plane per band, resampled exactly to the grid asked for.
//!
//! The content is one sensor width wide and centred ([`Grid::over_content`] scales the frame over
//! it); outside it repeats its edge. Pixels are squares of constant value, so a cell's value is
//! the area-weighted mean of the pixels under it. Only one band is held at a time.
//!
//! Equally spaced bands of 5 to 50 nm are kept; others are converted to bands of 10 nm, each the
//! mean of the spectrum over the band (linear between source bands). Negative samples within the
//! noise of a dark scene are taken as 0, which the notes say. Outside its bands a cube is dark:
//! what was not measured is not invented. A reflectance may be held at its ends ([`Beyond::Hold`]).

pub use super::band_source::BandSource;
use super::resample::resample;
use super::selection::{Arranged, Stated, arrange};
use super::{Beyond, Components, Grid, Quantity, Scene, White};
use camrig_base::numbers::counted;
use camrig_base::{Bands, Error, Plane, Result, Spectrum};
use camrig_light::colour::mixture::Mixer;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// Samples below zero that are taken as 0, as a part of the band's largest value, or of 1 for a
/// reflectance: dark samples from which a dark frame or stray light was subtracted scatter around
/// 0. Far below it something else is wrong.
const NOISE_FLOOR: f32 = 0.02;
/// Largest value that is accepted as a reflectance: highlights and noise of measured cubes exceed
/// 1, while per cent, counts and radiance exceed 2 almost everywhere.
const MAX_REFLECTANCE: f32 = 2.0;
/// Wavelengths that band centres may have, nm: from the ultraviolet to the shortwave infrared. A
/// list in µm or in Å lies outside.
const WAVELENGTHS_NM: std::ops::RangeInclusive<f64> = 200.0..=2500.0;
/// The range of which a cube says that it does not cover it, nm: that of [`Bands::VISIBLE`].
const VISIBLE_NM: [f64; 2] = [400.0, 700.0];
/// Steps of equally spaced bands that are kept, nm. Below, a scene would cost many bands for
/// little gain in colour; above, bands are too coarse for spectra of light sources.
const KEPT_STEPS_NM: std::ops::RangeInclusive<f64> = 5.0..=50.0;
/// Step of the bands that all other cubes are converted to, nm: that of [`Bands::VISIBLE`].
const STEP_NM: f64 = 10.0;
/// Deviation from equal spacing, in steps, that counts as rounding of the wavelengths.
const EQUAL_SPACING: f64 = 1e-3;
/// Weights of source bands closer than this to 0 or 1 differ from it by rounding only.
const WEIGHT_ROUNDING: f64 = 1e-6;

/// A spectral image as a scene.
pub struct Cube {
    source: Box<dyn BandSource>,
    wavelength_nm: Vec<f64>,
    quantity: Quantity,
    bands: Bands,
    /// For each band the source bands and their weights.
    mix: Vec<Vec<(usize, f32)>>,
    understood: Vec<String>,
    notes: Vec<String>,
    white: Option<White>,
    beyond: Beyond,
    /// Whether all negative samples are taken as 0, however far below it.
    clips: bool,
    /// Source bands read so far in which negative samples were taken as 0: how many, and the
    /// least.
    clipped: Mutex<BTreeMap<usize, (usize, f32)>>,
}

impl Cube {
    /// A cube whose source bands are centred at `wavelength_nm`, in any order.
    ///
    /// # Errors
    /// Wavelengths that are not one per band, or of which none lies within 200 to 2500 nm.
    pub fn new(
        source: Box<dyn BandSource>,
        wavelength_nm: Vec<f64>,
        quantity: Quantity,
    ) -> Result<Self> {
        Self::stated(source, &wavelength_nm, quantity, Stated::default())
    }

    /// A cube of which the file says more than its wavelengths.
    ///
    /// # Errors
    /// Wavelengths that are not one per band, or of which none lies within 200 to 2500 nm; lists
    /// that do not fit.
    pub fn stated(
        source: Box<dyn BandSource>,
        wavelength_nm: &[f64],
        quantity: Quantity,
        stated: Stated,
    ) -> Result<Self> {
        let Arranged { source, wavelength_nm, mut notes } =
            arrange(source, wavelength_nm, stated, WAVELENGTHS_NM)?;
        let (first, last) = (wavelength_nm[0], wavelength_nm[wavelength_nm.len() - 1]);
        let bands = scene_bands(&wavelength_nm);
        let [blue, red] = VISIBLE_NM;
        if first > blue + bands.step_nm / 2.0 || last < red - bands.step_nm / 2.0 {
            notes.push(format!(
                "bands from {first} to {last} nm do not cover {blue} to {red} nm: what lies \
                 beyond is not known"
            ));
        }
        let mix = mix(&wavelength_nm, &bands);
        let understood = converted(&wavelength_nm, &bands).into_iter().collect();
        Ok(Self {
            source,
            wavelength_nm,
            quantity,
            bands,
            mix,
            understood,
            notes,
            white: None,
            beyond: Beyond::Dark,
            clips: false,
            clipped: Mutex::default(),
        })
    }

    /// The same cube with all negative samples as 0 where `clips` says so, and with what its
    /// reader understood of the file, and what it assumed or ignored.
    pub fn with(
        mut self,
        clips: bool,
        mut understood: Vec<String>,
        mut notes: Vec<String>,
    ) -> Self {
        understood.append(&mut self.understood);
        notes.append(&mut self.notes);
        Self { clips, understood, notes, ..self }
    }

    /// The same cube with a white that light levels refer to.
    pub fn with_white(self, white: Option<White>) -> Self {
        Self { white, ..self }
    }

    /// The same cube with what it is beyond its bands.
    ///
    /// # Errors
    /// A radiance to be held: light that was not measured is not invented.
    pub fn with_beyond(self, beyond: Beyond) -> Result<Self> {
        if beyond == Beyond::Hold && self.quantity == Quantity::Radiance {
            return Err(Error::input("beyond=hold of a radiance").help(
                "light outside the bands was not measured: a radiance is dark there; \
                 reflectances may be held",
            ));
        }
        Ok(Self { beyond, ..self })
    }

    /// What was understood of the file, in words; what was assumed or ignored is in the notes.
    pub fn understood(&self) -> &[String] {
        &self.understood
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        self.source.size()
    }

    /// One source band, checked: finite, not negative, a reflectance not far above 1. Samples a
    /// little below zero become 0.
    fn stored_band(&self, band: usize) -> Result<Plane<f32>> {
        let mut plane = self.source.read(band)?;
        let largest = plane.data.iter().fold(0.0f32, |m, &v| m.max(v));
        let (limit, unit) = match self.quantity {
            Quantity::Reflectance => (MAX_REFLECTANCE, largest.max(1.0)),
            Quantity::Radiance => (f32::MAX, largest),
        };
        let floor = if self.clips { f32::MIN } else { -NOISE_FLOOR * unit };
        // The range excludes NaN and infinite values as well.
        if let Some(i) = plane.data.iter().position(|v| !(floor..=limit).contains(v)) {
            return Err(self.wrong_value(plane.data[i], i % plane.width, i / plane.width, band));
        }
        let (mut count, mut least) = (0, 0.0f32);
        for value in plane.data.iter_mut().filter(|v| **v < 0.0) {
            (count, least) = (count + 1, least.min(*value));
            *value = 0.0;
        }
        if count > 0
            && let Ok(mut clipped) = self.clipped.lock()
        {
            clipped.insert(band, (count, least));
        }
        Ok(plane)
    }

    /// What was taken as 0 in the bands read so far.
    fn clipped_note(&self) -> Option<String> {
        let clipped = self.clipped.lock().ok()?;
        let samples: usize = clipped.values().map(|(count, _)| count).sum();
        let least = clipped.values().fold(0.0f32, |m, (_, least)| m.min(*least));
        (samples > 0).then(|| {
            let (samples, bands) =
                (counted(samples, "negative sample"), counted(clipped.len(), "band"));
            format!("taken as 0: {samples} in {bands}, down to {least}")
        })
    }

    fn wrong_value(&self, value: f32, x: usize, y: usize, band: usize) -> Error {
        let (what, help) = if !value.is_finite() {
            ("not a finite number", "replace missing pixels before importing the scene")
        } else if value < 0.0 {
            ("negative", "light cannot be negative: give negative=zero to take such samples as 0")
        } else {
            (
                "too large for a reflectance",
                "reflectance is 0 to 1: give scale=0.01 for percent, scale=1.52590e-5 (1/65535) \
                 for counts of 16 bits, or quantity=radiance",
            )
        };
        let nm = self.wavelength_nm[band];
        Error::input(format!("the value {value} is {what}"))
            .at(format!("column {x}, row {y}, band {band} ({nm} nm)"))
            .help(help)
    }

    /// One band of the scene in the cube's own pixels.
    ///
    /// # Errors
    /// A file that cannot be read; values that are not finite, negative, or too large for a
    /// reflectance.
    pub fn band(&self, band: usize) -> Result<Plane<f32>> {
        if let [(only, weight)] = self.mix[band][..]
            && weight == 1.0
        {
            return self.stored_band(only);
        }
        let (width, height) = self.source.size();
        let mut sum = Plane::filled(width, height, 0.0f32);
        for &(stored, weight) in &self.mix[band] {
            let plane = self.stored_band(stored)?;
            sum.data.iter_mut().zip(&plane.data).for_each(|(s, v)| *s += weight * v);
        }
        Ok(sum)
    }
}

impl Scene for Cube {
    fn bands(&self) -> Bands {
        self.bands
    }

    fn quantity(&self) -> Quantity {
        self.quantity
    }

    fn beyond(&self) -> Beyond {
        self.beyond
    }

    fn aspect(&self) -> Option<f64> {
        let (width, height) = self.source.size();
        Some(width as f64 / height as f64)
    }

    fn white(&self) -> Option<&White> {
        self.white.as_ref()
    }

    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        if let Some(components) = self.source.components(mixer)? {
            return Ok(Some(components));
        }
        let reflectance = self.quantity == Quantity::Reflectance;
        let mixed = mixer.mix_bands(reflectance, &|band| self.band(band))?;
        Ok(Some(Components::of_planes(mixed, self.quantity)))
    }

    fn notes(&self) -> Vec<String> {
        self.notes.iter().cloned().chain(self.clipped_note()).collect()
    }

    fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
        Ok(resample(&self.band(band)?, grid))
    }
}

/// The bands of the scene for these source bands.
fn scene_bands(wavelength_nm: &[f64]) -> Bands {
    let (first, last) = (wavelength_nm[0], wavelength_nm[wavelength_nm.len() - 1]);
    let spaces = wavelength_nm.len() - 1;
    let step = (last - first) / spaces.max(1) as f64;
    let equal = spaces > 0
        && (0..=spaces)
            .all(|i| (wavelength_nm[i] - first - i as f64 * step).abs() < EQUAL_SPACING * step);
    if equal && KEPT_STEPS_NM.contains(&step) {
        return Bands { start_nm: first, step_nm: step, count: wavelength_nm.len() };
    }
    let (start, end) = ((first / STEP_NM).ceil(), (last / STEP_NM).floor());
    if end < start {
        // Between two multiples of the step: one band about the middle.
        return Bands { start_nm: (first + last) / 2.0, step_nm: STEP_NM, count: 1 };
    }
    Bands { start_nm: start * STEP_NM, step_nm: STEP_NM, count: (end - start) as usize + 1 }
}

/// What to say of bands that are not the source's own.
fn converted(wavelength_nm: &[f64], bands: &Bands) -> Option<String> {
    let Bands { start_nm, step_nm, count } = *bands;
    let near = |nm: f64| ((nm - start_nm) / step_nm).round() * step_nm + start_nm;
    let own = wavelength_nm.iter().all(|nm| (near(*nm) - nm).abs() < EQUAL_SPACING * step_nm);
    let end = bands.nm(count.saturating_sub(1));
    let inside = wavelength_nm[wavelength_nm.len() - 1] - wavelength_nm[0];
    let widest = wavelength_nm.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
    let complete = own && (inside / step_nm).round() as usize + 1 == wavelength_nm.len();
    (!complete).then(|| {
        format!(
            "converted to {} of {step_nm} nm, {start_nm} to {end} nm: means of straight lines \
             between its own, which are up to {widest:.1} nm apart",
            counted(count, "band")
        )
    })
}

/// The weights of source bands in each band. The mean of the linear interpolant is linear in the
/// samples: the weight of a sample is what the spectrum that is 1 there and 0 elsewhere gives.
fn mix(wavelength_nm: &[f64], bands: &Bands) -> Vec<Vec<(usize, f32)>> {
    let mut mix = vec![Vec::new(); bands.count];
    for stored in 0..wavelength_nm.len() {
        let mut unit = vec![0.0; wavelength_nm.len()];
        unit[stored] = 1.0;
        let Ok(unit) = Spectrum::new(wavelength_nm.to_vec(), unit) else { continue };
        for (band, weight) in unit.in_bands(bands).into_iter().enumerate() {
            let weight = if (weight - 1.0).abs() < WEIGHT_ROUNDING { 1.0 } else { weight };
            if weight > WEIGHT_ROUNDING {
                mix[band].push((stored, weight as f32));
            }
        }
    }
    mix
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Memory(Vec<Plane<f32>>);

    impl BandSource for Memory {
        fn size(&self) -> (usize, usize) {
            (self.0[0].width, self.0[0].height)
        }
        fn bands(&self) -> usize {
            self.0.len()
        }
        fn read(&self, band: usize) -> Result<Plane<f32>> {
            Ok(self.0[band].clone())
        }
    }

    fn cube(nm: Vec<f64>, value: impl Fn(usize, usize, f64) -> f32) -> Cube {
        let planes = nm.iter().map(|&w| Plane::from_fn(4, 2, |x, y| value(x, y, w))).collect();
        Cube::new(Box::new(Memory(planes)), nm, Quantity::Reflectance).unwrap()
    }

    fn visible() -> Vec<f64> {
        Bands::VISIBLE.centres().collect()
    }

    #[test]
    fn bands_that_are_not_the_files_own_are_told() {
        let said = |nm: &[f64]| cube(nm.to_vec(), |_, _, _| 0.5).understood().join("\n");
        let regular = |start: f64, step: f64, n: i32| -> Vec<f64> {
            (0..n).map(|i| start + step * f64::from(i)).collect()
        };
        assert_eq!(said(&regular(400.0, 10.0, 31)), "");
        assert_eq!(said(&regular(420.0, 10.0, 31)), "", "its own bands");
        let fine = said(&regular(400.0, 2.0, 151));
        assert!(fine.contains("31 bands of 10 nm") && fine.contains("up to 2.0 nm"), "{fine}");
        let mut gap = regular(400.0, 10.0, 31);
        gap.remove(12);
        assert!(said(&gap).contains("up to 20.0 nm apart"), "{}", said(&gap));
    }

    #[test]
    fn resampling_is_the_area_mean_and_repeats_the_edge() {
        let cube = cube(visible(), |x, y, _| (x + 4 * y) as f32 / 10.0);
        assert_eq!(cube.bands(), Bands::VISIBLE);
        assert_eq!(cube.aspect(), Some(2.0));
        let at = |width, height, left, top, cell| {
            cube.plane(7, &Grid { width, height, left, top, cell }).unwrap().data
        };
        let own = at(4, 2, -0.5, -0.25, 0.25);
        assert_eq!(own, [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]);
        // The four middle pixels in one cell.
        assert!((at(1, 1, -0.25, -0.25, 0.5)[0] - 0.35).abs() < 1e-6);
        // Half a pixel in the corner, and far outside: the corner's value.
        assert_eq!(at(1, 1, 0.375, 0.125, 0.125), [0.7]);
        assert_eq!(at(1, 1, 30.0, 20.0, 0.5), [0.7]);
        assert_eq!(at(1, 1, -30.0, -20.0, 0.5), [0.0]);
        // Half beyond the right edge: pixel 3 counts for what lies outside.
        assert!((at(1, 1, 0.25, -0.25, 0.25)[0] - 0.3).abs() < 1e-6);
        assert!((at(1, 1, 0.0, -0.25, 0.5)[0] - 0.45).abs() < 1e-6);
        assert!((at(1, 1, 0.25, -0.25, 0.5)[0] - 0.5).abs() < 1e-6);
    }

    #[test]
    fn mean_is_kept_at_any_grid() {
        let cube = cube(visible(), |x, y, _| [0.1, 0.9, 0.4, 0.7, 0.2, 0.0, 1.0, 0.3][x + 4 * y]);
        for width in [3usize, 7, 1000] {
            let cell = 1.0 / width as f64;
            let height = width.div_ceil(2);
            let plane =
                cube.plane(0, &Grid { width, height, left: -0.5, top: -0.25, cell }).unwrap();
            // Odd widths end half a cell below the content, which repeats the last row.
            let below = f64::from(height as u32) * cell - 0.5;
            let expected = (0.45 * 0.5 + below * 0.375) / (0.5 + below);
            let mean =
                plane.data.iter().map(|&v| f64::from(v)).sum::<f64>() / plane.data.len() as f64;
            assert!((mean - expected).abs() < 1e-5, "{width}: {mean} for {expected}");
        }
    }

    #[test]
    fn bands_are_kept_or_resampled_and_never_extended() {
        let at = |cube: &Cube, band| {
            let grid = Grid { width: 1, height: 1, left: 0.0, top: 0.0, cell: 0.1 };
            cube.plane(band, &grid).unwrap().data[0]
        };
        let linear = |_: usize, _: usize, nm: f64| (nm / 1000.0) as f32;
        // 3.1 nm steps: 10 nm bands with the mean of a linear spectrum, which is its centre's
        // value.
        let fine: Vec<f64> = (0..120).map(|i| 390.0 + 3.1 * f64::from(i)).collect();
        let cube = cube(fine, linear);
        assert_eq!(cube.bands(), Bands { start_nm: 390.0, step_nm: 10.0, count: 37 });
        assert!((at(&cube, 16) - 0.55).abs() < 1e-6 && cube.notes().is_empty());
        // 420 to 680 nm: what lies beyond is not known.
        let short = self::cube((0..27).map(|i| 420.0 + 10.0 * f64::from(i)).collect(), linear);
        assert_eq!(short.bands(), Bands { start_nm: 420.0, step_nm: 10.0, count: 27 });
        assert_eq!((at(&short, 0), at(&short, 26)), (0.42, 0.68));
        assert_eq!(short.data_nm(), [415.0, 685.0]);
        assert!(short.notes()[0].contains("do not cover 400 to 700 nm"));
        // One band only, on a multiple of the step or not.
        for nm in [550.0, 850.0, 853.0] {
            let one = self::cube(vec![nm], linear);
            assert_eq!(one.bands(), Bands { start_nm: nm, step_nm: 10.0, count: 1 });
            assert_eq!(at(&one, 0), (nm / 1000.0) as f32);
        }
        // Light that was not measured is not invented; a reflectance may be held.
        let held = self::cube(vec![550.0], linear).with_beyond(Beyond::Hold).unwrap();
        assert_eq!(held.beyond(), Beyond::Hold);
        let radiance = Cube { quantity: Quantity::Radiance, ..held };
        assert!(radiance.with_beyond(Beyond::Hold).is_err());
    }

    #[test]
    fn samples_in_the_noise_below_zero_become_zero_and_are_told() {
        let value = |x, y, nm| if (x, y, nm) == (1, 0, 420.0) { -0.003 } else { 0.5 };
        let dark = cube(visible(), value);
        assert!(dark.notes().is_empty());
        assert_eq!(dark.band(2).unwrap().data[..3], [0.5, 0.0, 0.5]);
        dark.band(2).unwrap();
        let notes = dark.notes();
        assert!(
            notes[0].starts_with("taken as 0: 1 negative sample in 1 band, down to -0.003"),
            "{notes:?}"
        );
        // Far below zero only if asked for.
        let wrong = cube(visible(), |x, _, _| if x == 2 { -0.5 } else { 0.5 });
        let message = wrong.band(0).unwrap_err().to_string();
        assert!(message.contains("negative=zero"), "{message}");
        assert_eq!(wrong.with(true, vec![], vec![]).band(0).unwrap().data[..3], [0.5, 0.5, 0.0]);
    }

    #[test]
    fn wrong_values_are_named_by_pixel_and_band() {
        for (value, expected) in [
            (f32::NAN, "finite"),
            (-0.1, "negative"),
            (45.0, "scale=0.01"),
            (f32::INFINITY, "finite"),
        ] {
            let cube =
                cube(visible(), |x, y, nm| if (x, y, nm) == (3, 1, 410.0) { value } else { 0.5 });
            let grid = Grid { width: 2, height: 1, left: -0.5, top: -0.25, cell: 0.5 };
            assert!(cube.plane(0, &grid).is_ok());
            let message = cube.plane(1, &grid).unwrap_err().to_string();
            assert!(message.contains("column 3, row 1, band 1 (410 nm)"), "{message}");
            assert!(message.contains(expected), "{message}");
        }
    }
}
