//! What `camrig lens` tells about a lens.

use super::InfoArgs;
use camrig_base::Result;
use camrig_lens::System;
use camrig_lens::characterise::FieldPoint;
use camrig_lens::prescription::{Medium, Object};
use camrig_optics::Characterisation;
use serde_json::{Value, json};

/// A characterisation in one line.
pub(super) fn summary(lens: &Characterisation) -> String {
    let least = lens.psf.captured.iter().flatten().copied().fold(1.0, f64::min);
    let between = match lens.psf.between {
        Some(b) => format!(
            ", blending between heights misplaces {:.2} % of it (mean; {:.2} % at worst) on \
             pixels of {} µm",
            100.0 * b.misplaced_mean,
            100.0 * b.misplaced_largest,
            b.pixel_um
        ),
        None => String::new(),
    };
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
        "magnification": p.magnification,
        "object_distance_mm": match lens.object {
            Object::Infinity => Value::Null,
            Object::Distance(d) => d.into(),
        },
        "entrance_pupil_mm": system.entrance_pupil_mm,
        "entrance_pupil_z_mm": p.entrance_z_mm,
        "exit_pupil_z_mm": p.exit_z_mm,
        "pupil_magnification": (p.exit_magnification / p.entrance_magnification).abs(),
        "stop_radius_mm": system.stop_radius_mm,
        "stop_surface": lens.stop + 1,
        "notes": lens.notes,
    })
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
        println!(
            "{:>9.3} {:>8.1} {:>12.6} {:>10.5} {:>9.6} {:>9.4} % {:>10.4} {:>11.6}",
            p.field_deg,
            p.wavelength_nm,
            p.chief_ray_height_mm,
            p.cra_deg,
            p.relative_illumination,
            p.distortion_percent,
            p.opd_rms_waves,
            p.spot_rms_mm
        );
    }
}

/// Figures and surfaces of a prescription.
pub(super) fn info(args: &InfoArgs) -> Result<()> {
    let system = args.lens.system()?;
    let lens = &system.prescription;
    let fields = system.fields_deg().map_err(|e| e.at(args.lens.file.display()))?;
    if args.json {
        let mut object = figures(&system);
        object["fields_deg"] = fields.into();
        object["wavelengths_nm"] = lens.wavelengths_nm.clone().into();
        object["surfaces"] = lens.surfaces.len().into();
        println!("{object}");
        return Ok(());
    }
    let p = &system.paraxial;
    println!("{}", lens.name);
    println!("EFL {:.6} mm, f/{:.4}, at {} nm", p.efl_mm, system.f_number(), lens.reference_nm);
    println!("back focus {:.6} mm, paraxial image at {:.6} mm", p.bfl_mm, p.image_distance_mm);
    println!(
        "entrance pupil {:.6} mm at z {:.6} mm, stop (surface {}) radius {:.6} mm",
        system.entrance_pupil_mm,
        p.entrance_z_mm,
        lens.stop + 1,
        system.stop_radius_mm
    );
    println!("fields {fields:?}°, wavelengths {:?} nm", lens.wavelengths_nm);
    println!(
        "{:>3} {:>14} {:>12} {:>12} {:>16} {:>10}",
        "", "radius mm", "thickness", "aperture", "behind", "conic"
    );
    for (i, s) in lens.surfaces.iter().enumerate() {
        let radius =
            if s.curvature == 0.0 { "plane".into() } else { format!("{:.6}", 1.0 / s.curvature) };
        let opening = s.clips.iter().map(|c| c.outer).fold(f64::INFINITY, f64::min);
        let opening = if opening.is_finite() { format!("{opening:.5}") } else { String::new() };
        let behind = match &s.medium {
            Medium::Air => String::new(),
            Medium::Mirror => "mirror".into(),
            Medium::Glass(glass) => glass.name.clone(),
        };
        let mark = if i == lens.stop { " stop" } else { "" };
        let sag = if s.even.is_empty() && s.odd.is_empty() { "" } else { " + polynomial" };
        println!(
            "{:>3} {radius:>14} {:>12.6} {opening:>12} {behind:>16} {:>10.5}{sag}{mark}",
            i + 1,
            s.thickness,
            s.conic
        );
    }
    Ok(())
}

/// What a characterisation holds.
pub(super) fn info_of_directory(args: &InfoArgs) -> Result<()> {
    let lens = Characterisation::read(&args.lens.file)?;
    if args.json {
        let object = json!({
            "name": lens.name,
            "source": lens.source,
            "efl_mm": lens.efl_mm,
            "f_number": lens.f_number,
            "magnification": lens.magnification,
            "stop_radius_mm": lens.stop_radius_mm,
            "heights_mm": lens.heights_mm,
            "wavelengths_nm": lens.wavelengths_nm,
            "psf_heights_mm": lens.psf.heights_mm,
            "psf_wavelengths_nm": lens.psf.wavelengths_nm,
            "psf_size": lens.psf.size,
            "psf_spacing_um": lens.psf.spacing_um,
            "psf_captured": lens.psf.captured,
            "psf_between": lens.psf.between,
        });
        println!("{object}");
    } else {
        println!("{} ({})", lens.name, lens.source);
        println!("EFL {:.6} mm, f/{:.4}", lens.efl_mm, lens.f_number);
        println!("{}", summary(&lens));
    }
    Ok(())
}
