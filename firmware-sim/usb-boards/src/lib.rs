//! Firmware of the camera rig for boards with USB, the part that all boards share. The rig's
//! blocking loop has the thread level to itself; USB runs on an interrupt executor above it, and
//! two pipes join them.

#![no_std]

#[cfg(not(any(feature = "stm32h743", feature = "rp2350")))]
compile_error!("choose a chip: cargo stm32h743 or cargo rp2350");
#[cfg(all(feature = "float", feature = "fixed"))]
compile_error!("choose one arithmetic: float or fixed");

pub mod limits;
pub mod link;
#[path = "../../boards/src/memory.rs"]
mod memory;
mod panic;
pub mod usb;

use camrig_firmware_sim::{Buffers, Plain, serve_rig};
use camrig_rig_link::framing::Framing;

/// Serves hosts one after the other, for ever. `firmware`: name and version.
///
/// # Panics
/// If called twice.
pub fn serve(firmware: &'static str) -> ! {
    let memory::Parts { rig, device, buffers } =
        memory::take(firmware).expect("the static memory is taken once");
    let Buffers { input, packet, answer, framed } = buffers;
    loop {
        let buffers = Buffers {
            input: &mut *input,
            packet: &mut *packet,
            answer: &mut *answer,
            framed: &mut *framed,
        };
        // A session ends when the host closes the port; a frame of it can be resumed in the next.
        // It cannot end otherwise: the pipes do not fail, and COBS gets into step by itself.
        let _ = serve_rig::<Plain, _, { limits::RAW_BYTES }>(
            device,
            rig,
            &mut link::Link,
            Framing::Cobs,
            buffers,
        );
    }
}
