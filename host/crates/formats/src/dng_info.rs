//! Metadata of a DNG file.

use super::opcodes::Opcode;
use camrig_base::RawFrame;

/// What a DNG says about a frame beyond its samples. Fields that are `None` or empty are not
/// written.
#[derive(Clone, Debug, PartialEq)]
pub struct DngInfo {
    /// Maker of the camera.
    pub make: String,
    /// Model of the camera.
    pub model: String,
    /// Free text: scene, seed, frame number.
    pub description: String,
    /// Time of capture, `YYYY:MM:DD HH:MM:SS`. Never taken from the clock: a simulated frame has
    /// no time of capture.
    pub datetime: Option<String>,
    /// Exposure time, s.
    pub exposure_s: Option<f64>,
    /// ISO speed; 100 times the analogue gain by the convention of camera-tuning tools.
    pub iso: Option<u32>,
    /// f-number.
    pub f_number: Option<f64>,
    /// Focal length, mm.
    pub focal_length_mm: Option<f64>,
    /// XYZ to camera under illuminant A, scaled so that white's largest channel is 1.
    pub color_matrix_a: Option<[[f64; 3]; 3]>,
    /// XYZ to camera under illuminant D65, scaled likewise.
    pub color_matrix_d65: Option<[[f64; 3]; 3]>,
    /// Camera R, G, B of a white in the scene's light, the largest 1.
    pub as_shot_neutral: Option<[f64; 3]>,
    /// (S, O) of each channel: the variance of a signal x (0 at black, 1 at white) is `S x + O`.
    pub noise_profile: Vec<(f64, f64)>,
    /// Black levels of the cells of the colour filter pattern, row-major, DN; empty: the frame's
    /// own black level everywhere.
    pub black_levels_dn: Vec<f64>,
    /// Corrections of stored values (bad pixels).
    pub opcode_list1: Vec<Opcode>,
    /// Corrections of linear values before demosaicing (gain maps).
    pub opcode_list2: Vec<Opcode>,
}

impl Default for DngInfo {
    fn default() -> Self {
        Self {
            make: "camrig".into(),
            model: "camrig".into(),
            description: String::new(),
            datetime: None,
            exposure_s: None,
            iso: None,
            f_number: None,
            focal_length_mm: None,
            color_matrix_a: None,
            color_matrix_d65: None,
            as_shot_neutral: None,
            noise_profile: Vec::new(),
            black_levels_dn: Vec::new(),
            opcode_list1: Vec::new(),
            opcode_list2: Vec::new(),
        }
    }
}

/// Black level of each cell of the pattern, DN.
pub(super) fn black_levels(frame: &RawFrame, info: &DngInfo) -> Vec<f64> {
    if info.black_levels_dn.is_empty() {
        vec![frame.black_level_dn; frame.cfa.width * frame.cfa.height]
    } else {
        info.black_levels_dn.clone()
    }
}
