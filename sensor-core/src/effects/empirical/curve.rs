//! A curve of straight lines between knots.

/// Knots of N numbers, the first of which is the place; places do not fall. Two knots at one place
/// are a step, of which the place itself has the second. Beyond its ends the curve stays.
#[derive(Clone, Copy)]
pub(super) struct Curve<'a, const N: usize> {
    knots: &'a [[f32; N]],
}

impl<'a, const N: usize> Curve<'a, N> {
    pub fn new(words: &'a [f32]) -> Self {
        Self { knots: words.as_chunks().0 }
    }

    /// Whether words are knots in order, at least one.
    pub fn is_one(words: &[f32]) -> bool {
        let (knots, rest) = words.as_chunks::<N>();
        let places = knots.iter().filter_map(|k| k.first());
        !knots.is_empty() && rest.is_empty() && places.is_sorted()
    }

    /// Its numbers at a place; zeros without knots.
    #[cfg_attr(target_os = "none", inline(never))]
    #[cfg_attr(not(target_os = "none"), inline(always))]
    pub fn at(&self, place: f32) -> [f32; N] {
        let after = self.knots.partition_point(|k| k.first().is_some_and(|x| *x <= place));
        let (before, after) =
            (after.checked_sub(1).and_then(|i| self.knots.get(i)), self.knots.get(after));
        let (Some(a), Some(b)) = (before, after) else {
            return before.or(after).copied().unwrap_or([0.0; N]);
        };
        // The knots differ in place, as one is beyond it.
        let share = match (a.first(), b.first()) {
            (Some(from), Some(to)) => (place - from) / (to - from),
            _ => 0.0,
        };
        let mut out = [0.0; N];
        for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
            *out = a + share * (b - a);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_knots_it_is_straight_and_two_at_one_place_are_a_step() {
        let words = [0.0, 1.0, 4.0, 3.0, 4.0, -1.0, 6.0, 0.0];
        assert!(Curve::<2>::is_one(&words));
        let curve = Curve::<2>::new(&words);
        let cases = [
            (-1.0, 1.0),
            (0.0, 1.0),
            (2.0, 2.0),
            (4.0, -1.0),
            (5.0, -0.5),
            (6.0, 0.0),
            (9.0, 0.0),
        ];
        for (place, value) in cases {
            assert_eq!(curve.at(place)[1], value, "{place}");
        }
        assert!((curve.at(3.999)[1] - 2.9995).abs() < 1e-6);
        assert!(!Curve::<2>::is_one(&[]) && !Curve::<2>::is_one(&[0.0, 1.0, 2.0]));
        assert!(!Curve::<2>::is_one(&[1.0, 1.0, 0.0, 0.0]));
        assert!(!Curve::<2>::is_one(&[f32::NAN, 1.0, 0.0, 0.0]));
        assert_eq!(Curve::<2>::new(&[]).at(1.0), [0.0, 0.0]);
    }
}
