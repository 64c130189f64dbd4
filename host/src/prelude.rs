//! What most programs that use camrig need: `use camrig::prelude::*;`.

pub use camrig_base::{Cfa, Error, ErrorKind, Plane, RawFrame, Result};
pub use camrig_camera::Camera;
pub use camrig_captures::CaptureSet;
pub use camrig_exposure::IrradianceCube;
pub use camrig_formats::{Format, Frames};
pub use camrig_light::{Illuminant, LightLevel};
pub use camrig_optics::Options;
pub use camrig_render::{About, Arithmetic, SimulatedSensor};
pub use camrig_rig::{FrameRequest, Rig};
pub use camrig_scene::{LitScene, Scene};
pub use camrig_sensor_core::config::FrameSettings;
