//! The memory of the rig, all of it static: the linker's figure is what the rig needs.

use crate::FIRMWARE;
use camrig_firmware_sim::{Buffers, Memory, Rig, RowMemory};
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

/// Longest row, pixels.
const WIDTH: usize = 2048;
/// Largest number of spectral bands; the memory does not depend on it, as bands are summed as they
/// arrive.
const BANDS: u16 = 31;
/// Rows: three of means and a pipeline of four, for one effect that reads its neighbours.
const ROWS: usize = 7;
/// Longest packed raw row, bytes.
pub const RAW_BYTES: usize = 2 * WIDTH;
/// Longest packet received: a band of 2048 pixels is 4224 bytes.
const PACKET: usize = 4400;
/// Packets that the host may have under way.
const CREDIT: u16 = 32;
/// Longest packet sent.
const ANSWER: usize = 1100;
/// Values of the crosstalk table: 13 x 17 nodes, 7 wavelengths, 3 channels, and the axes.
const CROSSTALK: usize = 13 * 17 * 7 * 3 + 37;

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

/// Hands out the memory, once.
pub fn take() -> Option<Parts> {
    let rows = RowMemory { rows: SIGNALS.take()?, sums: SUMS.take()? };
    let memory = Memory {
        #[cfg(feature = "float")]
        float: rows,
        #[cfg(feature = "fixed")]
        fixed: rows,
        mantissas: MANTISSAS.take()?,
        exponents: EXPONENTS.take()?,
        crosstalk: TABLE.take()?,
        max_bands: BANDS,
    };
    let buffers = Buffers {
        input: INPUT.take()?,
        packet: PACKET_BYTES.take()?,
        answer: ANSWER_BYTES.take()?,
        framed: FRAMED.take()?,
    };
    let rig = RIG.take()?.write(Rig::new(FIRMWARE, memory));
    let device = DEVICE.take()?.write(Device::new(PACKET as u16, CREDIT));
    Some(Parts { rig, device, buffers })
}

/// Pattern of unused stack.
const PAINT: u32 = 0x5ac5_ac5a;

unsafe extern "C" {
    static mut __ebss: u32;
    static mut _stack_start: u32;
}

/// From the end of the static memory to the stack's top.
fn stack() -> (*mut u32, *mut u32) {
    (&raw mut __ebss, &raw mut _stack_start)
}

/// Bytes between the static memory and the stack's top.
pub fn stack_size() -> usize {
    let (bottom, top) = stack();
    top as usize - bottom as usize
}

/// Fills the unused stack with a pattern, to measure later how deep it was used.
#[inline(never)]
pub fn paint_stack() {
    let (bottom, _) = stack();
    let here = 0u32;
    let mut word = bottom;
    // A margin for this function's own frame.
    let end = (&raw const here as usize - 64) as *mut u32;
    while word < end {
        // SAFETY: between the static memory and the stack pointer nothing lives (no heap).
        unsafe { word.write_volatile(PAINT) };
        word = word.wrapping_add(1);
    }
}

/// Largest stack use since [`paint_stack`], bytes.
pub fn stack_used() -> usize {
    let (bottom, top) = stack();
    let mut word = bottom;
    // SAFETY: reads the stack's own memory.
    while word < top && unsafe { word.read_volatile() } == PAINT {
        word = word.wrapping_add(1);
    }
    top as usize - word as usize
}
