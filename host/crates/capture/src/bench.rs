//! The virtual crosstalk bench: the experiment of Chen et al. 2009, section IV-C, simulated.
//!
//! No lens; parallel light through a narrow-band filter, as strong on the sensor at every tilt
//! (the beam is turned up by 1/cos θ); the sensor is turned so that the measured point sees the
//! light from where its chief ray would come. What a pixel makes of light from there is the
//! camera's hidden crosstalk table, which the fit (`camrig_measure::crosstalk`) is to find. Read
//! out are windows around the points, so one frame of the whole sensor serves all points of a
//! scan.

use super::take::{electrons_per_second, facts};
use camrig_base::output::OutputDir;
use camrig_base::{Bands, Error, Plane, RawFrame, Result};
use camrig_camera::{Camera, LensKind};
use camrig_captures::manifest::ManifestWriter;
use camrig_captures::{Capture, Light, Role, Rotation, Scan, Uniformity};
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_formats::{Facts, Format, Frames};
use camrig_render::SimulatedSensor;
use std::path::Path;

/// Wavelengths of the filters, nm.
pub const FILTERS_NM: [f64; 7] = [400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0];

/// Full width at half maximum of the filters, nm (Gaussian transmission).
pub const FILTER_WIDTH_NM: f64 = 10.0;

/// Columns and rows of the grid of points.
pub const GRID: (usize, usize) = (17, 13);

/// Points of an axis scan: ±30 steps and the centre.
const AXIS_POINTS: i32 = 61;

/// Side of the windows: the paper's 11 x 11 regions in whole periods of a Bayer pattern.
const WINDOW: usize = 12;

/// Mean signal at the centre as a fraction of saturation: little noise, and nothing saturates
/// where crosstalk brightens a channel.
const FILL: f64 = 0.5;

/// Half field for lenses whose focal length the camera file does not give, degrees: that of a
/// normal to moderately wide lens.
const DEFAULT_CORNER_DEG: f64 = 30.0;

/// A measured point.
struct Point {
    rotation: Rotation,
    id: String,
    left: usize,
    top: usize,
}

/// Simulates the experiment and writes a capture set of role `rotation`.
///
/// # Errors
/// A sensor smaller than a few windows, wavelengths at which it is blind, outputs that exist.
pub fn bench(
    camera: &Camera,
    frames: u32,
    exposure_s: f64,
    directory: &Path,
    force: bool,
    first_frame: u32,
    mut progress: impl FnMut(),
) -> Result<()> {
    let (width, height) = (camera.sensor.width as usize, camera.sensor.height as usize);
    let period = camera.sensor.cfa.width.max(camera.sensor.cfa.height);
    if width.min(height) < 4 * WINDOW || !WINDOW.is_multiple_of(period) {
        return Err(Error::input(format!("a sensor of {width} x {height} pixels"))
            .help("the bench reads windows of 12 x 12 pixels, whole periods of the pattern"));
    }
    let output = OutputDir::create(directory, force)?;
    let points = points(camera);
    let mut facts = facts(camera);
    (facts.width, facts.height) = (WINDOW, WINDOW);
    let mut manifest = ManifestWriter::new(facts, None, &camera.name);
    let mut number = first_frame;
    let mut shoot = |cube: &IrradianceCube, chosen: &[&Point]| -> Result<Vec<Vec<Plane<u16>>>> {
        let sensor = SimulatedSensor::new(camera, &cube.header)?;
        let mut stacks = vec![Vec::with_capacity(frames as usize); chosen.len()];
        let mut traps = camrig_render::Traps::default();
        for i in 0..frames {
            let settings = camera.settings(number, exposure_s, None);
            number = number.wrapping_add(1);
            let before = (i > 0).then_some(cube);
            let frame = sensor.frame_with(
                cube,
                &settings,
                camrig_render::FrameOptions {
                    before,
                    traps: Some(&mut traps),
                    ..camrig_render::FrameOptions::default()
                },
            )?;
            for (stack, p) in stacks.iter_mut().zip(chosen) {
                stack.push(window(&frame, p.left, p.top));
            }
            progress();
        }
        Ok(stacks)
    };
    let capture = |id: &str, role, light, rotation| Capture {
        analog_gain: camera.sensor.analog_gain,
        temperature_c: Some(camera.sensor.temperature_c),
        light,
        rotation,
        ..Capture::new(id, role, vec![format!("{id}.npy").into()], exposure_s)
    };
    let save = |id: &str, planes: Vec<Plane<u16>>| -> Result<()> {
        let facts = Facts { bits: Some(u32::from(camera.sensor.bits)), ..Facts::default() };
        output.write(format!("{id}.npy"), &Format::Npy.encode(&Frames { planes, facts })?)
    };
    let all: Vec<&Point> = points.iter().collect();
    for (p, stack) in points.iter().zip(shoot(&filtered(camera, 550.0, 0.0)?, &all)?) {
        let id = format!("dark-{}", p.id);
        save(&id, stack)?;
        manifest.push(&capture(&id, Role::Dark, None, Some(p.rotation)));
    }
    for nm in FILTERS_NM {
        let per_s = electrons_per_second(camera, nm, FILTER_WIDTH_NM);
        if per_s <= 0.0 {
            return Err(Error::disagreement(format!("the camera is blind at {nm} nm")));
        }
        let gain = camera.sensor.analog_gain;
        let irradiance = FILL * camera.sensor.saturation_e(gain) / (per_s * exposure_s);
        let cube = filtered(camera, nm, irradiance)?;
        // The scans are taken one after the other: each has its own temporal noise.
        for grid in [true, false] {
            let chosen: Vec<&Point> =
                points.iter().filter(|p| (p.rotation.scan == Scan::Grid) == grid).collect();
            for (p, stack) in chosen.iter().zip(shoot(&cube, &chosen)?) {
                let id = format!("{nm:.0}nm-{}", p.id);
                save(&id, stack)?;
                let light = Light {
                    irradiance_w_m2: Some(irradiance),
                    wavelength_nm: Some(nm),
                    uniformity: Uniformity::Flat,
                    ..Light::default()
                };
                manifest.push(&capture(&id, Role::Rotation, Some(light), Some(p.rotation)));
            }
        }
    }
    output.write("captures.toml", manifest.text()?.as_bytes())?;
    output.finish()
}

/// Frames that a bench of `frames` per point renders, for progress.
pub fn total_frames(frames: u32) -> u64 {
    u64::from(frames) * (1 + 2 * FILTERS_NM.len() as u64)
}

/// Light through a Gaussian filter, in sub-bands of half its width.
fn filtered(camera: &Camera, nm: f64, irradiance_w_m2: f64) -> Result<IrradianceCube> {
    let step = 0.5 * FILTER_WIDTH_NM;
    let shape: Vec<f64> = (-2..=2)
        .map(|k| {
            let u = f64::from(k) * step / FILTER_WIDTH_NM;
            libm::exp(-4.0 * std::f64::consts::LN_2 * u * u)
        })
        .collect();
    let sum: f64 = shape.iter().sum::<f64>() * step;
    let header = CubeHeader::new(
        (camera.sensor.width as usize, camera.sensor.height as usize),
        &Bands { start_nm: nm - 2.0 * step, step_nm: step, count: shape.len() },
        format!("parallel light through a filter at {nm} nm"),
    );
    let bands: Vec<f32> = shape.iter().map(|s| (irradiance_w_m2 * s / sum) as f32).collect();
    IrradianceCube::uniform(header, &bands)
}

fn points(camera: &Camera) -> Vec<Point> {
    let mut out = Vec::new();
    let even = |i: usize, n: usize| 2.0 * i as f64 / (n - 1) as f64 - 1.0;
    for j in 0..GRID.1 {
        for i in 0..GRID.0 {
            let (x, y) = (even(i, GRID.0), even(j, GRID.1));
            out.push(point(camera, x, y, Scan::Grid, format!("grid-{j:02}-{i:02}")));
        }
    }
    for k in 0..AXIS_POINTS {
        let u = even(k as usize, AXIS_POINTS as usize);
        for (scan, x, y, name) in [
            (Scan::Horizontal, u, 0.0, "horizontal"),
            (Scan::Vertical, 0.0, u, "vertical"),
            (Scan::Diagonal, u, u, "diagonal"),
            (Scan::Antidiagonal, u, -u, "antidiagonal"),
        ] {
            out.push(point(camera, x, y, scan, format!("{name}-{k:02}")));
        }
    }
    out
}

/// A point of the sensor near (x, y) in -1..1: moved so that its window fits on the sensor and
/// starts on a whole period of the pattern; and the chief ray there.
fn point(camera: &Camera, x: f64, y: f64, scan: Scan, id: String) -> Point {
    let s = &camera.sensor;
    let (width, height) = (f64::from(s.width), f64::from(s.height));
    let start = |u: f64, side: f64| {
        let free = side - WINDOW as f64;
        let start = (0.5 * (u + 1.0) * side - 0.5 * WINDOW as f64).clamp(0.0, free);
        // On whole periods of the pattern, so that every window starts with the same filter.
        let period = s.cfa.width.max(s.cfa.height);
        (start as usize / period * period).min(free as usize / period * period)
    };
    let (left, top) = (start(x, width), start(y, height));
    // Where the middle of the region of 11 x 11 pixels comes to lie.
    let middle = |start: usize, side: f64| 2.0 * (start as f64 + 5.5) / side - 1.0;
    let (x, y) = (middle(left, width), middle(top, height));
    let half_diagonal = 0.5e-3 * s.pitch_um * libm::hypot(width, height);
    let focal = match camera.lens.kind {
        LensKind::DiffractionLimited { focal_length_mm, .. } => focal_length_mm,
        _ => half_diagonal / libm::tan(DEFAULT_CORNER_DEG.to_radians()),
    };
    let tilt = |u: f64, side: f64| libm::atan(u * 0.5e-3 * s.pitch_um * side / focal).to_degrees();
    let rotation = Rotation {
        x,
        y,
        tilt_x_deg: tilt(x, width),
        tilt_y_deg: tilt(y, height),
        scan,
        window: true,
    };
    Point { rotation, id, left, top }
}

fn window(frame: &RawFrame, left: usize, top: usize) -> Plane<u16> {
    Plane::from_fn(WINDOW, WINDOW, |i, j| frame.data[(top + j) * frame.width + left + i])
}
