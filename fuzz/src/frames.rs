//! `camrig-frames/1` from arbitrary bytes: frames go forward in number and time and can be looked
//! at, or the stream is refused. Checksums of headers are made right, or little would be reached.

use camrig_scene::Scene;
use camrig_scene::sequence::SceneSequence;
use camrig_scene_files::sequence::frames::Frames;
use std::io::Cursor;

const HEADER: usize = 256;

/// CRC-32C.
fn crc32c(data: &[u8]) -> u32 {
    !data.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ if crc & 1 == 1 { 0x82f6_3b78 } else { 0 }
        })
    })
}

/// Goes through a stream and looks at its frames.
pub fn watch(data: &[u8]) {
    let mut bytes = data.to_vec();
    if bytes.len() >= HEADER {
        bytes[..8].copy_from_slice(b"CRFRAME1");
        let crc = crc32c(&bytes[..252]);
        bytes[252..HEADER].copy_from_slice(&crc.to_le_bytes());
    }
    let mut frames = Frames::new("it", Box::new(Cursor::new(bytes)));
    let mut newest = None;
    while let Ok(Some(frame)) = frames.next_frame() {
        assert!(newest.is_none_or(|(number, time)| frame.number > number && frame.start_s > time));
        newest = Some((frame.number, frame.start_s));
        if let Ok(cube) = frame.open() {
            // Samples may be none of the quantity; what is read has the size that was said.
            let (width, height) = cube.size();
            for band in [0, cube.bands().count - 1] {
                if let Ok(plane) = cube.band(band) {
                    assert_eq!(plane.data.len(), width * height);
                }
            }
        }
    }
}
