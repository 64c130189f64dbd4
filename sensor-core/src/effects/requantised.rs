//! Codes that were quantised again behind the converter.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Requantised codes: behind the converter, codes were quantised again with a step that depends
    /// on the level, as lossy compression (Raspberry Pi's PiSP, Sony's ARW) and tables do.
    ///
    /// In a range that begins at code a, with a step of s DN, code c becomes a + ⌈n s − r⌉ with
    /// n = ⌊(c − a)/s + r⌋; r = 1/2 rounds, and r = 0 cuts, as where low bits are dropped. There
    /// are up to five ranges: from 0 DN, and from each start on. Starts are whole numbers, and one
    /// of 65536 is none; with a step between whole numbers the distance of codes alternates, of
    /// 1.5 between 1 and 2. Put this effect last. Limits: a table whose step changes all along is
    /// taken as ranges of its mean step; errors of compression that depend on neighbours are not
    /// modelled.
    ///
    /// Source: definition.
    ///
    /// Closed form: of a ramp, codes a + ⌈n s − r⌉ alone, each as wide as its step; noise that is
    /// wider than a step gets s²/12 DN² more variance. Codes that are cut lie (s − 1)/2 DN lower.
    Requantised, "requantised", Voltage, Response, Pixel {
        /// Step from 0 DN on
        step_0_dn: "DN", 1.0..=4096.0, default 1.0;
        /// Where the second range begins
        from_1_dn: "DN", 0.0..=65536.0, default 65536.0;
        /// Its step
        step_1_dn: "DN", 1.0..=4096.0, default 1.0;
        /// Where the third range begins, not below the second
        from_2_dn: "DN", 0.0..=65536.0, default 65536.0;
        /// Its step
        step_2_dn: "DN", 1.0..=4096.0, default 1.0;
        /// Where the fourth range begins, not below the third
        from_3_dn: "DN", 0.0..=65536.0, default 65536.0;
        /// Its step
        step_3_dn: "DN", 1.0..=4096.0, default 1.0;
        /// Where the fifth range begins, not below the fourth
        from_4_dn: "DN", 0.0..=65536.0, default 65536.0;
        /// Its step
        step_4_dn: "DN", 1.0..=4096.0, default 1.0;
        /// r: 0.5 where codes are rounded, 0 where they are cut
        rounding: "1", 0.0..=0.5, default 0.5;
    }
}

impl Stage for Requantised {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let ranges = [
            (0, self.step_0_dn),
            (self.from_1_dn as u32, self.step_1_dn),
            (self.from_2_dn as u32, self.step_2_dn),
            (self.from_3_dn as u32, self.step_3_dn),
            (self.from_4_dn as u32, self.step_4_dn),
        ];
        let dn_per_e = cx.dn_per_e_here();
        let e_per_dn = 1.0 / dn_per_e;
        for v in row.as_flattened_mut() {
            let dn = A::electrons(*v) * dn_per_e + cx.black_level_dn + 0.5;
            // What the converter gives, from 0 to its largest code.
            let code = (dn.max(0.0) as u32).min(u32::from(cx.max_dn));
            let (mut from, mut step) = ranges[0];
            for &(start, its) in &ranges[1..] {
                (from, step) = if code >= start { (start, its) } else { (from, step) };
            }
            let n = (code.saturating_sub(from) as f32 / step + self.rounding) as u32;
            let above = n as f32 * step - self.rounding;
            let whole = above as u32;
            let again = from + whole + u32::from(above > whole as f32);
            *v = A::signal((again as f32 - cx.black_level_dn) * e_per_dn);
        }
    }
}
