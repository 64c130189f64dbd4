//! See `camrig_fuzz::files`; `FUZZ_FORMAT` names the reader.

#![no_main]

use camrig_fuzz::{files::Reader, memory::Bounded};
use std::sync::OnceLock;

#[global_allocator]
static MEMORY: Bounded = Bounded;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    static READER: OnceLock<Reader> = OnceLock::new();
    let format = || std::env::var("FUZZ_FORMAT").expect("FUZZ_FORMAT names the reader");
    READER.get_or_init(|| Reader::new(&format())).read(bytes);
});
