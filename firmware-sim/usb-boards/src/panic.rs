//! What happens on a panic.

use core::panic::PanicInfo;

/// Stops everything, USB included, so that the host sees a link that fails rather than a rig that
/// keeps silent. A debugger finds the processor here, with the place of the panic on the stack.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    loop {
        cortex_m::asm::wfi();
    }
}
