//! The angles at which the light of a traced lens passes an interference filter.

use super::sensor_grid;
use camrig_base::Result;
use camrig_camera::{Camera, Directions, LensKind};
use camrig_lens::characterise::sin2_at_image;

/// Steps of image height from the axis to the sensor's corner, between which the angles of rays
/// are even in the square of the height.
const STEPS: usize = 16;

/// The camera with the angles of its lens's light on the infrared cut filter, where that is an
/// interference filter and the lens a prescription: rays are traced to heights up to the sensor's
/// corner. Where none reaches a height, those of the last that some reach stand for it.
///
/// # Errors
/// A prescription that cannot be read, does not image or is not rotationally symmetric.
pub fn with_filter_angles(mut camera: Camera) -> Result<Camera> {
    let reach_mm = sensor_grid(&camera).corner_mm();
    let (Some(angles), LensKind::Prescription(setup)) =
        (&mut camera.sensor.filter_angles, &camera.lens.kind)
    else {
        return Ok(camera);
    };
    let system = camrig_lens_files::system(setup)?;
    let mut sin2 = Vec::with_capacity(STEPS + 1);
    for step in 0..=STEPS {
        let field = match step {
            0 => Ok(0.0),
            _ => system.field_of_real_height(reach_mm * step as f64 / STEPS as f64),
        };
        let rays = field.and_then(|deg| sin2_at_image(&system, deg, Directions::RAYS));
        sin2.push(match (rays, sin2.last()) {
            (Ok(rays), _) => rays,
            (Err(_), Some(last)) => Vec::clone(last),
            (Err(e), None) => {
                return Err(e.at(format!("ir_cut_effective_index, {}", setup.file.display())));
            }
        });
    }
    angles.directions = Directions::Traced { sin2: sin2.into(), reach_mm };
    Ok(camera)
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::{Bands, Outside, Spectrum};
    use std::fmt::Write as _;

    const INDEX: f64 = 1.7;
    const GLASS: f64 = 1.5;

    /// A stop 1 mm before a plane and a hyperboloid, which focuses collimated light without error:
    /// a focal length of 10 mm, 5 / (n − 1).
    fn camera(f_number: f64, pitch_um: f64) -> Camera {
        let directory = tempfile::tempdir().unwrap();
        let lens = format!(
            "format = \"camrig-prescription/1\"\nwavelengths_nm = [550.0]\nfields_deg = [0.0]\n\
             [aperture]\nf_number = {f_number}\n\
             [[surface]]\nstop = true\nthickness_mm = 1.0\n\
             [[surface]]\nthickness_mm = 2.0\nglass = \"flat\"\n\
             [[surface]]\nradius_mm = -5.0\nconic = -2.25\nthickness_mm = 10.0\n\
             [glass.flat]\ntable_nm = [[400.0, {GLASS}], [700.0, {GLASS}]]\n"
        );
        std::fs::write(directory.path().join("lens.toml"), lens).unwrap();
        let even = |value: f64| -> String {
            (15..=55).map(|i| format!("{},{value}\n", 20 * i)).collect()
        };
        let table = |name: &str, header: &str, value: f64| {
            let text = format!("wavelength_nm,{header}\n{}", even(value));
            std::fs::write(directory.path().join(name), text).unwrap();
        };
        table("qe.csv", "mono", 0.5);
        table("ir.csv", "transmittance", 1.0);
        let mut text = String::from("name = \"traced\"\n[lens]\nkind = \"prescription\"\n");
        write!(
            text,
            "file = \"lens.toml\"\n[sensor]\nwidth = 64\nheight = 48\npitch_um = {pitch_um}\n\
             fill_factor = 1.0\ncfa = \"mono\"\nqe = \"qe.csv\"\nir_cut = \"ir.csv\"\n\
             ir_cut_effective_index = {INDEX}\nfull_well_e = 1e4\nbits = 12\n\
             black_level_dn = 0\n[sensor.noise]\nread_e = 1.0\ndark_current_e_per_s = 0.0\n\
             prnu = 0.0\n"
        )
        .unwrap();
        let file = directory.path().join("camera.toml");
        std::fs::write(&file, text).unwrap();
        let untraced = Camera::load(file.to_str().unwrap()).unwrap();
        assert_eq!(
            untraced.sensor.filter_angles.as_ref().unwrap().directions,
            Directions::Untraced
        );
        assert!(
            untraced
                .sensor
                .filter_angles
                .as_ref()
                .unwrap()
                .check_traced(&untraced.sensor)
                .is_err()
        );
        let mut camera = with_filter_angles(untraced).unwrap();
        let edges = vec![479.999, 480.001, 619.999, 620.001];
        let pass = Spectrum::new(edges, vec![0.0, 1.0, 1.0, 0.0]).unwrap();
        camera.sensor.ir_cut = Some(pass.outside(Outside::Zero));
        camera
    }

    /// The response of the centre relative to that without an angle, and the corner's to the
    /// centre's: of steep edges, 1 − ⟨sin²θ⟩/n² in even light.
    fn shares(camera: &Camera) -> [f64; 2] {
        let bands = Bands { start_nm: 400.0, step_nm: 10.0, count: 24 };
        let sum = |camera: &Camera| camera.sensor.response(&bands)[0].iter().sum::<f64>();
        let mut normal = camera.clone();
        normal.sensor.filter_angles = None;
        let table = camera.sensor.factors_over_the_field(&[], &bands).unwrap();
        let nodes = table.x.len() * table.y.len();
        let response = &camera.sensor.response(&bands)[0];
        let corner: f64 = response
            .iter()
            .enumerate()
            .map(|(b, r)| r * f64::from(table.factors[b * nodes]))
            .sum();
        [sum(camera) / sum(&normal), corner / sum(&normal)]
    }

    /// On the axis, a ray at the height y of the hyperboloid goes to the focus: tan θ is y over the
    /// distance from there. Even light before the lens is even over y².
    #[test]
    fn the_cone_of_a_lens_moves_its_filter_as_its_rays_do() {
        let f_number = 1.8;
        let camera = camera(f_number, 0.1);
        let (radius, mut mean) = (10.0 / f_number / 2.0, 0.0);
        // z of the surface, before its vertex: z = c y² / (1 + √(1 − (1 + k) c² y²)).
        const SHARES: usize = 4000;
        for i in 0..SHARES {
            let y2 = radius * radius * (i as f64 + 0.5) / SHARES as f64;
            let sag = y2 / 5.0 / (1.0 + (1.0 + 1.25 * y2 / 25.0).sqrt());
            mean += y2 / (y2 + (10.0 + sag).powi(2)) / SHARES as f64;
        }
        let right = 1.0 - mean / (INDEX * INDEX);
        let [centre, _] = shares(&camera);
        assert!((centre - right).abs() < 2e-5, "{centre} {right}");
        assert!(1.0 - right > 0.01);
    }

    /// In the corner, the chief ray refracted by Snell's law at the plane and at the hyperboloid;
    /// the stop is so narrow that it stands for all rays.
    #[test]
    fn the_chief_ray_of_a_lens_moves_its_filter() {
        let camera = camera(200.0, 90.0);
        let corner_mm = 40.0 * 90e-3;
        // The ray through the centre of the stop whose tangent is t: its height, and its sine.
        let chief = |t: f64| {
            let sine = t / (1.0 + t * t).sqrt() / GLASS;
            let inside = sine / (1.0 - sine * sine).sqrt();
            let sag = |y: f64| y * y / 5.0 / (1.0 + (1.0 + 1.25 * y * y / 25.0).sqrt());
            let mut y = t + 2.0 * inside;
            for _ in 0..60 {
                y = t + inside * (2.0 - sag(y));
            }
            // The normal leans by dz/dy of the surface, which curves towards the stop.
            let slope = y / 5.0 / (1.0 + 1.25 * y * y / 25.0).sqrt();
            let normal = libm::atan(slope);
            let turned = libm::asin(GLASS * libm::sin(libm::atan(inside) - normal)) + normal;
            (y + libm::tan(turned) * (10.0 + sag(y)), libm::sin(turned))
        };
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = f64::midpoint(low, high);
            if chief(middle).0 < corner_mm { low = middle } else { high = middle }
        }
        let sine = chief(low).1;
        let right = 1.0 - sine * sine / (INDEX * INDEX);
        let [centre, corner] = shares(&camera);
        assert!((corner - right).abs() < 2e-4, "{corner} {right}");
        assert!((centre - 1.0).abs() < 1e-5 && 1.0 - right > 5e-3, "{centre} {right}");
    }
}
