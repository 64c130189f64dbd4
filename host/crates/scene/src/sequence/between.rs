//! The light of a scene between its frames, as means over windows of time.
//!
//! Between two frames the light of a pixel goes in a straight line from one to the other, or stays
//! that of the first until the second is shown; before the first frame it is that of the first,
//! after the last that of the last. Lamps multiply it by a waveform P. So the mean over a window of
//! length T from a on is a sum of the frames' light with weights
//!
//! w_i = 1/T ∫ P(t) h_i(t) dt, h_i the hat over the frame's time stamp and its neighbours', or the
//! time for which it is shown,
//!
//! exact for any number of frames within the window. Light that goes in straight lines fades a
//! thing out here and in there: nothing moves between frames.

use super::rounds::ROUNDING_S;
use camrig_light::Lamps;

/// How light goes on from one frame to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Between {
    /// In a straight line.
    #[default]
    Linear,
    /// Not at all, until the next is shown.
    Hold,
}

camrig_base::choices!(Between, "light between frames": Linear = "linear", Hold = "hold");

/// A frame in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knot {
    /// From when it is shown, s.
    pub start_s: f64,
    /// Whether it has nothing to do with the frame before: the light jumps.
    pub cut: bool,
}

/// Weights of frames, in order of time, in the mean light of a window that opens and closes at
/// these times, s. Their sum is the mean of the lamps.
///
/// # Panics
/// Never: a window of no length gives no weight.
#[must_use]
pub fn weights(
    knots: &[Knot],
    between: Between,
    lamps: &Lamps,
    [open_s, close_s]: [f64; 2],
) -> Vec<f64> {
    let mut weights = vec![0.0; knots.len()];
    let length = close_s - open_s;
    // Light that jumps does so with the window where a rounded time stamp is the window's edge.
    let edge = |time: f64| {
        let near = |edge: &f64| between == Between::Hold && (edge - time).abs() <= ROUNDING_S;
        [open_s, close_s].into_iter().find(near).unwrap_or(time)
    };
    for (i, knot) in knots.iter().enumerate() {
        let next = knots.get(i + 1);
        let from = if i == 0 { open_s } else { open_s.max(edge(knot.start_s)) };
        let to = next.map_or(close_s, |next| close_s.min(edge(next.start_s)));
        if from >= to {
            continue;
        }
        let fades = between == Between::Linear && from.max(knot.start_s) < to;
        match next.filter(|next| fades && !next.cut) {
            None => weights[i] += lamps.moments(from, to - from)[0] / length,
            Some(next) => {
                let begin = from.max(knot.start_s);
                let before = lamps.moments(from, begin - from)[0];
                let [whole, first] = lamps.moments(begin, to - begin);
                let step = next.start_s - knot.start_s;
                let faded = ((begin - knot.start_s) * whole + first) / step;
                weights[i] += (before + whole - faded) / length;
                weights[i + 1] += faded / length;
            }
        }
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;

    fn knots(times: &[f64]) -> Vec<Knot> {
        times.iter().map(|&start_s| Knot { start_s, cut: false }).collect()
    }

    /// Means over uneven frames: golden/light/between_frames.csv, to its ten digits.
    #[test]
    fn means_over_windows_are_exact() {
        let Some(file) = camrig_testing::shared("golden/light/between_frames.csv") else { return };
        let light = [1.0, 3.0, 2.0, 10.0, 0.0];
        let knots = knots(&[0.0, 1.0 / 30.0, 2.0 / 30.0, 0.125, 1.0 / 6.0]);
        let mean = |between, window| -> f64 {
            let weights = weights(&knots, between, &Lamps::default(), window);
            weights.iter().zip(light).map(|(w, e)| w * e).sum()
        };
        let mut lines = 0;
        for line in std::fs::read_to_string(file).unwrap().lines().skip(1) {
            let fields: Vec<f64> = line.split(',').map(|f| f.parse().unwrap()).collect();
            let [open, exposure, linear, held] = fields[..] else { panic!("{line}") };
            // The table's times have ten digits, too, and its light moves by up to 240 /s.
            let third = |s: f64| if (s - 1.0 / 30.0).abs() < 1e-9 { 1.0 / 30.0 } else { s };
            let window = [third(open), third(open) + third(exposure)];
            assert!((mean(Between::Linear, window) - linear).abs() < 2e-9, "{line}");
            assert!((mean(Between::Hold, window) - held).abs() < 2e-9, "{line}");
            lines += 1;
        }
        assert_eq!(lines, 6);
    }

    #[test]
    fn a_frame_alone_has_all_the_weight_and_a_cut_fades_nothing() {
        let steady = Lamps::default();
        let one = weights(&knots(&[0.5]), Between::Linear, &steady, [0.1, 0.3]);
        assert_eq!(one, [1.0], "to the bit: a scene at rest keeps its bytes");
        let held = weights(&knots(&[0.0, 1.0]), Between::Hold, &steady, [0.1, 0.3]);
        assert_eq!(held, [1.0, 0.0]);
        let rounded = knots(&[0.0, 0.333_333_333, 0.666_666_667]);
        let third = [1.0 / 3.0, 2.0 / 3.0];
        assert_eq!(weights(&rounded, Between::Hold, &steady, third), [0.0, 1.0, 0.0]);
        let mut cut = knots(&[0.0, 1.0]);
        cut[1].cut = true;
        let half = weights(&cut, Between::Linear, &steady, [0.5, 1.5]);
        assert!((half[0] - 0.5).abs() < 1e-15 && (half[1] - 0.5).abs() < 1e-15);
    }

    /// A lamp that pulses while the light fades: against a sum over 100 000 moments, whose error is
    /// one moment at each of the six edges.
    #[test]
    fn lamps_and_fading_light_are_integrated_together() {
        for spec in ["pulse:hz=90,duty=0.25,phase=0.4", "mains:hz=100,depth=0.7,phase=0.1"] {
            let lamps = Lamps::new(vec![spec.parse().unwrap()]).unwrap();
            let knots = knots(&[0.0, 0.01, 0.04]);
            let [open, close] = [-0.003, 0.031];
            let exact = weights(&knots, Between::Linear, &lamps, [open, close]);
            let count = 100_000;
            let mut sums = [0.0; 3];
            for i in 0..count {
                let t = open + (close - open) * (f64::from(i) + 0.5) / f64::from(count);
                let light = lamps.moments(t, 1e-9)[0] / 1e-9 / f64::from(count);
                let hat = |a: f64, b: f64| (t - a) / (b - a);
                let shares = match t {
                    t if t < 0.0 => [1.0, 0.0, 0.0],
                    t if t < 0.01 => [1.0 - hat(0.0, 0.01), hat(0.0, 0.01), 0.0],
                    _ => [0.0, 1.0 - hat(0.01, 0.04), hat(0.01, 0.04)],
                };
                (0..3).for_each(|k| sums[k] += light * shares[k]);
            }
            for (exact, sum) in exact.iter().zip(sums) {
                assert!((exact - sum).abs() < 6.0 * 4.0 / f64::from(count), "{spec}");
            }
        }
    }
}
