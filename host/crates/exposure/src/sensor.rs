//! The sensor stage on the workstation: frames from an irradiance cube, in parallel over rows.

use super::rows::{BandSums, Vector, refused, rows};
use super::{Chunk, CubeHeader, IrradianceCube};
use camrig_base::{Error, Plane, RawFrame, Result};
use camrig_camera::{Camera, CrosstalkTable};
use camrig_sensor_core::arith::{Arith, BLOCK, Block, Fixed, Float, blocks};
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::effects::{Effect, Needs};
use camrig_sensor_core::pipeline::MeanRows;
use rayon::prelude::*;
use std::ops::Range;

/// Arithmetic of the sensor stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Arithmetic {
    /// 32-bit floating point.
    #[default]
    F32,
    /// 32-bit fixed point, as on parts without a floating-point unit.
    Fixed,
}

camrig_base::choices!(Arithmetic, "arithmetic": F32 = "f32", Fixed = "fixed");

/// Most DN per electron, all gains together, in fixed point. Its stages round by 2⁻¹³ e⁻, here 0.01
/// DN each; up to there it agrees with floating point to one DN, or to one electron where charge is
/// counted (`sensor-core/tests/both_arithmetics.rs`).
pub const MAX_FIXED_DN_PER_E: f64 = 64.0;

impl Arithmetic {
    /// Refuses a sensor that this arithmetic does not compute to one DN.
    ///
    /// # Errors
    /// Fixed point and more than `MAX_FIXED_DN_PER_E` (64).
    pub fn check(self, config: &SensorConfig, settings: &FrameSettings) -> Result<()> {
        let gain = |effect: &Effect| match effect {
            Effect::SystemGain(e) => f64::from(e.ratio),
            Effect::GainBySite(e) => {
                f64::from([e.plane_1, e.plane_2, e.plane_3].into_iter().fold(e.plane_0, f32::max))
            }
            _ => 1.0,
        };
        let gains: f64 = config.effects.iter().map(gain).product();
        let dn_per_e = f64::from(config.dn_per_e(settings.analog_gain)) * gains;
        if self == Self::F32 || dn_per_e <= MAX_FIXED_DN_PER_E {
            return Ok(());
        }
        Err(Error::limit(format!("{dn_per_e:.1} DN per electron in fixed point"))
            .at(format!("analog_gain = {}", settings.analog_gain))
            .help(format!(
                "it is right to one DN up to {MAX_FIXED_DN_PER_E}: use floating point, less gain, \
                 fewer bits or a larger full well"
            )))
    }
}

/// What the traps of a sensor (effect `persistence`) hold between its frames, e⁻: four bytes for
/// each pixel and effect. Empty at first.
#[derive(Clone, Debug, Default)]
pub struct Traps {
    /// Row by row, in each one effect after the other.
    held_e: Vec<f32>,
}

/// How a frame is computed, where that is not the usual way.
#[derive(Default)]
pub struct FrameOptions<'a> {
    /// What the sensor saw in the frame before, for effects with a memory; darkness without it. How
    /// long it saw that, the settings say.
    pub before: Option<&'a IrradianceCube>,
    /// What the frames before left in the traps of a sensor that has some, and then what this one
    /// leaves; empty traps without it.
    pub traps: Option<&'a mut Traps>,
    /// Arithmetic of the sensor stage.
    pub arithmetic: Arithmetic,
}

/// Rows computed by one task.
pub(super) const ROWS_PER_TASK: usize = 32;

/// A camera's sensor set up for cubes of given bands.
pub struct SimulatedSensor {
    /// The sensor as `sensor-core` takes it.
    pub config: SensorConfig,
    /// Charge that a pixel holds, e⁻.
    full_well_e: f32,
    crosstalk: Option<CrosstalkTable>,
    cfa: camrig_base::Cfa,
}

impl SimulatedSensor {
    /// The sensor of `camera` in front of a cube with this header.
    ///
    /// # Errors
    /// A camera with `[sensor.hdr]`, which is an [`HdrSensor`](super::hdr::HdrSensor); a cube of
    /// another size than the sensor's; values that `sensor-core` refuses.
    pub fn new(camera: &Camera, header: &CubeHeader) -> Result<Self> {
        Self::in_light(camera, header, 1.0)
    }

    /// The same in another light level than the cube was made for: `light` multiplies the
    /// irradiance.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn in_light(camera: &Camera, header: &CubeHeader, light: f64) -> Result<Self> {
        let sensor = &camera.sensor;
        if let Some(hdr) = &sensor.hdr {
            return Err(hdr
                .where_one_is_read()
                .help(format!("choose one with --capture: {}", hdr.names())));
        }
        if (header.width, header.height) != (sensor.width as usize, sensor.height as usize) {
            return Err(Error::disagreement(format!(
                "irradiance of {} x {} pixels for a sensor of {} x {}",
                header.width, header.height, sensor.width, sensor.height
            ))
            .help("use the camera for which the irradiance was made, or simulate it anew"));
        }
        if let Some(angles) = &sensor.filter_angles {
            angles.check_traced(sensor)?;
        }
        let mut config = camera.sensor_config_for(&header.light, &header.spectral_bands())?;
        let light = light * header.level;
        let electrons = header.holds_electrons();
        for response in &mut config.response {
            // Electrons per second are what the response would make of the bands.
            let own = if electrons { 1.0 } else { f64::from(*response) };
            *response = (own * light) as f32;
        }
        config.check().map_err(refused)?;
        Ok(Self {
            config,
            full_well_e: sensor.full_well_e as f32,
            crosstalk: sensor.factors_over_the_field(&header.light, &header.spectral_bands()),
            cfa: sensor.cfa.clone(),
        })
    }

    /// One frame of `cube`, in floating point and dark before.
    ///
    /// # Errors
    /// Settings out of range; irradiance that cannot be read.
    pub fn frame(&self, cube: &IrradianceCube, settings: &FrameSettings) -> Result<RawFrame> {
        self.frame_with(cube, settings, FrameOptions::default())
    }

    /// One frame of `cube`, with options.
    ///
    /// # Errors
    /// Those of [`Self::frame`]; a frame after another one, by a sensor with traps whose charge is
    /// not given.
    pub fn frame_with(
        &self,
        cube: &IrradianceCube,
        settings: &FrameSettings,
        options: FrameOptions<'_>,
    ) -> Result<RawFrame> {
        let FrameOptions { before, traps, arithmetic } = options;
        let held = traps.as_ref().map_or(&[][..], |traps| &traps.held_e);
        let inputs = Inputs { sensor: self, cube, before, held, settings: *settings };
        inputs.check(arithmetic)?;
        let (width, height) = (self.config.width as usize, self.config.height as usize);
        let mut data = vec![0; width * height];
        let with_traps = self.effects_with_traps();
        if with_traps > 0 && before.is_some() && traps.is_none() {
            return Err(Error::unsupported(
                "persistence where frames are computed without those before",
            )
            .help("use simulate, expose or capture, or remove the effect from the camera file"));
        }
        let mut kept = vec![0.0; width * height * with_traps];
        let of_task = width * ROWS_PER_TASK;
        let mut kept_by_task: Vec<&mut [f32]> =
            kept.chunks_mut((of_task * with_traps).max(1)).collect();
        kept_by_task.resize_with(height.div_ceil(ROWS_PER_TASK), Default::default);
        let tasks = data.par_chunks_mut(of_task).zip(kept_by_task).enumerate();
        tasks.try_for_each(|(i, (out, kept))| {
            inputs.rows(arithmetic, i * ROWS_PER_TASK, out, kept)
        })?;
        if let Some(traps) = traps {
            traps.held_e = kept;
        }
        Ok(self.raw_frame(data, settings.analog_gain))
    }

    /// One frame of known mean photo-electrons, row by row, whatever its optics, response and light
    /// are; dark before.
    ///
    /// # Errors
    /// Means of another number than the sensor has pixels, negative or not finite; settings out of
    /// range, or beyond the arithmetic ([`Arithmetic::check`]).
    pub fn frame_of_electrons(
        &self,
        electrons: &[f32],
        settings: &FrameSettings,
        arithmetic: Arithmetic,
    ) -> Result<RawFrame> {
        arithmetic.check(&self.config, settings)?;
        let (width, height) = (self.config.width as usize, self.config.height as usize);
        if electrons.len() != width * height {
            let given = electrons.len();
            return Err(Error::disagreement(format!(
                "{given} means of {width} x {height} pixels"
            ))
            .help("give one for each pixel"));
        }
        if let Some(wrong) = electrons.iter().find(|e| !(**e >= 0.0 && e.is_finite())) {
            return Err(
                Error::input(format!("a mean of {wrong} electrons")).help("means are 0 or more")
            );
        }
        let mut data = vec![0; width * height];
        let tasks = data.par_chunks_mut(width * ROWS_PER_TASK).enumerate();
        tasks.try_for_each(|(i, out)| {
            let first = i * ROWS_PER_TASK;
            match arithmetic {
                Arithmetic::F32 => {
                    electron_rows::<Float>(&self.config, electrons, settings, first, out)
                }
                Arithmetic::Fixed => {
                    electron_rows::<Fixed>(&self.config, electrons, settings, first, out)
                }
            }
        })?;
        Ok(self.raw_frame(data, settings.analog_gain))
    }

    /// Number of its effects that hold charge from frame to frame.
    pub fn effects_with_traps(&self) -> usize {
        self.config.effects.iter().filter(|e| e.entry().needs == Needs::EarlierFrames).count()
    }

    /// Mean photo-electrons of every pixel, before any effect.
    ///
    /// # Errors
    /// Irradiance that cannot be read.
    pub fn electrons(
        &self,
        cube: &IrradianceCube,
        settings: &FrameSettings,
    ) -> Result<Plane<f32>> {
        let (width, height) = (self.config.width as usize, self.config.height as usize);
        let mut data = vec![0.0; width * height];
        let inputs = Inputs { sensor: self, cube, before: None, held: &[], settings: *settings };
        data.par_chunks_mut(width * ROWS_PER_TASK)
            .enumerate()
            .try_for_each(|(i, out)| electrons(&inputs, i * ROWS_PER_TASK, out))?;
        Ok(Plane { width, height, data })
    }

    /// A frame of this sensor from its DN, however they were computed.
    pub fn raw_frame(&self, data: Vec<u16>, analog_gain: f32) -> RawFrame {
        RawFrame {
            width: self.config.width as usize,
            height: self.config.height as usize,
            bits: u32::from(self.config.bits),
            cfa: self.cfa.clone(),
            black_level_dn: as_stated(self.config.at_gain(analog_gain).black_level_dn),
            white_level_dn: self.white_level_dn(analog_gain),
            data,
        }
    }

    /// Its colour filter array.
    pub fn cfa(&self) -> &camrig_base::Cfa {
        &self.cfa
    }

    /// The crosstalk table as `sensor-core` takes it.
    pub fn crosstalk(&self) -> Option<camrig_sensor_core::crosstalk::Crosstalk<'_>> {
        self.crosstalk.as_ref().map(CrosstalkTable::as_core)
    }

    /// DN at which a pixel saturates: full well or the converter's end, whichever comes first.
    fn white_level_dn(&self, analog_gain: f32) -> u16 {
        let at = self.config.at_gain(analog_gain);
        let full_well_e = at.well_e.map_or(self.full_well_e, |well| self.full_well_e.min(well));
        let full = at.dn_per_e * at.digital_gain * full_well_e;
        (full + at.black_level_dn).min(f32::from(self.config.max_dn())) as u16
    }
}

/// What a frame of a sensor is made of.
pub(super) struct Inputs<'a> {
    pub(super) sensor: &'a SimulatedSensor,
    pub(super) cube: &'a IrradianceCube,
    pub(super) before: Option<&'a IrradianceCube>,
    /// [`Traps::held_e`], or none.
    pub(super) held: &'a [f32],
    pub(super) settings: FrameSettings,
}

impl Inputs<'_> {
    /// Refuses settings out of range or beyond the arithmetic.
    pub(super) fn check(&self, arithmetic: Arithmetic) -> Result<()> {
        self.settings.check().map_err(refused)?;
        arithmetic.check(&self.sensor.config, &self.settings)
    }

    /// Computes the rows from `first` on that fill `out`; `kept` gets the charge of their traps.
    pub(super) fn rows(
        &self,
        arithmetic: Arithmetic,
        first: usize,
        out: &mut [u16],
        kept: &mut [f32],
    ) -> Result<()> {
        match arithmetic {
            Arithmetic::F32 => cube_rows::<Float>(self, first, out, kept),
            Arithmetic::Fixed => cube_rows::<Fixed>(self, first, out, kept),
        }
    }
}

/// [`Inputs::rows`] in one arithmetic.
fn cube_rows<A: Vector>(
    inputs: &Inputs<'_>,
    first: usize,
    out: &mut [u16],
    kept: &mut [f32],
) -> Result<()> {
    let config = &inputs.sensor.config;
    let (width, height) = (config.width as usize, config.height as usize);
    let windows = config.effects.iter().filter(|e| e.entry().needs == Needs::Neighbours).count();
    let count = out.len() / width;
    let from = first.saturating_sub(windows);
    let to = (first + count + windows).min(height);
    let crosstalk = inputs.sensor.crosstalk();
    let mut source = CubeRows::<A> {
        sums: BandSums::new(config, &inputs.settings, crosstalk)?,
        now: load(inputs.cube, from, to)?,
        before: inputs.before.map(|cube| load(cube, from, to)).transpose()?,
        traps: TrapRows {
            width,
            effects: inputs.sensor.effects_with_traps(),
            held: inputs.held,
            first,
            kept,
        },
    };
    rows::<A>(config, &inputs.settings, &mut source, first, out)
}

/// Computes the rows from `first` on that fill `out` from mean photo-electrons.
fn electron_rows<A: Vector>(
    config: &SensorConfig,
    electrons: &[f32],
    settings: &FrameSettings,
    first: usize,
    out: &mut [u16],
) -> Result<()> {
    let width = config.width as usize;
    let mut source = |row: u32, out: &mut [Block<A::Signal>]| {
        let means = electrons[row as usize * width..].iter();
        let pixels = out.as_flattened_mut().iter_mut().take(width);
        pixels.zip(means).for_each(|(pixel, &mean)| *pixel = A::Light::signal(mean));
    };
    rows::<A>(config, settings, &mut source, first, out)
}

/// Mean photo-electrons of the rows from `first` on.
fn electrons(inputs: &Inputs<'_>, first: usize, out: &mut [f32]) -> Result<()> {
    let config = &inputs.sensor.config;
    let width = config.width as usize;
    let rows = out.len() / width;
    let crosstalk = inputs.sensor.crosstalk();
    let mut sums = BandSums::<Float>::new(config, &inputs.settings, crosstalk)?;
    let bands = load(inputs.cube, first, first + rows)?;
    let mut row = vec![[0.0; BLOCK]; blocks(width)];
    for (y, out) in (first..).zip(out.chunks_mut(width)) {
        Float::COLLECT(&mut sums, &bands, y as u32, &mut row);
        out.copy_from_slice(&row.as_flattened()[..width]);
    }
    Ok(())
}

/// Rows of every band.
fn load(cube: &IrradianceCube, from: usize, to: usize) -> Result<Vec<Chunk<'_>>> {
    (0..cube.header.bands).map(|band| cube.chunk(band, from, to - from)).collect()
}

/// Mean photo-electrons from the rows of a cube.
struct CubeRows<'a, A: Arith> {
    sums: BandSums<'a, A>,
    now: Vec<Chunk<'a>>,
    before: Option<Vec<Chunk<'a>>>,
    traps: TrapRows<'a>,
}

/// Traps of the rows of a task: those of the frame before, of all rows, and those of its own rows
/// after the frame.
struct TrapRows<'a> {
    width: usize,
    effects: usize,
    held: &'a [f32],
    first: usize,
    kept: &'a mut [f32],
}

impl TrapRows<'_> {
    /// Place of an effect's row, so many rows from the beginning.
    fn place(&self, effect: usize, rows: usize) -> Range<usize> {
        let from = (rows * self.effects + effect) * self.width;
        from..from + self.width
    }
}

impl<A: Vector> MeanRows<A> for CubeRows<'_, A> {
    fn mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        A::COLLECT(&mut self.sums, &self.now, row, out);
    }

    fn previous_mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        match &self.before {
            Some(bands) => A::COLLECT(&mut self.sums, bands, row, out),
            None => out.fill([A::Signal::default(); BLOCK]),
        }
    }

    fn traps(&mut self, effect: usize, row: u32, out: &mut [Block<A::Signal>]) {
        out.fill([A::Signal::default(); BLOCK]);
        let held = self.traps.held.get(self.traps.place(effect, row as usize)).unwrap_or(&[]);
        for (out, &held) in out.as_flattened_mut().iter_mut().zip(held) {
            *out = A::Light::signal(held);
        }
    }

    fn keep_traps(&mut self, effect: usize, row: u32, held: &[Block<A::Signal>]) {
        // Rows above and below its own belong to other tasks.
        let Some(rows) = (row as usize).checked_sub(self.traps.first) else { return };
        let place = self.traps.place(effect, rows);
        let kept = self.traps.kept.get_mut(place).unwrap_or(&mut []);
        for (kept, &held) in kept.iter_mut().zip(held.as_flattened()) {
            *kept = A::Light::electrons(held);
        }
    }
}

/// A value of single precision as it was stated, with no more digits than it has: files keep it
/// exactly, so that what is measured of a frame does not depend on whether it was one.
fn as_stated(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::{Bands, Outside, Spectrum};
    use camrig_camera::Directions;
    use camrig_sensor_core::effects::{Effect, optical_crosstalk, persistence::Persistence};

    /// 16 DN per electron at gain 1: fixed point ends at gain 4, or less by the gains of effects.
    #[test]
    fn fixed_point_ends_at_64_dn_per_electron_with_all_gains() {
        use camrig_sensor_core::effects::{gain_by_site::GainBySite, system_gain::SystemGain};
        let camera = Camera::load("mt9t012").unwrap().with_size(16, 2).unwrap();
        let bands = Bands { start_nm: 400.0, step_nm: 10.0, count: 30 };
        let header = CubeHeader::new((16, 2), &bands, "darkness");
        let dark = IrradianceCube::uniform(header.clone(), &[0.0; 30]).unwrap();
        let mut sensor = SimulatedSensor::new(&camera, &header).unwrap();
        sensor.config.bits = 12;
        sensor.config.full_well_e = 4095.0 / 16.0;
        let double = GainBySite { plane_0: 0.5, plane_1: 1.0, plane_2: 2.0, plane_3: 1.0 };
        let chains: [(&[Effect], f32); 3] = [
            (&[], 1.0),
            (&[SystemGain { ratio: 0.5 }.into()], 0.5),
            (&[SystemGain { ratio: 2.0 }.into(), double.into()], 4.0),
        ];
        for (effects, gains) in chains {
            sensor.config.effects = effects.iter().copied().collect();
            let taken = |arithmetic, gain: f32| {
                let settings = camera.settings(0, 1e-3, Some(gain.into()));
                let options = FrameOptions { arithmetic, ..FrameOptions::default() };
                let of_light = sensor.frame_with(&dark, &settings, options);
                let of_electrons = sensor.frame_of_electrons(&[0.0; 32], &settings, arithmetic);
                [of_light, of_electrons]
            };
            let last = 4.0 / gains;
            for frame in
                taken(Arithmetic::Fixed, last).into_iter().chain(taken(Arithmetic::F32, 16.0))
            {
                frame.unwrap();
            }
            for frame in taken(Arithmetic::Fixed, last * 1.125) {
                let error = frame.unwrap_err();
                assert_eq!(error.kind(), camrig_base::ErrorKind::Limit);
                assert_eq!(error.what(), "72.0 DN per electron in fixed point");
                assert_eq!(error.place(), Some(&*format!("analog_gain = {}", last * 1.125)));
                assert!(
                    error.remedy().unwrap().contains("up to 64: use floating point, less gain")
                );
            }
        }
    }

    /// Light behind which rows share by crosstalk, then darkness, over the rows of several tasks:
    /// the frames show what traps of two time constants release, in both arithmetics. A frame after
    /// another is refused without their charge.
    #[test]
    fn traps_release_their_charge_over_the_frames_that_follow() {
        let camera = Camera::load("mt9t012").unwrap().with_size(50, 70).unwrap();
        let bands = Bands { start_nm: 400.0, step_nm: 10.0, count: 30 };
        let header = CubeHeader::new((50, 70), &bands, "even light");
        let [lit, dark] = [2e-3, 0.0].map(|level| {
            IrradianceCube::uniform(header.clone(), &vec![level; bands.count]).unwrap()
        });
        let mut sensor = SimulatedSensor::new(&camera, &header).unwrap();
        let kinds = [(0.2f32, 1.0f32), (0.1, 5.0)];
        let spread =
            optical_crosstalk::OpticalCrosstalk { side: 0.0, vertical: 0.1, diagonal: 0.0 };
        let traps = kinds.map(|(fraction, time_constant_frames)| {
            Effect::from(Persistence { fraction, time_constant_frames })
        });
        sensor.config.effects = [spread.into()].into_iter().chain(traps).collect();
        sensor.config.bits = 16;
        let settings = camera.settings(0, 1e-3, Some(1.0));
        let light = sensor.electrons(&lit, &settings).unwrap();
        let mean = |row: usize| light.data[row * 50..][..50].iter().sum::<f32>() / 50.0;
        // Rows of one colour order alike; the crosstalk of rows is that of even light.
        let gain = f64::from(sensor.config.dn_per_e(1.0));
        for arithmetic in Arithmetic::ALL {
            let (mut traps, mut before) = (Traps::default(), None);
            // Of one electron in the first frame: what the traps hold.
            let mut held = [0.0; 2];
            for k in 0..6 {
                let cube = if k == 0 { &lit } else { &dark };
                let options = FrameOptions { before, traps: Some(&mut traps), arithmetic };
                let frame = sensor.frame_with(cube, &settings.with_frame(k), options).unwrap();
                before = Some(cube);
                let mut share = if k == 0 { 1.0 } else { 0.0 };
                for (held, (fraction, tau)) in held.iter_mut().zip(kinds) {
                    let kept = *held * (-1.0 / f64::from(tau)).exp();
                    let caught = f64::from(fraction) * share;
                    share += *held - kept - caught;
                    *held = kept + caught;
                }
                for (row, dn) in frame.data.chunks(50).enumerate() {
                    let right = share * f64::from(0.8 * mean(row) + 0.2 * mean(row ^ 1));
                    let got = dn.iter().map(|&dn| f64::from(dn)).sum::<f64>() / 50.0;
                    let got = (got - f64::from(sensor.config.black_level_dn)) / gain;
                    assert!((got - right).abs() < 0.51 / gain, "{k}, row {row}: {got}, {right}");
                }
            }
        }
        let alone = FrameOptions { before: Some(&lit), ..FrameOptions::default() };
        let refused = sensor.frame_with(&dark, &settings, alone).unwrap_err();
        assert!(refused.to_string().contains("persistence"), "{refused}");
    }

    /// Mean electrons given row by row, in both arithmetics: frames are those of a cube of the same
    /// electrons, up to its rounding to 16 bits; means of another number, negative or NaN are refused.
    #[test]
    fn frames_of_electrons_are_those_of_their_cube() {
        let (width, height) = (50, 70);
        let camera = Camera::load("mt9t012").unwrap().with_size(50, 70).unwrap();
        let bands = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };
        let mut header = CubeHeader::new((width, height), &bands, "electrons");
        header.made_for.insert(CubeHeader::RESPONSE.into(), "electrons".into());
        header.level = 100.0;
        let settings = camera.settings(3, 0.01, Some(1.0));
        let sensor = SimulatedSensor::new(&camera, &header).unwrap();
        // Whole numbers to 2^15, which 16 bits hold exactly.
        let means = Plane::from_fn(width, height, |x, y| ((x * 70 + y) * 3) as f32);
        let mut cube = crate::IrradianceWriter::new(header).unwrap();
        cube.push(&means).unwrap();
        let cube = cube.finish().unwrap();
        for arithmetic in Arithmetic::ALL {
            let options = FrameOptions { arithmetic, ..FrameOptions::default() };
            let of_cube = sensor.frame_with(&cube, &settings, options).unwrap();
            let own = sensor.frame_of_electrons(&means.data, &settings, arithmetic).unwrap();
            let off = std::iter::zip(&own.data, &of_cube.data).filter(|(a, b)| a != b).count();
            assert!(off * 100 < width * height, "{arithmetic}: {off} pixels");
        }
        for wrong in [-1.0, f32::NAN, f32::INFINITY] {
            let means = vec![wrong; width * height];
            assert!(sensor.frame_of_electrons(&means, &settings, Arithmetic::F32).is_err());
        }
        assert!(sensor.frame_of_electrons(&[1.0], &settings, Arithmetic::F32).is_err());
    }

    /// Cameras behind filters whose edges move over the field by any effective index, f-number and
    /// pitch: both arithmetics within one DN, from darkness to 100 full wells.
    #[test]
    fn arithmetics_agree_behind_filters_that_move() {
        let mut state = 7u64;
        let mut next = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for draw in 0..20 {
            let index = ("sensor.ir_cut_effective_index", 1.0 + 0.01 + 2.0 * next());
            let mut camera =
                Camera::load_with("mt9t012", [index]).unwrap().with_size(40, 34).unwrap();
            let sensor = &mut camera.sensor;
            sensor.pitch_um = 150.0 * next() + 1.0;
            let [low, high] = [410.0 + 100.0 * next(), 560.0 + 120.0 * next()];
            let width = 0.1 + 20.0 * next();
            let edges = vec![low - width, low, high, high + width];
            let pass = Spectrum::new(edges, vec![0.0, 1.0, 1.0, 0.0]).unwrap();
            sensor.ir_cut = Some(pass.outside(Outside::Zero));
            camera.keep_noise(camrig_camera::KeptNoise::None);
            let bands = Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };
            let header = CubeHeader::new((40, 34), &bands, "even light");
            let response: f64 = camera.sensor.response(&bands)[1].iter().sum();
            let level =
                camera.sensor.full_well_e / (response * 1e-3) * (1e-3 * 1e5f64.powf(next()));
            let spectrum: Vec<f32> = (0..bands.count).map(|_| (level * next()) as f32).collect();
            let cube = IrradianceCube::uniform(header, &spectrum).unwrap();
            let simulated = SimulatedSensor::new(&camera, &cube.header).unwrap();
            let settings = camera.settings(0, 1e-3, Some(16f64.powf(next())));
            let [float, fixed] = Arithmetic::ALL.map(|arithmetic| {
                let options = FrameOptions { arithmetic, ..FrameOptions::default() };
                simulated.frame_with(&cube, &settings, options).unwrap().data
            });
            let off = float.iter().zip(&fixed).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(off <= Some(1), "draw {draw}: {off:?} DN");
        }
    }

    /// Even light through a filter with steep edges at 480 and 620 nm, on an even sensor: in the
    /// corner the edges lie at shorter waves, and the light falls to (1 − s_1/n²)/(1 − s_0/n²) of
    /// that in the centre, s the means of sin²θ over both cones; more at a smaller f-number alone.
    #[test]
    fn light_falls_towards_the_corner_as_an_interference_filter_moves() {
        let index = ("sensor.ir_cut_effective_index", 1.7);
        let mut camera = Camera::load_with("mt9t012", [index]).unwrap().with_size(66, 50).unwrap();
        let sensor = &mut camera.sensor;
        sensor.pitch_um = 70.0;
        let edges = vec![479.999, 480.001, 619.999, 620.001];
        let pass = Spectrum::new(edges, vec![0.0, 1.0, 1.0, 0.0]).unwrap();
        sensor.ir_cut = Some(pass.outside(Outside::Zero));
        sensor.qe = vec![Spectrum::constant(0.5); 3];
        let Some(Directions::Cones { image_distance_mm, sin }) =
            sensor.filter_angles.as_ref().map(|angles| angles.directions.clone())
        else {
            panic!("an ideal lens");
        };
        let bands = Bands { start_nm: 400.0, step_nm: 10.0, count: 24 };
        let header = CubeHeader::new((66, 50), &bands, "even light");
        let simulated = SimulatedSensor::new(&camera, &header).unwrap();
        let cube = IrradianceCube::uniform(header, &vec![1e-3; bands.count]).unwrap();
        let plane = simulated.electrons(&cube, &camera.settings(0, 1e-3, None)).unwrap();
        let part = |x: f64, y: f64| {
            let tan = x.hypot(y) * 70e-3 / image_distance_mm;
            let sin2 = tan * tan / (1.0 + tan * tan);
            1.0 - (sin2 + sin * sin / 2.0) / (1.7 * 1.7)
        };
        let centre = plane.data[25 * 66 + 33];
        for (x, y) in [(0usize, 0usize), (65, 49), (12, 40), (33, 3)] {
            let got = f64::from(plane.data[y * 66 + x] / centre);
            let right = part(x as f64 - 32.5, y as f64 - 24.5) / part(0.5, 0.5);
            // Steps of the filter and nodes of the field.
            assert!((got / right - 1.0).abs() < 1e-3, "{x}, {y}: {got}, {right}");
        }
    }
}
