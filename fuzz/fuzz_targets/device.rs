//! See `camrig_fuzz::device`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| camrig_fuzz::device::converse(data));
