//! Rigs: a frame has the same bytes on whatever rig its sensor stage ran.
//!
//! Always tested: the emulator in this process, over TCP and over a pseudo-terminal. With
//! firmware: Cortex-M boards in QEMU (`ci/tier-firmware` builds it and gives its folder in
//! CAMRIG_FIRMWARE).

mod captures;
mod common;
mod emulator;
mod errors;
mod overhead;
mod qemu;
#[cfg(unix)]
mod stays;
