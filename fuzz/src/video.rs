//! Video of a scene from arbitrary bytes: every frame is a picture of the size that the header
//! says, or the stream is refused.

use camrig_scene::Scene;
use camrig_scene::sequence::SceneSequence;
use camrig_scene_files::sequence::y4m::Video;
use std::io::Cursor;

/// Frames of the stream that are looked at.
const FRAMES: usize = 2;

/// Goes through the first frames of a stream.
pub fn watch(data: &[u8]) {
    let Ok(mut video) = Video::new("it", Box::new(Cursor::new(data.to_vec())), "", None) else {
        return;
    };
    let mut size = None;
    for _ in 0..FRAMES {
        let Ok(Some(frame)) = video.next_frame() else { return };
        assert!(frame.start_s >= 0.0 && frame.end_s.is_some_and(|end| end > frame.start_s));
        let cube = frame.open().expect("codes are colours");
        assert!(cube.band(15).is_ok() && cube.bands().count == 31);
        assert_eq!(*size.get_or_insert(cube.size()), cube.size());
    }
}
