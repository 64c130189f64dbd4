//! Smooth non-uniformity of response.

use super::context::normal;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Low-frequency PRNU: the response changes smoothly over the array (process gradients,
    /// coatings).
    ///
    /// n *= 1 + m(x, y), with m = Σ c_ij cos(iπ(u+1)/2) cos(jπ(v+1)/2) over i, j = 0..=order
    /// without (0, 0). The c_ij are normal and fixed, and scaled so that the mean square of m over
    /// sensors and pixels is σ². EMVA 1288 release 4.0, annex C.5.
    ///
    /// Source: EMVA 1288 release 4.0, annex C.5.
    ///
    /// Closed form: mean square of the relative response σ² over sensors and pixels; no terms above
    /// the order.
    PrnuLowFrequency, "prnu-low-frequency", Photo, Pattern, Pixel {
        /// Root mean square of m
        sigma: "1", 0.0..=0.14;
        /// Highest number of half waves over the array
        order: "1", 1.0..=4.0, default 2.0;
    }
}

/// Largest `order`.
const MAX_ORDER: usize = 4;

/// cos(π(u+1)/2).
#[inline(always)]
fn first_cosine(u: f32) -> f32 {
    math::sin_turns((u + 1.0) * 0.25 + 0.25)
}

/// cos(iπ(u+1)/2) for i up to `order`, 0 beyond.
fn cosines(order: usize, u: f32) -> [f32; MAX_ORDER + 1] {
    let first = first_cosine(u);
    let (mut waves, mut before, mut wave) = ([0.0; MAX_ORDER + 1], first, 1.0);
    for out in waves.iter_mut().take(order + 1) {
        *out = wave;
        (before, wave) = (wave, 2.0 * first * wave - before);
    }
    waves
}

impl Stage for PrnuLowFrequency {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let order = (self.order as usize).clamp(1, MAX_ORDER);
        let mut rng = cx.per_sensor(0);
        let by_row = cosines(order, cx.y());
        let (mut by_column, mut power) = ([0.0; MAX_ORDER + 1], 0.0);
        for (i, sum) in by_column.iter_mut().enumerate().take(order + 1) {
            for (j, wave) in by_row.iter().enumerate().take(order + 1) {
                let c = normal(&mut rng);
                if i + j > 0 {
                    *sum += c * wave;
                    // A cosine's mean square is a half.
                    power += if i == 0 || j == 0 { 0.5 } else { 0.25 };
                }
            }
        }
        let scale = self.sigma * math::rsqrt(power);
        super::scale_by_place::<A>(cx, row, |_, u| {
            // Σ c_i cos(iθ) by Clenshaw's recurrence.
            let cosine = first_cosine(u);
            let (mut next, mut after) = (0.0, 0.0);
            for c in by_column[1..].iter().rev() {
                (next, after) = (c + 2.0 * cosine * next - after, next);
            }
            1.0 + scale * (by_column[0] + cosine * next - after)
        });
    }
}
