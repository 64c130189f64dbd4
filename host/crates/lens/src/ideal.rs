//! The ideal thin lens ("paraxial surface"): every point of one plane is imaged onto a point of
//! another, without aberration.
//!
//! A ray keeps its height and changes its slopes by x/f and y/f. No thin phase object does that to
//! every beam at once, so the optical path through it depends on where the object is: it is taken
//! such that all rays between an object point and its image have equal paths, with the object at
//! its paraxial place in front of the surface.

use super::rays::Rays;

/// An ideal lens at one wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ideal {
    /// 1/f, 1/mm.
    pub power: f64,
    /// 1/(distance of the object in front of it), 1/mm, along the way of the light: 0 for
    /// collimated light, negative for converging light.
    pub vergence: f64,
}

/// Path through (x, y) of a lens less that through its centre, mm, of a beam whose rays start in
/// one point at the distance 1/`vergence` in front; the ray at (x, y) has the slopes (l, m).
fn longer([x, y]: [f64; 2], [l, m]: [f64; 2], vergence: f64) -> f64 {
    let (a, b) = (x * vergence - l, y * vergence - m);
    let centre = (a * a + b * b + 1.0).sqrt();
    let here = (l * l + m * m + 1.0).sqrt();
    ((x * x + y * y) * vergence - 2.0 * (a * x + b * y)) / (centre + here)
}

impl Ideal {
    /// Bends the rays, which lie on the plane of the lens.
    #[inline(always)]
    pub(super) fn bend<const N: usize>(&self, rays: &mut Rays<N>) {
        for i in 0..N {
            let (p, d) = rays.get(i);
            let place = [p[0], p[1]];
            let slopes = [0, 1].map(|k| d[k] / d[2].abs());
            let bent = [0, 1].map(|k| slopes[k] - self.power * place[k]);
            let length = (bent[0] * bent[0] + bent[1] * bent[1] + 1.0).sqrt();
            rays.direction[0][i] = bent[0] / length;
            rays.direction[1][i] = bent[1] / length;
            rays.direction[2][i] = (1.0 / length).copysign(d[2]);
            // Behind the lens the same, seen from the image.
            let back = bent.map(|v| -v);
            rays.path[i] -= longer(place, slopes, self.vergence)
                + longer(place, back, self.power - self.vergence);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays from a point off the axis meet in its image with equal optical paths: exactly, for
    /// objects at infinity, at finite distance (f = 50: 1/150 = 1/50 − 1/75), virtual, and at the
    /// front focus (collimated behind).
    #[test]
    fn rays_between_object_and_image_have_equal_paths() {
        let power = 1.0 / 50.0;
        for distance in [75.0, 120.0, -80.0] {
            let vergence: f64 = 1.0 / distance;
            let image = 1.0 / (power - vergence);
            let object = [3.0, -7.0, -distance];
            let paths: Vec<f64> = [[0.0, 0.0], [4.0, 1.0], [-9.0, 6.0]]
                .map(|[x, y]: [f64; 2]| {
                    let away = [x - object[0], y - object[1], distance];
                    let length = away.iter().map(|v| v * v).sum::<f64>().sqrt();
                    let forward = away.map(|v| v / length * distance.signum());
                    let mut ray = Rays::<1>::nowhere();
                    ray.set(0, [x, y, 0.0], forward);
                    Ideal { power, vergence }.bend(&mut ray);
                    let (p, d) = ray.get(0);
                    let t = image / d[2];
                    for k in 0..2 {
                        let right = -object[k] * image / distance;
                        assert!((p[k] + t * d[k] - right).abs() < 1e-11);
                    }
                    length * distance.signum() + ray.path[0] + t
                })
                .to_vec();
            for path in &paths {
                assert!((path - paths[0]).abs() < 1e-11, "{distance}: {paths:?}");
            }
        }
    }
}
