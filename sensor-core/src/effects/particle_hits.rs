//! Particle hits.

use super::context::{normal, unit};
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;
use rand_core::Rng;

effect! {
    /// Particle hits: charged particles (muons of cosmic rays, radioactivity) cross the sensor and
    /// leave charge along their tracks, in one frame each.
    ///
    /// Hits begin anywhere, Poisson with the mean r t in a million pixels, t the exposure. A flux F
    /// per area is r = 10⁶ F p², p the pixel pitch: 1 cm⁻² min⁻¹ of muons at sea level and 3 µm
    /// make 0.0015. They come from above with the law cos² of the zenith angle, so that cos θ = u^¼
    /// on a plane, u uniform, and from any side. The track is straight, d tan θ pixels long as seen
    /// from above, d the depth of the sensitive layer, and ends after 32 rows. Its charge is a
    /// d/cos θ (1 + w λ), not below 0, even along the track, with the most probable charge a per
    /// pixel pitch (some 75 e⁻/µm in silicon). λ = −ln z², z standard normal, has Moyal's law,
    /// which stands for Landau's. Moyal 1955; Particle Data Group, Review of Particle Physics 2022,
    /// chapters 30.4 and 34.2.
    ///
    /// Source: Moyal 1955; Particle Data Group 2022, chapters 30.4 and 34.2.
    ///
    /// Closed form: the hits of a frame are Poisson; the mean charge of one is 4/3 a d (1 + 1.270
    /// w), its mean square 2 a² d² ((1 + 1.270 w)² + 4.935 w²).
    ParticleHits, "particle-hits", Charge, Temporal, Pixel {
        /// Rate r of hits in a million pixels
        rate_per_mpx_s: "1/s", 0.0..=1e4;
        /// Most probable charge a for each pixel pitch of track
        charge_e_per_px: "e-", 0.0..=1e5;
        /// Depth d of the sensitive layer in pixel pitches
        depth_px: "px", 0.1..=8.0, default 1.0;
        /// Width w of the charge's law relative to its most probable value
        width: "1", 0.0..=0.2, default 0.1;
    }
}

/// Rows that a track crosses at most. Of layers as deep as a pixel is wide, one track in a million
/// would be longer.
const MAX_ROWS: u32 = 32;
/// Hits that begin in a row at most: in the mean a third of it at the highest rate, 10 s of
/// exposure and 3000 columns.
const MAX_HITS: u32 = 1000;

/// Shorter tracks are taken as this long, pixels.
const MIN_LENGTH: f32 = 1e-3;

/// −ln u, u uniform.
fn exponential(rng: &mut impl Rng) -> f32 {
    -math::ln(unit(rng.next_u32()))
}

/// A track as seen from above; lengths in pixels, from the upper left corner of its first row.
struct Track {
    /// Where it begins.
    x: f32,
    y: f32,
    /// Its direction, never upwards.
    across: f32,
    down: f32,
    length: f32,
    charge_e: f32,
}

impl Track {
    fn of(effect: &ParticleHits, width: u32, rng: &mut impl Rng) -> Self {
        let mut uniform = || unit(rng.next_u32());
        let (x, y, turns, u) = (uniform(), uniform(), 0.5 * uniform(), uniform());
        let z = normal(rng);
        // cos² θ is √u.
        let squared = math::sqrt(u);
        let moyal = -math::ln((z * z).max(f32::MIN_POSITIVE));
        let path = effect.depth_px * math::rsqrt(squared);
        Self {
            x: x * width as f32,
            y,
            across: math::sin_turns(turns + 0.25),
            down: math::sin_turns(turns).max(0.0),
            length: (path * math::sqrt((1.0 - squared).max(0.0))).max(MIN_LENGTH),
            charge_e: effect.charge_e_per_px * path * (1.0 + effect.width * moyal).max(0.0),
        }
    }

    /// Adds what it leaves in the row that is so many below its first.
    fn add_to<A: Arith>(&self, row: &mut [Block<A::Signal>], width: u32, below: f32) {
        // Between which lengths it is in the row.
        let at = |edge: f32| ((edge - self.y) / self.down.max(1e-6)).clamp(0.0, self.length);
        let (from, to) = (at(below), at(below + 1.0));
        let (a, b) = (self.x + self.across * from, self.x + self.across * to);
        let (left, right) = (a.min(b).max(0.0), a.max(b).min(width as f32));
        let charge = self.charge_e / self.length * (to - from);
        if to <= from || left > right {
            return;
        }
        let first = left as usize;
        let columns = row.as_flattened_mut().iter_mut().enumerate().take(width as usize);
        for (x, v) in columns.skip(first).take(right as usize + 1 - first) {
            let inside = right.min(x as f32 + 1.0) - left.max(x as f32);
            // A track down a column has no width.
            let across = (b - a).abs();
            let share = if across > MIN_LENGTH { inside / across } else { f32::from(x == first) };
            *v = A::add(*v, A::signal(charge * share));
        }
    }
}

impl Stage for ParticleHits {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let mean = self.rate_per_mpx_s * 1e-6 * cx.width as f32 * cx.exposure_s;
        for start in cx.row.saturating_sub(MAX_ROWS - 1)..=cx.row {
            let mut hits = cx.per_row_and_frame(0, start);
            // Between the events of a Poisson process lie exponential gaps.
            let mut at = exponential(&mut hits);
            for _ in 0..MAX_HITS {
                if at > mean {
                    break;
                }
                let track = Track::of(self, cx.width, &mut hits);
                track.add_to::<A>(row, cx.width, (cx.row - start) as f32);
                at += exponential(&mut hits);
            }
        }
    }
}
