//! Signals of the regions of 11 x 11 pixels that the experiment reads.

use crate::Value;
use crate::rounding::QUANTISATION;
use crate::stack::Stack;
use camrig_base::{Error, Result};
use camrig_captures::{Capture, CaptureSet, Role, Rotation};

/// Side of a region, pixels (Chen et al. 2009, section IV-C).
const REGION: usize = 11;

/// Positions and wavelengths that differ by less than this are the same: the rounding of decimals
/// in a manifest.
pub const SAME: f64 = 1e-6;

/// Mean over the frames, DN, and variance of that mean, DN², of every pixel of a region.
type Pixels = Vec<(f64, f64)>;

/// The dark signal of the sensor.
#[non_exhaustive]
pub enum Black {
    /// Windows at the points, each with its own dark.
    Windows(Vec<(Rotation, Pixels)>),
    /// A dark of the whole sensor.
    Frame(Stack),
    /// One level per channel.
    Level(Vec<Value>),
}

impl Black {
    /// The dark of every pixel where the set has it, else the mean of a dark, else the nominal
    /// level.
    ///
    /// # Errors
    /// Neither darks nor a nominal level.
    pub fn of(set: &CaptureSet) -> Result<Self> {
        let darks = || set.with_role(Role::Dark);
        let windows: Vec<_> = darks().filter_map(|c| Some((c, c.rotation?))).collect();
        if !windows.is_empty() {
            let of_point = |(capture, rotation): &(&Capture, Rotation)| {
                Ok((*rotation, pixels(set, capture, corner(set, rotation))?))
            };
            return windows.iter().map(of_point).collect::<Result<_>>().map(Self::Windows);
        }
        let channels = set.cfa().channels().len();
        match (darks().next(), set.sensor.black_level_dn) {
            (Some(dark), _) => {
                let stack = Stack::read(set, dark)?;
                let of_window = |c: &Capture| c.rotation.is_some_and(|r| r.window);
                if !set.with_role(Role::Rotation).any(of_window) {
                    return Ok(Self::Frame(stack));
                }
                let level = |c| {
                    let m = stack.channel_moments(c);
                    Value::new(
                        m.mean(),
                        libm::hypot(m.mean_error(), (m.plane.measured / m.pixels()).sqrt()),
                    )
                };
                Ok(Self::Level((0..channels).map(level).collect()))
            }
            (None, Some(black)) => Ok(Self::Level(vec![Value::new(black, 0.0); channels])),
            (None, None) => Err(Error::input("neither dark captures nor black_level_dn")
                .help("signals are ratios above black: add a capture of role = \"dark\"")),
        }
    }

    /// The dark of a region's pixels, and the error common to all pixels of each channel.
    fn under(&self, set: &CaptureSet, rotation: &Rotation) -> Result<(Pixels, Vec<f64>)> {
        let cfa = set.cfa();
        let channels = cfa.channels().len();
        let (left, top) = corner(set, rotation);
        let places = || (0..REGION * REGION).map(|k| (left + k % REGION, top + k / REGION));
        Ok(match self {
            Self::Windows(windows) => {
                let here = |w: &&(Rotation, Pixels)| {
                    (w.0.x - rotation.x).abs() < SAME && (w.0.y - rotation.y).abs() < SAME
                };
                let dark = windows.iter().find(here).ok_or_else(|| {
                    Error::input(format!("no dark capture at ({}, {})", rotation.x, rotation.y))
                        .help("give every point its dark, or one dark without [capture.rotation]")
                })?;
                (dark.1.clone(), vec![0.0; channels])
            }
            Self::Frame(stack) => {
                let noise: Vec<f64> = (0..channels)
                    .map(|c| stack.channel_moments(c).temporal / stack.frames as f64)
                    .collect();
                let of = |(x, y)| (stack.mean_at(x, y), noise[cfa.channel(x, y)]);
                (places().map(of).collect(), vec![0.0; channels])
            }
            Self::Level(levels) => {
                let of = |(x, y)| (levels[cfa.channel(x, y)].value, 0.0);
                (places().map(of).collect(), levels.iter().map(|l| l.std_error).collect())
            }
        })
    }
}

/// Mean above black of every channel over the region of a capture, DN. Its error includes temporal
/// noise and PRNU, from the scatter between the pixels.
///
/// # Errors
/// Frames smaller than a region, a saturated region, no dark for it.
pub fn signals(
    set: &CaptureSet,
    capture: &Capture,
    rotation: &Rotation,
    black: &Black,
) -> Result<Vec<Value>> {
    let place = |e: Error| e.at(format!("capture {:?}", capture.id));
    let cfa = set.cfa();
    let (left, top) = corner(set, rotation);
    let lit = pixels(set, capture, (left, top)).map_err(place)?;
    let (dark, common) = black.under(set, rotation).map_err(place)?;
    let of_channel = |channel: usize| {
        let of: Vec<(f64, f64)> = (0..REGION * REGION)
            .filter(|k| cfa.channel(left + k % REGION, top + k / REGION) == channel)
            .map(|k| (lit[k].0 - dark[k].0, lit[k].1 + dark[k].1))
            .collect();
        let n = of.len() as f64;
        let mean = of.iter().map(|p| p.0).sum::<f64>() / n;
        // The scatter of the pixels' means contains PRNU and temporal noise.
        let scatter = of.iter().map(|p| (p.0 - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let temporal = of.iter().map(|p| p.1).sum::<f64>() / n;
        Value::new(mean, libm::hypot((scatter.max(temporal) / n).sqrt(), common[channel]))
    };
    Ok((0..common.len()).map(of_channel).collect())
}

/// Top-left pixel of the region of a point.
fn corner(set: &CaptureSet, rotation: &Rotation) -> (usize, usize) {
    let start = |u: f64, side: usize| {
        let middle = if rotation.window { 0.5 } else { 0.5 * (u + 1.0) };
        let free = side.saturating_sub(REGION) as f64;
        (middle * side as f64 - 0.5 * REGION as f64).clamp(0.0, free) as usize
    };
    (start(rotation.x, set.sensor.width), start(rotation.y, set.sensor.height))
}

/// The pixels of the region with its top-left pixel at some position.
fn pixels(set: &CaptureSet, capture: &Capture, (left, top): (usize, usize)) -> Result<Pixels> {
    let (width, height) = (set.sensor.width, set.sensor.height);
    if width < REGION || height < REGION {
        return Err(Error::input(format!("frames of {width} x {height}"))
            .help("regions are 11 x 11 pixels"));
    }
    let mut sums = vec![(0.0f64, 0.0f64); REGION * REGION];
    let mut saturated = 0usize;
    let frames = set.for_each_batch(capture, |batch| {
        for frame in batch {
            for (k, (sum, square)) in sums.iter_mut().enumerate() {
                let v = frame.at(left + k % REGION, top + k / REGION);
                saturated += usize::from(v >= set.sensor.white_level_dn);
                *sum += f64::from(v);
                *square += f64::from(v).powi(2);
            }
        }
        Ok(())
    })?;
    // The share of `SATURATED_SHARE`, in integers.
    if saturated * 1000 > frames * REGION * REGION {
        return Err(Error::input("the region is saturated")
            .help("factors of saturated signals mean nothing: lower the light"));
    }
    let l = frames as f64;
    let of = |&(sum, square): &(f64, f64)| {
        let mean = sum / l;
        let variance = (square / l - mean * mean).max(0.0) / (l - 1.0).max(1.0);
        // The mean of constant samples is uncertain by their rounding.
        (mean, variance.max(QUANTISATION / l))
    };
    Ok(sums.iter().map(of).collect())
}
