//! See `camrig_fuzz::profiles`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| camrig_fuzz::profiles::drive(data));
