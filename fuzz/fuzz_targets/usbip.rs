//! See `camrig_fuzz::usbip`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| camrig_fuzz::usbip::attach(data));
