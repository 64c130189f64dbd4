//! A figure of a target with its value.

use crate::statistic::{Figure, Scale};

/// A figure with its value.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredFigure {
    /// What it measures.
    pub figure: Figure,
    /// Its value, in its own unit.
    pub value: f64,
    /// Standard deviation on its scale.
    pub sd: f64,
    /// The scale on which it is normally distributed.
    pub scale: Scale,
}

impl MeasuredFigure {
    /// A figure that is normally distributed in its own unit.
    pub(super) fn linear(figure: Figure, value: f64, sd: f64) -> Self {
        Self { figure, value, sd, scale: Scale::Linear }
    }
}
