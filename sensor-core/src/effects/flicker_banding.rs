//! Flicker with a rolling shutter.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;
use rand_core::Rng;

effect! {
    /// Flicker banding: the lamp's light pulsates, and with a rolling shutter each row integrates
    /// a different part of the pulsation.
    ///
    /// µ *= 1 + A a_c sinc(f t) sin(2π(f (y t_row + t/2) + φ_frame)), which is the mean of 1 + A a_c
    /// sin(2πf τ) over the row's exposure t. sinc(x) = sin(πx)/(πx), and φ is uniform in each
    /// frame. a_c is the depth that channel c sees over A: the phosphor of a white LED glows on,
    /// so its blue light, which comes from the diode, pulsates more than the rest.
    ///
    /// Source: definition.
    ///
    /// Closed form: in a frame the row means of a channel are a sine over y of frequency f t_row
    /// and relative amplitude A a_c sinc(f t).
    FlickerBanding, "flicker-banding", Light, Response, Pixel {
        /// Depth A of the light's modulation
        depth: "1", 0.0..=1.0;
        /// Frequency f of the light (twice that of the mains)
        frequency_hz: "Hz", 0.1..=1e5, default 100.0;
        /// Time t_row from one row to the next
        row_time_us: "us", 0.0..=1e4, default 20.0;
        /// Depth that the first channel sees, over A
        channel_0: "1", 0.0..=10.0, default 1.0;
        /// Depth that the second channel sees, over A
        channel_1: "1", 0.0..=10.0, default 1.0;
        /// Depth that the third channel sees, over A
        channel_2: "1", 0.0..=10.0, default 1.0;
        /// Depth that the fourth channel sees, over A
        channel_3: "1", 0.0..=10.0, default 1.0;
    }
}

/// Angle (rad) below which sin(x)/x is 1 in f32: it differs by x²/6 = 2e-7.
const SMALL_ANGLE: f32 = 1e-3;

impl Stage for FlickerBanding {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let cycles = self.frequency_hz * cx.exposure_s;
        let x = core::f32::consts::PI * cycles;
        let sinc = if x > SMALL_ANGLE { math::sin_turns(0.5 * cycles) / x } else { 1.0 };
        let row_cycles = f64::from(self.frequency_hz) * f64::from(self.row_time_us) * 1e-6;
        let phase = f64::from(cx.row) * row_cycles + 0.5 * f64::from(cycles);
        // In units of 2⁻³² turns, which wrap around at a whole turn.
        let turns = (phase * 4_294_967_296.0) as u64 as u32;
        let turns = turns.wrapping_add(cx.per_frame(0, cx.frame).next_u32());
        let wave = self.depth * sinc * math::sin_cos_turns(turns).0;
        let by_channel = [self.channel_0, self.channel_1, self.channel_2, self.channel_3];
        super::scale_by_place::<A>(cx, row, |x, _| {
            1.0 + by_channel.get(cx.channel(x)).copied().unwrap_or(1.0) * wave
        });
    }
}
