//! Coherent pick-up.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;
use rand_core::Rng;

effect! {
    /// Periodic pattern noise: a clock or a supply line couples into the signal as a plane wave
    /// with a new phase in each frame.
    ///
    /// v += A sin(2π(f_x x + f_y y) + φ_frame), with φ uniform. Input-referred; its variance is
    /// A²/2. Hambly et al. 2018.
    ///
    /// Source: Hambly et al. 2018.
    ///
    /// Closed form: amplitude A G^p at the one frequency, variance A² G^(2p)/2, a phase that is
    /// uniform over frames.
    PeriodicPatternNoise, "periodic-pattern-noise", Voltage, Temporal, Pixel {
        /// Amplitude
        amplitude_e: "e-", 0.0..=1e5;
        /// Frequency along a row
        cycles_per_column: "1/px", -0.5..=0.5;
        /// Frequency along a column
        cycles_per_row: "1/px", -0.5..=0.5;
        /// Power p of the analogue gain to which it is proportional, σ G^p: 0 before the gain, −1
        /// behind it
        gain_exponent: "1", -2.0..=2.0, default 0.0;
    }
}

impl Stage for PeriodicPatternNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        // Angles in units of 2⁻³² turns, which wrap around at a whole turn.
        let step = |cycles: f32| (cycles * 4_294_967_296.0) as i64 as u32;
        let start = cx.per_frame(0, cx.frame).next_u32();
        let mut turns = start.wrapping_add(step(self.cycles_per_row).wrapping_mul(cx.row));
        let by_column = step(self.cycles_per_column);
        let amplitude = A::signal(self.amplitude_e * cx.power_of_gain(self.gain_exponent));
        for v in row.as_flattened_mut() {
            *v = A::add(*v, A::scale(amplitude, A::factor(math::sin_cos_turns(turns).0)));
            turns = turns.wrapping_add(by_column);
        }
    }
}
