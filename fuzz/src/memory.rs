//! An allocator that ends the process at an allocation which no input explains.

use std::alloc::{GlobalAlloc, Layout, System as Memory};

/// Largest single allocation: inputs have 64 KiB, and compression may make a thousand times as much
/// of them.
const LARGEST: usize = 256 << 20;

/// The system's memory, without allocations beyond 256 MiB.
pub struct Bounded;

// SAFETY: every call is passed on to the system's allocator, or ends the process.
unsafe impl GlobalAlloc for Bounded {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        bounded(layout.size());
        // SAFETY: the caller keeps the contract of `GlobalAlloc`, which is this one's.
        unsafe { Memory.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        bounded(layout.size());
        // SAFETY: the caller keeps the contract of `GlobalAlloc`, which is this one's.
        unsafe { Memory.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        bounded(size);
        // SAFETY: the caller keeps the contract of `GlobalAlloc`, which is this one's.
        unsafe { Memory.realloc(at, layout, size) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract of `GlobalAlloc`, which is this one's.
        unsafe { Memory.dealloc(at, layout) }
    }
}

fn bounded(size: usize) {
    if size > LARGEST {
        eprintln!("an allocation of {size} bytes");
        std::process::abort();
    }
}
