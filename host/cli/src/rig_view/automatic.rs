//! Automatic exposure.

use camrig_base::RawFrame;
use camrig_render::auto_exposure::{Brightness, correction};

/// Frames to wait after a change: the longest delay of a rig's registers, 4, and the frame in
/// progress.
const SETTLE: u32 = 5;
/// Relative change of the exposure below which it stays, so that noise does not move it. A
/// trade-off: a seventh of a stop is hardly visible.
const DEAD_ZONE: f64 = 0.1;

/// The control loop from frames to exposures.
#[derive(Debug, Default)]
pub struct Automatic {
    on: bool,
    /// Frames still to wait for.
    wait: u32,
}

impl Automatic {
    /// Switches automatic exposure on or off.
    pub fn switch(&mut self, on: bool) {
        *self = Self { on, wait: 0 };
    }

    /// The exposure to write after a frame of `exposure_s`, if it should change.
    pub fn next(&mut self, frame: &RawFrame, exposure_s: f64) -> Option<f64> {
        if !self.on || self.wait > 0 {
            self.wait = self.wait.saturating_sub(1);
            return None;
        }
        let factor = correction(frame, Brightness::Highlights);
        if (factor - 1.0).abs() < DEAD_ZONE {
            return None;
        }
        self.wait = SETTLE;
        Some(exposure_s * factor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Cfa;

    fn frame(dn: u16) -> RawFrame {
        RawFrame {
            width: 10,
            height: 10,
            bits: 10,
            cfa: Cfa::parse("mono").unwrap(),
            black_level_dn: 0.0,
            white_level_dn: 1000,
            data: vec![dn; 100],
        }
    }

    /// The goal is 0.85 of the range.
    #[test]
    fn exposure_is_scaled_to_the_goal_and_waits_until_it_shows() {
        let mut automatic = Automatic::default();
        assert_eq!(automatic.next(&frame(425), 0.01), None, "it is off");
        automatic.switch(true);
        assert!((automatic.next(&frame(425), 0.01).unwrap() - 0.02).abs() < 1e-12);
        for _ in 0..SETTLE {
            assert_eq!(automatic.next(&frame(425), 0.01), None, "it waits");
        }
        assert_eq!(automatic.next(&frame(840), 0.02), None, "it is there");
        assert_eq!(automatic.next(&frame(1000), 0.02), Some(0.005), "saturated: a quarter");
    }
}
