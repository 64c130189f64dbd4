//! What `camrig lens` prints about a lens.

use super::InfoArgs;
use crate::screen;
use camrig_base::{Result, Spectrum};
use camrig_lens::System;
use camrig_lens::characterise::FieldPoint;
use camrig_lens::field;
use camrig_lens::prescription::{Form, Medium, Object, Prescription};
use camrig_optics::{Between, Characterisation, LensTables, PlaneCharacterisation};
use serde_json::{Value, json};

/// A characterisation in one line.
pub(super) fn summary(lens: &Characterisation) -> String {
    let least = lens.psf.captured.iter().flatten().copied().fold(1.0, f64::min);
    let between = blending(lens.psf.between, "heights");
    format!(
        "{} heights to {:.3} mm, {} wavelengths, {} PSFs of {}x{} at {} µm holding {:.1} % of \
         the light or more{between}",
        lens.heights_mm.len(),
        lens.heights_mm.last().copied().unwrap_or(0.0),
        lens.wavelengths_nm.len(),
        lens.psf.heights_mm.len() * lens.psf.wavelengths_nm.len(),
        lens.psf.size,
        lens.psf.size,
        lens.psf.spacing_um,
        100.0 * least
    )
}

/// A characterisation over the plane of the image in one line.
pub(super) fn plane_summary(lens: &PlaneCharacterisation) -> String {
    let least = lens.captured.iter().copied().fold(1.0, f64::min);
    let between = blending(lens.between, "places");
    let ends = |axis: &[f64]| [axis[0], axis[axis.len() - 1]];
    let ([left, right], [top, bottom]) = (ends(&lens.x_mm), ends(&lens.y_mm));
    format!(
        "{} x {} places, {left:.3} to {right:.3} mm right and {top:.3} to {bottom:.3} mm down, {} \
         wavelengths, PSFs of {}x{} at {} µm holding {:.1} % of the light or more{between}",
        lens.x_mm.len(),
        lens.y_mm.len(),
        lens.wavelengths_nm.len(),
        lens.psf_size,
        lens.psf_size,
        lens.psf_spacing_um,
        100.0 * least
    )
}

/// Error of interpolating between tabulated PSFs, if it is known.
fn blending(between: Option<Between>, stations: &str) -> String {
    between.map_or_else(String::new, |b| {
        format!(
            ", interpolating between {stations} misplaces {:.2} % of it (mean; {:.2} % worst) on \
             pixels of {} µm",
            100.0 * b.misplaced_mean,
            100.0 * b.misplaced_largest,
            b.pixel_um
        )
    })
}

/// Figures of a field point.
pub(super) fn point_json(p: &FieldPoint) -> Value {
    json!({
        "field_deg": p.field_deg,
        "wavelength_nm": p.wavelength_nm,
        "chief_ray_height_mm": p.chief_ray_height_mm,
        "cra_deg": p.cra_deg,
        "relative_illumination": p.relative_illumination,
        "distortion_percent": p.distortion_percent,
        "projected_solid_angle_sr": p.projected_solid_angle_sr,
        "opd_rms_waves": p.opd_rms_waves,
        "spot_rms_mm": p.spot_rms_mm,
    })
}

/// Paraxial figures of a prescription.
pub(super) fn figures(system: &System) -> Value {
    let (p, lens) = (&system.paraxial, &system.prescription);
    json!({
        "name": lens.name,
        "efl_mm": p.efl_mm,
        "f_number": system.f_number(),
        "reference_nm": lens.reference_nm,
        "bfl_mm": p.bfl_mm,
        "image_distance_mm": p.image_distance_mm,
        "sensor_distance_mm": sensor_distance_mm(system),
        "magnification": p.magnification,
        "object_distance_mm": match lens.object {
            Object::Infinity => Value::Null,
            Object::Distance(d) => d.into(),
        },
        "entrance_pupil_mm": system.entrance_pupil_mm,
        "entrance_pupil_z_mm": p.entrance_z_mm,
        "exit_pupil_z_mm": p.exit_z_mm,
        "pupil_magnification": p.pupil_magnification(),
        "stop_radius_mm": system.stop_radius_mm,
        "stop_surface": lens.stop + 1,
        "notes": lens.notes,
    })
}

/// From the last vertex to the sensor, mm.
fn sensor_distance_mm(system: &System) -> f64 {
    system.prescription.surfaces.last().map_or(0.0, |s| s.thickness)
}

/// The plane that the figures refer to.
fn planes(system: &System) -> String {
    let (sensor, image) = (sensor_distance_mm(system), system.paraxial.image_distance_mm);
    let ideal = match system.prescription.object {
        Object::Infinity => "EFL·tan θ",
        Object::Distance(_) => "|m|·object height",
    };
    format!(
        "heights, CRA, spots and PSFs are at the sensor, {sensor:.6} mm behind the last surface; \
         the paraxial image is at {image:.6} mm\n\
         distortion is relative to {ideal} of the paraxial image: if the sensor is elsewhere, it \
         does not tend to 0 on the axis"
    )
}

/// Figures of a point of a two-dimensional field.
pub(super) fn place_json(p: &field::Point, map: &field::Map) -> Value {
    json!({
        "field_x_deg": p.field_deg[0],
        "field_y_deg": p.field_deg[1],
        "wavelength_nm": p.wavelength_nm,
        "chief_ray_x_mm": p.chief_mm[0],
        "chief_ray_y_mm": p.chief_mm[1],
        "cra_x_deg": p.cra_deg[0],
        "cra_y_deg": p.cra_deg[1],
        "linear_x_mm": p.linear_mm[0],
        "linear_y_mm": p.linear_mm[1],
        "distortion_percent": p.distortion_percent(map.middle_mm),
        "relative_illumination": p.relative_illumination,
        "projected_solid_angle_sr": p.projected_solid_angle_sr,
        "spot_rms_mm": p.spot_rms_mm,
    })
}

/// The linear map at the centre of the field.
pub(super) fn map_json(map: &field::Map) -> Value {
    json!({
        "middle_mm": map.middle_mm,
        "by_tan_x_mm": map.slopes_mm[0],
        "by_tan_y_mm": map.slopes_mm[1],
    })
}

/// Figures over a two-dimensional field as a table.
pub(super) fn print_places(system: &System, map: &field::Map, points: &[field::Point]) {
    let [x, y] = map.slopes_mm;
    println!(
        "not rotationally symmetric: {}\n\
         EFL {:.6} mm in y, f/{:.4}, stop radius {:.6} mm (at {} nm, without tilts and decentres)\n\
         the field point (0, 0) lands at ({:.6}, {:.6}) mm; around it (x, y) change by \
         ({:.6}, {:.6}) mm per tan θx and ({:.6}, {:.6}) mm per tan θy, against which distortion \
         is told",
        system.prescription.asymmetry().unwrap_or_default(),
        system.paraxial.efl_mm,
        system.f_number(),
        system.stop_radius_mm,
        system.prescription.reference_nm,
        map.middle_mm[0],
        map.middle_mm[1],
        x[0],
        x[1],
        y[0],
        y[1],
    );
    println!(
        "{:>9} {:>9} {:>8} {:>12} {:>12} {:>10} {:>10} {:>9} {:>11} {:>11}",
        "field x",
        "field y",
        "nm",
        "x mm",
        "y mm",
        "CRA x deg",
        "CRA y deg",
        "rel. ill.",
        "distortion",
        "spot mm rms"
    );
    for p in points {
        println!(
            "{:>9.3} {:>9.3} {:>8.1} {:>12.6} {:>12.6} {:>10.5} {:>10.5} {:>9} {:>9.4} % \
             {:>11.6}",
            p.field_deg[0],
            p.field_deg[1],
            p.wavelength_nm,
            p.chief_mm[0],
            p.chief_mm[1],
            p.cra_deg[0],
            p.cra_deg[1],
            match p.relative_illumination.is_nan() {
                true => "-".into(),
                false => format!("{:.6}", p.relative_illumination),
            },
            p.distortion_percent(map.middle_mm),
            p.spot_rms_mm
        );
    }
}

/// Figures of field points as a table.
pub(super) fn print_points(system: &System, points: &[FieldPoint]) {
    println!(
        "EFL {:.6} mm, f/{:.4}, stop radius {:.6} mm (at {} nm)",
        system.paraxial.efl_mm,
        system.f_number(),
        system.stop_radius_mm,
        system.prescription.reference_nm
    );
    println!("{}", planes(system));
    println!(
        "{:>9} {:>8} {:>12} {:>10} {:>9} {:>11} {:>10} {:>11}",
        "field deg",
        "nm",
        "height mm",
        "CRA deg",
        "rel. ill.",
        "distortion",
        "OPD waves",
        "spot mm rms"
    );
    for p in points {
        // From 90° off the axis on there is no paraxial height.
        let distortion = match p.distortion_percent.is_nan() {
            true => "-".into(),
            false => format!("{:.4} %", p.distortion_percent),
        };
        println!(
            "{:>9.3} {:>8.1} {:>12.6} {:>10.5} {:>9.6} {distortion:>11} {:>10.4} {:>11.6}",
            p.field_deg,
            p.wavelength_nm,
            p.chief_ray_height_mm,
            p.cra_deg,
            p.relative_illumination,
            p.opd_rms_waves,
            p.spot_rms_mm
        );
    }
}

/// Figures and surfaces of a prescription, and what was assumed and ignored.
pub(super) fn info(args: &InfoArgs) -> Result<()> {
    let system = camrig_lens_files::system(&args.lens.setup())?;
    let lens = &system.prescription;
    let place = |e: camrig_base::Error| e.at(args.lens.file.display());
    let asymmetry = lens.asymmetry();
    let (fields, listed) = match asymmetry {
        Some(_) => {
            let places = system.field_places_deg().map_err(place)?;
            (json!(places), format!("{places:?}"))
        }
        None => {
            let fields = system.fields_deg().map_err(place)?;
            (json!(fields), format!("{fields:?}"))
        }
    };
    if args.json {
        lens.notes.iter().for_each(|note| eprintln!("note: {note}"));
        let mut object = figures(&system);
        object["fields_deg"] = fields;
        object["rotationally_symmetric"] = asymmetry.is_none().into();
        object["efl_x_mm"] = system.efl_x_mm()?.into();
        object["wavelengths_nm"] = lens.wavelengths_nm.clone().into();
        object["wavelength_weights"] = lens.wavelength_weights.clone().into();
        object["surfaces"] = lens.surfaces.len().into();
        println!("{object}");
        return Ok(());
    }
    let p = &system.paraxial;
    let mut text = vec![
        lens.name.clone(),
        format!("EFL {:.6} mm, f/{:.4}, at {} nm", p.efl_mm, system.f_number(), lens.reference_nm),
        match lens.object {
            Object::Infinity => format!("object at infinity, back focus {:.6} mm", p.bfl_mm),
            Object::Distance(d) => format!(
                "object {d} mm in front of the first surface, magnification {:.6}, back focus \
                 {:.6} mm",
                p.magnification, p.bfl_mm
            ),
        },
        planes(&system),
        format!(
            "entrance pupil {:.6} mm at z {:.6} mm, stop (surface {}) radius {:.6} mm",
            system.entrance_pupil_mm,
            p.entrance_z_mm,
            lens.stop + 1,
            system.stop_radius_mm
        ),
    ];
    if let Some(why) = asymmetry {
        text.push(format!(
            "not rotationally symmetric: {why}; figures are those without tilts and decentres in \
             the plane of y and z (EFL {:.6} mm in x)",
            system.efl_x_mm()?
        ));
    }
    let weights = &lens.wavelength_weights;
    let weighted = match weights.iter().all(|weight| *weight == weights[0]) {
        true => String::new(),
        false => format!(", weights {weights:?} in MTFs of several"),
    };
    text.push(format!("fields {listed}°, wavelengths {:?} nm{weighted}", lens.wavelengths_nm));
    text.push(match lens.notes.is_empty() {
        true => "assumed and ignored: nothing that changes the image".into(),
        false => "assumed and ignored:".into(),
    });
    text.extend(lens.notes.iter().map(|note| format!("  {note}")));
    let mut lines: Vec<String> = text.iter().flat_map(|text| screen::wrapped(text)).collect();
    let surfaces = surface_lines(lens);
    if args.surfaces || lines.len() + surfaces.len() <= screen::LINES {
        lines.extend(surfaces);
    } else {
        lines.push(format!("{} surfaces: --surfaces lists them", lens.surfaces.len()));
    }
    lines.iter().for_each(|line| println!("{line}"));
    Ok(())
}

fn print_screen(text: &[String]) {
    let lines = text.iter().flat_map(|text| screen::wrapped(text));
    lines.for_each(|line| println!("{line}"));
}

/// The surfaces as a table.
fn surface_lines(lens: &Prescription) -> Vec<String> {
    let mut lines = vec![format!(
        "{:>3} {:>14} {:>12} {:>12} {:>16} {:>10}",
        "", "radius mm", "thickness", "aperture", "behind", "conic"
    )];
    for (i, s) in lens.surfaces.iter().enumerate() {
        let radius =
            if s.curvature == 0.0 { "plane".into() } else { format!("{:.6}", 1.0 / s.curvature) };
        let openings = s.clips.iter().filter(|clip| clip.outer.is_finite());
        let opening =
            openings.min_by(|a, b| a.outer.total_cmp(&b.outer)).map_or_else(String::new, |clip| {
                match clip.is_round() {
                    true => format!("{:.5}", clip.outer),
                    false => format!("{:.3} x {:.3}", clip.outer, clip.outer * clip.aspect),
                }
            });
        let obscured = if s.clips.iter().any(|clip| clip.inner > 0.0) { " obscured" } else { "" };
        let behind = match &s.medium {
            Medium::Air => String::new(),
            Medium::Mirror => "mirror".into(),
            Medium::Glass(glass) => glass.name.clone(),
        };
        let mark = if i == lens.stop { " stop" } else { "" };
        let sag = match &s.form {
            Form::Plain if s.even.is_empty() && s.odd.is_empty() => "",
            Form::Plain => " + polynomial",
            Form::Forbes(_) => " + Forbes asphere",
            Form::Biconic { .. } => " (biconic)",
            Form::Toroid { .. } => " (toroid)",
            Form::Ideal { .. } => " (ideal lens)",
            Form::Break => " (coordinates only)",
        };
        let placed =
            if s.entry.is_some() || s.exit.is_some() { " tilted or decentred" } else { "" };
        lines.push(format!(
            "{:>3} {radius:>14} {:>12.6} {opening:>12} {behind:>16} {:>10.5}{sag}{placed}{obscured}\
             {mark}",
            i + 1,
            s.thickness,
            s.conic
        ));
    }
    lines
}

/// The contents of a characterisation.
pub(super) fn info_of_directory(args: &InfoArgs) -> Result<()> {
    let lens = match LensTables::read(&args.lens.file)? {
        LensTables::Heights(lens) => lens,
        LensTables::Plane(lens) => {
            info_of_plane(&lens, args.json);
            return Ok(());
        }
    };
    if args.json {
        let object = json!({
            "name": lens.name,
            "source": lens.source,
            "efl_mm": lens.efl_mm,
            "f_number": lens.f_number,
            "magnification": lens.magnification,
            "axis_solid_angle_sr": lens.projected_solid_angle_sr(),
            "axis_solid_angle_traced": lens.axis_solid_angle_sr.is_some(),
            "stop_radius_mm": lens.stop_radius_mm,
            "heights_mm": lens.heights_mm,
            "wavelengths_nm": lens.wavelengths_nm,
            "psf_heights_mm": lens.psf.heights_mm,
            "psf_wavelengths_nm": lens.psf.wavelengths_nm,
            "psf_size": lens.psf.size,
            "psf_spacing_um": lens.psf.spacing_um,
            "psf_captured": lens.psf.captured,
            "psf_between": lens.psf.between,
            "transmittance": samples(&lens.transmittance),
        });
        println!("{object}");
        return Ok(());
    }
    let ends = |axis: &[f64]| [axis[0], axis[axis.len() - 1]];
    let ([first, last], [psf_first, psf_last]) =
        (ends(&lens.wavelengths_nm), ends(&lens.psf.wavelengths_nm));
    print_screen(&[
        format!("{} ({})", lens.name, lens.source),
        format!(
            "EFL {:.6} mm, f/{:.4}, magnification {}",
            lens.efl_mm, lens.f_number, lens.magnification
        ),
        summary(&lens),
        format!(
            "projected solid angle of the pupil on the axis {:.6} sr, {}",
            lens.projected_solid_angle_sr(),
            match lens.axis_solid_angle_sr {
                Some(_) => "from real rays",
                None => "from the f-number, π/(1 + 4 N²): real lenses differ by some per cent",
            }
        ),
        format!(
            "distortion and relative illumination of {first} to {last} nm; PSFs to {} mm, of \
             {psf_first} to {psf_last} nm; chief-ray angles {}",
            ends(&lens.psf.heights_mm)[1],
            if lens.chief_ray_angle_deg.is_some() { "known" } else { "not known" },
        ),
        transmittance(&lens.transmittance),
        BEYOND.into(),
    ]);
    Ok(())
}

/// The contents of a characterisation over the image plane.
fn info_of_plane(lens: &PlaneCharacterisation, as_json: bool) {
    if as_json {
        let object = json!({
            "name": lens.name,
            "source": lens.source,
            "principal_distance_mm": lens.principal_distance_mm,
            "working_f_number": lens.working_f_number,
            "x_mm": lens.x_mm,
            "y_mm": lens.y_mm,
            "wavelengths_nm": lens.wavelengths_nm,
            "psf_size": lens.psf_size,
            "psf_spacing_um": lens.psf_spacing_um,
            "psf_captured": lens.captured,
            "psf_between": lens.between,
            "transmittance": samples(&lens.transmittance),
        });
        println!("{object}");
        return;
    }
    let nm = &lens.wavelengths_nm;
    print_screen(&[
        format!("{} ({}), not rotationally symmetric", lens.name, lens.source),
        format!(
            "principal distance {:.6} mm, f/{:.4} at the image (by the solid angle of real rays)",
            lens.principal_distance_mm, lens.working_f_number
        ),
        plane_summary(lens),
        format!("all of {} to {} nm; chief-ray angles not known", nm[0], nm[nm.len() - 1]),
        transmittance(&lens.transmittance),
        BEYOND.into(),
    ]);
}

/// What is assumed beyond a lens's tables.
const BEYOND: &str = "assumed: beyond the tables distortion continues along its last slope; \
                      relative illumination, PSFs and other wavelengths keep their last values; \
                      a note says so if a sensor reaches that far. The focus is fixed: there is no \
                      wavefront";

fn samples(curve: &Spectrum) -> Vec<(f64, f64)> {
    curve.samples().collect()
}

fn transmittance(curve: &Spectrum) -> String {
    let samples = samples(curve);
    match samples[..] {
        [(_, value)] => format!("transmittance {value} at all wavelengths"),
        _ => {
            let (first, last) = curve.range_nm();
            format!("transmittance of {} wavelengths, {first} to {last} nm", samples.len())
        }
    }
}
