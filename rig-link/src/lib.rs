//! Placeholder.
#![no_std]

pub mod packing;
