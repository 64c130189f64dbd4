//! Signal-to-noise ratio of an even area of one raw frame.
//!
//! The noise is that of one frame from pixel to pixel, temporal and fixed, from differences of
//! neighbours of one colour along the rows, so that shading does not count: half the mean square
//! of N differences is the variance σ², with a standard error of σ² √(3/N) (J. von Neumann et al.,
//! Ann. Math. Stat. 12, 153, 1941). Below what rounding can hide (EMVA 1288 release 4.0, eq. 53)
//! it is not determined.

use super::emva::decibels;
use super::moments::SATURATED_SHARE;
use super::mtf::Roi;
use super::rounding::QUANTISATION_LIMITED;
use camrig_base::{Error, RawFrame, Result, Value};

/// The middle half of the width and height of a frame.
#[must_use]
pub fn middle(frame: &RawFrame) -> Roi {
    let (x, y) = (frame.width / 4, frame.height / 4);
    Roi { x, y, width: frame.width - 2 * x, height: frame.height - 2 * y }
}

/// Signal above black over noise of a channel in a region, dB.
///
/// # Errors
/// A region outside the frame or without pairs of the channel's pixels, saturated samples, no
/// signal above black, noise that rounding hides.
pub fn snr_db(frame: &RawFrame, channel: usize, roi: Roi) -> Result<Value> {
    let Roi { x, y, width, height } = roi;
    if x + width > frame.width || y + height > frame.height {
        return Err(Error::input(format!(
            "region {x},{y},{width},{height} is not inside the frame of {} x {}",
            frame.width, frame.height
        )));
    }
    let step = frame.cfa.width;
    let (mut sum, mut count, mut square, mut pairs) = (0.0, 0.0, 0.0, 0.0);
    let mut saturated = 0.0;
    for v in y..y + height {
        for u in (x..x + width).filter(|u| frame.cfa.channel(*u, v) == channel) {
            let at = |u: usize| f64::from(frame.data[v * frame.width + u]);
            sum += at(u);
            saturated += f64::from(u8::from(at(u) >= f64::from(frame.white_level_dn)));
            count += 1.0;
            if u + step < x + width {
                square += (at(u + step) - at(u)).powi(2);
                pairs += 1.0;
            }
        }
    }
    if pairs == 0.0 {
        return Err(Error::input("the region has no neighbours of this channel"));
    }
    if saturated > SATURATED_SHARE * count {
        let share = 100.0 * saturated / count;
        return Err(Error::input(format!("{share:.1} % of the samples are saturated"))
            .help("expose less: clipped samples have neither their signal nor their noise"));
    }
    let variance =
        Value::new(0.5 * square / pairs, 0.5 * square / pairs * (3.0f64 / pairs).sqrt());
    let noise = variance.sqrt().filter(|_| variance.value >= QUANTISATION_LIMITED);
    let signal = sum / count - frame.black_level_dn;
    match noise {
        _ if signal <= 0.0 => Err(Error::input("no signal above black")),
        None => Err(Error::input("rounding hides the noise, which is at most 0.49 DN")),
        Some(noise) => {
            let signal = Value::new(signal, noise.value / f64::sqrt(count));
            Ok(decibels(signal.over(noise)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Cfa;
    use rand_distr::{Distribution, Normal};
    use rand_xoshiro::{Xoshiro256PlusPlus, rand_core::SeedableRng};

    fn frame(cfa: &str, mut sample: impl FnMut(usize, usize) -> f64) -> RawFrame {
        let (width, height) = (64, 48);
        RawFrame {
            width,
            height,
            bits: 12,
            cfa: Cfa::parse(cfa).unwrap(),
            black_level_dn: 100.0,
            white_level_dn: 4095,
            data: (0..width * height)
                .map(|i| sample(i % width, i / width).round() as u16)
                .collect(),
        }
    }

    /// Samples alternate by ±5 about 1100 on a slope of 1 DN per pixel. Of the 32 columns in the
    /// middle, whose mean is 1131.5 DN, 16 differences of neighbours are -9 and 15 are 11: a mean
    /// square of 100.355 DN² and a noise of √(100.355/2) = 7.0836 DN.
    #[test]
    fn shading_is_no_noise() {
        let sloped = frame("mono", |x, _| 1100.0 + x as f64 + if x % 2 == 0 { 5.0 } else { -5.0 });
        let found = snr_db(&sloped, 0, middle(&sloped)).unwrap();
        let truth = 20.0 * (1031.5_f64 / 7.0836).log10();
        assert!((found.value - truth).abs() < 1e-3, "{found:?} {truth}");
    }

    #[test]
    fn noise_is_recovered_within_its_error() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
        let (mut square, runs) = (0.0, 40);
        for _ in 0..runs {
            let normal = Normal::new(0.0, 6.0).unwrap();
            let noisy = frame("RGGB", |_, _| 900.0 + normal.sample(&mut random));
            let found = snr_db(&noisy, 1, middle(&noisy)).unwrap();
            // Rounding adds a twelfth to 36 DN².
            let truth = 20.0 * (800.0 / (36.0f64 + 1.0 / 12.0).sqrt()).log10();
            square += ((found.value - truth) / found.std_error).powi(2);
        }
        // χ² of 40 degrees of freedom has a standard deviation of 8.9.
        assert!((square - f64::from(runs)).abs() < 36.0, "{square}");
    }

    #[test]
    fn what_is_not_determined_is_said() {
        let says = |frame: &RawFrame| snr_db(frame, 0, middle(frame)).unwrap_err().to_string();
        assert!(says(&frame("mono", |_, _| 500.0)).contains("rounding hides"));
        assert!(says(&frame("mono", |x, _| 4090.0 + (x % 6) as f64)).contains("saturated"));
        assert!(says(&frame("mono", |x, _| 90.0 + (x % 5) as f64)).contains("no signal"));
        let flat = frame("mono", |_, _| 500.0);
        assert!(snr_db(&flat, 0, Roi { x: 60, y: 0, width: 8, height: 8 }).is_err());
    }
}
