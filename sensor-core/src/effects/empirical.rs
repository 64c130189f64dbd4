//! What no other effect describes: a shape that was found in frames, as a table.

mod correlation;
mod curve;
mod field;
mod line_noise;
mod response;
mod since_start;

use super::{Class, Context, Domain, Inputs, MAX_TABLE, Stage, effect, own_table};
use crate::arith::{Arith, BLOCK, Block};
use crate::effects::dark_current::growth;
use crate::math;
use curve::Curve;
use field::Field;

effect! {
    /// Empirical effect: a shape that was found in frames and that no other effect has, as a table
    /// of numbers. A camera may have several.
    ///
    /// `domain` says what of the sensor it changes, `shape` how that lies over the frame or the
    /// signal; the table holds the shape f, and `amount` multiplies it.
    ///
    /// - offset, e⁻: v += A f(x, y), or A f(i), i the frames since the sensor's start;
    /// - gain: n *= 1 + A f(x, y), or v for n where it is a seam, as taps come after the pixel;
    /// - dark, e⁻/s: q += Poisson(max(d, 0)) + min(d, 0), d = t 2^((T − T_ref)/T_d) A f(x, y);
    /// - temporal, e⁻: v += A z(y, frame) f(x) (s/S)^e, s the row's mean signal, or the same with
    ///   x and y exchanged in z and f; or v += A c(x, y, frame), where c follows itself;
    /// - response, e⁻: v += A f(v) + σ(v) z(x, y, frame).
    ///
    /// z is standard normal, c has variance 1. Shapes of offset, gain and dark current: seam
    /// (steps from a column and a row on), wave (sines that stand still), row-profile and
    /// column-profile (curves over columns or rows), map (a sum of curves over columns times curves
    /// over rows), distribution (a quantile function of z, fixed for each pixel); of the offset
    /// also frame-curve (the first frames after a start). Of temporal noise: row-flat, column-flat,
    /// row-profile, column-profile (common to a row or column), correlation (taps or a length). Of
    /// the response: signal-curve. Curves are straight between their knots and stay beyond their
    /// ends. All tables of a camera together have at most 1024 numbers. Limits: the row's mean
    /// stands for the signal of each of its pixels. Shapes as `camrig diagnose` finds them; EMVA
    /// 1288 release 4.0 for parts of rows and columns, Janesick 2001 for where they act.
    ///
    /// Source: EMVA 1288 release 4.0; Janesick 2001.
    ///
    /// Closed form: that of its domain and shape above, of the table's own numbers.
    Empirical, "empirical", Voltage, Pattern, Pixel {
        /// What it changes: 0 offset, 1 gain, 2 dark current, 3 temporal noise, 4 response
        quantity: "1", 0.0..=4.0;
        /// Its shape: 0 row-flat, 1 column-flat, 2 row-profile, 3 column-profile, 4 seam, 5 wave,
        /// 6 map, 7 distribution, 8 correlation, 9 signal-curve, 10 frame-curve
        shape: "1", 0.0..=10.0;
        /// What the table's values are multiplied by, in e⁻, 1 or e⁻/s
        amount: "e-", -1e6..=1e6;
        /// Exponent e of the signal, of temporal noise common to lines
        on_signal: "1", 0.0..=4.0, default 0.0;
        /// Signal S at which such noise has its amount
        signal_e: "e-", 1.0..=524_287.0, default 1.0;
        /// Temperature rise that doubles a dark current
        doubling_c: "K", 1.0..=100.0, default 7.0;
        /// Reference temperature of a dark current
        reference_c: "degC", -100.0..=150.0, default 25.0;
        /// Where its words begin in the table of the sensor: their number, then the words
        start: "1", 0.0..=1023.0, default 0.0;
    }
}

/// What of the sensor an empirical effect changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// What every frame has, e⁻.
    Offset,
    /// The response to light, relative.
    Gain,
    /// The rate of dark charge, e⁻/s.
    Dark,
    /// What is new in every frame, e⁻.
    Temporal,
    /// The signal over itself, e⁻.
    Response,
}

/// How an empirical effect lies over the frame or the signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Common to a row, alike along it.
    RowFlat,
    /// Common to a column, alike along it.
    ColumnFlat,
    /// Along rows.
    RowProfile,
    /// Along columns.
    ColumnProfile,
    /// Steps between parts of the sensor.
    Seam,
    /// Plane waves.
    Wave,
    /// A sum of products.
    Map,
    /// A law over pixels.
    Distribution,
    /// Follows itself from pixel to pixel.
    Correlation,
    /// Over the signal.
    SignalCurve,
    /// Over the frames since the sensor's start.
    FrameCurve,
}

impl Quantity {
    /// All, in the order of their numbers.
    pub const ALL: [Self; 5] =
        [Self::Offset, Self::Gain, Self::Dark, Self::Temporal, Self::Response];
}

impl Shape {
    /// All, in the order of their numbers.
    pub const ALL: [Self; 11] = [
        Self::RowFlat,
        Self::ColumnFlat,
        Self::RowProfile,
        Self::ColumnProfile,
        Self::Seam,
        Self::Wave,
        Self::Map,
        Self::Distribution,
        Self::Correlation,
        Self::SignalCurve,
        Self::FrameCurve,
    ];

    /// Whether a quantity may have this shape.
    pub fn suits(self, quantity: Quantity) -> bool {
        match quantity {
            Quantity::Offset if self == Self::FrameCurve => true,
            Quantity::Offset | Quantity::Gain | Quantity::Dark => matches!(
                self,
                Self::RowProfile
                    | Self::ColumnProfile
                    | Self::Seam
                    | Self::Wave
                    | Self::Map
                    | Self::Distribution
            ),
            Quantity::Temporal => matches!(
                self,
                Self::RowFlat
                    | Self::ColumnFlat
                    | Self::RowProfile
                    | Self::ColumnProfile
                    | Self::Correlation
            ),
            Quantity::Response => self == Self::SignalCurve,
        }
    }
}

impl Empirical {
    /// What it changes.
    pub const fn quantity(&self) -> Quantity {
        match self.quantity as u8 {
            0 => Quantity::Offset,
            1 => Quantity::Gain,
            2 => Quantity::Dark,
            3 => Quantity::Temporal,
            _ => Quantity::Response,
        }
    }

    /// Its shape.
    pub const fn shape(&self) -> Shape {
        match self.shape as u8 {
            0 => Shape::RowFlat,
            1 => Shape::ColumnFlat,
            2 => Shape::RowProfile,
            3 => Shape::ColumnProfile,
            4 => Shape::Seam,
            5 => Shape::Wave,
            6 => Shape::Map,
            7 => Shape::Distribution,
            8 => Shape::Correlation,
            9 => Shape::SignalCurve,
            _ => Shape::FrameCurve,
        }
    }

    /// Where it acts.
    pub const fn domain(&self) -> Domain {
        match (self.quantity(), self.shape()) {
            (Quantity::Gain, Shape::Seam) => Domain::Voltage,
            (Quantity::Gain, _) => Domain::Photo,
            (Quantity::Dark, _) => Domain::Charge,
            _ => Domain::Voltage,
        }
    }

    /// What it is to a picture.
    pub const fn class(&self) -> Class {
        match self.quantity() {
            Quantity::Offset | Quantity::Gain => Class::Pattern,
            Quantity::Dark => Class::Dark,
            Quantity::Temporal => Class::Temporal,
            Quantity::Response => Class::Response,
        }
    }

    /// Whether its table, in that of the sensor, is one that its shape has.
    pub(crate) fn fits(&self, table: &[f32]) -> bool {
        let words = own_table(table, self.start);
        let tells = match self.shape() {
            Shape::RowFlat | Shape::ColumnFlat => true,
            Shape::RowProfile | Shape::ColumnProfile | Shape::Distribution => {
                Curve::<2>::is_one(words)
            }
            Shape::SignalCurve => Curve::<3>::is_one(words),
            Shape::FrameCurve => since_start::is_one(words),
            Shape::Seam | Shape::Wave | Shape::Map => Field::is_one(self.shape(), words),
            Shape::Correlation => correlation::is_one(words),
        };
        tells && self.shape().suits(self.quantity()) && words.iter().all(|w| w.is_finite())
    }
}

impl Stage for Empirical {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let words = own_table(cx.table, self.start);
        match (self.quantity(), self.shape()) {
            (Quantity::Temporal, Shape::Correlation) => {
                correlation::add::<A>(cx, row, self.amount, words);
            }
            (Quantity::Temporal, _) => line_noise::add::<A>(self, cx, row, words),
            (Quantity::Response, _) => response::change::<A>(cx, row, self.amount, words),
            (Quantity::Offset | Quantity::Gain | Quantity::Dark, shape) => {
                self.change::<A>(cx, row, Field::new(cx, shape, words));
            }
        }
    }
}

impl Empirical {
    /// Changes a row by a fixed pattern.
    #[inline(always)]
    fn change<A: Arith>(
        &self,
        cx: &Context<'_>,
        row: &mut [Block<A::Signal>],
        mut field: Field<'_>,
    ) {
        let quantity = self.quantity();
        let of_light = self.domain().is_of_light();
        let scale = match quantity {
            Quantity::Dark => {
                self.amount * cx.exposure_s * growth(cx, self.reference_c, self.doubling_c)
            }
            _ => self.amount,
        };
        let mut counts = cx.counts(0, true, true);
        let zero = A::Signal::default();
        for (b, block) in row.iter_mut().enumerate() {
            let values = field.block::<A>(cx, b).map(|f| scale * f);
            if quantity == Quantity::Gain {
                for (v, f) in block.iter_mut().zip(values) {
                    let times = if of_light { A::Light::times } else { A::times };
                    *v = times(*v, 1.0 + f);
                }
                continue;
            }
            let mut values = values.map(A::signal);
            if quantity == Quantity::Dark {
                // What would take charge away has no shot noise.
                let mut below = [zero; BLOCK];
                for (v, below) in values.iter_mut().zip(&mut below) {
                    if *v < zero {
                        *below = core::mem::take(v);
                    }
                }
                A::poisson(core::slice::from_mut(&mut values), &mut counts);
                for (v, below) in values.iter_mut().zip(below) {
                    *v = A::add(*v, below);
                }
            }
            for (v, f) in block.iter_mut().zip(values) {
                *v = A::add(*v, f);
            }
        }
    }

    /// The share of its amount that line noise has in a row, (s/S)^e.
    #[inline(always)]
    fn share_of<A: Arith>(&self, cx: &Context<'_>, row: &[Block<A::Signal>]) -> f32 {
        if self.on_signal == 0.0 {
            return 1.0;
        }
        let pixels = row.as_flattened().iter().take(cx.width as usize);
        let mean = pixels.fold(0.0, |sum, v| sum + A::electrons(*v)) / cx.width as f32;
        let ratio = mean / self.signal_e;
        if ratio > MIN_RATIO { math::pow(ratio, self.on_signal) } else { 0.0 }
    }
}

/// Share of the reference signal below which noise that grows with it is none: `math::pow` needs a
/// positive number.
const MIN_RATIO: f32 = 1e-6;

const _: () = assert!(MAX_TABLE <= 1024, "`start` reaches every word");
