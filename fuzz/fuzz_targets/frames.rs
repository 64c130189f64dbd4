//! See `camrig_fuzz::frames`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| camrig_fuzz::frames::watch(data));
