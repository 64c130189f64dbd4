//! Which frame of a sequence is shown when.
//!
//! Frame n of a sensor is taken at n over its frame rate, counted from the time stamp of the
//! sequence's first frame, and shows the newest frame of the scene whose time stamp is not later
//! (the nearest past). The scene stands still during a frame. A sequence ends where its last frame
//! does: at the end that its rate gives it, else after as long as the frame before was shown.
//!
//! Where the sequence has no time stamps, or the sensor no frame rate, each frame of the sensor
//! shows the next frame of the scene.

use super::rounds::{ROUNDING_S, Rounds, Span};
use super::{SceneFrame, SceneSequence};
use camrig_base::Result;

/// What a frame of a sensor shows.
pub enum Moment {
    /// The same as the frame before.
    Same,
    /// Another frame of the scene.
    Next(SceneFrame),
    /// The sequence has ended.
    Over,
}

/// A sequence as it is shown to a sensor.
pub struct Playback {
    /// The sequence.
    pub rounds: Rounds,
    /// Frames of the sensor per second, where both it and the sequence have times.
    sensor_hz: Option<f64>,
    showing: Option<Span>,
    /// Read, but not yet due.
    ahead: Option<(SceneFrame, Span)>,
}

impl Playback {
    /// Shows `sequence` to a sensor of `sensor_hz` frames per second, over and over where it
    /// `repeats`.
    #[must_use]
    pub fn new(sequence: Box<dyn SceneSequence>, sensor_hz: Option<f64>, repeats: bool) -> Self {
        let sensor_hz = sensor_hz.filter(|_| sequence.is_timed());
        Self {
            rounds: Rounds::new(sequence, sensor_hz.is_some(), repeats),
            sensor_hz,
            showing: None,
            ahead: None,
        }
    }

    /// Whether frames are shown by their time stamps, and not one after the other.
    #[must_use]
    pub fn is_timed(&self) -> bool {
        self.sensor_hz.is_some()
    }

    /// What frame `frame` of the sensor shows. Frames are asked for in order, from 0 on.
    ///
    /// # Errors
    /// Those of [`SceneSequence::next_frame`]; a sequence without frames.
    pub fn at(&mut self, frame: u64) -> Result<Moment> {
        let moment = match self.sensor_hz {
            Some(hz) => self.at_time(frame as f64 / hz)?,
            None => self.rounds.read()?.map_or(Moment::Over, |(frame, _)| Moment::Next(frame)),
        };
        match &moment {
            Moment::Same => self.rounds.counts.held += 1,
            Moment::Next(_) => self.rounds.counts.used += 1,
            Moment::Over => {}
        }
        Ok(moment)
    }

    fn at_time(&mut self, time_s: f64) -> Result<Moment> {
        let due = time_s + ROUNDING_S;
        let mut shown = None;
        // The next frame need not be there while it is known that this one is shown.
        while self.showing.is_none_or(|span| span.end.is_none_or(|end| end <= due)) {
            let ahead = self.ahead.take();
            let Some((frame, span)) = ahead.map_or_else(|| self.rounds.read(), |a| Ok(Some(a)))?
            else {
                return Ok(self.at_the_end(due, shown));
            };
            if span.start > due {
                self.ahead = Some((frame, span));
                break;
            }
            self.showing = Some(span);
            self.rounds.counts.skipped += u64::from(shown.replace(frame).is_some());
        }
        Ok(shown.map_or(Moment::Same, Moment::Next))
    }

    /// What is shown where no frame follows.
    fn at_the_end(&mut self, due: f64, shown: Option<SceneFrame>) -> Moment {
        let over = self.showing.is_none_or(|span| span.last_end() <= due);
        // A frame alone, of which nothing says how long it lasts, is shown once.
        let alone = self.showing.is_some_and(|span| span.last_end() == span.start);
        match shown {
            Some(frame) if alone || !over => Moment::Next(frame),
            None if !over => Moment::Same,
            shown => {
                self.rounds.counts.skipped += u64::from(shown.is_some());
                Moment::Over
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::rounds::Counts;
    use super::*;
    use camrig_base::Error;

    /// Frames that are shown from and to these times; none can be opened.
    pub struct Times {
        spans: Vec<(f64, Option<f64>)>,
        at: usize,
        timed: bool,
    }

    impl SceneSequence for Times {
        fn name(&self) -> &str {
            "times"
        }

        fn is_timed(&self) -> bool {
            self.timed
        }

        fn next_frame(&mut self) -> Result<Option<SceneFrame>> {
            let Some(&span) = self.spans.get(self.at) else { return Ok(None) };
            self.at += 1;
            let number = self.at as u64 - 1;
            let none = || Err(Error::input("no scene"));
            Ok(Some(SceneFrame::new(number, span, number.to_string(), none)))
        }

        fn rewind(&mut self) -> Result<()> {
            self.at = 0;
            Ok(())
        }

        fn notes(&mut self) -> Vec<String> {
            Vec::new()
        }
    }

    pub fn times(spans: &[(f64, Option<f64>)]) -> Box<Times> {
        Box::new(Times { spans: spans.to_vec(), at: 0, timed: true })
    }

    pub fn regular(count: usize, hz: f64) -> Box<Times> {
        let at = |k: usize| k as f64 / hz;
        times(&(0..count).map(|k| (at(k), Some(at(k + 1)))).collect::<Vec<_>>())
    }

    /// The frames of the scene that frames of the sensor show, `most` at most.
    fn shown(playback: &mut Playback, most: u64) -> Vec<u64> {
        let mut shown = Vec::new();
        for frame in 0..most {
            match playback.at(frame).unwrap() {
                Moment::Same => shown.push(*shown.last().unwrap()),
                Moment::Next(frame) => shown.push(frame.number),
                Moment::Over => break,
            }
        }
        shown
    }

    #[test]
    fn the_newest_frame_that_is_not_in_the_future_is_shown() {
        let at = |scene_hz: f64, count: usize, sensor_hz: f64| {
            shown(&mut Playback::new(regular(count, scene_hz), Some(sensor_hz), false), 100)
        };
        assert_eq!(at(30.0, 3, 30.0), [0, 1, 2]);
        assert_eq!(at(24.0, 4, 60.0), [0, 0, 0, 1, 1, 2, 2, 2, 3, 3]);
        assert_eq!(at(60.0, 7, 30.0), [0, 2, 4, 6]);
        assert_eq!(at(30_000.0 / 1001.0, 5, 30_000.0 / 1001.0), [0, 1, 2, 3, 4]);
        // Rounding never moves a frame, however long it goes on.
        let shown = at(30_000.0 / 1001.0, 100, 60_000.0 / 1001.0);
        assert!(shown.iter().enumerate().all(|(n, &k)| k == n as u64 / 2), "{shown:?}");
        assert_eq!(shown.len(), 100);
    }

    #[test]
    fn frames_are_counted() {
        let mut slow = Playback::new(regular(4, 24.0), Some(60.0), false);
        shown(&mut slow, 100);
        let counts = |received, used, skipped, held| Counts { received, used, skipped, held };
        assert_eq!(slow.rounds.counts(), counts(4, 4, 0, 6));
        let mut fast = Playback::new(regular(8, 60.0), Some(30.0), false);
        assert_eq!(shown(&mut fast, 100), [0, 2, 4, 6]);
        assert_eq!(fast.rounds.counts(), counts(8, 4, 4, 0));
    }

    #[test]
    fn without_times_of_both_each_frame_shows_the_next() {
        assert_eq!(shown(&mut Playback::new(regular(3, 7.0), None, false), 9), [0, 1, 2]);
        let untimed = Times { timed: false, ..*regular(3, 1.0) };
        let mut playback = Playback::new(Box::new(untimed), Some(30.0), true);
        assert_eq!(shown(&mut playback, 7), [0, 1, 2, 0, 1, 2, 0]);
    }

    #[test]
    fn a_round_follows_the_other_without_a_gap() {
        let mut playback = Playback::new(regular(3, 24.0), Some(48.0), true);
        assert_eq!(shown(&mut playback, 9), [0, 0, 1, 1, 2, 2, 0, 0, 1]);
        let mut still = Playback::new(times(&[(5.0, None)]), Some(48.0), true);
        assert!(still.at(0).err().unwrap().to_string().contains("lasts no time"));
    }

    /// Stamps that are rounded to nanoseconds, irregular, from any origin on; the last frame lasts
    /// as long as the one before it.
    #[test]
    fn time_stamps_need_not_be_regular() {
        let stamps = [7.0, 7.033_333_333, 7.066_666_667, 7.2, 7.3];
        let spans: Vec<_> = stamps.iter().map(|&s| (s, None)).collect();
        let mut playback = Playback::new(times(&spans), Some(30.0), false);
        assert_eq!(shown(&mut playback, 100), [0, 1, 2, 2, 2, 2, 3, 3, 3, 4, 4, 4]);
        let mut alone = Playback::new(times(&[(7.0, None)]), Some(30.0), false);
        assert_eq!(shown(&mut alone, 100), [0]);
        let empty = Playback::new(times(&[]), Some(30.0), true).at(0).err().unwrap().to_string();
        assert!(empty.contains("without frames"), "{empty}");
    }
}
