//! Fixed patterns: a value for each pixel of the frame.

use super::curve::Curve;
use super::{Context, Shape, since_start};
use crate::arith::{Arith, BLOCK};
use crate::math;
use crate::stream::Lanes;

/// The values of a row's pixels, block by block.
#[allow(clippy::large_enum_variant, reason = "streams cannot be boxed without an allocator")]
pub(super) enum Field<'a> {
    /// From a column and a row on so much more: (column, row, step).
    Seam(&'a [[f32; 3]]),
    /// Σ a sin(2π(f_x x + f_y y + φ)): (f_x, f_y, φ in turns, a).
    Wave(&'a [[f32; 4]]),
    /// A curve over the columns.
    RowProfile(Curve<'a, 2>),
    /// The same along the row, over rows or over frames.
    Level(f32),
    /// Σ u_k(x) v_k(y): knots of u and v, equally apart from the first pixel to the last.
    Map(Terms<'a>),
    /// A quantile function, over a standard normal number that each pixel has.
    Distribution(Curve<'a, 2>, Lanes),
}

/// The products of a map: numbers of knots over columns and rows, then for each term all of both.
#[derive(Clone, Copy)]
pub(super) struct Terms<'a> {
    columns: usize,
    rows: usize,
    knots: &'a [f32],
}

impl<'a> Terms<'a> {
    fn new(words: &'a [f32]) -> Option<Self> {
        let ([columns, rows], knots) = words.split_first_chunk()?;
        let (columns, rows) = (*columns as usize, *rows as usize);
        let sound = columns > 0
            && rows > 0
            && !knots.is_empty()
            && knots.len().checked_rem(columns + rows) == Some(0);
        sound.then_some(Self { columns, rows, knots })
    }

    /// Knots over columns, and the value over rows, of each term.
    fn over(&self, share: f32) -> impl Iterator<Item = (&'a [f32], f32)> {
        let columns = self.columns;
        self.knots.chunks_exact((columns + self.rows).max(1)).filter_map(move |term| {
            let (over_columns, over_rows) = term.split_at_checked(columns)?;
            Some((over_columns, between(over_rows, share)))
        })
    }
}

/// The value at a share (0 to 1) of the way along knots that are equally apart.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn between(knots: &[f32], share: f32) -> f32 {
    let place = share * knots.len().saturating_sub(1) as f32;
    let i = place as usize;
    let value = |i: usize| knots.get(i).or(knots.last()).copied().unwrap_or(0.0);
    let a = value(i);
    a + (place - i as f32) * (value(i + 1) - a)
}

/// The share of the way from the first of `count` lines to the last.
#[inline(always)]
fn share(line: usize, count: u32) -> f32 {
    line as f32 / count.saturating_sub(1).max(1) as f32
}

impl<'a> Field<'a> {
    /// Whether words are the table of a seam, a wave or a map.
    pub fn is_one(shape: Shape, words: &[f32]) -> bool {
        match shape {
            Shape::Seam => !words.is_empty() && words.as_chunks::<3>().1.is_empty(),
            Shape::Wave => !words.is_empty() && words.as_chunks::<4>().1.is_empty(),
            _ => Terms::new(words).is_some(),
        }
    }

    #[inline(always)]
    pub fn new(cx: &Context<'_>, shape: Shape, words: &'a [f32]) -> Self {
        match shape {
            Shape::Seam => Self::Seam(words.as_chunks().0),
            Shape::Wave => Self::Wave(words.as_chunks().0),
            Shape::RowProfile => Self::RowProfile(Curve::new(words)),
            Shape::ColumnProfile => Self::Level(Curve::<2>::new(words).at(cx.row as f32)[1]),
            Shape::FrameCurve => Self::Level(since_start::level(cx.frame, words)),
            Shape::Map => Terms::new(words).map_or(Self::Level(0.0), Self::Map),
            _ => Self::Distribution(Curve::new(words), cx.per_pixel(0)),
        }
    }

    /// The values of a block; blocks are asked for in their order.
    #[inline(always)]
    pub fn block<A: Arith>(&mut self, cx: &Context<'_>, block: usize) -> [f32; BLOCK] {
        let mut out = [0.0; BLOCK];
        let first = block * BLOCK;
        let columns = out.iter_mut().zip(first..);
        match self {
            Self::Seam(steps) => {
                let row = cx.row as f32;
                for (out, x) in columns {
                    let on = |[column, from, _]: &&[f32; 3]| *column <= x as f32 && *from <= row;
                    *out = steps.iter().filter(on).fold(0.0, |sum, [_, _, step]| sum + step);
                }
            }
            Self::Wave(waves) => {
                // Angles in units of 2⁻³² turns, which wrap around at a whole turn.
                let turns = |cycles: f32| (cycles * 4_294_967_296.0) as i64 as u32;
                for [fx, fy, phase, amplitude] in *waves {
                    let by_column = turns(*fx);
                    let start = turns(*phase).wrapping_add(turns(*fy).wrapping_mul(cx.row));
                    let mut at = start.wrapping_add(by_column.wrapping_mul(first as u32));
                    for out in &mut out {
                        *out += amplitude * math::sin_cos_turns(at).0;
                        at = at.wrapping_add(by_column);
                    }
                }
            }
            Self::RowProfile(curve) => columns.for_each(|(out, x)| *out = curve.at(x as f32)[1]),
            Self::Level(level) => out.fill(*level),
            Self::Map(terms) => {
                for (knots, over_rows) in terms.over(share(cx.row as usize, cx.height)) {
                    for (out, x) in out.iter_mut().zip(first..) {
                        *out += over_rows * between(knots, share(x, cx.width));
                    }
                }
            }
            Self::Distribution(curve, lanes) => {
                for (out, z) in out.iter_mut().zip(A::normals(lanes)) {
                    *out = curve.at(A::number(z))[1];
                }
            }
        }
        out
    }
}
