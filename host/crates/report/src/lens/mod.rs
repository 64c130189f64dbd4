//! The page and the drawings of a lens: section, aberrations, illumination, MTF, point-spread
//! functions, spots.

mod curves;
mod section;

use super::numbers::{amount, fixed, number};
use super::page::{KeyFigure, Page, Table};
use super::plot::{Colour, Mark, Plot};
use camrig_base::Result;
use camrig_lens::characterise::{Plan, PsfMethod};
use camrig_lens::prescription::{Medium, Object};
use camrig_lens::section::{Foci, foci};
use camrig_lens::{System, characterise};
use camrig_optics::Characterisation;
use curves::Named;

/// A drawing as a separate file.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// Name of the file, without extension.
    pub name: String,
    /// SVG text.
    pub svg: String,
}

/// Foci over the field at a wavelength.
struct FociAt {
    nm: f64,
    foci: Vec<Foci>,
}

/// Fields in section and of MTF over focus, as parts of the largest: axis, half the area, corner.
const FIELDS: [f64; 3] = [0.0, 0.7, 1.0];
/// Rays of each field.
const RAYS: usize = 5;
/// Fields of the curves of foci.
const FOCI: u32 = 30;
/// Shifts of the sensor on each side; they reach beyond what field curvature needs, and over the
/// depth of focus 2·λN² at least this many times.
const SHIFTS: i32 = 6;
const DEPTHS: [f64; 2] = [2.0, 16.0];
const BEYOND: f64 = 1.3;
/// Maximum number of wavelengths drawn.
const WAVELENGTHS: usize = 3;
/// Samples per side of the PSFs over focus.
const PSF_SIZE: usize = 64;

/// A prescription that a characterisation was traced from.
#[derive(Clone, Copy, Debug)]
pub struct Traced<'a> {
    /// The lens.
    pub system: &'a System,
    /// Largest field, degrees.
    pub max_field_deg: f64,
}

/// The drawings of a characterised lens. `pixel_um` is the side of the pixels that it is for.
pub fn drawings(lens: &Characterisation, pixel_um: Option<f64>) -> Vec<Drawing> {
    let mut all = curves::of_tables(lens, pixel_um);
    all.extend(curves::of_psfs(lens, pixel_um));
    all.push(Named { name: "psf", plot: curves::psfs(lens) });
    let drawing = |named: Named| Drawing { name: named.name.into(), svg: named.plot.file() };
    all.into_iter().map(drawing).collect()
}

/// The page of a characterised lens; of a traced one with its section, prescription, field
/// curvature and MTF over focus. `pixel_um` is the side of the pixels that it is for.
///
/// # Errors
/// Rays that are lost.
pub fn page(
    lens: &Characterisation,
    traced: Option<Traced<'_>>,
    pixel_um: Option<f64>,
) -> Result<Page> {
    let mut page = Page::new(if lens.name.is_empty() { "Lens" } else { &lens.name });
    page.kind("Lens").subtitle(&lens.source);
    page.key_figures(&key_figures(lens, traced)?);
    if let Some(traced) = traced {
        for note in &traced.system.prescription.notes {
            page.note(note);
        }
        prescription(&mut page, traced)?;
    }
    let mut tables: Vec<Plot> = Vec::new();
    let mut focused = None;
    if let Some(traced) = traced {
        let foci = curvature(traced)?;
        focused = through_focus(lens, traced, &foci);
        tables.push(foci_plot(&foci));
    }
    tables.extend(curves::of_tables(lens, pixel_um).into_iter().map(|named| named.plot));
    page.heading("Aberrations and illumination").grid(|page| {
        tables.iter().for_each(|plot| {
            page.plot(plot);
        });
    });
    page.heading("Sharpness").grid(|page| {
        for named in curves::of_psfs(lens, pixel_um) {
            page.plot(&named.plot);
        }
        focused.iter().for_each(|plot| {
            page.plot(plot);
        });
        page.plot(&curves::psfs(lens));
    });
    Ok(page)
}

fn key_figures(lens: &Characterisation, traced: Option<Traced<'_>>) -> Result<Vec<KeyFigure>> {
    let nm = lens.wavelengths_nm[lens.wavelengths_nm.len() / 2];
    let heights = &lens.heights_mm;
    let top = heights.last().copied().unwrap_or(0.0);
    let mut focal = KeyFigure::new("Focal length", &format!("{}\u{a0}mm", fixed(lens.efl_mm, 3)));
    let f_number = format!("f/{}", fixed(lens.f_number, 2));
    focal = match traced {
        Some(t) => {
            let back = fixed(t.system.paraxial.bfl_mm, 3);
            focal.below(&format!("{f_number}, back focus {back}\u{a0}mm"))
        }
        None => focal.below(&f_number),
    };
    let (curve, light) = (lens.distortion(nm), lens.illumination(nm));
    let height = KeyFigure::new("Image height", &format!("{}\u{a0}mm", fixed(curve.at(top), 2)));
    let height = match traced {
        Some(t) => height.below(&format!("at {}°", number(t.max_field_deg))),
        None => height.below("at the largest field"),
    };
    let off = heights.iter().filter(|h| **h > 0.0).map(|&h| 100.0 * (curve.at(h) / h - 1.0));
    let most = off.fold(0.0_f64, |most, v| if v.abs() > most.abs() { v } else { most });
    let waves = curves::wave(nm);
    let mut all = vec![
        focal,
        height,
        KeyFigure::new("Distortion", &format!("{}\u{a0}%", fixed(most, 1)))
            .below(&format!("largest, {waves}")),
        KeyFigure::new("Illumination", &format!("{}\u{a0}%", fixed(100.0 * light.at(top), 0)))
            .below(&format!("at the largest field, {waves}")),
    ];
    if let Some(t) = traced {
        let points = characterise::field_points(t.system, &[0.0], &[nm])?;
        let spot = 1e3 * points[0].spot_rms_mm;
        all.push(
            KeyFigure::new("Spot on the axis", &amount(spot, None, "µm"))
                .below(&format!("rms radius of the rays, {waves}")),
        );
    }
    Ok(all)
}

/// The section with rays of three fields, and the surfaces.
fn prescription(page: &mut Page, traced: Traced<'_>) -> Result<()> {
    let fields = FIELDS.map(|part| part * traced.max_field_deg);
    let drawn = camrig_lens::section::section(traced.system, &fields, RAYS)?;
    let lens = &traced.system.prescription;
    let caption = format!(
        "Rays at {}; surfaces without an aperture are drawn as wide as the rays need. {}",
        curves::wave(lens.reference_nm),
        match lens.object {
            Object::Infinity => "Object at infinity.".to_owned(),
            Object::Distance(mm) => format!("Object {} mm before the first surface.", number(mm)),
        }
    );
    let mut table = Table::new(&["surf."])
        .numbers(&["radius, mm", "thickness, mm"])
        .words(&["material"])
        .numbers(&["conic"])
        .words(&["asphere"]);
    for (i, s) in lens.surfaces.iter().enumerate() {
        let plane = s.curvature == 0.0;
        let stop = if i == lens.stop { " stop" } else { "" };
        table.row(vec![
            format!("{}{stop}", i + 1),
            if plane { "plane".into() } else { fixed(1.0 / s.curvature, 4) },
            fixed(s.thickness, 4),
            match &s.medium {
                Medium::Air => "air".into(),
                Medium::Mirror => "mirror".into(),
                Medium::Glass(glass) => glass.name.clone(),
            },
            if s.conic == 0.0 { "0".into() } else { fixed(s.conic, 3) },
            if s.even.is_empty() && s.odd.is_empty() { "no".into() } else { "yes".into() },
        ]);
    }
    page.evidence(
        |page| {
            page.drawing(&section::svg(&drawn, &fields), &caption);
        },
        |page| {
            page.subheading("Prescription").rows(&table);
        },
    );
    Ok(())
}

/// Foci over the field at a few wavelengths.
fn curvature(traced: Traced<'_>) -> Result<Vec<FociAt>> {
    let mut nm = traced.system.prescription.wavelengths_nm.clone();
    nm.sort_by(f64::total_cmp);
    nm.dedup();
    let at = |i: u32| traced.max_field_deg * f64::from(i) / f64::from(FOCI);
    let fields: Vec<f64> = (0..=FOCI).map(at).collect();
    few(&nm, WAVELENGTHS)
        .into_iter()
        .map(|nm| Ok(FociAt { nm, foci: foci(traced.system, &fields, nm)? }))
        .collect()
}

fn foci_plot(all: &[FociAt]) -> Plot {
    let mut plot =
        Plot::new("Field curvature", "image height, mm", "focus behind the sensor plane, µm");
    for FociAt { nm, foci } in all {
        let colour = Colour::of_wavelength(*nm);
        let of = |z: fn(&Foci) -> f64| foci.iter().map(|f| [f.height_mm, 1e3 * z(f)]).collect();
        plot.series(&curves::wave(*nm), Mark::Line, colour, of(|f| f.tangential_mm));
        plot.series("", Mark::Dashed, colour, of(|f| f.sagittal_mm));
    }
    plot.limit_y(0.0, "sensor");
    plot.note("Solid: tangential. Dashed: sagittal. Foci of rays close to the chief ray.");
    plot
}

/// MTF over shifts of the sensor that reach over the field's foci; none where a shift leaves no
/// light in the window of the PSFs.
fn through_focus(lens: &Characterisation, traced: Traced<'_>, foci: &[FociAt]) -> Option<Plot> {
    let nm = lens.psf.wavelengths_nm[lens.psf.wavelengths_nm.len() / 2];
    let depth_mm = 2e-6 * nm * lens.f_number * lens.f_number;
    let all = foci.iter().flat_map(|at| &at.foci).flat_map(|f| [f.sagittal_mm, f.tangential_mm]);
    let farthest = all.filter(|z| z.is_finite()).fold(0.0_f64, |m, z| m.max(z.abs()));
    let reach = (BEYOND * farthest).clamp(DEPTHS[0] * depth_mm, DEPTHS[1] * depth_mm);
    let shifted = |i: i32| {
        let shift_mm = reach * f64::from(i) / f64::from(SHIFTS);
        let plan = Plan {
            heights: FIELDS.len(),
            density: None,
            max_field_deg: traced.max_field_deg,
            wavelengths_nm: vec![nm],
            psf_size: PSF_SIZE,
            psf_spacing_um: None,
            method: PsfMethod::Auto,
        };
        let system = traced.system.with_sensor_shift(shift_mm).ok()?;
        let found = characterise::characterise(&system, &plan, &|_, _| ()).ok()?;
        Some((1e3 * shift_mm, found))
    };
    let shifted: Vec<_> = (-SHIFTS..=SHIFTS).map(shifted).collect::<Option<_>>()?;
    curves::through_focus(&shifted, curves::rounded(curves::cutoff(lens, nm) / 8.0))
}

/// Spot diagrams at field angles `fields` (degrees) for some wavelengths (nm): positions of rays
/// on the image plane relative to the chief ray of the reference wavelength, µm.
///
/// # Errors
/// Rays that are lost.
pub fn spots(system: &System, fields: &[f64], wavelengths: &[f64]) -> Result<Vec<Drawing>> {
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
        all.push(Drawing { name: format!("spot-{}", i + 1), svg: plot.file() });
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
