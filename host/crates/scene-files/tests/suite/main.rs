//! Scenes from files, as a user opens them.

mod picture_files;
mod scene_files;
mod scene_units;
