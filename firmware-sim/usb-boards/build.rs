//! Puts the chip's memory map where the linker finds it.

use std::{env, fs, path::PathBuf};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap());
    for chip in ["stm32h743", "rp2350"] {
        let map = format!("{chip}.x");
        println!("cargo:rerun-if-changed={map}");
        if env::var_os(format!("CARGO_FEATURE_{}", chip.to_uppercase())).is_some() {
            fs::copy(&map, out.join("memory.x")).unwrap();
        }
    }
    println!("cargo:rustc-link-search={}", out.display());
}
