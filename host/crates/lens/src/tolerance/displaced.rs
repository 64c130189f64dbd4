//! Surfaces displaced by small rotations and shifts.

use crate::prescription::Pose;
use crate::trace::TrainSurface;

/// How a surface is displaced: turned about a point of the axis, then shifted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Displacement {
    /// Shift along x and y, mm.
    pub shift: [f64; 2],
    /// Rotation about x and y, radians.
    pub tilt: [f64; 2],
    /// z of the surface's vertex from the point about which it turns, mm.
    pub arm: f64,
}

impl Displacement {
    /// The coordinates of the displaced surface in those of its undisplaced vertex; `None` where
    /// nothing is displaced.
    fn frame(&self) -> Option<Pose> {
        (self.shift != [0.0; 2] || self.tilt != [0.0; 2]).then(|| self.moved())
    }

    fn moved(&self) -> Pose {
        // Rodrigues' rotation about the unit vector (a, b, 0).
        let [x, y] = self.tilt;
        let angle = (x * x + y * y).sqrt();
        let [a, b] = if angle > 0.0 { [x / angle, y / angle] } else { [1.0, 0.0] };
        let (s, c) = libm::sincos(angle);
        let v = 1.0 - c;
        let axes = [
            [c + a * a * v, a * b * v, -b * s],
            [a * b * v, c + b * b * v, a * s],
            [b * s, -a * s, c],
        ];
        let [x, y, z] = axes[2].map(|along| along * self.arm);
        Pose { origin: [self.shift[0] + x, self.shift[1] + y, z - self.arm], axes }
    }
}

/// The surfaces of a lens that is symmetric about its axis, displaced. Each thickness still leads
/// along the axis.
pub(super) fn displaced(
    surfaces: &[TrainSurface],
    displacements: &[Displacement],
) -> Vec<TrainSurface> {
    let pairs = surfaces.iter().zip(displacements);
    pairs
        .map(|(surface, displacement)| {
            let entry = displacement.frame();
            let mut surface = surface.clone();
            surface.prescribed.entry = entry;
            surface.prescribed.exit = entry.map(|frame| frame.inverse());
            surface
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prescription::Surface;
    use crate::trace::{LANES, Rays, trace_lanes};

    fn sphere(radius: f64) -> TrainSurface {
        TrainSurface {
            prescribed: Surface { curvature: 1.0 / radius, ..Surface::plane(25.0) },
            before: 1.0,
            after: 1.5,
            forward: true,
            vergence: 0.0,
        }
    }

    fn landing(displacement: Displacement) -> Vec<([f64; 3], f64)> {
        let mut rays = Rays::<LANES>::nowhere();
        for i in 0..LANES {
            let x = 0.5 * i as f64 - 1.5;
            let d = [0.02, -0.05, (1.0 - 0.02 * 0.02 - 0.05 * 0.05_f64).sqrt()];
            rays.set(i, [x, 0.3 * x + 0.4, -3.0], d);
        }
        trace_lanes(&displaced(&[sphere(10.0)], &[displacement]), &mut rays);
        (0..LANES).map(|i| (rays.get(i).0, rays.path[i])).collect()
    }

    /// A sphere that turns about its centre of curvature stays where it is.
    #[test]
    fn a_sphere_turned_about_its_centre_is_the_same_sphere() {
        let turned = Displacement { tilt: [0.03, -0.02], arm: -10.0, ..Displacement::default() };
        let (still, moved) = (landing(Displacement::default()), landing(turned));
        for ((p, path), (q, other)) in still.iter().zip(&moved) {
            assert!((0..3).all(|k| (p[k] - q[k]).abs() < 1e-12), "{p:?} {q:?}");
            assert!((path - other).abs() < 1e-12);
        }
        // About its vertex it does not.
        let other = landing(Displacement { arm: 0.0, ..turned });
        assert!((other[0].0[0] - still[0].0[0]).abs() > 0.01);
    }

    /// A surface shifted to +y is a ray shifted to −y, with the landing place shifted back.
    #[test]
    fn a_shifted_surface_shifts_the_picture() {
        let mut rays = Rays::<LANES>::nowhere();
        let mut shifted = Rays::<LANES>::nowhere();
        for i in 0..LANES {
            rays.set(i, [0.1 * i as f64, 0.5, -3.0], [0.0, 0.0, 1.0]);
            shifted.set(i, [0.1 * i as f64, 0.5 - 0.2, -3.0], [0.0, 0.0, 1.0]);
        }
        let up = Displacement { shift: [0.0, 0.2], ..Displacement::default() };
        trace_lanes(&displaced(&[sphere(10.0)], &[up]), &mut rays);
        trace_lanes(&[sphere(10.0)], &mut shifted);
        for i in 0..LANES {
            assert!((rays.position[1][i] - shifted.position[1][i] - 0.2).abs() < 1e-13);
        }
    }
}
