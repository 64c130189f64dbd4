//! Mismatch of read-out channels.

use super::context::normal;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Read-out channel mismatch: columns are read through n channels in turn, each with its own
    /// offset and gain.
    ///
    /// v = v (1 + σ_g z_g(x mod n)) + σ_o z_o(x mod n), with z standard normal and fixed.
    /// Input-referred.
    ///
    /// Source: definition.
    ///
    /// Closed form: column means repeat every n columns, with variance σ_o² + σ_g² v² over the
    /// channels.
    ReadoutChannelMismatch, "readout-channel-mismatch", Voltage, Pattern, Pixel {
        /// Channels n
        channels: "1", 1.0..=16.0;
        /// Standard deviation of their offsets
        offset_e: "e-", 0.0..=1e4, default 0.0;
        /// Standard deviation of their relative gains
        gain: "1", 0.0..=0.1, default 0.0;
    }
}

/// Most read-out channels.
const MAX_READOUT_CHANNELS: usize = 16;

impl Stage for ReadoutChannelMismatch {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let channels = (self.channels as usize).clamp(1, MAX_READOUT_CHANNELS);
        let mut rng = cx.per_sensor(0);
        let mut table = [(A::factor(1.0), A::Signal::default()); MAX_READOUT_CHANNELS];
        for (gain, offset) in &mut table {
            *gain = A::factor(1.0 + self.gain * normal(&mut rng));
            *offset = A::signal(self.offset_e * normal(&mut rng));
        }
        for group in row.as_flattened_mut().chunks_mut(channels) {
            for (v, &(gain, offset)) in group.iter_mut().zip(&table) {
                *v = A::add(A::scale(*v, gain), offset);
            }
        }
    }
}
