//! gzip around other formats (`.fits.gz`) and inside them.

use camrig_base::Result;
#[cfg(feature = "gzip")]
use {super::truncated, camrig_base::Error, flate2::read::MultiGzDecoder, std::io::Read};

/// Largest file that is unpacked into memory, bytes: a chosen bound, a hundred frames of 10
/// million pixels; gzip can make a thousand bytes of one.
pub(super) const LARGEST: usize = 2 << 30;

/// Whether bytes are a gzip file.
pub(super) fn is_gzip(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x1F, 0x8B, 8])
}

/// The content of a gzip file, of `most` bytes or fewer.
///
/// # Errors
/// Damaged or truncated bytes, a larger content; a build without gzip.
#[cfg(feature = "gzip")]
pub(super) fn inflate(bytes: &[u8], most: usize) -> Result<Vec<u8>> {
    let mut content = Vec::new();
    // One byte more shows that there are more.
    let mut reader = MultiGzDecoder::new(bytes).take(most as u64 + 1);
    match reader.read_to_end(&mut content) {
        Ok(_) if content.len() > most => {
            Err(Error::limit(format!("a gzip file of more than {most} bytes"))
                .help("unpack it first"))
        }
        Ok(_) => Ok(content),
        Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            Err(truncated(bytes.len() + 1, bytes.len()).at("gzip"))
        }
        Err(e) => Err(Error::input(format!("gzip: {e}")).help("the file is damaged")),
    }
}

#[cfg(not(feature = "gzip"))]
pub(super) fn inflate(_: &[u8], _: usize) -> Result<Vec<u8>> {
    Err(super::left_out("gzip"))
}
