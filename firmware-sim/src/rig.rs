//! What a rig holds between frames: memory, camera, settings.

use crate::camera::CameraStore;
use crate::memory::{Memory, UNIT_BYTES};
use crate::running::{self, AnyRunning, Frame, MAX_RING};
use camrig_rig_link::device::{Begun, Model, RowSink};
use camrig_rig_link::message::*;
use camrig_rig_link::packing::Packing;
use camrig_rig_link::registers::Registers;
use camrig_sensor_core::arith::blocks;
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::effects::{Effect, Needs};
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
        let camera = CameraStore::new(core::mem::take(&mut memory.crosstalk));
        Self { firmware, camera, frame: None, memory, sink: None }
    }

    /// Gives the rig an interface of its own, for raw rows that the host wants there.
    pub fn set_sink(&mut self, sink: &'m mut (dyn RowSink + Send)) {
        self.sink = Some(sink);
    }

    /// The frame in progress with everything that it needs; `None` between frames. Making it costs
    /// about as much as a few hundred pixels, so keep it while parts arrive.
    pub fn running(&mut self) -> Option<AnyRunning<'_>> {
        self.running_and_sink().map(|(running, _)| running)
    }

    /// [`Rig::running`], and where its rows go.
    pub(crate) fn running_and_sink(
        &mut self,
    ) -> Option<(AnyRunning<'_>, Option<&mut (dyn RowSink + Send + 'm)>)> {
        let frame = self.frame.as_mut()?;
        let (camera, memory) = (&self.camera, &mut self.memory);
        let running = AnyRunning::new(camera.config()?, camera.crosstalk(), frame, memory)?;
        Some((running, self.sink.as_deref_mut()))
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

/// Sizes on the link of a frame of this camera; `None` if they exceed the number range of the
/// link. Host and device both compute them and compare.
pub fn frame_shape(config: &SensorConfig, codec: Codec, raw_bits: u8) -> Option<FrameShape> {
    let width = config.width as usize;
    let bands = match codec {
        Codec::Bfp16 => usize::from(config.bands),
        Codec::Electrons16 => 1,
        _ => return None,
    };
    Some(FrameShape {
        rows: u16::try_from(config.height).ok()?,
        units: u16::try_from(groups(width) * bands).ok()?,
        unit_bytes: UNIT_BYTES as u16,
        raw_bytes: u16::try_from(Packing::of_bits(raw_bits.into())?.row_bytes(width)).ok()?,
        halo: u8::try_from(halo(config)).ok()?,
    })
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
            codecs: 1 << Codec::Bfp16 as u8 | 1 << Codec::Electrons16 as u8 | WIDE_GROUPS,
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
        if config.effects.iter().any(|e| e.entry().needs == Needs::EarlierFrames) {
            return Err(Refusal::Effects);
        }
        let max = self.max_width();
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
        let width = config.width as usize;
        let whole = u32::from(frame.width) == config.width
            && u32::from(frame.rows) == config.height
            && (frame.codec == Codec::Electrons16 || frame.bands == u16::from(config.bands));
        if !whole || width > self.max_width() || frame.bands > self.memory.max_bands {
            return Err(Refusal::WrongShape);
        }
        if frame.raw_bits < config.bits {
            return Err(Refusal::Packing);
        }
        let shape = frame_shape(config, frame.codec, frame.raw_bits).ok_or(Refusal::Packing)?;
        let ring = 2 * halo(config) + 1;
        let needed = ring * blocks(width) + memory_blocks(config);
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
        let seed = config.seed;
        #[cfg(feature = "defmt")]
        defmt::info!(
            "frame {=u32}: {=f32} s, gain {=f32}",
            settings.frame,
            settings.exposure_s,
            settings.analog_gain
        );
        self.frame = Some(Frame::new(*frame, settings, shape, registers));
        Ok(Begun::new(shape, seed))
    }

    fn units(&mut self, row: u16, first: u16, units: &[u8]) {
        if let Some(mut running) = self.running() {
            running::units(&mut running, row, first, units);
        }
    }

    fn raw_row(&mut self, row: u16, out: &mut [u8]) {
        if let Some(mut running) = self.running() {
            running::raw_row(&mut running, row, out);
        }
    }

    fn sink(&mut self) -> Option<&mut dyn RowSink> {
        Some(&mut **self.sink.as_mut()?)
    }
}
