//! Helpers shared by the benches.

pub mod cost;
pub mod frames;
pub mod scene_frames;
pub mod sensor;
