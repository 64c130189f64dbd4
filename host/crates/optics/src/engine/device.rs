//! The device that runs the blur that varies over the field. (The blur that is the same everywhere
//! is one transform per band, and always runs on the processor.)

use super::gpu::{self, Gpu};
use super::source::Rows;
use super::varying::{self, Kernels, Tiling};
use camrig_base::{Plane, Result};

/// Choice of the device for the blur that varies over the field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The processor: the same bytes on any machine.
    Cpu,
    /// A graphics processor of any kind, including one emulated in software: the same within
    /// 32-bit rounding.
    Gpu,
    /// A dedicated graphics processor where there is one, else the processor.
    #[default]
    Auto,
}

camrig_base::choices!(DeviceChoice, "device": Cpu = "cpu", Gpu = "gpu", Auto = "auto");

/// An opened device.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub enum Device {
    /// The processor.
    #[default]
    Cpu,
    /// A graphics processor.
    Gpu(&'static Gpu),
}

impl DeviceChoice {
    /// Opens the chosen device.
    ///
    /// # Errors
    /// A graphics processor was asked for and there is none.
    pub fn open(self) -> Result<Device> {
        match self {
            Self::Cpu => Ok(Device::Cpu),
            Self::Gpu => Gpu::open(true).map(Device::Gpu).map_err(|e| e.at("device gpu")),
            Self::Auto => Ok(Gpu::open(false).map_or(Device::Cpu, Device::Gpu)),
        }
    }
}

impl Device {
    /// The graphics processor's name; `None` for the processor.
    #[must_use]
    pub fn name(self) -> Option<&'static str> {
        match self {
            Self::Cpu => None,
            Self::Gpu(gpu) => Some(gpu.name()),
        }
    }

    /// The processor and, in a program built with the feature `gpu`, a graphics processor where
    /// there is one, if only in software.
    #[must_use]
    pub fn available() -> Vec<Self> {
        [Self::Cpu].into_iter().chain(Gpu::open(true).map(Self::Gpu)).collect()
    }
}

/// Blurs bands of one tiling.
#[non_exhaustive]
pub enum Blurrer {
    Cpu(Box<varying::Blurrer>),
    Gpu(gpu::Blurrer),
}

impl Blurrer {
    pub fn new(device: Device, tiling: &Tiling) -> Result<Self> {
        match device {
            Device::Cpu => Ok(Self::Cpu(Box::new(varying::Blurrer::new(tiling)))),
            Device::Gpu(gpu) => gpu::Blurrer::new(gpu, tiling).map(Self::Gpu),
        }
    }

    pub fn tiling(&self) -> &Tiling {
        match self {
            Self::Cpu(blurrer) => blurrer.tiling(),
            Self::Gpu(blurrer) => blurrer.tiling(),
        }
    }

    /// See [`varying::Blurrer::blur`].
    pub fn blur(
        &mut self,
        rows: &Rows<'_>,
        kernels: &Kernels,
        corner: (usize, usize),
        size: (usize, usize),
    ) -> Result<Plane<f32>> {
        match self {
            Self::Cpu(blurrer) => blurrer.blur(rows, kernels, corner, size),
            Self::Gpu(blurrer) => blurrer.blur(rows, kernels, corner, size),
        }
    }
}
