//! A sequence as a sensor's rows see it: the frames in whose light a frame of the sensor is taken,
//! with their weights row by row.
//!
//! Frames that no row sees are never opened, those that one sees are opened once, and none is kept
//! longer than a row may see it. The frames of a sensor end with the last one that begins before
//! the sequence is over; its rows see the last frame for as long as they need.

use super::between::{Between, Knot, weights};
use super::rounds::{Counts, ROUNDING_S, Rounds, Span};
use super::{SceneFrame, SceneSequence};
use camrig_base::{Error, Result};
use camrig_light::Lamps;
use std::collections::VecDeque;

/// Least weight for which a frame is opened: far below a step of any converter, and above the
/// rounding of times.
const LEAST: f64 = 1e-9;

/// A sequence in time. `T` is what becomes of a frame that is seen.
pub struct Timeline<T> {
    /// The sequence.
    pub rounds: Rounds,
    between: Between,
    lamps: Lamps,
    /// Frames in order of time, from the one before the first window on.
    frames: VecDeque<Frame<T>>,
    /// When the sequence is over, where its last frame is there.
    end_s: Option<f64>,
    begun: bool,
}

struct Frame<T> {
    knot: Knot,
    span: Span,
    seen: Seen<T>,
}

enum Seen<T> {
    NotYet(Option<SceneFrame>),
    Opened(T),
}

/// What the rows of a frame see: frames of the scene, and the weight of each in each row.
pub type Views<'a, T> = Vec<(&'a T, Vec<f64>)>;

impl<T> Timeline<T> {
    /// A sequence with time stamps, read once or over and over, in the light of lamps.
    #[must_use]
    pub fn new(
        sequence: Box<dyn SceneSequence>,
        repeats: bool,
        between: Between,
        lamps: Lamps,
    ) -> Self {
        Self {
            rounds: Rounds::new(sequence, true, repeats),
            between,
            lamps,
            frames: VecDeque::new(),
            end_s: None,
            begun: false,
        }
    }

    /// The first frame, before any window is asked for.
    ///
    /// # Errors
    /// Those of [`Timeline::views`].
    pub fn first(&mut self, open: impl FnOnce(SceneFrame) -> Result<T>) -> Result<&T> {
        if self.frames.is_empty() {
            self.read()?;
        }
        let none = || Error::internal("a sequence without a first frame");
        let frame = self.frames.front_mut().ok_or_else(none)?;
        frame.opened(open, &mut self.rounds.counts)?.ok_or_else(none)
    }

    /// What rows see whose windows open and close at these times, s after the first frame; none
    /// where the sequence is over before. `open` makes of a frame what is seen of it. Windows are
    /// asked for in order of time.
    ///
    /// # Errors
    /// Those of [`SceneSequence::next_frame`] and of `open`; a sequence without frames; more frames
    /// than `most` that are seen at once.
    pub fn views(
        &mut self,
        rows: &[[f64; 2]],
        most: usize,
        mut open: impl FnMut(SceneFrame) -> Result<T>,
    ) -> Result<Option<Views<'_, T>>> {
        let first = rows.iter().fold(f64::MAX, |a, row| a.min(row[0]));
        let last = rows.iter().fold(f64::MIN, |a, row| a.max(row[1]));
        self.read_until(first, last)?;
        // A frame alone, of which nothing says how long it lasts, is shown once.
        let lasts = self.end_s.is_none_or(|end| end > first + ROUNDING_S || !self.begun);
        if !lasts {
            return Ok(None);
        }
        let knots: Vec<Knot> = self.frames.iter().map(|frame| frame.knot).collect();
        let mut columns = vec![vec![0.0; rows.len()]; knots.len()];
        for (y, row) in rows.iter().enumerate() {
            let weights = weights(&knots, self.between, &self.lamps, *row);
            columns.iter_mut().zip(weights).for_each(|(column, weight)| column[y] = weight);
        }
        let seen = |column: &[f64]| column.iter().any(|w| *w > LEAST);
        // Lamps may leave all frames dark; one of them tells what is dark.
        let all_dark = !columns.iter().any(|column| seen(column));
        let count = columns.iter().filter(|column| seen(column)).count();
        if count > most {
            let what = format!("{count} frames of {} in one of the sensor's", self.rounds.name());
            return Err(Error::limit(what).help(format!(
                "memory is for {most}: let the scene have fewer frames per second"
            )));
        }
        let opened = self.rounds.counts.used;
        let mut views = Vec::new();
        for (i, (frame, column)) in self.frames.iter_mut().zip(columns).enumerate() {
            if (seen(&column) || all_dark && i == 0)
                && let Some(seen) = frame.opened(&mut open, &mut self.rounds.counts)?
            {
                views.push((seen, column));
            }
        }
        let same = self.rounds.counts.used == opened && self.begun;
        self.rounds.counts.held += u64::from(same);
        self.begun = true;
        Ok(Some(views))
    }

    /// Reads on until the light is known from one time to another, and drops what is over before.
    fn read_until(&mut self, first: f64, last: f64) -> Result<()> {
        loop {
            while self.frames.get(1).is_some_and(|next| next.knot.start_s <= first) {
                let dropped = self.frames.pop_front();
                let unseen = |frame: Frame<T>| matches!(frame.seen, Seen::NotYet(_));
                self.rounds.counts.skipped += u64::from(dropped.is_some_and(unseen));
            }
            let known =
                self.frames.back().is_some_and(|newest| match (self.between, newest.span.end) {
                    (Between::Hold, Some(end)) => end + ROUNDING_S >= last,
                    _ => newest.knot.start_s >= last,
                });
            if known || self.end_s.is_some() {
                return Ok(());
            }
            self.read()?;
        }
    }

    /// Reads the next frame, or learns when the sequence is over.
    fn read(&mut self) -> Result<()> {
        let Some((frame, span)) = self.rounds.read()? else {
            self.end_s = self.frames.back().map(|newest| newest.span.last_end());
            return Ok(());
        };
        let knot = Knot { start_s: span.start, cut: frame.cut };
        self.frames.push_back(Frame { knot, span, seen: Seen::NotYet(Some(frame)) });
        Ok(())
    }
}

impl<T> Frame<T> {
    /// What is seen of it; none where opening it has failed before.
    fn opened(
        &mut self,
        open: impl FnOnce(SceneFrame) -> Result<T>,
        counts: &mut Counts,
    ) -> Result<Option<&T>> {
        if let Seen::NotYet(scene) = &mut self.seen
            && let Some(scene) = scene.take()
        {
            self.seen = Seen::Opened(open(scene)?);
            counts.used += 1;
        }
        Ok(match &self.seen {
            Seen::Opened(seen) => Some(seen),
            Seen::NotYet(_) => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sequence::playback::tests::{regular, times};

    /// What the rows see: numbers of frames with their weights in the first and the last row.
    fn seen(timeline: &mut Timeline<u64>, rows: &[[f64; 2]]) -> Option<Vec<(u64, f64, f64)>> {
        let views = timeline.views(rows, 9, |frame| Ok(frame.number)).unwrap()?;
        let rounded = |w: f64| (1e6 * w).round() / 1e6;
        let ends = |w: &[f64]| (rounded(w[0]), rounded(w[w.len() - 1]));
        Some(
            views
                .iter()
                .map(|(frame, w)| {
                    let (first, last) = ends(w);
                    (**frame, first, last)
                })
                .collect(),
        )
    }

    fn timeline(hz: f64, frames: usize, between: Between, repeats: bool) -> Timeline<u64> {
        Timeline::new(regular(frames, hz), repeats, between, Lamps::default())
    }

    #[test]
    fn rows_see_the_frames_of_their_windows() {
        let mut fading = timeline(100.0, 5, Between::Linear, false);
        let rows = [[0.0, 0.005], [0.01, 0.02]];
        assert_eq!(
            seen(&mut fading, &rows),
            Some(vec![(0, 0.75, 0.0), (1, 0.25, 0.5), (2, 0.0, 0.5)])
        );
        let mut held = timeline(100.0, 5, Between::Hold, false);
        assert_eq!(seen(&mut held, &rows), Some(vec![(0, 1.0, 0.0), (1, 0.0, 1.0)]));
        // Frames 2 and 3 are in no window.
        assert_eq!(seen(&mut held, &[[0.045, 0.055]]), Some(vec![(4, 1.0, 1.0)]));
        assert_eq!(seen(&mut held, &[[0.05, 0.055]]), None);
        let counts = held.rounds.counts();
        assert_eq!((counts.received, counts.used, counts.skipped, counts.held), (5, 3, 2, 0));
    }

    #[test]
    fn a_frame_is_opened_once_and_read_no_earlier_than_it_is_needed() {
        let mut held = timeline(10.0, 4, Between::Hold, false);
        for (frame, windows) in [(0, 3), (1, 2)] {
            for i in 0..windows {
                let open = 0.1 * f64::from(frame) + 0.01 * f64::from(i);
                assert_eq!(seen(&mut held, &[[open, open + 0.01]]).unwrap().len(), 1);
            }
        }
        let counts = held.rounds.counts();
        assert_eq!((counts.received, counts.used, counts.held), (2, 2, 3));
        let mut fading = timeline(10.0, 4, Between::Linear, false);
        seen(&mut fading, &[[0.0, 0.01]]);
        assert_eq!(fading.rounds.counts().received, 2, "light that fades needs the next frame");
    }

    #[test]
    fn rounds_go_on_and_a_frame_alone_is_shown_once() {
        let mut round = timeline(10.0, 2, Between::Linear, true);
        let window = |k: u32| [[0.1 * f64::from(k), 0.1 * f64::from(k) + 0.05]];
        for k in 0..6 {
            let (now, next) = (u64::from(k % 2), u64::from((k + 1) % 2));
            let views = seen(&mut round, &window(k)).unwrap();
            assert_eq!(views, [(now, 0.75, 0.75), (next, 0.25, 0.25)], "{k}");
        }
        let alone = times(&[(7.0, None)]);
        let mut alone: Timeline<u64> =
            Timeline::new(alone, false, Between::Linear, Lamps::default());
        assert_eq!(seen(&mut alone, &window(0)), Some(vec![(0, 1.0, 1.0)]));
        assert_eq!(seen(&mut alone, &window(1)), None);
        let mut empty: Timeline<u64> =
            Timeline::new(times(&[]), true, Between::Linear, Lamps::default());
        assert!(empty.views(&window(0), 9, |f| Ok(f.number)).is_err());
    }
}
