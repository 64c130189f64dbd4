//! Persistence.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Persistence: traps catch part of the charge that a photodiode holds, and release it over the
    /// frames that follow, as in infrared and scientific sensors.
    ///
    /// Of a frame n with µ mean photo-electrons, q = min(µ, W) is held, W the full well. The traps
    /// hold T_(n−1) from the frames before, of which d = exp(−1/τ) stays, τ their time constant in
    /// frames: µ' = µ − c + (1 − d) T_(n−1) and T_n = d T_(n−1) + c, with c = min(f q, W − d
    /// T_(n−1)) caught. No charge is lost, and traps are full at W. What is caught and released is
    /// so by chance, electron by electron: what is read has the Poisson law of its mean, and photon
    /// transfer shows the true system gain. Several such effects are several kinds of traps, each
    /// with its time constant; what one kind releases, the next may catch. Frames follow each other
    /// in the order in which they are taken, the first with empty traps; the charge takes four
    /// bytes for each pixel and effect, which no rig has. Janesick 2001; Smith et al. 2008;
    /// Leisenring et al. 2016.
    ///
    /// Source: Janesick 2001; Smith et al. 2008; Leisenring et al. 2016.
    ///
    /// Closed form: in darkness after one frame of µ, frame k shows f min(µ, W) (1 − d) d^(k−1); in
    /// steady light frame k shows µ − f µ d^(k−1) until the traps are full, and then µ.
    Persistence, "persistence", Light, Response, EarlierFrames {
        /// Fraction f of the charge that a frame leaves in the traps
        fraction: "1", 0.0..=0.5;
        /// Time constant τ of their release
        time_constant_frames: "frames", 0.0..=1e4;
    }
}

impl Persistence {
    /// Light of a row in, with what the traps released; charge of the traps before the frame in,
    /// after it out.
    #[inline(always)]
    pub(crate) fn exchange<A: Arith>(
        &self,
        cx: &Context<'_>,
        row: &mut [Block<A::Signal>],
        traps: &mut [Block<A::Signal>],
    ) {
        let less = |a: A::Signal, b: A::Signal| if a < b { a } else { b };
        let full = A::signal(cx.full_well_e);
        let fraction = A::factor(self.fraction);
        let stays = A::factor(math::exp(-1.0 / self.time_constant_frames));
        for (light, trapped) in row.as_flattened_mut().iter_mut().zip(traps.as_flattened_mut()) {
            let kept = A::scale(*trapped, stays);
            let caught = less(A::scale(less(*light, full), fraction), A::sub(full, kept));
            *light = A::add(A::sub(*light, caught), A::sub(*trapped, kept));
            *trapped = A::add(kept, caught);
        }
    }
}

impl Stage for Persistence {
    /// Nothing: the pipeline has the traps (`exchange`).
    fn apply<A: Arith>(
        &self,
        _: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        _: &mut [Block<A::Signal>],
    ) {
    }
}
