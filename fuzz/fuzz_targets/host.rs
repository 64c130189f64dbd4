//! See `camrig_fuzz::host`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| camrig_fuzz::host::converse(data));
