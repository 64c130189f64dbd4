//! From spectral irradiance to mean photo-electrons (eq. 8 and 9 of Chen et al. 2009).
//!
//! µ(x, y) = t Σ_b E_b(x, y) R_c,b F_c,b(x, y): exposure time t, irradiance E_b of band b,
//! response R of the pixel's channel c ([`SensorConfig::response`]) and positional crosstalk
//! factor F. Bands are added in their order, so a device can receive and discard them one by one;
//! it keeps one row of sums.

use crate::arith::Arith;
use crate::config::{ConfigError, FrameSettings, MAX_PATTERN, SensorConfig};
use crate::crosstalk::{Crosstalk, MAX_NODES, place};
use crate::spectral::{BandRow, GROUP, is_wide, plain, power_of_two};
use core::array::{from_mut, from_ref};
use core::borrow::Borrow;

/// Sums of a group of pixels that share an exponent.
pub type Sums<S> = [S; GROUP];

/// Largest number of alignments of a colour filter pattern with a group of 16: patterns of 3, 5 and
/// 6 columns shift from group to group.
const PHASES: usize = if cfg!(feature = "multispectral") { 5 } else { 3 };

/// What a collector knows of a sensor in a frame.
#[derive(Clone, Debug)]
pub struct Exposed<'a> {
    config: &'a SensorConfig,
    crosstalk: Option<Crosstalk<'a>>,
    /// Positions of the nodes in pixels from the left edge of column 0; one node without a table.
    nodes: heapless::Vec<f32, MAX_NODES>,
    /// Response x exposure = weight x 2^scale, weights at most 1.
    scale: i32,
    per_unit: f32,
}

/// Sums the bands of the rows of one frame.
pub struct Collector<'a, A: Arith> {
    of: Exposed<'a>,
    /// Weights at each node for the current band and row.
    weights: [[Sums<A::Weight>; PHASES]; MAX_NODES],
}

/// Adds a group with weights x 2^scale to its sums.
#[inline(always)]
fn add<A: Arith>(
    sums: &mut Sums<A::Sum>,
    (exponent, mantissas): (i8, &[u16; GROUP]),
    scale: i32,
    weights: &Sums<A::Weight>,
) {
    if is_wide(exponent) {
        add_wide::<A>(sums, (exponent, *mantissas), scale, *weights);
    } else {
        A::accumulate(sums, mantissas, i32::from(exponent) + scale, weights);
    }
}

/// [`add`] of a group of high dynamic range: rare, and kept off the path of the others, whose
/// weights stay in registers as these are passed by value.
#[cold]
#[inline(never)]
fn add_wide<A: Arith>(
    sums: &mut Sums<A::Sum>,
    (exponent, mantissas): (i8, [u16; GROUP]),
    scale: i32,
    weights: Sums<A::Weight>,
) {
    for ((sum, mantissa), weight) in sums.iter_mut().zip(mantissas).zip(&weights) {
        let (mantissa, exponent) = plain(exponent, mantissa);
        A::accumulate(from_mut(sum), &[mantissa], exponent + scale, from_ref(weight));
    }
}

/// The exponent for which `largest` x 2^-exponent is at most 1.
#[inline(always)]
fn scale_of(largest: f32) -> i32 {
    ((largest.to_bits() >> 23) as i32 - 126).clamp(-100, 100)
}

impl<'a> Exposed<'a> {
    /// Without a crosstalk table all factors are 1.
    ///
    /// # Errors
    /// What [`SensorConfig::check`], [`FrameSettings::check`] and [`Crosstalk::check`] refuse.
    pub fn new(
        config: &'a SensorConfig,
        settings: &FrameSettings,
        crosstalk: Option<Crosstalk<'a>>,
    ) -> Result<Self, ConfigError> {
        config.check()?;
        settings.check()?;
        let (mut nodes, mut factor) = (heapless::Vec::new(), 1.0f32);
        match &crosstalk {
            None => nodes.extend([0.0]),
            Some(table) => {
                table.check(usize::from(config.channels))?;
                nodes.extend(table.x.iter().map(|x| (x + 1.0) * 0.5 * config.width as f32));
                factor = table.factors.iter().fold(0.0, |a, &f| if f > a { f } else { a });
            }
        }
        let response = config.response.iter().fold(0.0, |a: f32, &r| if r > a { r } else { a });
        let largest = response * settings.exposure_s * factor;
        let scale = scale_of(largest);
        let per_unit = settings.exposure_s * power_of_two(-scale);
        Ok(Self { config, crosstalk, nodes, scale, per_unit })
    }
}

impl<'a, A: Arith> Collector<'a, A> {
    /// A collector for one frame; without a crosstalk table all factors are 1.
    ///
    /// # Errors
    /// Those of [`Exposed::new`].
    pub fn new(
        config: &'a SensorConfig,
        settings: &FrameSettings,
        crosstalk: Option<Crosstalk<'a>>,
    ) -> Result<Self, ConfigError> {
        Exposed::new(config, settings, crosstalk).map(Self::of)
    }

    /// A collector for a sensor in a frame.
    pub fn of(exposed: Exposed<'a>) -> Self {
        let weights = [[[A::Weight::default(); GROUP]; PHASES]; MAX_NODES];
        Self { of: exposed, weights }
    }

    /// Goes on with another sensor: one collector, and the memory for its weights, serves the
    /// captures of a pixel in turn.
    #[inline(always)]
    pub fn turn_to(&mut self, exposed: &Exposed<'a>) {
        self.of.clone_from(exposed);
    }

    /// Adds one band (irradiance, W m⁻² nm⁻¹) of row `y` to the row's sums,
    /// [`crate::spectral::groups`] of the width. [`Arith::collected`] turns a sum into mean
    /// photo-electrons.
    #[inline(always)]
    pub fn add_band(&mut self, y: u32, band: usize, row: BandRow<'_>, sums: &mut [Sums<A::Sum>]) {
        self.add_groups(y, band, row.groups(&mut [0; GROUP]), sums);
    }

    /// [`Self::add_band`] of a band whose groups come from elsewhere: exponents and mantissas.
    #[inline(always)]
    pub fn add_groups(
        &mut self,
        y: u32,
        band: usize,
        groups: impl Iterator<Item = (i8, impl Borrow<[u16; GROUP]>)>,
        sums: &mut [Sums<A::Sum>],
    ) {
        self.set_weights(y as usize, band);
        let phases = self.phases();
        let cells = self.of.nodes.len() - 1;
        let mut cell = 0;
        for (g, ((exponent, mantissas), sums)) in groups.zip(sums).enumerate() {
            let phase = g % phases;
            let first = (g * GROUP) as f32 + 0.5;
            let last = first + (GROUP - 1) as f32;
            let group = (exponent, mantissas.borrow());
            if cells == 0 {
                add::<A>(sums, group, self.of.scale, &self.weights[0][phase]);
                continue;
            }
            while cell + 1 < cells && self.node(cell + 1) <= first {
                cell += 1;
            }
            let mut weights = self.between(cell, phase, first);
            // In a group that extends beyond a node, the remaining pixels use the next cells.
            let mut next = cell;
            while next + 1 < cells && self.node(next + 1) <= last {
                next += 1;
                let from = self.node(next);
                let beyond = self.between(next, phase, first);
                for (i, w) in weights.iter_mut().enumerate() {
                    *w = if first + i as f32 >= from { beyond[i] } else { *w };
                }
            }
            add::<A>(sums, group, self.of.scale, &weights);
        }
    }

    /// Adds a row of mean photo-electrons per second of exposure (e⁻/s): bands that were summed
    /// elsewhere, as groups of exponents and mantissas. `exposure_s`: exposure time, s.
    #[inline(always)]
    pub fn add_rates(
        &mut self,
        groups: impl Iterator<Item = (i8, impl Borrow<[u16; GROUP]>)>,
        exposure_s: f32,
        sums: &mut [Sums<A::Sum>],
    ) {
        let scale = scale_of(exposure_s);
        let weights = [A::weight(exposure_s * power_of_two(-scale)); GROUP];
        for ((exponent, mantissas), sums) in groups.zip(sums) {
            add::<A>(sums, (exponent, mantissas.borrow()), scale, &weights);
        }
    }

    #[inline(always)]
    fn phases(&self) -> usize {
        match self.of.config.pattern.width {
            3 | 6 => 3,
            5 => PHASES,
            _ => 1,
        }
    }

    #[inline(always)]
    fn node(&self, i: usize) -> f32 {
        self.of.nodes.get(i).copied().unwrap_or(f32::MAX)
    }

    /// Weights of a group in a cell between two nodes; `first` is the centre of its first pixel.
    #[inline(always)]
    fn between(&self, cell: usize, phase: usize, first: f32) -> Sums<A::Weight> {
        let (a, b) = (self.node(cell), self.node(cell + 1));
        let step = 1.0 / (b - a);
        let last = self.weights.len() - 1;
        A::lerp(
            &self.weights[cell.min(last)][phase],
            &self.weights[(cell + 1).min(last)][phase],
            (first - a) * step,
            step,
        )
    }

    /// Computes the weights of a band at each node of a row.
    #[inline(always)]
    fn set_weights(&mut self, y: usize, band: usize) {
        let config = self.of.config;
        let bands = usize::from(config.bands);
        let pattern_width = usize::from(config.pattern.width).clamp(1, MAX_PATTERN);
        let phases = self.phases();
        let nm = config.first_band_nm + band as f32 * config.band_step_nm;
        let v = (y as f32 + 0.5) / config.height as f32 * 2.0 - 1.0;
        let places = self.of.crosstalk.map(|c| (c, place(c.wavelength_nm, nm), place(c.y, v)));
        for (node, weights) in self.weights.iter_mut().enumerate().take(self.of.nodes.len()) {
            let mut by_column = [A::Weight::default(); MAX_PATTERN];
            for (x, weight) in by_column.iter_mut().enumerate().take(pattern_width) {
                let channel = config.pattern.channel(x, y);
                let response = config.response.get(channel * bands + band).copied().unwrap_or(0.0);
                let factor = match places {
                    Some((table, wavelength, row)) => table.at(channel, wavelength, row, node),
                    None => 1.0,
                };
                *weight = A::weight(response * self.of.per_unit * factor);
            }
            for (phase, weights) in weights.iter_mut().enumerate().take(phases) {
                for (i, w) in weights.iter_mut().enumerate() {
                    *w = by_column[(phase * GROUP + i) % pattern_width % MAX_PATTERN];
                }
            }
        }
    }
}
