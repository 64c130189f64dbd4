//! Shot noise by an exact method.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::stream::Key;
use rand_core::Rng;
use rand_distr::{Distribution, Poisson};

effect! {
    /// Exact shot noise: the stage `shot-noise` draws its counts from the
    /// exact Poisson law in f64, by multiplication below a mean of 12 and by rejection above.
    ///
    /// This effect only alters the shot-noise stage; alone it does nothing. It is about ten times
    /// slower than the usual method. Two promises do not hold with it: results may differ between
    /// machines (logarithms of the platform), and a pixel's count depends on the means before it
    /// in its row. `Poisson` of the `rand_distr` crate; Ahrens & Dieter 1982.
    ///
    /// Source: Ahrens & Dieter 1982.
    ///
    /// Closed form: mean µ, variance µ, and the probabilities of the Poisson law.
    ExactShotNoise, "exact-shot-noise", Light, Shot, Pixel {}
}

impl Stage for ExactShotNoise {
    fn prepare(&self, cx: &mut Context<'_>) {
        // Of several the first one's streams.
        cx.exact_shot_noise.get_or_insert(cx.key);
    }

    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        _: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        _: &mut [Block<A::Signal>],
    ) {
    }
}

/// Counts for the means of a row.
pub(super) fn counts<A: Arith>(cx: &Context<'_>, key: Key, row: &mut [Block<A::Signal>]) {
    let mut rng = Context { key, ..*cx }.per_row_and_frame(0, cx.row);
    for v in row.as_flattened_mut() {
        *v = A::signal(count(f64::from(A::electrons(*v)), &mut rng));
    }
}

fn count(mean: f64, rng: &mut impl Rng) -> f32 {
    // There is no law for a mean of 0 or below: no count.
    Poisson::new(mean).map_or(0.0, |law| law.sample(rng)) as f32
}
