//! Validating: a model's frames beside captured ones, figure by figure.

pub mod paper;
