//! Optics results kept on disk by content, so that the same scene through the same lens onto the
//! same grid is rendered once.
//!
//! A result is a cube (`KEY.irr`) and what the engine reported (`KEY.json`) in one directory;
//! beside them lie the lenses that were traced (`KEY.lens`, see `super::traced`), so that another
//! scene does not trace a lens again, and a cube that is there takes none. Files appear whole; one
//! that cannot be read counts as missing. The light level is not part of the key: cubes are
//! rendered for a white whose largest band is 1 and carry the level as a factor in their header,
//! with or without a cache, hit or miss. So a change of lux runs no optics, and the bytes never
//! depend on what happened to be cached.

use super::lens::Described;
use super::{About, MadeFor, made_for, sensor_grid};
use camrig_base::{Bands, Error, Result, Spectrum};
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube, IrradianceWriter};
use camrig_light::Illuminant;
use camrig_optics::{self as optics, Lens, Options, Report, SensorGrid, content};
use camrig_scene::LitScene;
use std::fs::Metadata;
use std::path::{Path, PathBuf};

/// A cube from the cache or freshly made.
pub struct Rendered {
    /// The irradiance.
    pub cube: IrradianceCube,
    /// What the engine reported, then or now.
    pub report: Report,
    /// Whether the cube came from the cache; say so to the user.
    pub hit: bool,
    /// Whether a lens was traced for it now.
    pub traced: bool,
    /// What the reader of the lens assumed or ignored.
    pub notes: Vec<String>,
}

/// [`super::irradiance`] through the cache in `directory`; without one it always renders.
///
/// A cache that cannot be written is no error: the result is simply not kept.
///
/// # Errors
/// Those of rendering.
pub fn irradiance(
    camera: &Camera,
    scene: &LitScene<'_>,
    options: &Options,
    about: About,
    directory: Option<&Path>,
    progress: impl FnMut(usize, usize),
) -> Result<Rendered> {
    let bands = scene.scene.bands();
    let grid = sensor_grid(camera);
    let described = Described::new(camera, &bands, about.illuminant.as_ref(), options)?;
    let of_lens = (made_for(camera)?, described.light.clone());
    let (header, white) = header(camera, scene, about, of_lens)?;
    let notes = described.notes().to_vec();
    let files = match directory {
        Some(directory) => {
            let key = content::key(scene.scene, &white, &described.content(), &grid, options)?;
            Some((directory.join(format!("{key}.irr")), directory.join(format!("{key}.json"))))
        }
        None => None,
    };
    if let Some((mut cube, report)) = files.as_ref().and_then(|(cube, report)| load(cube, report))
    {
        cube.header = header;
        return Ok(Rendered { cube, report, hit: true, traced: false, notes });
    }
    let (lens, traced) = described.lens(directory)?;
    let lit = LitScene { scene: scene.scene, white };
    let (cube, report) = rendered(&lit, &*lens, header, &grid, options, progress)?;
    if let Some((cube_path, report_path)) = &files {
        keep(&cube, cube_path, &report, report_path);
    }
    Ok(Rendered { cube, report, hit: false, traced, notes })
}

/// The header of a cube, and the white for which its samples are rendered: the largest band is 1.
pub(crate) fn header(
    camera: &Camera,
    scene: &LitScene<'_>,
    about: About,
    (made_for, light): (MadeFor, Vec<Spectrum>),
) -> Result<(CubeHeader, Vec<f64>)> {
    let level = scene.white.iter().fold(0.0f64, |m, &w| m.max(w));
    if level <= 0.0 {
        return Err(Error::input("the scene's light is 0 in every band")
            .help("choose an illuminant that reaches into the scene's bands"));
    }
    let white: Vec<f64> = scene.white.iter().map(|w| w / level).collect();
    let (grid, bands) = (sensor_grid(camera), scene.scene.bands());
    let header = CubeHeader {
        level,
        lux: about.lux,
        illuminant: about.illuminant.map(|illuminant| illuminant.name),
        light,
        made_for,
        ..CubeHeader::new((grid.width, grid.height), &bands, about.made_of)
    };
    Ok((header, white))
}

fn rendered(
    scene: &LitScene<'_>,
    lens: &dyn Lens,
    header: CubeHeader,
    grid: &SensorGrid,
    options: &Options,
    progress: impl FnMut(usize, usize),
) -> Result<(IrradianceCube, Report)> {
    let mut writer = IrradianceWriter::new(header)?;
    let report =
        optics::irradiance(scene, lens, grid, options, progress, |_, plane| writer.push(&plane))?;
    Ok((writer.finish()?, report))
}

/// A lens that is made once for many scenes of the same bands in the same light. Of these no cubes
/// are kept: each is seen once.
pub(crate) struct OneLens {
    lens: Box<dyn Lens>,
    /// What irradiance through it is made for. Looked up once, as it digests the lens's files.
    pub made_for: MadeFor,
    /// Spectrum of the light on the sensor within a band, as a product.
    pub light: Vec<Spectrum>,
    /// Whether it was traced now.
    pub traced: bool,
    /// What its reader assumed or ignored.
    pub notes: Vec<String>,
}

impl OneLens {
    /// The lens of `camera`, from `directory` where that holds it.
    pub fn new(
        camera: &Camera,
        bands: &Bands,
        illuminant: Option<&Illuminant>,
        options: &Options,
        directory: Option<&Path>,
    ) -> Result<Self> {
        let described = Described::new(camera, bands, illuminant, options)?;
        let light = described.light.clone();
        let notes = described.notes().to_vec();
        let made_for = made_for(camera)?;
        let (lens, traced) = described.lens(directory)?;
        Ok(Self { lens, made_for, light, traced, notes })
    }

    /// The lens itself.
    pub fn lens(&self) -> &dyn Lens {
        &*self.lens
    }

    /// What it was made for, and the light within a band.
    pub fn of_lens(&self) -> (MadeFor, Vec<Spectrum>) {
        (self.made_for.clone(), self.light.clone())
    }

    /// [`irradiance`] through this lens: the same bytes.
    pub fn irradiance(
        &self,
        camera: &Camera,
        scene: &LitScene<'_>,
        options: &Options,
        about: About,
        progress: impl FnMut(usize, usize),
    ) -> Result<(IrradianceCube, Report)> {
        let (header, white) = header(camera, scene, about, self.of_lens())?;
        let lit = LitScene { scene: scene.scene, white };
        rendered(&lit, &*self.lens, header, &sensor_grid(camera), options, progress)
    }
}

fn load(cube: &Path, report: &Path) -> Option<(IrradianceCube, Report)> {
    let report = serde_json::from_slice(&std::fs::read(report).ok()?).ok()?;
    Some((IrradianceCube::open(cube).ok()?, report))
}

/// The report is written last: a cube without one counts as missing.
fn keep(cube: &IrradianceCube, cube_path: &Path, report: &Report, report_path: &Path) {
    let Some(directory) = cube_path.parent() else { return };
    let kept = std::fs::create_dir_all(directory).is_ok() && cube.save(cube_path, true).is_ok();
    if let (true, Ok(text)) = (kept, serde_json::to_vec(report)) {
        // Losing the cache is no reason to fail: the result is in hand.
        let _ = std::fs::write(report_path, text);
        prune(directory);
    }
}

/// Largest size of a cache, bytes; the results made longest ago go first.
const LARGEST: u64 = 4 << 30;

fn prune(directory: &Path) {
    let mut all: Vec<_> = entries(directory)
        .filter(|(path, _)| path.extension().is_some_and(|e| e == "irr" || e == "lens"))
        .filter_map(|(path, about)| {
            let size = match about.is_dir() {
                true => entries(&path).map(|(_, file)| file.len()).sum(),
                false => about.len(),
            };
            Some((about.modified().ok()?, size, path))
        })
        .collect();
    all.sort();
    let mut total: u64 = all.iter().map(|(_, size, _)| size).sum();
    for (_, size, path) in all {
        if total <= LARGEST {
            return;
        }
        total -= size;
        // What stays is tried again next time.
        let _ = match path.is_dir() {
            true => std::fs::remove_dir_all(path),
            false => {
                let _ = std::fs::remove_file(path.with_extension("json"));
                std::fs::remove_file(path)
            }
        };
    }
}

/// What a directory holds, as far as it can be read.
fn entries(directory: &Path) -> impl Iterator<Item = (PathBuf, Metadata)> + use<> {
    let entries = std::fs::read_dir(directory).into_iter().flatten();
    entries.filter_map(|entry| {
        let entry = entry.ok()?;
        Some((entry.path(), entry.metadata().ok()?))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_scene::chart;

    fn rows(cube: &IrradianceCube) -> Vec<(Vec<u8>, Vec<u16>)> {
        let width = cube.header.width;
        (0..cube.header.bands)
            .flat_map(|band| (0..cube.header.height).map(move |y| (band, y)))
            .map(|(band, y)| {
                let chunk = cube.chunk(band, y, 1).unwrap();
                let row = chunk.row(width, y);
                (row.exponents.iter().map(|&e| e as u8).collect(), row.mantissas.to_vec())
            })
            .collect()
    }

    #[test]
    fn another_light_level_is_a_hit_with_the_same_bytes_and_another_lens_is_not() {
        let directory = tempfile::tempdir().unwrap();
        let mut camera = Camera::load("mt9t012").unwrap();
        (camera.sensor.width, camera.sensor.height) = (48, 32);
        let chart = chart::open("slanted-edge").unwrap().unwrap();
        let count = chart.bands().count;
        let run = |camera: &Camera, level: f64| {
            let lit = LitScene { scene: &*chart, white: vec![level; count] };
            let options = Options::default();
            let about = About { lux: Some(100.0 * level), ..About::default() };
            irradiance(camera, &lit, &options, about, Some(directory.path()), |_, _| {}).unwrap()
        };
        let first = run(&camera, 0.02);
        let second = run(&camera, 0.05);
        assert!(!first.hit && second.hit);
        assert_eq!(first.report, second.report);
        assert_eq!(rows(&first.cube), rows(&second.cube));
        assert_eq!((first.cube.header.level, second.cube.header.level), (0.02, 0.05));
        assert_eq!((first.cube.header.lux, second.cube.header.lux), (Some(2.0), Some(5.0)));
        camera.sensor.pitch_um *= 1.5;
        assert!(!run(&camera, 0.02).hit);
        // A damaged file counts as missing.
        for file in std::fs::read_dir(directory.path()).unwrap() {
            std::fs::write(file.unwrap().path(), b"?").unwrap();
        }
        assert!(!run(&camera, 0.02).hit);
        assert!(run(&camera, 0.02).hit);
    }

    /// Frame after frame goes through the lens as it was read, whatever becomes of its files.
    #[test]
    fn one_lens_for_many_frames_is_read_once_and_says_what_it_was_read_from() {
        let folder = tempfile::tempdir().unwrap();
        let tables = folder.path().join("lens");
        optics::Characterisation::example(17, 0.5).write(&tables, false).unwrap();
        let mut camera = Camera::load("mt9t012").unwrap();
        (camera.sensor.width, camera.sensor.height) = (48, 32);
        camera.lens.kind = camrig_camera::LensKind::Characterised(tables.clone());
        let chart = chart::open("slanted-edge").unwrap().unwrap();
        let lit = LitScene { scene: &*chart, white: vec![0.02; chart.bands().count] };
        let (options, about) = (Options::default(), About::default());
        let of_one = irradiance(&camera, &lit, &options, about.clone(), None, |_, _| {}).unwrap();
        let lens = OneLens::new(&camera, &chart.bands(), None, &options, None).unwrap();
        std::fs::remove_dir_all(&tables).unwrap();
        let (cube, _) = lens.irradiance(&camera, &lit, &options, about, |_, _| {}).unwrap();
        assert_eq!(cube.header.made_for, of_one.cube.header.made_for);
        assert_eq!(rows(&cube), rows(&of_one.cube));
    }
}
