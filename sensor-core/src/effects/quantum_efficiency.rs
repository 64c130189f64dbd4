//! Error of the quantum efficiency.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Quantum efficiency: the sensor converts more or fewer photons than its curve says, at all
    /// wavelengths alike.
    ///
    /// µ *= r. The mean changes, and the shot noise with it; the gain does not.
    ///
    /// Source: EMVA 1288 release 4.0, section 2.1.
    ///
    /// Closed form: mean and variance r times those without it.
    QuantumEfficiency, "quantum-efficiency", Light, Response, Pixel {
        /// Photo-electrons relative to what the curve gives
        ratio: "1", 0.0..=10.0;
    }
}

impl Stage for QuantumEfficiency {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        _: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::scale_all::<A>(row, self.ratio);
    }
}
