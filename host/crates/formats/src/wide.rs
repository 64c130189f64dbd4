//! Frames of more than 16 bits: the linear signal of a sensor that merges several readings of a
//! pixel. NumPy arrays (`<u4`), TIFF (32-bit words) and CSI-2 (RAW20, RAW24) hold them.

#[cfg(feature = "tiff")]
use super::tiff16;
use super::{Format, Frames, csi2, npy};
use camrig_base::{Error, Result};

/// The bytes of a file.
///
/// # Errors
/// A format that does not hold more than 16 bits; those of the format's writer.
pub fn encode(format: &Format, frames: &Frames<u32>) -> Result<Vec<u8>> {
    match format {
        Format::Npy => npy::encode(frames),
        #[cfg(feature = "tiff")]
        Format::Tiff => tiff16::encode(frames),
        Format::Csi2 => csi2::encode(frames),
        other => Err(unsupported(other)),
    }
}

/// Refuses a format that does not hold more than 16 bits.
///
/// # Errors
/// Such a format.
pub fn check(format: &Format) -> Result<()> {
    match format {
        Format::Npy | Format::Tiff | Format::Csi2 => Ok(()),
        other => Err(unsupported(other)),
    }
}

fn unsupported(format: &Format) -> Error {
    Error::unsupported(format!("samples of more than 16 bits as {format}"))
        .help("write .npy or .tiff, which hold 32 bits, or .csi2 (20 or 24)")
}

/// Reads the frames of a file whose samples may have more than 16 bits: an array or a TIFF of 32
/// or more, RAW20 or RAW24 packets. `None` for others, which [`decode`](super::decode) reads.
///
/// # Errors
/// Those of the format's reader.
pub fn decode(bytes: &[u8]) -> Result<Option<Frames<u32>>> {
    let frames: Frames<u32> = match Format::sniff(bytes) {
        Some(Format::Npy) if npy::is_wide(bytes) => npy::decode(bytes)?,
        #[cfg(feature = "tiff")]
        Some(Format::Tiff) if tiff16::is_wide(bytes) => tiff16::decode(bytes)?,
        Some(Format::Csi2) if csi2::is_wide(bytes) => csi2::decode(bytes)?,
        _ => return Ok(None),
    };
    let is_wide = |frames: &Frames<u32>| match frames.facts.bits {
        Some(bits) => bits > u16::BITS,
        None => frames.planes.iter().flat_map(|p| &p.data).any(|dn| *dn > u16::MAX.into()),
    };
    Ok(Some(frames).filter(is_wide))
}
