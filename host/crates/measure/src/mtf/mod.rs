//! Slanted-edge spatial frequency response (e-SFR) of one channel of a raw frame.
//!
//! The method of ISO 12233:2023 (e-SFR), on the channel's own samples without demosaicing:
//! 1. in each row, the edge's position is the centroid of the windowed derivative of the samples;
//! 2. a straight line through the rows' positions is the edge, or a cubic where it is bent by more
//!    than noise (lens distortion bends it; the standard allows up to the fifth order);
//! 3. samples are sorted by their distance from the edge along its normal into bins of a quarter
//!    of the channel's sample pitch: the oversampled edge spread function. A bin's value is the
//!    mean over the bin of the polygon through the samples, which does not depend on their
//!    clustering;
//! 4. its derivative by central differences, under a Tukey window (α = 1) centred on the edge, is
//!    the line spread function, whose Fourier transform's magnitude is the SFR;
//! 5. the SFR is divided by the transfer functions of the central difference (the standard's
//!    correction) and of averaging over a bin, and by the step's height including the tails that
//!    diffraction spreads beyond the region (the standard divides by the windowed height, which
//!    raises the SFR of small pixels at f/8 by some per cent).
//!
//! Before the first step, uneven light over the region is taken off: relative illumination and
//! shading, but neither the tails of diffraction nor any that end within the region (`trend.rs`).
//! So the response does not depend on the region's size.
//!
//! Two steps of the standard are done otherwise, as noise would pull the SFR down. The line is
//! fitted to all samples at once (`line.rs`): centroids of noisy rows scatter, and a line through
//! them blurs. Where noise is more than what lies in the tails, the window is narrower and the
//! height is that of the sides' means; the noise's own power is subtracted.
//!
//! Frequencies are in cycles per sensor pixel for every channel: the samples of a Bayer channel
//! are two pixels apart, but the bins are finer, so that its curve also extends beyond its own
//! Nyquist frequency. The standard error of a response is a jackknife over blocks of rows; that of
//! MTF50 is the response's, or what the noise of the sides gives if that is more, over the slope.
//!
//! For several frames of one edge, the edge spread functions are averaged: each relative to the
//! edge fitted in its frame, so that a camera that moves by a fraction of a pixel causes no blur,
//! and with its sides scaled to the mean levels, so that a flickering lamp has no effect.
//! [`find_edges`] finds the regions.

mod line;
mod search;
mod sfr;
mod trend;

pub use self::search::find_edges;

use self::line::EdgeLine;
use self::sfr::{Sfr, Spread};
use self::trend::Trend;
use super::rounding::QUANTISATION_LIMITED;
use camrig_base::Cfa;
use camrig_base::Value;
use camrig_base::median::{SD_PER_MAD, median};
use camrig_base::{Error, ErrorCode, Plane, Result};
use camrig_linear::moments;
use serde::Serialize;
use std::borrow::Borrow;

/// Bins per sample pitch of the channel (ISO 12233:2023).
const OVERSAMPLING: f64 = 4.0;

/// Fraction of the Tukey window that is tapered, half on each side (ISO 12233:2023).
const TUKEY_ALPHA: f64 = 1.0;

/// Robust standard deviations above which a sample is from a defective pixel: no Gaussian noise of
/// any region exceeds eight.
const DEFECT: f64 = 8.0;

/// Number of samples at similar distances from the edge with whose median a sample is compared:
/// enough for a robust median, few compared with the edge's width.
const NEIGHBOURS: usize = 11;

/// Blocks of rows for the jackknife: ten give its error to about a quarter.
const BLOCKS: usize = 10;
/// Smallest side of a region, pixels: the window needs ten on either side of the edge.
const MIN_SIDE: usize = 20;
/// Fewest samples of a row and fewest rows for a line through the rows' positions.
const MIN_SAMPLES: usize = 8;
const MIN_ROWS: usize = 10;
/// Smallest range of samples that can be an edge, DN: quantisation distorts a smaller step.
const MIN_RANGE_DN: f64 = 8.0;
/// Share of samples at the white level, or at 0 DN, from which a side counts as clipped.
const CLIPPED_SHARE: f64 = 0.005;
/// Share of a side's samples at its extreme value above which it is clipped, where the white level
/// is unknown: half of symmetric noise is beyond its mean, so clipping there or further in affects
/// at least as many samples.
const ONE_VALUE_SHARE: f64 = 0.5;
/// Smallest MTF50 over its standard error: with less, the interval of two standard errors reaches
/// to none.
const MIN_Z: f64 = 2.0;
/// Number of samples at similar distances from the edge of whose scatter the limit of defects is.
const ALIKE: usize = NEIGHBOURS * NEIGHBOURS;
/// Smallest deviation of a defect over the step: less does not move the response, and is what
/// rounding and uneven light leave where there is no noise.
const MIN_DEFECT: f64 = 0.02;

/// A rectangle of a frame, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Roi {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Direction in which a response is measured: across the edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Direction {
    /// Across an edge that is near the pixel columns.
    Horizontal,
    /// Across an edge that is near the pixel rows.
    Vertical,
}

impl Direction {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Horizontal => "horizontal",
            Self::Vertical => "vertical",
        }
    }
}

/// The response of one channel over one edge.
#[derive(Clone, Debug, Serialize)]
pub struct Edge {
    /// Channel letter, lower case.
    pub channel: String,
    /// Angle between the edge and the pixel columns (for a horizontal edge, the rows), degrees.
    pub angle_deg: f64,
    /// MTF50: frequency where the response falls to one half, cycles per pixel. Its standard error
    /// is that of the response over its slope, from the noise of the sides or from blocks of rows,
    /// or, for several frames, that from the frames: the largest of them.
    pub mtf50_cycles_per_pixel: Value,
    /// Standard deviation of MTF50 between frames, cycles per pixel; `None` for one frame.
    pub mtf50_frame_spread: Option<f64>,
    /// Number of frames.
    pub frames: usize,
    /// Region of the edge.
    pub roi: Roi,
    /// Direction across the edge.
    pub direction: Direction,
    /// Middle of the edge from the frame's centre, pixels: to the right and down.
    pub position: [f64; 2],
    /// Distance of it over half the frame's diagonal: field, 0 in the centre and 1 in a corner.
    pub field: f64,
    /// MTF50 in cycles per millimetre, where the pitch is known.
    pub mtf50_cycles_per_mm: Option<Value>,
    /// Response at 0.5 cycles per pixel; `None` where the curve ends before, as for sparsely
    /// sampled channels.
    pub mtf_at_nyquist: Option<Value>,
    /// (cycles per pixel, response) from 0 to 1 cycle per pixel, or as far as the samples allow.
    pub curve: Vec<[f64; 2]>,
    /// Standard error of each response of the curve.
    #[serde(skip)]
    pub curve_std_error: Vec<f64>,
    /// Edge spread function: (distance from the edge, pixels; DN).
    #[serde(skip)]
    pub spread: Vec<[f64; 2]>,
    /// Mean DN on the two sides of the edge, dark first.
    pub levels_dn: [f64; 2],
}

/// Measures one channel (its letter in upper case) over an edge in a region of a frame.
///
/// # Errors
/// A region outside the frame or too small, no edge in it, an edge that leaves it, is parallel to
/// the pixel grid, or is clipped at either level.
pub fn measure(
    frame: &Plane<u16>,
    cfa: &Cfa,
    channel: char,
    roi: Roi,
    white_level_dn: Option<u16>,
    pitch_um: Option<f64>,
) -> Result<Edge> {
    measure_frames(&[(frame, white_level_dn)], cfa, channel, roi, pitch_um)
}

/// What [`edges`] finds.
#[derive(Clone, Debug, Serialize)]
pub struct Responses {
    /// Channels that have a response, region by region.
    pub edges: Vec<Edge>,
    /// Those that have none.
    pub excluded: Vec<Excluded>,
}

/// A channel without a response in a region.
#[derive(Clone, Debug, Serialize)]
pub struct Excluded {
    /// Channel letter, lower case.
    pub channel: String,
    /// Region.
    pub roi: Roi,
    /// Why it has none.
    pub reason: String,
}

/// The edges of frames in each of `channels`: in `regions`, or, where none is given, wherever the
/// first frame has some.
///
/// # Errors
/// No frame; where no channel has an edge, the first reason of those of [`measure_frames`] in a
/// given region.
pub fn edges(
    frames: &[(Plane<u16>, Option<u16>)],
    cfa: &Cfa,
    channels: &[char],
    regions: &[Roi],
    pitch_um: Option<f64>,
) -> Result<Responses> {
    let (first, white) =
        frames.first().ok_or_else(|| Error::input("no frames").help("provide one or more"))?;
    let searched = match (regions, channels) {
        ([], [some, ..]) => {
            let green = if channels.contains(&'G') { 'G' } else { *some };
            find_edges(first, cfa, green, *white)
        }
        _ => Vec::new(),
    };
    let (mut edges, mut excluded, mut first_error) = (Vec::new(), Vec::new(), None);
    for &roi in regions.iter().chain(&searched) {
        for &channel in channels {
            match measure_frames(frames, cfa, channel, roi, pitch_um) {
                Ok(edge) => edges.push(edge),
                Err(e) => {
                    excluded.push(Excluded {
                        channel: channel.to_ascii_lowercase().to_string(),
                        roi,
                        reason: e.what().to_owned(),
                    });
                    let Roi { x, y, width, height } = roi;
                    first_error.get_or_insert(match regions.len() {
                        1 => e.at(format!("channel {channel}")),
                        _ => e.at(format!("channel {channel}, region {x},{y},{width},{height}")),
                    });
                }
            }
        }
    }
    match first_error {
        Some(e) if edges.is_empty() && !regions.is_empty() => Err(e),
        _ if edges.is_empty() => Err(Error::input("no slanted edge found")
            .help("give the region of an edge, and the reason is reported")),
        _ => Ok(Responses { edges, excluded }),
    }
}

/// [`measure`] over several frames of one edge, each with its white level, DN, where that is known.
/// They may move by less than the region's margin and change in brightness between them.
///
/// # Errors
/// Those of [`measure`] of any frame, no frame, frames of different sizes, an edge that turns or
/// changes its sides from one frame to another.
pub fn measure_frames(
    frames: &[(impl Borrow<Plane<u16>>, Option<u16>)],
    cfa: &Cfa,
    channel: char,
    roi: Roi,
    pitch_um: Option<f64>,
) -> Result<Edge> {
    let frames: Vec<(&Plane<u16>, Option<u16>)> =
        frames.iter().map(|(frame, white)| (frame.borrow(), *white)).collect();
    let trend = trend(&frames, cfa, channel, roi);
    let numbered = |(i, &(frame, white)): (usize, &(&Plane<u16>, Option<u16>))| {
        let found =
            find(frame, cfa, channel, roi, white).and_then(|found| found.without(trend.as_ref()));
        found.map_err(|e| if frames.len() > 1 { e.at(format!("frame {i}")) } else { e })
    };
    let found: Vec<Found> = frames.iter().enumerate().map(numbered).collect::<Result<_>>()?;
    let first =
        found.first().ok_or_else(|| Error::input("no frames").help("provide one or more"))?;
    check_same_edge(&frames, &found)?;
    let edges = Edges::new(&found)?;
    let sfr = edges.response(None)?;
    let mtf50 = sfr.crossing(0.5).ok_or_else(|| {
        let end = sfr.curve.last().map_or(0.0, |p| p[0]);
        Error::input(format!("the response does not fall to one half below {end:.2} cycles/pixel"))
            .help("check that this is an image of an edge; noise has such a response")
    })?;
    // Jackknife: leave out one block of rows at a time.
    let parts: Vec<Sfr> =
        (0..BLOCKS).filter_map(|block| edges.response(Some(block)).ok()).collect();
    let error_at = |f: f64| jackknife(&parts.iter().filter_map(|s| s.at(f)).collect::<Vec<_>>());
    // A crossing that noise makes too low lies where there is less noise than where it should be.
    let frequency = sfr.fitted.max(mtf50);
    let by_noise = sfr.error_at_half(frequency).max(error_at(frequency)) / sfr.fall(mtf50);
    let mtf50_frame_spread = edges.frame_spread()?;
    let between = mtf50_frame_spread.map_or(0.0, |s| s / (frames.len() as f64).sqrt());
    let rounded = edges.rounding(&sfr, mtf50);
    let mtf50 = Value::new(mtf50, libm::hypot(by_noise.max(between), rounded));
    if mtf50.z() < MIN_Z {
        return Err(Error::input(
            "noise hides the response: MTF50 is less than two standard errors from none",
        )
        .help("use more light, a larger region or more frames"));
    }
    let size = frames[0].0;
    let half = [size.width, size.height].map(|side| 0.5 * side as f64);
    let (across, along) = first.line.centre();
    let place = if first.near_rows { [along, across] } else { [across, along] };
    // Pixel centres are whole numbers, the frame's centre lies between them.
    let position = [place[0] + 0.5 - half[0], place[1] + 0.5 - half[1]];
    Ok(Edge {
        channel: channel.to_ascii_lowercase().to_string(),
        angle_deg: libm::atan(first.line.slope_at_middle()).to_degrees(),
        mtf50_cycles_per_pixel: mtf50,
        mtf50_frame_spread,
        frames: frames.len(),
        roi,
        direction: if first.near_rows { Direction::Vertical } else { Direction::Horizontal },
        position,
        field: libm::hypot(position[0], position[1]) / libm::hypot(half[0], half[1]),
        mtf50_cycles_per_mm: pitch_um.map(|p| mtf50.scaled(1e3 / p)),
        mtf_at_nyquist: sfr.at(0.5).map(|v| Value::new(v, error_at(0.5))),
        curve_std_error: sfr.curve.iter().map(|p| error_at(p[0])).collect(),
        curve: sfr.curve,
        spread: sfr.spread,
        levels_dn: edges.levels,
    })
}

/// Refuses frames of different edges.
fn check_same_edge(frames: &[(&Plane<u16>, Option<u16>)], found: &[Found]) -> Result<()> {
    let size = |f: &(&Plane<u16>, Option<u16>)| (f.0.width, f.0.height);
    let first = &found[0];
    for (i, (frame, one)) in frames.iter().zip(found).enumerate() {
        let what = if size(frame) != size(&frames[0]) {
            "of another size than the first"
        } else if one.near_rows != first.near_rows || one.line.rises != first.line.rises {
            "with another edge in the region than the first"
        } else {
            continue;
        };
        return Err(Error::disagreement(format!("a frame {what}"))
            .at(format!("frame {i}"))
            .help("frames of one edge, taken one after another, are averaged"));
    }
    Ok(())
}

/// One edge in several frames.
struct Edges<'a> {
    found: &'a [Found],
    /// Distance from the edge that every frame reaches, pixels.
    reach: f64,
    /// Mean levels of the sides, dark first, DN.
    levels: [f64; 2],
    /// Half width of the window, pixels.
    window: f64,
}

impl<'a> Edges<'a> {
    /// Error of a frequency by rounding where no noise blurs it: the last half DN of each side's
    /// tail is lost, which is 1 DN of the step, and moves the response by as much.
    fn rounding(&self, sfr: &Sfr, frequency: f64) -> f64 {
        /// Steps of the slope, cycles per pixel.
        const BESIDE: f64 = 0.01;
        let first = &self.found[0];
        let sides = far_sides(&first.rows, &first.line, self.reach);
        let blurred = sides.iter().all(|side| side.variance >= QUANTISATION_LIMITED);
        let (below, above) = (sfr.at(frequency - BESIDE), sfr.at(frequency + BESIDE));
        let (false, Some(below), Some(above)) = (blurred, below, above) else { return 0.0 };
        let slope = (above - below) / (2.0 * BESIDE);
        (1.0 / (sides[1].mean - sides[0].mean) / slope).abs()
    }

    fn new(found: &'a [Found]) -> Result<Self> {
        let reach = found.iter().map(|f| Spread::reach(&f.rows, &f.line));
        let mean = |side: usize| {
            found.iter().map(|f| f.line.levels[side]).sum::<f64>() / found.len() as f64
        };
        let reach = reach.fold(f64::INFINITY, f64::min);
        let mut edges = Self { found, reach, levels: [mean(0), mean(1)], window: reach };
        edges.window = edges.mean_spread(None)?.window()?;
        Ok(edges)
    }

    /// The edge spread function of a frame about its own edge, its sides at the mean levels.
    fn spread(&self, frame: &Found, without: Option<usize>) -> Result<Spread> {
        let mut spread = Spread::of(&frame.rows, &frame.line, frame.step, self.reach, without)?;
        let ([dark, bright], [own_dark, own_bright]) = (self.levels, frame.line.levels);
        if self.found.len() > 1 {
            let factor = (bright - dark) / (own_bright - own_dark);
            spread.dn.iter_mut().for_each(|dn| *dn = dark + factor * (*dn - own_dark));
        }
        Ok(spread)
    }

    /// The edge spread function of all frames without a block of rows.
    fn mean_spread(&self, without: Option<usize>) -> Result<Spread> {
        let spreads = self.found.iter().map(|frame| self.spread(frame, without));
        Ok(Spread::mean(&spreads.collect::<Result<Vec<_>>>()?))
    }

    /// The response of all frames without a block of rows.
    fn response(&self, without: Option<usize>) -> Result<Sfr> {
        Sfr::of(&self.mean_spread(without)?, self.window)
    }

    /// Standard deviation of the frames' own MTF50, cycles per pixel; `None` of one frame.
    fn frame_spread(&self) -> Result<Option<f64>> {
        if self.found.len() < 2 {
            return Ok(None);
        }
        let own = |frame| Ok(Sfr::of(&self.spread(frame, None)?, self.window)?.crossing(0.5));
        let own: Vec<Option<f64>> = self.found.iter().map(own).collect::<Result<_>>()?;
        let own: Vec<f64> = own.into_iter().flatten().collect();
        Ok((own.len() > 1).then(|| moments(&own).1.sqrt()))
    }
}

/// Standard error from values that each leave out one block.
fn jackknife(values: &[f64]) -> f64 {
    let b = values.len() as f64;
    let mean = values.iter().sum::<f64>() / b;
    ((b - 1.0) / b * values.iter().map(|f| (f - mean).powi(2)).sum::<f64>()).sqrt()
}

/// The response of one channel at some frequencies, with its predicted standard errors.
#[derive(Clone, Debug)]
pub struct Response {
    /// Response at each frequency.
    pub at: Vec<Value>,
    /// Mean of the two sides, dark side first, DN.
    pub levels_dn: [Value; 2],
}

/// The response of one channel (its letter in upper case) of a frame, or of a mean of frames, at
/// `frequencies` (cycles per pixel), relative to the difference of the two sides' means. It has
/// less noise than [`measure`], which takes the step's height from its ends, and is comparable
/// between edges of the same lens and light.
/// Samples of defective pixels are excluded.
///
/// # Errors
/// Those of [`measure`], and a frequency beyond the end of the curve.
pub fn response<T: Copy + Into<f64>>(
    frame: &Plane<T>,
    cfa: &Cfa,
    channel: char,
    roi: Roi,
    white_level_dn: Option<u16>,
    frequencies: &[f64],
) -> Result<Response> {
    let found = find(frame, cfa, channel, roi, white_level_dn)?;
    let trend = found.trend();
    let Found { rows, step, line, .. } = found.without(trend.as_ref())?;
    let spread = Spread::of(&rows, &line, step, Spread::reach(&rows, &line), None)?;
    let sfr = Sfr::of(&spread, spread.half())?;
    let [dark, bright] = far_sides(&rows, &line, sfr.half);
    let difference = bright.mean - dark.mean;
    let samples = rows.iter().map(Vec::len).sum::<usize>() as f64;
    let at = |&f: &f64| {
        let response = sfr.at(f).ok_or_else(|| {
            Error::unsupported(format!("the samples do not show {f} cycles/pixel"))
                .help("use a channel whose samples are closer together")
        })?;
        let own = sfr.height.abs() / difference;
        Ok(Value::new(response * own, sfr.noise(f).sqrt() * own))
    };
    Ok(Response {
        at: frequencies.iter().map(at).collect::<Result<_>>()?,
        // The far halves of the sides are half of the samples.
        levels_dn: [dark, bright]
            .map(|side| Value::new(side.mean, (4.0 * side.variance / samples).sqrt())),
    })
}

/// Excludes samples that differ from the median of samples at the same distance from the edge by
/// more than [`DEFECT`] robust standard deviations of those thereabouts.
fn exclude_defects(rows: &mut Rows, line: &EdgeLine) {
    let distance =
        |s: &Sample| (s.across - line.at(s.along)) / libm::hypot(line.slope(s.along), 1.0);
    let mut sorted: Vec<(f64, f64)> =
        rows.iter().flatten().map(|s| (distance(s), s.value)).collect();
    if sorted.len() < NEIGHBOURS {
        return;
    }
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let around = |i: usize| {
        let first = i.saturating_sub(NEIGHBOURS / 2).min(sorted.len() - NEIGHBOURS);
        let mut values: Vec<f64> = sorted[first..first + NEIGHBOURS].iter().map(|s| s.1).collect();
        median(&mut values, f64::total_cmp)
    };
    let local: Vec<f64> = (0..sorted.len()).map(around).collect();
    let least = MIN_DEFECT * (line.levels[1] - line.levels[0]);
    let limits: Vec<f64> = (0..sorted.len())
        .step_by(ALIKE)
        .map(|first| {
            let last = sorted.len().min(first + ALIKE);
            let mut off: Vec<f64> =
                (first..last).map(|i| (sorted[i].1 - local[i]).abs()).collect();
            (DEFECT * SD_PER_MAD * median(&mut off, f64::total_cmp)).max(least)
        })
        .collect();
    let is_sound = |s: &Sample| {
        let d = distance(s);
        let i = sorted.partition_point(|other| other.0 < d).min(sorted.len() - 1);
        (s.value - local[i]).abs() <= limits[i / ALIKE]
    };
    rows.iter_mut().for_each(|row| row.retain(is_sound));
    rows.retain(|r| r.len() >= MIN_SAMPLES);
}

/// The samples of a side of the edge.
#[derive(Clone, Copy)]
struct Side {
    /// DN.
    mean: f64,
    /// DN².
    variance: f64,
}

/// The outer half of each side, dark side first.
fn far_sides(rows: &Rows, line: &EdgeLine, half: f64) -> [Side; 2] {
    let mut sides = [(0.0, 0.0, 0.0); 2];
    for row in rows {
        let place = line.at(row[0].along);
        let cos = 1.0 / libm::hypot(line.slope(row[0].along), 1.0);
        for s in row {
            let distance = (s.across - place) * cos;
            if distance.abs() > 0.5 * half {
                let side = &mut sides[usize::from(distance > 0.0)];
                *side = (side.0 + 1.0, side.1 + s.value, side.2 + s.value * s.value);
            }
        }
    }
    let mut out = sides.map(|(n, sum, square)| {
        let mean: f64 = sum / n;
        Side { mean, variance: (square / n - mean * mean).max(0.0) }
    });
    out.sort_by(|a, b| a.mean.total_cmp(&b.mean));
    out
}

/// An edge found in a region of a frame.
struct Found {
    /// Samples in rows across the edge.
    rows: Rows,
    /// Mean distance between neighbouring samples of a row, pixels.
    step: f64,
    line: EdgeLine,
    /// Whether the edge is near the pixel rows.
    near_rows: bool,
}

/// The edge in a region.
fn find<T: Copy + Into<f64>>(
    frame: &Plane<T>,
    cfa: &Cfa,
    channel: char,
    roi: Roi,
    white_level_dn: Option<u16>,
) -> Result<Found> {
    if roi.x + roi.width > frame.width || roi.y + roi.height > frame.height {
        return Err(Error::input(format!(
            "region {},{},{},{} is not inside the frame of {} x {}",
            roi.x, roi.y, roi.width, roi.height, frame.width, frame.height
        ))
        .help("give column, row, width and height in pixels")
        .with_code(ErrorCode::RegionOutside));
    }
    if roi.width.min(roi.height) < MIN_SIDE {
        return Err(Error::input(format!("region of {} x {} pixels", roi.width, roi.height))
            .help("an edge needs 20 pixels or more each way; 60 x 100 is good"));
    }
    let mut rows = collect(frame, cfa, channel, roi);
    if rows.iter().all(Vec::is_empty) {
        return Err(Error::input(format!("no channel {channel:?} in pattern {cfa}"))
            .help("use one of the pattern's letters"));
    }
    check_clipping(&rows, white_level_dn)?;
    let near_rows = is_near_rows(&rows);
    if near_rows {
        rows = transpose(&rows, roi);
    }
    rows.retain(|r| r.len() >= MIN_SAMPLES);
    if rows.len() < MIN_ROWS {
        return Err(Error::input("fewer than 10 rows of samples across the edge"));
    }
    let step = step(&rows);
    let line = EdgeLine::find(&rows, step)?;
    check_sides(&rows, &line)?;
    Ok(Found { rows, step, line, near_rows })
}

impl Found {
    fn trend(&self) -> Option<Trend> {
        let mut rows = self.rows.clone();
        exclude_defects(&mut rows, &self.line);
        Trend::of(&rows, &self.line, self.step, Spread::reach(&self.rows, &self.line))
    }

    /// The edge without a trend of its sides and without samples of defective pixels.
    fn without(mut self, trend: Option<&Trend>) -> Result<Self> {
        if let Some(trend) = trend {
            trend.take_off(&mut self.rows, &self.line);
        }
        exclude_defects(&mut self.rows, &self.line);
        self.line = EdgeLine::find(&self.rows, self.step)?;
        fill_tails(&mut self.rows, &self.line);
        Ok(self)
    }
}

/// The trend of the mean of frames, whose noise hides less of it than that of one; none where that
/// shows no edge, as of frames that are refused later.
fn trend(
    frames: &[(&Plane<u16>, Option<u16>)],
    cfa: &Cfa,
    channel: char,
    roi: Roi,
) -> Option<Trend> {
    let (first, _) = frames.first()?;
    let mut mean = Plane::filled(first.width, first.height, 0.0);
    for (frame, _) in frames {
        let sum = mean.data.iter_mut().zip(&frame.data);
        sum.for_each(|(m, v)| *m += f64::from(*v) / frames.len() as f64);
    }
    find(&mean, cfa, channel, roi, None).ok()?.trend()
}

/// Mean distance between neighbouring samples of the rows, pixels: patterns such as X-Trans have
/// several in one row, and other rows have others.
fn step(rows: &Rows) -> f64 {
    let span = |row: &Vec<Sample>| row[row.len() - 1].across - row[0].across;
    let gaps = rows.iter().map(|row| row.len() - 1).sum::<usize>();
    rows.iter().map(span).sum::<f64>() / gaps as f64
}

/// A sample: position across and along the edge, pixels, and value, DN.
#[derive(Clone, Copy, Debug)]
struct Sample {
    across: f64,
    along: f64,
    value: f64,
}

type Rows = Vec<Vec<Sample>>;

fn collect<T: Copy + Into<f64>>(frame: &Plane<T>, cfa: &Cfa, channel: char, roi: Roi) -> Rows {
    (roi.y..roi.y + roi.height)
        .map(|y| {
            (roi.x..roi.x + roi.width)
                .filter(|&x| cfa.letter(x, y) == channel)
                .map(|x| Sample {
                    across: x as f64,
                    along: y as f64,
                    value: frame.at(x, y).into(),
                })
                .collect()
        })
        .collect()
}

fn transpose(rows: &Rows, roi: Roi) -> Rows {
    let mut columns: Rows = vec![Vec::new(); roi.width];
    for s in rows.iter().flatten() {
        let turned = Sample { across: s.along, along: s.across, value: s.value };
        columns[s.across as usize - roi.x].push(turned);
    }
    columns
}

/// Whether the signal changes more from row to row than along the rows.
fn is_near_rows(rows: &Rows) -> bool {
    let half_mean =
        |part: &[Sample]| part.iter().map(|s| s.value).sum::<f64>() / part.len().max(1) as f64;
    let filled: Vec<&Vec<Sample>> = rows.iter().filter(|r| !r.is_empty()).collect();
    let mid = filled.len() / 2;
    let mean_of = |rows: &[&Vec<Sample>]| {
        rows.iter().map(|r| half_mean(r)).sum::<f64>() / rows.len().max(1) as f64
    };
    let down = (mean_of(&filled[..mid]) - mean_of(&filled[mid..])).abs();
    let across: f64 = filled
        .iter()
        .map(|r| half_mean(&r[..r.len() / 2]) - half_mean(&r[r.len() / 2..]))
        .sum::<f64>()
        / filled.len().max(1) as f64;
    down > across.abs()
}

/// Refuses a region without contrast, and one with samples at the white level or at 0 DN.
fn check_clipping(rows: &Rows, white: Option<u16>) -> Result<()> {
    let values = || rows.iter().flatten().map(|s| s.value);
    let low = values().fold(f64::INFINITY, f64::min);
    let high = values().fold(f64::NEG_INFINITY, f64::max);
    let n = values().count() as f64;
    let at_white =
        white.map_or(0.0, |w| values().filter(|v| *v >= f64::from(w)).count() as f64 / n);
    let at_zero = values().filter(|v| *v == 0.0).count() as f64 / n;
    if high - low < MIN_RANGE_DN && at_white <= CLIPPED_SHARE {
        return Err(Error::input(format!("no edge: all samples lie within {} DN", high - low))
            .help("choose a region across a dark and a bright area"));
    }
    if at_white > CLIPPED_SHARE {
        return Err(clipped(true, high, at_white, "the samples"));
    }
    if at_zero > CLIPPED_SHARE {
        return Err(clipped(false, low, at_zero, "the samples"));
    }
    Ok(())
}

/// Refuses an edge with one side at one extreme value, and noise on the other: it is clipped at an
/// unknown level. Without noise, neighbouring samples have the same value on both.
fn check_sides(rows: &Rows, line: &EdgeLine) -> Result<()> {
    let is_of = |bright: bool| {
        let after = bright == line.rises;
        move |s: &&Sample| (s.across > line.at(s.along)) == after
    };
    // Share of neighbours of equal values.
    let stillness = |bright: bool| {
        let of_row = |row: &Vec<Sample>| {
            let side: Vec<&Sample> = row.iter().filter(is_of(bright)).collect();
            let equal = side.windows(2).filter(|two| two[0].value == two[1].value).count();
            (equal, side.len().saturating_sub(1))
        };
        let (equal, all) =
            rows.iter().map(of_row).fold((0, 0), |sum, row| (sum.0 + row.0, sum.1 + row.1));
        equal as f64 / all.max(1) as f64
    };
    for bright in [false, true] {
        let side = rows.iter().flatten().filter(is_of(bright));
        let values: Vec<f64> = side.map(|s| s.value).collect();
        let further = if bright { f64::max } else { f64::min };
        let Some(extreme) = values.iter().copied().reduce(further) else { continue };
        let share = values.iter().filter(|v| **v == extreme).count() as f64 / values.len() as f64;
        if share > ONE_VALUE_SHARE && stillness(!bright) < ONE_VALUE_SHARE {
            return Err(clipped(bright, extreme, share, "its samples"));
        }
    }
    Ok(())
}

/// Replaces samples of the last DN of each side of an edge without noise. A code leaves half a DN
/// open on both sides, in which a whole tail may lie: of a level L at the border of two codes, the
/// first change of codes is far out in the tail, and the step looks a DN too high. The blurred step
/// of height H that fits best says where in its code the level is, L = c + 1/2 − H Φ(u) with the
/// first change of codes from c on at u blurs, and where in theirs the samples are.
fn fill_tails(rows: &mut Rows, line: &EdgeLine) {
    let sides = far_sides(rows, line, Spread::reach(rows, line));
    let codes = rows.iter().flatten().all(|s| s.value.fract() == 0.0);
    if !codes || sides.iter().any(|side| side.variance >= QUANTISATION_LIMITED) {
        return;
    }
    let to_bright = if line.rises { 1.0 } else { -1.0 };
    let blurs = |s: &Sample| {
        let across = (s.across - line.at(s.along)) / libm::hypot(line.slope(s.along), 1.0);
        to_bright * across / line.blur
    };
    let risen = |u: f64| 0.5 * libm::erfc(-u * std::f64::consts::FRAC_1_SQRT_2);
    let samples = || rows.iter().flatten();
    let dark = samples().map(|s| s.value).fold(f64::INFINITY, f64::min);
    let bright = samples().map(|s| s.value).fold(f64::NEG_INFINITY, f64::max);
    let first = samples().filter(|s| s.value > dark).map(blurs).fold(f64::INFINITY, f64::min);
    let last = samples().filter(|s| s.value < bright).map(blurs).fold(f64::NEG_INFINITY, f64::max);
    let height = bright - dark;
    let low = (dark + 0.5 - height * risen(first)).max(dark - 0.5);
    let high = (bright - 0.5 + height * risen(-last)).min(bright + 0.5);
    for s in rows.iter_mut().flatten() {
        let expected = low + (high - low) * risen(blurs(s));
        if expected - low < 1.0 || high - expected < 1.0 {
            s.value = expected.clamp(s.value - 0.5, s.value + 0.5);
        }
    }
}

/// The error for a side whose level is cut off at `dn` in a `share` of some samples.
fn clipped(bright: bool, dn: f64, share: f64, of: &str) -> Error {
    let (side, remedy) = match bright {
        true => ("bright", "expose less"),
        false => ("dark", "raise the black level or the light"),
    };
    Error::input(format!("the {side} side is clipped at {dn} DN ({:.0} % of {of})", 100.0 * share))
        .help(format!("{remedy}: a clipped edge has no true response"))
}

#[cfg(test)]
mod tests;
