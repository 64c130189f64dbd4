//! A model's frames measured as real ones are: beside captured ones, and for its data sheet.

pub mod datasheet;
pub mod paper;
