//! What a sensor is at a gain.

/// What a sensor is at one gain: [`SensorConfig::at_gain`](crate::config::SensorConfig::at_gain).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct AtGain {
    /// The analogue part of the gain.
    pub analog_gain: f32,
    /// What codes are multiplied by.
    pub digital_gain: f32,
    /// DN of the converter per input-referred electron.
    pub dn_per_e: f32,
    /// These over those at unity gain: the analogue gain itself, unless a gain table has others.
    pub relative_gain: f32,
    /// DN of no signal.
    pub black_level_dn: f32,
    /// Read noise, e⁻, where a gain table gives it.
    pub read_e: Option<f32>,
    /// Charge that the node holds, e⁻, where a gain table gives it.
    pub well_e: Option<f32>,
}

impl AtGain {
    /// Most places of a gain table.
    pub const MAX_PLACES: usize = 16;
    /// Numbers of a place.
    pub const PLACE: usize = 5;

    /// The code after the digital gain, halves up as hardware rounds them: rounded to even, their
    /// errors would follow the signal over twice as many codes, which photon transfer would see.
    pub(crate) fn multiplied(&self, dn: u16, max_dn: u16) -> u16 {
        let black = self.black_level_dn;
        let dn = (f32::from(dn) - black) * self.digital_gain + black;
        (dn.clamp(0.0, f32::from(max_dn)) + 0.5) as u16
    }
}
