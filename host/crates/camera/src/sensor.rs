//! The sensor of a camera as checked values, and its conversion for `camrig-sensor-core`.

use super::filter_angles::Moved;
use super::{Camera, CrosstalkTable, KeptNoise, SensorTiming};
use camrig_base::{Bands, Cfa, Error, Result, Spectrum, weighted_means};
use camrig_light::photometry::HC;
use camrig_sensor_core::config::{FrameSettings, MAX_EFFECTS, Pattern, SensorConfig, Streams};
use camrig_sensor_core::effects::{Domain, Effect, Needs};
use camrig_sensor_core::effects::{
    dark_current::DarkCurrent, full_well::FullWell, prnu::Prnu, read_noise::ReadNoise,
    row_offset_fpn::RowOffsetFpn, shot_noise::ShotNoise,
};

/// `[sensor]` of a camera file, checked.
#[derive(Clone, Debug)]
pub struct SensorModel {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Pixel pitch, µm.
    pub pitch_um: f64,
    /// Photosensitive area over pitch².
    pub fill_factor: f64,
    /// Colour filter array.
    pub cfa: Cfa,
    /// Names of the channels (`r`, `g`, `b`; `r`, `gr`, `gb`, `b`; or the pattern's letters).
    pub channel_names: Vec<String>,
    /// Quantum efficiency with colour filter per channel, electrons per photon.
    pub qe: Vec<Spectrum>,
    /// Transmittance of the infrared cut filter, 0 to 1.
    pub ir_cut: Option<Spectrum>,
    /// The angles at which light passes it, where it is an interference filter.
    pub filter_angles: Option<super::FilterAngles>,
    /// Positional crosstalk.
    pub crosstalk: Option<CrosstalkTable>,
    /// Conversion gain, µV per electron, where it is known: it cancels in the DN.
    pub conversion_gain_uv_per_e: Option<f64>,
    /// Linear full well, e⁻: the charge that a pixel holds.
    pub full_well_e: f64,
    /// Charge at which the converter's range ends at unity gain, e⁻.
    pub full_scale_e: f64,
    /// Bits of the converter.
    pub bits: u8,
    /// Mean of no signal, DN.
    pub black_level_dn: f64,
    /// Analog gain unless a frame sets another.
    pub analog_gain: f64,
    /// Sensor temperature, °C.
    pub temperature_c: f64,
    /// Seed of this physical sensor, which fixes its fixed patterns.
    pub seed: u64,
    /// When its rows collect light, where that is known.
    pub timing: Option<SensorTiming>,
    /// Its captures, where it takes several of each pixel.
    pub hdr: Option<super::hdr::Hdr>,
    /// Which capture of a pixel it is, where another sensor takes several.
    pub streams: Streams,
    /// Noise and fixed patterns.
    pub noise: Noise,
    /// Its figures by gain, where they follow no law of the gain.
    pub gains: Option<super::Gains>,
    /// What of them pictures have ([`Camera::keep_noise`]).
    pub kept_noise: KeptNoise,
}

/// `[sensor.noise]` of a camera file, checked.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Noise {
    /// Read noise at unity gain, input-referred, standard deviation, e⁻.
    pub read_e: f64,
    /// The part of the read noise that comes after the gain stage, e⁻ at unity gain.
    pub read_e_post: f64,
    /// Mean dark current at the reference temperature, e⁻/s.
    pub dark_current_e_per_s: f64,
    /// Rise of temperature that doubles the dark current, K.
    pub dark_doubling_c: f64,
    /// Reference temperature, °C.
    pub temperature_ref_c: f64,
    /// Standard deviation over pixels of the dark current, e⁻/s.
    pub dsnu_e_per_s: f64,
    /// Standard deviation over pixels of the relative gain.
    pub prnu: f64,
    /// Standard deviation of the row-wise fixed pattern, e⁻.
    pub row_fpn_e: f64,
}

impl SensorModel {
    /// Electrons per second for an irradiance of 1 W m⁻² nm⁻¹ over a band, per channel and band, in
    /// light that is even within each band: [`Self::response_to`] no further light.
    pub fn response(&self, bands: &Bands) -> Vec<Vec<f64>> {
        self.response_to(&[], bands)
    }

    /// Electrons per second for a mean irradiance of 1 W m⁻² nm⁻¹ over a band, per channel and
    /// band, of light whose spectrum within a band is the product of the curves `light`:
    /// A Δλ/(hc) ∫ Φ(λ) QE(λ) S(λ) λ dλ / ∫ Φ(λ) dλ (eq. 8 and 9 of Chen et al. 2009), with A =
    /// pitch² x fill factor and the infrared cut filter S. The integrals are exact
    /// ([`weighted_means`]), so that the response to a line, or through a filter that is narrower
    /// than a band, is as exact as their tables. It is that of the centre, where it differs over
    /// the field ([`Self::factors_over_the_field`]).
    pub fn response_to(&self, light: &[Spectrum], bands: &Bands) -> Vec<Vec<f64>> {
        match self.moved_filter(light, bands) {
            Some(moved) => moved.centre(),
            None => self.response_behind(self.ir_cut.as_ref(), light, bands),
        }
    }

    fn moved_filter(&self, light: &[Spectrum], bands: &Bands) -> Option<Moved> {
        let (angles, filter) = (self.filter_angles.as_ref()?, self.ir_cut.as_ref()?);
        Some(angles.responses(self, filter, light, bands))
    }

    /// What multiplies the response to a light in bands from place to place: the crosstalk table, or
    /// the shift of an interference filter.
    pub fn factors_over_the_field(
        &self,
        light: &[Spectrum],
        bands: &Bands,
    ) -> Option<CrosstalkTable> {
        match self.moved_filter(light, bands) {
            Some(moved) => Some(moved.table(self, bands)),
            None => self.crosstalk.clone(),
        }
    }

    /// Whether the response differs from place to place by more than a factor.
    pub fn differs_over_the_field(&self) -> bool {
        self.crosstalk.is_some() || self.filter_angles.is_some()
    }

    /// The response behind a filter.
    pub(crate) fn response_behind(
        &self,
        filter: Option<&Spectrum>,
        light: &[Spectrum],
        bands: &Bands,
    ) -> Vec<Vec<f64>> {
        let area_m2 = self.pitch_um * self.pitch_um * 1e-12 * self.fill_factor;
        let (wavelength, light) = (Spectrum::wavelength(), light.iter().collect::<Vec<_>>());
        let of_channel = |qe: &Spectrum| {
            let curves: Vec<&Spectrum> = [qe, &wavelength].into_iter().chain(filter).collect();
            let means = weighted_means(&curves, &light, bands);
            means.into_iter().map(|mean| area_m2 * mean * 1e-9 / HC * bands.step_nm).collect()
        };
        self.qe.iter().map(of_channel).collect()
    }

    /// The channel of each pixel of the repeating pattern.
    pub fn pattern(&self) -> Pattern {
        let cfa = &self.cfa;
        let channel = |x: usize, y: usize| {
            let letter = cfa.letter(x, y).to_ascii_lowercase();
            // A green pixel in a row with red ones is gr, in a row with blue ones gb.
            let row_has_red = (0..cfa.width).any(|x| cfa.letter(x, y) == 'R');
            let apart = if row_has_red { "gr" } else { "gb" };
            let index = self.channel_names.iter().position(|n| {
                n.len() == 1 && n.starts_with(letter) || letter == 'g' && n == apart
            });
            index.unwrap_or(0) as u8
        };
        let tile = (0..cfa.height).flat_map(|y| (0..cfa.width).map(move |x| (x, y)));
        Pattern::new(cfa.width as u8, cfa.height as u8, tile.map(|(x, y)| channel(x, y)))
    }
}

impl Camera {
    /// The signal chain: the base model (eq. 10 of Chen et al. 2009) with the file's effects
    /// inserted by domain. What remembers earlier frames comes last of the effects on light: it
    /// remembers what the others made of it.
    pub fn chain(&self) -> Vec<Effect> {
        let noise = &self.sensor.noise;
        let of = |domain| self.effects.iter().filter(move |e| e.domain() == domain).copied();
        let mut chain: Vec<Effect> = of(Domain::Light).collect();
        chain.sort_by_key(|e| match e.entry().needs {
            Needs::EarlierFrames => 2,
            Needs::PreviousFrame => 1,
            _ => 0,
        });
        if self.sensor.kept_noise != KeptNoise::None {
            chain.push(ShotNoise {}.into());
        }
        chain.push(Prnu { sigma: noise.prnu as f32 }.into());
        chain.extend(of(Domain::Photo));
        chain.push(
            DarkCurrent {
                mean_e_per_s: noise.dark_current_e_per_s as f32,
                dsnu_e_per_s: noise.dsnu_e_per_s as f32,
                doubling_c: noise.dark_doubling_c as f32,
                reference_c: noise.temperature_ref_c as f32,
            }
            .into(),
        );
        chain.extend(of(Domain::Charge));
        chain.push(FullWell { full_well_e: self.sensor.full_well_e as f32, knee: 0.0 }.into());
        chain.extend(self.sensor.gains.iter().map(|gains| Effect::from(gains.stage())));
        chain.push(RowOffsetFpn::from_values(&[noise.row_fpn_e as f32]).into());
        chain.push(
            ReadNoise { read_e: noise.read_e as f32, read_e_post: noise.read_e_post as f32 }
                .into(),
        );
        chain.extend(of(Domain::Voltage));
        chain
    }

    /// The sensor for some bands, in the form that `camrig-sensor-core` takes, in light that is
    /// even within each band.
    ///
    /// # Errors
    /// More bands than a sensor takes, and what `SensorConfig::check` refuses.
    pub fn sensor_config(&self, bands: &Bands) -> Result<SensorConfig> {
        self.sensor_config_for(&[], bands)
    }

    /// The same in light whose spectrum within a band is the product of the curves `light`
    /// ([`SensorModel::response_to`]).
    ///
    /// # Errors
    /// Those of [`Self::sensor_config`].
    pub fn sensor_config_for(&self, light: &[Spectrum], bands: &Bands) -> Result<SensorConfig> {
        let sensor = &self.sensor;
        if bands.count > camrig_sensor_core::config::MAX_BANDS {
            return Err(Error::limit(format!("{} spectral bands", bands.count)).help(format!(
                "use at most {}; resample the scene",
                camrig_sensor_core::config::MAX_BANDS
            )));
        }
        self.check_chain()?;
        let mut config = SensorConfig::new(sensor.width, sensor.height);
        config.pattern = sensor.pattern();
        config.channels = sensor.channel_names.len() as u8;
        config.bands = bands.count as u8;
        config.first_band_nm = bands.start_nm as f32;
        config.band_step_nm = bands.step_nm as f32;
        config.response =
            sensor.response_to(light, bands).concat().iter().map(|&w| w as f32).collect();
        config.full_well_e = sensor.full_scale_e as f32;
        config.bits = sensor.bits;
        config.black_level_dn = sensor.black_level_dn as f32;
        config.seed = sensor.seed;
        config.streams = sensor.streams;
        config.effects = self.chain().into_iter().collect();
        config.table = self.table().into_iter().collect();
        config.check().map_err(|e| Error::input(format!("this sensor cannot be: {e}")))?;
        Ok(config)
    }

    /// Settings of a frame, exposure in seconds; gain as in the camera file unless given,
    /// temperature as in the camera file.
    pub fn settings(
        &self,
        frame: u32,
        exposure_s: f64,
        analog_gain: Option<f64>,
    ) -> FrameSettings {
        FrameSettings::new(exposure_s as f32)
            .with_frame(frame)
            .with_gain(analog_gain.unwrap_or(self.sensor.analog_gain) as f32)
            .with_temperature(self.sensor.temperature_c as f32)
    }

    /// Checks that the chain fits the sensor model; for cameras whose effects were changed after
    /// loading.
    ///
    /// # Errors
    /// More effects than a sensor takes; one whose places on a scale do not rise.
    pub fn check_chain(&self) -> Result<()> {
        let chain = self.chain();
        let windows = chain.iter().filter(|e| e.entry().needs == Needs::Neighbours).count();
        let most = camrig_sensor_core::config::MAX_WINDOWS;
        if chain.len() > MAX_EFFECTS || windows > most {
            return Err(Error::limit(format!("{} effects", self.effects.len())).help(format!(
                "use at most {} effects, of which {most} read neighbouring pixels",
                MAX_EFFECTS - (chain.len() - self.effects.len())
            )));
        }
        self.effects.iter().try_for_each(places_in_order)
    }
}

/// Refuses an effect of several places on a scale that do not rise: what lies between them would be
/// anyone's guess.
fn places_in_order(effect: &Effect) -> Result<()> {
    let places = match effect {
        Effect::Companding(e) => vec![("knee_1", e.knee_1), ("knee_2", e.knee_2)],
        Effect::Requantised(e) => vec![
            ("from_1_dn", e.from_1_dn),
            ("from_2_dn", e.from_2_dn),
            ("from_3_dn", e.from_3_dn),
            ("from_4_dn", e.from_4_dn),
        ],
        _ => return Ok(()),
    };
    match places.windows(2).find(|two| two[1].1 < two[0].1) {
        None => Ok(()),
        Some(two) => {
            let [(first, low), (second, high)] = [two[0], two[1]];
            Err(Error::input(format!("{second} = {high} is below {first} = {low}"))
                .at(format!("[[effect]] kind = {:?}", effect.entry().kind))
                .help("give them in rising order"))
        }
    }
}
