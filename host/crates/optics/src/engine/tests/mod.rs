use super::*;
use crate::diffraction::{Diffraction, Illumination};
use camrig_base::{Bands, Spectrum};
use camrig_scene::{Grid, LitScene, Quantity, Scene};
use camrig_testing::shared;
use std::f64::consts::PI;

mod placement;
mod range;
mod revision;

/// A scene given by its exact cell averages in one or more bands.
struct Exact<F> {
    bands: Bands,
    average: F,
}

impl<F: Fn(&Grid, usize, usize) -> f64 + Send + Sync> Scene for Exact<F> {
    fn bands(&self) -> Bands {
        self.bands
    }
    fn quantity(&self) -> Quantity {
        Quantity::Radiance
    }
    fn aspect(&self) -> Option<f64> {
        None
    }
    fn plane(&self, _band: usize, grid: &Grid) -> camrig_base::Result<Plane<f32>> {
        Ok(Plane::from_fn(grid.width, grid.height, |x, y| (self.average)(grid, x, y) as f32))
    }
}

fn one_band(nm: f64) -> Bands {
    Bands { start_nm: nm, step_nm: 10.0, count: 1 }
}

fn perfect(f_number: f64) -> Diffraction {
    Diffraction {
        f_number,
        focal_length_mm: 4.0,
        magnification: 0.0,
        transmittance: Spectrum::constant(1.0),
        illumination: Illumination::Uniform,
        defocus_um: 0.0,
    }
}

fn render(
    scene: &dyn Scene,
    lens: &dyn Lens,
    grid: &SensorGrid,
    options: &Options,
) -> Vec<Plane<f32>> {
    let lit = LitScene { scene, white: vec![1.0; scene.bands().count] };
    let mut planes = Vec::new();
    irradiance(
        &lit,
        lens,
        grid,
        options,
        |_, _| {},
        |_, plane| {
            planes.push(plane);
            Ok(())
        },
    )
    .unwrap();
    planes
}

fn csv(path: &str) -> Option<Vec<Vec<f64>>> {
    let text = std::fs::read_to_string(shared(path)?).unwrap();
    Some(
        text.lines()
            .skip(1)
            .map(|l| l.split(',').map(|v| v.parse().unwrap_or(f64::NAN)).collect())
            .collect(),
    )
}

#[test]
fn otf_agrees_with_another_program() {
    let Some(rows) = csv("golden/isetcam/c_otf_diffraction_dlMTF.csv") else { return };
    for row in rows {
        let [f_number, nm, cutoff, f, otf] = row[..] else { panic!("{row:?}") };
        let lens = perfect(f_number);
        assert!((lens.cutoff_per_mm(nm) / cutoff - 1.0).abs() < 1e-6);
        assert!((lens.otf(nm, f) - otf).abs() < 1e-6, "{row:?}");
    }
}

#[test]
fn cos4_agrees_with_another_program() {
    let Some(rows) = csv("golden/isetcam/d_cos4th.csv") else { return };
    for row in rows {
        let mut lens = perfect(4.0);
        lens.illumination = Illumination::Cos4;
        lens.focal_length_mm = row[3] * 1e3;
        let ratio = lens.illumination(550.0).unwrap().at(row[6], 0.0);
        assert!((ratio - row[9]).abs() < 1e-6, "{row:?}: {ratio}");
    }
}

#[test]
fn irradiance_agrees_with_another_program() {
    // Radiance of the D65 scene of 100 cd/m² and its irradiance at f/4, m = -0.0033445, from the
    // same run; the other program loses 0.06 % to diffraction tails at its frame's edge.
    let Some(rows) = csv("golden/isetcam/a_scene_and_oi_spectrum_100cdm2_f4.csv") else { return };
    let lens = Diffraction { magnification: 0.0033445, ..perfect(4.0) };
    for row in rows {
        let ratio = lens.steradians(row[0]) * row[2] / row[4];
        assert!((ratio - 1.0).abs() < 1e-3, "{row:?}: {ratio}");
    }
    let Some(rows) = csv("golden/isetcam/b_illuminance_vs_distance_f4.csv") else { return };
    for row in rows {
        let lens = Diffraction { magnification: row[1].abs(), ..perfect(4.0) };
        let lux = 100.0 * lens.steradians(550.0);
        assert!((lux / row[2] - 1.0).abs() < 1e-3, "{row:?}: {lux}");
    }
    let Some(rows) = csv("golden/isetcam/b_irradiance_vs_luminance_fnumber.csv") else { return };
    for row in rows {
        let lens = Diffraction { magnification: 0.0033445, ..perfect(row[0]) };
        // That loss, 0.06 % at f/4, is proportional to λN.
        let lux = row[1] * lens.steradians(550.0) * (1.0 - 1.5e-4 * row[0]);
        assert!((lux / row[2] - 1.0).abs() < 1e-3, "{row:?}: {lux}");
    }
}

#[test]
fn uniform_scenes_come_out_as_equation_7_says() {
    let scene = Exact { bands: one_band(550.0), average: |_: &Grid, _, _| 2.0 };
    let mut lens = perfect(2.8);
    lens.magnification = 0.1;
    lens.transmittance = Spectrum::constant(0.8);
    let expected = PI * 2.0 * 0.8 / (1.0 + 4.0 * (2.8f64 * 1.1).powi(2));
    // Cells that resolve the light and such that do not; of a small frame, 1 % of it goes beyond.
    for (width, height, pitch_um, fill_factor) in [(50, 31, 2.2, 0.6), (4, 3, 6.0, 1.0)] {
        let grid = SensorGrid { width, height, pitch_um, fill_factor };
        let plane = &render(&scene, &lens, &grid, &Options::default())[0];
        for &e in &plane.data {
            assert!((f64::from(e) / expected - 1.0).abs() < 2e-6, "{e} instead of {expected}");
        }
    }
}

/// Overlap of the cell with a square of side `side` about the origin, as a fraction of the cell,
/// over side²: a point of unit flux.
fn point(side: f64) -> impl Fn(&Grid, usize, usize) -> f64 + Send + Sync {
    let overlap = move |from: f64, to: f64| (to.min(side / 2.0) - from.max(-side / 2.0)).max(0.0);
    move |g, x, y| {
        let (u, v) = (g.left + x as f64 * g.cell, g.top + y as f64 * g.cell);
        overlap(u, u + g.cell) * overlap(v, v + g.cell) / (g.cell * side).powi(2)
    }
}

#[test]
fn measured_otf_of_a_point_is_equation_4() {
    // Pixels of λN/2.5 sample the whole pass band. Of the tolerance of 0.5 % of full scale, the
    // frame of 512 of them takes 0.06 % on each of its four sides (2λN/(π³X) of the light falls
    // beyond X), and cells of λN/12.5 take (πhf)²/6 < 0.1 %: a point is the one scene that cell
    // averages cannot hold.
    for nm in [400.0, 550.0, 700.0] {
        let lens = perfect(4.0);
        let pitch_um = nm * 1e-3 * 4.0 / 2.5;
        let n = 512;
        let grid = SensorGrid { width: n, height: n, pitch_um, fill_factor: 1e-6 };
        let side = 1.0 / (64.0 * n as f64);
        let scene = Exact { bands: one_band(nm), average: point(side) };
        let plane =
            &render(&scene, &lens, &grid, &Options { oversample: Some(5), ..Options::default() })
                [0];
        // The line-spread function's transform along x; the point sits between four pixels.
        let lines: Vec<f64> = (0..n)
            .map(|x| (0..n).map(|y| f64::from(plane.at(x, y))).sum::<f64>() / (n * n) as f64)
            .collect();
        let centre = n as f64 / 2.0;
        let mut worst: f64 = 0.0;
        for k in 0..100 {
            let per_mm = lens.cutoff_per_mm(nm) * f64::from(k) / 99.0;
            let turns = per_mm * pitch_um * 1e-3;
            let measured: f64 = lines
                .iter()
                .enumerate()
                .map(|(x, v)| v * (2.0 * PI * turns * (x as f64 + 0.5 - centre)).cos())
                .sum();
            worst = worst.max((measured / lens.steradians(nm) - lens.otf(nm, per_mm)).abs());
        }
        println!("{nm} nm: worst {worst:.5}");
        assert!(worst < 0.005, "{nm} nm: {worst}");
    }
}

/// A lens whose PSF is one Gaussian, once as an OTF and once as a PSF table.
struct GaussianOtf {
    sigma_um: f64,
    table: bool,
}

impl Lens for GaussianOtf {
    fn steradians(&self, _nm: f64) -> f64 {
        1.0
    }
    fn illumination(&self, _nm: f64) -> Option<OverField<'_, f64>> {
        None
    }
    fn ideal_place(&self, _nm: f64) -> Option<OverField<'_, (f64, f64)>> {
        None
    }
    fn principal_distance_mm(&self) -> f64 {
        1.0
    }
    fn blur(&self, _nm: f64) -> Blur<'_> {
        let sigma = self.sigma_um;
        let cutoff_per_mm = 1.3e3 / sigma;
        if !self.table {
            let at = move |f: f64| libm::exp(-2.0 * (PI * f * sigma * 1e-3).powi(2));
            let (spread_um, at) = (5.0 * sigma, Box::new(at));
            return Blur::Otf(Otf { cutoff_per_mm, spread_um, tail_um: 0.0, at });
        }
        let (size, spacing_um) = (65, 0.2 * sigma);
        let value = |k: usize| {
            let (i, j) = ((k / size) as f64 - 32.0, (k % size) as f64 - 32.0);
            libm::exp(-0.02 * (i * i + j * j)) / (50.0 * PI)
        };
        let psf: Vec<f32> = (0..size * size).map(|k| value(k) as f32).collect();
        let psfs = psf::PsfField {
            stations: stations::Stations::Heights(vec![0.0]),
            size,
            spacing_um,
            psfs: vec![psf],
        };
        Blur::Field { psfs, cutoff_per_mm }
    }
}

#[test]
fn the_two_ways_to_blur_agree() {
    // A disc scene with its edges softened over a cell by exact averaging is not needed: a smooth
    // pattern has closed-form averages. cos(2πu·k) averaged over a cell is itself times a sinc.
    let waves = 17.0;
    let scene = Exact {
        bands: one_band(550.0),
        average: move |g: &Grid, x, y| {
            let (u, v) = (g.left + (x as f64 + 0.5) * g.cell, g.top + (y as f64 + 0.5) * g.cell);
            let damp = sampling::sinc(waves * g.cell);
            1.0 + 0.5 * damp * (2.0 * PI * waves * u).cos()
                + 0.3 * damp * (2.0 * PI * waves * v).sin()
        },
    };
    let grid = SensorGrid { width: 96, height: 80, pitch_um: 2.2, fill_factor: 0.7 };
    let (lens, sigma) = (|table| GaussianOtf { sigma_um: 1.4, table }, 1.4);
    for oversample in [1, 2, 3] {
        let options = Options { oversample: Some(oversample), ..Options::default() };
        let by_otf = &render(&scene, &lens(false), &grid, &options)[0];
        let by_psf = &render(&scene, &lens(true), &grid, &options)[0];
        let per_um = waves / (96.0 * 2.2);
        let passed = (-2.0 * (PI * per_um * sigma).powi(2)).exp()
            * sampling::sinc(per_um * grid.aperture_um());
        for y in 0..80 {
            for x in 0..96 {
                let u = (x as f64 + 0.5) / 96.0 - 0.5;
                let v = (y as f64 + 0.5 - 40.0) / 96.0;
                let exact = 1.0
                    + passed
                        * (0.5 * (2.0 * PI * waves * u).cos()
                            + 0.3 * (2.0 * PI * waves * v).sin());
                let (a, b) = (f64::from(by_otf.at(x, y)), f64::from(by_psf.at(x, y)));
                // The OTF route wraps a pattern that is not periodic in the padded frame: 5 sigma
                // of margin; one cell per pixel does not resolve this PSF, and a kernel without
                // negative entries is less sharp there. The PSF route adds the sample square (0.2
                // sigma) and cuts 1e-4 of the light; sharpening is sixth order in the cell.
                let tolerance = if oversample == 1 { 1e-2 } else { 1e-4 };
                assert!(
                    (a - exact).abs() < tolerance,
                    "s {oversample} ({x}, {y}): OTF {a}, exact {exact}"
                );
                let tolerance = if oversample == 1 { 3e-3 } else { 1e-3 };
                assert!(
                    (b - exact).abs() < tolerance,
                    "s {oversample} ({x}, {y}): PSF {b}, exact {exact}"
                );
            }
        }
    }
}

#[test]
fn no_light_is_lost_or_made_between_nodes() {
    // A characterised lens without fall-off or distortion; a patch well inside a black frame keeps
    // its light whatever the PSFs do, since each scatters its own cells' light.
    let mut lens = crate::Characterisation::example(33, 0.25);
    lens.relative_illumination.fill(1.0);
    lens.real_height_mm =
        lens.heights_mm.iter().flat_map(|&h| std::iter::repeat_n(h, 3)).collect();
    let scene = Exact {
        bands: one_band(500.0),
        average: |g: &Grid, x, y| {
            let (u, v) = (g.left + (x as f64 + 0.5) * g.cell, g.top + (y as f64 + 0.5) * g.cell);
            let wave = (1.0 + (40.0 * u).sin() * (31.0 * v).cos()) * 0.5;
            // A window that falls to 0 smoothly, so that cells resolve it.
            wave * (0.5 + 0.5 * (PI * (u / 0.4).clamp(-1.0, 1.0)).cos())
                * (0.5 + 0.5 * (PI * (v / 0.3).clamp(-1.0, 1.0)).cos())
        },
    };
    let grid = SensorGrid { width: 300, height: 240, pitch_um: 2.2, fill_factor: 1.0 };
    let blurred = &render(&scene, &lens, &grid, &Options::default())[0];
    let cells = Grid { width: 300, height: 240, left: -0.5, top: -0.4, cell: 1.0 / 300.0 };
    let sum = |plane: &Plane<f32>| plane.data.iter().map(|&v| f64::from(v)).sum::<f64>();
    let expected = sum(&scene.plane(0, &cells).unwrap()) * lens.steradians(500.0);
    let ratio = sum(blurred) / expected;
    assert!((ratio - 1.0).abs() < 1e-5, "{ratio}");
}

/// MTF50 in cycles/mm of an edge with slope 1 in 12 through the middle of a plane of 12 rows:
/// pixel (x, y) lies (12·x + y)/12·cos θ from the edge, so together the rows sample it evenly,
/// unbinned.
fn mtf50(plane: &Plane<f64>, pitch_um: f64) -> f64 {
    assert_eq!(plane.height, 12);
    let edge: Vec<f64> = (0..12 * plane.width).map(|k| plane.at(k / 12, k % 12)).collect();
    let line: Vec<f64> = edge.windows(2).map(|w| w[1] - w[0]).collect();
    let spacing = (1.0f64 / 12.0).atan().cos() / 12.0;
    let mtf = |per_pixel: f64| -> f64 {
        let step = 2.0 * PI * per_pixel * spacing;
        let (mut re, mut im) = (0.0, 0.0);
        for (i, v) in line.iter().enumerate() {
            re += v * (step * i as f64).cos();
            im += v * (step * i as f64).sin();
        }
        re.hypot(im) / (edge[edge.len() - 1] - edge[0]) / sampling::sinc(per_pixel * spacing)
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if mtf(middle) > 0.5 { low = middle } else { high = middle }
    }
    low / (pitch_um * 1e-3)
}

#[test]
fn slanted_edges_have_the_mtf50_of_theory() {
    // Photon-weighted diffraction OTF times pixel sinc, flat QE, D65, 400 to 700 nm in 50 nm
    // steps; figures and the 1 % from golden/README.md.
    let Some(light) = csv("golden/isetcam/ref_V_lambda_and_D65.csv") else { return };
    let angle = (1.0f64 / 12.0).atan();
    let bands = Bands { start_nm: 400.0, step_nm: 50.0, count: 7 };
    for (f_number, expected) in [
        (2.0, [263.44, 203.80, 119.76]),
        (4.0, [164.06, 145.47, 101.90]),
        (8.0, [88.43, 85.11, 72.74]),
    ] {
        for (pitch_um, expected) in [1.4, 2.2, 4.4].into_iter().zip(expected) {
            // Exact average of a half plane over a cell: a step, averaged along both sides.
            let average = move |g: &Grid, x: usize, y: usize| {
                let (u, v) =
                    (g.left + (x as f64 + 0.5) * g.cell, g.top + (y as f64 + 0.5) * g.cell);
                let d = u * angle.cos() + v * angle.sin();
                let (p, q) = (0.5 * g.cell * angle.cos(), 0.5 * g.cell * angle.sin());
                let ramp = |t: f64| 0.5 * t.max(0.0).powi(2);
                let area = ramp(d + p + q) - ramp(d + p - q) - ramp(d - p + q) + ramp(d - p - q);
                0.1 + 0.8 * area / (4.0 * p * q)
            };
            let scene = Exact { bands, average };
            let grid = SensorGrid { width: 256, height: 12, pitch_um, fill_factor: 1.0 };
            let planes = render(&scene, &perfect(f_number), &grid, &Options::default());
            let mut photons = Plane::filled(256, 12, 0.0f64);
            for (plane, nm) in planes.iter().zip(bands.centres()) {
                let row = light.iter().find(|r| r[0] == nm).unwrap();
                for (sum, e) in photons.data.iter_mut().zip(&plane.data) {
                    *sum += f64::from(*e) * row[2] * nm;
                }
            }
            let found = mtf50(&photons, pitch_um);
            println!("f/{f_number} {pitch_um} µm: {found:.2} cycles/mm, theory {expected}");
            assert!((found / expected - 1.0).abs() < 0.01, "f/{f_number} {pitch_um} µm: {found}");
        }
    }
}

/// 1 on one side of the line u = `edge`, exact averages.
fn half_plane(right_of: bool, edge: f64) -> impl Fn(&Grid, usize, usize) -> f64 + Send + Sync {
    move |g, x, _| {
        let u = g.left + x as f64 * g.cell;
        let left = ((edge - u) / g.cell).clamp(0.0, 1.0);
        if right_of { 1.0 - left } else { left }
    }
}

#[test]
fn nothing_wraps_around_to_the_opposite_border() {
    // Everything left of a line bright, the line at the frame's left border and a little inside or
    // outside of it; then everything right of one at the right border. What lies further from the
    // line than the margin is wide, which is what the kernel reaches, stays black; before its
    // kernel was finite, 7e-4 of the peak came round.
    let (width, height) = (90, 21);
    let grid = SensorGrid { width, height, pitch_um: 2.2, fill_factor: 0.7 };
    for table in [false, true] {
        let lens = &GaussianOtf { sigma_um: 1.4, table };
        for (oversample, offset) in [(1, 0.0), (2, 3.3), (3, -2.0), (2, -30.0)] {
            for right_of in [false, true] {
                let edge = if right_of { 0.5 - offset / 90.0 } else { offset / 90.0 - 0.5 };
                let scene = Exact { bands: one_band(550.0), average: half_plane(right_of, edge) };
                let options = Options { oversample: Some(oversample), ..Options::default() };
                let lit = LitScene { scene: &scene, white: vec![1.0] };
                let mut plane = Plane::filled(0, 0, 0.0);
                let report = irradiance(
                    &lit,
                    lens,
                    &grid,
                    &options,
                    |_, _| {},
                    |_, p| {
                        plane = p;
                        Ok(())
                    },
                );
                let peak = lens.steradians(550.0);
                let margin = report.unwrap().margin_pixels;
                let reach = offset.max(0.0).ceil() as usize + margin + 1;
                assert!(reach < width, "the test must look at something: {reach}");
                let far = if right_of { 0..width - reach } else { reach..width };
                let rows = plane.data.chunks_exact(width);
                let most =
                    rows.flat_map(|row| &row[far.clone()]).fold(0.0f32, |m, v| m.max(v.abs()));
                let most = f64::from(most) / peak;
                println!("s {oversample}, line {offset} pixels inside: {most:.1e} beyond {reach}");
                // f32 transforms: 2⁻²⁴ a few times.
                assert!(most < 5e-7, "s {oversample}, line {offset}: {most}");
            }
        }
    }
}

#[test]
fn light_far_from_an_edge_is_what_diffraction_spreads() {
    // Beside a bright half plane, at a distance d from its edge, the line-spread function's tail:
    // 1/2 − (1/π)∫OTF(f)·sinc(af)·sin(2πfd)/f df. An error of the tail is glare or a lack of it.
    let grid = SensorGrid { width: 400, height: 8, pitch_um: 5.2, fill_factor: 0.5 };
    let scene = Exact { bands: one_band(550.0), average: half_plane(false, 0.0) };
    for (f_number, defocus_um) in [(1.4, 0.0), (2.8, 0.0), (2.8, 60.0), (8.0, 0.0), (8.0, 200.0)] {
        let lens = Diffraction { defocus_um, ..perfect(f_number) };
        let plane = &render(&scene, &lens, &grid, &Options::default())[0];
        let cutoff = lens.cutoff_per_mm(550.0);
        let steps = 20_000;
        let table: Vec<(f64, f64)> = (0..steps)
            .map(|k| {
                let f = (f64::from(k) + 0.5) * cutoff / f64::from(steps);
                (f, lens.otf(550.0, f) * sampling::sinc(grid.aperture_um() * 1e-3 * f) / f)
            })
            .collect();
        let tail = |d_mm: f64| {
            let sum: f64 = table.iter().map(|(f, v)| v * (2.0 * PI * f * d_mm).sin()).sum();
            0.5 - sum / PI * cutoff / f64::from(steps)
        };
        // What cells cost the core, a tenth of the tail beyond 32 λN; and what lies further than
        // the frame is wide each way: outside a square, √2 of what lies beyond a line.
        let lambda_n_um = 0.55 * f_number;
        let tail_beyond = |x_um: f64| 2.0 * lambda_n_um / (PI.powi(3) * x_um);
        let bound = 0.1 * tail_beyond(32.0 * lambda_n_um)
            + 2.0f64.sqrt() * tail_beyond(400.0 * grid.pitch_um);
        for pixels in [5usize, 10, 20, 40, 80, 120, 160] {
            let theory = tail((pixels as f64 + 0.5) * grid.pitch_um * 1e-3);
            let found = f64::from(plane.at(200 + pixels, 4)) / lens.steradians(550.0);
            println!(
                "f/{f_number}, {defocus_um} µm, {pixels} pixels: {found:.6}, theory {theory:.6}"
            );
            assert!((found - theory).abs() < bound, "{found} instead of {theory}, bound {bound}");
        }
    }
}

/// A pixel of radiance 1e6 in the dark: the one in column `i` and row `j` of `grid`.
fn pixel_of_light(
    grid: &SensorGrid,
    i: f64,
    j: f64,
) -> impl Fn(&Grid, usize, usize) -> f64 + Send + Sync + use<> {
    let (width, height) = (grid.width as f64, grid.height as f64);
    let share = move |from: f64, cell: f64, at: f64| {
        ((from + cell).min((at + 1.0) / width) - from.max(at / width)).max(0.0) / cell
    };
    move |g, x, y| {
        let u = g.left + 0.5 + x as f64 * g.cell;
        let v = g.top + 0.5 * height / width + y as f64 * g.cell;
        1e6 * share(u, g.cell, i) * share(v, g.cell, j)
    }
}

#[test]
fn wings_of_a_lamp_are_the_tail_wherever_it_is() {
    // At nine places, in steps of 5 and 11 pixels. The closed form is λN/(π³r³) per area, the
    // mean over the rings of Airy; over the squares of lamp and pixel, of variance 1/12 each way,
    // the mean is 9/12·r⁻² of that more, r in pixels.
    let grid = SensorGrid { width: 500, height: 401, pitch_um: 2.2, fill_factor: 1.0 };
    // Octaves of distance, from half of the core on.
    const OCTAVES: usize = 6;
    for f_number in [1.0, 1.4, 2.8, 4.0, 10.0] {
        let lens = perfect(f_number);
        let lambda_n = 0.55 * f_number / grid.pitch_um;
        let core = (32.0 * lambda_n).max(8.0);
        let (mut found, mut theory, mut worst) = ([0.0f64; OCTAVES], [0.0f64; OCTAVES], 0.0f64);
        for (i, j) in (0..9).map(|k| ([245.0, 250.0, 256.0][k % 3], [195.0, 200.0, 206.0][k / 3]))
        {
            let scene = Exact { bands: one_band(550.0), average: pixel_of_light(&grid, i, j) };
            let plane = &render(&scene, &lens, &grid, &Options::default())[0];
            for (k, e) in plane.data.iter().enumerate() {
                let r = libm::hypot((k % 500) as f64 - i, (k / 500) as f64 - j);
                let light = f64::from(*e) / lens.steradians(550.0);
                let tail = 1e6 * lambda_n / (PI * r).powi(3) * (1.0 + 0.75 / (r * r));
                if r > 0.5 * core && r < 190.0 {
                    let octave = libm::log2(2.0 * r / core) as usize;
                    found[octave] += light;
                    theory[octave] += tail;
                }
                // The core is blurred within a square of 4 pixels more on each side.
                if r > 2.0f64.sqrt() * (core + 5.0) {
                    worst = worst.max((light / tail - 1.0).abs());
                }
            }
        }
        let octaves = found.iter().zip(&theory).filter(|(_, theory)| **theory > 0.0);
        let mean = octaves.fold(0.0f64, |m, (found, theory)| m.max((found / theory - 1.0).abs()));
        println!(
            "f/{f_number}: {:.2} % of a pixel, {:.2} % of an octave",
            1e2 * worst,
            1e2 * mean
        );
        assert!(worst < 0.01 && mean < 0.01, "f/{f_number}: {worst}, {mean}");
    }
}
