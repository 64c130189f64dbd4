//! Flicker with a rolling shutter.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;
use rand_core::Rng;

effect! {
    /// Flicker banding: the lamp's light pulsates, and with a rolling shutter each row integrates
    /// a different part of the pulsation.
    ///
    /// µ *= 1 + A a_p sinc(f t) sin(2π(f (y t_row + t/2) + φ_frame) − δ_p) at place p = 2 (y mod 2) +
    /// x mod 2 of a 2x2 pattern: the mean of 1 + A a_p sin(2πf τ − δ_p) over the row's exposure t,
    /// with sinc(x) = sin(πx)/(πx) and φ uniform in each frame. The light of white LEDs has an
    /// amplitude and a phase of its own in each colour, as blue comes from the diode and the rest
    /// from a phosphor, which glows on: an AR0130 sees red 21° behind blue, and its two greens, which
    /// get some of their neighbours' light, 2° and 2.5 % of the depth apart.
    ///
    /// Source: definition.
    ///
    /// Closed form: in a frame the row means of a place are a sine over y of frequency f t_row,
    /// relative amplitude A a_p sinc(f t) and phase −δ_p against the light's.
    FlickerBanding, "flicker-banding", Light, Response, Pixel {
        /// Depth A of the light's modulation
        depth: "1", 0.0..=1.0;
        /// Frequency f of the light (twice that of the mains)
        frequency_hz: "Hz", 0.1..=1e5, default 100.0;
        /// Time t_row from one row to the next
        row_time_us: "us", 0.0..=1e4, default 20.0;
        /// Depth at even columns of even rows (from 0), over A
        plane_0: "1", 0.0..=10.0, default 1.0;
        /// Depth at odd columns of even rows, over A
        plane_1: "1", 0.0..=10.0, default 1.0;
        /// Depth at even columns of odd rows, over A
        plane_2: "1", 0.0..=10.0, default 1.0;
        /// Depth at odd columns of odd rows, over A
        plane_3: "1", 0.0..=10.0, default 1.0;
        /// Angle δ by which the light lags at odd columns of even rows, behind even columns of even
        /// rows
        plane_1_lag_deg: "deg", -360.0..=360.0, default 0.0;
        /// Angle by which it lags at even columns of odd rows
        plane_2_lag_deg: "deg", -360.0..=360.0, default 0.0;
        /// Angle by which it lags at odd columns of odd rows
        plane_3_lag_deg: "deg", -360.0..=360.0, default 0.0;
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
        let wave = |own: f32, lag_deg: f32| {
            let lag = f64::from(lag_deg) / 360.0 * 4_294_967_296.0;
            own * self.depth * sinc * math::sin_cos_turns(turns.wrapping_sub(lag as i64 as u32)).0
        };
        let waves = match cx.row % 2 {
            0 => [wave(self.plane_0, 0.0), wave(self.plane_1, self.plane_1_lag_deg)],
            _ => [
                wave(self.plane_2, self.plane_2_lag_deg),
                wave(self.plane_3, self.plane_3_lag_deg),
            ],
        };
        super::scale_by_place::<A>(cx, row, |x, _| 1.0 + waves[x % 2]);
    }
}
