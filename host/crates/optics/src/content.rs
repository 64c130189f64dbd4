//! Cache keys: a digest of everything that an optics result depends on. Two runs with the same key
//! give the same planes.
//!
//! The key covers everything the engine asks for — the scene's cell averages, each figure of the
//! lens in every band, grid, options, version of this program — rather than names of files, so a
//! file that was touched but not changed keeps its results and a changed one never returns old
//! ones. A lens that has to be traced first is represented by what it is traced from
//! ([`LensContent`]). Scenes are read on a grid of one cell per pixel over the frame and an eighth
//! of its width around it: two scenes that differ only in detail below a pixel which leaves
//! *every* pixel's average as it is share a key.
//!
//! 64-bit SipHash of the standard library: by accident, two of a million results collide with a
//! probability of 3e-8. It may change with the compiler, which costs a recomputation.

use super::engine::stations::Stations;
use super::engine::{Blur, Lens, Options, OverField, SensorGrid};
use camrig_base::Bands;
use camrig_base::Result;
use camrig_scene::{Grid, Scene};
use std::hash::{DefaultHasher, Hasher};
use std::path::PathBuf;

/// Samples each way by which a figure over the plane enters a key.
const PLANE_SAMPLES: usize = 65;
/// Samples by which a radial curve enters a key. Two curves that agree at all of them count as
/// one.
const CURVE_SAMPLES: usize = 1025;

/// To be raised whenever the same input gives other planes or another lens than before; a test of the
/// engine says when.
pub(crate) const REVISION: u32 = 5;

/// What represents a lens in a key.
#[non_exhaustive]
pub enum LensContent<'a> {
    /// Every figure that the engine would ask for.
    Figures(&'a dyn Lens),
    /// A description from which those figures follow.
    Description(String),
}

/// The key of a result that follows from a description alone: 16 hexadecimal digits.
#[must_use]
pub fn key_of_description(description: &str) -> String {
    let mut content = Content::new();
    content.0.write(description.as_bytes());
    content.key()
}

/// The key of the planes that `scene`, its `white` per band, lens, grid and options give, 16
/// hexadecimal digits.
///
/// # Errors
/// A scene that cannot be rendered.
pub fn key(
    scene: &dyn Scene,
    white: &[f64],
    lens: &LensContent<'_>,
    grid: &SensorGrid,
    options: &Options,
) -> Result<String> {
    let mut content = Content::new();
    let bands = scene.bands();
    content.numbers([bands.start_nm, bands.step_nm, bands.count as f64]);
    content.numbers(white.iter().copied());
    content.grid(grid, options);
    match lens {
        LensContent::Figures(lens) => content.lens(*lens, &bands, grid),
        LensContent::Description(text) => content.0.write(text.as_bytes()),
    }
    content.scene(scene, &bands, grid)?;
    Ok(content.key())
}

/// Where results are kept: `$XDG_CACHE_HOME/camrig/optics`, else `~/.cache/camrig/optics`; `None`
/// where neither variable is set to an absolute path.
#[must_use]
pub fn directory() -> Option<PathBuf> {
    let absolute =
        |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|p| p.is_absolute());
    let base =
        absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|h| h.join(".cache")))?;
    Some(base.join("camrig").join("optics"))
}

struct Content(DefaultHasher);

impl Content {
    fn new() -> Self {
        let mut hasher = DefaultHasher::new();
        hasher.write(env!("CARGO_PKG_VERSION").as_bytes());
        hasher.write_u32(REVISION);
        Self(hasher)
    }

    fn key(&self) -> String {
        format!("{:016x}", self.0.finish())
    }

    fn numbers(&mut self, values: impl IntoIterator<Item = f64>) {
        values.into_iter().for_each(|v| self.0.write_u64(v.to_bits()));
    }

    fn grid(&mut self, grid: &SensorGrid, options: &Options) {
        self.numbers([grid.width as f64, grid.height as f64, grid.pitch_um, grid.fill_factor]);
        // The number of threads is not part of it: the planes do not depend on it.
        let Options { oversample, step_error, misplaced_light, border, threads: _, device } =
            *options;
        self.numbers([oversample.unwrap_or(0) as f64, step_error, misplaced_light]);
        self.0.write_u8(border as u8);
        // Graphics processors differ from the processor and from each other in the last bits.
        device.name().into_iter().for_each(|name| self.0.write(name.as_bytes()));
    }

    fn lens(&mut self, lens: &dyn Lens, bands: &Bands, grid: &SensorGrid) {
        let (x, y) = lens.axis_mm();
        self.numbers([x, y, lens.veiling_glare()]);
        let reach = libm::hypot(grid.width_mm(), grid.height as f64 * grid.pitch_um * 1e-3)
            + libm::hypot(x, y);
        for nm in bands.centres() {
            self.numbers([lens.steradians(nm)]);
            let ratios = lens.illumination(nm);
            self.over_field(ratios.as_ref(), reach, |&ratio| [ratio, 0.0]);
            let ideal = lens.ideal_place(nm);
            self.over_field(ideal.as_ref(), reach, |&(x, y)| [x, y]);
            match lens.blur(nm) {
                Blur::Otf(otf) => {
                    self.numbers([otf.cutoff_per_mm, otf.spread_um, otf.tail_um]);
                    self.curve(&otf.at, otf.cutoff_per_mm);
                }
                Blur::Field { psfs, cutoff_per_mm } => {
                    self.numbers([cutoff_per_mm, psfs.spacing_um, psfs.size as f64]);
                    match &psfs.stations {
                        Stations::Heights(heights_mm) => self.numbers(heights_mm.iter().copied()),
                        Stations::Lattice(lattice) => {
                            self.numbers(lattice.x_mm.iter().chain(&lattice.y_mm).copied());
                        }
                    }
                    psfs.psfs.iter().for_each(|psf| self.samples(psf));
                }
            }
        }
    }

    /// A figure over places as far as `reach` from the axis each way.
    fn over_field<T>(
        &mut self,
        figure: Option<&OverField<'_, T>>,
        reach: f64,
        numbers: impl Fn(&T) -> [f64; 2],
    ) {
        self.0.write_u8(u8::from(figure.is_some()));
        match figure {
            None => self.curve(&|_| 0.0, reach),
            Some(OverField::Radial(curve)) => self.curve(curve, reach),
            Some(OverField::Plane(function)) => {
                let at = |i: usize| reach * (2.0 * i as f64 / (PLANE_SAMPLES - 1) as f64 - 1.0);
                for k in 0..PLANE_SAMPLES * PLANE_SAMPLES {
                    let value = function(at(k % PLANE_SAMPLES), at(k / PLANE_SAMPLES));
                    self.numbers(numbers(&value));
                }
            }
        }
    }

    fn curve(&mut self, curve: &dyn Fn(f64) -> f64, end: f64) {
        let step = end / (CURVE_SAMPLES - 1) as f64;
        self.numbers((1..CURVE_SAMPLES).map(|i| curve(step * i as f64)));
    }

    fn scene(&mut self, scene: &dyn Scene, bands: &Bands, grid: &SensorGrid) -> Result<()> {
        let margin = grid.width.div_ceil(8);
        let cell = 1.0 / grid.width as f64;
        let area = Grid {
            width: grid.width + 2 * margin,
            height: grid.height + 2 * margin,
            left: -0.5 - margin as f64 * cell,
            top: -(grid.height as f64 / 2.0 + margin as f64) * cell,
            cell,
        };
        for band in 0..bands.count {
            self.samples(&scene.plane(band, &area)?.data);
        }
        Ok(())
    }

    fn samples(&mut self, values: &[f32]) {
        self.0.write_usize(values.len());
        self.0.write(pulp::bytemuck::cast_slice(values));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Departed, Departures, Device, Diffraction, Distortion, Illumination};
    use camrig_base::Plane;
    use camrig_base::Spectrum;
    use camrig_scene::Quantity;

    struct Ramp(f32);

    impl Scene for Ramp {
        fn bands(&self) -> Bands {
            Bands { start_nm: 450.0, step_nm: 100.0, count: 3 }
        }
        fn quantity(&self) -> Quantity {
            Quantity::Radiance
        }
        fn aspect(&self) -> Option<f64> {
            None
        }
        fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
            Ok(Plane::from_fn(grid.width, grid.height, |x, _| self.0 * (x + band) as f32))
        }
    }

    #[test]
    fn everything_that_matters_changes_the_key_and_threads_do_not() {
        let lens = Diffraction {
            f_number: 2.8,
            focal_length_mm: 4.0,
            magnification: 0.0,
            transmittance: Spectrum::constant(0.9),
            illumination: Illumination::Cos4,
            defocus_um: 0.0,
        };
        let grid = SensorGrid { width: 24, height: 16, pitch_um: 2.2, fill_factor: 0.6 };
        let white = [1.0; 3];
        let options = Options::default();
        let key = |scene: &Ramp,
                   white: &[f64],
                   lens: &dyn Lens,
                   grid: &SensorGrid,
                   options: &Options| {
            super::key(scene, white, &LensContent::Figures(lens), grid, options)
        };
        let base = key(&Ramp(1.0), &white, &lens, &grid, &options).unwrap();
        let threads = Options { threads: Some(3), ..options };
        assert_eq!(base, key(&Ramp(1.0), &white, &lens, &grid, &threads).unwrap());
        let mut others = vec![
            key(&Ramp(1.1), &white, &lens, &grid, &options),
            key(&Ramp(1.0), &[1.0, 1.0, 0.9], &lens, &grid, &options),
            key(&Ramp(1.0), &white, &lens, &SensorGrid { pitch_um: 2.3, ..grid }, &options),
            key(&Ramp(1.0), &white, &lens, &grid, &Options { oversample: Some(2), ..options }),
        ];
        let defocused = Diffraction { defocus_um: 3.0, ..lens.clone() };
        others.push(key(&Ramp(1.0), &white, &defocused, &grid, &options));
        for departures in [
            Departures {
                distortion: Distortion { k1: 1e-3, ..Distortion::default() },
                ..Departures::default()
            },
            Departures { veiling_glare: 0.01, ..Departures::default() },
            Departures { axis_mm: (0.0, 0.1), ..Departures::default() },
            Departures { transmittance: Spectrum::constant(0.9), ..Departures::default() },
        ] {
            let lens = Departed { lens: Box::new(lens.clone()), departures };
            others.push(key(&Ramp(1.0), &white, &lens, &grid, &options));
        }
        for device in Device::available().into_iter().skip(1) {
            let options = Options { device, ..options };
            others.push(key(&Ramp(1.0), &white, &lens, &grid, &options));
        }
        let described = |text| {
            let lens = LensContent::Description(String::from(text));
            super::key(&Ramp(1.0), &white, &lens, &grid, &options)
        };
        assert_ne!(described("a").unwrap(), described("b").unwrap());
        others.push(described("a"));
        for (i, other) in others.into_iter().enumerate() {
            assert_ne!(base, other.unwrap(), "change {i}");
        }
    }
}
