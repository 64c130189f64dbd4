//! Lenses from files, traced: what the readers and the tracer make of them together.

mod exports;
mod lens_apertures;
mod lens_fields;
mod lens_folds;
mod lens_import;
mod lens_tracer;
mod patents;
mod seq_files;
mod zmx_files;
