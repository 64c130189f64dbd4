//! What a drawing of a lens shows: its surfaces in section, rays of a field, and where rays close
//! to the chief ray meet.

use super::prescription::Medium;
use super::pupil::{Beam, Bundle};
use super::system::System;
use super::trace::LANES;
use camrig_base::Result;

/// Places over the pupil at which the rim of a beam is looked for, and how far beyond the paraxial
/// pupil's radius: pupils of wide fields grow.
const RIM_PLACES: u32 = 240;
const BEYOND: f64 = 2.0;
/// Distance of close rays from the chief ray, in diameters of the pupil: far above rounding, and
/// far below where aberrations of higher order count.
const CLOSE: f64 = 1e-4;
/// Points of a surface's curve.
const POINTS: u32 = 48;
/// How far a surface without an aperture is drawn beyond the outermost ray.
const RIM: f64 = 1.04;

/// A place in the section: z from the first vertex and y, mm.
pub type Place = [f64; 2];

/// A surface in section.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// From its lower to its upper edge.
    pub curve: Vec<Place>,
    /// Whether glass follows.
    pub before_glass: bool,
    /// Whether it is the stop.
    pub stop: bool,
}

/// A lens in section with rays.
#[derive(Clone, Debug, PartialEq)]
pub struct Section {
    /// Its surfaces.
    pub surfaces: Vec<Profile>,
    /// Of each field, its rays, each from before the first surface to the image plane.
    pub rays: Vec<Vec<Vec<Place>>>,
    /// Where the image plane is.
    pub image_z_mm: f64,
}

/// The section of a lens with `count` rays (3 at least) of each field, degrees, spread evenly over
/// what of the pupil light passes, at the reference wavelength.
///
/// # Errors
/// A chief ray that is lost.
pub fn section(system: &System, fields_deg: &[f64], count: usize) -> Result<Section> {
    let train = system.at(system.prescription.reference_nm)?;
    let length: f64 = train.surfaces.iter().map(|s| s.prescribed.thickness.abs()).sum();
    let lead = 0.2 * length;
    let mut rays = Vec::with_capacity(fields_deg.len());
    for &deg in fields_deg {
        let beam = Beam::aim(&train, deg)?;
        let reach = 0.5 * BEYOND * train.entrance_pupil_mm;
        let place = |i: u32| reach * (2.0 * f64::from(i) / f64::from(RIM_PLACES) - 1.0);
        let passing: Vec<f64> =
            (0..=RIM_PLACES).map(place).filter(|y| beam.path(*y, lead).is_some()).collect();
        let (Some(low), Some(high)) = (passing.first(), passing.last()) else {
            rays.push(Vec::new());
            continue;
        };
        let at = |i: usize| low + (high - low) * i as f64 / (count.max(3) - 1) as f64;
        rays.push((0..count.max(3)).filter_map(|i| beam.path(at(i), lead)).collect());
    }
    let mut vertex = 0.0;
    let mut surfaces = Vec::with_capacity(train.surfaces.len());
    for (i, surface) in train.surfaces.iter().enumerate() {
        // A path begins before the first surface.
        let met = rays.iter().flatten().filter_map(|path| path.get(i + 1));
        let of_rays = RIM * met.map(|p| p[1].abs()).fold(0.0, f64::max);
        let opening = system.prescription.surfaces[i].clips.iter().map(|c| c.outer);
        let half = opening.filter(|r| r.is_finite()).fold(f64::INFINITY, f64::min);
        let half = if half.is_finite() { half } else { of_rays };
        let point = |k: u32| {
            let y = half * (2.0 * f64::from(k) / f64::from(POINTS) - 1.0);
            [vertex + surface.sag(y * y).0, y]
        };
        surfaces.push(Profile {
            curve: (0..=POINTS).map(point).filter(|p| p[0].is_finite()).collect(),
            before_glass: matches!(system.prescription.surfaces[i].medium, Medium::Glass(_)),
            stop: i == train.stop,
        });
        vertex += surface.prescribed.thickness;
    }
    Ok(Section { surfaces, rays, image_z_mm: vertex })
}

/// Where rays close to the chief ray meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foci {
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Height of the chief ray on the image plane, mm, 0 or more.
    pub height_mm: f64,
    /// Distance of the focus of sagittal rays behind the image plane along the axis, mm.
    pub sagittal_mm: f64,
    /// The same of tangential rays.
    pub tangential_mm: f64,
}

/// Field curvature and astigmatism: foci of close rays about the chief ray (Coddington's), at
/// fields in degrees and a wavelength in nm. Not a number where close rays are parallel.
///
/// # Errors
/// Chief rays that are lost.
pub fn foci(system: &System, fields_deg: &[f64], nm: f64) -> Result<Vec<Foci>> {
    let train = system.at(nm)?;
    let close = CLOSE * train.entrance_pupil_mm;
    let of_field = |&field_deg: &f64| {
        let beam = Beam::aim(&train, field_deg)?;
        let mut places = [[0.0; 2]; LANES];
        [places[0], places[1], places[2]] = [[0.0, close], [0.0, -close], [close, 0.0]];
        let rays = beam.trace(&places);
        // Place on the image plane and slope, along an axis.
        let of = |i: usize, axis: usize| {
            let (p, d) = rays.get(i);
            (p[axis], d[axis] / d[2])
        };
        let away = rays.get(0).1[2].signum();
        let ((a, slope_a), (b, slope_b)) = (of(0, 1), of(1, 1));
        let (x, slope_x) = of(2, 0);
        Ok(Foci {
            field_deg,
            height_mm: beam.height_mm().abs(),
            sagittal_mm: -away * x / slope_x,
            tangential_mm: -away * (a - b) / (slope_a - slope_b),
        })
    };
    fields_deg.iter().map(of_field).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prescription::toml;
    use crate::{Catalogue, Conditions};

    const RADIUS_MM: f64 = 50.0;

    fn singlet() -> System {
        let text = r#"
            format = "camrig-prescription/1"
            wavelengths_nm = [587.6]
            fields_deg = [0.0, 10.0]
            [aperture]
            f_number = 8.0
            [[surface]]
            radius_mm = 50.0
            thickness_mm = 4.0
            glass = "N-BK7"
            stop = true
            [[surface]]
            radius_mm = -50.0
            thickness_mm = 47.3
        "#;
        let lens = toml::read(text, &Catalogue::default()).unwrap();
        System::new(lens, Conditions::default()).unwrap()
    }

    /// A thin lens with the stop at it has sagittal and tangential foci at −h²/2f·(1 + 1/n) and
    /// −h²/2f·(3 + 1/n) from the paraxial image (Welford 1986, ch. 8: Petzval n·f, astigmatism of
    /// a thin lens at the stop).
    #[test]
    fn foci_of_a_thin_lens_follow_its_petzval_sum_and_astigmatism() {
        let system = singlet();
        let found = foci(&system, &[0.0, 2.0], 587.6).unwrap();
        let (f, n) = (system.paraxial.efl_mm, 1.5168);
        let h = found[1].height_mm;
        let sagittal = found[1].sagittal_mm - found[0].sagittal_mm;
        let tangential = found[1].tangential_mm - found[0].tangential_mm;
        let expected = |k: f64| -h * h / (2.0 * f) * (k + 1.0 / n);
        // The thickness is 8 % of the focal length.
        assert!((sagittal / expected(1.0) - 1.0).abs() < 0.1, "{sagittal} {}", expected(1.0));
        assert!((tangential / expected(3.0) - 1.0).abs() < 0.1, "{tangential}");
        let paraxial = system.paraxial.image_distance_mm - 47.3;
        assert!((found[0].sagittal_mm - paraxial).abs() < 1e-5);
        assert!((found[0].tangential_mm - paraxial).abs() < 1e-5);
    }

    #[test]
    fn rays_of_a_section_begin_before_the_lens_and_meet_near_the_image() {
        let section = section(&singlet(), &[0.0, 10.0], 5).unwrap();
        assert_eq!(section.image_z_mm, 4.0 + 47.3);
        assert_eq!(section.rays.iter().map(Vec::len).collect::<Vec<_>>(), [5, 5]);
        for path in &section.rays[0] {
            assert_eq!(path.len(), 4, "the lead, two surfaces, the image");
            assert!(path[0][0] < path[1][0] && path[3][1].abs() < 0.2, "{path:?}");
            assert!((path[3][0] - section.image_z_mm).abs() < 1e-9);
        }
        let edge = section.surfaces[0].curve[0];
        let sag = RADIUS_MM - (RADIUS_MM * RADIUS_MM - edge[1] * edge[1]).sqrt();
        assert!((edge[0] - sag).abs() < 1e-9, "{edge:?}");
        assert!(section.surfaces[0].before_glass && !section.surfaces[1].before_glass);
    }
}
