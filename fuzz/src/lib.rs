//! What is fuzzed: the decoders of both ends of the link, the GigE Vision and USB cameras, sensors
//! on I2C, streams of scenes, readers of files.
//!
//! `fuzz_targets` hands these functions to libFuzzer (`ci/fuzz`); `tests/seeds.rs` calls them with
//! the seeds and with a fixed number of changes of each.

pub mod device;
pub mod files;
pub mod frames;
pub mod gige;
pub mod host;
pub mod memory;
pub mod profiles;
pub mod usbip;
pub mod video;
