//! The device without sockets and clock: requests of an attached host in, answers out; orders of
//! frames out, frames in. Times are since the device was switched on.
//!
//! Frames begin when the host commits a format (UVC 1.0, 4.3.1.1) and end when it clears the
//! endpoint, forgets a transfer of it or leaves. An image goes in one payload, with a header of two
//! bytes. Transfers wait for frames; a frame begins when its time has come, the one before has been
//! sent and a transfer waits.

use crate::descriptors::{self, CAMERA_TERMINAL, Intervals, PROCESSING_UNIT, PixelFormat};
use crate::protocol::{self, Request, Submit};
use camrig_gige::{Order, Pace, Region, Sensor, Taken, Timing};
use std::collections::VecDeque;
use std::time::Duration;

/// Bytes of the streaming controls probe and commit in UVC 1.0.
const STREAMING_BYTES: usize = 26;
/// Bytes of a payload's header.
const PAYLOAD_HEADER: usize = 2;
/// Bits of a payload's header: its end, the end of the image; bit 0 tells images apart.
const END_OF_HEADER: u8 = 0x80;
const END_OF_IMAGE: u8 = 0x02;
/// Most transfers that wait: Linux has five.
const MAX_WAITING: usize = 64;
/// UVC's unit of exposure time, and of frame intervals, ns.
const EXPOSURE_UNIT_NS: u64 = 100_000;
const INTERVAL_UNIT_NS: u64 = 100;
/// Requests of the video class.
const SET_CUR: u8 = 0x01;
const GET_CUR: u8 = 0x81;
/// Selectors: streaming probe and commit; exposure mode and time of the camera terminal; gain.
const PROBE: u8 = 1;
const COMMIT: u8 = 2;
const EXPOSURE_MODE: u8 = 2;
const EXPOSURE_TIME: u8 = 4;
const GAIN: u8 = 4;
/// The only exposure mode: manual.
const MANUAL: u32 = 1;

/// Format (an index) and frame length.
#[derive(Clone, Copy, Debug)]
struct Streaming {
    format: usize,
    frame_lines: u16,
}

/// A stream under way.
#[derive(Clone, Copy, Debug)]
struct Stream {
    /// When the next frame may begin.
    due: Duration,
    is_first: bool,
}

/// A number that the host sets: present value, least, greatest, at power-on, bytes.
struct Control {
    now: u32,
    min: u32,
    max: u32,
    usual: u32,
    bytes: usize,
}

/// A device.
#[derive(Debug)]
pub struct Device {
    sensor: Sensor,
    has_controls: bool,
    formats: Vec<PixelFormat>,
    timing: Timing,
    probe: Streaming,
    commit: Streaming,
    is_written: bool,
    stream: Option<Stream>,
    /// Whether a frame is being taken, and whether it is still wanted.
    is_busy: bool,
    is_wanted: bool,
    /// What is being sent, and how much of it has been.
    payload: Vec<u8>,
    at: usize,
    /// Transfers that wait: numbers and the most that they take.
    waiting: VecDeque<(u32, u32)>,
    next_frame: u32,
    image_bit: u8,
    /// Images sent.
    images: u64,
}

impl Device {
    /// A device that was just switched on.
    pub fn new(sensor: Sensor) -> Self {
        let streaming = Streaming { format: 0, frame_lines: sensor.timing.frame_lines };
        Self {
            has_controls: true,
            formats: PixelFormat::of_sensor(&sensor),
            timing: sensor.timing,
            probe: streaming,
            commit: streaming,
            is_written: true,
            stream: None,
            is_busy: false,
            is_wanted: false,
            payload: Vec::new(),
            at: 0,
            waiting: VecDeque::new(),
            next_frame: 0,
            image_bit: 0,
            images: 0,
            sensor,
        }
    }

    /// The same without controls of exposure and gain, which something else sets.
    #[must_use]
    pub fn without_controls(self) -> Self {
        Self { has_controls: false, ..self }
    }

    /// Images sent so far.
    pub fn images(&self) -> u64 {
        self.images
    }

    /// The host has gone: nothing waits any more. Settings stay.
    pub fn detach(&mut self) {
        self.stop();
        self.waiting.clear();
    }

    /// Takes a request with the data that follow it, and returns the answers.
    pub fn receive(&mut self, now: Duration, request: &Request, data: &[u8]) -> Vec<u8> {
        match request {
            Request::Unlink { seq, victim } => {
                let before = self.waiting.len();
                self.waiting.retain(|(waiting, _)| waiting != victim);
                let was_waiting = self.waiting.len() < before;
                if was_waiting {
                    self.stop();
                }
                protocol::forgotten(*seq, was_waiting)
            }
            Request::Submit(submit) if submit.endpoint == 0 => {
                let answer = self.control(now, submit, data);
                protocol::answered(submit, answer)
            }
            Request::Submit(submit)
                if submit.is_in
                    && submit.endpoint == descriptors::STREAM
                    && self.waiting.len() < MAX_WAITING =>
            {
                self.waiting.push_back((submit.seq, submit.length));
                self.send()
            }
            Request::Submit(submit) => protocol::refused(submit.seq),
        }
    }

    /// The next frame to take, if it is time: to be delivered before there is another.
    pub fn order(&mut self, now: Duration, pace: Pace) -> Option<Order> {
        let is_free = !self.is_busy && self.payload.is_empty() && !self.waiting.is_empty();
        let stream = self.stream.as_mut().filter(|stream| is_free && now >= stream.due)?;
        let lines = u64::from(self.timing.in_force().frame_lines);
        let period = match pace {
            Pace::AsOrdered => Duration::from_nanos(lines * u64::from(self.sensor.line_ns)),
            Pace::Every(period) => period,
            Pace::Standby => return None,
        };
        // A frame that was late does not delay the next ones, but they do not pile up.
        stream.due = stream.due.saturating_add(period).max(now.saturating_sub(period));
        let after_standby = std::mem::take(&mut stream.is_first);
        let frame = self.next_frame;
        self.next_frame = frame.wrapping_add(1);
        (self.is_busy, self.is_wanted) = (true, true);
        let format = &self.formats[self.commit.format];
        Some(Order {
            frame,
            after_standby,
            is_written: std::mem::take(&mut self.is_written),
            timing: self.timing.in_force(),
            test_pattern: 0,
            test_value: 0,
            fault: 0,
            fault_argument: 0,
            region: Region { x: 0, y: 0, width: self.sensor.width, height: self.sensor.height },
            pixel_format: format.name.clone(),
            image_bytes: format.image_bytes(&self.sensor) as usize,
        })
    }

    /// When the next frame may begin.
    pub fn next_order(&self) -> Option<Duration> {
        self.stream.map(|stream| stream.due)
    }

    /// What became of the order; returns what is sent of it.
    pub fn deliver(&mut self, taken: Taken) -> Vec<u8> {
        self.is_busy = false;
        match taken {
            Taken::Image(image, _) if self.is_wanted => {
                self.image_bit ^= 1;
                let bits = END_OF_HEADER | END_OF_IMAGE | self.image_bit;
                self.payload = [&[PAYLOAD_HEADER as u8, bits], &image[..]].concat();
                self.at = 0;
                self.send()
            }
            Taken::End if self.is_wanted => {
                self.stop();
                self.waiting.drain(..).flat_map(|(seq, _)| protocol::ended(seq)).collect()
            }
            Taken::Image(..) | Taken::Dropped(_) | Taken::End => Vec::new(),
        }
    }

    /// Fills transfers that wait.
    fn send(&mut self) -> Vec<u8> {
        let mut out = Vec::new();
        while self.at < self.payload.len()
            && let Some((seq, room)) = self.waiting.pop_front()
        {
            let end = self.payload.len().min(self.at + room as usize);
            out.extend(protocol::sent(seq, &[&self.payload[self.at..end]]));
            self.at = end;
            if end == self.payload.len() {
                self.payload.clear();
                self.at = 0;
                self.images += 1;
            }
        }
        out
    }

    /// Ends the stream; what was not sent is lost.
    fn stop(&mut self) {
        (self.stream, self.is_wanted) = (None, false);
        self.payload.clear();
        self.at = 0;
    }

    /// Answers a control transfer; `None` refuses it.
    fn control(&mut self, now: Duration, submit: &Submit, data: &[u8]) -> Option<Vec<u8>> {
        let [kind, request, _, value_high, index_low, index_high, ..] = submit.setup;
        match (kind, request) {
            // The stream's endpoint is cleared when it ends.
            (0x02, 1) => {
                self.stop();
                Some(vec![])
            }
            (0x21, SET_CUR) if index_low == 1 => {
                self.set_streaming(now, value_high, data).then(Vec::new)
            }
            (0xA1, _) if index_low == 1 => self.streaming(request, value_high),
            (0x21, SET_CUR) if index_low == 0 => {
                self.set_control(index_high, value_high, data).then(Vec::new)
            }
            (0xA1, _) if index_low == 0 => {
                self.control_of(index_high, value_high)?.answer(request)
            }
            _ => {
                let configuration = || {
                    let (sensor, intervals) = (&self.sensor, self.intervals());
                    descriptors::configuration(sensor, &self.formats, intervals, self.has_controls)
                };
                let texts = [&self.sensor.model[..], &self.sensor.serial];
                descriptors::CAMERA.answer(submit, configuration, texts)
            }
        }
    }

    fn interval(&self, frame_lines: u16) -> u32 {
        let ns = u64::from(frame_lines) * u64::from(self.sensor.line_ns);
        (ns / INTERVAL_UNIT_NS).clamp(1, u32::MAX.into()) as u32
    }

    fn intervals(&self) -> Intervals {
        Intervals {
            min: self.interval(self.sensor.min_frame_lines),
            max: self.interval(u16::MAX),
            usual: self.interval(self.sensor.timing.frame_lines),
        }
    }

    /// Answers to requests for probe and commit.
    fn streaming(&self, request: u8, selector: u8) -> Option<Vec<u8>> {
        let negotiated = match selector {
            PROBE => self.probe,
            COMMIT => self.commit,
            _ => return None,
        };
        let (usual, lines) = (self.sensor.timing.frame_lines, negotiated.frame_lines);
        let frame_lines = match request {
            GET_CUR => lines,
            0x82 => self.sensor.min_frame_lines,
            0x83 => u16::MAX,
            0x87 => usual,
            0x85 => return Some(vec![STREAMING_BYTES as u8, 0]),
            0x86 => return Some(vec![3]), // can be read and written
            _ => return None,
        };
        let bytes = self.formats[negotiated.format].image_bytes(&self.sensor);
        let mut out = vec![0; STREAMING_BYTES];
        out[2] = negotiated.format as u8 + 1;
        out[3] = 1;
        out[4..8].copy_from_slice(&self.interval(frame_lines).to_le_bytes());
        out[18..22].copy_from_slice(&bytes.to_le_bytes());
        out[22..26].copy_from_slice(&(bytes + PAYLOAD_HEADER as u32).to_le_bytes());
        Some(out)
    }

    /// Takes probe and commit: the nearest that there is.
    fn set_streaming(&mut self, now: Duration, selector: u8, data: &[u8]) -> bool {
        let [_, _, format, _, i0, i1, i2, i3, ..] = *data else { return false };
        let interval = u64::from(u32::from_le_bytes([i0, i1, i2, i3]));
        let line_ns = u64::from(self.sensor.line_ns);
        let lines = (interval * INTERVAL_UNIT_NS + line_ns / 2) / line_ns;
        let least = self.sensor.min_frame_lines.max(1);
        let negotiated = Streaming {
            format: usize::from(format).clamp(1, self.formats.len()) - 1,
            frame_lines: match interval {
                0 => self.sensor.timing.frame_lines,
                _ => lines.clamp(least.into(), u16::MAX.into()) as u16,
            },
        };
        match selector {
            PROBE => self.probe = negotiated,
            COMMIT => {
                self.stop();
                self.commit = negotiated;
                self.is_written |= self.timing.frame_lines != negotiated.frame_lines;
                self.timing.frame_lines = negotiated.frame_lines;
                self.stream = Some(Stream { due: now, is_first: true });
            }
            _ => return false,
        }
        true
    }

    /// An exposure in UVC's units.
    fn exposure(&self, lines: u16) -> u32 {
        let ns = u64::from(lines) * u64::from(self.sensor.line_ns);
        ((ns + EXPOSURE_UNIT_NS / 2) / EXPOSURE_UNIT_NS).max(1) as u32
    }

    fn control_of(&self, unit: u8, selector: u8) -> Option<Control> {
        let usual = self.sensor.timing;
        Some(match (unit, selector) {
            _ if !self.has_controls => return None,
            (CAMERA_TERMINAL, EXPOSURE_MODE) => {
                Control { now: MANUAL, min: MANUAL, max: MANUAL, usual: MANUAL, bytes: 1 }
            }
            (CAMERA_TERMINAL, EXPOSURE_TIME) => Control {
                now: self.exposure(self.timing.exposure_lines),
                min: 1,
                max: self.exposure(u16::MAX),
                usual: self.exposure(usual.exposure_lines),
                bytes: 4,
            },
            (PROCESSING_UNIT, GAIN) => Control {
                now: self.timing.gain_code.into(),
                min: 1,
                max: i16::MAX as u32, // uvcvideo reads gains with a sign
                usual: usual.gain_code.into(),
                bytes: 2,
            },
            _ => return None,
        })
    }

    fn set_control(&mut self, unit: u8, selector: u8, data: &[u8]) -> bool {
        let Some(control) = self.control_of(unit, selector) else { return false };
        let mut word = [0; 4];
        let Some(given) = data.get(..control.bytes) else { return false };
        word[..control.bytes].copy_from_slice(given);
        let value = u32::from_le_bytes(word);
        if !(control.min..=control.max).contains(&value) {
            return false;
        }
        match (unit, selector) {
            (CAMERA_TERMINAL, EXPOSURE_TIME) => {
                let line_ns = u64::from(self.sensor.line_ns);
                let lines = (u64::from(value) * EXPOSURE_UNIT_NS + line_ns / 2) / line_ns;
                self.timing.exposure_lines = lines.clamp(1, u16::MAX.into()) as u16;
            }
            (PROCESSING_UNIT, GAIN) => self.timing.gain_code = value as u16,
            _ => return true, // the exposure mode, of which there is one
        }
        self.is_written = true;
        true
    }
}

impl Control {
    fn answer(&self, request: u8) -> Option<Vec<u8>> {
        let value = match request {
            GET_CUR => self.now,
            0x82 => self.min,
            0x83 => self.max,
            0x84 => 1, // step; of the exposure mode, the modes that there are
            0x87 => self.usual,
            0x85 => return Some((self.bytes as u16).to_le_bytes().to_vec()),
            0x86 => return Some(vec![3]), // can be read and written
            _ => return None,
        };
        Some(value.to_le_bytes()[..self.bytes].to_vec())
    }
}
