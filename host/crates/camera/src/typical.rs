//! Rules of thumb for what is not known of a camera, each with its reason.
//!
//! They replace values that a data sheet does not give. A file that is made with them marks each
//! as `typical`.

use super::Value;

/// A value and why it is that.
pub type Rule = (Value, &'static str);

/// What rules depend on.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// Pixels in a row and rows.
    pub size: (f64, f64),
    /// Pixel pitch, µm.
    pub pitch_um: f64,
    /// Bits of the converter.
    pub bits: u32,
    /// Whether there are no colour filters.
    pub mono: bool,
    /// Largest quantum efficiency, where it is known.
    pub qe_peak: Option<f64>,
    /// Read noise, e⁻, where it is known.
    pub read_e: Option<f64>,
    /// Dark current and its temperature, e⁻/s and °C, where it is known.
    pub dark: Option<(f64, f64)>,
}

/// Pitch below which a camera is one of a phone, µm.
const PHONE_PITCH_UM: f64 = 2.0;
/// Full well of a pixel of 1 µm, e⁻, and its power of the pitch: 4000 e⁻ (pitch/µm)^(5/4) goes
/// through the sensors of `sensors.csv` within a factor of 3.
const FULL_WELL_E: f64 = 4000.0;
/// Peak of the quantum efficiency: the middle of the sensors of `sensors.csv` without filters.
const QE_PEAK: f64 = 0.65;
/// Peak behind a green filter over that without (IMX264: 0.57 of 0.64, IMX287: 0.58 of 0.64).
pub const GREEN_OVER_MONO: f64 = 0.9;
/// Peak from which on a pixel is taken for a back-illuminated one: those lit from the front stay
/// below (IMX174: 0.77).
const BACK_ILLUMINATED: f64 = 0.8;
/// Read noise at unity gain, e⁻: the middle of the sensors of `sensors.csv`.
const READ_E: f64 = 3.0;
/// Dark current of a square micrometre at 25 °C, e⁻/s: between the CMV4000 (4.1) and the IMX900
/// and GSENSE400BSI (0.1 to 0.2).
const DARK_E_PER_S_UM2: f64 = 0.5;

/// The value of a key of a camera file by its path, `None` where it is left out or must be given.
#[must_use]
pub fn rule(path: &str, known: &Known) -> Option<Rule> {
    lens(path, known).or_else(|| sensor(path, known)).or_else(|| noise(path, known))
}

fn lens(path: &str, known: &Known) -> Option<Rule> {
    let (w, h) = known.size;
    let phone = known.pitch_um < PHONE_PITCH_UM;
    Some(match path {
        "lens.kind" => ("diffraction-limited".into(), "no lens is known"),
        "lens.f_number" if phone => (2.0.into(), "phones have f/1.6 to f/2.4"),
        "lens.f_number" => (2.8.into(), "lenses of machine vision have f/1.4 to f/8"),
        "lens.focal_length_mm" => {
            let diagonal_mm = (w * w + h * h).sqrt() * known.pitch_um * 1e-3;
            (rounded(diagonal_mm, 2).into(), "the sensor's diagonal: a normal lens, 53° across it")
        }
        "lens.transmittance" => (0.92.into(), "a few coated elements"),
        "lens.relative_illumination" => ("cos4".into(), "no fall-off is known"),
        _ => return None,
    })
}

fn sensor(path: &str, known: &Known) -> Option<Rule> {
    Some(match path {
        "sensor.fill_factor" => {
            (1.0.into(), "quantum efficiency counts the light on the whole pixel, as EMVA 1288")
        }
        "sensor.qe" if !known.mono => {
            ("mobile-qe.csv".into(), "colour filters of the AR0132AT, scaled to the peak")
        }
        "sensor.qe" if known.qe_peak.is_some_and(|peak| peak >= BACK_ILLUMINATED) => {
            ("imx455-qe.csv".into(), "the back-illuminated IMX455, scaled to the peak")
        }
        "sensor.qe" => ("imx426-qe.csv".into(), "the IMX426, scaled to the peak"),
        "sensor.qe_peak" if known.mono => (QE_PEAK.into(), "the middle of the built-in sensors"),
        "sensor.qe_peak" => (
            rounded(GREEN_OVER_MONO * QE_PEAK, 2).into(),
            "the middle of the built-in sensors, behind colour filters",
        ),
        "sensor.ir_cut" if !known.mono => {
            ("ir-cut-690.csv".into(), "colour cameras have an infrared cut filter")
        }
        "sensor.full_well_e" => {
            let root = known.pitch_um.sqrt().sqrt();
            let well = FULL_WELL_E * known.pitch_um * root;
            (rounded(well, 2).into(), "4000 e- x (pitch/µm)^1.25, as the built-in sensors")
        }
        "sensor.black_level_dn" => {
            (libm::exp2(f64::from(known.bits) - 6.0).into(), "1/64 of the range")
        }
        "sensor.analog_gain" => (1.0.into(), "unity"),
        "sensor.temperature_c" => match known.dark {
            Some((_, at)) => (at.into(), "that for which the dark current is known"),
            None => (25.0.into(), "a camera in a room"),
        },
        "sensor.seed" => (1.into(), "any number: another one is another piece of this sensor"),
        _ => return None,
    })
}

fn noise(path: &str, known: &Known) -> Option<Rule> {
    let read_e = known.read_e.unwrap_or(READ_E);
    let area_um2 = known.pitch_um * known.pitch_um;
    let dark = known.dark.map_or(rounded(DARK_E_PER_S_UM2 * area_um2, 2), |(dark, _)| dark);
    Some(match path {
        "sensor.noise.read_e" => (READ_E.into(), "the middle of the built-in sensors"),
        "sensor.noise.read_e_post" => {
            (rounded(read_e / 2f64.sqrt(), 2).into(), "half of the variance of read_e")
        }
        "sensor.noise.dark_current_e_per_s" => (dark.into(), "0.5 e-/s per µm² at 25 °C"),
        "sensor.noise.dark_doubling_c" => (7.0.into(), "silicon: 6 to 8 K"),
        "sensor.noise.temperature_ref_c" => (25.0.into(), "that of the rule for the dark current"),
        "sensor.noise.dsnu_e_per_s" => (rounded(dark / 2.0, 2).into(), "half of the dark current"),
        "sensor.noise.prnu" => (0.01.into(), "1 %: data sheets give 0.5 to 1 %"),
        "sensor.noise.row_fpn_e" => {
            (rounded(read_e / 10.0, 2).into(), "a tenth of read_e: rows are not seen beside it")
        }
        _ => return None,
    })
}

/// A number with so many significant digits.
#[must_use]
pub fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits.saturating_sub(1)).parse().unwrap_or(value)
}
