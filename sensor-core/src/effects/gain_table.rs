//! Figures of a sensor by its gain.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::at_gain::AtGain;
use crate::math;

effect! {
    /// Gain table: what a sensor is at each of its gains, where no law of the gain says it, as with
    /// two conversion gains or a gain that is digital from some value on. A camera file gives it as
    /// `[sensor.gains]`.
    ///
    /// At a gain G, read noise, DN per electron, black level and the charge that the node holds are
    /// those of the table; between two of its places ln of the value is a straight line over ln G
    /// (the value itself where it is 0 at one of them), beyond the first and the last they stay. Two
    /// places of one gain are a step: the second holds from there on. From `digital_above`, G_a, on
    /// the analogue gain is G_a, and codes are multiplied: DN' = round((DN − b) G/G_a) + b, clamped
    /// to the converter's range. As a stage it limits the charge: q = min(q, W(G)). Janesick 2007,
    /// ch. 11; the tables of Wei et al. 2021 (ELD) are of this kind.
    ///
    /// Source: Janesick 2007, chapter 11; Wei et al. 2021.
    ///
    /// Closed form: at a place its numbers; in the middle of two (on ln G) their geometric mean.
    GainTable, "gain-table", Charge, Response, Pixel {
        /// Gain G_a at which the analogue gain ends
        digital_above: "1", 1e-3..=1e6, default 1e6;
        /// Where its words begin in the table of the sensor: their number, then for each place
        /// gain, read noise (e⁻), DN per electron, black level (DN), charge (e⁻); below 0: as
        /// without this table
        start: "1", 0.0..=1023.0, default 0.0;
    }
}

impl GainTable {
    /// Its places in the sensor's table.
    fn places(self, table: &[f32]) -> &[[f32; AtGain::PLACE]] {
        super::own_table(table, self.start).as_chunks().0
    }

    /// Whether the table has places, their gains rise with at most one step each, and all values are
    /// finite.
    pub(crate) fn fits(self, table: &[f32]) -> bool {
        let places = self.places(table);
        let rise = places.windows(2).all(|two| two[0][0] <= two[1][0])
            && places.windows(3).all(|three| three[0][0] < three[2][0]);
        (1..=AtGain::MAX_PLACES).contains(&places.len())
            && super::own_table(table, self.start).len() == AtGain::PLACE * places.len()
            && rise
            && places.as_flattened().iter().all(|v| v.is_finite())
            && places.iter().all(|place| place[0] > 0.0 && place[2] != 0.0)
    }

    /// Read noise (e⁻), DN per electron, black level (DN) and charge of the node (e⁻) at a gain, as
    /// far as a sensor's table gives them; 16 places are looked at.
    pub fn values_at(self, table: &[f32], gain: f32) -> [Option<f32>; AtGain::PLACE - 1] {
        let gain = gain.min(self.digital_above);
        let places = self.places(table);
        let here = places.iter().rposition(|place| place[0] <= gain);
        let at = |i: usize| places.get(i).copied().unwrap_or([-1.0; AtGain::PLACE]);
        let ([first, a @ ..], [second, b @ ..]) = match here {
            Some(i) if i + 1 < places.len() => (at(i), at(i + 1)),
            Some(i) => (at(i), at(i)),
            None => (at(0), at(0)),
        };
        let part =
            if second > first { math::ln(gain / first) / math::ln(second / first) } else { 0.0 };
        core::array::from_fn(|column| {
            let (a, b) = (a[column], b[column]);
            if part > 0.0 && a > 0.0 && b > 0.0 {
                Some(a * math::exp(part * math::ln(b / a)))
            } else {
                (a >= 0.0).then_some(a + part * (b - a))
            }
        })
    }
}

impl Stage for GainTable {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let Some(well_e) = cx.at_gain.well_e else { return };
        let full = A::signal(well_e);
        for v in row.as_flattened_mut() {
            *v = if *v < full { *v } else { full };
        }
    }
}
