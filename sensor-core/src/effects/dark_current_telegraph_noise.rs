//! Random telegraph noise of the dark current.

use super::context::{MAX_EXPONENTIAL, unit};
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, BLOCK, Block, EXPANSION_FROM_E};
use crate::effects::dark_current::growth;
use crate::math;

effect! {
    /// Telegraph noise of the dark current: a defect in the photodiode of a few pixels switches
    /// their dark current between two rates, so that the noise grows with exposure.
    ///
    /// For a fixed fraction f of the pixels q += Poisson(A t b(frame)), with b either 0 or 1 and t
    /// the exposure. The rate A = −a ln u, u uniform, is fixed, has mean a, and grows with
    /// temperature as the dark current does. In each frame the defect is renewed with probability
    /// q, and then is on with probability d: the states are those of `random-telegraph-noise`, and
    /// are constant within a frame. Hopkins and Hopkinson 1995; Goiffon et al. 2009.
    ///
    /// Source: Hopkins and Hopkinson 1995; Goiffon et al. 2009.
    ///
    /// Closed form: of pixels of one rate, mean A t d and variance A t d + A² t² d(1−d), with
    /// autocovariance A² t² d(1−d)(1−q)^|n|.
    DarkCurrentTelegraphNoise, "dark-current-telegraph-noise", Charge, Temporal, Pixel {
        /// Fraction of pixels
        fraction: "1", 0.0..=1.0;
        /// Mean of their jumps at the reference temperature
        mean_e_per_s: "e-/s", 0.0..=1e6;
        /// Chance of a renewal from one frame to the next
        renewal: "1", 0.03..=1.0, default 0.2;
        /// Share of the time at the higher rate
        duty: "1", 0.0..=1.0, default 0.5;
        /// Temperature rise that doubles it; in a camera file, left out, that of sensor.noise
        doubling_c: "K", 1.0..=100.0, default 7.0;
        /// Reference temperature; in a camera file, left out, that of sensor.noise
        reference_c: "degC", -100.0..=150.0, default 25.0;
    }
}

impl Stage for DarkCurrentTelegraphNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let scale =
            self.mean_e_per_s * cx.exposure_s * growth(cx, self.reference_c, self.doubling_c);
        let mut pattern = cx.per_pixel(0);
        let mut counts = cx.counts(0, true, MAX_EXPONENTIAL * scale >= EXPANSION_FROM_E);
        for (b, block) in row.iter_mut().enumerate() {
            let chosen = super::chosen(&mut pattern, self.fraction);
            let words = super::words(&mut pattern);
            let mut extra = [A::Signal::default(); BLOCK];
            for (i, extra) in extra.iter_mut().enumerate() {
                let column = (b * BLOCK + i) as u32;
                if chosen[i] && cx.telegraph_is_up(column, self.renewal, self.duty) {
                    *extra = A::signal(-scale * math::ln(unit(words[i])));
                }
            }
            A::poisson(core::slice::from_mut(&mut extra), &mut counts);
            for (v, e) in block.iter_mut().zip(extra) {
                *v = A::add(*v, e);
            }
        }
    }
}
