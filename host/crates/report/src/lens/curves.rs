//! Curves of a characterised lens: distortion, lateral colour, illumination, chief-ray angle, MTF,
//! point-spread functions.

use crate::numbers::{fixed, number};
use crate::plot::{Colour, Mark, Plot, picture_grid};
use camrig_base::Plane;
use camrig_optics::Characterisation;
use std::f64::consts::{PI, TAU};

/// Maximum number of wavelengths, field heights and rows of PSFs drawn.
const WAVELENGTHS: usize = 3;
const HEIGHTS: usize = 3;
const PSF_ROWS: usize = 4;
/// Parts of the cut-off of diffraction at which MTF is drawn over the field, rounded.
/// Factors of 2.5 lie between them, so that they differ after rounding.
const PARTS: [f64; 3] = [1.0 / 40.0, 1.0 / 16.0, 1.0 / 6.4];
/// Points of an MTF over frequency.
const POINTS: u32 = 100;
/// The marks of the two directions.
const DIRECTIONS: &str = "Solid: tangential. Dashed: sagittal.";

/// A plot with the name of its file.
pub(super) struct Named {
    pub name: &'static str,
    pub plot: Plot,
}

/// Drawings of the tables of a lens. A pixel pitch, µm, adds the pixel for
/// comparison.
pub(super) fn of_tables(lens: &Characterisation, pixel_um: Option<f64>) -> Vec<Named> {
    let nm = super::few(&lens.wavelengths_nm, WAVELENGTHS);
    let curves = |title: &str, y: &str, value: &dyn Fn(f64, f64) -> f64| {
        let mut plot = Plot::new(title, "paraxial image height, mm", y);
        for &w in &nm {
            let points = lens.heights_mm.iter().map(|&h| [h, value(h, w)]).collect();
            plot.series(&wave(w), Mark::Line, Colour::of_wavelength(w), points);
        }
        plot
    };
    let distortion = |h: f64, w: f64| match h > 0.0 {
        true => 100.0 * (lens.distortion(w).at(h) / h - 1.0),
        false => f64::NAN,
    };
    let plot = curves("Distortion", "real / paraxial height − 1, %", &distortion);
    let mut all = vec![Named { name: "distortion", plot }];
    let lateral_colour = lateral_colour(lens, pixel_um);
    all.extend(lateral_colour.map(|plot| Named { name: "lateral-colour", plot }));
    let mut illumination = curves("Relative illumination", "ratio to the axis, 1", &|h, w| {
        lens.illumination(w).at(h)
    });
    illumination.y_range(0.0, 1.1);
    if lens.magnification == 0.0 {
        let cos4 = |h: f64| 1.0 / (1.0 + (h / lens.efl_mm).powi(2)).powi(2);
        let points = lens.heights_mm.iter().map(|&h| [h, cos4(h)]).collect();
        illumination.series("cos⁴ of the field", Mark::Dashed, Colour::Reference, points);
    }
    all.push(Named { name: "illumination", plot: illumination });
    if lens.chief_ray_angle_deg.is_some() {
        let angle = |h: f64, w: f64| lens.chief_ray_angle(w).map_or(f64::NAN, |c| c.at(h));
        let plot = curves("Chief-ray angle", "angle with the axis, °", &angle);
        all.push(Named { name: "chief-ray-angle", plot });
    }
    all
}

/// Drawings of the sharpness of a lens.
pub(super) fn of_psfs(lens: &Characterisation, pixel_um: Option<f64>) -> Vec<Named> {
    vec![
        Named { name: "mtf-field", plot: over_field(lens) },
        Named { name: "mtf", plot: over_frequency(lens, pixel_um) },
    ]
}

pub(super) fn wave(nm: f64) -> String {
    format!("{}\u{a0}nm", (10.0 * nm).round() / 10.0)
}

/// Chief rays of the outer wavelengths less that of the middle one, µm.
fn lateral_colour(lens: &Characterisation, pixel_um: Option<f64>) -> Option<Plot> {
    let waves = super::few(&lens.wavelengths_nm, WAVELENGTHS);
    let reference = *waves.get(waves.len() / 2)?;
    let others = waves.iter().filter(|w| **w != reference);
    let y = format!("chief ray relative to {}, µm", wave(reference));
    let mut plot = Plot::new("Lateral colour", "paraxial image height, mm", &y);
    let middle = lens.distortion(reference);
    for &w in others.clone() {
        let own = lens.distortion(w);
        let points = lens.heights_mm.iter().map(|&h| [h, 1e3 * (own.at(h) - middle.at(h))]);
        plot.series(&wave(w), Mark::Line, Colour::of_wavelength(w), points.collect());
    }
    if let Some(pixel) = pixel_um {
        let name = format!("1 pixel of {} µm", number(pixel));
        plot.limit_y(pixel, &name).limit_y(-pixel, "1 pixel");
    }
    others.count().gt(&0).then_some(plot)
}

/// Cut-off of diffraction on the axis, cycles/mm.
pub(super) fn cutoff(lens: &Characterisation, nm: f64) -> f64 {
    1e6 / (nm * lens.f_number * (1.0 + lens.magnification))
}

/// The largest of 1, 2 and 5 times a power of ten that is not above a value.
pub(super) fn rounded(value: f64) -> f64 {
    let decade = libm::pow(10.0, libm::log10(value).floor());
    [5.0, 2.0].map(|m| m * decade).into_iter().find(|v| *v <= value).unwrap_or(decade)
}

/// Text of a rounded frequency.
fn per_mm_words(per_mm: f64) -> String {
    format!("{} cycles/mm", fixed(per_mm, if per_mm < 1.0 { 2 } else { 0 }))
}

/// Index of the wavelength in the middle of the PSFs', and the wavelength, nm.
fn middle(lens: &Characterisation) -> (usize, f64) {
    let w = lens.psf.wavelengths_nm.len() / 2;
    (w, lens.psf.wavelengths_nm[w])
}

/// MTF over the field at three frequencies.
fn over_field(lens: &Characterisation) -> Plot {
    let (psf, (w, nm)) = (&lens.psf, middle(lens));
    let mut plot = Plot::new("MTF across the field", "paraxial image height, mm", "modulation, 1");
    plot.y_range(0.0, 1.0).note(&format!("At {}, with diffraction. {DIRECTIONS}", wave(nm)));
    for (i, part) in PARTS.into_iter().enumerate() {
        let per_mm = rounded(part * cutoff(lens, nm));
        for radial in [true, false] {
            let at = |h: usize| {
                let line = line_spread(psf.psf(h, w), psf.size, radial);
                [psf.heights_mm[h], modulation(&line, per_mm * psf.spacing_um * 1e-3)]
            };
            let points = (0..psf.heights_mm.len()).map(at).collect();
            let (label, mark) = match radial {
                true => (per_mm_words(per_mm), Mark::Line),
                false => (String::new(), Mark::Dashed),
            };
            plot.series(&label, mark, Colour::Series(i), points);
        }
    }
    plot
}

/// MTF over frequency at a few field heights, with the diffraction limit on the axis, and Nyquist
/// of the pixel where it is known.
fn over_frequency(lens: &Characterisation, pixel_um: Option<f64>) -> Plot {
    let (psf, (w, nm)) = (&lens.psf, middle(lens));
    let cutoff = cutoff(lens, nm);
    let top = cutoff.min(500.0 / psf.spacing_um);
    let mut plot =
        Plot::new("MTF against frequency", "spatial frequency, cycles/mm", "modulation, 1");
    plot.x_range(0.0, top).y_range(0.0, 1.0);
    plot.note(&format!("At {}. {DIRECTIONS}", wave(nm)));
    let frequencies: Vec<f64> =
        (0..=POINTS).map(|i| top * f64::from(i) / f64::from(POINTS)).collect();
    let limit = |f: f64| {
        let v = (f / cutoff).min(1.0);
        2.0 / PI * (libm::acos(v) - v * (1.0 - v * v).sqrt())
    };
    let points = frequencies.iter().map(|&f| [f, limit(f)]).collect();
    plot.series("diffraction limit", Mark::Dashed, Colour::Reference, points);
    for (i, &h) in super::few_indices(psf.heights_mm.len(), HEIGHTS).iter().enumerate() {
        for radial in [true, false] {
            let line = line_spread(psf.psf(h, w), psf.size, radial);
            let points =
                frequencies.iter().map(|&f| [f, modulation(&line, f * psf.spacing_um * 1e-3)]);
            let (label, mark) = match radial {
                true => (format!("{} mm", number(psf.heights_mm[h])), Mark::Line),
                false => (String::new(), Mark::Dashed),
            };
            plot.series(&label, mark, Colour::Series(i), points.collect());
        }
    }
    if let Some(nyquist) = pixel_um.map(|p| 500.0 / p).filter(|n| *n < top) {
        plot.limit_x(nyquist, "Nyquist");
    }
    plot
}

/// MTF at one frequency over shifts of the sensor, µm: a characterisation for each.
pub(super) fn through_focus(shifted: &[(f64, Characterisation)], per_mm: f64) -> Option<Plot> {
    let (_, first) = shifted.first()?;
    let y = format!("modulation at {}, 1", per_mm_words(per_mm));
    let mut plot = Plot::new("Through-focus MTF", "sensor shift away from the lens, µm", &y);
    let (_, nm) = middle(first);
    plot.y_range(0.0, 1.0).limit_x(0.0, "sensor");
    plot.note(&format!("At {}. {DIRECTIONS}", wave(nm)));
    for (i, h) in (0..first.psf.heights_mm.len()).enumerate() {
        for radial in [true, false] {
            let at = |(shift_um, lens): &(f64, Characterisation)| {
                let (psf, (w, _)) = (&lens.psf, middle(lens));
                let line = line_spread(psf.psf(h, w), psf.size, radial);
                [*shift_um, modulation(&line, per_mm * psf.spacing_um * 1e-3)]
            };
            let (label, mark) = match radial {
                true => (format!("{} mm", number(first.psf.heights_mm[h])), Mark::Line),
                false => (String::new(), Mark::Dashed),
            };
            plot.series(&label, mark, Colour::Series(i), shifted.iter().map(at).collect());
        }
    }
    Some(plot)
}

/// Line spread function: the PSF summed over its columns (tangential) or its rows (sagittal).
fn line_spread(block: &[f32], size: usize, along_rows: bool) -> Vec<f64> {
    let mut line = vec![0.0; size];
    for (k, v) in block.iter().enumerate() {
        line[if along_rows { k / size } else { k % size }] += f64::from(*v);
    }
    line
}

/// |Fourier transform| at `cycles` per sample, relative to that at 0.
fn modulation(line: &[f64], cycles: f64) -> f64 {
    let (mut re, mut im, mut sum) = (0.0, 0.0, 0.0);
    for (k, v) in line.iter().enumerate() {
        let (s, c) = libm::sincos(TAU * cycles * k as f64);
        re += v * c;
        im += v * s;
        sum += v;
    }
    (re * re + im * im).sqrt() / sum
}

/// PSFs over field and wavelength.
pub(super) fn psfs(lens: &Characterisation) -> Plot {
    let psf = &lens.psf;
    let waves = super::few_indices(psf.wavelengths_nm.len(), WAVELENGTHS);
    let columns: Vec<String> = waves.iter().map(|&w| wave(psf.wavelengths_nm[w])).collect();
    let row = |h: usize| {
        // PSF rows rise away from the axis; in a picture, away from the axis is up.
        let picture = |w: usize| {
            let block = psf.psf(h, w);
            let n = psf.size;
            Plane::from_fn(n, n, |x, y| f64::from(block[(n - 1 - y) * n + x]))
        };
        (number(psf.heights_mm[h]), waves.iter().map(|&w| picture(w)).collect())
    };
    let rows: Vec<(String, Vec<Plane<f64>>)> =
        super::few_indices(psf.heights_mm.len(), PSF_ROWS).into_iter().map(row).collect();
    let side = psf.size as f64 * psf.spacing_um;
    let title = format!("Point-spread functions, each {} µm wide", number(side));
    let mut plot = picture_grid(&title, &columns, &rows, ["wavelength, nm", "image height, mm"]);
    plot.note("Square root, each relative to its own peak; away from the axis is up.");
    plot
}
