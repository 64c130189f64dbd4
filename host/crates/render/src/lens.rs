//! The lens of a camera file as the optics engine takes it.

use super::optical_effects::Optics;
use super::traced::Tracing;
use camrig_base::{Bands, Error, Result, Spectrum, weighted_means};
use camrig_camera::{Camera, LensKind, RelativeIllumination};
use camrig_light::Illuminant;
use camrig_optics::content::LensContent;
use camrig_optics::interpolate::MonotoneCubic;
use camrig_optics::{Departed, Departures, Diffraction, Illumination};
use camrig_optics::{Lens, LensTables, Options, SensorGrid};
use std::path::Path;

/// The sensor's grid as the optics sees it.
pub fn sensor_grid(camera: &Camera) -> SensorGrid {
    let sensor = &camera.sensor;
    SensorGrid {
        width: sensor.width as usize,
        height: sensor.height as usize,
        pitch_um: sensor.pitch_um,
        fill_factor: sensor.fill_factor,
    }
}

/// The lens with the optical effects of the camera file. A prescription is traced at the
/// wavelengths of `bands`, at as many heights as [`Options::misplaced_light`] asks.
///
/// # Errors
/// Lens data that cannot be read or traced; a defocus of a lens whose wavefront is not known.
pub fn lens(camera: &Camera, bands: &Bands, options: &Options) -> Result<Box<dyn Lens>> {
    Ok(Described::new(camera, bands, None, options)?.lens(None)?.0)
}

/// What a user should know of the lens of a camera in light of `bands`: what the reader of a
/// prescription assumed or ignored, and where sensor or light go beyond tables.
///
/// # Errors
/// Those of [`lens`], but for what only tracing shows.
pub fn lens_notes(camera: &Camera, bands: &Bands) -> Result<Vec<String>> {
    Ok(Described::new(camera, bands, None, &Options::default())?.notes().to_vec())
}

/// The lens of a camera file, known well enough to tell it from any other, but not yet traced, and
/// the light that comes through it.
///
/// The engine takes a lens's transmittance at the centre of a band. It is given the mean over the
/// band, weighted by the light, so that filters narrower than a band and steep edges count in full.
pub struct Described {
    source: Source,
    /// Spectrum of the light on the sensor within a band, as a product: illuminant and
    /// transmittances.
    pub light: Vec<Spectrum>,
}

enum Source {
    /// A lens of given figures.
    Given {
        /// The lens.
        lens: Box<dyn Lens>,
        /// Where the sensor or its light goes beyond its tables.
        notes: Vec<String>,
    },
    /// One whose figures have to be traced, and what comes on top of them.
    Traced {
        /// What is to be traced.
        tracing: Box<Tracing>,
        /// Its transmittance: the mean over each band, at the band's centre.
        transmittance: Spectrum,
        /// What else the lens has.
        departures: Box<Departures>,
    },
}

impl Described {
    /// The lens as `camera` describes it, in the light of an illuminant, or in light that is even
    /// within each band; see [`lens`].
    ///
    /// # Errors
    /// Lens data that cannot be read; a defocus of a lens whose wavefront is not known.
    pub fn new(
        camera: &Camera,
        bands: &Bands,
        illuminant: Option<&Illuminant>,
        options: &Options,
    ) -> Result<Self> {
        let grid = sensor_grid(camera);
        let Optics { defocus_um, ln_f_number, departures } =
            Optics::of(&camera.optical_effects, &grid)?;
        if ln_f_number != 0.0 && !matches!(camera.lens.kind, LensKind::DiffractionLimited { .. }) {
            return Err(Error::unsupported(
                "another f-number of a lens whose figures are of its own",
            )
            .at("[[effect]] kind = \"f-number\"")
            .help(
                "use a lens of kind \"diffraction-limited\", or give the stop in the \
                     prescription or characterisation",
            ));
        }
        let mut factors = vec![camera.lens.transmittance.clone(), departures.transmittance];
        let departures = Departures { transmittance: Spectrum::constant(1.0), ..departures };
        let power = illuminant.map(|illuminant| illuminant.power.clone());
        let mean_transmittance = |factors: &[Spectrum]| {
            let (factors, power) = (factors.iter().collect::<Vec<_>>(), power.iter());
            let means = weighted_means(&factors, &power.collect::<Vec<_>>(), bands);
            Spectrum::new(bands.centres().collect(), means)
        };
        let source = match &camera.lens.kind {
            LensKind::Prescription(setup) => {
                let transmittance = mean_transmittance(&factors)?;
                let reach_mm = reach_mm(&departures, &grid);
                let tracing = Tracing::new(camera, setup, bands, options, defocus_um, reach_mm)?;
                let departures = Box::new(departures);
                Source::Traced { tracing: Box::new(tracing), transmittance, departures }
            }
            LensKind::Characterised(path) => {
                let tables = characterised(path, defocus_um)?;
                let extent = tables.extent();
                factors.push(tables.transmittance().clone());
                let lens = tables.into_lens(mean_transmittance(&factors)?);
                let lens = departed(lens, departures);
                let notes = extent.notes(&path.display().to_string(), &*lens, &grid, bands);
                Source::Given { lens, notes }
            }
            LensKind::DiffractionLimited {
                f_number,
                focal_length_mm,
                magnification,
                relative_illumination,
            } => {
                let lens = Box::new(Diffraction {
                    f_number: f_number * libm::exp(ln_f_number),
                    focal_length_mm: *focal_length_mm,
                    magnification: *magnification,
                    transmittance: mean_transmittance(&factors)?,
                    illumination: illumination(relative_illumination, grid.corner_mm()),
                    defocus_um,
                });
                Source::Given { lens: departed(lens, departures), notes: Vec::new() }
            }
        };
        let light = power.into_iter().chain(factors).collect();
        Ok(Self { source, light })
    }

    /// What the lens is, for a key.
    pub fn content(&self) -> LensContent<'_> {
        match &self.source {
            Source::Given { lens, .. } => LensContent::Figures(&**lens),
            Source::Traced { tracing, transmittance, departures } => LensContent::Description(
                format!("{} {transmittance:?} {departures:?}", tracing.description()),
            ),
        }
    }

    /// What the reader of a prescription assumed or ignored, and where the sensor or its light goes
    /// beyond tables.
    pub fn notes(&self) -> &[String] {
        match &self.source {
            Source::Given { notes, .. } => notes,
            Source::Traced { tracing, .. } => tracing.notes(),
        }
    }

    /// The lens, and whether it was traced now; one that `directory` holds is not traced again.
    ///
    /// # Errors
    /// A prescription that cannot be traced.
    pub fn lens(self, directory: Option<&Path>) -> Result<(Box<dyn Lens>, bool)> {
        match self.source {
            Source::Given { lens, .. } => Ok((lens, false)),
            Source::Traced { tracing, transmittance, departures } => {
                let (tables, traced) = tracing.tables(directory)?;
                Ok((departed(tables.into_lens(transmittance), *departures), traced))
            }
        }
    }
}

fn departed(lens: Box<dyn Lens>, departures: Departures) -> Box<dyn Lens> {
    match departures == Departures::default() {
        true => lens,
        false => Box::new(Departed { lens, departures }),
    }
}

/// Image height of the sensor's farthest corner, mm, as the lens has it without departures.
fn reach_mm(departures: &Departures, grid: &SensorGrid) -> f64 {
    let half = |n: usize, axis: f64| 5e-4 * n as f64 * grid.pitch_um + axis.abs();
    let (x, y) = departures.axis_mm;
    let corner = libm::hypot(half(grid.width, x), half(grid.height, y));
    departures.distortion.inverse()(corner)
}

fn illumination(given: &RelativeIllumination, corner_mm: f64) -> Illumination {
    match given {
        RelativeIllumination::Cos4 => Illumination::Cos4,
        RelativeIllumination::Flat => Illumination::Uniform,
        RelativeIllumination::Table(table) => {
            let (heights, ratios) = table.iter().map(|(h, r)| (h * corner_mm, *r)).unzip();
            Illumination::Table(MonotoneCubic::new(heights, ratios))
        }
    }
}

fn characterised(path: &Path, defocus_um: f64) -> Result<LensTables> {
    if defocus_um != 0.0 {
        return Err(Error::unsupported(
            "defocus of a characterised lens: its tables hold no wavefront",
        )
        .at("[[effect]] kind = \"defocus\"")
        .help(
            "use a lens of kind \"prescription\" or \"diffraction-limited\", or a \
                 characterisation made out of focus (camrig lens trace --sensor-shift)",
        ));
    }
    LensTables::read(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{OpticsPath, OpticsStage, SceneLight, scene_irradiance};
    use camrig_camera::OpticalEffect;
    use camrig_lens::prescription::Setup;
    use camrig_optics::diffraction::hopkins_otf;
    use camrig_optics::{Blur, Characterisation};
    use std::path::PathBuf;

    fn steradians_and_mtf(camera: &Camera) -> (f64, f64) {
        let lens = lens(camera, &Bands::VISIBLE, &Options::default()).unwrap();
        let mtf = match lens.blur(550.0) {
            Blur::Otf(otf) => (otf.at)(100.0),
            Blur::Field { psfs, .. } => psfs.axial_mtf()(100.0),
        };
        (lens.steradians(550.0), mtf)
    }

    #[test]
    fn optical_effects_reach_every_kind_of_lens_that_can_have_them() {
        let mut camera = Camera::load("mt9t012").unwrap();
        let (light, mtf) = steradians_and_mtf(&camera);
        let effect = |kind, values: &[f32]| OpticalEffect::new(kind, values).unwrap();
        camera.optical_effects =
            vec![effect("defocus", &[20.0]), effect("lens-transmittance", &[0.5, 0.0])];
        let (less, lower) = steradians_and_mtf(&camera);
        assert!((less / light - 0.5).abs() < 1e-12 && lower < 0.9 * mtf, "{lower} of {mtf}");

        // Another stop is a lens of that f-number; only one of given figures has another.
        camera.optical_effects = vec![effect("f-number", &[0.25])];
        let (less, lower) = steradians_and_mtf(&camera);
        let mut stopped = Camera::load("mt9t012").unwrap();
        let LensKind::DiffractionLimited { f_number, .. } = &mut stopped.lens.kind else {
            panic!()
        };
        *f_number *= 2.0;
        let (right, right_mtf) = steradians_and_mtf(&stopped);
        assert!((less / right - 1.0).abs() < 1e-12 && (lower - right_mtf).abs() < 1e-12);
        assert!((less / light - 0.25).abs() < 0.01, "{less} of {light}");
        camera.lens.kind = LensKind::Characterised(PathBuf::from("not-read"));
        let error = lens(&camera, &Bands::VISIBLE, &Options::default()).err().unwrap().to_string();
        assert!(error.contains("another f-number"), "{error}");
        camera.optical_effects = vec![effect("defocus", &[20.0])];
        let error = lens(&camera, &Bands::VISIBLE, &Options::default()).err().unwrap().to_string();
        assert!(error.contains("no wavefront"), "{error}");

        // A plane and a hyperboloid of eccentricity n: perfect on the axis, so Hopkins holds.
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("singlet.toml");
        std::fs::write(&file, SINGLET).unwrap();
        camera.lens.kind = LensKind::Prescription(Box::new(Setup { file, ..Setup::default() }));
        (camera.sensor.width, camera.sensor.height) = (64, 48);
        let bands = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };
        for defocus_um in [0.0, 40.0, -80.0] {
            camera.optical_effects = vec![effect("defocus", &[defocus_um])];
            let lens = lens(&camera, &bands, &Options::default()).unwrap();
            let Blur::Field { psfs, cutoff_per_mm } = lens.blur(550.0) else {
                panic!("a traced lens has PSFs")
            };
            let waves = f64::from(defocus_um).abs() / (8.0 * 16.0 * 0.55);
            for per_mm in [30.0, 60.0, 120.0] {
                let theory = hopkins_otf(per_mm / cutoff_per_mm, waves).abs();
                let found = psfs.axial_mtf()(per_mm);
                // The window of 128 samples cuts the PSF's wings, some per cent of its light.
                assert!((found - theory).abs() < 0.03, "{defocus_um} {per_mm}: {found} {theory}");
            }
        }
    }

    #[test]
    fn what_the_reader_of_a_lens_assumed_is_told() {
        let mut camera = Camera::load("mt9t012").unwrap();
        let described = |camera: &Camera| {
            Described::new(camera, &Bands::VISIBLE, None, &Options::default())
                .unwrap()
                .notes()
                .to_vec()
        };
        assert!(described(&camera).is_empty());
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("singlet.seq");
        let text =
            "RDM; EPD 2; DIM M; WL 550; YAN 0; SO 0 1e13; S 10 2 1.5168:64.17; S -10 9; SI 0 0";
        std::fs::write(&file, text).unwrap();
        camera.lens.kind = LensKind::Prescription(Box::new(Setup { file, ..Setup::default() }));
        let notes = described(&camera);
        assert!(notes.len() == 1 && notes[0].contains("first surface is the stop"), "{notes:?}");
    }

    #[test]
    fn a_sensor_beyond_the_tables_of_a_lens_is_told_wherever_it_is_used() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("small");
        // To an image height of 0.5 mm, 400 to 700 nm.
        Characterisation::example(17, 0.5).write(&path, false).unwrap();
        let mut camera = Camera::load("mt9t012").unwrap();
        camera.lens.kind = LensKind::Characterised(path.clone());
        (camera.sensor.width, camera.sensor.height, camera.sensor.pitch_um) = (64, 48, 20.0);
        let light = SceneLight::lux("D65", 100.0);
        let seen =
            scene_irradiance(&camera, "uniform", &light, &Options::default(), |_, _| ()).unwrap();
        let told = |notes: &[String]| {
            let of_lens: Vec<&String> = notes.iter().filter(|n| n.contains("small: ")).collect();
            let ends = of_lens.iter().filter(|n| n.contains("end at 0.500 mm"));
            assert_eq!(ends.count(), 1, "{notes:?}");
        };
        told(&seen.notes);
        let stage = OpticsStage {
            scene: "uniform".into(),
            illuminant: None,
            level: None,
            options: Options::default(),
            cache: None,
            motion: None,
            path: OpticsPath::Bands,
        };
        told(&stage.run(&camera, |_, _| ()).unwrap().notes);
        // Half the corner's height of 0.8 mm.
        camera.sensor.pitch_um = 10.0;
        let bands = Bands::VISIBLE;
        let described = Described::new(&camera, &bands, None, &Options::default()).unwrap();
        assert_eq!(described.notes(), [""; 0]);
        // The axis moved right by 20 pixels: the left corner is 0.52 mm from it.
        let moved = OpticalEffect::new("decentre-tilt", &[20.0, 0.0]);
        camera.optical_effects = vec![moved.unwrap()];
        let described = Described::new(&camera, &bands, None, &Options::default()).unwrap();
        assert_eq!(described.notes().len(), 1);
    }

    const SINGLET: &str = r#"
format = "camrig-prescription/1"
wavelengths_nm = [550.0]
fields_deg = [0.0]
[aperture]
f_number = 4.0
[[surface]]
thickness_mm = 2.0
glass = "flat"
stop = true
[[surface]]
radius_mm = -5.0
conic = -2.25
thickness_mm = 10.0
[glass.flat]
table_nm = [[400.0, 1.5], [700.0, 1.5]]
"#;
}
