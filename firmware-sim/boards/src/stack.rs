//! How deep the stack is used.

/// Pattern of unused stack.
const PAINT: u32 = 0x5ac5_ac5a;

unsafe extern "C" {
    static mut __ebss: u32;
    static mut _stack_start: u32;
}

/// From the end of the static memory to the stack's top.
fn ends() -> (*mut u32, *mut u32) {
    (&raw mut __ebss, &raw mut _stack_start)
}

/// Bytes between the static memory and the stack's top.
pub fn size() -> usize {
    let (bottom, top) = ends();
    top as usize - bottom as usize
}

/// Fills the unused stack with a pattern, to measure later how deep it was used.
#[inline(never)]
pub fn paint() {
    let (bottom, _) = ends();
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

/// Largest stack use since [`paint`], bytes.
pub fn used() -> usize {
    let (bottom, top) = ends();
    let mut word = bottom;
    // SAFETY: reads the stack's own memory.
    while word < top && unsafe { word.read_volatile() } == PAINT {
        word = word.wrapping_add(1);
    }
    top as usize - word as usize
}
