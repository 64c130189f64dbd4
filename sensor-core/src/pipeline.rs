//! Runs the signal chain row by row.
//!
//! A pipeline keeps as many rows as its effects need: one, and three more for each effect that
//! reads its neighbours. Rows may be requested in any order; in rising order each is computed
//! once. The result of a row depends only on its number and the frame.
//!
//! Where an effect remembers the previous frame, the effects of light before it also run on the
//! light of that frame, with its exposure and number and in memory of their own.

use crate::arith::{Arith, BLOCK, Block, blocks};
use crate::config::{ConfigError, FrameSettings, MAX_EFFECTS, MAX_WINDOWS, SensorConfig, Streams};
use crate::effects::{Context, Domain, Effect, Inputs, Needs, beside};
use crate::stream::Key;

/// Source of the mean photo-electrons of a pipeline.
pub trait MeanRows<A: Arith> {
    /// Writes the mean photo-electrons (e⁻) of a row into `out`, which holds
    /// [`blocks`] of the width, as signals of [`Arith::Light`]; values beyond the last pixel are
    /// ignored.
    fn mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]);

    /// The same in the light of the previous frame, at the exposure of this one; darkness by
    /// default. The pipeline accounts for the previous frame's own exposure.
    fn previous_mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        let _ = row;
        out.fill([A::Signal::default(); BLOCK]);
    }

    /// Writes what the traps of a row hold at the beginning of the frame into `out`, e⁻, as signals
    /// of [`Arith::Light`], for the effect of this number among those that read it
    /// ([`Needs::EarlierFrames`]); nothing by default.
    fn traps(&mut self, effect: usize, row: u32, out: &mut [Block<A::Signal>]) {
        let _ = (effect, row);
        out.fill([A::Signal::default(); BLOCK]);
    }

    /// Takes what they hold at its end, which [`Self::traps`] gives in the frame that follows. A
    /// row may be told several times, each time with the same values.
    fn keep_traps(&mut self, effect: usize, row: u32, held: &[Block<A::Signal>]) {
        let _ = (effect, row, held);
    }
}

impl<A: Arith, F: FnMut(u32, &mut [Block<A::Signal>])> MeanRows<A> for F {
    fn mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        self(row, out);
    }
}

#[derive(Clone, Copy)]
struct Link<'a> {
    effect: &'a Effect,
    key: Key,
    /// [`Context::pattern_of`] and [`Context::noise_of`].
    pattern_of: u8,
    noise_of: u8,
    /// [`Context::passed_gain`].
    passed_gain: f32,
}

impl Link<'_> {
    /// What its effect knows of a row, beyond what all do.
    #[inline(always)]
    fn context<'a>(&self, cx: &Context<'a>) -> Context<'a> {
        let Self { key, pattern_of, noise_of, passed_gain, .. } = *self;
        Context { key, pattern_of, noise_of, passed_gain, ..*cx }
    }
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

    /// Place for a row, and for the note that it is held.
    #[inline(always)]
    fn get_mut(&mut self, row: u32) -> (&mut [Block<S>], &mut Option<u32>) {
        let len = self.rows.len() / 3;
        let third = (row % 3) as usize;
        let place = self.rows.get_mut(third * len..(third + 1) * len).unwrap_or(&mut []);
        (place, &mut self.held[third])
    }

    #[inline(always)]
    fn holds(&self, row: u32) -> bool {
        self.held[(row % 3) as usize] == Some(row)
    }
}

/// The chain, or its beginning, in one frame: what its stages know, and the rows between them.
struct Run<'a, S> {
    cx: Context<'a>,
    windows: heapless::Vec<Window<'a, S>, MAX_WINDOWS>,
    /// The row that leaves it.
    row: &'a mut [Block<S>],
}

/// The signal chain of one frame.
pub struct Pipeline<'a, A: Arith> {
    config: &'a SensorConfig,
    chain: heapless::Vec<Link<'a>, MAX_EFFECTS>,
    /// Number of effects on light and photo-electrons, the first of the chain.
    light: usize,
    now: Run<'a, A::Signal>,
    before: Option<Before<'a, A::Signal>>,
    /// One row of the traps, where an effect has some.
    #[cfg_attr(not(feature = "persistence"), allow(dead_code, reason = "no effect has traps"))]
    traps: &'a mut [Block<A::Signal>],
}

/// The previous frame, up to the effect that remembers it.
struct Before<'a, S> {
    /// Number of effects before that one, and its level in the chain.
    links: usize,
    level: usize,
    /// Exposure of the previous frame over that of this one.
    exposure_ratio: f32,
    run: Run<'a, S>,
}

/// Number of the first effect that remembers the previous frame.
fn remembering(config: &SensorConfig) -> Option<usize> {
    config.effects.iter().position(|e| e.entry().needs == Needs::PreviousFrame)
}

fn windows(effects: &[Effect]) -> usize {
    effects.iter().filter(|e| e.entry().needs == Needs::Neighbours).count()
}

/// Rows of traps that a pipeline works on at a time.
fn rows_of_traps(config: &SensorConfig) -> usize {
    let has_some = |e: &Effect| e.entry().needs == Needs::EarlierFrames;
    usize::from(cfg!(feature = "persistence") && config.effects.iter().any(has_some))
}

/// Number of blocks of memory that [`Pipeline::new`] needs for a sensor.
pub fn memory_blocks(config: &SensorConfig) -> usize {
    let before = remembering(config).and_then(|first| config.effects.get(..first));
    let rows = 1 + 3 * windows(&config.effects) + before.map_or(0, |e| 1 + 3 * windows(e));
    (rows + rows_of_traps(config)) * blocks(config.width as usize)
}

impl<'a, S> Run<'a, S> {
    /// A run of these effects, which takes its memory, rows of `len` blocks, from the beginning of
    /// `memory`.
    fn new(
        cx: Context<'a>,
        effects: &[Effect],
        len: usize,
        memory: &mut &'a mut [Block<S>],
    ) -> Result<Self, ConfigError> {
        let mut take = |count: usize| {
            let (rows, rest) =
                core::mem::take(memory).split_at_mut_checked(count).ok_or(ConfigError::Memory)?;
            *memory = rest;
            Ok(rows)
        };
        let row = take(len)?;
        let mut run = Self { cx, windows: heapless::Vec::new(), row };
        for _ in 0..windows(effects) {
            let window = Window { rows: take(3 * len)?, held: [None; 3] };
            run.windows.push(window).map_err(|_| ConfigError::Memory)?;
        }
        Ok(run)
    }

    /// The steps, by level and row, that a row needs to leave the run.
    #[inline(always)]
    fn steps(&self, row: u32) -> impl Iterator<Item = (usize, u32)> + use<S> {
        let (depth, height) = (self.windows.len() as u32, self.cx.height);
        // Rows move through the windows one behind the other: when row t enters the first window,
        // row t - 1 leaves it and enters the second, and so on. A row that follows the last one
        // requested needs one step only: then each window holds the row that leaves it and the one
        // above.
        let ready = |(level, window): (usize, &Window<'_, S>)| {
            let leaves = row + depth - 1 - level as u32;
            let above = leaves.saturating_sub(1);
            leaves >= height || (window.holds(leaves) && window.holds(above))
        };
        let held = self.windows.iter().enumerate().all(ready);
        let first = if held { row + depth } else { row.saturating_sub(depth) };
        let steps = (first..=row + depth).flat_map(move |t| (0..=depth).map(move |l| (l, t)));
        steps.filter_map(move |(level, t)| {
            let requested = level < depth || t == row + depth;
            let there = requested && t >= level && t - level < height;
            there.then(|| (level as usize, t - level))
        })
    }

    /// A row on its way through a level: from the level's window to the next window, or to the end
    /// of the run. `None` while the window lacks its neighbours.
    #[inline(always)]
    fn at(&mut self, level: usize, row: u32) -> Option<At<'_, S>>
    where
        S: Copy,
    {
        let level = level.min(self.windows.len());
        let (below, above) = self.windows.split_at_mut(level);
        let [row_above, row_below] = beside(row, self.cx.height);
        let mut at = At { out: &mut *self.row, held: None, beside: None };
        if let Some(window) = above.first_mut() {
            let (place, held) = window.get_mut(row);
            *held = None;
            (at.out, at.held) = (place, Some(held));
        }
        if let Some(window) = below.last() {
            let rows = [row_above, row, row_below];
            if !rows.iter().all(|&n| window.holds(n)) {
                return None;
            }
            let rows = rows.map(|n| window.get(n));
            for (o, i) in at.out.iter_mut().zip(rows[1]) {
                *o = *i;
            }
            at.beside = Some(rows);
        }
        Some(at)
    }
}

/// A row on its way: see [`Run::at`].
struct At<'r, S> {
    out: &'r mut [Block<S>],
    /// Where the next window notes that it holds the row.
    held: Option<&'r mut Option<u32>>,
    /// The row above, the row and the row below, before the effect that reads them.
    beside: Option<[&'r [Block<S>]; 3]>,
}

/// What an effect reads beside the row.
#[inline(always)]
fn inputs<'r, S>(
    needs: Needs,
    beside: Option<[&'r [Block<S>]; 3]>,
    previous: &'r [Block<S>],
) -> Inputs<'r, S> {
    let [above, here, below] = match needs {
        Needs::Neighbours => beside.unwrap_or_default(),
        _ => Default::default(),
    };
    Inputs { above, here, below, previous }
}

/// The links of a level, those between two windows, with their places in the chain.
#[inline(always)]
fn of_level<'c, 'a>(
    chain: &'c [Link<'a>],
    level: usize,
) -> impl Iterator<Item = (usize, &'c Link<'a>)> {
    let mut passed = 0;
    chain.iter().enumerate().filter(move |(_, link)| {
        passed += usize::from(link.effect.entry().needs == Needs::Neighbours);
        passed == level
    })
}

/// What the stages of a frame know before its first row.
fn context<'a>(
    config: &'a SensorConfig,
    settings: &FrameSettings,
    chain: &[Link<'_>],
) -> Context<'a> {
    let at_gain = config.at_gain(settings.analog_gain);
    let mut cx = Context {
        width: config.width,
        height: config.height,
        row: 0,
        frame: settings.frame,
        exposure_s: settings.exposure_s,
        nominal_exposure_s: settings.exposure_s,
        temperature_c: settings.temperature_c,
        analog_gain: at_gain.relative_gain,
        dn_per_e: at_gain.dn_per_e,
        at_gain,
        passed_gain: 1.0,
        full_well_e: config.full_well_e,
        full_scale_e: config.full_scale_e(),
        black_level_dn: at_gain.black_level_dn,
        max_dn: config.max_dn(),
        pattern: &config.pattern,
        #[cfg(feature = "empirical")]
        table: &config.table,
        #[cfg(feature = "read-noise-spread")]
        read_noise_spread: None,
        #[cfg(feature = "exact-shot-noise")]
        exact_shot_noise: None,
        key: Key::new(config.seed),
        pattern_of: 0,
        noise_of: 0,
    };
    for link in chain {
        cx = link.context(&cx);
        link.effect.prepare(&mut cx);
    }
    cx
}

/// From photo-electrons to the charge that they are.
#[inline(always)]
fn hold<A: Arith>(row: &mut [Block<A::Signal>]) {
    for e in row.as_flattened_mut() {
        *e = A::held(*e);
    }
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
        let mut chain: heapless::Vec<Link<'a>, MAX_EFFECTS> = heapless::Vec::new();
        #[cfg_attr(
            not(feature = "gain-stage"),
            allow(unused_mut, reason = "nothing passes it on")
        )]
        let mut passed_gain = 1.0;
        for effect in &config.effects {
            let entry = effect.entry();
            // Effects of one kind differ by their order.
            let nth = chain.iter().filter(|l| l.effect.entry().id == entry.id).count() as u32;
            let key = Key::new(config.seed).with(u32::from(entry.id)).with(nth);
            let Streams { photodiode, window, capture } = config.streams;
            let [pattern_of, noise_of] = match effect.domain() {
                Domain::Voltage => [capture, capture],
                _ => [photodiode, window],
            };
            let link = Link { effect, key, pattern_of, noise_of, passed_gain };
            chain.push(link).map_err(|_| ConfigError::Memory)?;
            #[cfg(feature = "gain-stage")]
            if let Effect::GainStage(stage) = effect {
                passed_gain *= stage.factor(config.at_gain(settings.analog_gain).relative_gain);
            }
        }
        let len = blocks(config.width as usize);
        let mut memory = memory;
        let mut cx = context(config, settings, &chain);
        cx.passed_gain = passed_gain;
        let now = Run::new(cx, &config.effects, len, &mut memory)?;
        let mut before = None;
        if let Some(links) = remembering(config)
            && let Some(effects) = config.effects.get(..links)
        {
            let previous = settings.previous();
            before = Some(Before {
                links,
                level: windows(effects),
                exposure_ratio: previous.exposure_s / settings.exposure_s,
                run: Run::new(context(config, &previous, &chain), effects, len, &mut memory)?,
            });
        }
        let light = chain.iter().filter(|l| l.effect.domain() < Domain::Charge).count();
        let traps = memory.get_mut(..rows_of_traps(config) * len).ok_or(ConfigError::Memory)?;
        Ok(Self { config, chain, light, now, before, traps })
    }

    /// Computes one row of DN into `out`, which holds the sensor's width. A row number beyond the
    /// sensor leaves `out` as it is.
    #[inline(always)]
    pub fn row(&mut self, row: u32, source: &mut (impl MeanRows<A> + ?Sized), out: &mut [u16]) {
        if row >= self.config.height {
            return;
        }
        let Self { config, chain, light, now, before, .. } = self;
        #[cfg(feature = "persistence")]
        let traps = &mut *self.traps;
        for (level, row) in now.steps(row) {
            // What the previous frame left in the row comes first.
            let remembers = before.as_ref().filter(|before| before.level == level);
            let of_before = remembers.map(|before| before.run.steps(row)).into_iter().flatten();
            let steps = of_before.map(|step| (true, step)).chain([(false, (level, row))]);
            for (is_before, (level, row)) in steps {
                let (run, previous, links, ratio): (_, &[_], _, _) = match before {
                    Some(before) if is_before => {
                        (&mut before.run, &[], before.links, Some(before.exposure_ratio))
                    }
                    Some(before) => (&mut *now, &*before.run.row, chain.len(), None),
                    None => (&mut *now, &[], chain.len(), None),
                };
                let cx = Context { row, ..run.cx };
                let Some(At { out, held, beside }) = run.at(level, row) else { continue };
                if beside.is_none() {
                    match ratio {
                        Some(ratio) => {
                            source.previous_mean_row(row, out);
                            for e in out.as_flattened_mut() {
                                *e = A::Light::times(*e, ratio);
                            }
                        }
                        None => source.mean_row(row, out),
                    }
                    if *light == 0 {
                        hold::<A>(out);
                    }
                }
                for (i, link) in of_level(chain, level).take_while(|(i, _)| *i < links) {
                    let inputs = inputs(link.effect.entry().needs, beside, previous);
                    let cx = link.context(&cx);
                    #[cfg(feature = "persistence")]
                    if let Effect::Persistence(effect) = link.effect
                        && !is_before
                    {
                        let with_traps = |l: &&Link| l.effect.entry().id == link.effect.entry().id;
                        let number = chain.iter().take(i).filter(with_traps).count();
                        source.traps(number, row, traps);
                        effect.exchange::<A::Light>(&cx, out, traps);
                        source.keep_traps(number, row, traps);
                    }
                    link.effect.apply::<A>(&cx, &inputs, out);
                    if i + 1 == *light {
                        hold::<A>(out);
                    }
                }
                if let Some(held) = held {
                    *held = Some(row);
                }
            }
        }
        let gain = now.cx.dn_per_e_here();
        let (at_gain, max) = (now.cx.at_gain, config.max_dn());
        for (block, out) in now.row.iter().zip(out.chunks_mut(BLOCK)) {
            let mut dn = [0; BLOCK];
            A::digitise(block, gain, at_gain.black_level_dn, max, &mut dn);
            if at_gain.digital_gain != 1.0 {
                dn = dn.map(|dn| at_gain.multiplied(dn, max));
            }
            match out.first_chunk_mut::<BLOCK>() {
                Some(whole) => *whole = dn,
                None => out.iter_mut().zip(dn).for_each(|(o, d)| *o = d),
            }
        }
    }
}
