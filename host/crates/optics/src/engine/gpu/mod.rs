//! The blur that varies over the field on a graphics processor, through wgpu: Vulkan, Metal or
//! Direct3D 12.
//!
//! The same sum as [`super::varying`], directly instead of by Fourier transforms ([`Blurrer`]): a
//! graphics processor can spare the multiplications that a transform saves, up to kernels of some
//! hundred entries across.

mod blur;

pub use blur::Blurrer;
use camrig_base::{Error, ErrorCode, Result};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use wgpu::{Adapter, Backends, Buffer, BufferDescriptor, BufferUsages, DeviceType};

/// An opened graphics processor.
#[derive(Debug)]
pub struct Gpu {
    name: String,
    kind: DeviceType,
    device: wgpu::Device,
    queue: wgpu::Queue,
    /// The last error that the driver reported; it reports asynchronously.
    trouble: Arc<Mutex<Option<String>>>,
}

/// The graphics processor that this process opened.
static OPENED: OnceLock<Gpu> = OnceLock::new();

impl Gpu {
    /// The best graphics processor of this machine: a dedicated one, or with `any` also an
    /// integrated one or one emulated in software.
    ///
    /// # Errors
    /// There is none, or the driver does not open it.
    pub fn open(any: bool) -> Result<&'static Self> {
        let wanted = |kind: DeviceType| any || is_dedicated(kind);
        if let Some(gpu) = OPENED.get().filter(|gpu| wanted(gpu.kind)) {
            return Ok(gpu);
        }
        let gpu = Self::find(wanted)?;
        Ok(OPENED.get_or_init(|| gpu))
    }

    fn find(wanted: impl Fn(DeviceType) -> bool) -> Result<Self> {
        let backends = Backends::VULKAN | Backends::METAL | Backends::DX12;
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends,
            flags: wgpu::InstanceFlags::empty(),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let found = pollster::block_on(instance.enumerate_adapters(backends));
        let adapter = found.into_iter().filter(|a| wanted(a.get_info().device_type));
        let adapter = adapter.min_by_key(|a| rank(a.get_info().device_type)).ok_or_else(|| {
            Error::unsupported(
                "no graphics processor: no driver of Vulkan, Metal or Direct3D 12 has one",
            )
            .help(
                "install its driver, or mesa-vulkan-drivers for one in software, or use the \
                 processor",
            )
            .with_code(ErrorCode::GraphicsProcessor)
        })?;
        Self::of(&adapter)
    }

    fn of(adapter: &Adapter) -> Result<Self> {
        let info = adapter.get_info();
        let wanted =
            wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&wanted)).map_err(|e| {
                Error::device(format!("{} cannot be opened: {e}", info.name))
                    .help("use the processor")
                    .with_code(ErrorCode::GraphicsProcessor)
            })?;
        let trouble = Arc::new(Mutex::new(None));
        let note = |trouble: &Mutex<Option<String>>, what: String| {
            *trouble.lock().unwrap_or_else(PoisonError::into_inner) = Some(what);
        };
        let said = Arc::clone(&trouble);
        device.on_uncaptured_error(Arc::new(move |e| note(&said, e.to_string())));
        let said = Arc::clone(&trouble);
        device.set_device_lost_callback(move |_, why| note(&said, format!("lost: {why}")));
        let name = format!("{} ({}, {})", info.name, info.backend, info.driver_info);
        Ok(Self { name, kind: info.device_type, device, queue, trouble })
    }

    /// Its name, backend and driver.
    pub fn name(&self) -> &str {
        &self.name
    }

    fn buffer(&self, size: u64, usage: BufferUsages) -> Buffer {
        let (label, mapped_at_creation) = (None, false);
        self.device.create_buffer(&BufferDescriptor { label, size, usage, mapped_at_creation })
    }

    fn filled(&self, data: &[u8], usage: BufferUsages) -> Buffer {
        let buffer = self.buffer(data.len() as u64, usage | BufferUsages::COPY_DST);
        self.queue.write_buffer(&buffer, 0, data);
        buffer
    }

    /// Returns the error reported since the last call, if there is one.
    fn check(&self) -> Result<()> {
        match self.trouble.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(what) => Err(self.failed(what)),
            None => Ok(()),
        }
    }

    fn failed(&self, what: impl std::fmt::Display) -> Error {
        Error::device(format!("{} gave up: {what}", self.name))
            .help("use the processor")
            .with_code(ErrorCode::GraphicsProcessor)
    }
}

/// Whether it can be expected to sum faster than the processor transforms. Integrated ones cannot,
/// judging by their multiplications per second.
fn is_dedicated(kind: DeviceType) -> bool {
    matches!(kind, DeviceType::DiscreteGpu | DeviceType::VirtualGpu)
}

/// Order of preference, the fastest kind first.
fn rank(kind: DeviceType) -> u8 {
    match kind {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}

#[cfg(test)]
mod tests;
