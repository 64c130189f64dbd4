//! Rendering: scene + camera → irradiance → raw frames.
