//! Runs the signal chain row by row.
//!
//! A pipeline keeps as many rows as its effects need: one, and three more for each effect that
//! reads its neighbours. Rows may be requested in any order; in rising order each is computed
//! once. The result of a row depends only on its number and the frame.

use crate::arith::{Arith, BLOCK, Block, blocks};
use crate::config::{ConfigError, FrameSettings, MAX_EFFECTS, MAX_WINDOWS, SensorConfig};
use crate::effects::{Context, Effect, Inputs, Needs, beside};
use crate::stream::Key;

/// Source of the mean photo-electrons of a pipeline.
pub trait MeanRows<A: Arith> {
    /// Writes the mean photo-electrons (e⁻) of a row into `out`, which holds
    /// [`blocks`] of the width; values beyond the last pixel are ignored.
    fn mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]);

    /// Writes the mean photo-electrons (e⁻) that the row had in the previous frame; darkness by
    /// default.
    fn previous_mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        let _ = row;
        out.fill([A::Signal::default(); BLOCK]);
    }
}

impl<A: Arith, F: FnMut(u32, &mut [Block<A::Signal>])> MeanRows<A> for F {
    fn mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        self(row, out);
    }
}

#[derive(Clone, Copy)]
struct Link {
    effect: Effect,
    key: Key,
}

/// Three rows of the signal just before an effect that reads its neighbours.
struct Window<'a, S> {
    rows: &'a mut [Block<S>],
    /// Which row each third holds.
    held: [Option<u32>; 3],
}

impl<S> Window<'_, S> {
    #[inline(always)]
    fn get(&self, row: u32) -> &[Block<S>] {
        let len = self.rows.len() / 3;
        let start = (row % 3) as usize * len;
        self.rows.get(start..start + len).unwrap_or(&[])
    }

    #[inline(always)]
    fn get_mut(&mut self, row: u32) -> &mut [Block<S>] {
        let len = self.rows.len() / 3;
        let start = (row % 3) as usize * len;
        self.rows.get_mut(start..start + len).unwrap_or(&mut [])
    }

    #[inline(always)]
    fn holds(&self, row: u32) -> bool {
        self.held[(row % 3) as usize] == Some(row)
    }
}

/// The signal chain of one frame.
pub struct Pipeline<'a, A: Arith> {
    config: &'a SensorConfig,
    cx: Context<'a>,
    links: heapless::Vec<Link, MAX_EFFECTS>,
    windows: heapless::Vec<Window<'a, A::Signal>, MAX_WINDOWS>,
    /// The finished row, and the previous frame's row if an effect needs it.
    row: &'a mut [Block<A::Signal>],
    previous: &'a mut [Block<A::Signal>],
}

/// Number of blocks of memory that [`Pipeline::new`] needs for a sensor.
pub fn memory_blocks(config: &SensorConfig) -> usize {
    let count = |needs| config.effects.iter().filter(|e| e.entry().needs == needs).count();
    let rows = 1 + 3 * count(Needs::Neighbours) + count(Needs::PreviousFrame).min(1);
    rows * blocks(config.width as usize)
}

impl<'a, A: Arith> Pipeline<'a, A> {
    /// A pipeline for one frame that works in `memory` of at least [`memory_blocks`] blocks.
    ///
    /// # Errors
    /// What [`SensorConfig::check`] and [`FrameSettings::check`] refuse, and
    /// [`ConfigError::Memory`] if `memory` is too small.
    pub fn new(
        config: &'a SensorConfig,
        settings: &FrameSettings,
        memory: &'a mut [Block<A::Signal>],
    ) -> Result<Self, ConfigError> {
        config.check()?;
        settings.check()?;
        let mut links: heapless::Vec<Link, MAX_EFFECTS> = heapless::Vec::new();
        for effect in &config.effects {
            let entry = effect.entry();
            // Effects of one kind differ by their order.
            let nth = links.iter().filter(|l| l.effect.entry().id == entry.id).count() as u32;
            let key = Key::new(config.seed).with(u32::from(entry.id)).with(nth);
            links.push(Link { effect: *effect, key }).map_err(|_| ConfigError::Memory)?;
        }
        let len = blocks(config.width as usize);
        let (row, mut rest) = memory.split_at_mut_checked(len).ok_or(ConfigError::Memory)?;
        let mut previous: &mut [Block<A::Signal>] = &mut [];
        if links.iter().any(|l| l.effect.entry().needs == Needs::PreviousFrame) {
            (previous, rest) = rest.split_at_mut_checked(len).ok_or(ConfigError::Memory)?;
        }
        let mut windows = heapless::Vec::new();
        for _ in links.iter().filter(|l| l.effect.entry().needs == Needs::Neighbours) {
            let (rows, left) = rest.split_at_mut_checked(3 * len).ok_or(ConfigError::Memory)?;
            rest = left;
            windows.push(Window { rows, held: [None; 3] }).map_err(|_| ConfigError::Memory)?;
        }
        let mut cx = Context {
            width: config.width,
            height: config.height,
            row: 0,
            frame: settings.frame,
            exposure_s: settings.exposure_s,
            nominal_exposure_s: settings.exposure_s,
            temperature_c: settings.temperature_c,
            analog_gain: settings.analog_gain,
            dn_per_e: config.dn_per_e(settings.analog_gain),
            full_well_e: config.full_well_e,
            black_level_dn: config.black_level_dn,
            max_dn: config.max_dn(),
            pattern: &config.pattern,
            #[cfg(feature = "empirical")]
            table: &config.table,
            #[cfg(feature = "read-noise-spread")]
            read_noise_spread: None,
            #[cfg(feature = "exact-shot-noise")]
            exact_shot_noise: None,
            key: Key::new(config.seed),
        };
        for link in &links {
            cx.key = link.key;
            link.effect.prepare(&mut cx);
        }
        Ok(Self { config, cx, links, windows, row, previous })
    }

    /// Computes one row of DN into `out`, which holds the sensor's width. A row number beyond the
    /// sensor leaves `out` as it is.
    #[inline(always)]
    pub fn row(&mut self, row: u32, source: &mut (impl MeanRows<A> + ?Sized), out: &mut [u16]) {
        if row >= self.cx.height {
            return;
        }
        let depth = self.windows.len() as u32;
        // Rows move through the windows one behind the other: when row t enters the first window,
        // row t - 1 leaves it and enters the second, and so on. A row that follows the last one
        // requested needs one step only: then each window holds the row that leaves it and the one
        // above.
        let ready = |(level, window): (usize, &Window<'_, A::Signal>)| {
            let leaves = row + depth - 1 - level as u32;
            let above = leaves.saturating_sub(1);
            leaves >= self.cx.height || (window.holds(leaves) && window.holds(above))
        };
        let held = self.windows.iter().enumerate().all(ready);
        let first = if held { row + depth } else { row.saturating_sub(depth) };
        for t in first..=row + depth {
            for level in 0..=depth {
                let requested = level < depth || t == row + depth;
                if requested && t >= level && t - level < self.cx.height {
                    self.step(level as usize, t - level, source);
                }
            }
        }
        let gain = self.cx.dn_per_e;
        let (black, max) = (self.config.black_level_dn, self.config.max_dn());
        for (block, out) in self.row.iter().zip(out.chunks_mut(BLOCK)) {
            let mut dn = [0; BLOCK];
            A::digitise(block, gain, black, max, &mut dn);
            match out.first_chunk_mut::<BLOCK>() {
                Some(whole) => *whole = dn,
                None => out.iter_mut().zip(dn).for_each(|(o, d)| *o = d),
            }
        }
    }

    /// Computes a row at a level: from the level's window to the next window, or to the end of the
    /// chain.
    #[inline(always)]
    fn step(&mut self, level: usize, row: u32, source: &mut (impl MeanRows<A> + ?Sized)) {
        let mut cx = Context { row, ..self.cx };
        let at = level.min(self.windows.len());
        let (below, above) = self.windows.split_at_mut(at);
        let [row_above, row_below] = beside(row, self.cx.height);
        let mut out: &mut [Block<A::Signal>] = self.row;
        if let Some(window) = above.first_mut() {
            window.held[(row % 3) as usize] = None;
            out = window.get_mut(row);
        }
        let window = below.last();
        if let Some(window) = window {
            if ![row_above, row, row_below].iter().all(|&n| window.holds(n)) {
                return;
            }
            for (o, i) in out.iter_mut().zip(window.get(row)) {
                *o = *i;
            }
        } else {
            source.mean_row(row, out);
        }
        let mut passed = 0;
        for link in &self.links {
            let needs = link.effect.entry().needs;
            passed += usize::from(needs == Needs::Neighbours);
            if passed != level {
                continue;
            }
            let mut inputs =
                Inputs::<A::Signal> { above: &[], here: &[], below: &[], previous: &[] };
            match (needs, window) {
                (Needs::Neighbours, Some(window)) => {
                    inputs.above = window.get(row_above);
                    inputs.here = window.get(row);
                    inputs.below = window.get(row_below);
                }
                (Needs::PreviousFrame, _) => {
                    source.previous_mean_row(row, self.previous);
                    inputs.previous = self.previous;
                }
                _ => {}
            }
            cx.key = link.key;
            link.effect.apply::<A>(&cx, &inputs, out);
        }
        if let Some(window) = above.first_mut() {
            window.held[(row % 3) as usize] = Some(row);
        }
    }
}
