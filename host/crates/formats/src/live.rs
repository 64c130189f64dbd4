//! Frames one after another: each is encoded when it is there, and nothing of it is kept.
//!
//! **Full scale.** Headerless pixels and Y4M of other bits than the sensor's are at full scale:
//! samples are shifted left into more bits and right, with their low bits lost, into fewer. So
//! white is white for programs that know 8 and 16 bits alone: 1023 of 10 bits is 65472 as
//! `SRGGB16` and 255 as `SRGGB8`.

#[cfg(feature = "mcap")]
use super::mcap::{CameraInfo, Recording};
use super::{Facts, Format, Frames, bayerlink, csi2, wide, y4m};
use camrig_base::{Error, RawFrame, Result};
use std::borrow::Cow;

/// Encodes the frames of a stream.
pub struct LiveEncoder {
    format: Format,
    frames_per_s: Option<f64>,
    /// Frames encoded.
    count: u64,
    #[cfg(feature = "mcap")]
    camera: Option<CameraInfo>,
    /// An MCAP file that was begun.
    #[cfg(feature = "mcap")]
    recording: Option<Recording>,
}

/// What goes into a stream apart from the pixels of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Beside {
    /// CSI-2 frame number, 1 to 65535; counted from 1 where not given.
    pub number: Option<u16>,
    /// Payloads of the embedded data lines.
    pub embedded: Vec<Vec<u8>>,
    /// Whether Line Start and Line End packets enclose every image line.
    pub line_packets: bool,
    /// What happens to the packets of CSI-2.
    pub damage: Vec<csi2::Damage>,
    /// When the frame began, s from the stream's begin, for formats that say it; from the frame
    /// rate where not given.
    pub time_s: Option<f64>,
}

impl Beside {
    /// How the packets of frame number `counted` are written.
    fn options(&self, counted: u16) -> csi2::Options {
        csi2::Options {
            virtual_channel: 0,
            line_packets: self.line_packets,
            embedded: vec![self.embedded.clone()],
            numbers: vec![self.number.unwrap_or(counted)],
        }
    }
}

impl LiveEncoder {
    /// An encoder for a format in which frames follow one another; `frames_per_s` for formats that
    /// say it.
    ///
    /// # Errors
    /// A format that holds one frame, or counts its frames at the front.
    pub fn new(format: Format, frames_per_s: Option<f64>) -> Result<Self> {
        if format.is_stream() {
            return Ok(Self {
                format,
                frames_per_s,
                count: 0,
                #[cfg(feature = "mcap")]
                camera: None,
                #[cfg(feature = "mcap")]
                recording: None,
            });
        }
        Err(Error::unsupported(format!("a stream of frames as {format}")).help(
            "formats in which frames follow one another are csi2, mcap, pgm, y4m and headerless \
             pixels such as SGRBG10P; and bayerlink",
        ))
    }

    /// Says the frame rate before the first frame, for formats that say it.
    pub fn set_rate(&mut self, frames_per_s: Option<f64>) {
        self.frames_per_s = frames_per_s;
    }

    /// Says the camera's figures before the first frame, for formats that hold them
    /// ([`Self::has_camera`]).
    #[cfg(feature = "mcap")]
    pub fn set_camera(&mut self, figures: CameraInfo) {
        self.camera = Some(figures);
    }

    /// Whether the format is packets of CSI-2.
    pub fn has_packets(&self) -> bool {
        self.format == Format::Csi2
    }

    /// Whether the format holds the figures of a camera.
    pub fn has_camera(&self) -> bool {
        self.format == Format::Mcap
    }

    /// Refuses frames that the format cannot hold.
    ///
    /// # Errors
    /// Those of [`Self::encode`].
    pub fn check(&self, like: &RawFrame) -> Result<()> {
        let mut anew = Self::new(self.format.clone(), self.frames_per_s)?;
        anew.encode(like, &Beside::default()).map(drop)
    }

    /// Bits per sample as which a frame is written.
    fn bits(&self, frame: &RawFrame) -> u32 {
        match &self.format {
            Format::Raw(pixels) => pixels.bits,
            Format::Y4m => y4m::depth(frame.bits),
            _ => frame.bits,
        }
    }

    /// What a reader of such frames has to know that the format does not say: sentences for a
    /// person.
    pub fn notes(&self, frame: &RawFrame) -> Vec<String> {
        let bits = self.bits(frame);
        let scaled = at_full_scale(frame, bits);
        let shift = bits.abs_diff(frame.bits);
        let black = scaled.black_level_dn;
        let shifted = match bits.cmp(&frame.bits) {
            std::cmp::Ordering::Equal => None,
            std::cmp::Ordering::Greater => Some(format!("left by {shift}")),
            std::cmp::Ordering::Less => Some(format!("right by {shift}, their low bits lost")),
        };
        let full_scale = shifted.map(|how| {
            format!(
                "{} is at full scale: samples of {} bits are shifted {how}; the black level is \
                 {black} DN",
                self.format, frame.bits
            )
        });
        let stamps = (self.format == Format::Mcap && self.frames_per_s.is_none()).then(|| {
            "no frame rate is known: frames whose time is not known either are stamped 1 s apart"
                .to_string()
        });
        let display = match &self.format {
            Format::Bayerlink(display) => display.size(frame).ok(),
            _ => None,
        };
        let display = display.map(|(width, height)| {
            format!(
                "{} is {width} x {height} pixels of 24 bits: rgb24, to be shown unscaled and at \
                 full range",
                self.format
            )
        });
        let left_out = self.format.leaves_out(&Facts::of(frame)).into_iter().chain(display);
        left_out.chain(full_scale).chain(stamps).collect()
    }

    /// Time of the next frame, ns.
    #[cfg(feature = "mcap")]
    fn stamp_ns(&self, beside: &Beside) -> u64 {
        let counted = || self.count as f64 / self.frames_per_s.unwrap_or(1.0);
        (beside.time_s.unwrap_or_else(counted) * 1e9).round() as u64
    }

    /// The bytes of the next frame.
    ///
    /// # Errors
    /// Those of the format's writer.
    pub fn encode(&mut self, frame: &RawFrame, beside: &Beside) -> Result<Vec<u8>> {
        let frame = &*at_full_scale(frame, self.bits(frame));
        let counted = self.counted();
        let bytes = match &self.format {
            Format::Csi2 => {
                let options = beside.options(counted);
                let bytes = csi2::encode_with(&Frames::from_raw(frame), &options)?;
                match &beside.damage[..] {
                    [] => bytes,
                    damages => csi2::damage(&bytes, damages)?,
                }
            }
            Format::Y4m => {
                let mut bytes = match self.count {
                    0 => y4m::live_header(frame, self.frames_per_s)?,
                    _ => Vec::new(),
                };
                bytes.extend(y4m::frame(&frame.data, frame.bits)?);
                bytes
            }
            #[cfg(feature = "mcap")]
            Format::Mcap => {
                let stamp_ns = self.stamp_ns(beside);
                let recording = match &mut self.recording {
                    Some(recording) => recording,
                    none => none.insert(Recording::new(frame, self.camera)?),
                };
                recording.frame(frame, stamp_ns)?
            }
            Format::Bayerlink(display) => bayerlink::encode(frame, *display, self.count as u32)?,
            other => other.encode(&Frames::from_raw(frame))?,
        };
        self.count += 1;
        Ok(bytes)
    }

    /// The bytes of the next frame, of more than 16 bits.
    ///
    /// # Errors
    /// A format that does not hold it; those of its writer.
    pub fn encode_wide(&mut self, frame: &RawFrame<u32>, beside: &Beside) -> Result<Vec<u8>> {
        wide::check(&self.format)?;
        let options = beside.options(self.counted());
        self.count += 1;
        csi2::encode_with(&Frames::from_raw(frame), &options)
    }

    /// The bytes of the captures of the next exposure, each on its virtual channel. `None` where
    /// the format has no channels: its captures follow one another as frames.
    ///
    /// # Errors
    /// Those of [`csi2::encode_together`].
    pub fn encode_captures(&mut self, captures: &[csi2::Sent<'_>]) -> Result<Option<Vec<u8>>> {
        if self.format != Format::Csi2 {
            return Ok(None);
        }
        let number = self.counted();
        self.count += 1;
        csi2::encode_together(captures, number, false).map(Some)
    }

    /// Number of the next frame, from 1.
    fn counted(&self) -> u16 {
        (self.count % u64::from(u16::MAX) + 1) as u16
    }

    /// What follows the last frame, in formats that have an end.
    ///
    /// # Errors
    /// None that depends on the frames.
    pub fn finish(&mut self) -> Result<Vec<u8>> {
        #[cfg(feature = "mcap")]
        if let Some(recording) = self.recording.take() {
            return recording.finish();
        }
        Ok(Vec::new())
    }
}

/// A frame at the full scale of `bits` bits.
fn at_full_scale(frame: &RawFrame, bits: u32) -> Cow<'_, RawFrame> {
    let (left, right) = (bits.saturating_sub(frame.bits), frame.bits.saturating_sub(bits));
    if left == right {
        return Cow::Borrowed(frame);
    }
    let shift = |dn: u16| dn << left >> right;
    Cow::Owned(RawFrame {
        bits,
        black_level_dn: frame.black_level_dn * f64::from(1 << left) / f64::from(1 << right),
        white_level_dn: shift(frame.white_level_dn),
        data: frame.data.iter().map(|&dn| shift(dn)).collect(),
        ..frame.clone()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Cfa;

    fn frame(cfa: &str) -> RawFrame {
        RawFrame {
            width: 4,
            height: 2,
            bits: 10,
            cfa: Cfa::parse(cfa).unwrap(),
            black_level_dn: 42.0,
            white_level_dn: 1023,
            data: vec![0, 1, 42, 1023, 512, 3, 4, 5],
        }
    }

    fn encoder(name: &str) -> LiveEncoder {
        LiveEncoder::new(Format::parse(name).unwrap(), None).unwrap()
    }

    fn encoded(name: &str, cfa: &str) -> Vec<u8> {
        encoder(name).encode(&frame(cfa), &Beside::default()).unwrap()
    }

    #[test]
    fn eight_and_sixteen_bits_are_at_full_scale_and_the_sensors_own_as_they_are() {
        let words = |words: &[u16]| words.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<_>>();
        let data = frame("RGGB").data;
        assert_eq!(encoded("SRGGB10", "RGGB"), words(&data));
        let sixteen: Vec<u16> = data.iter().map(|dn| dn * 64).collect();
        assert_eq!(encoded("SRGGB16", "RGGB"), words(&sixteen));
        assert_eq!(encoded("SRGGB8", "RGGB"), [0, 0, 10, 255, 128, 0, 1, 1]);
        let notes = encoder("SRGGB16").notes(&frame("RGGB"));
        assert!(notes[0].contains("left by 6; the black level is 2688 DN"), "{notes:?}");
        assert!(encoder("SRGGB8").notes(&frame("RGGB"))[0].contains("right by 2"), "{notes:?}");
        assert!(encoder("SRGGB10P").notes(&frame("RGGB")).is_empty());
        assert!(encoder("SBGGR8").encode(&frame("RGGB"), &Beside::default()).is_err());
    }

    /// A stream of frames is what the whole would be, for formats that were written whole before.
    #[test]
    fn frames_one_by_one_are_those_of_a_whole_file() {
        let mut whole = Frames::from_raw(&frame("mono"));
        whole.planes = vec![whole.planes[0].clone(); 3];
        for name in ["csi2", "mcap", "pgm", "y4m", "bayerlink:16x4", "Y10", "Y10P"] {
            let mut encoder = encoder(name);
            let mut bytes = Vec::new();
            for _ in 0..3 {
                bytes.extend(encoder.encode(&frame("mono"), &Beside::default()).unwrap());
            }
            bytes.extend(encoder.finish().unwrap());
            assert_eq!(bytes, Format::parse(name).unwrap().encode(&whole).unwrap(), "{name}");
        }
    }

    #[test]
    fn numbers_and_embedded_lines_go_into_a_packet_stream() {
        let mut encoder = encoder("csi2");
        let beside = Beside {
            number: Some(7),
            embedded: vec![csi2::Embedded::of_frame(0.01, 1.0, 1).line(10)],
            line_packets: true,
            damage: vec![csi2::Damage::HeaderBit(1)],
            ..Beside::default()
        };
        let stream = csi2::decode_stream::<u16>(&encoder.encode(&frame("RGGB"), &beside).unwrap());
        let stream = stream.unwrap();
        assert_eq!(stream.channels[0].frame_numbers, [7]);
        assert_eq!(stream.channels[0].embedded, [beside.embedded]);
        assert_eq!((stream.faults.len(), stream.faults[0].row), (1, Some(1)));
    }

    #[test]
    fn formats_that_hold_one_frame_or_count_them_are_no_streams() {
        for name in ["dng", "png", "npy", "tiff", "fits"] {
            let said = LiveEncoder::new(Format::parse(name).unwrap(), None);
            let said = said.err().unwrap();
            assert!(said.to_string().contains("csi2, mcap, pgm"), "{name}: {said}");
        }
    }
}
