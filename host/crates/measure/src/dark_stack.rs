//! Figures of one stack of dark frames in DN: offset, read noise, noise of rows and columns, hot
//! pixels. No metadata is needed.
//!
//! Read noise is the square root of the temporal variance of the pixels minus that of rounding,
//! step²/12 (EMVA 1288 release 4.0, section 7.1); the dark current's shot noise is part of it.
//! Noise of rows is that of the frames' row means about their temporal mean, minus the
//! contribution of white noise: with w pixels in a row V_row = σ_row² + (σ² − σ_row²)/w.

use super::codes::Codes;
use super::copies;
use super::emva;
use super::figure;
use super::moments::{Moments, SATURATED_SHARE};
use super::rounding::QUANTISATION;
use super::rounding::QUANTISATION_LIMITED;
use super::stack::Stack;
use camrig_base::Value;
use camrig_base::{Cfa, Error, Plane, RawFrame, Result};
use camrig_captures::{Capture, CaptureSet, Role, SensorFacts, open_with_facts};
use camrig_formats::Facts;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value as Json, json};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Robust standard deviations above which a pixel is hot: one in 1e9 of a Gaussian pattern.
const HOT_SIGMAS: f64 = 6.0;
/// Ratio of the standard deviation of a Gaussian to its median absolute deviation.
const SIGMA_OVER_MEDIAN: f64 = 1.482_602;
/// Bits of samples of unknown range.
const MAX_BITS: u32 = 16;

/// Figures of a stack of dark frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DarkStack {
    /// Mean of all samples, DN.
    pub offset_dn: Value,
    /// Temporal noise of a pixel without rounding, DN; `None` where rounding hides it.
    pub read_noise_dn: Option<Value>,
    /// Temporal noise that the pixels of a row share, DN.
    pub row_noise_dn: Value,
    /// Temporal noise that the pixels of a column share, DN.
    pub column_noise_dn: Value,
    /// Standard deviation of the rows' offsets, DN.
    pub row_fpn_dn: Value,
    /// Standard deviation of the columns' offsets, DN.
    pub column_fpn_dn: Value,
    /// Distance of neighbouring codes, DN.
    pub code_step_dn: Value,
    /// Number of pixels whose mean lies far above that of the others of their colour.
    pub hot_pixels: Value,
    /// Number of frames.
    pub frames: usize,
    /// Figures of each channel, by its letter.
    pub channels: BTreeMap<String, DarkChannel>,
    /// Remarks for people.
    pub notes: Vec<String>,
}

impl DarkStack {
    /// The read noise, e⁻, at a system gain in DN per electron.
    pub fn read_noise_e(&self, dn_per_e: Option<f64>) -> Option<Value> {
        in_electrons(self.read_noise_dn, dn_per_e)
    }

    /// The figures as a JSON object, with those in electrons where the system gain is known, DN per
    /// electron.
    ///
    /// # Errors
    /// None but a fault of the program.
    pub fn json(&self, dn_per_e: Option<f64>) -> Result<Map<String, Json>> {
        let mut figures = json!(self);
        if let Some(k) = dn_per_e {
            figures["read_noise_e"] = json!(self.read_noise_e(dn_per_e));
            for (letter, channel) in &self.channels {
                let object = &mut figures["channels"][letter];
                object["read_noise_e"] = json!(in_electrons(channel.read_noise_dn, dn_per_e));
                object["dynamic_range_db"] = json!(channel.dynamic_range_db(k));
            }
        }
        figure::object(&figures)
    }
}

fn in_electrons(dn: Option<Value>, dn_per_e: Option<f64>) -> Option<Value> {
    Some(dn?.scaled(1.0 / dn_per_e?))
}

/// The dark stacks of a capture set, the shortest exposure first, which has least noise of the dark
/// current.
///
/// # Errors
/// No dark captures; those of [`of_capture`].
pub fn of_set(set: &CaptureSet) -> Result<Vec<(&Capture, DarkStack)>> {
    let mut darks: Vec<_> = set.with_role(Role::Dark).collect();
    darks.sort_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s));
    if darks.is_empty() {
        return Err(Error::input("no dark captures")
            .help("a capture of role = \"dark\" is a stack without light"));
    }
    darks.into_iter().map(|c| Ok((c, of_capture(set, c)?))).collect()
}

/// The stacks of [`of_set`] as a JSON object: at the top the first, and all of them as `darks`.
///
/// # Errors
/// None but a fault of the program.
pub fn json_of_set(
    darks: &[(&Capture, DarkStack)],
    dn_per_e: Option<f64>,
) -> Result<Map<String, Json>> {
    let one = |(capture, found): &(&Capture, DarkStack)| -> Result<_> {
        let mut one = found.json(dn_per_e)?;
        one.insert("id".into(), json!(capture.id));
        one.insert("exposure_s".into(), json!(capture.exposure_s));
        one.insert("analog_gain".into(), json!(capture.analog_gain));
        Ok(one)
    };
    let all = darks.iter().map(one).collect::<Result<Vec<_>>>()?;
    let mut top = darks.first().map_or(Ok(Map::new()), |(_, found)| found.json(dn_per_e))?;
    top.insert("darks".into(), json!(all));
    Ok(top)
}

/// Figures of one channel of a stack of dark frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DarkChannel {
    /// Mean, DN.
    pub offset_dn: Value,
    /// Temporal noise of a pixel without rounding, DN; `None` where rounding hides it.
    pub read_noise_dn: Option<Value>,
    /// Temporal variance, DN².
    #[serde(skip)]
    temporal_dn2: Value,
    /// Square of the step of the codes, DN².
    #[serde(skip)]
    step_dn2: f64,
    /// Signal at which the samples saturate, DN.
    #[serde(skip)]
    largest_dn: Value,
}

impl DarkChannel {
    /// Of the moments of a channel, its codes and its white level, DN.
    fn of(m: &Moments, codes: &Codes, white_dn: u16) -> Self {
        // A constant frame has no scatter; its mean is still uncertain by rounding.
        let floor = (codes.quantisation() / (m.pixels() * m.frames as f64)).sqrt();
        let offset_dn = Value::new(m.mean(), m.mean_error().max(floor));
        Self {
            offset_dn,
            read_noise_dn: read_noise(m, codes),
            temporal_dn2: Value::new(m.temporal, m.temporal_error),
            step_dn2: codes.square(),
            largest_dn: Value::new(f64::from(white_dn) - offset_dn.value, offset_dn.std_error),
        }
    }

    /// EMVA 1288's dynamic range, dB, of a converter that saturates at the white level, for the
    /// system gain K, DN/e⁻.
    #[must_use]
    pub fn dynamic_range_db(&self, dn_per_e: f64) -> Value {
        let gain = Value::new(dn_per_e, 0.0);
        let range = emva::dynamic_range(self.largest_dn, self.temporal_dn2, self.step_dn2, gain);
        emva::decibels(range)
    }
}

/// The channels of dark frames in memory, in the order of their pattern.
///
/// # Errors
/// Fewer than two frames, or frames of different sizes.
pub fn channels_of(frames: &[RawFrame]) -> Result<Vec<DarkChannel>> {
    let stack = Stack::of_frames(frames)?;
    if stack.frames < 2 {
        return Err(Error::input("noise is the difference between frames: two at least"));
    }
    let (codes, first) = (Codes::of([&stack.codes]), &frames[0]);
    let channels = 0..first.cfa.channels().len();
    let of = |c| DarkChannel::of(&stack.channel_moments(c), &codes, first.white_level_dn);
    Ok(channels.map(of).collect())
}

/// The figures of the frames in `files`, in order of time. The colour filter pattern is `cfa`,
/// otherwise that of the first file, otherwise monochrome.
///
/// # Errors
/// No file, files that cannot be read or differ in size, fewer than two frames, the same frame
/// twice.
pub fn of_files(files: &[PathBuf], cfa: Option<Cfa>) -> Result<DarkStack> {
    let first = files.first().ok_or_else(|| {
        Error::input("no frames").help("provide the files of one stack of dark frames")
    })?;
    let frames = camrig_formats::read(first).map_err(|e| e.at(first.display()))?;
    let facts = frames.facts;
    let (width, height) = frames.planes.first().map_or((0, 0), |p| (p.width, p.height));
    drop(frames.planes);
    let differences = differences(files, &facts);
    let bits = facts.bits.unwrap_or(MAX_BITS).min(MAX_BITS);
    let full_scale = ((1u32 << bits) - 1) as u16;
    let sensor = SensorFacts {
        width,
        height,
        bits,
        cfa: cfa.or(facts.cfa),
        black_level_dn: None,
        white_level_dn: facts.white_level_dn.unwrap_or(full_scale),
        pitch_um: None,
        window: None,
    };
    let capture = Capture::new(first.display().to_string(), Role::Dark, files.to_vec(), 0.0);
    let set = CaptureSet { root: PathBuf::new(), camera: None, sensor, captures: Vec::new() };
    let mut found = of_capture(&set, &capture)?;
    found.notes.extend(differences);
    Ok(found)
}

/// Conditions in which files of one stack differ from the first: a sentence for each, with the
/// first such file.
fn differences(files: &[PathBuf], first: &Facts) -> Vec<String> {
    type Condition = fn(&Facts) -> Option<String>;
    let kinds: [(&str, Condition); 4] = [
        ("exposure", |f| Some(format!("{} s", f.taken.exposure_s.as_ref()?.value))),
        ("gain", |f| Some(f.taken.analog_gain.as_ref()?.value.to_string())),
        ("pattern", |f| Some(f.cfa.as_ref()?.to_string())),
        ("black level", |f| Some(format!("{} DN", f.black_level_dn?))),
    ];
    let conditions = |facts: &Facts| kinds.map(|(_, of)| of(facts));
    let others: Vec<_> = files[1..]
        .par_iter()
        .filter_map(|file| Some((file, conditions(&open_with_facts(file).ok()?.1))))
        .collect();
    let difference = |(i, expected): (usize, Option<String>)| {
        let expected = expected?;
        let differs = |other: &Option<String>| other.as_ref().is_some_and(|o| *o != expected);
        let (file, found) = others.iter().find(|(_, found)| differs(&found[i]))?;
        Some(format!(
            "{} has another {} than the first file, {} instead of {expected}: frames of one stack \
             must have the same conditions",
            file.display(),
            kinds[i].0,
            found[i].as_deref().unwrap_or_default()
        ))
    };
    conditions(first).into_iter().enumerate().filter_map(difference).collect()
}

/// The figures of a dark stack of a capture set.
///
/// # Errors
/// Frames that cannot be read, fewer than two, the same frame twice.
pub fn of_capture(set: &CaptureSet, capture: &Capture) -> Result<DarkStack> {
    let stack = Stack::read(set, capture)?;
    if stack.frames < 2 {
        return Err(Error::input("one frame").at(format!("capture {:?}", capture.id)).help(
            "noise is the difference between frames: provide at least two, better sixteen",
        ));
    }
    copies::refuse(set, capture, &stack)?;
    let m = Moments::pool(&stack.moments);
    let codes = Codes::of([&stack.codes]);
    let mut notes: Vec<String> = codes.note().into_iter().collect();
    let lines = Lines::read(set, capture)?;
    let [row_noise_dn, column_noise_dn] = lines.noise(&stack, m.temporal);
    let fpn = m.spatial();
    if m.zeros > SATURATED_SHARE {
        notes.push(format!(
            "{:.2} % of the samples are 0: the dark is cut off there, so that the offset is too \
             high and the noise too low; raise the black level",
            100.0 * m.zeros
        ));
    }
    notes.extend(stack.cut_off.map(|cut_off| cut_off.note("the first frame")));
    if m.whites > SATURATED_SHARE {
        notes.push(format!("{:.2} % of the samples are at the white level", 100.0 * m.whites));
    }
    let read_noise_dn = read_noise(&m, &codes);
    if read_noise_dn.is_none() {
        notes.push(format!(
            "rounding hides the read noise, which is at most {:.2} DN (EMVA 1288 release 4.0, eq. 53); \
             raise the gain",
            (QUANTISATION_LIMITED * codes.square()).sqrt()
        ));
    }
    let of = |m: &Moments| DarkChannel::of(m, &codes, set.sensor.white_level_dn);
    let letters = set.cfa().channels();
    let channels = letters.iter().enumerate().map(|(c, letter)| {
        (letter.to_ascii_lowercase().to_string(), of(&stack.channel_moments(c)))
    });
    Ok(DarkStack {
        offset_dn: of(&m).offset_dn,
        read_noise_dn,
        channels: channels.collect(),
        row_noise_dn,
        column_noise_dn,
        row_fpn_dn: root(fpn.row),
        column_fpn_dn: root(fpn.column),
        code_step_dn: Value::new(codes.step_dn, 0.0),
        hot_pixels: hot_pixels(&stack),
        frames: stack.frames,
        notes,
    })
}

/// Temporal noise without rounding; `None` where rounding is not equivalent to added noise.
fn read_noise(m: &Moments, codes: &Codes) -> Option<Value> {
    if m.temporal < QUANTISATION_LIMITED * codes.square() {
        return None;
    }
    let spread = m.spatial().total.value.max(0.0);
    let guess = m.temporal - codes.quantisation();
    let variance = m.temporal - codes.rounding(guess, m.mean(), spread);
    Value::new(variance, m.temporal_error).sqrt()
}

/// The square root of a variance; where that is not positive, 0 with the error that a variance of
/// the size of its error would have.
fn root(variance: Value) -> Value {
    variance.sqrt().unwrap_or_else(|| Value::new(0.0, variance.std_error.max(0.0).sqrt()))
}

/// Means of the rows and columns of each frame, DN.
#[derive(Default)]
struct Lines {
    rows: Vec<Vec<f64>>,
    columns: Vec<Vec<f64>>,
}

impl Lines {
    fn read(set: &CaptureSet, capture: &Capture) -> Result<Self> {
        let mut lines = Self::default();
        set.for_each_batch(capture, |frames| {
            frames.iter().for_each(|frame| lines.add(frame));
            Ok(())
        })?;
        Ok(lines)
    }

    fn add(&mut self, frame: &Plane<u16>) {
        let mut columns = vec![0u64; frame.width];
        let row = |samples: &[u16]| {
            let sum: u64 = samples.iter().map(|v| u64::from(*v)).sum();
            sum as f64 / frame.width as f64
        };
        for samples in frame.data.chunks_exact(frame.width) {
            columns.iter_mut().zip(samples).for_each(|(sum, v)| *sum += u64::from(*v));
        }
        self.rows.push(frame.data.chunks_exact(frame.width).map(row).collect());
        self.columns.push(columns.iter().map(|s| *s as f64 / frame.height as f64).collect());
    }

    /// Temporal noise of rows and columns.
    fn noise(&self, stack: &Stack, temporal: f64) -> [Value; 2] {
        [(&self.rows, stack.width), (&self.columns, stack.height)].map(|(lines, pixels)| {
            let (variance, freedom) = scatter(lines);
            let pixels = pixels as f64;
            let excess = (variance - temporal / pixels) / (1.0 - 1.0 / pixels);
            root(Value::new(excess, variance * (2.0 / freedom).sqrt()))
        })
    }
}

/// Variance of lines over frames about their own and the frames' means, and its degrees of
/// freedom.
fn scatter(lines: &[Vec<f64>]) -> (f64, f64) {
    let (frames, count) = (lines.len(), lines[0].len());
    let of_line: Vec<f64> =
        (0..count).map(|i| lines.iter().map(|l| l[i]).sum::<f64>() / frames as f64).collect();
    let all = of_line.iter().sum::<f64>() / count as f64;
    let mut square = 0.0;
    for frame in lines {
        let of_frame = frame.iter().sum::<f64>() / count as f64;
        square += frame
            .iter()
            .zip(&of_line)
            .map(|(v, line)| (v - line - of_frame + all).powi(2))
            .sum::<f64>();
    }
    let freedom = ((frames - 1) * (count - 1)).max(1) as f64;
    (square / freedom, freedom)
}

/// Pixels whose mean lies more than [`HOT_SIGMAS`] above the median of their site.
fn hot_pixels(stack: &Stack) -> Value {
    let frames = stack.frames as f64;
    let mut count = 0usize;
    for (site, moments) in stack.sites.iter().zip(&stack.moments) {
        let (rows, columns) = (site.rows(stack.height), site.columns(stack.width));
        let places = (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j)));
        let mut sums: Vec<u32> = places
            .map(|(i, j)| {
                let (x, y) = (site.x0 + i * site.step_x, site.y0 + j * site.step_y);
                stack.sum[y * stack.width + x]
            })
            .collect();
        let middle = sums.len() / 2;
        let median = *sums.select_nth_unstable(middle).1;
        let mut away: Vec<u32> = sums.iter().map(|v| v.abs_diff(median)).collect();
        let spread = f64::from(*away.select_nth_unstable(middle).1) * SIGMA_OVER_MEDIAN;
        // Where most means are equal, noise and rounding still scatter them.
        let noise = ((moments.temporal + QUANTISATION) * frames).sqrt();
        let limit = f64::from(median) + HOT_SIGMAS * spread.max(noise);
        count += sums.iter().filter(|v| f64::from(**v) > limit).count();
    }
    Value::new(count as f64, (count as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_formats::{Format, Frames, npy};
    use rand_distr::{Distribution, Normal};
    use rand_xoshiro::{Xoshiro256PlusPlus, rand_core::SeedableRng};

    const SIZE: (usize, usize) = (64, 48);

    /// Figures of frames of `sample(frame, x, y)`; the last frame is in another file.
    fn figures(frames: usize, mut sample: impl FnMut(usize, usize, usize) -> f64) -> DarkStack {
        let folder = tempfile::tempdir().unwrap();
        let mut planes: Vec<Plane<u16>> = (0..frames)
            .map(|f| {
                Plane::from_fn(SIZE.0, SIZE.1, |x, y| sample(f, x, y).round().max(0.0) as u16)
            })
            .collect();
        let last = planes.split_off(frames - 1);
        let files: Vec<PathBuf> = [planes, last]
            .into_iter()
            .enumerate()
            .filter(|(_, planes)| !planes.is_empty())
            .map(|(i, planes)| {
                let path = folder.path().join(format!("{i}.npy"));
                let bytes = npy::encode(&Frames { planes, facts: Facts::default() }).unwrap();
                std::fs::write(&path, bytes).unwrap();
                path
            })
            .collect();
        of_files(&files, None).unwrap()
    }

    #[test]
    fn files_of_other_conditions_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let mut taken = 0;
        let mut file = |name: &str, black: f64, exposure: f64| {
            let mut facts = Facts { bits: Some(12), ..Facts::default() };
            (facts.cfa, facts.black_level_dn) = (Cfa::parse("RGGB").ok(), Some(black));
            facts.taken.exposure_s = Some(camrig_formats::Said::new(exposure, "a test"));
            let mut plane = || {
                taken += 1;
                Plane::from_fn(8, 6, |x, y| 60 + (x * y % (6 + taken)) as u16)
            };
            let planes = vec![plane(), plane()];
            let path = folder.path().join(name);
            std::fs::write(&path, Format::Pgm.encode(&Frames { planes, facts }).unwrap()).unwrap();
            path
        };
        let [a, b] = [file("a.pgm", 64.0, 0.01), file("b.pgm", 64.0, 0.01)];
        let notes = |files: &[PathBuf]| of_files(files, None).unwrap().notes;
        let conditions = |notes: Vec<String>| {
            notes.into_iter().filter(|note| note.contains("same conditions")).collect::<Vec<_>>()
        };
        assert_eq!(conditions(notes(&[a.clone(), b.clone()])), [""; 0]);
        let c = file("c.pgm", 100.0, 2.0);
        let found = conditions(notes(&[a, b, c]));
        assert_eq!(found.len(), 2, "{found:?}");
        let words = ["another exposure than the first file, 2 s instead of 0.01 s", "100 DN"];
        for (note, words) in found.iter().zip(words) {
            assert!(note.contains("c.pgm") && note.contains(words), "{note}");
        }
    }

    fn near(found: Value, truth: f64, most_sigmas: f64) {
        let off = (found.value - truth).abs();
        assert!(off < most_sigmas * found.std_error, "{found:?}, truth {truth}");
    }

    #[test]
    fn noise_of_pixels_rows_and_columns_is_recovered() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
        let mut normal = move |s: f64| Normal::new(0.0, s).unwrap().sample(&mut random);
        let mut row = 0.0;
        let found = figures(16, |_, x, _| {
            if x == 0 {
                row = normal(0.5);
            }
            100.2 + row + normal(4.0)
        });
        let read = found.read_noise_dn.unwrap();
        // 4.0 and the row's 0.5 together.
        near(read, 4.031, 4.0);
        assert!(read.std_error < 0.02, "{read:?}");
        assert!((found.offset_dn.value - 100.2).abs() < 0.1, "{:?}", found.offset_dn);
        near(found.row_noise_dn, 0.5, 4.0);
        assert!(found.column_noise_dn.value < 0.15, "{:?}", found.column_noise_dn);
        assert_eq!((found.code_step_dn.value, found.hot_pixels.value), (1.0, 0.0));
        assert_eq!((found.frames, found.notes.len()), (16, 0));
    }

    /// Noise of 0.6 DN: without subtraction of the 1/12 DN² of rounding it would be 0.666.
    #[test]
    fn rounding_is_subtracted_and_hides_small_noise() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(6);
        let mut normal = move |s: f64| Normal::new(0.0, s).unwrap().sample(&mut random);
        near(figures(16, |_, _, _| 20.3 + normal(0.6)).read_noise_dn.unwrap(), 0.6, 4.0);
        let hidden = figures(4, |_, _, _| 20.0 + normal(0.2));
        assert_eq!(hidden.read_noise_dn, None);
        assert!(hidden.notes[0].contains("at most 0.49 DN"), "{:?}", hidden.notes);
    }

    #[test]
    fn what_is_wrong_with_a_dark_is_said() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
        let mut normal = move |s: f64| Normal::new(0.0, s).unwrap().sample(&mut random);
        let cut = figures(4, |_, _, _| 2.0 + normal(3.0));
        assert!(cut.notes[0].contains("cut off"), "{:?}", cut.notes);
        let hot = figures(4, |_, x, y| {
            normal(1.0) + if (x, y) == (5, 7) || (x, y) == (40, 3) { 90.0 } else { 50.0 }
        });
        assert_eq!(hot.hot_pixels.value, 2.0);
    }

    /// Two files given twice: the variance of four frames would be two thirds of what it is.
    #[test]
    fn files_that_are_copies_are_refused_and_a_cut_off_dark_is_told() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(8);
        let mut normal = move |s: f64| Normal::new(0.0, s).unwrap().sample(&mut random);
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a.npy", "b.npy"].map(|name| {
            let planes = vec![Plane::from_fn(SIZE.0, SIZE.1, |_, _| (64.0 + normal(2.0)) as u16)];
            let bytes = npy::encode(&Frames { planes, facts: Facts::default() }).unwrap();
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        });
        assert!(of_files(&[a.clone(), b.clone()], None).is_ok());
        let error = of_files(&[a.clone(), b.clone(), a, b], None).unwrap_err().to_string();
        for part in ["frame 2 (", "a.npy) is a copy of frame 0 (", "keep one of each"] {
            assert!(error.contains(part), "{error}");
        }
        let cut = figures(4, |_, _, _| (64.0 + normal(2.0)).max(64.0));
        assert!(cut.notes[0].contains("are 64 DN"), "{:?}", cut.notes);
    }

    #[test]
    fn one_frame_has_no_noise() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.npy");
        let planes = vec![Plane::from_fn(16, 12, |x, _| x as u16)];
        let bytes = npy::encode(&Frames { planes, facts: Facts::default() }).unwrap();
        std::fs::write(&path, bytes).unwrap();
        let error = of_files(&[path], None).unwrap_err().to_string();
        assert!(error.contains("at least two"), "{error}");
        assert!(of_files(&[], None).is_err());
    }
}
