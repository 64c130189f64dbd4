//! MCAP recordings of ROS 2 camera topics (`.mcap`): what robots and their simulators record and
//! play back. Source: the MCAP specification, version 0; the container is written and read by
//! Foxglove's `mcap`.
//!
//! Each frame is a `sensor_msgs/msg/Image` on `/camera/image_raw` and, where the lens is known, a
//! `sensor_msgs/msg/CameraInfo` on `/camera/camera_info` with the same time stamp; of several
//! cameras in one recording, each has its name instead of `camera`. Samples of up
//! to 8 bits are `mono8` or `bayer_rggb8` and its like, others `...16`; they are the sensor's DN,
//! not stretched. What ROS has no field for (bits, black and white level) is in the channel's
//! metadata under `camrig`, from which [`decode`] takes it. Written without compression, read also
//! with zstd and lz4; in records one after another, without chunks and their index: `mcap recover`
//! adds one, and repairs a recording that is cut off. Checksums of chunks and of the data are
//! checked where a recording has them.

mod chunks;

pub use super::ros::CameraInfo;
use super::ros::{self, Image};
use super::{Facts, Frames, MCAP_MAGIC, check_range};
use camrig_base::{Error, Plane, RawFrame, Result};
use mcap::read::Options;
use mcap::records::{MessageHeader, op};
use mcap::write::NoSeek;
use mcap::{MessageStream, WriteOptions};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};

/// Name of a camera that is alone in a recording.
const CAMERA: &str = "camera";
/// Key of a channel's metadata that holds the facts of its frames.
const NOTE: &str = "camrig";

/// Bytes of the recording that have not been fetched.
#[derive(Clone, Default)]
struct Pending(Arc<Mutex<Vec<u8>>>);

impl Pending {
    fn fetch(&self) -> Vec<u8> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Pending {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut pending = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        pending.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A recording in progress.
pub struct Recording {
    writer: mcap::Writer<NoSeek<Pending>>,
    pending: Pending,
    cameras: Vec<Topics>,
}

/// A camera of a recording.
pub struct Recorded<'a> {
    /// Its name, in those of its topics and as its frame of reference.
    pub name: &'a str,
    /// A frame of its facts.
    pub like: &'a RawFrame,
    /// Its figures.
    pub info: Option<CameraInfo>,
}

/// The topics of a camera.
struct Topics {
    name: String,
    images: u16,
    info: Option<(u16, CameraInfo)>,
    sequence: u32,
}

fn failed(error: mcap::McapError) -> Error {
    Error::internal(format!("an MCAP record: {error}"))
}

impl Recording {
    /// A recording of frames with the facts of `like`.
    ///
    /// # Errors
    /// A colour filter pattern for which ROS has no name.
    pub fn new(like: &RawFrame, info: Option<CameraInfo>) -> Result<Self> {
        Self::of(&[Recorded { name: CAMERA, like, info }])
    }

    /// A recording of several cameras.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn of(cameras: &[Recorded<'_>]) -> Result<Self> {
        for camera in cameras {
            ros::encoding(&camera.like.cfa, sample_bytes(camera.like))?;
        }
        let pending = Pending::default();
        let options = WriteOptions::new()
            .profile("ros2")
            .library("camrig")
            .compression(None)
            // The index of chunks would be kept in memory to the end of the recording.
            .use_chunks(false)
            .disable_seeking(true);
        let mut writer = options.create(NoSeek::new(pending.clone())).map_err(failed)?;
        let mut channel = |topic: &str, name, definition: &str, metadata: &_| {
            let schema = writer.add_schema(name, "ros2msg", definition.as_bytes());
            writer.add_channel(schema.map_err(failed)?, topic, "cdr", metadata).map_err(failed)
        };
        let topics = cameras.iter().map(|&Recorded { name, like, info }| {
            let mut metadata = BTreeMap::from([("offered_qos_profiles".into(), String::new())]);
            let info = match info {
                Some(info) => {
                    let (topic, definition) =
                        (format!("/{name}/camera_info"), ros::CAMERA_INFO_DEFINITION);
                    Some((channel(&topic, ros::CAMERA_INFO, definition, &metadata)?, info))
                }
                None => None,
            };
            metadata.insert(NOTE.into(), Facts::of(like).note());
            let topic = format!("/{name}/image_raw");
            let images = channel(&topic, ros::IMAGE, ros::IMAGE_DEFINITION, &metadata)?;
            Ok(Topics { name: name.to_string(), images, info, sequence: 0 })
        });
        let cameras = topics.collect::<Result<Vec<_>>>()?;
        Ok(Self { writer, pending, cameras })
    }

    /// The bytes that come next in the file, up to and with this frame; `stamp_ns` since the
    /// recording's begin.
    ///
    /// # Errors
    /// Samples beyond the bits, a size beyond ROS's.
    pub fn frame(&mut self, frame: &RawFrame, stamp_ns: u64) -> Result<Vec<u8>> {
        self.frame_of(0, frame, stamp_ns)
    }

    /// The same of one of several cameras.
    ///
    /// # Errors
    /// Those of [`Self::frame`], a camera that is none of them.
    pub fn frame_of(&mut self, camera: usize, frame: &RawFrame, stamp_ns: u64) -> Result<Vec<u8>> {
        check_range(&frame.data, frame.bits)?;
        let size = |n: usize| {
            u32::try_from(n).map_err(|_| Error::limit(format!("{n} pixels in a row of ROS's")))
        };
        let (width, height) = (size(frame.width)?, size(frame.height)?);
        let bytes = sample_bytes(frame);
        let data = match bytes {
            1 => frame.data.iter().map(|&dn| dn as u8).collect(),
            _ => frame.data.iter().flat_map(|dn| dn.to_le_bytes()).collect(),
        };
        let encoding = ros::encoding(&frame.cfa, bytes)?;
        let image = Image { width, height, encoding, data };
        let topics = self.cameras.get_mut(camera);
        let topics = topics.ok_or_else(|| Error::internal(format!("no camera {camera}")))?;
        let sequence = topics.sequence;
        let mut message = |channel_id: u16, data: &[u8]| {
            let (log_time, publish_time) = (stamp_ns, stamp_ns);
            let header = MessageHeader { channel_id, sequence, log_time, publish_time };
            self.writer.write_to_known_channel(&header, data).map_err(failed)
        };
        if let Some((channel, info)) = topics.info {
            message(channel, &info.encode((width, height), stamp_ns, &topics.name))?;
        }
        message(topics.images, &image.encode(stamp_ns, &topics.name))?;
        topics.sequence = sequence.wrapping_add(1);
        self.writer.flush().map_err(failed)?;
        Ok(self.pending.fetch())
    }

    /// The bytes of the file's end: its channels and statistics.
    ///
    /// # Errors
    /// None that depends on the frames.
    pub fn finish(mut self) -> Result<Vec<u8>> {
        self.writer.finish().map_err(failed)?;
        Ok(self.pending.fetch())
    }
}

/// Bytes of a sample.
fn sample_bytes(frame: &RawFrame) -> usize {
    if frame.bits <= 8 { 1 } else { 2 }
}

/// A whole recording. No time is known of these frames: they are stamped 1 s apart.
///
/// # Errors
/// Facts that the frames do not carry, and those of [`Recording`].
pub fn encode(frames: &Frames) -> Result<Vec<u8>> {
    let mut recording = Recording::new(&frames.raw(0)?, None)?;
    let mut bytes = Vec::new();
    for i in 0..frames.planes.len() {
        bytes.extend(recording.frame(&frames.raw(i)?, i as u64 * ros::NS_PER_S)?);
    }
    bytes.extend(recording.finish()?);
    Ok(bytes)
}

/// Reads the frames of a recording: the images of its one topic of raw pixels.
///
/// # Errors
/// A damaged file, several topics of images, pixels that are not raw, images of several sizes.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    let not_whole = |what: &str| {
        Error::input(format!("not a whole MCAP recording: {what}"))
            .help("one that was cut off is repaired by `mcap recover`")
    };
    let damaged = |error: mcap::McapError| not_whole(&error.to_string());
    let checked = |bytes: &[u8]| {
        let within = records_end_within(bytes.get(MCAP_MAGIC.len()..).unwrap_or_default(), false);
        let longer = || not_whole("a record or a text is longer than what holds it");
        within.then_some(()).ok_or_else(longer)
    };
    checked(bytes)?;
    let unpacked = chunks::unpacked(bytes)?;
    let bytes = unpacked.as_deref().unwrap_or(bytes);
    checked(bytes)?;
    let mut topic: Option<Arc<mcap::Channel<'_>>> = None;
    let (mut planes, mut facts) = (Vec::<Plane<u16>>::new(), Facts::default());
    let checking = Options::ValidateChunkCrcs.into();
    for message in MessageStream::new_with_options(bytes, checking).map_err(damaged)? {
        let message = message.map_err(damaged)?;
        let channel = &message.channel;
        if channel.schema.as_ref().is_none_or(|schema| schema.name != ros::IMAGE) {
            continue;
        }
        if topic.as_ref().is_some_and(|t| t.id != channel.id) {
            return Err(Error::unsupported("images of several topics in one recording")
                .help("filter it: `mcap filter --include-topic-regex /camera/image_raw`"));
        }
        let (cfa, width, height, data) = Image::decode(&message.data)?;
        if topic.is_none() {
            facts.cfa = cfa;
            facts.merge_note(channel.metadata.get(NOTE).map_or("", |note| note));
            topic = Some(channel.clone());
        }
        if planes.first().is_some_and(|p| (p.width, p.height) != (width, height)) {
            return Err(Error::unsupported("images of several sizes in one recording"));
        }
        planes.push(Plane { width, height, data });
    }
    if planes.is_empty() {
        return Err(Error::input("a recording without images")
            .help("raw pixels are in messages sensor_msgs/msg/Image"));
    }
    Ok(Frames { planes, facts })
}

/// Whether every record ends within the bytes that hold it, and every text within its record, and
/// whether the records of chunks that are not compressed fill what they are said to: `mcap`
/// calculates with the lengths that they state, and takes memory for them, as if they did.
fn records_end_within(mut rest: &[u8], in_chunk: bool) -> bool {
    // An opcode and a length.
    const HEAD: usize = 9;
    while let Some((head, after)) = rest.split_at_checked(HEAD) {
        let length = u64::from_le_bytes(std::array::from_fn(|i| head[1 + i]));
        let record = usize::try_from(length).ok().and_then(|n| after.split_at_checked(n));
        let Some((record, next)) = record else { return false };
        if !texts_end_within(head[0], record) {
            return false;
        }
        match head[0] {
            _ if in_chunk => rest = next,
            op::FOOTER => return true,
            op::CHUNK if !chunk_is_filled(record) => return false,
            _ => rest = next,
        }
    }
    rest.is_empty() || !in_chunk
}

/// A field of a record.
enum Field {
    /// So many bytes.
    Bytes(usize),
    /// A length, and as many bytes: a text, or an array or a map of numbers.
    Text,
    /// A length, and texts that fill it.
    Texts,
}

/// The fields of a record, up to the last text.
fn fields(kind: u8) -> &'static [Field] {
    use Field::{Bytes, Text, Texts};
    match kind {
        op::HEADER => &[Text, Text],
        op::SCHEMA => &[Bytes(2), Text, Text, Text],
        op::CHANNEL => &[Bytes(4), Text, Text, Texts],
        op::CHUNK => &[Bytes(28), Text],
        op::CHUNK_INDEX => &[Bytes(32), Text, Bytes(8), Text],
        op::ATTACHMENT => &[Bytes(16), Text, Text],
        op::ATTACHMENT_INDEX => &[Bytes(40), Text, Text],
        op::METADATA => &[Text, Texts],
        op::METADATA_INDEX => &[Bytes(16), Text],
        _ => &[],
    }
}

/// Whether the texts of a record end within it.
fn texts_end_within(kind: u8, record: &[u8]) -> bool {
    fn split(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
        let (length, rest) = bytes.split_first_chunk()?;
        rest.split_at_checked(u32::from_le_bytes(*length) as usize)
    }
    let mut rest = record;
    for field in fields(kind) {
        let found = match field {
            Field::Bytes(count) => rest.split_at_checked(*count),
            Field::Text | Field::Texts => split(rest),
        };
        let Some((content, after)) = found else { return false };
        let mut texts = if matches!(field, Field::Texts) { content } else { &[] };
        while !texts.is_empty() {
            let Some((_, after)) = split(texts) else { return false };
            texts = after;
        }
        rest = after;
    }
    true
}

/// Whether the records of a chunk fill what is said to hold them, where they are not compressed.
fn chunk_is_filled(chunk: &[u8]) -> bool {
    // Two times, the length when unpacked and its checksum; the length of the compression's name,
    // which is 0 without any, and that of the records.
    const BEFORE: usize = 28;
    match chunk.get(BEFORE..).and_then(|rest| rest.split_first_chunk::<12>()) {
        Some(([0, 0, 0, 0, stated @ ..], rest)) => {
            let stated = usize::try_from(u64::from_le_bytes(*stated)).unwrap_or(usize::MAX);
            rest.get(..stated).is_some_and(|records| records_end_within(records, true))
        }
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Cfa;

    fn frame(bits: u32, cfa: &str) -> RawFrame {
        let white = ((1u32 << bits) - 1) as u16;
        RawFrame {
            width: 4,
            height: 2,
            bits,
            cfa: Cfa::parse(cfa).unwrap(),
            black_level_dn: 4.5,
            white_level_dn: white,
            data: vec![0, 1, 42, white, white / 2, 3, 4, 5],
        }
    }

    fn info() -> CameraInfo {
        CameraInfo { focal_px: [900.0; 2], centre_px: [1.5, 0.5], radial: [-0.1, 0.02, 0.0] }
    }

    fn recorded(frame: &RawFrame, camera: Option<CameraInfo>) -> Vec<u8> {
        let mut recording = Recording::new(frame, camera).unwrap();
        let mut bytes = Vec::new();
        for i in 0..3 {
            bytes.extend(recording.frame(frame, 1_500_000_000 * i).unwrap());
        }
        bytes.extend(recording.finish().unwrap());
        bytes
    }

    #[test]
    fn frames_come_back_with_what_is_known_about_them() {
        for (bits, cfa) in [(8, "GRBG"), (10, "RGGB"), (16, "BGGR"), (12, "mono")] {
            let frame = frame(bits, cfa);
            let bytes = recorded(&frame, Some(info()));
            let back = decode(&bytes).unwrap();
            assert_eq!(back.planes.len(), 3);
            assert_eq!(back.raw(2).unwrap(), frame, "{bits} {cfa}");
            assert_eq!(recorded(&frame, Some(info())), bytes, "the same bytes again");
        }
    }

    /// Chunks as other writers pack them, with an index behind them that no longer fits.
    #[test]
    fn several_cameras_have_topics_of_their_own() {
        let (left, right) = (frame(8, "mono"), frame(10, "RGGB"));
        let cameras = [
            Recorded { name: "left", like: &left, info: None },
            Recorded { name: "right", like: &right, info: Some(info()) },
        ];
        let mut recording = Recording::of(&cameras).unwrap();
        let mut bytes = Vec::new();
        for i in 0..2 {
            bytes.extend(recording.frame_of(0, &left, 10 * i).unwrap());
            bytes.extend(recording.frame_of(1, &right, 10 * i + 1).unwrap());
        }
        bytes.extend(recording.finish().unwrap());
        let messages = MessageStream::new(&bytes).unwrap().map(|message| message.unwrap());
        let seen: Vec<_> =
            messages.map(|m| (m.channel.topic.clone(), m.log_time, m.sequence)).collect();
        let seen = seen.iter().map(|(topic, time, sequence)| (&topic[..], *time, *sequence));
        let expected = [0, 1].map(|i: u32| {
            let time = 10 * u64::from(i);
            [
                ("/left/image_raw", time, i),
                ("/right/camera_info", time + 1, i),
                ("/right/image_raw", time + 1, i),
            ]
        });
        assert_eq!(seen.collect::<Vec<_>>(), expected.concat());
        assert!(decode(&bytes).unwrap_err().to_string().contains("several topics"));
    }

    #[test]
    fn compressed_chunks_are_read() {
        let frame = frame(12, "GBRG");
        let plain = recorded(&frame, None);
        for packing in ["zstd", "lz4"] {
            let packed = chunks::tests::packed(&plain, packing);
            assert_ne!(packed, plain);
            assert_eq!(decode(&packed).unwrap(), decode(&plain).unwrap(), "{packing}");
            let mut damaged = packed.clone();
            // In the first chunk, behind its head.
            let chunk = packed.iter().zip(&plain).position(|(a, b)| a != b).unwrap();
            damaged[chunk + 50..chunk + 90].fill(0x55);
            assert!(decode(&damaged).is_err(), "{packing}");
        }
        let other = chunks::tests::packed(&plain, "brotli");
        let error = decode(&other).unwrap_err().to_string();
        assert!(error.contains("brotli") && error.contains("mcap compress"), "{error}");
    }

    /// One bit of a pixel, in a chunk with its checksum and in records with that of all data.
    #[test]
    fn a_wrong_bit_does_not_agree_with_the_checksums() {
        let frame = frame(12, "GBRG");
        let plain = recorded(&frame, None);
        for whole in [chunks::tests::packed(&plain, ""), plain] {
            assert_eq!(decode(&whole).unwrap().raw(2).unwrap(), frame);
            let samples: Vec<u8> = frame.data.iter().flat_map(|dn| dn.to_le_bytes()).collect();
            let at = whole.windows(samples.len()).position(|w| w == samples).unwrap();
            let mut damaged = whole;
            damaged[at + 2] ^= 1;
            let error = decode(&damaged).unwrap_err().to_string();
            assert!(error.to_lowercase().contains("crc"), "{error}");
        }
    }

    /// Drivers of cameras without a colour filter array, or that do not know it, say the type of
    /// the samples alone.
    #[test]
    fn samples_without_a_pattern_are_read() {
        for (encoding, data, samples) in
            [("16UC1", vec![1, 2, 3, 4], vec![513, 1027]), ("8UC1", vec![1, 2], vec![1, 2])]
        {
            let image = Image { width: 2, height: 1, encoding: encoding.into(), data };
            assert_eq!(Image::decode(&image.encode(0, CAMERA)).unwrap(), (None, 2, 1, samples));
        }
    }

    /// A record that states 2⁶⁴ − 1 bytes, in the file and in a chunk.
    #[test]
    fn records_of_lying_lengths_are_refused() {
        let record = |opcode: u8, length: u64, content: &[u8]| {
            [&[opcode][..], &length.to_le_bytes(), content].concat()
        };
        let lying = record(op::MESSAGE, u64::MAX, &[0; 40]);
        let chunk = |stated: u64, records: &[u8]| {
            let content = [&[0; 32][..], &stated.to_le_bytes(), records].concat();
            record(op::CHUNK, content.len() as u64, &content)
        };
        let holding_it = chunk(lying.len() as u64, &lying);
        // Part of a record's head, and records that are not there.
        let (cut, missing) = (chunk(4, &[0; 4]), chunk(40, &[0; 9]));
        // Texts that state nearly 2³² bytes: a schema's name, the second text of a channel's map.
        let text = |length: u32, content: &[u8]| [&length.to_le_bytes()[..], content].concat();
        let name = [&[1, 0][..], &text(u32::MAX - 9, &[0; 40])].concat();
        let schema = record(op::SCHEMA, name.len() as u64, &name);
        let map = [text(1, b"a"), text(u32::MAX - 9, &[0; 40])].concat();
        let (topic, map) = ([text(1, b"t"), text(0, b"")].concat(), text(map.len() as u32, &map));
        let channel = [&[1, 0, 1, 0][..], &topic, &map].concat();
        let channel = record(op::CHANNEL, channel.len() as u64, &channel);
        let index = [&[0; 16][..], &text(1 << 29, &[0; 4])].concat();
        let index = record(op::METADATA_INDEX, index.len() as u64, &index);
        for records in [lying, holding_it, cut, missing, schema, channel, index] {
            let error = decode(&[MCAP_MAGIC, &records].concat()).err().unwrap().to_string();
            assert!(error.contains("longer than what holds it"), "{error}");
        }
    }

    /// Bytes by hand from the message definitions and XCDR1's alignment.
    #[test]
    fn messages_are_laid_out_as_the_definitions_say() {
        let image = Image { width: 2, height: 1, encoding: "mono8".into(), data: vec![7, 9] };
        let mut expected = vec![0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 7, 0, 0, 0];
        expected.extend(b"camera\0\0"); // one byte of padding before the next u32
        expected.extend([1, 0, 0, 0, 2, 0, 0, 0, 6, 0, 0, 0]);
        expected.extend(b"mono8\0\0\0"); // not big-endian, one byte of padding
        expected.extend([2, 0, 0, 0, 2, 0, 0, 0, 7, 9]);
        assert_eq!(image.encode(1_000_000_002, CAMERA), expected);
        let message = info().encode((4, 2), 0, CAMERA);
        // Head, stamp, frame, sizes, "plumb_bob", count: 4 + 8 + 11 + 1 + 8 + 14 + 2 + 4, then d.
        let f64_at = |at: usize| f64::from_le_bytes(message[at..at + 8].try_into().unwrap());
        assert_eq!([0, 1, 2, 3, 4].map(|i| f64_at(52 + 8 * i)), [-0.1, 0.02, 0.0, 0.0, 0.0]);
        assert_eq!(f64_at(52 + 40), 900.0);
        assert_eq!(f64_at(52 + 56), 1.5);
        assert_eq!(message.len(), 52 + 8 * (5 + 9 + 9 + 12) + 6 * 4 + 1);
    }

    /// Pixels 2 and 3 of the whole are pixel 0 of the part, whose centre is at 2.5 of the whole.
    #[test]
    fn a_part_of_the_frame_has_figures_of_its_own() {
        let part = CameraInfo { centre_px: [6.5, 3.5], ..info() }.of_part([2, 0], 2);
        assert_eq!((part.focal_px, part.centre_px), ([450.0; 2], [2.0, 1.5]));
        assert_eq!(part.radial, info().radial);
    }

    #[test]
    fn what_ros_has_no_name_for_and_damage_are_refused() {
        let said = Recording::new(&frame(10, "RGBW/BGWR"), None).err().map(|e| e.to_string());
        assert!(said.is_none_or(|s| s.contains("ROS")));
        let bytes = recorded(&frame(10, "RGGB"), None);
        for end in [0, 8, 40, bytes.len() / 2] {
            assert!(decode(&bytes[..end]).is_err(), "{end}");
        }
        let message = Image { width: 2, height: 2, encoding: "rgb8".into(), data: vec![0; 12] };
        assert!(Image::decode(&message.encode(0, CAMERA)).is_err());
        let message = Image { width: 9, height: 9, encoding: "mono16".into(), data: vec![0; 12] };
        assert!(Image::decode(&message.encode(0, CAMERA)).is_err());
    }
}
