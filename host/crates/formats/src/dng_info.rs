//! Metadata of a DNG file.

use super::opcodes::Opcode;
use camrig_base::RawFrame;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Fields of the main directory that belong to the colour matrices or to the exposure, which a
/// copy keeps.
pub(super) const CARRIED: [u16; 11] = [
    50723, // CameraCalibration1
    50724, // CameraCalibration2
    50727, // AnalogBalance
    50729, // AsShotWhiteXY
    50730, // BaselineExposure
    50731, // BaselineNoise
    50732, // BaselineSharpness
    50734, // LinearResponseLimit
    50739, // ShadowScale
    50964, // ForwardMatrix1
    50965, // ForwardMatrix2
];
/// CIE illuminant D65 in DNG's (Exif LightSource) numbering.
pub(super) const ILLUMINANT_D65: u16 = 21;

/// A colour matrix and the light it is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorMatrix {
    /// The light in Exif's LightSource numbering: 17 is illuminant A, 21 D65, 0 unknown.
    pub illuminant: u16,
    /// XYZ to camera R, G, B, scaled so that white's largest channel is 1.
    pub camera_from_xyz: [[f64; 3]; 3],
}

impl ColorMatrix {
    /// Of illuminant A.
    #[must_use]
    pub fn of_a(camera_from_xyz: [[f64; 3]; 3]) -> Self {
        Self { illuminant: 17, camera_from_xyz }
    }

    /// Of illuminant D65.
    #[must_use]
    pub fn of_d65(camera_from_xyz: [[f64; 3]; 3]) -> Self {
        Self { illuminant: ILLUMINANT_D65, camera_from_xyz }
    }
}

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
    /// Distance of neighbouring pixels, µm. FITS has a place for it, DNG none that readers agree
    /// on.
    pub pitch_um: Option<f64>,
    /// XYZ to camera R, G, B, for up to two lights.
    pub color_matrices: Vec<ColorMatrix>,
    /// Camera R, G, B of a white in the scene's light, the largest 1.
    pub as_shot_neutral: Option<[f64; 3]>,
    /// (S, O) of each channel: the variance of a signal x (0 at black, 1 at white) is `S x + O`.
    pub noise_profile: Vec<(f64, f64)>,
    /// Black levels of the cells of the colour filter pattern, row-major, DN; empty: the frame's
    /// own black level everywhere.
    pub black_levels_dn: Vec<f64>,
    /// Numbers of further fields of the main directory, by tag: white and exposure as
    /// other programs wrote them, kept as they were read.
    pub carried: BTreeMap<u16, Vec<f64>>,
    /// Linear value of each stored code, 16 bits, where codes are companded. Black levels are
    /// linear values then.
    pub linearization: Vec<u16>,
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
            pitch_um: None,
            color_matrices: Vec::new(),
            as_shot_neutral: None,
            noise_profile: Vec::new(),
            black_levels_dn: Vec::new(),
            carried: BTreeMap::new(),
            linearization: Vec::new(),
            opcode_list1: Vec::new(),
            opcode_list2: Vec::new(),
        }
    }
}

impl DngInfo {
    /// XYZ to camera R, G, B in daylight: the matrix for D65, otherwise the last one.
    #[must_use]
    pub fn daylight_matrix(&self) -> Option<[[f64; 3]; 3]> {
        let of_d65 = self.color_matrices.iter().find(|m| m.illuminant == ILLUMINANT_D65);
        of_d65.or(self.color_matrices.last()).map(|m| m.camera_from_xyz)
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

/// The frame as its linearization table makes it; as it is without one.
pub(super) fn linearized<'a>(frame: &'a RawFrame, info: &DngInfo) -> Cow<'a, RawFrame> {
    let table = &info.linearization;
    let Some(&end) = table.last() else { return Cow::Borrowed(frame) };
    let linear = |dn: u16| table.get(usize::from(dn)).copied().unwrap_or(end);
    Cow::Owned(RawFrame {
        bits: 16,
        black_level_dn: info.black_levels_dn.first().copied().unwrap_or(frame.black_level_dn),
        white_level_dn: linear(frame.white_level_dn),
        data: frame.data.iter().map(|&dn| linear(dn)).collect(),
        ..frame.clone()
    })
}
