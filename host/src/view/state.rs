//! What the live page shows: the last frame and figures over frames, kept by the streaming thread.

use camrig_base::{Plane, RawFrame, Result};
use camrig_formats::{DngInfo, png, preview};
use camrig_report::plot::Palette;
use serde_json::{Value, json};

/// Bins of the histogram: each is more than two pixels wide on the page.
const BINS: usize = 256;
/// Longest side of a picture, pixels; larger frames are thinned, so that a page keeps up with the
/// stream.
const PICTURE: usize = 1024;
/// Weight of the last frame in the running mean of the frame rate. A trade: the figure follows a
/// change within some five frames and still can be read.
const RATE_WEIGHT: f64 = 0.2;
/// Frames before the running mean of the frame rate begins: the first period holds the rig's
/// start.
const RATE_START: u64 = 3;
/// Shortest period that a frame rate is computed from, s.
const SHORTEST_PERIOD_S: f64 = 1e-6;
/// White of the noise map, in root mean squares of the temporal noise: pixels of a normal sensor
/// stay below it, pixels of excess noise reach it.
const NOISE_WHITE: f64 = 3.0;

/// The stream so far.
pub struct State {
    /// The last frame.
    frame: Option<RawFrame>,
    info: DngInfo,
    /// Frames seen.
    pub frames: u64,
    /// Frames that the rig lost on request.
    pub dropped: u64,
    counter: u16,
    exposure_s: f64,
    analog_gain: f64,
    frames_per_s: f64,
    noise: Noise,
    /// What the page asked for last and the rig cannot do, with its limit.
    pub refused: Option<String>,
    /// What the rig did to the last frame on request of its registers.
    pub injected: Option<String>,
    /// Why the stream ended.
    pub ended: Option<String>,
}

/// What the rig and the clock say about a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// The sensor's frame counter.
    pub counter: u16,
    /// Exposure in force, s.
    pub exposure_s: f64,
    /// Gain in force.
    pub analog_gain: f64,
    /// Time since the frame before, s.
    pub period_s: f64,
}

impl State {
    /// A stream that has not begun.
    pub fn new(info: DngInfo) -> Self {
        Self {
            frame: None,
            info,
            frames: 0,
            dropped: 0,
            counter: 0,
            exposure_s: 0.0,
            analog_gain: 0.0,
            frames_per_s: 0.0,
            noise: Noise::default(),
            refused: None,
            injected: None,
            ended: None,
        }
    }

    /// Takes a frame. The noise map begins anew when exposure or gain change.
    pub fn push(&mut self, frame: RawFrame, told: Told) {
        if (self.exposure_s, self.analog_gain) != (told.exposure_s, told.analog_gain) {
            self.noise = Noise::default();
        }
        self.noise.push(&frame.data);
        (self.exposure_s, self.analog_gain) = (told.exposure_s, told.analog_gain);
        self.counter = told.counter;
        self.frames += 1;
        let now = 1.0 / told.period_s.max(SHORTEST_PERIOD_S);
        self.frames_per_s = if self.frames < RATE_START {
            now
        } else {
            (1.0 - RATE_WEIGHT) * self.frames_per_s + RATE_WEIGHT * now
        };
        self.frame = Some(frame);
    }

    /// The figures that the page shows; profiles along `row` and `column`, the middle ones unless
    /// given.
    pub fn json(&self, row: Option<usize>, column: Option<usize>) -> Value {
        let Some(frame) = &self.frame else {
            return json!({ "frames": 0, "refused": self.refused, "ended": self.ended });
        };
        let row = row.unwrap_or(frame.height / 2).min(frame.height - 1);
        let column = column.unwrap_or(frame.width / 2).min(frame.width - 1);
        let letter = |x: usize, y: usize| frame.cfa.letter(x, y).to_ascii_lowercase().to_string();
        let line = |n: usize, at: &dyn Fn(usize) -> (usize, usize)| -> Vec<Value> {
            let sample = |i| {
                let (x, y) = at(i);
                json!([letter(x, y), frame.data[y * frame.width + x]])
            };
            (0..n).map(sample).collect()
        };
        json!({
            "frames": self.frames,
            "dropped": self.dropped,
            "counter": self.counter,
            "frames_per_s": self.frames_per_s,
            "exposure_s": self.exposure_s,
            "analog_gain": self.analog_gain,
            "width": frame.width,
            "height": frame.height,
            "bits": frame.bits,
            "black_level_dn": frame.black_level_dn,
            "white_level_dn": frame.white_level_dn,
            "channels": frame.channel_means(),
            "histogram": histogram(frame),
            "row": row,
            "column": column,
            "row_profile": line(frame.width, &|x| (x, row)),
            "column_profile": line(frame.height, &|y| (column, y)),
            "noise_frames": self.noise.frames,
            "noise_dn": self.noise.mean_sigma(),
            "refused": self.refused,
            "injected": self.injected,
            "ended": self.ended,
        })
    }

    /// The last frame as a PNG, and `None` before it.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn picture(&self) -> Result<Option<Vec<u8>>> {
        let of = |frame| png::encode_rgb(&preview::thumbnail(frame, &self.info, PICTURE));
        self.frame.as_ref().map(of).transpose()
    }

    /// Temporal noise as a PNG, black at 0 to white at three times its root mean square; `None`
    /// before two frames.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn noise_picture(&self) -> Result<Option<Vec<u8>>> {
        let Some(frame) = &self.frame else { return Ok(None) };
        let Some(mean) = self.noise.mean_sigma() else { return Ok(None) };
        let step = frame.width.max(frame.height).div_ceil(PICTURE / 2).max(1);
        let (width, height) = ((frame.width / step).max(1), (frame.height / step).max(1));
        let picture = Plane::from_fn(width, height, |x, y| {
            let pixels = (0..step * step).map(|k| (x * step + k % step, y * step + k / step));
            let inside = pixels.filter(|(x, y)| *x < frame.width && *y < frame.height);
            let (sum, n) = inside.fold((0.0, 0.0), |(sum, n), (x, y)| {
                (sum + self.noise.variance(y * frame.width + x), n + 1.0)
            });
            Palette::Inferno.colour(
                (sum / f64::max(n, 1.0)).sqrt() / (NOISE_WHITE * mean.max(f64::MIN_POSITIVE)),
            )
        });
        png::encode_rgb(&picture).map(Some)
    }
}

/// Counts per channel over the range of the converter.
fn histogram(frame: &RawFrame) -> Vec<(String, Vec<u32>)> {
    let channels = frame.cfa.channels();
    let mut counts = vec![vec![0; BINS]; channels.len()];
    for (y, row) in frame.data.chunks(frame.width).enumerate() {
        for (x, &dn) in row.iter().enumerate() {
            let bin = (usize::from(dn) * BINS) >> frame.bits;
            counts[frame.cfa.channel(x, y)][bin.min(BINS - 1)] += 1;
        }
    }
    channels.iter().map(|c| c.to_lowercase().to_string()).zip(counts).collect()
}

/// Mean and variance of each pixel over frames (Welford).
#[derive(Default)]
struct Noise {
    frames: u32,
    mean: Vec<f32>,
    squares: Vec<f32>,
}

impl Noise {
    fn push(&mut self, data: &[u16]) {
        if self.mean.len() != data.len() {
            *self =
                Self { frames: 0, mean: vec![0.0; data.len()], squares: vec![0.0; data.len()] };
        }
        self.frames += 1;
        let n = self.frames as f32;
        for ((mean, squares), &dn) in self.mean.iter_mut().zip(&mut self.squares).zip(data) {
            let difference = f32::from(dn) - *mean;
            *mean += difference / n;
            *squares += difference * (f32::from(dn) - *mean);
        }
    }

    /// Variance over frames of a pixel, DN².
    fn variance(&self, index: usize) -> f64 {
        f64::from(self.squares[index]) / f64::from(self.frames.max(2) - 1)
    }

    /// Root of the mean variance, DN; `None` before two frames.
    fn mean_sigma(&self) -> Option<f64> {
        let sum: f64 = self.squares.iter().map(|&s| f64::from(s)).sum();
        let degrees = f64::from(self.frames.max(1) - 1) * self.squares.len() as f64;
        (self.frames > 1).then(|| (sum / degrees).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Cfa;

    fn frame(dn: [u16; 4]) -> RawFrame {
        RawFrame {
            width: 2,
            height: 2,
            bits: 10,
            cfa: Cfa::parse("RGGB").unwrap(),
            black_level_dn: 42.0,
            white_level_dn: 1023,
            data: dn.to_vec(),
        }
    }

    #[test]
    fn noise_is_the_standard_deviation_over_frames_and_starts_anew_with_the_settings() {
        let mut state = State::new(DngInfo::default());
        let told = |gain| Told { counter: 1, exposure_s: 0.01, analog_gain: gain, period_s: 0.1 };
        assert!(state.picture().unwrap().is_none());
        for (a, b) in [(100, 200), (104, 200), (108, 200)] {
            state.push(frame([a, b, b, b]), told(1.0));
        }
        // Variances 16, 0, 0, 0 DN²: mean 4, root 2.
        assert_eq!(state.json(None, None)["noise_dn"].as_f64(), Some(2.0));
        assert!(state.noise_picture().unwrap().is_some());
        state.push(frame([9; 4]), told(2.0));
        let now = state.json(Some(0), Some(99));
        assert!(now["noise_dn"].is_null());
        assert_eq!((now["frames"].as_u64(), now["column"].as_u64()), (Some(4), Some(1)));
        assert_eq!(now["row_profile"][1], json!(["g", 9]));
        assert_eq!(now["histogram"][1][1][2], 2, "both greens: {now}");
    }
}
