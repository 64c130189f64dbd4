//! The level at which signals end, where that lies below the white level: a full well.
//!
//! A pixel has ended where a longer exposure gives it no more: less than its ratio of times to the
//! power of 0.1. Even a tone curve (power 0.42) gives more. Signals that have ended pile up at one
//! level, and none lie above: what moved, or a lamp that changed, does neither.

use super::exposures::Series;
use camrig_base::Cfa;
use rayon::prelude::*;

/// Growth over the ratio of times, as a power, of what has ended.
const GROWTH: f64 = 0.1;
/// Signals that are watched, of full scale: well above noise.
const WATCHED: f64 = 0.1;
/// Half of the signals that have ended lie this close to their median, and fewer than one in a
/// hundred of their number above.
const PILE: f64 = 0.02;
/// Fewest samples that make a pile.
const LEAST: usize = 100;

/// Full scale above black: `stated`, or the lowest level at which the signals of a channel end,
/// where that is more than `PILE` below.
pub fn full_scale(series: &Series, cfa: &Cfa, stated: f64) -> f64 {
    (0..cfa.channels().len())
        .into_par_iter()
        .filter_map(|channel| level(series, cfa, channel, stated))
        .filter(|&level| level < (1.0 - PILE) * stated)
        .min_by(f64::total_cmp)
        .unwrap_or(stated)
}

/// Where the signals of a channel pile up.
fn level(series: &Series, cfa: &Cfa, channel: usize, stated: f64) -> Option<f64> {
    const SAMPLES: usize = 1 << 18;
    let frame = &series.exposures[0].signal;
    // An odd step visits every column and channel.
    let step = (frame.data.len() / SAMPLES) | 1;
    let of_channel = |i: &usize| cfa.channel(i % frame.width, i / frame.width) == channel;
    let places: Vec<usize> = (0..frame.data.len()).step_by(step).filter(of_channel).collect();
    let mut ended: Vec<f32> = Vec::new();
    for pair in series.exposures.windows(2) {
        let (short, long) = (&pair[0], &pair[1]);
        let most = libm::pow(long.seconds / short.seconds, GROWTH);
        // Exposures too close together are not conclusive.
        if most < 1.0 + PILE {
            continue;
        }
        for &i in &places {
            let (before, after) = (short.signal.data.get(i)?, long.signal.data.get(i)?);
            let growth = f64::from(*after) / f64::from(*before);
            if f64::from(*before) > WATCHED * stated && (1.0 - PILE..most).contains(&growth) {
                ended.push(*after);
            }
        }
    }
    if ended.len() < LEAST {
        return None;
    }
    let middle = ended.len() / 2;
    let level = f64::from(*ended.select_nth_unstable_by(middle, f32::total_cmp).1);
    let close = |v: &&f32| (f64::from(**v) / level - 1.0).abs() < PILE;
    let signals = series.exposures.iter().flat_map(|e| places.iter().map(|&i| e.signal.data[i]));
    let above = signals.filter(|&v| f64::from(v) > (1.0 + 2.0 * PILE) * level).count();
    let piled = 2 * ended.iter().filter(close).count() >= ended.len() && 100 * above < ended.len();
    piled.then_some(level)
}

#[cfg(test)]
mod tests {
    use super::super::exposures::Exposure;
    use super::super::hdr;
    use super::*;
    use camrig_base::Plane;

    const WELL: f64 = 2800.0;

    /// Light over 60 dB, seen by 12 bits with a response and uniform noise of 4 DN; `view` says
    /// where a pixel looks.
    fn series(response: impl Fn(f64) -> f64, view: impl Fn(usize, usize) -> usize) -> Series {
        let exposures = [0.01, 0.04, 0.16].iter().enumerate().map(|(j, &seconds)| {
            let signal = Plane::from_fn(160, 120, |x, y| {
                let mean = response(light(view(j, x)) * seconds);
                let noise = (x * 7919 + y * 104_729 + j * 1299) % 1000;
                (mean + 4.0 * (noise as f64 / 1000.0 - 0.5)).round().min(4095.0) as f32
            });
            Exposure { id: format!("e{j}"), seconds, frames: 1, signal }
        });
        Series { name: "test".into(), exposures: exposures.collect() }
    }

    fn light(x: usize) -> f64 {
        150.0 * 1e3f64.powf(x as f64 / 160.0)
    }

    /// Bent by 2 % at a full well of 2800 DN, and cut off there.
    fn bent(s: f64) -> f64 {
        (s - 0.02 * s * s / WELL).min(0.98 * WELL)
    }

    #[test]
    fn a_full_well_below_the_white_level_is_found() {
        let mono = Cfa::parse("mono").unwrap();
        let still = |_: usize, x: usize| x;
        let seen = series(bent, still);
        let found = full_scale(&seen, &mono, 4095.0);
        assert!((found / (0.98 * WELL) - 1.0).abs() < 0.005, "{found}");
        // The brightest column is lit by 150 kDN/s: only the shortest exposure is below the well
        // there.
        let merged = hdr::merge(&seen, &mono, found, &[]).unwrap();
        for x in 40..160 {
            let off = f64::from(merged.radiance.at(x, 60)) / light(x) - 1.0;
            assert!(off.abs() < 0.025, "{x}: {off}");
        }
        // Up to the white level, what is cut off contradicts the times.
        assert!(hdr::merge(&seen, &mono, 4095.0, &[]).is_err());
    }

    #[test]
    fn what_ends_at_the_white_level_or_moves_is_no_full_well() {
        let mono = Cfa::parse("mono").unwrap();
        let still = |_: usize, x: usize| x;
        assert_eq!(full_scale(&series(|s| s, still), &mono, 4095.0), 4095.0);
        // A tone curve of power 1/2.2 ends at the white level too.
        let toned = |s: f64| 4095.0 * (s / 4095.0).min(1.0).powf(1.0 / 2.2);
        assert_eq!(full_scale(&series(toned, still), &mono, 4095.0), 4095.0);
        // In the longer exposures a quarter of the view is as dark as it was bright in the first.
        let moving =
            |j: usize, x: usize| if j > 0 && x >= 100 { x.saturating_sub(32 * j) } else { x };
        assert_eq!(full_scale(&series(|s| s, moving), &mono, 4095.0), 4095.0);
    }
}
