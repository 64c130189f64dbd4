//! Tuning files of libcamera for the Raspberry Pi.

use super::imported::{Beside, Imported, number, numbers};
use camrig_base::{Error, Result};
use camrig_camera::{Camera, LensKind, RelativeIllumination};
use camrig_linear::{LeastSquares, Matrix, Vector};
use serde_json::{Value as Json, json};

/// Largest sample of the numbers in a tuning file.
const TOP: f64 = 65_535.0;
/// The processor of Raspberry Pis before the fifth, and its columns and rows of `luminance_lut`.
const TARGET: &str = "bcm2835";
const GRID: [usize; 2] = [16, 12];
/// Lines of a table of relative illumination.
const FIELDS: usize = 17;
/// Powers of the field in the law of the fall-off: even ones, as a lens is round.
const POWERS: [f64; 4] = [0.0, 2.0, 4.0, 6.0];

/// What PRNU adds to the slope of noise over the root of the mean, by which pixels of even patches
/// differ: of a patch at half of the range, (1 + p² W/2) for a full well of W.
fn with_prnu(full_well_e: f64, prnu: f64) -> f64 {
    1.0 + 0.5 * prnu * prnu * full_well_e
}

pub(super) fn read(json: &Json, beside: &Beside) -> Result<Imported> {
    let algorithms: Vec<&Json> = json["algorithms"].as_array().into_iter().flatten().collect();
    let own = |name: &str| algorithms.iter().find_map(|a| a.get(name));
    let of = |name: &str, key: &str| number(own(name)?.get(key)?);
    let mut found = Imported::default();
    let from = "libcamera";
    let slope = of("rpi.noise", "reference_slope").filter(|slope| *slope > 0.0);
    let black = of("rpi.black_level", "black_level");
    let gains = own("rpi.alsc").and_then(|alsc| numbers(alsc.get("luminance_lut")?));
    if slope.is_none() && black.is_none() && gains.is_none() {
        return Err(Error::input("a tuning file without rpi.noise, rpi.black_level and rpi.alsc"));
    }
    if let Some(slope) = slope {
        let apparent = TOP / (slope * slope);
        let full = match beside.prnu {
            // W = A (1 + p² W/2).
            Some(p) => apparent / (1.0 - 0.5 * p * p * apparent).max(0.1),
            None => {
                found.notes.push(
                    "rpi.noise holds PRNU too, which is not known: of 0.8 % the full well is some \
                     15 % too low; give sensor.noise.prnu"
                        .into(),
                );
                apparent
            }
        };
        found.add("sensor.full_well_e", full, from);
    }
    if let Some(black) = black {
        let bits = beside.bits("a black level on 16 bits")?;
        found.add("sensor.black_level_dn", black * libm::exp2(bits - 16.0), from);
    }
    if let Some(gains) = gains {
        let target = json["target"].as_str().unwrap_or_default();
        add_fall_off(&mut found, &gains, target, beside)?;
    }
    if own("rpi.ccm").is_some() || own("rpi.awb").is_some_and(|awb| awb.get("ct_curve").is_some())
    {
        found.notes.push(
            "rpi.ccm and ct_curve are left out: a camera file has spectra of its channels, which \
             matrices and ratios do not tell; give sensor.qe"
                .into(),
        );
    }
    Ok(found)
}

/// Columns and rows of `luminance_lut`, by the processor that the file is for.
fn grid(target: &str) -> Option<[usize; 2]> {
    match target {
        TARGET => Some(GRID),
        "pisp" => Some([32, 32]),
        _ => None,
    }
}

/// Field of a cell, 0 at the axis and 1 at the corner.
fn field(cell: usize, [columns, rows]: [usize; 2], size: [f64; 2]) -> f64 {
    let of = |i: usize, n: usize, length: f64| ((i as f64 + 0.5) / n as f64 - 0.5) * length;
    let at = libm::hypot(of(cell % columns, columns, size[0]), of(cell / columns, rows, size[1]));
    at / (0.5 * libm::hypot(size[0], size[1]))
}

/// Relative illumination, the reciprocal of the gains: its part that is round about the axis.
fn add_fall_off(found: &mut Imported, gains: &[f64], target: &str, beside: &Beside) -> Result<()> {
    let cells = grid(target).filter(|[columns, rows]| columns * rows == gains.len());
    let cells = cells.ok_or_else(|| {
        Error::input(format!("luminance_lut of {} numbers for target {target:?}", gains.len()))
            .help("16 x 12 for bcm2835, 32 x 32 for pisp")
    })?;
    if !gains.iter().all(|gain| *gain > 0.0) {
        return Err(Error::input("luminance_lut").help("gains are above 0"));
    }
    let size = beside.size.ok_or_else(|| {
        Error::input("a table of fall-off over the sensor").help("give its columns and rows")
    })?;
    let law = |field: f64, j: usize| libm::pow(field, POWERS[j]);
    let fields: Vec<f64> = (0..gains.len()).map(|i| field(i, cells, size)).collect();
    let design = Matrix::from_fn(gains.len(), POWERS.len(), |i, j| law(fields[i], j));
    let target = Vector::from_fn(gains.len(), |i, _| gains[i].recip());
    let fit = LeastSquares::of(&design, &target)
        .ok_or_else(|| Error::input("luminance_lut of one field"))?;
    let at = |field: f64| -> f64 {
        (0..POWERS.len()).map(|j| fit.coefficients[j] * law(field, j)).sum()
    };
    let centre = at(0.0);
    let field_of = |i: usize| i as f64 / (FIELDS - 1) as f64;
    let lines = (0..FIELDS).map(field_of).map(|h| format!("{h},{:.5}\n", at(h) / centre));
    let name = format!("{}-illumination.csv", beside.name);
    found.add("lens.relative_illumination", name.clone(), "libcamera");
    found.tables.push((name, format!("field,ratio\n{}", lines.collect::<String>())));
    let rest = (fit.chi2 / gains.len() as f64).sqrt() / centre;
    found.notes.push(format!(
        "fall-off by luminance_lut: {:.2} at the corner; {:.1} % rms of it is not round about the \
         axis, and left out",
        at(1.0) / centre,
        100.0 * rest
    ));
    Ok(())
}

/// Relative illumination over the field, 0 at the axis and 1 at the corner, of a lens that is
/// described by key parameters; straight lines between the fields of a table.
fn illumination(camera: &Camera, field: f64) -> Option<f64> {
    let LensKind::DiffractionLimited { focal_length_mm, relative_illumination, .. } =
        &camera.lens.kind
    else {
        return None;
    };
    let sensor = &camera.sensor;
    Some(match relative_illumination {
        RelativeIllumination::Flat => 1.0,
        RelativeIllumination::Cos4 => {
            let diagonal = libm::hypot(sensor.width as f64, sensor.height as f64);
            let tangent = field * 0.5e-3 * sensor.pitch_um * diagonal / focal_length_mm;
            (1.0 + tangent * tangent).powi(2).recip()
        }
        RelativeIllumination::Table(table) => {
            let beyond = table.iter().position(|(h, _)| *h >= field)?.max(1);
            let ((a, low), (b, high)) = (table[beyond - 1], table[beyond]);
            low + (high - low) * (field - a) / (b - a)
        }
    })
}

/// A tuning file of libcamera (JSON) for `camera`: `rpi.black_level`, `rpi.noise` and, for lenses
/// that are described by key parameters, `rpi.alsc`.
pub fn to_tuning(camera: &Camera) -> Json {
    let sensor = &camera.sensor;
    let full = f64::from((1u32 << sensor.bits) - 1) / sensor.at_gain(1.0).dn_per_e;
    let slope = (TOP / full * with_prnu(full, sensor.noise.prnu)).sqrt();
    let black = sensor.black_level_dn * libm::exp2(16.0 - f64::from(sensor.bits));
    let mut algorithms = vec![
        json!({ "rpi.black_level": { "black_level": black.round() } }),
        json!({ "rpi.noise": { "reference_constant": 0, "reference_slope": slope } }),
    ];
    let size = [sensor.width as f64, sensor.height as f64];
    let cells = 0..GRID[0] * GRID[1];
    let all: Option<Vec<f64>> =
        cells.map(|i| illumination(camera, field(i, GRID, size))).collect();
    if let Some(all) = all {
        let most = all.iter().copied().fold(0.0, f64::max);
        let gains: Vec<f64> = all.iter().map(|v| most / v).collect();
        algorithms.push(json!({ "rpi.alsc": { "luminance_lut": gains } }));
    }
    json!({ "version": 2.0, "target": TARGET, "algorithms": algorithms })
}
