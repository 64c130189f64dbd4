//! Self-contained HTML pages and SVG plots of measurements and simulations.
//!
//! The principal type is [`page::Page`]. It is written top to bottom from headings, tables,
//! pictures and drawings; it loads nothing from elsewhere, is readable on a phone, in print, on a
//! dark background and without scripts, and has the same bytes for the same content. A
//! [`plot::Plot`] draws series over linear or logarithmic axes, maps and cells; its colours are
//! roles, which the page colours. The module [`numbers`] rounds values to their errors. The other
//! modules write the pages of camrig's commands: data sheets, EMVA 1288, lenses, measurements,
//! simulations, diagnosis, trade-offs.
//!
//! # Example
//! A page with the noise of a sensor against its signal, both in electrons:
//! ```
//! use camrig_report::{numbers::amount, page::Page, plot::{Colour, Mark, Plot}};
//!
//! let noise = |signal_e: f64| [signal_e, (9.0 + signal_e).sqrt()]; // read noise 3 e⁻, shot noise
//! let mut plot = Plot::new("Noise", "signal, e⁻", "standard deviation, e⁻");
//! plot.log_x().log_y().note("Shot noise and read noise.");
//! let points = [1.0, 10.0, 100.0, 1e3, 1e4].map(noise).to_vec();
//! plot.series("model", Mark::Line, Colour::Improved, points);
//!
//! let mut page = Page::new("My sensor");
//! page.heading("Noise").grid(|page| {
//!     page.plot(&plot);
//! });
//! page.facts(&[("read noise", amount(3.0, Some(0.21), "e⁻"))]);
//! let html = page.html();
//! assert!(html.starts_with("<!doctype html>") && html.contains("<svg"));
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod datasheet;
pub mod diagnosis;
pub mod emva;
pub mod lens;
pub mod measurement;
pub mod numbers;
pub mod page;
pub mod paper;
pub mod plot;
pub mod simulation;
pub mod tradeoff;
