//! The two ROS 2 messages of a camera, in the Common Data Representation (OMG CDR 1.0, XCDR1,
//! little-endian): a head of 4 bytes, then fields, each aligned to its own size from there on.
//!
//! Sources: `sensor_msgs/msg/Image`, `sensor_msgs/msg/CameraInfo` and
//! `sensor_msgs/msg/RegionOfInterest` of ROS 2's common_interfaces; REP 104 for what is in them.

use crate::truncated;
use camrig_base::{Cfa, Error, Result};

/// Name of the schema of an image.
pub const IMAGE: &str = "sensor_msgs/msg/Image";
/// Name of the schema of a camera's figures.
pub const CAMERA_INFO: &str = "sensor_msgs/msg/CameraInfo";

/// What both definitions end with.
macro_rules! header {
    () => {
        "================================================================================\n\
         MSG: std_msgs/Header\n\
         builtin_interfaces/Time stamp\n\
         string frame_id\n\
         ================================================================================\n\
         MSG: builtin_interfaces/Time\n\
         int32 sec\n\
         uint32 nanosec\n"
    };
}

/// Definition of an image.
pub const IMAGE_DEFINITION: &str = concat!(
    "std_msgs/Header header\n\
     uint32 height\n\
     uint32 width\n\
     string encoding\n\
     uint8 is_bigendian\n\
     uint32 step\n\
     uint8[] data\n",
    header!()
);

/// Definition of a camera's figures.
pub const CAMERA_INFO_DEFINITION: &str = concat!(
    "std_msgs/Header header\n\
     uint32 height\n\
     uint32 width\n\
     string distortion_model\n\
     float64[] d\n\
     float64[9] k\n\
     float64[9] r\n\
     float64[12] p\n\
     uint32 binning_x\n\
     uint32 binning_y\n\
     sensor_msgs/RegionOfInterest roi\n\
     ================================================================================\n\
     MSG: sensor_msgs/RegionOfInterest\n\
     uint32 x_offset\n\
     uint32 y_offset\n\
     uint32 height\n\
     uint32 width\n\
     bool do_rectify\n",
    header!()
);

/// Head of a message: CDR, little-endian.
const HEAD: [u8; 4] = [0, 1, 0, 0];
/// Nanoseconds in a second.
pub const NS_PER_S: u64 = 1_000_000_000;

/// A pinhole camera with radial distortion (Brown 1966), as REP 104's `plumb_bob`: a point at
/// x, y in the plane at distance 1 is seen at pixel (fx·x·s + cx, fy·y·s + cy) with
/// s = 1 + k1·r² + k2·r⁴ + k3·r⁶, r² = x² + y². The centre of the upper left pixel is at (0, 0).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraInfo {
    /// Focal length, pixels, to the right and down.
    pub focal_px: [f64; 2],
    /// Where the optical axis meets the sensor, pixels from the upper left pixel's centre.
    pub centre_px: [f64; 2],
    /// k1, k2, k3.
    pub radial: [f64; 3],
}

/// Packs a message.
struct Writer(Vec<u8>);

impl Writer {
    /// A message of this time, in this frame of reference.
    fn new(stamp_ns: u64, frame_id: &str) -> Self {
        let mut message = Self(HEAD.to_vec());
        message.u32((stamp_ns / NS_PER_S) as u32);
        message.u32((stamp_ns % NS_PER_S) as u32);
        message.text(frame_id);
        message
    }

    fn align(&mut self, bytes: usize) {
        let end = HEAD.len() + (self.0.len() - HEAD.len()).next_multiple_of(bytes);
        self.0.resize(end, 0);
    }

    fn u32(&mut self, value: u32) {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    fn f64s(&mut self, values: &[f64]) {
        self.align(8);
        values.iter().for_each(|v| self.0.extend_from_slice(&v.to_le_bytes()));
    }

    fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
    }
}

/// An image as a message holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// ROS's name of the pixels' layout.
    pub encoding: String,
    /// Samples, 8 or 16 bits each, low byte first.
    pub data: Vec<u8>,
}

/// ROS's name of pixels of a colour filter pattern, with samples of one or two bytes.
///
/// # Errors
/// A pattern that is not Bayer's.
pub fn encoding(cfa: &Cfa, bytes: usize) -> Result<String> {
    let bits = 8 * bytes;
    if cfa.is_mono() {
        return Ok(format!("mono{bits}"));
    }
    let pattern = cfa.to_string().to_ascii_lowercase();
    if !["rggb", "bggr", "gbrg", "grbg"].contains(&pattern.as_str()) {
        return Err(Error::unsupported(format!("a colour filter pattern {cfa} in a ROS image"))
            .help("ROS has names for Bayer patterns and grey alone; write csi2 or headerless"));
    }
    Ok(format!("bayer_{pattern}{bits}"))
}

/// The pattern, where it is said, and the bytes per sample that a ROS name means.
fn layout(encoding: &str) -> Result<(Option<Cfa>, usize)> {
    match encoding {
        "8UC1" => return Ok((None, 1)),
        "16UC1" => return Ok((None, 2)),
        _ => {}
    }
    let name = encoding.trim_end_matches(|c: char| c.is_ascii_digit());
    let bytes = match &encoding[name.len()..] {
        "8" => 1,
        "16" => 2,
        _ => 0,
    };
    let cfa = match name {
        "mono" => Cfa::parse("mono").ok(),
        _ => name.strip_prefix("bayer_").and_then(|p| Cfa::parse(&p.to_ascii_uppercase()).ok()),
    };
    cfa.filter(|_| bytes > 0).map(|cfa| (Some(cfa), bytes)).ok_or_else(|| {
        Error::unsupported(format!("a ROS image of {encoding:?}"))
            .help("mono8, mono16, 8UC1, 16UC1 and bayer_RGGB8 or 16 of the four patterns hold raw pixels")
    })
}

impl Image {
    /// The message's bytes; `stamp_ns` since the recording's begin, in a frame of reference.
    pub fn encode(&self, stamp_ns: u64, frame_id: &str) -> Vec<u8> {
        let step = self.data.len() / (self.height as usize).max(1);
        let mut message = Writer::new(stamp_ns, frame_id);
        message.u32(self.height);
        message.u32(self.width);
        message.text(&self.encoding);
        message.0.push(0); // little-endian
        message.u32(step as u32);
        message.u32(self.data.len() as u32);
        message.0.extend_from_slice(&self.data);
        message.0
    }

    /// Its colour filter pattern, where it says one, its width, height and samples, DN.
    ///
    /// # Errors
    /// A message that ends early, samples that are no raw pixels.
    pub fn decode(message: &[u8]) -> Result<(Option<Cfa>, usize, usize, Vec<u16>)> {
        let mut reader = Reader::new(message)?;
        reader.u32()?; // seconds
        reader.u32()?; // nanoseconds
        reader.text()?; // frame of reference
        let [height, width] = [reader.u32()?, reader.u32()?].map(|n| n as usize);
        let encoding = reader.text()?;
        let big = reader.bytes(1)?[0] != 0;
        let step = reader.u32()? as usize;
        let length = reader.u32()? as usize;
        let data = reader.bytes(length)?;
        let (cfa, bytes) = layout(encoding)?;
        crate::area(width, height)?;
        if step < width * bytes || step.checked_mul(height).is_none_or(|n| n > length) {
            return Err(Error::input(format!(
                "rows of {step} bytes, {length} in all, for {width} x {height} pixels of {encoding}"
            ))
            .help("the recording is damaged"));
        }
        let sample = |bytes: &[u8]| match *bytes {
            [dn] => dn.into(),
            [a, b] if big => u16::from_be_bytes([a, b]),
            [a, b, ..] => u16::from_le_bytes([a, b]),
            [] => 0,
        };
        let rows = data.chunks_exact(step).take(height);
        let samples = rows.flat_map(|row| row[..width * bytes].chunks_exact(bytes).map(sample));
        Ok((cfa, width, height, samples.collect()))
    }
}

impl CameraInfo {
    /// Of the part of the frame that begins at a pixel, with `n` x `n` pixels put together.
    #[must_use]
    pub fn of_part(self, begin: [usize; 2], n: u32) -> Self {
        let n = f64::from(n);
        let [x, y] = [0, 1].map(|i| (self.centre_px[i] - begin[i] as f64 + 0.5) / n - 0.5);
        Self { focal_px: self.focal_px.map(|f| f / n), centre_px: [x, y], ..self }
    }

    /// The message's bytes for images of `width` x `height` pixels; `stamp_ns` since the
    /// recording's begin, in a frame of reference.
    pub fn encode(&self, (width, height): (u32, u32), stamp_ns: u64, frame_id: &str) -> Vec<u8> {
        let ([fx, fy], [cx, cy], [k1, k2, k3]) = (self.focal_px, self.centre_px, self.radial);
        let mut message = Writer::new(stamp_ns, frame_id);
        message.u32(height);
        message.u32(width);
        message.text("plumb_bob");
        message.u32(5);
        message.f64s(&[k1, k2, 0.0, 0.0, k3]);
        message.f64s(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
        message.f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        message.f64s(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
        // No binning and the whole frame: zeros.
        for _ in 0..6 {
            message.u32(0);
        }
        message.0.push(0);
        message.0
    }
}

/// Reads a message's fields.
struct Reader<'a> {
    message: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn new(message: &'a [u8]) -> Result<Self> {
        match message {
            [0, 1, ..] if message.len() >= HEAD.len() => Ok(Self { message, at: HEAD.len() }),
            _ => Err(Error::unsupported("a message that is not little-endian CDR")),
        }
    }

    fn bytes(&mut self, count: usize) -> Result<&'a [u8]> {
        let rest = &self.message[self.at..];
        let bytes = rest.get(..count).ok_or_else(|| truncated(count, rest.len()))?;
        self.at += count;
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32> {
        let to_next = self.at.next_multiple_of(4) - self.at;
        self.bytes(to_next)?;
        let bytes = self.bytes(4)?;
        Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    fn text(&mut self) -> Result<&'a str> {
        let length = self.u32()? as usize;
        let bytes = self.bytes(length)?;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes))
            .map_err(|_| Error::input("text that is not UTF-8").help("the recording is damaged"))
    }
}
