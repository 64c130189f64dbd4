//! The memory of the rig, all of it static: the linker's figure is what the rig needs. The firmware
//! of `usb-boards` has this module too, with limits of its own.

use crate::limits::{ANSWER, BANDS, CAPTURES, CREDIT, CROSSTALK, PACKET, RAW_BYTES, ROWS, WIDTH};
use camrig_firmware_sim::{Buffers, CaptureMemory, Memory, Rig, RowMemory};
use camrig_rig_link::device::Device;
use camrig_rig_link::framing::Framing;
#[cfg(feature = "fixed")]
use camrig_sensor_core::arith::Fixed as Arithmetic;
#[cfg(feature = "float")]
use camrig_sensor_core::arith::Float as Arithmetic;
use camrig_sensor_core::arith::{Arith, BLOCK, Block, blocks};
use camrig_sensor_core::collect::Sums;
use camrig_sensor_core::spectral::{GROUP, groups};
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, Ordering};

type Signal = <Arithmetic as Arith>::Signal;
type Sum = <Arithmetic as Arith>::Sum;

#[cfg(feature = "float")]
const ZERO: (Signal, Sum) = (0.0, 0.0);
#[cfg(feature = "fixed")]
const ZERO: (Signal, Sum) = (fixed::types::I20F12::ZERO, 0);

/// Memory that is handed out once.
struct Once<T>(UnsafeCell<T>, AtomicBool);

// SAFETY: `take` gives the contents out once, and there is one core and no interrupt that uses
// them.
unsafe impl<T> Sync for Once<T> {}

impl<T> Once<T> {
    const fn new(contents: T) -> Self {
        Self(UnsafeCell::new(contents), AtomicBool::new(false))
    }

    fn take(&'static self) -> Option<&'static mut T> {
        if self.1.swap(true, Ordering::AcqRel) {
            return None;
        }
        // SAFETY: the flag lets only the first caller come here.
        Some(unsafe { &mut *self.0.get() })
    }
}

// One static each, so that those of zeros need no flash.
static SIGNALS: Once<[Block<Signal>; ROWS * blocks(WIDTH)]> =
    Once::new([[ZERO.0; BLOCK]; ROWS * blocks(WIDTH)]);
static SUMS: Once<[Sums<Sum>; groups(WIDTH)]> = Once::new([[ZERO.1; GROUP]; groups(WIDTH)]);
static MANTISSAS: Once<[u16; WIDTH]> = Once::new([0; WIDTH]);
static EXPONENTS: Once<[i8; groups(WIDTH)]> = Once::new([0; groups(WIDTH)]);
static MORE_CAPTURES: Once<[CaptureMemory; CAPTURES - 1]> =
    Once::new([const { CaptureMemory::EMPTY }; CAPTURES - 1]);
static TABLE: Once<[f32; CROSSTALK]> = Once::new([0.0; CROSSTALK]);
static INPUT: Once<[u8; 512]> = Once::new([0; 512]);
static PACKET_BYTES: Once<[u8; Framing::Cobs.max_encoded(PACKET)]> =
    Once::new([0; Framing::Cobs.max_encoded(PACKET)]);
static ANSWER_BYTES: Once<[u8; ANSWER]> = Once::new([0; ANSWER]);
static FRAMED: Once<[u8; Framing::Cobs.max_encoded(ANSWER)]> =
    Once::new([0; Framing::Cobs.max_encoded(ANSWER)]);
// Made when the firmware starts, so that their initial values need no flash.
static DEVICE: Once<MaybeUninit<Device<RAW_BYTES>>> = Once::new(MaybeUninit::zeroed());
static RIG: Once<MaybeUninit<Rig<'static>>> = Once::new(MaybeUninit::zeroed());

/// The rig and its link's memory.
pub struct Parts {
    /// Camera and frame.
    pub rig: &'static mut Rig<'static>,
    /// The protocol.
    pub device: &'static mut Device<RAW_BYTES>,
    /// The link's memory.
    pub buffers: Buffers<'static>,
}

/// Hands out the memory, once. `firmware`: name and version, as the rig reports them.
pub fn take(firmware: &'static str) -> Option<Parts> {
    let rows = RowMemory { rows: SIGNALS.take()?, sums: SUMS.take()? };
    let memory = Memory::new(MANTISSAS.take()?, EXPONENTS.take()?, TABLE.take()?, BANDS)
        .with_captures(MORE_CAPTURES.take()?);
    #[cfg(feature = "float")]
    let memory = memory.with_float(rows);
    #[cfg(feature = "fixed")]
    let memory = memory.with_fixed(rows);
    let buffers = Buffers {
        input: INPUT.take()?,
        packet: PACKET_BYTES.take()?,
        answer: ANSWER_BYTES.take()?,
        framed: FRAMED.take()?,
    };
    let rig = RIG.take()?.write(Rig::new(firmware, memory));
    let device = DEVICE.take()?.write(Device::new(PACKET as u16, CREDIT));
    Some(Parts { rig, device, buffers })
}
