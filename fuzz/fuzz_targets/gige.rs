//! See `camrig_fuzz::gige`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| camrig_fuzz::gige::converse(data));
