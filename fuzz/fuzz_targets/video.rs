//! See `camrig_fuzz::video`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| camrig_fuzz::video::watch(data));
