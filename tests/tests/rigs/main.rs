//! Rigs: whatever sensor stage a frame ran on, its bytes are the same.
//!
//! Tiers: the emulator in this process, over TCP, over a pseudo-terminal (always); firmware on
//! Cortex-M boards in QEMU (`ci/tier-firmware` builds it and says where in CAMRIG_FIRMWARE).

mod common;
mod emulator;
mod errors;
mod overhead;
mod qemu;
