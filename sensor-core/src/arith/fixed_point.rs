//! Fixed-point arithmetic.

/// placeholder
#[derive(Clone, Copy, Debug)]
pub struct Fixed;
