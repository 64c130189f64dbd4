//! Point-spread functions from the rays of a pupil.
//!
//! - Diffraction: every ray represents a plane wave of its own direction. The waves are summed
//!   with their phases on the image plane around the chief ray (Zemax calls this the Huygens PSF).
//!   [`direct`] computes that sum; [`diffraction`] computes it through a regular grid of
//!   directions: rays are spread onto the grid with a short kernel whose transform is divided out
//!   afterwards (non-uniform Fourier transform of type 1, Dutt and Rokhlin 1993; kernel of
//!   Barnett, Magland and af Klinteberg 2019), and two matrix products take the grid to the image,
//!   so that only the samples asked for are computed.
//! - Geometric: the power of the rays where they land.

use super::pupil::{Bundle, Extent, Outline};
use super::samples::PupilSamples;
use camrig_vector::vectorised;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// The samples on which a PSF is computed: `size` x `size`, the chief ray at sample `size / 2`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Samples per side.
    pub size: usize,
    /// Distance between samples, mm.
    pub spacing_mm: f64,
}

/// A PSF of unit sum (`size`², rows along +y) and the fraction of the light that falls in its
/// window.
#[derive(Clone, Debug, PartialEq)]
pub struct Psf {
    /// Samples, row-major.
    pub data: Vec<f64>,
    /// Fraction of the pupil's light inside the window.
    pub captured: f64,
}

/// Largest number of cells across the pupil. Tracing and summing grow with its square (a million
/// rays here); a wavefront that needs more blurs so far that geometric optics describes it.
const FINEST: usize = 1024;
/// Fewest cells across the pupil, whatever the wavefront: the rim is sharp, and the cells that it
/// crosses are weighted by their share inside.
const COARSEST: usize = 64;
/// Cells across the pupil when only the extent of the spot and of the cone of rays is wanted: a
/// coarse bound, which [`cells_across`] doubles.
pub const PROBE_CELLS: usize = 16;

/// Cells across the pupil that a diffraction PSF over `window` needs; `None` where that is too
/// many.
///
/// Sampled directions repeat the PSF at a distance λ/ΔM. The repeats stay clear of the window when
/// that distance exceeds half the window plus the radius of the spot; twice that sum is taken.
pub fn cells_across(beam: &impl Bundle, outline: &Outline, window: &Window) -> Option<usize> {
    let probe = PupilSamples::trace(beam, outline, PROBE_CELLS);
    let extent = |pick: &dyn Fn(&super::samples::Sample) -> f64| {
        probe
            .rays
            .iter()
            .map(pick)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
    };
    let reach = probe.rays.iter().map(|r| r.landing[0].abs().max(r.landing[1].abs()));
    let reach = reach.fold(0.0, f64::max);
    let (low, high) = extent(&|r| r.direction[1]);
    let (left, right) = extent(&|r| r.direction[0]);
    let wide = match outline.extent {
        Extent::MirrorHalf => 2.0 * right,
        Extent::Whole => right - left,
    };
    let range = (high - low).max(wide);
    let period = 2.0 * (0.5 * window.size as f64 * window.spacing_mm + reach);
    let cells = (range * period / (beam.train().nm * 1e-6)).ceil();
    (cells <= FINEST as f64).then(|| (cells as usize).max(COARSEST))
}

/// The diffraction PSF as a plain sum over rays and samples. Slow; the reference for
/// [`diffraction`].
#[must_use]
pub fn direct(samples: &PupilSamples, nm: f64, window: &Window) -> Psf {
    let Window { size, spacing_mm } = *window;
    let per_mm = 1e6 / nm;
    let mut field = vec![[0.0; 2]; size * size];
    for ray in &samples.rays {
        for (i, row) in field.chunks_exact_mut(size).enumerate() {
            let y = (i as f64 - (size / 2) as f64) * spacing_mm;
            for (j, value) in row.iter_mut().enumerate() {
                let x = (j as f64 - (size / 2) as f64) * spacing_mm;
                let along = ray.phase + per_mm * ray.direction[1] * y;
                let across = per_mm * ray.direction[0] * x;
                let (phase, amplitude) = match samples.extent {
                    // This ray and its mirror image.
                    Extent::MirrorHalf => (along, 2.0 * ray.amplitude * libm::cos(TAU * across)),
                    Extent::Whole => (along + across, ray.amplitude),
                };
                let (s, c) = libm::sincos(TAU * phase.fract());
                value[0] += amplitude * c;
                value[1] += amplitude * s;
            }
        }
    }
    normalised(field.iter().map(|[a, b]| a * a + b * b).collect(), samples, nm, window)
}

/// The diffraction PSF; equals [`direct`] within 1e-6 of the peak.
#[must_use]
pub fn diffraction(samples: &PupilSamples, nm: f64, window: &Window) -> Psf {
    let Window { size, spacing_mm } = *window;
    let kernel = Kernel::get();
    let copies = samples.extent.copies();
    // A direction cosine d advances by d·spacing/λ cycles per sample; the grid has 2·size nodes
    // per cycle, so that node k at sample j is the root of unity number k·j of 2·size.
    let turns = 2 * size;
    let scale = spacing_mm * 1e6 / nm * turns as f64;
    let nodes = |pick: &dyn Fn(&super::samples::Sample) -> f64| {
        let (low, high) = samples
            .rays
            .iter()
            .map(pick)
            .fold((0.0_f64, 0.0_f64), |(a, b), v| (a.min(v * scale), b.max(v * scale)));
        let first = low.floor() as i64 - WIDTH as i64;
        (first, (high.ceil() as i64 - first) as usize + WIDTH + 1)
    };
    let (first_l, count_l) = nodes(&|r| r.direction[0]);
    let (first_m, count_m) = nodes(&|r| r.direction[1]);
    let mut real = vec![0.0; count_l * count_m];
    let mut imaginary = vec![0.0; count_l * count_m];
    for ray in &samples.rays {
        let (l0, weights_l) = kernel.around(ray.direction[0] * scale);
        let (m0, weights_m) = kernel.around(ray.direction[1] * scale);
        let (s, c) = libm::sincos(TAU * ray.phase.fract());
        let (column, row) = ((l0 - first_l) as usize, (m0 - first_m) as usize);
        for (k, weight) in weights_m.iter().enumerate() {
            let (re, im) =
                (copies * ray.amplitude * weight * c, copies * ray.amplitude * weight * s);
            let start = (row + k) * count_l + column;
            for (i, w) in weights_l.iter().enumerate() {
                real[start + i] += re * w;
                imaginary[start + i] += im * w;
            }
        }
    }
    let roots: Vec<[f64; 2]> = (0..turns)
        .map(|k| {
            let (s, c) = libm::sincos(TAU * k as f64 / turns as f64);
            [c, s]
        })
        .collect();
    let root = |node: i64, sample: i64| roots[(node * sample).rem_euclid(turns as i64) as usize];
    // Along x: mirror pairs leave a cosine, and samples −j and j are equal.
    let half = size / 2 + 1;
    let (first_x, columns) = match samples.extent {
        Extent::MirrorHalf => (0, half),
        Extent::Whole => (-((size / 2) as i64), size),
    };
    let waves = |part: usize| -> Vec<f64> {
        (0..count_l)
            .flat_map(|k| (0..columns).map(move |j| (k, j)))
            .map(|(k, j)| root(first_l + k as i64, first_x + j as i64)[part])
            .collect()
    };
    let shape = [count_m, count_l, columns];
    let cosines = waves(0);
    let mut folded_re = product(&real, &cosines, shape);
    let mut folded_im = product(&imaginary, &cosines, shape);
    if samples.extent == Extent::Whole {
        let sines = waves(1);
        let add = |sums: &mut [f64], factor: f64, parts: Vec<f64>| {
            sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += factor * part);
        };
        add(&mut folded_re, -1.0, product(&imaginary, &sines, shape));
        add(&mut folded_im, 1.0, product(&real, &sines, shape));
    }
    let correction: Vec<f64> =
        (0..half).map(|j| kernel.transform(j as f64 / turns as f64)).collect();
    let mut waves_of_rows = Vec::with_capacity(size * count_m);
    for i in 0..size {
        let y = i as i64 - (size / 2) as i64;
        waves_of_rows.extend((0..count_m).map(|k| root(first_m + k as i64, y)));
    }
    let right = squared_field(&waves_of_rows, &folded_re, &folded_im, [size, count_m, columns]);
    let intensity = (0..size * size)
        .map(|k| {
            let (y, x) = ((k / size).abs_diff(size / 2), (k % size).abs_diff(size / 2));
            let c = correction[y] * correction[x];
            let column = match samples.extent {
                Extent::MirrorHalf => x,
                Extent::Whole => k % size,
            };
            right[k / size * columns + column] / (c * c)
        })
        .collect();
    normalised(intensity, samples, nm, window)
}

/// The geometric PSF: the power of each ray, shared bilinearly among the four samples around the
/// place where it lands.
#[must_use]
pub fn geometric(samples: &PupilSamples, window: &Window) -> Psf {
    let Window { size, spacing_mm } = *window;
    let mut data = vec![0.0; size * size];
    let mut add = |x: f64, y: f64, power: f64| {
        let (x, y) = (x / spacing_mm + (size / 2) as f64, y / spacing_mm + (size / 2) as f64);
        let (x0, y0) = (x.floor(), y.floor());
        let shares = [(0.0, 1.0 - (x - x0)), (1.0, x - x0)];
        let rows = [(0.0, 1.0 - (y - y0)), (1.0, y - y0)];
        for (dx, wx) in shares {
            for (dy, wy) in rows {
                let (i, j) = (y0 + dy, x0 + dx);
                let inside = |v: f64| v >= 0.0 && v < size as f64;
                if inside(i) && inside(j) {
                    data[i as usize * size + j as usize] += power * wx * wy;
                }
            }
        }
    };
    for ray in &samples.rays {
        add(ray.landing[0], ray.landing[1], ray.power);
        if samples.extent == Extent::MirrorHalf {
            add(-ray.landing[0], ray.landing[1], ray.power);
        }
    }
    let sum: f64 = data.iter().sum();
    let captured = sum / samples.power;
    scaled_to_unit_sum(data, sum, captured)
}

/// Unit sum; the captured fraction by Parseval's theorem, ∫|U|² dx dy = λ²·(power through the
/// pupil).
fn normalised(intensity: Vec<f64>, samples: &PupilSamples, nm: f64, window: &Window) -> Psf {
    let sum: f64 = intensity.iter().sum();
    let wavelength_mm = nm * 1e-6;
    let all = wavelength_mm * wavelength_mm * samples.power;
    let captured = sum * window.spacing_mm * window.spacing_mm / all;
    scaled_to_unit_sum(intensity, sum, captured)
}

fn scaled_to_unit_sum(mut data: Vec<f64>, sum: f64, captured: f64) -> Psf {
    if sum > 0.0 {
        data.iter_mut().for_each(|v| *v /= sum);
    }
    Psf { data, captured: captured.min(1.0) }
}

/// |Σ w·(re + i·im)|² of the rows x inner factors `waves` and the inner x columns matrices.
#[vectorised]
fn squared_field(
    waves: &[[f64; 2]],
    real: &[f64],
    imaginary: &[f64],
    [rows, inner, columns]: [usize; 3],
) -> Vec<f64> {
    let mut out = Vec::with_capacity(rows * columns);
    let (mut re, mut im) = (vec![0.0; columns], vec![0.0; columns]);
    for row in waves.chunks_exact(inner) {
        re.fill(0.0);
        im.fill(0.0);
        let lines = real.chunks_exact(columns).zip(imaginary.chunks_exact(columns));
        for ([c, s], (p, q)) in row.iter().zip(lines) {
            for ((a, b), (p, q)) in re.iter_mut().zip(&mut im).zip(p.iter().zip(q)) {
                *a += c * p - s * q;
                *b += c * q + s * p;
            }
        }
        out.extend(re.iter().zip(&im).map(|(a, b)| a * a + b * b));
    }
    out
}

/// Row-major matrix product of [rows x inner] and [inner x columns].
#[vectorised]
fn product(a: &[f64], b: &[f64], [rows, inner, columns]: [usize; 3]) -> Vec<f64> {
    let mut out = vec![0.0; rows * columns];
    for (line, a_row) in out.chunks_exact_mut(columns).zip(a.chunks_exact(inner)) {
        for (factor, b_row) in a_row.iter().zip(b.chunks_exact(columns)) {
            line.iter_mut().zip(b_row).for_each(|(o, v)| *o += factor * v);
        }
    }
    out
}

/// Grid nodes per axis over which a ray is spread.
const WIDTH: usize = 8;
/// Rows of the kernel's table per node distance: linear interpolation errs by 1.5e-7.
const FINE: usize = 1024;
/// Shape parameter β of the kernel over its width, for twofold oversampling (Barnett, Magland and
/// af Klinteberg 2019, SIAM J. Sci. Comput. 41, C479).
const BETA_PER_WIDTH: f64 = 2.3;

/// The spreading kernel exp(β(√(1 − (2t/w)²) − 1)), |t| ≤ w/2, tabulated; with twofold
/// oversampling and w = 8 its aliases are below 1e-7.
struct Kernel {
    table: Vec<[f64; WIDTH]>,
}

impl Kernel {
    fn value(t: f64) -> f64 {
        let z = 2.0 * t / WIDTH as f64;
        let inside = 1.0 - z * z;
        let beta = BETA_PER_WIDTH * WIDTH as f64;
        if inside <= 0.0 { 0.0 } else { libm::exp(beta * (inside.sqrt() - 1.0)) }
    }

    /// The table, computed once for the process.
    fn get() -> &'static Self {
        static KERNEL: OnceLock<Kernel> = OnceLock::new();
        KERNEL.get_or_init(Self::new)
    }

    fn new() -> Self {
        // Entry k of row r: distance to the k-th of the nodes around a place r/FINE above a node.
        let row = |r: usize| {
            std::array::from_fn(|k| {
                Self::value(r as f64 / FINE as f64 + (WIDTH / 2 - 1) as f64 - k as f64)
            })
        };
        Self { table: (0..=FINE).map(row).collect() }
    }

    /// The first of the nodes around `place`, and the weights of the [`WIDTH`] nodes from there.
    #[inline]
    fn around(&self, place: f64) -> (i64, [f64; WIDTH]) {
        let below = place.floor();
        let position = (place - below) * FINE as f64;
        let row = (position as usize).min(FINE - 1);
        let t = position - row as f64;
        let (a, b) = (&self.table[row], &self.table[row + 1]);
        let weights = std::array::from_fn(|k| a[k] + t * (b[k] - a[k]));
        (below as i64 - (WIDTH as i64 / 2 - 1), weights)
    }

    /// ∫ kernel(t)·cos(2πνt) dt by the trapezoid rule, which neglects only what the kernel's
    /// spectrum holds beyond 8 cycles per node distance.
    fn transform(&self, nu: f64) -> f64 {
        const STEPS: usize = 64;
        let step = WIDTH as f64 / STEPS as f64;
        let terms = (1..STEPS).map(|i| {
            let t = i as f64 * step - 0.5 * WIDTH as f64;
            Self::value(t) * libm::cos(TAU * nu * t)
        });
        step * terms.sum::<f64>()
    }
}
