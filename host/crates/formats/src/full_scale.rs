//! How ffmpeg shows headerless samples at their brightness.
//!
//! ffmpeg has Bayer formats of 8 and 16 bits and takes 65535 for white in the latter: 10 bits in
//! them, whose white is 1023, come out black unless they are stretched. GStreamer takes Bayer of
//! more than 8 bits from 1.24 on and grey as 8 or 16 bits alone, with rows that end on multiples of
//! four bytes; ffmpeg gives it what every version takes.

/// The filter that stretches `bits` of a 16-bit Bayer format to its range, with a space before it;
/// empty where the format has the samples' range.
pub fn filter(bits: u32, mono: bool) -> String {
    if mono || matches!(bits, 8 | 16) {
        return String::new();
    }
    let stretched = format!("val*65535/{}", (1u32 << bits) - 1);
    format!(" -vf \"format=rgb48le,lutrgb=r={stretched}:g={stretched}:b={stretched}\"")
}

/// What follows `gst-launch-1.0` for frames that `ffmpeg`, a command that writes `out.png`, reads.
pub fn through_ffmpeg(ffmpeg: &str, width: usize, height: usize) -> String {
    let input = ffmpeg.trim_end_matches("out.png").replacen("ffmpeg", "ffmpeg -v error", 1);
    format!(
        "{input}-pix_fmt rgb0 -f rawvideo - | gst-launch-1.0 fdsrc blocksize={} ! \
         video/x-raw,format=RGBx,width={width},height={height},framerate=1/1 ! ...",
        4 * width * height
    )
}
