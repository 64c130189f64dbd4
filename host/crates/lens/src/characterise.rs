//! From a traced lens to figures at field points, and to a whole [`Characterisation`].

use super::heights::{self, Density, Probe, Station};
use super::prescription::Object;
use super::psf::{self, Psf, Window};
use super::pupil::{Beam, Bundle, Outline};
use super::samples::{PupilSamples, Sample};
use super::system::System;
use super::train::Train;
use camrig_base::Spectrum;
use camrig_base::{Error, ErrorCode, Result};
use camrig_optics::{Characterisation, PsfGrid};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Cells across the pupil for the wavefront error and spot size of a field point: the rim's cells,
/// where the wavefront is steepest, then hold 3 % of the light.
const WAVEFRONT_CELLS: usize = 128;
/// Cells across the pupil for a geometric PSF: 5e4 rays, some tens for each sample of a spot that
/// fills half of a 64 x 64 window.
const GEOMETRIC_CELLS: usize = 256;
/// Side of the PSF window over the largest spot radius when the spacing is chosen: the spot's
/// diameter and a tenth more.
const WINDOW_OVER_SPOT_RADIUS: f64 = 2.2;
/// Fields at which the largest spot is looked for, about.
const SPOT_FIELDS: usize = 5;

/// Figures of one field point at one wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldPoint {
    /// Field angle at the paraxial entrance pupil, degrees.
    pub field_deg: f64,
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Height of the real chief ray on the image plane, mm, positive on the side of the paraxial
    /// image.
    pub chief_ray_height_mm: f64,
    /// Angle of the chief ray with the axis at the image, degrees, positive when it runs outwards.
    pub cra_deg: f64,
    /// Projected solid angle of the clipped pupil over that on the axis at the same wavelength:
    /// the irradiance ratio for a uniform Lambertian scene.
    pub relative_illumination: f64,
    /// Real height over paraxial height ([`System::paraxial_height_mm`]) − 1, percent; 0 on the
    /// axis, NaN from 90° on, where there is no paraxial height.
    pub distortion_percent: f64,
    /// Projected solid angle of the light from the field point, sr: that of the pupil seen from
    /// its image.
    pub projected_solid_angle_sr: f64,
    /// Root-mean-square optical path difference about its mean, waves.
    pub opd_rms_waves: f64,
    /// Root-mean-square distance of the rays from their centroid, mm.
    pub spot_rms_mm: f64,
}

/// How point-spread functions are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PsfMethod {
    /// Diffraction; geometry where the wavefront is too strong for it.
    #[default]
    Auto,
    /// Sum of plane waves.
    Diffraction,
    /// Ray positions.
    Geometric,
}

camrig_base::choices!(PsfMethod, "method of PSFs":
    Auto = "auto", Diffraction = "diffraction", Geometric = "geometric"
);

/// What a characterisation is to contain.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Image heights, evenly spaced from the axis to the largest field, before more are added
    /// between them.
    pub heights: usize,
    /// How heights are added; `None` keeps the even heights and does not measure the error between
    /// them.
    pub density: Option<Density>,
    /// Largest field, degrees.
    pub max_field_deg: f64,
    /// Wavelengths, nm, strictly rising.
    pub wavelengths_nm: Vec<f64>,
    /// Samples per side of a PSF.
    pub psf_size: usize,
    /// Distance between PSF samples, µm; `None` chooses it so that the spots fit into the window
    /// and diffraction is resolved.
    pub psf_spacing_um: Option<f64>,
    /// How PSFs are computed.
    pub method: PsfMethod,
}

/// Sign of the paraxial image height of a positive field angle (launch coordinates: see
/// [`super::pupil`]).
fn side(system: &System) -> f64 {
    match system.prescription.object {
        Object::Infinity => system.paraxial.efl_mm.signum(),
        Object::Distance(_) => -system.paraxial.magnification.signum(),
    }
}

/// Figures at every field (degrees) and wavelength (nm), fields outermost.
///
/// # Errors
/// Rays that are lost and glasses without data; the error names the field and the wavelength.
pub fn field_points(
    system: &System,
    fields: &[f64],
    wavelengths: &[f64],
) -> Result<Vec<FieldPoint>> {
    let trains = trains(system, wavelengths)?;
    let points: Result<Vec<Vec<FieldPoint>>> = fields
        .par_iter()
        .map(|&deg| {
            trains.iter().map(|train| Ok(Aimed::new(system, train, deg)?.point(true))).collect()
        })
        .collect();
    Ok(points?.concat())
}

/// sin²θ against the axis of the light that reaches the image from a field (degrees), at the
/// reference wavelength: the middles of `count` equal shares of its power, in rising order.
///
/// # Errors
/// Rays that are lost; lenses that are not rotationally symmetric.
pub fn sin2_at_image(system: &System, field_deg: f64, count: usize) -> Result<Vec<f64>> {
    let train = system.at(system.prescription.reference_nm)?;
    let beam = Beam::aim(&train, field_deg)?;
    let samples = PupilSamples::trace(&beam, &beam.fine_outline()?, WAVEFRONT_CELLS);
    let sin2 = |s: &Sample| s.direction[0] * s.direction[0] + s.direction[1] * s.direction[1];
    let mut rays: Vec<(f64, f64)> = samples.rays.iter().map(|s| (sin2(s), s.power)).collect();
    rays.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = rays.iter().map(|ray| ray.1).sum();
    let (mut ray, mut below) = (0, 0.0);
    let middle = |share: usize| {
        let wanted = (share as f64 + 0.5) / count as f64 * total;
        while ray + 1 < rays.len() && below + rays[ray].1 < wanted {
            below += rays[ray].1;
            ray += 1;
        }
        rays[ray].0
    };
    Ok((0..count).map(middle).collect())
}

/// The lens at each wavelength, with the solid angle of its pupil as seen from the axial image
/// point.
fn trains(system: &System, wavelengths: &[f64]) -> Result<Vec<AxisTrain>> {
    wavelengths.iter().map(|&nm| AxisTrain::new(system, nm)).collect()
}

struct AxisTrain {
    train: Train,
    axis_sr: f64,
    /// Solid angle of the light that arrives at the sensor on the axis, sr.
    sensor_sr: f64,
}

impl AxisTrain {
    fn new(system: &System, nm: f64) -> Result<Self> {
        let train = system.at(nm)?;
        let axis = Beam::aim(&train, 0.0)?;
        axis.check_rim()?;
        let outline = axis.fine_outline()?;
        let axis_sr = outline.projected_solid_angle();
        let sensor_sr = axis.solid_angle_from_sensor(&outline);
        Ok(Self { train, axis_sr, sensor_sr })
    }
}

/// A beam with its outline.
struct Aimed<'a> {
    system: &'a System,
    train: &'a AxisTrain,
    beam: Beam<'a>,
    outline: Outline,
}

impl<'a> Aimed<'a> {
    fn new(system: &'a System, train: &'a AxisTrain, field_deg: f64) -> Result<Self> {
        let beam = Beam::aim(&train.train, field_deg)?;
        let outline = beam.fine_outline()?;
        Ok(Self { system, train, beam, outline })
    }

    fn point(&self, wavefront: bool) -> FieldPoint {
        let beam = &self.beam;
        let side = side(self.system);
        let height = side * beam.height_mm();
        let ideal = self.system.paraxial_height_mm(beam.field_deg);
        let solid_angle = self.outline.projected_solid_angle();
        let samples = wavefront.then(|| PupilSamples::trace(beam, &self.outline, WAVEFRONT_CELLS));
        let figure = |f: &dyn Fn(&PupilSamples) -> f64| samples.as_ref().map_or(f64::NAN, f);
        FieldPoint {
            field_deg: beam.field_deg,
            wavelength_nm: beam.train.nm,
            chief_ray_height_mm: height,
            cra_deg: side * beam.chief_ray_angle_deg(),
            relative_illumination: solid_angle / self.train.axis_sr,
            distortion_percent: if beam.field_deg.abs() >= 90.0 {
                f64::NAN
            } else if ideal == 0.0 {
                0.0
            } else {
                100.0 * (height / ideal - 1.0)
            },
            projected_solid_angle_sr: solid_angle,
            opd_rms_waves: figure(&|s| s.opd_rms_pv().0),
            spot_rms_mm: figure(&PupilSamples::spot_rms_mm),
        }
    }

    fn psf(&self, window: &Window, method: PsfMethod) -> Result<Psf> {
        traced_psf(&self.beam, &self.outline, window, method, &|| self.beam.place())
    }
}

/// The PSF of a beam by a method; `place` names the field point.
///
/// # Errors
/// A wavefront too strong for diffraction where that is asked for; a window that no light reaches.
pub(super) fn traced_psf(
    beam: &impl Bundle,
    outline: &Outline,
    window: &Window,
    method: PsfMethod,
    place: &dyn Fn() -> String,
) -> Result<Psf> {
    let cells = match method {
        PsfMethod::Geometric => None,
        _ => psf::cells_across(beam, outline, window),
    };
    let psf = match (cells, method) {
        (Some(cells), _) => {
            let samples = PupilSamples::trace(beam, outline, cells);
            psf::diffraction(&samples, beam.train().nm, window)
        }
        (None, PsfMethod::Diffraction) => {
            return Err(Error::unsupported("the wavefront is too strong for a diffraction PSF")
                .at(place())
                .help("use the method auto or geometric, or a smaller window")
                .with_code(ErrorCode::PsfMethod));
        }
        (None, _) => psf::geometric(&PupilSamples::trace(beam, outline, GEOMETRIC_CELLS), window),
    };
    if !(psf.captured > 0.0) {
        let side_um = window.size as f64 * window.spacing_mm * 1e3;
        return Err(Error::input(format!("no light falls on the PSF's {side_um:.0} µm"))
            .at(place())
            .help(
                "the lens is out of focus there: give its wavelengths, the distance of PSF \
                 samples or a shift of the sensor",
            )
            .with_code(ErrorCode::PsfWindow));
    }
    Ok(psf)
}

/// A PSF of a characterisation.
struct Traced {
    point: FieldPoint,
    samples: Vec<f32>,
    captured: f64,
}

impl Probe for Traced {
    fn real_height_mm(&self) -> f64 {
        self.point.chief_ray_height_mm
    }
    fn samples(&self) -> &[f32] {
        &self.samples
    }
}

/// Traces the PSFs of a characterisation.
struct Tracer<'a> {
    system: &'a System,
    plan: &'a Plan,
    trains: &'a [AxisTrain],
    window: Window,
}

impl Tracer<'_> {
    /// The PSF and figures at a paraxial image height, mm, and the wavelength with this index.
    fn trace(&self, height_mm: f64, wavelength: usize) -> Result<Traced> {
        let Self { system, plan, trains, window } = self;
        let field_deg = system.field_of_paraxial_height(height_mm);
        let aimed = Aimed::new(system, &trains[wavelength], field_deg)?;
        let psf = aimed.psf(window, plan.method)?;
        // Rows rise away from the axis.
        let samples = samples_upright(&psf, window.size, [false, side(system) < 0.0]);
        let mut point = aimed.point(false);
        // Pictures are of the light that the sensor gets, in focus or not.
        let sensor_sr = aimed.beam.solid_angle_from_sensor(&aimed.outline);
        point.relative_illumination = sensor_sr / aimed.train.sensor_sr;
        Ok(Traced { point, samples, captured: psf.captured })
    }

    /// All that is traced at the stations, one by one, each wavelength in turn: what the choice of
    /// heights left out, in addition to what it traced at the probes.
    fn complete(
        &self,
        stations: Vec<Station<Traced>>,
        probes: &[usize],
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Vec<Traced>> {
        let bands = self.trains.len();
        let all = stations.len() * bands;
        let done = AtomicUsize::new(stations.len() * probes.len());
        let traced: Result<Vec<Vec<Traced>>> = stations
            .into_par_iter()
            .map(|station| {
                let mut probed = station.traced.into_iter();
                (0..bands)
                    .map(|w| match probes.contains(&w).then(|| probed.next()).flatten() {
                        Some(traced) => Ok(traced),
                        None => {
                            let traced = self.trace(station.height_mm, w)?;
                            progress(done.fetch_add(1, Ordering::Relaxed) + 1, all);
                            Ok(traced)
                        }
                    })
                    .collect()
            })
            .collect();
        Ok(traced?.into_iter().flatten().collect())
    }
}

/// Characterises a lens: figures and PSFs over image height and wavelength.
///
/// Heights are chosen by the PSFs at the first, middle and last wavelength. Then
/// `progress(done, total)` is called after each PSF, from any thread.
///
/// # Errors
/// Those of [`field_points`]; distortion that folds the image; a PSF window that no light reaches.
pub fn characterise(
    system: &System,
    plan: &Plan,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Characterisation> {
    if plan.heights < 2 || !(plan.max_field_deg > 0.0 && plan.max_field_deg < 90.0) {
        return Err(Error::input(format!(
            "{} heights up to a field of {}°",
            plan.heights, plan.max_field_deg
        ))
        .help(
            "give two heights or more and a largest field between 0 and 90 degrees: pictures are \
             of a plane in front of the lens",
        )
        .with_code(ErrorCode::LargestField));
    }
    let top = system.paraxial_height_mm(plan.max_field_deg);
    let even: Vec<f64> =
        (0..plan.heights).map(|i| top * i as f64 / (plan.heights - 1) as f64).collect();
    let trains = trains(system, &plan.wavelengths_nm)?;
    if trains.is_empty() {
        return Err(Error::input("no wavelength").help("give at least one, in nm"));
    }
    let spacing_um = match plan.psf_spacing_um {
        Some(spacing) => spacing,
        None => {
            let fields: Vec<f64> =
                even.iter().map(|&h| system.field_of_paraxial_height(h)).collect();
            spacing_for(system, &trains, &fields, plan.psf_size)?
        }
    };
    let window = Window { size: plan.psf_size, spacing_mm: spacing_um * 1e-3 };
    let tracer = Tracer { system, plan, trains: &trains, window };
    let last = trains.len() - 1;
    // The engine judges interpolation at the same three bands.
    let mut probes = vec![0, last / 2, last];
    probes.dedup();
    let (stations, between) = match &plan.density {
        Some(density) => {
            let trace = |height| probes.par_iter().map(|&w| tracer.trace(height, w)).collect();
            let window = (window.size, spacing_um);
            let (stations, between) = heights::choose(&even, density, window, trace)?;
            (stations, Some(between))
        }
        None => {
            probes.clear();
            let bare = |height_mm| Station { height_mm, traced: Vec::new() };
            (even.into_iter().map(bare).collect(), None)
        }
    };
    let heights: Vec<f64> = stations.iter().map(|s| s.height_mm).collect();
    let traced = tracer.complete(stations, &probes, progress)?;
    let (points, blocks): (Vec<FieldPoint>, Vec<(Vec<f32>, f64)>) =
        traced.into_iter().map(|t| (t.point, (t.samples, t.captured))).unzip();
    let mut grid = PsfGrid {
        heights_mm: heights.clone(),
        wavelengths_nm: plan.wavelengths_nm.clone(),
        size: window.size,
        spacing_um,
        data: blocks.iter().flat_map(|(samples, _)| samples).copied().collect(),
        captured: Some(blocks.iter().map(|(_, captured)| *captured).collect()),
        between,
    };
    grid.normalise()?;
    let axis = AxisTrain::new(system, system.prescription.reference_nm)?;
    let lens = Characterisation {
        name: system.prescription.name.clone(),
        source: format!("traced by camrig {}", env!("CARGO_PKG_VERSION")),
        efl_mm: system.paraxial.front_efl_mm().abs(),
        f_number: system.f_number(),
        magnification: system.paraxial.magnification.abs(),
        pupil_magnification: system.paraxial.pupil_magnification(),
        axis_solid_angle_sr: Some(axis.sensor_sr),
        stop_radius_mm: Some(system.stop_radius_mm),
        // Of light that comes from another medium, radiance over n² stays the same.
        transmittance: Spectrum::constant(system.paraxial.object_index.powi(2).recip()),
        wavelengths_nm: plan.wavelengths_nm.clone(),
        heights_mm: heights,
        real_height_mm: points.iter().map(|p| p.chief_ray_height_mm).collect(),
        relative_illumination: points.iter().map(|p| p.relative_illumination).collect(),
        chief_ray_angle_deg: Some(points.iter().map(|p| p.cra_deg).collect()),
        psf: grid,
    };
    lens.validate()?;
    Ok(lens)
}

/// The samples with columns and rows reversed where `turned` says so. With an even number of them,
/// one has no mirror image and keeps its place.
pub(super) fn samples_upright(psf: &Psf, size: usize, turned: [bool; 2]) -> Vec<f32> {
    let source = |i: usize, turned: bool| match turned {
        false => i,
        true => (2 * (size / 2) + size - i) % size,
    };
    let [columns, rows] = turned;
    (0..size)
        .flat_map(|i| (0..size).map(move |j| (i, j)))
        .map(|(i, j)| psf.data[source(i, rows) * size + source(j, columns)] as f32)
        .collect()
}

/// Distance between PSF samples, µm: the one at which the largest spot fits into the window, but
/// between λN/4 and λN/2 of the shortest wavelength (λN/2 is the Nyquist limit of an
/// aberration-free image).
fn spacing_for(system: &System, trains: &[AxisTrain], fields: &[f64], size: usize) -> Result<f64> {
    let (first, last) = (&trains[0], &trains[trains.len() - 1]);
    let mut reach = 0.0_f64;
    for deg in fields.iter().step_by((fields.len() / SPOT_FIELDS).max(1)) {
        for train in [first, last] {
            let aimed = Aimed::new(system, train, *deg)?;
            let probe = PupilSamples::trace(&aimed.beam, &aimed.outline, psf::PROBE_CELLS);
            let far = probe.rays.iter().map(|r| r.landing[0].abs().max(r.landing[1].abs()));
            reach = far.fold(reach, f64::max);
        }
    }
    Ok(spacing_um(reach, first.axis_sr, first.train.nm, size))
}

/// Distance between PSF samples, µm, for spots that reach as far as `reach_mm` from their chief
/// rays, with the pupil's solid angle, sr, and the shortest wavelength, nm.
pub(super) fn spacing_um(reach_mm: f64, pupil_sr: f64, nm: f64, size: usize) -> f64 {
    let slope = (pupil_sr / std::f64::consts::PI).sqrt();
    let nyquist_um = nm * 1e-3 / (4.0 * slope);
    let wanted = WINDOW_OVER_SPOT_RADIUS * 1e3 * reach_mm / size as f64;
    // Rounded to 0.01 µm, so that a lens file reads well.
    (wanted.clamp(0.5 * nyquist_um, nyquist_um) * 100.0).round().max(1.0) / 100.0
}

/// Where rays land on the image plane, (x, y) in mm. The chief ray comes first; `across` rays span
/// the pupil's diameter.
///
/// # Errors
/// A chief ray that is lost.
pub fn landing_places(
    system: &System,
    field_deg: f64,
    nm: f64,
    across: usize,
) -> Result<Vec<[f64; 2]>> {
    let train = system.at(nm)?;
    let beam = Beam::aim(&train, field_deg)?;
    let chief = [beam.chief.position[0][0], beam.chief.position[1][0]];
    let mut places = vec![chief];
    if across > 0 {
        let outline = beam.fine_outline()?;
        for ray in PupilSamples::trace(&beam, &outline, across).rays {
            places.push([chief[0] + ray.landing[0], chief[1] + ray.landing[1]]);
            places.push([chief[0] - ray.landing[0], chief[1] + ray.landing[1]]);
        }
    }
    Ok(places)
}
