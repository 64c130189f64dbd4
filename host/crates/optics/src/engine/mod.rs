//! The optics engine: scene radiance in, spectral irradiance on the sensor grid out, band by band.
//!
//! Per band, E(x, y) = L(ideal(x, y)) ⊗ blur ⊗ pixel · π·T(λ)/(1+4(N(1+|m|))²) · RI(x, y) (eq. 7):
//! 1. the scene is rendered, **area averaged**, on cells s times finer than the pixels
//!    ([`sampling`] says how s is chosen), with a margin around the frame;
//! 2. where the lens distorts, it is resampled at the *ideal* place of every real cell (inverse
//!    mapping; radiance is resampled, so no Jacobian);
//! 3. the blur and the pixel's photosensitive square, integrated exactly, act in the Fourier
//!    domain, and the result is taken at the pixel centres. Aliasing of the real pixel grid stays;
//!    that of the cell grid is bounded by the choice of s. Kernels are finite and the margin holds
//!    them whole, so convolution is linear: nothing wraps around. (On a graphics processor a blur
//!    that varies over the field is summed directly: [`Device`]);
//! 4. relative illumination at the pixel centre and eq. 7 are applied, once.

pub mod sampling;

pub mod collapsed;
mod device;
mod field;
pub(super) mod fourier;
#[cfg_attr(not(feature = "gpu"), path = "gpu/absent.rs")]
mod gpu;
pub mod nodes;
pub mod over_field;
pub mod psf;
mod range;
mod sharpen;
pub(super) mod source;
pub mod stations;
pub mod varying;
mod warp;
pub(super) mod wide;

use camrig_base::{Error, Plane, Result};
use camrig_scene::LitScene;
pub use device::{Device, DeviceChoice};
use fourier::Kernel;
pub use nodes::{Misplaced, NodeReport};
pub use over_field::{OverField, PlaneFunction};
use sampling::{Cells, Layout};
use serde::{Deserialize, Serialize};
pub use source::Border;
use wide::Wide;

/// A function of image height in mm.
pub type RadialCurve<'a> = Box<dyn Fn(f64) -> f64 + Send + Sync + 'a>;

/// The sensor as the optics sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorGrid {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Distance of pixel centres, µm.
    pub pitch_um: f64,
    /// Photosensitive area over pitch²; a square of side pitch·√fill factor about the pixel's
    /// centre.
    pub fill_factor: f64,
}

/// How a lens blurs.
pub enum Blur<'a> {
    /// The same everywhere: a real, rotationally symmetric optical transfer function.
    Otf(Otf<'a>),
    /// Different over the field: point-spread functions by image height or place.
    Field {
        /// The PSFs.
        psfs: psf::PsfField,
        /// Frequency beyond which nothing passes (diffraction), cycles/mm.
        cutoff_per_mm: f64,
    },
}

/// An optical transfer function, or a part of one.
pub struct Otf<'a> {
    /// Frequency beyond which nothing passes, cycles/mm.
    pub cutoff_per_mm: f64,
    /// Distance from the ideal place within which all of the light but the tail falls, µm; what
    /// else falls beyond is folded back into it.
    pub spread_um: f64,
    /// Length t of the tail, µm: beyond `spread_um` the point-spread function is t/(4π²r³), as
    /// behind an aperture with edges, where the value falls from frequency 0 as 1 − t·f. 0
    /// without. It is followed for the longer side of the frame.
    pub tail_um: f64,
    /// The value over frequency in cycles/mm, 1 at frequency 0.
    pub at: RadialCurve<'a>,
}

/// What the engine asks of a lens. Image heights and places are real ones from the optical axis,
/// mm.
pub trait Lens: Send + Sync {
    /// Irradiance on the axis over radiance, sr: eq. 7 with transmittance.
    fn steradians(&self, nm: f64) -> f64;
    /// Illumination relative to the axis over real image places; `None` for 1 everywhere.
    fn illumination(&self, nm: f64) -> Option<OverField<'_, f64>>;
    /// Paraxial over real image places: the inverse of distortion; `None` without any.
    fn ideal_place(&self, nm: f64) -> Option<OverField<'_, (f64, f64)>>;
    /// Ideal image height over the tangent of the angle before the lens, mm: f(1 + |m|/P) with
    /// focal length f, magnification m and pupil magnification P.
    fn principal_distance_mm(&self) -> f64;
    /// Where the optical axis meets the sensor, mm right of and below its centre.
    fn axis_mm(&self) -> (f64, f64) {
        (0.0, 0.0)
    }
    /// Fraction of the light that reaches the frame spread evenly over it.
    fn veiling_glare(&self) -> f64 {
        0.0
    }
    /// The blur.
    fn blur(&self, nm: f64) -> Blur<'_>;
}

/// Options of the computation; the defaults suit any scene.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Cells per pixel and direction; `None` takes the smallest that keeps
    /// [`Options::step_error`].
    pub oversample: Option<usize>,
    /// Largest error at a sharp step of the scene, relative to the step, that the cell grid may
    /// cause.
    pub step_error: f64,
    /// Largest mean fraction of light that interpolating PSFs between nodes may misplace.
    pub misplaced_light: f64,
    /// What lies beyond the frame.
    pub border: Border,
    /// Worker threads; `None` for one per processor. The result does not depend on it.
    pub threads: Option<usize>,
    /// Device of a blur that varies over the field. Graphics processors round differently, each
    /// kind in its own way.
    pub device: Device,
}

/// Default bound on the error at a sharp step, relative to the step. It is a worst case over all
/// phases and frequencies, and real edges stay well below it; a smaller bound costs more cells.
const STEP_ERROR: f64 = 0.025;
/// Default bound on the mean share of light that interpolation of PSFs misplaces, chosen as a
/// trade of time against error: nodes twice as close leave a quarter of the error and need four
/// times the kernels.
const MISPLACED_LIGHT: f64 = 0.01;

impl Default for Options {
    fn default() -> Self {
        Self {
            oversample: None,
            step_error: STEP_ERROR,
            misplaced_light: MISPLACED_LIGHT,
            border: Border::Scene,
            threads: None,
            device: Device::Cpu,
        }
    }
}

impl Options {
    /// Starts the worker threads.
    fn workers(&self) -> Result<rayon::ThreadPool> {
        rayon::ThreadPoolBuilder::new()
            .num_threads(self.threads.unwrap_or(0))
            .build()
            .map_err(|e| Error::device(format!("cannot start worker threads: {e}")))
    }
}

/// What the engine did.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Cells per pixel and direction, per band.
    pub oversample: Vec<usize>,
    /// Margin rendered around the frame, pixels, largest over the bands.
    pub margin_pixels: usize,
    /// Bound on the error at a sharp step relative to the step, largest over the bands; the wings
    /// of an OTF add less than 1e-3.
    pub step_error: f64,
    /// Where the blur varies over the field: how PSFs are interpolated, and how well. Errors are
    /// the worst of the first, middle and last band.
    pub nodes: Option<NodeReport>,
    /// The graphics processor that blurred, if one did.
    pub device: Option<String>,
}

impl Report {
    fn keep_margin(&mut self, pixels: usize) {
        self.margin_pixels = self.margin_pixels.max(pixels);
    }
}

/// Renders every band of `scene` through `lens` onto `grid`.
///
/// `sink(band, plane)` gets, in band order, the mean irradiance over each pixel's photosensitive
/// square, W m⁻² nm⁻¹. `progress(done, total)` is called after each band. Memory: about
/// 12 bytes per cell of one padded, oversampled band.
///
/// # Errors
/// Impossible grids and options, a scene that cannot be rendered, an error of the sink.
pub fn irradiance(
    scene: &LitScene,
    lens: &dyn Lens,
    grid: &SensorGrid,
    options: &Options,
    mut progress: impl FnMut(usize, usize),
    mut sink: impl FnMut(usize, Plane<f32>) -> Result<()> + Send,
) -> Result<Report> {
    grid.check()?;
    let pool = options.workers()?;
    let bands = scene.scene.bands();
    let mut report = Report::default();
    let (mut buffers, mut field_state) = (fourier::Buffers::default(), FieldState::default());
    for band in 0..bands.count {
        let nm = bands.nm(band);
        let mut plane = pool.install(|| {
            let job = Band { scene, band, lens, nm, grid, options };
            match lens.blur(nm) {
                Blur::Otf(otf) => job.through_otf(&otf, &mut buffers, &mut report),
                Blur::Field { psfs, cutoff_per_mm } => {
                    job.through_field(&psfs, cutoff_per_mm, &mut field_state, &mut report)
                }
            }
        })?;
        field::FallOff::new(lens, nm, grid).apply(&mut plane);
        sink(band, plane)?;
        progress(band + 1, bands.count);
    }
    Ok(report)
}

/// One band on its way through the lens.
#[derive(Clone, Copy)]
struct Band<'a> {
    scene: &'a LitScene<'a>,
    band: usize,
    lens: &'a dyn Lens,
    nm: f64,
    grid: &'a SensorGrid,
    options: &'a Options,
}

impl Band<'_> {
    /// Cells per pixel, by the option or by the step error, noted in the report.
    fn oversample(
        &self,
        cutoff_per_mm: f64,
        otf: &dyn Fn(f64) -> f64,
        report: &mut Report,
    ) -> Result<usize> {
        let (s, error) = cells_per_pixel(self.grid, self.options, cutoff_per_mm, otf)?;
        report.oversample.push(s);
        report.step_error = report.step_error.max(error);
        Ok(s)
    }

    fn source(&self, cells: &Cells) -> source::Source<'_> {
        let Self { scene, band, lens, nm, grid, options } = *self;
        let warp = source::Warp::new(lens, nm, grid, cells);
        source::Source::new(scene, band, warp, cells, options.border)
    }

    fn through_otf(
        &self,
        otf: &Otf,
        buffers: &mut fourier::Buffers,
        report: &mut Report,
    ) -> Result<Plane<f32>> {
        let wide = Wide::new(self.grid, &[otf]);
        let core = wide.core(otf);
        let oversample = self.oversample(core.cutoff_per_mm, &core.at, report)?;
        let layout = fourier::layout(self.grid, oversample, core.spread_um);
        report.keep_margin(layout.margin.max(wide.margin_pixels()));
        let kernel = Kernel::of_core(&core, wide.far(otf), &self.grid.geometry(&layout));
        let source = self.source(&layout.cells(self.grid));
        let rows = |first: usize, count: usize| source.rows(first, count);
        let mut plane = fourier::blur(&rows, kernel, &layout, buffers)?;
        let light = wide.light(|_, cells| self.source(cells))?;
        for (ring, light) in wide.rings.iter().zip(&light) {
            let kernel = ring.kernel(otf.tail_um);
            let far = fourier::blur(&ring.rows(light), kernel, &ring.layout, buffers)?;
            ring.add_to(&mut plane, &far);
        }
        Ok(plane)
    }

    fn through_field(
        &self,
        psfs: &psf::PsfField,
        cutoff_per_mm: f64,
        state: &mut FieldState,
        report: &mut Report,
    ) -> Result<Plane<f32>> {
        let s = self.oversample(cutoff_per_mm, &psfs.axial_mtf(), report)?;
        let tile_pixels = match state.tile_pixels {
            Some(pixels) => pixels,
            None => *state.tile_pixels.insert(self.node_distance()?),
        };
        let FieldGrids { layout, kernel } = &FieldGrids::new(psfs, self.grid, s);
        report.keep_margin(layout.margin);
        let source = self.source(&layout.cells(self.grid));
        let place = self.place(layout);
        let tiling = varying::Tiling::new(
            s,
            (layout.cells_across(), layout.cells_down()),
            kernel.size,
            kernel.before,
            tile_pixels * s,
        );
        if self.probes().contains(&self.band) {
            let tolerance = self.options.misplaced_light;
            let kernel_at = |x: f64, y: f64| psfs.kernel(x, y, kernel);
            let found = place.report(&kernel_at, psfs, kernel, &tiling, tolerance);
            match &mut report.nodes {
                None => report.nodes = Some(found),
                Some(nodes) => nodes.join(found),
            }
        }
        let kernels = place.kernels(psfs, kernel, &tiling);
        if state.blurrer.as_ref().is_none_or(|b| *b.tiling() != tiling) {
            state.blurrer = None;
        }
        let blurrer = match &mut state.blurrer {
            Some(blurrer) => blurrer,
            none => none.insert(device::Blurrer::new(self.options.device, &tiling)?),
        };
        report.device = self.options.device.name().map(String::from);
        blurrer.blur(
            &|first, count| source.rows(first, count),
            &kernels,
            (layout.left(), layout.top()),
            (layout.width, layout.height),
        )
    }

    /// The bands at which the interpolation of PSFs is judged.
    fn probes(&self) -> [usize; 3] {
        let last = self.scene.scene.bands().count - 1;
        [0, last / 2, last]
    }

    /// The distance of nodes, in pixels, that keeps the tolerance in every probe.
    fn node_distance(&self) -> Result<usize> {
        let mut least = usize::MAX;
        for band in self.probes() {
            let probe = Band { band, nm: self.scene.scene.bands().nm(band), ..*self };
            if let Blur::Field { psfs, cutoff_per_mm } = self.lens.blur(probe.nm) {
                let mtf = psfs.axial_mtf();
                let s = probe.oversample(cutoff_per_mm, &mtf, &mut Report::default())?;
                let FieldGrids { layout, kernel } = FieldGrids::new(&psfs, self.grid, s);
                let tolerance = self.options.misplaced_light;
                let kernel_at = |x: f64, y: f64| psfs.kernel(x, y, &kernel);
                least =
                    least.min(probe.place(&layout).node_distance(&kernel_at, &psfs, tolerance));
            }
        }
        Ok(least)
    }

    fn place<'b>(&self, layout: &'b Layout) -> nodes::Place<'b> {
        nodes::Place { layout, pitch_mm: self.grid.pitch_um * 1e-3, axis_mm: self.lens.axis_mm() }
    }
}

/// Most cells per pixel and direction, which bounds the memory.
const MAX_CELLS: usize = 64;

/// Cells per pixel, by the option or by the step error, and that error.
fn cells_per_pixel(
    grid: &SensorGrid,
    options: &Options,
    cutoff_per_mm: f64,
    otf: &dyn Fn(f64) -> f64,
) -> Result<(usize, f64)> {
    let (pitch, aperture) = (grid.pitch_um, grid.aperture_um());
    match options.oversample {
        Some(s) if !(1..=MAX_CELLS).contains(&s) => {
            Err(Error::limit(format!("{s} cells per pixel and direction"))
                .help(format!("use 1 to {MAX_CELLS}")))
        }
        Some(s) => Ok((s, sampling::step_error(s, pitch, aperture, cutoff_per_mm, otf))),
        None => sampling::oversample(options.step_error, pitch, aperture, cutoff_per_mm, otf),
    }
}

/// The grids of a band whose blur varies over the field.
pub(super) struct FieldGrids {
    /// The padded frame.
    pub layout: Layout,
    /// The kernels.
    pub kernel: psf::KernelGrid,
}

impl FieldGrids {
    /// Kernels that hold the PSFs, and a margin that holds the kernels.
    pub fn new(psfs: &psf::PsfField, grid: &SensorGrid, s: usize) -> Self {
        let radius_um = psfs.radius_um(psf::TAIL);
        let kernel = psf::KernelGrid::new(s, grid.pitch_um, grid.aperture_um(), radius_um);
        let margin_um = (kernel.before + s) as f64 * kernel.cell_um;
        Self { layout: Layout::new(grid, s, margin_um), kernel }
    }
}

/// State of field-varying blur that is kept from band to band.
#[derive(Default)]
struct FieldState {
    /// Distance of nodes.
    tile_pixels: Option<usize>,
    /// Plans and buffers, as long as the tiling stays the same.
    blurrer: Option<device::Blurrer>,
}

impl SensorGrid {
    /// Side of the photosensitive square, µm.
    #[must_use]
    pub fn aperture_um(&self) -> f64 {
        self.pitch_um * self.fill_factor.sqrt()
    }

    /// Half the frame's diagonal: the image height of the corners, mm.
    #[must_use]
    pub fn corner_mm(&self) -> f64 {
        libm::hypot(self.width as f64, self.height as f64) * self.pitch_um * 5e-4
    }

    /// The frame's width, mm.
    #[must_use]
    pub fn width_mm(&self) -> f64 {
        self.width as f64 * self.pitch_um * 1e-3
    }

    pub(super) fn geometry<'a>(&self, layout: &'a Layout) -> fourier::Geometry<'a> {
        let (pitch_um, aperture_um) = (self.pitch_um, self.aperture_um());
        fourier::Geometry { layout, pitch_um, aperture_um }
    }

    fn check(&self) -> Result<()> {
        if self.width == 0 || self.height == 0 {
            return Err(Error::input(format!(
                "a sensor of {} x {} pixels",
                self.width, self.height
            ))
            .help("give at least one pixel each way"));
        }
        if !(self.pitch_um.is_finite() && self.pitch_um > 0.0) {
            return Err(
                Error::input(format!("pitch {} µm", self.pitch_um)).help("give it in µm, above 0")
            );
        }
        if !(self.fill_factor > 0.0 && self.fill_factor <= 1.0) {
            return Err(Error::input(format!("fill factor {}", self.fill_factor))
                .help("photosensitive area over pitch², above 0 and at most 1"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
