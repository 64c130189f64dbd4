//! Dead, weak and hot areas: rows, parts of rows, clusters.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::effects::dark_current::growth;
use rand_core::Rng;

effect! {
    /// Defective areas: a few rectangles of pixels respond with a fraction of the others' gain or
    /// not at all, or have far more dark current: whole rows (as wide as the sensor, one high),
    /// parts of rows, clusters. Columns are in `defective-columns` too.
    ///
    /// µ' = g µ + t I 2^((T − T_ref)/T_d) in n rectangles, each anywhere on the sensor; t is the
    /// exposure. Where rectangles overlap, each acts on what the one before it leaves. What they
    /// lack and what they have more, they do before shot noise. Chen et al. 2009, section VI:
    /// defects that only the captures show; EMVA 1288 release 4.0, section 8.4, for lines.
    ///
    /// Source: Chen et al. 2009, section VI.
    ///
    /// Closed form: in the rectangles mean and temporal variance g µ + t I 2^((T − T_ref)/T_d).
    DefectiveAreas, "defective-areas", Light, Defect, Pixel {
        /// Number of rectangles n
        count: "1", 0.0..=256.0;
        /// Columns of each; 0 are all
        width_px: "px", 0.0..=65535.0, default 0.0;
        /// Rows of each; 0 are all
        height_px: "px", 0.0..=65535.0, default 1.0;
        /// Gain relative to the rest; 0 is dead
        gain: "1", 0.0..=2.0, default 0.0;
        /// Dark current beside that of the rest, at the reference temperature
        rate_e_per_s: "e-/s", 0.0..=1e6, default 0.0;
        /// Temperature rise that doubles it; in a camera file, left out, that of sensor.noise
        doubling_c: "K", 1.0..=100.0, default 7.0;
        /// Reference temperature; in a camera file, left out, that of sensor.noise
        reference_c: "degC", -100.0..=150.0, default 25.0;
    }
}

/// The first pixel and the length of a rectangle along one side of the sensor, from a uniform word.
fn span(word: u32, length: f32, all: u32) -> (u32, u32) {
    let own = if length < 0.5 { all } else { ((length + 0.5) as u32).min(all) };
    let places = u64::from(all - own) + 1;
    (((u64::from(word) * places) >> 32) as u32, own)
}

impl Stage for DefectiveAreas {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let growth = growth(cx, self.reference_c, self.doubling_c);
        let more = A::signal(self.rate_e_per_s * cx.exposure_s * growth);
        let mut places = cx.per_sensor(0);
        let row = row.as_flattened_mut();
        for _ in 0..(self.count + 0.5) as u32 {
            let (left, width) = span(places.next_u32(), self.width_px, cx.width);
            let (top, height) = span(places.next_u32(), self.height_px, cx.height);
            if (top..top + height).contains(&cx.row) {
                for v in row.iter_mut().skip(left as usize).take(width as usize) {
                    *v = A::add(A::times(*v, self.gain), more);
                }
            }
        }
    }
}
