//! What a model predicts for a capture set: its effects, its light, replicates of the captures,
//! and the mean and scatter of every statistic over them.

pub mod effects;
pub mod light;
pub mod prediction;
pub mod replicate;
pub mod replicates;
