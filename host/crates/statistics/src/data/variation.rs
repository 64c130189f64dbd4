//! How light and offset vary over the frames of a stack, apart from noise.

/// Variation over the frames used of a stack; empty where there is none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameVariation {
    /// Light of each frame relative to the mean of all.
    pub light: Vec<f64>,
    /// Offset of each frame, DN.
    pub offset_dn: Vec<f64>,
}

impl FrameVariation {
    /// Whether all frames are equal.
    pub fn is_none(&self) -> bool {
        self.light.is_empty() && self.offset_dn.is_empty()
    }

    /// Light of a frame relative to the mean of all.
    pub fn light_of(&self, frame: usize) -> f64 {
        self.light.get(frame).copied().unwrap_or(1.0)
    }

    /// Offset of a frame, DN.
    pub fn offset_of(&self, frame: usize) -> f64 {
        self.offset_dn.get(frame).copied().unwrap_or(0.0)
    }
}
