//! `[sensor.gains]`: figures of the sensor by its gain, and what the sensor is at one gain.

use super::file::GainsFile;
use super::{Noise, SensorModel};
use camrig_base::{Error, Result};
use camrig_sensor_core::config::AtGain as Core;
use camrig_sensor_core::effects::gain_table::GainTable;

/// `[sensor.gains]` of a camera file, checked: values at some gains, between which they are
/// straight lines in logarithms ([`gain_table`](camrig_sensor_core::effects::gain_table)).
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Gains {
    /// The gains, rising; one that stands twice is a step.
    pub at: Vec<f64>,
    /// Read noise, e⁻.
    pub read_e: Option<Vec<f64>>,
    /// DN per electron.
    pub dn_per_e: Option<Vec<f64>>,
    /// DN of no signal.
    pub black_level_dn: Option<Vec<f64>>,
    /// Charge that the node holds, e⁻.
    pub well_e: Option<Vec<f64>>,
    /// Gain from which on the rest is digital.
    pub digital_above: Option<f64>,
}

/// What a sensor is at one gain.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct AtGain {
    /// What codes are multiplied by: 1 but for `digital_above`.
    pub digital_gain: f64,
    /// DN per electron, in codes as they leave the sensor.
    pub dn_per_e: f64,
    /// DN of no signal.
    pub black_level_dn: f64,
    /// Variance of the read noise, input-referred, e⁻².
    pub read_variance_e2: f64,
    /// Charge that a pixel can give, e⁻: full well, or what the node holds.
    pub full_well_e: f64,
}

impl AtGain {
    /// Variance of rounding in twelfths of DN²: of the converter, and of what a digital gain makes
    /// of its codes where that is no whole number.
    pub fn rounding(&self) -> f64 {
        let again = if self.digital_gain.fract() == 0.0 { 0.0 } else { 1.0 };
        self.digital_gain * self.digital_gain + again
    }
}

impl Gains {
    /// Checks the table of a sensor whose converter ends at `top` DN.
    pub(crate) fn new(file: GainsFile, top: f64) -> Result<Self> {
        let wrong = |what: String, help: &str| Err(Error::input(what).help(help));
        let GainsFile { at, read_e, dn_per_e, black_level_dn, well_e, digital_above } = file;
        if !(1..=Core::MAX_PLACES).contains(&at.len()) {
            let help = format!("give 1 to {} gains, rising", Core::MAX_PLACES);
            return wrong(format!("at has {} gains", at.len()), &help);
        }
        let rise = at.windows(2).all(|two| two[0] <= two[1])
            && at.windows(3).all(|three| three[0] < three[2]);
        if !rise || !at.iter().all(|g| (1e-2..=1e4).contains(g)) {
            return wrong(
                format!("at = {at:?}"),
                "gains rise, 0.01 to 10000; one that stands twice is a step",
            );
        }
        let most = camrig_sensor_core::arith::MAX_SIGNAL_E.into();
        for (key, values, range) in [
            ("read_e", &read_e, 0.0..=1e5),
            ("dn_per_e", &dn_per_e, 1e-6..=1e6),
            ("black_level_dn", &black_level_dn, 0.0..=top - 1.0),
            ("well_e", &well_e, 1.0..=most),
        ] {
            let Some(values) = values else { continue };
            if values.len() != at.len() || !values.iter().all(|v| range.contains(v)) {
                let (low, high) = (range.start(), range.end());
                return wrong(
                    format!("{key} = {values:?}"),
                    &format!(
                        "give one number of {low} to {high} for each of the {} gains",
                        at.len()
                    ),
                );
            }
        }
        Ok(Self { at, read_e, dn_per_e, black_level_dn, well_e, digital_above })
    }

    /// Its words in the sensor's table, after their number.
    pub(crate) fn words(&self) -> Vec<f32> {
        let of =
            |values: &Option<Vec<f64>>, i: usize| values.as_ref().map_or(-1.0, |v| v[i] as f32);
        let place = |(i, gain): (usize, &f64)| {
            let columns = [&self.read_e, &self.dn_per_e, &self.black_level_dn, &self.well_e];
            [*gain as f32].into_iter().chain(columns.map(|values| of(values, i)))
        };
        let words: Vec<f32> = self.at.iter().enumerate().flat_map(place).collect();
        [words.len() as f32].into_iter().chain(words).collect()
    }

    /// The stage of a sensor whose table begins with [`Self::words`].
    pub(crate) fn stage(&self) -> GainTable {
        let unlimited = GainTable::ENTRY.parameters[0].max;
        GainTable { digital_above: self.digital_above.map_or(unlimited, |g| g as f32), start: 0.0 }
    }
}

impl Noise {
    /// Variance of the read noise at an analog gain by the law of its two parts, input-referred,
    /// e⁻²; [`SensorModel::at_gain`] knows of a table.
    pub fn read_variance_e2(&self, analog_gain: f64) -> f64 {
        camrig_sensor_core::effects::read_noise::variance(
            self.read_e,
            self.read_e_post,
            analog_gain,
        )
    }
}

impl SensorModel {
    /// What the sensor is at a gain. DN per electron are G (2^bits − 1)/W (eq. 11 of Chen et al.
    /// 2009), with W the end of the converter's range, unless `[sensor.gains]` gives them.
    pub fn at_gain(&self, gain: f64) -> AtGain {
        let dn_per_e = |gain: f64| gain * f64::from((1u32 << self.bits) - 1) / self.full_scale_e;
        let Some(gains) = &self.gains else {
            return AtGain {
                digital_gain: 1.0,
                dn_per_e: dn_per_e(gain),
                black_level_dn: self.black_level_dn,
                read_variance_e2: self.noise.read_variance_e2(gain),
                full_well_e: self.full_well_e,
            };
        };
        let found = gains.stage().values_at(&gains.words(), gain as f32);
        let analog_gain = gains.digital_above.map_or(gain, |above| gain.min(above));
        let digital_gain = gain / analog_gain;
        let [read_e, own_dn_per_e, black_level_dn, well_e] = found.map(|v| v.map(f64::from));
        AtGain {
            digital_gain,
            dn_per_e: own_dn_per_e.unwrap_or(dn_per_e(analog_gain)) * digital_gain,
            black_level_dn: black_level_dn.unwrap_or(self.black_level_dn),
            read_variance_e2: read_e
                .map_or_else(|| self.noise.read_variance_e2(analog_gain), |r| r * r),
            full_well_e: well_e.map_or(self.full_well_e, |well| self.full_well_e.min(well)),
        }
    }

    /// DN per electron at a gain, in codes as they leave the sensor.
    pub fn dn_per_e(&self, gain: f64) -> f64 {
        self.at_gain(gain).dn_per_e
    }

    /// Electrons at which a pixel saturates at a gain: full well or the converter's end.
    pub fn saturation_e(&self, gain: f64) -> f64 {
        let (top, at) = (f64::from((1u32 << self.bits) - 1), self.at_gain(gain));
        at.full_well_e.min((top - at.black_level_dn) / at.dn_per_e)
    }
}

#[cfg(test)]
mod tests {
    use crate::{Camera, Folder};
    use camrig_base::Bands;

    const BASE: &str = include_str!("../presets/mt9t012.toml");

    fn camera(gains: &str) -> camrig_base::Result<Camera> {
        let text = format!("{BASE}\n[sensor.gains]\n{gains}");
        Camera::parse(&text, "test", &Folder::BuiltIn)
    }

    /// The table of a sensor with two conversion gains, the second from 3.333 on, and a digital gain
    /// above 6.667, as in DN per electron of 1023/8500: values by hand, and those that frames have.
    #[test]
    fn a_sensor_is_at_each_gain_what_its_table_says() {
        let camera = camera(
            "at = [1, 2, 3.333, 3.333, 6.667]\nread_e = [6.0, 4.17, 3.5, 2.2, 1.46]\n\
             black_level_dn = [42, 42, 42, 50, 60]\nwell_e = [9000, 9000, 9000, 2000, 2000]\n\
             digital_above = 6.667",
        )
        .unwrap();
        let sensor = &camera.sensor;
        let full_e = sensor.full_well_e;
        let k = 1023.0 / sensor.full_scale_e;
        for (gain, read_e, black, well_e, digital) in [
            (0.5, 6.0, 42.0, full_e, 1.0),
            (2.0, 4.17, 42.0, full_e, 1.0),
            (2f64.sqrt(), (6.0 * 4.17f64).sqrt(), 42.0, full_e, 1.0),
            (3.333, 2.2, 50.0, 2000.0, 1.0),
            ((3.333 * 6.667f64).sqrt(), (2.2 * 1.46f64).sqrt(), 3000f64.sqrt(), 2000.0, 1.0),
            (13.334, 1.46, 60.0, 2000.0, 2.0),
        ] {
            let at = sensor.at_gain(gain);
            let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-6, "{gain}: {a}, {b}");
            near(at.read_variance_e2, read_e * read_e);
            near(at.dn_per_e, k * gain);
            near(at.black_level_dn, black);
            near(at.full_well_e, well_e.min(full_e));
            near(at.digital_gain, digital);
            let config = camera.sensor_config(&Bands::VISIBLE).unwrap();
            near(f64::from(config.dn_per_e(gain as f32)), at.dn_per_e);
            near(f64::from(config.at_gain(gain as f32).black_level_dn), black);
            near(f64::from(config.at_gain(gain as f32).read_e.unwrap()), read_e);
        }
        // Rounding of the converter, in twelfths of DN²; of codes times 1.5 once more.
        assert_eq!(sensor.at_gain(5.0).rounding(), 1.0);
        assert_eq!(sensor.at_gain(13.334).rounding(), 4.0);
        assert!((sensor.at_gain(10.0005).rounding() - 3.25).abs() < 1e-9);
    }

    #[test]
    fn wrong_tables_are_named() {
        for (gains, expected) in [
            ("at = []", "1 to 16 gains"),
            ("at = [2, 1]", "gains rise"),
            ("at = [1, 1, 1]", "gains rise"),
            ("at = [1, 2]\nread_e = [3]", "each of the 2 gains"),
            ("at = [1, 2]\nread_e = [3, -1]", "read_e = [3.0, -1.0]"),
            ("at = [1]\nblack_level_dn = [1023]", "0 to 1022"),
            ("at = [1]\nreed_e = [1]", "read_e"),
        ] {
            let message = camera(gains).unwrap_err().to_string();
            let help = camera(gains).unwrap_err();
            let said = format!("{message} {}", help.remedy().unwrap_or_default());
            assert!(said.contains(expected), "{gains}: {said}");
        }
    }
}
