//! Self-contained HTML pages and SVG plots of measurements and simulations.
//!
//! A [`page::Page`] is written top to bottom from headings, tables, pictures and drawings; it
//! loads nothing from elsewhere, is readable on a phone, in print and on a dark background, and
//! has the same bytes for the same content. A [`plot::Plot`] draws series over linear or
//! logarithmic axes, whose labels name quantity and unit. The other modules write the pages of
//! camrig's commands: data sheets, EMVA 1288, lenses, measurements, simulations, diagnosis,
//! trade-offs.
//!
//! # Example
//! A page with the noise of a sensor over its signal, both in electrons:
//! ```
//! use camrig_report::{page::Page, plot::{Mark, Plot}};
//!
//! let noise = |signal_e: f64| [signal_e, (9.0 + signal_e).sqrt()]; // read noise 3 e⁻, shot noise
//! let mut plot = Plot::new("Noise", "signal, e⁻", "standard deviation, e⁻");
//! plot.log_x().log_y();
//! plot.series("model", Mark::Line, [1.0, 10.0, 100.0, 1e3, 1e4].map(noise).to_vec());
//!
//! let mut page = Page::new("My sensor");
//! page.heading("Noise").drawing(&plot.svg(), "shot noise and read noise");
//! page.table(&["figure", "value"], &[vec!["read noise".into(), "3.0 e⁻".into()]]);
//! let html = page.html();
//! assert!(html.starts_with("<!doctype html>") && html.contains("<svg"));
//! ```

pub mod datasheet;
pub mod diagnosis;
pub mod emva;
pub mod lens;
pub mod measurement;
pub mod page;
pub mod paper;
pub mod plot;
pub mod simulation;
pub mod tradeoff;
