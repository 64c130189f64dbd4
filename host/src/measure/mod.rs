//! Measuring: captures in, figures out.
