//! A sequence read once, or over and over, on a clock that begins with its first frame.

use super::{SceneFrame, SceneSequence};
use camrig_base::{Error, Result};

/// Time stamps are rounded, to whole nanoseconds or to what a file's text holds; a frame whose
/// stamp is later by no more than this is there already, s. Far below any exposure.
pub(super) const ROUNDING_S: f64 = 1e-6;

/// When a frame is shown, s after the first frame of the first round.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub start: f64,
    pub end: Option<f64>,
    /// How long the frame before was shown.
    before: f64,
}

impl Span {
    /// When it is over where no frame follows: at the end that is known, else after as long as the
    /// frame before was shown.
    pub fn last_end(&self) -> f64 {
        self.end.unwrap_or(self.start + self.before)
    }
}

/// Frames of a scene, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames of the scene that came.
    pub received: u64,
    /// Of these, frames that some frame of the sensor shows.
    pub used: u64,
    /// Of these, frames that none shows: the next was due already.
    pub skipped: u64,
    /// Frames of the sensor that show the same as the one before.
    pub held: u64,
}

/// The rounds of a sequence, and what came of its frames.
pub struct Rounds {
    sequence: Box<dyn SceneSequence>,
    repeats: bool,
    /// Whether frames are shown by their time stamps.
    timed: bool,
    /// Time stamp of the first frame.
    origin_s: Option<f64>,
    /// When the rounds before this one were over.
    rounds_s: f64,
    /// Of the frame that was read last.
    last: Option<Span>,
    pub(super) counts: Counts,
}

impl Rounds {
    pub(super) fn new(sequence: Box<dyn SceneSequence>, timed: bool, repeats: bool) -> Self {
        let (origin_s, rounds_s, last, counts) = (None, 0.0, None, Counts::default());
        Self { sequence, repeats, timed, origin_s, rounds_s, last, counts }
    }

    /// What is shown, for messages.
    #[must_use]
    pub fn name(&self) -> &str {
        self.sequence.name()
    }

    /// What was assumed or left out since it was last asked.
    pub fn notes(&mut self) -> Vec<String> {
        self.sequence.notes()
    }

    /// Frames so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// The next frame of the sequence, from the first again where it repeats.
    pub(super) fn read(&mut self) -> Result<Option<(SceneFrame, Span)>> {
        let mut next = self.sequence.next_frame()?;
        if next.is_none() && self.repeats && self.counts.received > 0 {
            self.rounds_s = self.round_end()?;
            self.sequence.rewind()?;
            self.last = None;
            next = self.sequence.next_frame()?;
        }
        let Some(frame) = next else {
            return if self.counts.received > 0 { Ok(None) } else { Err(self.empty()) };
        };
        self.counts.received += 1;
        let origin = *self.origin_s.get_or_insert(frame.start_s);
        let after = |time: f64| self.rounds_s + (time - origin);
        let start = after(frame.start_s);
        let before = self.last.map_or(0.0, |span| start - span.start);
        let span = Span { start, end: frame.end_s.map(after), before };
        self.last = Some(span);
        Ok(Some((frame, span)))
    }

    fn empty(&self) -> Error {
        Error::input("a sequence without frames").at(self.sequence.name())
    }

    /// When this round is over.
    fn round_end(&self) -> Result<f64> {
        if !self.timed {
            return Ok(self.rounds_s);
        }
        let end = self.last.map_or(self.rounds_s, |span| span.last_end());
        if end > self.rounds_s {
            return Ok(end);
        }
        let what = "a sequence that lasts no time, over and over";
        Err(Error::input(what).at(self.sequence.name()))
    }
}
