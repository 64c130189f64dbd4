//! What a rig holds between frames: memory, camera, settings.

use crate::camera::CameraStore;
use crate::memory::{Memory, UNIT_BYTES};
use crate::raw_row::RawRow;
use crate::running::{self, AnyRunning, Frame, MAX_RING};
use camrig_rig_link::device::{Begun, Model, RowSink};
use camrig_rig_link::message::*;
use camrig_rig_link::registers::Registers;
use camrig_sensor_core::arith::blocks;
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::effects::{Effect, Needs};
use camrig_sensor_core::hdr::{MAX_CAPTURES, Readout};
use camrig_sensor_core::pipeline::memory_blocks;
use camrig_sensor_core::spectral::{GROUP, groups};

/// A rig without its link: [`Model`] for [`camrig_rig_link::device::Device`].
pub struct Rig<'m> {
    firmware: &'static str,
    camera: CameraStore<'m>,
    frame: Option<Frame>,
    memory: Memory<'m>,
    sink: Option<&'m mut (dyn RowSink + Send)>,
}

impl<'m> Rig<'m> {
    /// A rig without a camera. `firmware`: name and version, at most 40 bytes.
    pub fn new(firmware: &'static str, mut memory: Memory<'m>) -> Self {
        let captures = core::mem::take(&mut memory.captures);
        let camera = CameraStore::new(core::mem::take(&mut memory.crosstalk), captures);
        Self { firmware, camera, frame: None, memory, sink: None }
    }

    /// Gives the rig an interface of its own, for raw rows that the host wants there.
    pub fn set_sink(&mut self, sink: &'m mut (dyn RowSink + Send)) {
        self.sink = Some(sink);
    }

    /// Calls `work` with the frame in progress and everything that it needs, and where its rows go;
    /// `None` between frames. Making it costs about as much as a few hundred pixels, so keep it while
    /// parts arrive.
    pub fn with_running<T>(
        &mut self,
        work: impl FnOnce(&mut AnyRunning<'_, '_>, Option<&mut (dyn RowSink + Send + 'm)>) -> T,
    ) -> Option<T> {
        let frame = self.frame.as_ref()?;
        let (camera, memory, sink) = (&self.camera, &mut self.memory, self.sink.as_deref_mut());
        AnyRunning::with(camera, frame, memory, |mut running| work(&mut running, sink))
    }

    fn max_width(&self) -> usize {
        let bands = self.memory.mantissas.len().min(self.memory.exponents.len() * GROUP);
        #[cfg(feature = "float")]
        let bands = self.memory.float.as_ref().map_or(bands, |m| bands.min(m.sums.len() * GROUP));
        #[cfg(feature = "fixed")]
        let bands = self.memory.fixed.as_ref().map_or(bands, |m| bands.min(m.sums.len() * GROUP));
        bands.min(usize::from(u16::MAX))
    }

    fn row_blocks(&self, arithmetic: NumberFormat) -> Option<usize> {
        match arithmetic {
            #[cfg(feature = "float")]
            NumberFormat::F32 => self.memory.float.as_ref().map(|m| m.rows.len()),
            #[cfg(feature = "fixed")]
            NumberFormat::Fixed => self.memory.fixed.as_ref().map(|m| m.rows.len()),
            _ => None,
        }
    }
}

/// Number of rows above and below that a raw row depends on: one for each effect that reads its
/// neighbours.
pub fn halo(config: &SensorConfig) -> usize {
    config.effects.iter().filter(|e| e.entry().needs == Needs::Neighbours).count()
}

/// What the sizes of a camera's frames on the link follow from.
#[derive(Clone, Debug)]
pub struct Sensor<'c> {
    /// Its captures, at least one.
    pub captures: heapless::Vec<&'c SensorConfig, MAX_CAPTURES>,
    /// What is made of several.
    pub readout: Option<&'c Readout>,
}

impl Sensor<'_> {
    /// Number of rows above and below that a raw row depends on.
    pub fn halo(&self) -> usize {
        self.captures.iter().map(|config| halo(config)).max().unwrap_or(0)
    }

    /// How its raw rows lie in bytes with so many bits per sample; `None` where they cannot.
    pub fn raw_row(&self, bits: u8) -> Option<RawRow> {
        RawRow::new(bits, self.captures.iter().map(|config| config.bits).max()?, self.readout)
    }

    /// How many lights the bands of a spectral row belong to: 1 that all captures see, or one of
    /// each capture; `None` where it is neither.
    pub fn lights(&self, codec: Codec, bands: u16) -> Option<usize> {
        let of_one = match codec {
            Codec::Bfp16 => usize::from(self.captures.first()?.bands),
            Codec::Electrons16 => 1,
            _ => return None,
        };
        // Electrons are those of one response.
        let shared = codec == Codec::Bfp16 || self.captures.len() == 1;
        [1, self.captures.len()]
            .into_iter()
            .find(|n| usize::from(bands) == n * of_one && (shared || *n > 1))
    }

    /// Sizes on the link of a frame with so many bands in a spectral row, and so many bits in a raw
    /// sample; `None` if they exceed the number range of the link. Host and device both compute
    /// them and compare.
    pub fn frame_shape(&self, bands: u16, raw_bits: u8) -> Option<FrameShape> {
        let config = self.captures.first()?;
        let width = config.width as usize;
        Some(FrameShape {
            rows: u16::try_from(config.height).ok()?,
            units: u16::try_from(groups(width) * usize::from(bands)).ok()?,
            unit_bytes: UNIT_BYTES as u16,
            raw_bytes: u16::try_from(self.raw_row(raw_bits)?.bytes(width)).ok()?,
            halo: u8::try_from(self.halo()).ok()?,
        })
    }
}

impl Model for Rig<'_> {
    fn capabilities(&self) -> Capabilities {
        let bit = |arithmetic| u8::from(self.row_blocks(arithmetic).is_some()) << arithmetic as u8;
        let mut memory_bytes =
            size_of_val(self.memory.mantissas) + size_of_val(self.memory.exponents);
        #[cfg(feature = "float")]
        if let Some(rows) = &self.memory.float {
            memory_bytes += size_of_val(rows.rows) + size_of_val(rows.sums);
        }
        #[cfg(feature = "fixed")]
        if let Some(rows) = &self.memory.fixed {
            memory_bytes += size_of_val(rows.rows) + size_of_val(rows.sums);
        }
        Capabilities {
            firmware: self.firmware.try_into().unwrap_or_default(),
            packet_bytes: 0,
            credit: 0,
            max_width: self.max_width() as u16,
            max_bands: self.memory.max_bands,
            max_camera: self.camera.max_bytes(),
            arithmetics: bit(NumberFormat::F32) | bit(NumberFormat::Fixed),
            codecs: 1 << Codec::Bfp16 as u8
                | 1 << Codec::Electrons16 as u8
                | WIDE_GROUPS
                | if self.camera.max_captures() > 1 { SEVERAL_CAPTURES } else { 0 },
            memory_bytes: memory_bytes as u32,
            effects: Effect::CATALOGUE.iter().map(|entry| entry.id).collect(),
            camera: 0,
        }
    }

    fn camera_piece(&mut self, offset: u32, piece: &[u8]) -> Result<(), Refusal> {
        self.frame = None;
        self.camera.piece(offset, piece)
    }

    fn camera_end(&mut self) -> Result<(), Refusal> {
        self.camera.end()?;
        let config = self.camera.config().ok_or(Refusal::BadCamera)?;
        // The charge of all pixels would have to be kept from frame to frame.
        let mut effects = self.camera.captures().flat_map(|capture| &capture.config.effects);
        if effects.any(|e| e.entry().needs == Needs::EarlierFrames) {
            return Err(Refusal::Effects);
        }
        // Captures have the memory of rows in equal parts, of whole groups.
        let max = match self.camera.captures().count() {
            0 | 1 => self.max_width(),
            n => self.max_width() / n / GROUP * GROUP,
        };
        if config.width as usize > max {
            return Err(Refusal::TooWide { max: max as u16 });
        }
        if u16::from(config.bands) > self.memory.max_bands {
            return Err(Refusal::TooManyBands { max: self.memory.max_bands });
        }
        #[cfg(feature = "defmt")]
        defmt::info!(
            "camera: {=u32} x {=u32} pixels, {=u8} bands",
            config.width,
            config.height,
            config.bands
        );
        Ok(())
    }

    fn begin(
        &mut self,
        frame: &FrameBegin,
        exposure: Exposure,
        registers: &Registers,
    ) -> Result<Begun, Refusal> {
        self.frame = None;
        let config = self.camera.config().ok_or(Refusal::NoCamera)?;
        let captures = self.camera.captures().map(|capture| capture.config);
        let sensor = Sensor { captures: captures.collect(), readout: self.camera.readout() };
        let (width, count) = (config.width as usize, sensor.captures.len());
        let whole = u32::from(frame.width) == config.width
            && u32::from(frame.rows) == config.height
            && groups(width) * count <= self.max_width().div_ceil(GROUP);
        let lights = sensor.lights(frame.codec, frame.bands).filter(|_| whole);
        let lights = lights.ok_or(Refusal::WrongShape)?;
        let raw_row = sensor.raw_row(frame.raw_bits).ok_or(Refusal::Packing)?;
        let shape = sensor.frame_shape(frame.bands, frame.raw_bits).ok_or(Refusal::Packing)?;
        let ring = 2 * sensor.halo() + 1;
        let chains = sensor.captures.iter().map(|config| memory_blocks(config)).sum::<usize>();
        let needed = count * ring * blocks(width) + chains;
        let there = self.row_blocks(frame.arithmetic).ok_or(Refusal::Arithmetic)?;
        if ring > MAX_RING || needed > there {
            return Err(Refusal::Effects);
        }
        let mut settings = FrameSettings::new(exposure.exposure_s)
            .with_frame(frame.frame)
            .with_gain(exposure.analog_gain)
            .with_temperature(frame.temperature_c);
        if let Before::LitFor { exposure_s } = frame.before {
            settings = settings.after_exposure(exposure_s);
        }
        settings.check().map_err(|_| Refusal::Exposure)?;
        for ratios in sensor.readout.iter().flat_map(|readout| &readout.ratios) {
            ratios.settings(&settings).check().map_err(|_| Refusal::Exposure)?;
        }
        let seed = config.seed;
        #[cfg(feature = "defmt")]
        defmt::info!(
            "frame {=u32}: {=f32} s, gain {=f32}",
            settings.frame,
            settings.exposure_s,
            settings.analog_gain
        );
        self.frame = Some(Frame::new(*frame, settings, &shape, (lights, raw_row), registers));
        Ok(Begun::new(shape, seed))
    }

    fn units(&mut self, row: u16, first: u16, units: &[u8]) {
        let _ = self.with_running(|running, _| running::units(running, row, first, units));
    }

    fn raw_row(&mut self, row: u16, out: &mut [u8]) {
        let _ = self.with_running(|running, _| running::raw_row(running, row, out));
    }

    fn sink(&mut self) -> Option<&mut dyn RowSink> {
        Some(&mut **self.sink.as_mut()?)
    }
}
