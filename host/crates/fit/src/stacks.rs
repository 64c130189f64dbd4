//! The dark and flat stacks of a cleaned set by analog gain, and the levels of the flats.

use super::channels::Channels;
use super::scenes::{Bin, bins};
use super::waves::{self, Wave};
use camrig_base::{Cfa, Error, Plane, Result, Value};
use camrig_captures::{CaptureSet, Role};
use camrig_clean::{Cleaned, Done, Kind};
use camrig_estimates::blinking::Blinking;
use camrig_estimates::robust::{mean, variance};
use camrig_estimates::rows::RowNoise;
use camrig_estimates::{Estimates, Sites, Stack, estimate};
use camrig_measure::ladder::{Selection, photons};
use camrig_measure::moments::SATURATED_SHARE;
use camrig_measure::ptc::{self, Ptc};

/// Most samples in memory, from which a gain is known to 0.1 %; of larger sets the middle of the
/// frames is used.
const MAX_SAMPLES: usize = 1 << 25;
/// Change of temperature up to which stacks belong together, K: with a doubling in 7 K, dark
/// current changes by 10 %.
const SAME_TEMPERATURE_C: f64 = 1.0;

/// Relative difference of exposures up to which darks are one stack: charge differs by no more.
const SAME_EXPOSURE: f64 = 0.03;

/// What was measured at one analog gain.
pub struct AtGain {
    /// The gain as it was stated.
    pub gain: f64,
    /// The part of it that multiplied the codes.
    pub digital: f64,
    /// What its dark and flat stacks show.
    pub found: Estimates,
    /// Its flats below saturation, in the order of [`Estimates::flats`].
    pub flats: Vec<FlatStack>,
    /// Areas of static scenes by their level, of sets without flats.
    pub scenes: Vec<Bin>,
    /// Exposure of the shortest dark, s.
    pub shortest_s: f64,
    /// Exposure of the longest dark, s.
    pub longest_s: f64,
    /// Frames of the darks, and of the flats or scenes that were used.
    pub frames: [usize; 2],
    /// Photon transfer of its flats; none where it has none.
    pub ptc: Option<Ptc>,
    /// Pixels of the shortest dark that blink.
    pub blinking: Option<Blinking>,
    /// The strongest wave of its darks.
    pub wave: Option<Wave>,
    /// Codes of its stacks within the scale.
    pub histograms: Vec<Histogram>,
    /// Channels of columns by the gains of its brightest flat, and by the offsets of its shortest
    /// dark in DN.
    pub channels: [Option<Channels>; 2],
}

/// The codes of a stack.
pub struct Histogram {
    /// How often each came.
    pub counts: Vec<u32>,
    /// Standard deviation of a pixel over the frames, of several sites the smallest, DN: the
    /// density of the codes is as smooth as this noise, whatever the pixels' means.
    pub sd: f64,
}

impl Histogram {
    /// Of a stack; none of one of which samples are cut off.
    fn of(stack: &Stack, sites: Sites, white: u16) -> Option<Self> {
        let mut counts = vec![0; usize::from(white) + 1];
        for v in stack.frames.iter().flat_map(|frame| &frame.data) {
            counts[usize::from(*v).min(usize::from(white))] += 1;
        }
        let samples = counts.iter().map(|c| f64::from(*c)).sum::<f64>();
        let cut = f64::from(counts[0] + counts[usize::from(white)]);
        if cut > SATURATED_SHARE * samples {
            return None;
        }
        let (width, height) = stack.size();
        let mut of_sites = vec![Vec::new(); sites.count()];
        for p in 0..width * height {
            let values: Vec<f64> = stack.frames.iter().map(|f| f64::from(f.data[p])).collect();
            of_sites[sites.of(p % width, p / width)].push(variance(&values));
        }
        let narrowest = of_sites.iter().map(|v| mean(v).value).fold(f64::INFINITY, f64::min);
        Some(Self { counts, sd: narrowest.sqrt() })
    }
}

impl AtGain {
    /// DN per electron by the scenes, as of a straight response.
    fn of_scenes(&self) -> Option<f64> {
        Value::combine(self.scenes.iter().map(|bin| bin.ratio)).map(|k| k.value)
    }

    /// Whether its frames tell the gain.
    pub fn tells_gain(&self) -> bool {
        !self.flats.is_empty() || !self.scenes.is_empty()
    }
}

/// Conditions of a flat.
pub struct FlatStack {
    /// Its place in [`Estimates::flats`].
    pub index: usize,
    /// Wavelength, nm, where the light is narrow-band.
    pub wavelength_nm: Option<f64>,
    /// Photons per pixel over the exposure, where they are known.
    pub photons: Option<f64>,
    /// Exposure, s.
    pub exposure_s: f64,
    /// Frames.
    pub frames: usize,
}

/// The sites of a colour filter pattern.
pub fn sites(cfa: &Cfa) -> Sites {
    Sites { across: cfa.width, down: cfa.height }
}

/// Roles of frames of what is no uniform light.
const SCENES: [Role; 4] = [Role::Scene, Role::Chart, Role::Edge, Role::Dots];

/// Measures every analog gain that has darks, by rising gain, at the temperature of most stacks.
/// `dn_per_e` is that at unity gain, for sets without flats and scenes; without it, electrons are
/// DN.
///
/// # Errors
/// Files that cannot be read; no dark stack of two frames or more; no flat below saturation.
pub fn measure(raw: &CaptureSet, cleaned: &Cleaned, dn_per_e: Option<f64>) -> Result<Vec<AtGain>> {
    // Photon transfer reads the frames as they were, with the light that cleaning mended.
    let set = CaptureSet { captures: cleaned.set().captures.clone(), ..raw.clone() };
    let used = at_one_temperature(cleaned.set());
    let gains_of = |roles: &[Role]| {
        let of_role = used.iter().map(|i| &cleaned.set().captures[*i]);
        let of_role = of_role.filter(|c| roles.contains(&c.role));
        let mut gains: Vec<f64> = of_role.map(|c| c.analog_gain).collect();
        gains.sort_by(f64::total_cmp);
        gains.dedup();
        gains
    };
    let lit = gains_of(&[&SCENES[..], &[Role::Flat]].concat());
    let mut gains = gains_of(&[Role::Dark]);
    if gains.is_empty() {
        return Err(Error::input("no dark captures").help(
            "a camera file needs dark frames: some ten of the shortest exposure, and some ten of \
             a long one for the dark current",
        ));
    }
    // Those without flats have the gain of the others, in proportion.
    gains.sort_by_key(|gain| !lit.contains(gain));
    let in_dn = lit.is_empty().then_some(1.0);
    let (mut all, mut unity): (Vec<AtGain>, _) = (Vec::new(), dn_per_e.or(in_dn));
    for gain in gains {
        let place = |e: Error| e.at(format!("analog gain {gain}"));
        if unity.is_none() && !lit.contains(&gain) {
            return Err(Error::input("no flat or scene at a gain that has darks").help(
                "add two flats of one level or more, or the DN per electron at unity gain",
            ));
        }
        let k = unity.map_or(f64::NAN, |k| k * gain);
        let found = at_gain(&set, cleaned, &used, (gain, k)).map_err(place)?;
        unity =
            unity.or(found.found.gain.map(|k| k.value).or(found.of_scenes()).map(|k| k / gain));
        all.push(found);
    }
    all.sort_by(|a, b| a.gain.total_cmp(&b.gain));
    Ok(all)
}

/// The flats, or scenes where there are none, whose gain does not depend on temperature, and the
/// darks whose temperature most darks have.
fn at_one_temperature(set: &CaptureSet) -> Vec<usize> {
    let is_dark = |i: &usize| set.captures[*i].role == Role::Dark;
    let (darks, lit): (Vec<usize>, Vec<usize>) = (0..set.captures.len()).partition(is_dark);
    let near = |a: &usize, b: &usize| {
        let at = |i: &usize| set.captures[*i].temperature_c;
        at(a).zip(at(b)).is_none_or(|(a, b)| (a - b).abs() <= SAME_TEMPERATURE_C)
    };
    let together = |a: &&usize| darks.iter().filter(|b| near(a, b)).count();
    // Of equal groups the first in the file.
    let first = darks.iter().rev().max_by_key(together);
    let together = darks.iter().filter(|i| first.is_some_and(|first| near(first, i))).copied();
    let is_flat = |i: &usize| set.captures[*i].role == Role::Flat;
    let is_scene = |i: &usize| SCENES.contains(&set.captures[*i].role);
    let (flats, others): (Vec<usize>, Vec<usize>) = lit.into_iter().partition(is_flat);
    let scenes = others.into_iter().filter(is_scene).filter(|_| flats.is_empty());
    let mut used: Vec<usize> = together.chain(flats.iter().copied()).chain(scenes).collect();
    used.sort_unstable();
    used
}

/// What multiplied the codes of a gain, where all its samples within the scale have a step.
fn digital(set: &CaptureSet, cleaned: &Cleaned, gain: f64) -> f64 {
    let of_gain = |id: &str| set.captures.iter().any(|c| c.id == id && c.analog_gain == gain);
    let steps = cleaned.findings().iter();
    let steps = steps.filter(|f| f.kind == Kind::CodeStep && f.done == Done::Reported);
    let mut own = steps.filter(|f| f.place.split(", ").any(of_gain));
    own.find_map(|f| f.amount).unwrap_or(1.0)
}

fn at_gain(
    set: &CaptureSet,
    cleaned: &Cleaned,
    used: &[usize],
    (gain, dn_per_e): (f64, f64),
) -> Result<AtGain> {
    let facts = &cleaned.set().sensor;
    let of_gain: Vec<usize> =
        used.iter().copied().filter(|i| set.captures[*i].analog_gain == gain).collect();
    let counts: usize =
        of_gain.iter().map(|i| set.count(&set.captures[*i])).sum::<Result<usize>>()?;
    let part = middle(facts.width, facts.height, counts, &cleaned.set().cfa());
    let mut stacks: Vec<Stack> = Vec::new();
    let mut flats: Vec<(usize, f64)> = Vec::new();
    for i in of_gain {
        let capture = &set.captures[i];
        let mut frames = Vec::new();
        cleaned.for_each_batch(i, |planes| {
            frames.extend(planes.iter().map(|p| cut(p, part)));
            Ok(())
        })?;
        if frames.len() < 2 {
            continue;
        }
        if capture.role == Role::Flat {
            flats.push((i, saturated(&frames, facts.white_level_dn)));
        }
        let exposure_s = capture.exposure_s;
        let alike = |s: &&mut Stack| {
            s.role == Role::Dark && (s.exposure_s - exposure_s).abs() <= SAME_EXPOSURE * exposure_s
        };
        match stacks.iter_mut().find(alike).filter(|_| capture.role == Role::Dark) {
            Some(dark) => dark.frames.extend(frames),
            None => stacks.push(Stack::new(&capture.id, capture.role, exposure_s, frames)),
        }
    }
    let photon_transfer = photon_transfer(set, gain)?;
    let below = |(index, (i, share)): (usize, (usize, f64))| {
        let capture = &set.captures[i];
        let used = share <= SATURATED_SHARE && is_used(photon_transfer.as_ref(), &capture.id);
        used.then(|| FlatStack {
            index,
            wavelength_nm: capture.light.as_ref().and_then(|l| l.wavelength_nm),
            photons: photons(set, capture),
            exposure_s: capture.exposure_s,
            frames: stacks.iter().find(|s| s.id == capture.id).map_or(0, |s| s.frames.len()),
        })
    };
    let flats: Vec<FlatStack> = flats.into_iter().enumerate().filter_map(below).collect();
    let count = |role| stacks.iter().filter(|s| s.role == role).map(|s| s.frames.len()).sum();
    let darks = || stacks.iter().filter(|s| s.role == Role::Dark).map(|s| s.exposure_s);
    let (shortest_s, longest_s) =
        (darks().fold(f64::INFINITY, f64::min), darks().fold(0.0, f64::max));
    let sites = sites(&cleaned.set().cfa());
    let mut frames = [count(Role::Dark), flats.iter().map(|f| f.frames).sum()];
    let mut scenes = Vec::new();
    let shortest = stacks.iter().find(|s| s.role == Role::Dark && s.exposure_s == shortest_s);
    if let Some(dark) = shortest {
        for scene in stacks.iter().filter(|s| SCENES.contains(&s.role)) {
            scenes.extend(bins(&scene.frames, &dark.frames, sites, facts.white_level_dn));
            frames[1] += scene.frames.len();
        }
    }
    let of_scenes = Value::combine(scenes.iter().map(|bin: &Bin| bin.ratio));
    let found = estimate(&stacks, sites, of_scenes.map_or(dn_per_e, |k| k.value))?;
    let digital = digital(set, cleaned, gain);
    let blinking = shortest.and_then(Blinking::of);
    let darks: Vec<&Stack> = stacks.iter().filter(|s| s.role == Role::Dark).collect();
    let rows = RowNoise::of(std::slice::from_ref(&found.bias.row_spectrum));
    let wave = waves::strongest(&darks, sites, rows.as_ref());
    let white = facts.white_level_dn;
    let level = |f: &&FlatStack| {
        let sites = &found.flats[f.index].sites;
        sites.iter().map(|s| s.level.value).sum::<f64>()
    };
    let brightest = flats.iter().max_by(|a, b| level(a).total_cmp(&level(b)));
    let brightest = brightest.and_then(|f| {
        let id = &found.flats[f.index].stack;
        stacks.iter().find(|s| s.role == Role::Flat && s.id == *id)
    });
    let channels = [
        brightest.zip(shortest).and_then(|(flat, dark)| Channels::of_gains(flat, dark, sites)),
        shortest.and_then(|dark| Channels::of_offsets(dark, sites)),
    ];
    let histograms = stacks.iter().filter_map(|s| Histogram::of(s, sites, white)).collect();
    Ok(AtGain {
        gain,
        digital,
        found,
        flats,
        scenes,
        shortest_s,
        longest_s,
        frames,
        ptc: photon_transfer,
        blinking,
        wave,
        histograms,
        channels,
    })
}

/// The photon transfer of the wavelength with most flats at a gain; none without flats.
fn photon_transfer(set: &CaptureSet, gain: f64) -> Result<Option<Ptc>> {
    let all = Selection::all(set).into_iter();
    let own = all.filter(|s| s.analog_gain == gain && !s.darks.is_empty());
    let most = own.max_by_key(|s| s.flats.len());
    most.map(|selection| ptc::of_selection(set, &selection)).transpose()
}

/// Whether photon transfer found a flat below saturation, in all channels; one of another light
/// was not judged.
fn is_used(ptc: Option<&Ptc>, id: &str) -> bool {
    let channels = ptc.iter().flat_map(|p| &p.channels);
    channels.flat_map(|c| &c.curve).filter(|point| point.id == id).all(|point| point.used)
}

/// Share of the samples at the white level.
fn saturated(frames: &[Plane<u16>], white: u16) -> f64 {
    let all = frames.iter().flat_map(|f| &f.data);
    let (full, count) =
        all.fold((0usize, 0usize), |(full, n), v| (full + usize::from(*v >= white), n + 1));
    full as f64 / count.max(1) as f64
}

/// First column and row, columns and rows of the part of frames that fits into memory.
fn middle(width: usize, height: usize, frames: usize, cfa: &Cfa) -> [usize; 4] {
    let share = (MAX_SAMPLES / frames.max(1)) as f64 / (width * height) as f64;
    let part = |all: usize, period: usize| {
        if share >= 1.0 {
            return (0, all);
        }
        let kept = (all as f64 * share.sqrt()) as usize / period * period;
        ((all - kept) / 2 / period * period, kept)
    };
    let ((x, width), (y, height)) = (part(width, cfa.width), part(height, cfa.height));
    [x, y, width, height]
}

fn cut(plane: &Plane<u16>, [x0, y0, width, height]: [usize; 4]) -> Plane<u16> {
    match (plane.width, plane.height) == (width, height) {
        true => plane.clone(),
        false => Plane::from_fn(width, height, |x, y| plane.row(y0 + y)[x0 + x]),
    }
}
