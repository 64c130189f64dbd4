//! Random telegraph noise.

use super::context::unit;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, BLOCK, Block};
use crate::math;

effect! {
    /// Random telegraph noise: a trap in the source follower of a few pixels switches the signal
    /// between two levels.
    ///
    /// For a fixed fraction f of the pixels, v += A b(frame), with b either 0 or 1. The amplitude
    /// A = a (1 − w − w ln u), u uniform, has mean a and is fixed; its distribution goes from one
    /// value for all (w = 0) to exponential (w = 1). In each frame the trap is renewed with
    /// probability q, and then is 1 with probability d. So b has mean d, variance d(1−d) and
    /// autocorrelation (1−q)^|n|, over up to 128 frames.
    ///
    /// With correlated double sampling the trap is seen twice: v += A (b − b'), b' its state at the
    /// first sample, renewed in between with probability s. The signal then has three levels, −A, 0
    /// and A; the outer ones have probability s d(1−d) each, so that the mean is 0 and the variance
    /// 2 s d(1−d) A². In a share of the pixels the jumps go down: −A. A pixel with two traps comes
    /// of two such effects. Wang et al. 2006; Goiffon et al. 2009.
    ///
    /// Source: Wang et al. 2006; Goiffon et al. 2009.
    ///
    /// Closed form: of one sample, mean A d and variance A² d(1−d), with autocovariance A²
    /// d(1−d)(1−q)^|n|; of two, mean 0 and variance 2 s d(1−d) A².
    RandomTelegraphNoise, "random-telegraph-noise", Voltage, Temporal, Pixel {
        /// Fraction of pixels
        fraction: "1", 0.0..=1.0;
        /// Mean of their amplitudes
        amplitude_e: "e-", 0.0..=1e4;
        /// Chance of a renewal from one frame to the next
        renewal: "1", 0.03..=1.0, default 0.2;
        /// Share of the time in the upper level
        duty: "1", 0.0..=1.0, default 0.5;
        /// Spread w of the amplitudes: 1 exponential, 0 all alike
        spread: "1", 0.0..=1.0, default 1.0;
        /// Chance s of a renewal between the two samples of correlated double sampling; 0 is one
        /// sample
        between_samples: "1", 0.0..=1.0, default 0.0;
        /// Share of these pixels whose jumps go down, in steps of 1/256
        down: "1", 0.0..=1.0, default 0.0;
    }
}

impl RandomTelegraphNoise {
    /// The level of a column's pixel, in amplitudes: 0 or 1, or −1 to 1 of two samples.
    fn level(&self, cx: &Context<'_>, column: u32) -> f32 {
        let up = cx.telegraph_is_up(column, self.renewal, self.duty);
        if self.between_samples == 0.0 {
            return f32::from(u8::from(up));
        }
        let renewed = unit(cx.word(2, cx.frame, column)) < self.between_samples;
        let first = if renewed { unit(cx.word(3, cx.frame, column)) < self.duty } else { up };
        f32::from(i8::from(up) - i8::from(first))
    }
}

impl Stage for RandomTelegraphNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let mut pattern = cx.per_pixel(0);
        for (b, block) in row.iter_mut().enumerate() {
            let chosen = super::chosen(&mut pattern, self.fraction);
            let words = super::words(&mut pattern);
            for (i, v) in block.iter_mut().enumerate() {
                if !chosen[i] {
                    continue;
                }
                let level = self.level(cx, (b * BLOCK + i) as u32);
                if level != 0.0 {
                    let share = 1.0 - self.spread - self.spread * math::ln(unit(words[i]));
                    // The lowest bits of the word, which its uniform number does not use.
                    let down = ((words[i] & 0xff) as f32) < self.down * 256.0;
                    let amplitude = self.amplitude_e * share * if down { -level } else { level };
                    *v = A::add(*v, A::signal(amplitude));
                }
            }
        }
    }
}
