//! The figures of a stream, as text and JSON.

use super::Args;
use super::pace::{FrameTime, Pace};
use camrig_base::numbers::counted;
use camrig_base::output::LiveOutput;
use camrig_rig::{Rig, RigFrame};
use camrig_rig_link::message::{Exposure, Fault};
use camrig_sensor_core::config::FrameSettings;
use serde_json::{Value, json};

/// The settings and times of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Record {
    counter: u16,
    frame: u32,
    exposure: Exposure,
    dropped: bool,
    fault: Fault,
    test_pattern: u16,
    time: FrameTime,
}

impl Record {
    /// Of a received frame.
    pub fn new(frame: &RigFrame, time: FrameTime) -> Self {
        let start = &frame.start;
        Self {
            counter: start.counter,
            frame: start.frame,
            exposure: start.exposure,
            dropped: frame.dropped,
            fault: start.fault,
            test_pattern: start.test_pattern,
            time,
        }
    }

    /// The settings in force, and injected faults.
    fn settings(&self) -> Value {
        let mut settings = json!({
            "counter": self.counter,
            "frame": self.frame,
            "exposure_s": self.exposure.exposure_s,
            "analog_gain": self.exposure.analog_gain,
            "dropped": self.dropped,
            "fault": fault(self.fault),
            "test_pattern": self.test_pattern,
        });
        if let Some(late) = self.time.late {
            settings["late_us"] = json!(1e6 * late);
        }
        settings
    }
}

/// A fault by name, `null` for none.
fn fault(fault: Fault) -> Value {
    match fault {
        Fault::None => Value::Null,
        Fault::DropFrame => json!({ "kind": "drop-frame" }),
        Fault::CorruptRow(row) => json!({ "kind": "corrupt-row", "row": row }),
        Fault::StuckCounter => json!({ "kind": "stuck-counter" }),
        Fault::LateFrame(ms) => json!({ "kind": "late-frame", "ms": ms }),
        _ => json!({ "kind": "unknown" }),
    }
}

/// The outcome of a stream, apart from its times.
#[derive(Default)]
pub struct Outcome {
    /// Frames that the sensor dropped on request.
    pub dropped: u64,
    /// Those of them in standby.
    pub standby: u64,
    /// Frames whose light was computed for another exposure than the rig's.
    pub exposure_missed: u64,
    /// Frames of another exposure or gain than was asked for.
    pub settings_missed: u64,
    /// Whether an error ended the stream, so that no rate was kept.
    pub broke_off: bool,
    /// Every frame, for `--json`.
    pub records: Vec<Record>,
    /// Frames of a scene that is a sequence, counted.
    pub scene_frames: Value,
    /// Notes about the light, the lens and the camera's tables.
    pub notes: Vec<String>,
}

impl Outcome {
    /// Counts a frame of another exposure or gain than was asked for, if any was.
    pub fn count_settings(&mut self, asked: Option<FrameSettings>, used: Exposure) {
        let missed = asked.is_some_and(|asked| {
            [asked.exposure_s, asked.analog_gain] != [used.exposure_s, used.analog_gain]
        });
        self.settings_missed += u64::from(missed);
    }
}

/// Prints figures: one JSON object, or lines of text, which go to standard error if the frames are
/// on standard output.
pub fn tell(args: &Args, rig: &Rig, before: (u64, u64), pace: &Pace, outcome: &Outcome) {
    let (sent, received) = rig.link_bytes();
    let (sent, received) = (sent.saturating_sub(before.0), received.saturating_sub(before.1));
    let s = rig.statistics();
    let repairs: Value = json!({
        "damaged_packets": s.damaged,
        "rewinds": s.rewinds,
        "timeouts": s.timeouts,
    });
    let ([p50, p99], max) = (pace.latency_ms([0.5, 0.99]), pace.longest_ms());
    let (fps, seconds, dropped) = (pace.frames_per_s(), pace.seconds(), outcome.dropped);
    if args.json {
        let late = args.fps.map(|_| pace.late());
        let times: Vec<Value> = outcome.records.iter().map(|record| record.time.json()).collect();
        let settings: Vec<Value> = outcome.records.iter().map(Record::settings).collect();
        println!(
            "{}",
            json!({
                "frames": pace.frames(),
                "dropped_on_request": dropped,
                "frames_dropped": dropped,
                "frames_in_standby": outcome.standby,
                "scene_frames": outcome.scene_frames,
                "exposure_missed": outcome.exposure_missed,
                "settings_missed": outcome.settings_missed,
                "seconds": seconds,
                "frames_per_s": fps,
                "rate_hz": fps,
                "fps_asked": args.fps,
                "pace_kept": pace.is_kept().filter(|_| !outcome.broke_off),
                "late_frames": late,
                "frames_late": late,
                "frame_times": times,
                "latency_p50_ms": p50,
                "latency_p99_ms": p99,
                "latency_max_ms": max,
                "latency_us": { "p50": 1e3 * p50, "p99": 1e3 * p99, "max": 1e3 * max },
                "sent_bytes": sent,
                "received_bytes": received,
                "repairs": repairs,
                "settings": settings,
                "notes": outcome.notes,
            })
        );
        return;
    }
    let rate = |bytes: u64| bytes as f64 / seconds / 1e6;
    let mut lines = vec![
        format!(
            "{} in {seconds:.2} s: {fps:.2} frames/s",
            counted(pace.frames() as usize, "frame")
        ),
        format!("latency p50 {p50:.1} ms, p99 {p99:.1} ms, largest {max:.1} ms"),
        format!("sent {:.3} MB/s, received {:.3} MB/s", rate(sent), rate(received)),
    ];
    if s.damaged + s.rewinds + s.timeouts > 0 {
        lines.push(format!("repairs: {repairs}"));
    }
    let requested = dropped - outcome.standby;
    for (frames, why) in [
        (requested, "as requested by the rig's fault register"),
        (outcome.standby, "since the rig is in standby (register 0x0100 is 0)"),
    ] {
        if frames > 0 {
            lines.push(format!("dropped {}, {why}", counted(frames as usize, "frame")));
        }
    }
    if outcome.exposure_missed > 0 {
        lines.push(format!(
            "{} frames had another exposure than their light was computed for: another host \
             writes the rig's registers",
            outcome.exposure_missed
        ));
    }
    if outcome.settings_missed > 0 {
        lines.push(format!(
            "{} of another exposure or gain than was asked for",
            counted(outcome.settings_missed as usize, "frame")
        ));
    }
    let text = lines.join("\n");
    match args.output.as_deref().is_some_and(LiveOutput::is_stdout) {
        true => eprintln!("{text}"),
        false => println!("{text}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_other_settings_are_counted_where_any_were_asked_for() {
        let used = |exposure_s: f32, analog_gain: f32| Exposure { exposure_s, analog_gain };
        let asked = FrameSettings::new(0.005).with_gain(2.0);
        let mut outcome = Outcome::default();
        outcome.count_settings(Some(asked), used(0.005, 2.0));
        outcome.count_settings(None, used(0.001, 4.0));
        assert_eq!(outcome.settings_missed, 0);
        outcome.count_settings(Some(asked), used(0.001, 2.0));
        outcome.count_settings(Some(asked), used(0.005, 4.0));
        assert_eq!(outcome.settings_missed, 2);
    }
}
