//! Drawings of a lens: distortion, illumination, chief-ray angle, MTF, point-spread functions,
//! spots.

use super::numbers::number;
use super::plot::{Colour, Mark, Plot, picture_grid};
use camrig_base::{Plane, Result};
use camrig_lens::{System, characterise};
use camrig_optics::Characterisation;
use std::f64::consts::{PI, TAU};

/// A drawing: a name for its file, and SVG text.
pub type Drawing = (&'static str, String);

/// The drawings of a characterised lens.
pub fn drawings(lens: &Characterisation) -> Vec<Drawing> {
    let nm = few(&lens.wavelengths_nm, 3);
    let curves = |title: &str, y: &str, value: &dyn Fn(f64, f64) -> f64| {
        let mut plot = Plot::new(title, "paraxial image height, mm", y);
        for &w in &nm {
            let points = lens.heights_mm.iter().map(|&h| [h, value(h, w)]).collect();
            plot.series(&format!("{w} nm"), Mark::Line, Colour::of_wavelength(w), points);
        }
        plot
    };
    let distortion = |h: f64, w: f64| match h > 0.0 {
        true => 100.0 * (lens.distortion(w).at(h) / h - 1.0),
        false => f64::NAN,
    };
    let mut all = vec![
        (
            "distortion",
            curves("Distortion", "real over paraxial height − 1, %", &distortion).file(),
        ),
        (
            "illumination",
            curves("Relative illumination", "ratio to the axis", &|h, w| {
                lens.illumination(w).at(h)
            })
            .y_range(0.0, 1.05)
            .file(),
        ),
    ];
    if lens.chief_ray_angle_deg.is_some() {
        let angle = |h: f64, w: f64| lens.chief_ray_angle(w).map_or(f64::NAN, |c| c.at(h));
        all.push((
            "chief-ray-angle",
            curves("Chief-ray angle", "chief-ray angle, °", &angle).file(),
        ));
    }
    all.push(("mtf", mtf(lens)));
    all.push(("psf", psfs(lens)));
    all
}

/// MTF at the middle PSF wavelength, radial (fringes across the radius) and tangential, at a few
/// field heights, with the diffraction limit of the f-number on the axis.
fn mtf(lens: &Characterisation) -> String {
    let psf = &lens.psf;
    let w = psf.wavelengths_nm.len() / 2;
    let nm = psf.wavelengths_nm[w];
    let cutoff = 1e6 / (nm * lens.f_number * (1.0 + lens.magnification));
    let top = cutoff.min(500.0 / psf.spacing_um);
    let mut plot =
        Plot::new(&format!("MTF at {nm} nm"), "spatial frequency, cycles/mm", "modulation");
    plot.x_range(0.0, top).y_range(0.0, 1.0);
    let frequencies: Vec<f64> = (0..=100).map(|i| top * f64::from(i) / 100.0).collect();
    let limit = |f: f64| {
        let v = (f / cutoff).min(1.0);
        2.0 / PI * (v.acos() - v * (1.0 - v * v).sqrt())
    };
    let points = frequencies.iter().map(|&f| [f, limit(f)]).collect();
    plot.series("diffraction limit", Mark::Dashed, Colour::Reference, points);
    for (i, &h) in few_indices(psf.heights_mm.len(), 3).iter().enumerate() {
        let block = psf.psf(h, w);
        for (name, mark, radial) in
            [("radial", Mark::Line, true), ("tangential", Mark::Dashed, false)]
        {
            let line = line_spread(block, psf.size, radial);
            let points =
                frequencies.iter().map(|&f| [f, modulation(&line, f * psf.spacing_um * 1e-3)]);
            let label = format!("{} mm {name}", number(psf.heights_mm[h]));
            plot.series(&label, mark, Colour::Series(i), points.collect());
        }
    }
    plot.file()
}

/// Line spread function: the PSF summed over its columns (radial) or its rows (tangential).
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

fn psfs(lens: &Characterisation) -> String {
    let psf = &lens.psf;
    let waves = few_indices(psf.wavelengths_nm.len(), 3);
    let columns: Vec<String> =
        waves.iter().map(|&w| format!("{} nm", psf.wavelengths_nm[w])).collect();
    let rows: Vec<(String, Vec<Plane<f64>>)> = few_indices(psf.heights_mm.len(), 5)
        .into_iter()
        .map(|h| {
            // PSF rows rise away from the axis; in a picture, away from the axis is up.
            let picture = |w: usize| {
                let block = psf.psf(h, w);
                let n = psf.size;
                Plane::from_fn(n, n, |x, y| f64::from(block[(n - 1 - y) * n + x]))
            };
            (number(psf.heights_mm[h]), waves.iter().map(|&w| picture(w)).collect())
        })
        .collect();
    let side = psf.size as f64 * psf.spacing_um;
    let title = format!("PSF, {side:.0} µm wide, square root; outward is up");
    picture_grid(&title, &columns, &rows, ["wavelength", "image height, mm"]).file()
}

/// Spot diagrams at field angles `fields` (degrees) for some wavelengths (nm): positions of rays
/// on the image plane relative to the chief ray of the reference wavelength, µm.
///
/// # Errors
/// Rays that are lost.
pub fn spots(
    system: &System,
    fields: &[f64],
    wavelengths: &[f64],
) -> Result<Vec<(String, String)>> {
    let reference = system.prescription.reference_nm;
    let mut all = Vec::with_capacity(fields.len());
    for (i, &deg) in fields.iter().enumerate() {
        let mut plot = Plot::new(&format!("Spot at {deg:.2}°"), "x, µm", "y, µm");
        let origin = characterise::landing_places(system, deg, reference, 0)?;
        let mut reach = 0.0_f64;
        for &nm in wavelengths {
            let places = characterise::landing_places(system, deg, nm, 24)?;
            let points: Vec<[f64; 2]> = places
                .iter()
                .map(|[x, y]| [1e3 * (x - origin[0][0]), 1e3 * (y - origin[0][1])])
                .collect();
            reach = points.iter().flatten().fold(reach, |a, v| a.max(v.abs()));
            let colour = Colour::of_wavelength(nm);
            plot.series(&format!("{nm} nm"), Mark::Points, colour, points);
        }
        plot.equal_units().x_range(-1.1 * reach, 1.1 * reach).y_range(-1.1 * reach, 1.1 * reach);
        all.push((format!("spot-{}", i + 1), plot.file()));
    }
    Ok(all)
}

fn few(values: &[f64], count: usize) -> Vec<f64> {
    few_indices(values.len(), count).into_iter().map(|i| values[i]).collect()
}

/// At most `count` of `0..len`, evenly spread, the ends among them.
fn few_indices(len: usize, count: usize) -> Vec<usize> {
    if len <= count {
        return (0..len).collect();
    }
    (0..count).map(|i| i * (len - 1) / (count - 1)).collect()
}
