//! A real sensor's registers in front of the emulator: what a driver writes to them over I2C sets
//! exposure, gain and frame length of a live camera.

use camrig_base::Result;
use camrig_gige::Pace;
use camrig_profiles::{Frame, Profile, Sensor};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Shortest exposure, s: what registers ask for below has no light worth a number, and a frame
/// has some exposure.
const MIN_EXPOSURE_S: f64 = 1e-9;

/// A sensor that was just switched on, by the name of its profile or the file of one.
pub fn open(profile: &str) -> Result<Sensor> {
    let is_file = Path::new(profile).extension().is_some_and(|end| end == "toml");
    let known = || Profile::names().collect::<Vec<_>>().join(", ");
    let read = match is_file {
        true => Profile::load(Path::new(profile)),
        false => Profile::builtin(profile).map_err(|e| {
            e.help(format!("give the file of a profile (NAME.toml), or {}", known()))
        }),
    };
    read.map(Sensor::new)
}

/// The sensor, as the source of frames sees it.
pub struct Registers<'a> {
    sensor: &'a Mutex<Sensor>,
    /// As it was when the last frame had begun.
    before: Sensor,
    /// Columns and rows of the images.
    size: (u32, u32),
    /// What was reported: each is once.
    reported: Vec<&'static str>,
}

impl<'a> Registers<'a> {
    /// Of a camera whose images have this size.
    pub fn new(sensor: &'a Mutex<Sensor>, size: (u32, u32)) -> Self {
        let mut registers = Self { before: lock(sensor).clone(), sensor, size, reported: vec![] };
        registers.before.settle();
        registers
    }

    /// How frames follow one another.
    pub fn pace(&self) -> Pace {
        // Another sensor that is as this one is: the frame has not begun.
        let coming = lock(self.sensor).clone().next_frame();
        coming.map_or(Pace::Standby, |frame| Pace::Every(lasts(&frame)))
    }

    /// Begins a frame; `None` in standby. `after_pause`: others have gone by that nobody took.
    /// `is_stuck`: what was written since the last frame is lost.
    pub fn next_frame(&mut self, after_pause: bool, is_stuck: bool) -> Option<Frame> {
        let mut sensor = lock(self.sensor);
        if is_stuck {
            *sensor = self.before.clone();
        }
        if after_pause {
            sensor.settle();
        }
        let frame = sensor.next_frame();
        self.before = sensor.clone();
        drop(sensor);
        let mut frame = frame?;
        self.report(&frame);
        frame.exposure_s = frame.exposure_s.max(MIN_EXPOSURE_S);
        Some(frame)
    }

    /// Says what the registers ask for and these frames do not have.
    fn report(&mut self, frame: &Frame) {
        let asked = [
            (frame.digital_gain != 1.0, "digital gain"),
            (frame.is_mirrored || frame.is_flipped, "mirrored or flipped images"),
            (frame.test_pattern.is_some(), "a test pattern"),
            (frame.size.is_some_and(|size| size != self.size), "images of another size"),
            (frame.is_automatic, "the sensor's own control of exposure and gain"),
        ];
        for (_, what) in asked.into_iter().filter(|(is_asked, _)| *is_asked) {
            if !self.reported.contains(&what) {
                self.reported.push(what);
                eprintln!("note: the sensor's registers ask for {what}, which frames do not have");
            }
        }
    }
}

/// From the beginning of a frame to that of the next.
pub fn lasts(frame: &Frame) -> Duration {
    Duration::try_from_secs_f64(frame.frame_s).unwrap_or(Duration::MAX)
}

fn lock(sensor: &Mutex<Sensor>) -> MutexGuard<'_, Sensor> {
    // With a thread that panicked the server ends.
    sensor.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal::i2c::I2c;

    const ADDRESS: u8 = 0x10;

    fn write(sensor: &Mutex<Sensor>, bytes: &[u8]) {
        lock(sensor).write(ADDRESS, bytes).unwrap();
    }

    #[test]
    fn frames_follow_registers_with_their_delays_pauses_and_faults() {
        let sensor = Mutex::new(open("imx219").unwrap());
        let mut registers = Registers::new(&sensor, (3280, 2464));
        assert_eq!(registers.pace(), Pace::Standby);
        assert_eq!(registers.next_frame(true, false), None);
        write(&sensor, &[0x01, 0x5A, 0, 10]);
        write(&sensor, &[0x01, 0x00, 1]);
        let line_s = 3448.0 / 182.4e6;
        let frame_s = f64::from(0x0DC6) * line_s;
        assert_eq!(registers.pace(), Pace::Every(Duration::from_secs_f64(frame_s)));
        let mut lines = |after_pause, is_stuck| {
            let frame = registers.next_frame(after_pause, is_stuck).unwrap();
            (frame.exposure_s / line_s).round()
        };
        assert_eq!(lines(true, false), 10.0);
        write(&sensor, &[0x01, 0x5A, 0, 20]);
        assert_eq!([lines(false, false), lines(false, false)], [10.0, 20.0], "two frames");
        write(&sensor, &[0x01, 0x5A, 0, 30]);
        assert_eq!(lines(true, false), 30.0, "at once after a pause");
        write(&sensor, &[0x01, 0x5A, 0, 40]);
        assert_eq!([lines(false, true), lines(false, false)], [30.0; 2], "lost");
        assert_eq!(lock(&sensor).register(0x015B), 30);
        assert!(registers.reported.is_empty(), "{:?}", registers.reported);
        write(&sensor, &[0x01, 0x72, 1]);
        registers.next_frame(false, false);
        assert_eq!(registers.reported, ["mirrored or flipped images"]);
    }

    #[test]
    fn a_sensor_is_a_name_or_a_file() {
        assert!(open("imx999").unwrap_err().to_string().contains("imx219"));
        assert!(open("none/such.toml").unwrap_err().to_string().contains("such.toml"));
    }
}
