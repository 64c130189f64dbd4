//! `camrig-frames/1`: frames of a scene as another program makes them, with time stamps, over
//! standard input, TCP or a Unix socket. `docs/frames.md` has the format.
//!
//! One message is one frame. Nothing of a message is believed before its header's checksum is
//! right and its sizes agree; memory grows with the bytes that come. All frames have the shape of
//! the first. Numbers and times go forward; numbers that are missing are counted.

use super::header::{BYTES, CRC, Colour, Header, Sample, Shape, extension};
use super::pipe::{broken, read_up_to};
use super::{FrameLight, SceneFrame, SceneSequence};
use crate::Quantity;
use crate::cube::{BandSource, Cube};
use crate::rgb;
use crate::rgb::picture::{Picture, Said, Samples, about_channels, three};
use crate::selection::Stated;
use ::exr::prelude::f16;
use camrig_base::{Error, Plane, Result};
use rayon::prelude::*;
use std::io::Read;
use std::sync::Arc;

/// A stream of messages.
pub struct Frames {
    name: String,
    source: Box<dyn Read + Send>,
    shape: Option<Arc<Shape>>,
    /// Number and time of the newest message.
    newest: Option<(u64, f64)>,
    missing: u64,
    ended: bool,
    notes: Vec<String>,
}

impl Frames {
    /// Messages from any stream; `name` says where it comes from.
    #[must_use]
    pub fn new(name: &str, source: Box<dyn Read + Send>) -> Self {
        Self {
            name: name.into(),
            source,
            shape: None,
            newest: None,
            missing: 0,
            ended: false,
            notes: Vec::new(),
        }
    }

    fn exactly(&mut self, count: u64, what: &str) -> Result<Vec<u8>> {
        let bytes = read_up_to(&mut *self.source, count).map_err(|e| broken(&e))?;
        match bytes.len() as u64 {
            n if n == count => Ok(bytes),
            n => Err(Error::input(format!(
                "the stream ends within {what}: {n} of {count} bytes came"
            ))
            .help("its writer was stopped, or has died")),
        }
    }

    fn header(&mut self) -> Result<Option<Header>> {
        let bytes = read_up_to(&mut *self.source, BYTES as u64).map_err(|e| broken(&e))?;
        if bytes.is_empty() {
            return Err(Error::input("the stream ends without the message that ends it")
                .help("its writer has died; the frames so far have been taken"));
        }
        let Ok(head) = <[u8; BYTES]>::try_from(bytes.as_slice()) else {
            return Err(Error::input(format!(
                "the stream ends within a header: {} of {BYTES} bytes came",
                bytes.len()
            )));
        };
        let more = extension(&head)?;
        let more = self.exactly(more as u64, "a header")?;
        let header = Header::parse(&head, &more)?;
        Ok(header.frame.is_some().then_some(header))
    }

    /// The next message, checked against those before; none at the end.
    fn message(&mut self) -> Result<Option<(Header, Payload)>> {
        let Some(mut header) = self.header()? else { return Ok(None) };
        let Some(shape) = header.frame.take() else { return Ok(None) };
        let shape = match &self.shape {
            None => Arc::new(shape),
            Some(first) if **first == shape => first.clone(),
            Some(_) => {
                return Err(Error::disagreement("a frame that is not like the first").help(
                    "size, samples, colours, scale, light level and illuminant stay those of the \
                     first frame; a light that changes is radiance",
                ));
            }
        };
        self.check_order(&header)?;
        if self.shape.is_none() {
            self.notes.extend(of_first(&header, &shape));
        }
        let bytes = self.exactly(header.payload, "a frame")?;
        if header.payload_crc.is_some_and(|crc| crc != CRC.checksum(&bytes)) {
            return Err(Error::input("a payload whose checksum is wrong"));
        }
        self.shape = Some(shape.clone());
        self.newest = Some((header.number, header.time_s));
        Ok(Some((header, Payload { shape, bytes })))
    }

    fn check_order(&mut self, header: &Header) -> Result<()> {
        let Some((number, time_s)) = self.newest else {
            self.missing = header.number;
            return Ok(());
        };
        if header.number <= number || header.time_s <= time_s {
            return Err(Error::input(format!(
                "frame {} at {} s after frame {number} at {time_s} s",
                header.number, header.time_s
            ))
            .help("numbers and times of frames go forward"));
        }
        self.missing = self.missing.saturating_add(header.number - number - 1);
        Ok(())
    }
}

/// What to say of the first frame.
fn of_first(header: &Header, shape: &Shape) -> Vec<String> {
    let mut notes = Vec::new();
    if header.has_pose {
        notes.push("poses of frames are not used".into());
    }
    if let Colour::Space(_) = shape.colour {
        about_channels(shape.channels, &mut notes);
    }
    notes
}

impl SceneSequence for Frames {
    fn name(&self) -> &str {
        &self.name
    }

    fn is_timed(&self) -> bool {
        true
    }

    fn next_frame(&mut self) -> Result<Option<SceneFrame>> {
        if self.ended {
            return Ok(None);
        }
        let due = self.newest.map_or(0, |(number, _)| number.saturating_add(1));
        let place = |name: &str| format!("frame {due} of {name}");
        let Some((header, payload)) = self.message().map_err(|e| e.at(place(&self.name)))? else {
            self.ended = true;
            if self.missing > 0 {
                let missing = self.missing;
                self.notes.push(format!("{missing} frames of {} never came", self.name));
            }
            return Ok(None);
        };
        let end_s = header.duration_s.map(|duration| header.time_s + duration);
        let name = format!("frame {} of {}", header.number, self.name);
        let light = FrameLight {
            level: payload.shape.level,
            illuminant: payload.shape.illuminant.clone(),
        };
        let open = move || payload.scene();
        let times = (header.time_s, end_s);
        let mut frame = SceneFrame::new(header.number, times, name, open).with_light(light);
        frame.cut = header.cut;
        Ok(Some(frame))
    }

    fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

/// A frame's samples.
struct Payload {
    shape: Arc<Shape>,
    bytes: Vec<u8>,
}

impl Payload {
    /// The scene.
    fn scene(self) -> Result<Cube> {
        let shape = self.shape.clone();
        match &shape.colour {
            Colour::Bands(nm) => {
                let stated = Stated { scale: Some(shape.scale as f32), ..Stated::default() };
                Cube::stated(Box::new(self), nm, shape.quantity, stated)
            }
            Colour::Space(space) => {
                let radiance = shape.quantity == Quantity::Radiance;
                if !radiance && shape.scale != 1.0 {
                    let what = format!("a scale of {} of a picture of reflectance", shape.scale);
                    return Err(
                        Error::unsupported(what).help("it is 1: its samples are the scene's")
                    );
                }
                let picture = Picture {
                    size: (shape.width, shape.height),
                    samples: self.samples(),
                    said: Said::Space((**space).clone()),
                    orientation: 1,
                    white_luminance: (radiance && shape.scale > 0.0).then_some(shape.scale),
                    understood: Vec::new(),
                    notes: Vec::new(),
                };
                rgb::of_picture(picture, &format!("as={}", shape.quantity.name()))
            }
        }
    }

    /// Red, green and blue.
    fn samples(&self) -> Samples {
        let channels = self.shape.channels;
        let codes = |data, most| Samples::Codes { data: three(data, channels), most };
        match self.shape.sample {
            Sample::U8 => codes(self.interleaved(|[code]| code.into()), 255),
            Sample::U16 => codes(self.interleaved(u16::from_le_bytes), u16::MAX),
            Sample::F16 => Samples::Floats(three(self.interleaved(half), channels)),
            Sample::F32 => Samples::Floats(three(self.interleaved(f32::from_le_bytes), channels)),
        }
    }

    /// Place of a sample.
    fn place(&self, x: usize, y: usize, channel: usize) -> usize {
        let Shape { planar, channels, sample, row_bytes, plane_bytes, .. } = &*self.shape;
        let (across, plane) = match planar {
            true => (x, channel as u64 * plane_bytes),
            false => (x * channels + channel, 0),
        };
        (plane + y as u64 * row_bytes) as usize + across * sample.bytes() as usize
    }

    fn code(&self, at: usize) -> u16 {
        match self.shape.sample {
            Sample::U8 => self.bytes[at].into(),
            _ => u16::from_le_bytes([self.bytes[at], self.bytes[at + 1]]),
        }
    }

    /// A sample as a number; whole ones over their largest.
    fn float(&self, at: usize) -> f32 {
        match self.shape.sample {
            Sample::U8 => f32::from(self.code(at)) / 255.0,
            Sample::U16 => f32::from(self.code(at)) / 65_535.0,
            Sample::F16 => f16::from_bits(self.code(at)).to_f32(),
            Sample::F32 => f32::from_le_bytes(std::array::from_fn(|i| self.bytes[at + i])),
        }
    }

    /// The channels of pixel after pixel, of samples of N bytes.
    fn interleaved<T: Copy + Default + Send, const N: usize>(
        &self,
        read: impl Fn([u8; N]) -> T + Sync,
    ) -> Vec<T> {
        let Shape { width, height, channels, planar, .. } = *self.shape;
        let mut samples = vec![T::default(); width * height * channels];
        let from =
            |y: usize, channel: usize| self.bytes[self.place(0, y, channel)..].as_chunks().0;
        let row = |(y, row): (usize, &mut [T])| {
            if !planar {
                row.iter_mut().zip(from(y, 0)).for_each(|(sample, bytes)| *sample = read(*bytes));
                return;
            }
            for channel in 0..channels {
                let of_channel = row.iter_mut().skip(channel).step_by(channels);
                let samples = of_channel.zip(from(y, channel));
                samples.for_each(|(sample, bytes)| *sample = read(*bytes));
            }
        };
        samples.par_chunks_mut(width * channels).enumerate().for_each(row);
        samples
    }
}

/// A number of 16 bits.
fn half(bytes: [u8; 2]) -> f32 {
    f16::from_le_bytes(bytes).to_f32()
}

/// Bands in the unit of the quantity.
impl BandSource for Payload {
    fn size(&self) -> (usize, usize) {
        (self.shape.width, self.shape.height)
    }

    fn bands(&self) -> usize {
        self.shape.channels
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let (width, height) = self.size();
        Ok(Plane::from_fn(width, height, |x, y| self.float(self.place(x, y, band))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;
    use camrig_light::LightLevel;
    use camrig_scene::sequence::{Moment, Playback};
    use std::io::Cursor;

    /// A header of 8 x 2 pixels of one grey u8, sRGB reflectance, with other numbers at places.
    fn message(changes: &[(usize, &[u8])], payload: &[u8]) -> Vec<u8> {
        let mut head = vec![0; BYTES];
        let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, b"CRFRAME1");
        put(8, &256u32.to_le_bytes());
        for (at, value) in [(40, 8u32), (44, 2), (48, 1)] {
            put(at, &value.to_le_bytes());
        }
        for (at, value) in [(52, 1u16), (54, 1), (56, 1), (58, 1), (60, 1)] {
            put(at, &value.to_le_bytes());
        }
        put(64, &8u64.to_le_bytes());
        put(80, &(payload.len() as u64).to_le_bytes());
        put(88, &1.0f64.to_le_bytes());
        changes.iter().for_each(|(at, bytes)| put(*at, bytes));
        let crc = CRC.checksum(&head[..252]);
        head[252..].copy_from_slice(&crc.to_le_bytes());
        [&head, payload].concat()
    }

    fn end() -> Vec<u8> {
        message(&[(12, &[2]), (16, &[9])], &[])
    }

    fn frames(messages: &[Vec<u8>]) -> Frames {
        Frames::new("it", Box::new(Cursor::new(messages.concat())))
    }

    fn said(message: Vec<u8>) -> String {
        frames(&[message]).next_frame().err().unwrap().to_string()
    }

    #[test]
    fn frames_have_their_numbers_times_and_samples() {
        let at = |number: u8, time_ns: i64, code: u8| {
            let cut = [number / 2];
            let times = [(12, &cut[..]), (16, &[number]), (24, &time_ns.to_le_bytes())];
            message(&times, &[code; 16])
        };
        let mut frames = frames(&[at(0, -40_000_000, 255), at(2, 20_000_000, 0), end()]);
        let first = frames.next_frame().unwrap().unwrap();
        assert_eq!((first.number, first.start_s, first.end_s), (0, -0.04, None));
        assert!(!first.cut);
        let cube = first.open().unwrap();
        assert_eq!((cube.size(), cube.quantity()), ((8, 2), Quantity::Reflectance));
        assert!(cube.band(9).unwrap().data.iter().all(|v| (v - 1.0).abs() < 1e-4));
        let second = frames.next_frame().unwrap().unwrap();
        assert_eq!((second.number, second.cut), (2, true));
        assert!(frames.next_frame().unwrap().is_none() && frames.next_frame().unwrap().is_none());
        assert_eq!(frames.notes(), ["1 frames of it never came"]);
    }

    #[test]
    fn bands_are_read_in_both_layouts_with_their_scale_and_light() {
        let value = |x: usize, y: usize, band: usize| (1 + x + 8 * y + 16 * band) as f32;
        let bytes = |order: &dyn Fn(usize) -> (usize, usize, usize)| -> Vec<u8> {
            (0..48)
                .flat_map(|i| {
                    let (x, y, b) = order(i);
                    value(x, y, b).to_le_bytes()
                })
                .collect()
        };
        let common: [(usize, &[u8]); 8] = [
            (12, &[8]),
            (48, &[3]),
            (52, &[4]),
            (58, &[0]),
            (60, &[0]),
            (88, &0.01f64.to_le_bytes()),
            (96, &80.0f64.to_le_bytes()),
            (192, &500.0f64.to_le_bytes()),
        ];
        let step = 50.0f64.to_le_bytes();
        let interleaved = bytes(&|i| (i / 3 % 8, i / 24, i % 3));
        let planar = bytes(&|i| (i % 8, i / 8 % 2, i / 16));
        let rows: [&[(usize, &[u8])]; 2] = [
            &[(64, &[96]), (200, &step), (208, b"A")],
            &[(54, &[2]), (64, &[32]), (72, &[64]), (200, &step), (208, b"A")],
        ];
        for (changes, payload) in rows.iter().zip([interleaved, planar]) {
            let all = [&common[..], changes].concat();
            let frame = frames(&[message(&all, &payload)]).next_frame().unwrap().unwrap();
            assert_eq!(frame.light.level, Some(LightLevel::Luminance(80.0)));
            assert_eq!(frame.light.illuminant.as_deref(), Some("A"));
            let cube = frame.open().unwrap();
            assert_eq!((cube.bands().start_nm, cube.bands().count), (500.0, 3));
            let band = cube.band(1).unwrap();
            assert!((band.at(3, 1) - 0.01 * value(3, 1, 1)).abs() < 1e-6, "{band:?}");
        }
    }

    /// Codes of 8 and 16 bits and numbers of 16 and 32 bits mean the same colours, pixel after
    /// pixel or plane after plane, with rows that are longer than their pixels.
    #[test]
    fn colours_are_read_from_all_samples_in_both_layouts() {
        type Bytes = fn(u8) -> Vec<u8>;
        let samples: [(u8, Bytes); 4] = [
            (1, |code| vec![code]),
            (2, |code| (u16::from(code) * 257).to_le_bytes().to_vec()),
            (3, |code| f16::from_f32(f32::from(code) / 255.0).to_le_bytes().to_vec()),
            (4, |code| (f32::from(code) / 255.0).to_le_bytes().to_vec()),
        ];
        let code = |x: usize, y: usize, c: usize| (10 + 9 * x + 40 * y + 60 * c) as u8;
        let mut first: Option<Plane<f32>> = None;
        for ((sample, bytes), planar) in
            samples.iter().flat_map(|sample| [1, 2].map(|planar| (sample, planar)))
        {
            let size = bytes(0).len();
            let (planes, each) = if planar == 2 { (3, 1) } else { (1, 3) };
            let row_bytes = 8 * each * size + size;
            let mut payload = vec![0; planes * 2 * row_bytes];
            for (x, y, c) in (0..48).map(|i| (i % 8, i / 8 % 2, i / 16)) {
                let (plane, across) = if planar == 2 { (c, x) } else { (0, 3 * x + c) };
                let at = (2 * plane + y) * row_bytes + across * size;
                payload[at..at + size].copy_from_slice(&bytes(code(x, y, c)));
            }
            let changes: [(usize, &[u8]); 5] = [
                (48, &[3]),
                (52, &[*sample]),
                (54, &[planar]),
                (64, &(row_bytes as u64).to_le_bytes()),
                (72, &(if planar == 2 { 2 * row_bytes as u64 } else { 0 }).to_le_bytes()),
            ];
            let frame = frames(&[message(&changes, &payload)]).next_frame().unwrap().unwrap();
            let band = frame.open().unwrap().band(20).unwrap();
            match &first {
                None => first = Some(band),
                // Numbers of 16 bits have 11 of mantissa, steep at the foot of the curve of sRGB.
                Some(first) => {
                    for (found, expected) in band.data.iter().zip(&first.data) {
                        assert!((found - expected).abs() < 2e-3, "{sample} {planar}");
                    }
                }
            }
        }
    }

    #[test]
    fn lies_are_refused_with_the_frame_and_the_byte() {
        let grey = [7u8; 16];
        for (at, bytes, words) in [
            (0, &b"XRFRAME1"[..], "byte 0"),
            (8, &[1, 1], "byte 8"),
            (12, &[64], "shared memory"),
            (12, &[12], "flags 0xc"),
            (40, &[0], "byte 40"),
            (40, &[255, 255, 255, 255], "byte 40"),
            (44, &[255, 255, 0, 0], "byte 80"),
            (48, &[2], "byte 48"),
            (52, &[9], "byte 52"),
            (54, &[3], "byte 54"),
            (56, &[0], "byte 56"),
            (58, &[6], "byte 58"),
            (60, &[3], "byte 60"),
            (64, &[7], "byte 80"),
            (64, &[255; 8], "byte 80"),
            (80, &[255; 8], "byte 80"),
            (88, &f64::NAN.to_le_bytes(), "byte 88"),
            (88, &[0; 8], "byte 88"),
            (62, &[1], "byte 62"),
            (188, &[1], "byte 188"),
            (247, &[1], "byte 244"),
            (208, &[255], "byte 208"),
        ] {
            let text = said(message(&[(at, bytes)], &grey));
            assert!(text.contains(words) && text.contains("frame 0 of it"), "{at}: {text}");
        }
        let mut damaged = message(&[], &grey);
        damaged[41] = 1;
        assert!(said(damaged).contains("checksum"));
        assert!(said(message(&[(12, &[32])], &grey)).contains("payload whose checksum"));
        let whole = message(&[], &grey);
        assert!(said(whole[..100].to_vec()).contains("100 of 256"));
        assert!(said(whole[..260].to_vec()).contains("4 of 16 bytes"));
        let huge: [(usize, &[u8]); 3] = [(40, &[0, 64]), (64, &[0, 64]), (80, &[0, 128, 0, 0])];
        assert!(said(message(&huge, &grey)).contains("16 of 32768 bytes"));
    }

    #[test]
    fn order_and_likeness_are_kept() {
        let after = |changes: &[(usize, &[u8])]| {
            let mut frames = frames(&[message(&[], &[7; 16]), message(changes, &[7; 16])]);
            frames.next_frame().unwrap();
            frames.next_frame().err().unwrap().to_string()
        };
        assert!(after(&[(24, &[1])]).contains("go forward"));
        let last = message(&[(16, &[255; 8])], &[7; 16]);
        let mut frames_to_the_last = frames(&[last.clone(), last]);
        frames_to_the_last.next_frame().unwrap();
        assert!(frames_to_the_last.next_frame().err().unwrap().to_string().contains("go forward"));
        assert!(after(&[(16, &[1])]).contains("go forward"));
        let other = after(&[(16, &[1]), (24, &[1]), (60, &[0])]);
        assert!(
            other.contains("not like the first") && other.contains("frame 1 of it"),
            "{other}"
        );
        let mut alone = frames(&[message(&[], &[7; 16])]);
        alone.next_frame().unwrap();
        let died = alone.next_frame().err().unwrap().to_string();
        assert!(died.contains("without the message that ends it"), "{died}");
    }

    /// A frame whose end is known is shown without waiting for the next.
    #[test]
    fn a_duration_tells_when_a_frame_ends() {
        let tenth = 100_000_000u64.to_le_bytes();
        let one = message(&[(32, &tenth)], &[7; 16]);
        let mut playback = Playback::new(Box::new(frames(&[one, end()])), Some(20.0), false);
        assert!(matches!(playback.at(0), Ok(Moment::Next(_))));
        assert!(matches!(playback.at(1), Ok(Moment::Same)));
        assert!(matches!(playback.at(2), Ok(Moment::Over)));
    }
}
