//! Light that diffraction spreads far: the tail of a point-spread function, ring by ring.
//!
//! Where the OTF falls from frequency 0 as 1 − t·f, the point-spread function falls as
//! t/(4π²r³) ([`Otf::tail_um`]). That is a sum of Gaussians of all widths σ,
//! ∫ C/σ²·G(r, σ) dσ with C = t/(π√(2π)). Those wider than σ₀ make
//!
//! - a point-spread function t/(4π²r³)·S(r/σ₀), all of the tail but 0.1 % from 4 σ₀ on,
//!   and smooth within: S(x) = erf(x/√2) − x·√(2/π)·e^(−x²/2);
//! - an OTF C/σ₀·(e^(−y²) − √π·y·erfc(y)), y = √2·π·σ₀·f.
//!
//! What is left of the lens's OTF, the core, ends at 4 σ₀ and is blurred on fine cells. The wide
//! part is taken apart at σ₀, 4 σ₀, 16 σ₀ ..., each ring on square pixels of some σ/2 a
//! side: every two octaves of distance have pixels of their own, and far ones cost next to nothing.
//! The last ring ends with the longer side of the frame; the light beyond stays with the core, so
//! that the whole is 1.
//!
//! **Place.** Light is brought to a ring's pixels, and from these to the sensor's, by cubic
//! convolution with the parameter −1/2 (Catmull-Rom; Keys 1981, IEEE Trans. ASSP 29, 1153),
//! which keeps its sum, centroid and second moments: where a lamp lies in a large pixel does not
//! matter. A ring takes it from the pixels of the one before, and beyond these from cells of the
//! same size.
//!
//! **Limits.** Beyond the core, the light of a pixel anywhere in the frame is that of the closed
//! form to 1 %. In the core, from half its reach on, that holds of the mean around the place;
//! single pixels show the rings of Airy. A lamp outside the frame, farther than the ring before
//! reaches, counts as in the middle of a cell of σ/8 at a distance of 4 σ or more: up to 5 %.
//! Where 4 σ₀ is more than 128 pixels, cells of some pixels stand for the scene: up to 2 %.

use super::fourier::Kernel;
use super::sampling::{Cells, Layout};
use super::source::Source;
use super::{Otf, SensorGrid};
use camrig_base::{Plane, Result};
use camrig_vector::vectorised;
use rayon::prelude::*;
use std::f64::consts::{FRAC_2_SQRT_PI, PI, SQRT_2};
use std::ops::{AddAssign, Mul};

/// Distance, in widths σ of the narrowest of some Gaussians, beyond which they are all of the
/// tail: 1 − S(4) = 0.1 %.
const REACH: f64 = 4.0;
/// Widest over narrowest Gaussian of a ring: two octaves, a trade of the number of rings against
/// their reach.
const RING: usize = 4;
/// Narrowest Gaussian over the side of the pixels that hold it, a trade of time against error: at
/// their Nyquist frequency e^(−π²/2·4) = 3e-9 of it passes, and cubic convolution, whose error
/// falls as the third power, costs 0.6 % of the tail at worst
/// (`wings_of_a_lamp_are_the_tail_wherever_it_is`).
const PIXELS: f64 = 2.0;
/// Narrowest Gaussian over the side of the cells that stand for the scene, where these are larger
/// than the sensor's pixels.
const CELLS: f64 = 16.0;
/// Pixels that cubic convolution reaches on each side.
const APRON: usize = 2;

/// How the tail of OTFs is computed.
pub struct Wide {
    /// Distance within which the core's light falls, µm.
    pub reach_um: f64,
    /// The rings, the nearest first; none without a tail.
    pub rings: Vec<Ring>,
    /// σ₀, mm.
    from_mm: f64,
    /// Share of the light beyond the last ring over the tail's length, per µm.
    lost_per_um: f64,
}

/// One ring.
pub struct Ring {
    /// The frame with an apron of [`APRON`], in the ring's pixels.
    pub grid: SensorGrid,
    /// Its padded frame.
    pub layout: Layout,
    /// The cells that its light comes from.
    pub cells: Cells,
    /// Side of its pixels in the sensor's.
    side: usize,
    /// Side of its pixels in cells.
    ratio: usize,
    /// Of a tail of 1 µm.
    kernel: Kernel,
}

impl Wide {
    /// For OTFs of some bands; `sensor` is their sensor.
    pub fn new(sensor: &SensorGrid, otfs: &[&Otf<'_>]) -> Self {
        let spread_um = otfs.iter().fold(0.0f64, |m, otf| m.max(otf.spread_um));
        if otfs.iter().all(|otf| otf.tail_um == 0.0) {
            return Self {
                reach_um: spread_um,
                rings: Vec::new(),
                from_mm: 0.0,
                lost_per_um: 0.0,
            };
        }
        // Pixels of the first ring are the sensor's or larger.
        let narrowest = (spread_um / (REACH * sensor.pitch_um)).max(PIXELS);
        let cell = ((narrowest / CELLS) as usize).max(1);
        let side = (narrowest / (PIXELS * cell as f64)) as usize * cell;
        let longest = sensor.width.max(sensor.height) as f64;
        let mut rings = Vec::new();
        let (mut from, mut cell, mut side) = (narrowest, cell, side);
        loop {
            let to = RING as f64 * from;
            let ring = |to, reach| Ring::new(sensor, (from, to), reach, side, cell);
            if REACH * to >= longest {
                rings.push(ring(f64::INFINITY, longest));
                break;
            }
            rings.push(ring(to, REACH * to));
            (from, cell, side) = (to, side, RING * side);
        }
        let from_mm = 1e-3 * narrowest * sensor.pitch_um;
        let kept: f64 = rings.iter().map(|ring| ring.kernel.light(&ring.layout)).sum();
        let lost_per_um = 1e-3 * wide_otf(from_mm, 0.0) - kept;
        Self { reach_um: REACH * 1e3 * from_mm, rings, from_mm, lost_per_um }
    }

    /// The OTF of what the rings carry of a tail, and what lies beyond them.
    pub fn far(&self, otf: &Otf<'_>) -> impl Fn(f64) -> f64 + Send + Sync + use<> {
        let (from_mm, tail_mm) = (self.from_mm, 1e-3 * otf.tail_um);
        move |f| if tail_mm == 0.0 { 0.0 } else { tail_mm * wide_otf(from_mm, f) }
    }

    /// The rest, with the light that no ring carries.
    pub fn core<'a>(&self, otf: &'a Otf<'_>) -> Otf<'a> {
        let (far, whole) = (self.far(otf), 1.0 + self.lost_per_um * otf.tail_um);
        Otf {
            cutoff_per_mm: otf.cutoff_per_mm,
            spread_um: self.reach_um,
            tail_um: 0.0,
            at: Box::new(move |f| whole * (otf.at)(f) - far(f)),
        }
    }

    /// Margin rendered around the frame, in the sensor's pixels.
    pub fn margin_pixels(&self) -> usize {
        self.rings.iter().map(Ring::margin_pixels).max().unwrap_or(0)
    }

    /// The light on the pixels of every ring, from the scene on the cells of each.
    ///
    /// # Errors
    /// Those of the scene.
    pub fn light<'a>(
        &self,
        source: impl Fn(usize, &Cells) -> Source<'a>,
    ) -> Result<Vec<Plane<f32>>> {
        let mut all: Vec<Plane<f32>> = Vec::new();
        for (k, ring) in self.rings.iter().enumerate() {
            let mut cells = source(k, &ring.cells).plane()?;
            if let Some((near, light)) = self.rings[..k].last().zip(all.last()) {
                near.replace(&mut cells, light, &ring.cells);
            }
            all.push(ring.gathered(&cells));
        }
        Ok(all)
    }
}

/// The OTF of the Gaussians wider than `from_mm` of a tail of 1 mm, over frequency in cycles/mm.
fn wide_otf(from_mm: f64, f: f64) -> f64 {
    let y = SQRT_2 * PI * from_mm * f;
    let bell = libm::exp(-y * y) - PI.sqrt() * y * libm::erfc(y);
    bell / (PI * (2.0 * PI).sqrt() * from_mm)
}

/// The point-spread function of the Gaussians wider than `from` of a tail of 1, all in one unit.
fn wide_psf(from: f64, r: f64) -> f64 {
    let x = r / (SQRT_2 * from);
    match r > 0.0 {
        true => {
            let share = libm::erf(x) - FRAC_2_SQRT_PI * x * libm::exp(-x * x);
            share / (4.0 * PI * PI * r * r * r)
        }
        false => 1.0 / (6.0 * PI * PI * (2.0 * PI).sqrt() * from * from * from),
    }
}

impl Ring {
    /// Of the Gaussians of widths from .. to; these, `reach` and `side` and `cell`, the sides of
    /// its pixels and cells, are in pixels of the sensor.
    fn new(
        sensor: &SensorGrid,
        (from, to): (f64, f64),
        reach: f64,
        side: usize,
        cell: usize,
    ) -> Self {
        let (across, down) = (sensor.width.div_ceil(side), sensor.height.div_ceil(side));
        let grid = SensorGrid {
            width: across + 2 * APRON,
            height: down + 2 * APRON,
            pitch_um: sensor.pitch_um * side as f64,
            fill_factor: 1.0,
        };
        let layout = Layout::new(&grid, 1, reach * sensor.pitch_um);
        let (beyond, ratio) = (layout.margin + 2 * APRON, side / cell);
        let frame = (sensor.width.div_ceil(cell), sensor.height.div_ceil(cell));
        let all = ((across + 2 * beyond) * ratio, (down + 2 * beyond) * ratio);
        let cells = Cells::coarse(sensor, cell, frame, beyond * ratio, all);
        let density = |i: usize, j: usize| {
            let r_um = grid.pitch_um * libm::hypot(i as f64, j as f64);
            let of = |from: f64| wide_psf(from * sensor.pitch_um, r_um);
            (of(from) - of(to)) * grid.pitch_um * grid.pitch_um
        };
        let row = |j: usize| (0..=layout.margin).map(|i| density(i, j)).collect();
        let kernel = Kernel::new((0..=layout.margin).map(row).collect());
        Self { grid, layout, cells, side, ratio, kernel }
    }

    /// What a pixel receives of a tail from the pixels around it.
    pub fn kernel(&self, tail_um: f64) -> Kernel {
        Kernel::sum(&[(tail_um, &self.kernel)])
    }

    fn margin_pixels(&self) -> usize {
        (self.layout.margin + 2 * APRON) * self.side
    }

    /// Pixels between the left or upper edge of its light and that of the frame.
    fn before(&self) -> usize {
        self.layout.margin + 3 * APRON
    }

    /// The light of cells on the ring's pixels, as far as any reaches.
    fn gathered(&self, cells: &Plane<f32>) -> Plane<f32> {
        let n = self.ratio;
        // Cells between a pixel's first and the first that it takes light of.
        let first = APRON * n + 3 * n / 2;
        let weights: Vec<f32> = (0..2 * APRON * n)
            .map(|i| (i as f64 + 0.5 - (3 * n / 2) as f64) / n as f64 - 0.5)
            .map(|place| (cubic(place) / n as f64) as f32)
            .collect();
        let taps = |pixel: usize| {
            let cell = move |(i, weight): (usize, f32)| {
                Some(((pixel * n + i).checked_sub(first)?, weight))
            };
            weights.iter().copied().enumerate().filter_map(cell)
        };
        let (across, down) = (cells.width / n + 2 * APRON, cells.height / n + 2 * APRON);
        let mut light = Plane::filled(across, down, 0.0);
        light.data.par_chunks_mut(across).enumerate().for_each_init(
            || vec![0.0; cells.width],
            |sum, (pixel, row)| {
                sum.fill(0.0);
                for (cell, weight) in taps(pixel).filter(|(cell, _)| *cell < cells.height) {
                    add_row(sum, weight, cells.row(cell));
                }
                for (pixel, value) in row.iter_mut().enumerate() {
                    let light = |(cell, weight)| weight * sum.get(cell).copied().unwrap_or(0.0);
                    *value = taps(pixel).map(light).sum();
                }
            },
        );
        light
    }

    /// Puts this ring's light in place of what a next one's cells, of the size of its pixels, hold
    /// of the same part of the scene.
    fn replace(&self, cells: &mut Plane<f32>, light: &Plane<f32>, next: &Cells) {
        let (left, top) = (next.left - self.before(), next.top - self.before());
        let own = |i: usize, n: usize| (APRON..n - APRON).contains(&i);
        for y in 0..light.height {
            let row = &mut cells.row_mut(top + y)[left..left + light.width];
            for (x, (cell, value)) in row.iter_mut().zip(light.row(y)).enumerate() {
                let inside = own(x, light.width) && own(y, light.height);
                *cell = if inside { *value } else { *cell + value };
            }
        }
    }

    /// Rows of its light on its padded frame; 0 beyond what was gathered.
    pub fn rows<'a>(
        &self,
        light: &'a Plane<f32>,
    ) -> impl Fn(usize, usize) -> Result<Plane<f32>> + Sync + use<'a> {
        let Layout { padded_width, .. } = self.layout;
        let before = self.before() - APRON;
        let place = move |i: usize, margin: usize| (i + before).checked_sub(margin);
        let (left, top) = (self.layout.left(), self.layout.top());
        move |first, count| {
            Ok(Plane::from_fn(padded_width, count, |x, y| {
                let at = place(x, left).zip(place(first + y, top));
                let within = at.filter(|(x, y)| *x < light.width && *y < light.height);
                within.map_or(0.0, |(x, y)| light.at(x, y))
            }))
        }
    }

    /// Adds a plane of its pixels to one of the sensor's.
    pub fn add_to<T>(&self, sum: &mut Plane<T>, far: &Plane<T>)
    where
        T: Copy + Send + Sync + From<f32> + Mul<Output = T> + AddAssign,
    {
        let across = taps(sum.width, self.side);
        let down = taps(sum.height, self.side);
        let rows = sum.data.par_chunks_mut(sum.width).zip(down);
        rows.for_each_init(
            || vec![T::from(0.0); far.width],
            |between, (row, taps)| {
                between.fill(T::from(0.0));
                for (j, weight) in taps {
                    let line = &far.data[j * far.width..][..far.width];
                    let weight = T::from(weight);
                    between.iter_mut().zip(line).for_each(|(b, v)| *b += weight * *v);
                }
                for (value, taps) in row.iter_mut().zip(&across) {
                    taps.iter().for_each(|&(i, weight)| *value += T::from(weight) * between[i]);
                }
            },
        );
    }
}

/// sum += weight · row.
#[vectorised]
fn add_row(sum: &mut [f32], weight: f32, row: &[f32]) {
    sum.iter_mut().zip(row).for_each(|(sum, v)| *sum += weight * v);
}

/// The kernel of cubic convolution at a distance in pixels.
fn cubic(distance: f64) -> f64 {
    let x = distance.abs();
    match x {
        _ if x < 1.0 => (1.5 * x - 2.5) * x * x + 1.0,
        _ if x < 2.0 => ((2.5 - 0.5 * x) * x - 4.0) * x + 2.0,
        _ => 0.0,
    }
}

/// For each of `fine` pixels, the larger pixels along an axis, from the apron on, that it is
/// interpolated from, and their weights.
fn taps(fine: usize, side: usize) -> Vec<[(usize, f32); 4]> {
    let at = |k: usize| {
        let place = (k as f64 + 0.5) / side as f64 - 0.5 + APRON as f64;
        let first = place as usize - 1;
        std::array::from_fn(|n| (first + n, cubic(place - (first + n) as f64) as f32))
    };
    (0..fine).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_keeps_quadratic_polynomials() {
        for (fine, side) in [(203usize, 16usize), (64, 8), (31, 4), (9, 2), (7, 1)] {
            let x = |i: usize| (i as f64 + 0.5 - APRON as f64) * side as f64;
            for (k, taps) in taps(fine, side).iter().enumerate() {
                let at = k as f64 + 0.5;
                let square: f64 = taps.iter().map(|&(i, w)| f64::from(w) * x(i) * x(i)).sum();
                assert!((square - at * at).abs() < 1e-5 * x(taps[3].0).powi(2), "{side}, {k}");
            }
        }
    }

    #[test]
    fn gathered_light_keeps_sum_centroid_and_second_moment() {
        let sensor = SensorGrid { width: 37, height: 23, pitch_um: 2.0, fill_factor: 1.0 };
        for (side, cell) in [(1, 1), (5, 1), (4, 2), (16, 4)] {
            let ring = Ring::new(&sensor, (2.0 * side as f64, f64::INFINITY), 37.0, side, cell);
            let n = side / cell;
            for lamp in [0, 3, 11] {
                let (x, y) = (ring.cells.left + lamp, ring.cells.top + lamp / 2);
                let mut cells = Plane::filled(ring.cells.across, ring.cells.down, 0.0f32);
                cells.row_mut(y)[x] = 1.0;
                let light = ring.gathered(&cells);
                // Places in cells from the frame's corner.
                let place = |i: usize| ((i as f64 + 0.5) - ring.before() as f64) * n as f64;
                let moment = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
                    let of = |(k, v): (usize, &f32)| {
                        f64::from(*v) * f(place(k % light.width), place(k / light.width))
                    };
                    light.data.iter().enumerate().map(of).sum::<f64>() * (n * n) as f64
                };
                let at = lamp as f64 + 0.5;
                let found = [moment(&|_, _| 1.0), moment(&|x, _| x), moment(&|x, _| x * x)];
                for (found, right) in found.iter().zip([1.0, at, at * at]) {
                    assert!((found - right).abs() < 1e-4 * (n * n) as f64, "{side}, {lamp}");
                }
            }
        }
    }

    #[test]
    fn rings_and_core_together_are_the_whole_of_the_otf() {
        // The transform of the wide part's point-spread function, as an integral over r, is its
        // OTF: 2π∫ p(r)·J0(2πfr)·r dr.
        let (from, steps, end) = (0.8, 200_000, 4000.0);
        for f in [0.01, 0.1, 0.3] {
            let term = |k: usize| {
                let r = (k as f64 + 0.5) * end / steps as f64;
                2.0 * PI * wide_psf(from, r) * libm::j0(2.0 * PI * f * r) * r
            };
            let sum = (0..steps).map(term).sum::<f64>() * end / steps as f64;
            // 1/(2πR) of the tail lies beyond R, and J0 there is below 0.07.
            assert!((sum - wide_otf(from, f)).abs() < 1e-5, "{f}: {sum}");
        }
        let otf = Otf {
            cutoff_per_mm: 1000.0,
            spread_um: 30.0,
            tail_um: 1.3,
            at: Box::new(|f| 1.0 - 1e-3 * f),
        };
        let sensor = SensorGrid { width: 300, height: 200, pitch_um: 2.0, fill_factor: 1.0 };
        let wide = Wide::new(&sensor, &[&otf]);
        assert_eq!(wide.rings.len(), 3);
        let rings = wide.rings.iter().map(|ring| ring.kernel(1.3).light(&ring.layout));
        let total = (wide.core(&otf).at)(0.0) + rings.sum::<f64>();
        assert!((total - 1.0).abs() < 1e-14, "{total}");
    }
}
