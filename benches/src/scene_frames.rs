//! Messages of `camrig-frames/1` (docs/frames.md): three samples a pixel, interleaved, Rec. 709.

/// How a pixel's samples are stored, and what they mean.
#[derive(Clone, Copy)]
pub enum Kind {
    /// Bytes by the curve of sRGB: reflectance.
    Codes,
    /// Floats, linear: radiance, 100 cd/m² for a luminance of 1.
    Floats,
}

impl Kind {
    fn bytes(self) -> u32 {
        match self {
            Self::Codes => 1,
            Self::Floats => 4,
        }
    }

    /// Bytes of the samples of a frame.
    pub fn payload(self, [width, height]: [u32; 2]) -> usize {
        (3 * self.bytes() * width * height) as usize
    }
}

/// The header of a frame, 25 of which are a second; `None` ends the stream.
pub fn header(number: u64, frame: Option<([u32; 2], Kind)>) -> [u8; 256] {
    let mut head = [0; 256];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"CRFRAME1");
    put(8, &256u32.to_le_bytes());
    put(12, &(if frame.is_none() { 2u32 } else { 0 }).to_le_bytes());
    put(16, &number.to_le_bytes());
    put(24, &(number * 40_000_000).to_le_bytes());
    let (size, kind) = frame.unwrap_or(([0; 2], Kind::Floats));
    for (at, value) in [(40, size[0]), (44, size[1]), (48, 3)] {
        put(at, &value.to_le_bytes());
    }
    let (sample, quantity, transfer, scale) = match kind {
        Kind::Codes => (1u16, 1u16, 1u16, 1.0f64),
        Kind::Floats => (4, 2, 0, 100.0),
    };
    for (at, value) in [(52, sample), (54, 1), (56, quantity), (58, 1), (60, transfer)] {
        put(at, &value.to_le_bytes());
    }
    put(64, &u64::from(3 * kind.bytes() * size[0]).to_le_bytes());
    put(80, &(kind.payload(size) as u64).to_le_bytes());
    put(88, &(if frame.is_none() { 0.0 } else { scale }).to_le_bytes());
    if let Kind::Codes = kind {
        put(208, b"D65");
    }
    let crc = crc32c(&head[..252]);
    head[252..].copy_from_slice(&crc.to_le_bytes());
    head
}

fn crc32c(bytes: &[u8]) -> u32 {
    let shift = |crc: u32, _| crc >> 1 ^ if crc & 1 == 1 { 0x82f6_3b78 } else { 0 };
    !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), shift))
}
