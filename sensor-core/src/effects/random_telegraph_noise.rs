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
    /// autocorrelation (1−q)^|n|. Any frame can be computed without the others: the last renewal
    /// is sought up to 128 frames back (at q = 0.03 one trap in fifty reaches that limit and
    /// starts afresh). Wang et al. 2006; Goiffon et al. 2009.
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
    }
}

/// Most frames that are searched for the last renewal, this one included.
const MEMORY: u32 = 128;

impl RandomTelegraphNoise {
    /// Whether the trap of a column's pixel is in its upper level.
    fn up(&self, cx: &Context<'_>, column: u32) -> bool {
        let mut frame = cx.frame;
        for _ in 1..MEMORY {
            if unit(cx.word(0, frame, column)) < self.renewal {
                break;
            }
            frame = frame.wrapping_sub(1);
        }
        unit(cx.word(1, frame, column)) < self.duty
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
                if chosen[i] && self.up(cx, (b * BLOCK + i) as u32) {
                    let share = 1.0 - self.spread - self.spread * math::ln(unit(words[i]));
                    let amplitude = self.amplitude_e * share;
                    *v = A::add(*v, A::signal(amplitude));
                }
            }
        }
    }
}
