//! The ray-tracing kernel: exact rays through a sequence of surfaces, N side by side.
//!
//! Rays are straight lines between surfaces, bent by the vector form of Snell's law n'(d'×s) =
//! n(d×s) (Welford, Aberrations of Optical Systems, 1986, ch. 4). Sag of a surface, with s = r²:
//! c·s/(1 + √(1 − (1+k)c²s)) + Σ aᵢ·r^(2i) + Σ bᵢ·r^(2i−1). The conic is met in closed form,
//! polynomial terms and other shapes ([`Form`]) by Newton's iteration from there. A ray that
//! misses a surface or is totally reflected becomes NaN and stays NaN; without branches, N rays run
//! as vector lanes. Only IEEE basic operations and square roots are used, without contraction: the
//! same bits on every machine.

use super::ideal::Ideal;
use super::prescription::{Form, Medium, Surface};
pub use super::rays::{Rays, Start};
use camrig_vector::vectorised;

/// A surface ready to trace at one wavelength, in its own vertex coordinates.
#[derive(Clone, Debug)]
pub struct TrainSurface {
    /// Its shape, place and apertures, the stop's own among them; no polynomial ends with zeros.
    pub prescribed: Surface,
    /// Index in front of it.
    pub before: f64,
    /// Index behind it; a mirror has the same on both sides.
    pub after: f64,
    /// Whether light comes from the side of −z, with no mirror, tilt or decentre in front: a ray
    /// then meets the surface where it comes through from there, even one from more than 90° off
    /// the axis. Otherwise its direction tells.
    pub forward: bool,
    /// Of an ideal lens: 1/(distance of the object in front of it), 1/mm ([`Ideal::vergence`]).
    pub vergence: f64,
}

impl TrainSurface {
    /// Carries the rays from where they are onto this surface (coordinates: this surface's
    /// vertex).
    #[inline(always)]
    pub fn meet<const N: usize>(&self, rays: &mut Rays<N>) {
        if let Some(entry) = &self.prescribed.entry {
            rays.enter(entry);
        }
        match &self.prescribed.form {
            Form::Break => {}
            Form::Biconic { .. } | Form::Toroid { .. } => {
                let mut length = self.meet_conic(rays, true);
                self.refine(rays, &mut length, |place, [dx, dy]| {
                    let (sag, [gx, gy]) = self.sag_xy(place);
                    (sag, gx * dx + gy * dy)
                });
                self.end_meeting(rays, &length);
            }
            Form::Plain | Form::Forbes(_) | Form::Ideal { .. } => {
                let plain = self.prescribed.even.is_empty() && self.prescribed.odd.is_empty();
                let polynomial = !plain || matches!(self.prescribed.form, Form::Forbes(_));
                let mut length = self.meet_conic(rays, polynomial);
                if polynomial {
                    self.refine(rays, &mut length, |[x, y], [dx, dy]| {
                        let (sag, gradient) = self.sag(x * x + y * y);
                        (sag, gradient * (x * dx + y * dy))
                    });
                }
                self.end_meeting(rays, &length);
            }
        }
    }

    /// Carries the rays onto the conic; the distances they go. With `or_plane`, rays that miss it
    /// go to the plane at its vertex.
    // Lanes index several arrays at once, here and below.
    #[allow(clippy::needless_range_loop)]
    #[inline(always)]
    fn meet_conic<const N: usize>(&self, rays: &mut Rays<N>, or_plane: bool) -> [f64; N] {
        let (c, k) = (self.prescribed.curvature, self.prescribed.conic);
        let [px, py, pz] = &mut rays.position;
        let [dx, dy, dz] = &rays.direction;
        let mut length = [0.0; N];
        for i in 0..N {
            // c·(x² + y² + (1+k)z²) = 2z along the ray: a·t² + 2b·t + g = 0, the root next to the
            // vertex.
            let a = c * (1.0 + k * dz[i] * dz[i]);
            let b = c * (px[i] * dx[i] + py[i] * dy[i] + (1.0 + k) * pz[i] * dz[i]) - dz[i];
            let g = c * (px[i] * px[i] + py[i] * py[i] + (1.0 + k) * pz[i] * pz[i]) - 2.0 * pz[i];
            let root = (b * b - a * g).sqrt();
            let way = if self.forward { 1.0 } else { dz[i] };
            let t = g / (-b + root.copysign(way));
            // The half of the conic away from the vertex is no part of the surface.
            let near = 1.0 - (1.0 + k) * c * (pz[i] + t * dz[i]) >= 0.0;
            // A polynomial surface may exist where its conic part does not: start at the plane.
            let plane = if way * dz[i] > 0.0 { -pz[i] / dz[i] } else { f64::NAN };
            let t = match or_plane {
                true if t.is_nan() => plane,
                false if !near => f64::NAN,
                _ => t,
            };
            length[i] = t;
            px[i] += t * dx[i];
            py[i] += t * dy[i];
            pz[i] += t * dz[i];
        }
        length
    }

    /// Adds the optical path over the distances and what the apertures let pass.
    #[allow(clippy::needless_range_loop)]
    #[inline(always)]
    fn end_meeting<const N: usize>(&self, rays: &mut Rays<N>, length: &[f64; N]) {
        for i in 0..N {
            rays.path[i] += self.before * length[i];
        }
        for clip in &self.prescribed.clips {
            for i in 0..N {
                let excess = clip.excess(rays.position[0][i], rays.position[1][i]);
                rays.excess[i] = if excess > rays.excess[i] { excess } else { rays.excess[i] };
            }
        }
    }

    /// Newton's iteration on f = z − sag(x, y) along the rays; `rise` gives the sag at a place and
    /// its derivative in a direction (dx, dy).
    #[allow(clippy::needless_range_loop)]
    #[inline(always)]
    fn refine<const N: usize>(
        &self,
        rays: &mut Rays<N>,
        length: &mut [f64; N],
        rise: impl Fn([f64; 2], [f64; 2]) -> (f64, f64),
    ) {
        // Newton's method doubles the number of correct digits: a step below 1e-9 mm leaves an
        // error below rounding. STEPS only ends an iteration that does not converge.
        const ENOUGH: f64 = 1e-9;
        const STEPS: usize = 40;
        for step in 0..STEPS {
            let mut largest = 0.0_f64;
            for i in 0..N {
                let (x, y) = (rays.position[0][i], rays.position[1][i]);
                let [dx, dy, dz] = [0, 1, 2].map(|axis| rays.direction[axis][i]);
                let (sag, rise) = rise([x, y], [dx, dy]);
                let slope = dz - rise;
                let t = (sag - rays.position[2][i]) / slope;
                length[i] += t;
                rays.position[0][i] += t * dx;
                rays.position[1][i] += t * dy;
                rays.position[2][i] += t * dz;
                let size = t.abs();
                largest = if size > largest { size } else { largest };
                if step == STEPS - 1 && size > ENOUGH {
                    length[i] = f64::NAN;
                }
            }
            if largest <= ENOUGH {
                return;
            }
        }
    }

    /// Sag of a biconic or toroid at (x, y), and its gradient.
    #[inline(always)]
    #[must_use]
    pub fn sag_xy(&self, [x, y]: [f64; 2]) -> (f64, [f64; 2]) {
        match self.prescribed.form {
            Form::Biconic { curvature, conic } => {
                let (cx, cy) = (curvature, self.prescribed.curvature);
                let (ex, ey) = ((1.0 + conic) * cx * cx, (1.0 + self.prescribed.conic) * cy * cy);
                let root = (1.0 - ex * x * x - ey * y * y).sqrt();
                let sag = (cx * x * x + cy * y * y) / (1.0 + root);
                let along = |c: f64, e: f64, v: f64| (2.0 * c + sag * e / root) * v / (1.0 + root);
                (sag, [along(cx, ex, x), along(cy, ey, y)])
            }
            Form::Toroid { curvature } => {
                let (curve, gradient) = self.sag(y * y);
                let q = 1.0 - curvature * curve;
                let root = (q * q - curvature * curvature * x * x).sqrt();
                let sag = curve + curvature * x * x / (q + root);
                (sag, [curvature * x / root, gradient * y * q / root])
            }
            _ => {
                let (sag, gradient) = self.sag(x * x + y * y);
                (sag, [gradient * x, gradient * y])
            }
        }
    }

    /// Whether it reflects.
    #[inline(always)]
    pub(super) fn is_mirror(&self) -> bool {
        matches!(self.prescribed.medium, Medium::Mirror)
    }

    /// Paraxial power in x and y, 1/mm, between media of these signed indices.
    pub(super) fn power(&self, before: f64, after: f64) -> [f64; 2] {
        let curvature =
            self.prescribed.curvature + 2.0 * self.prescribed.even.first().copied().unwrap_or(0.0);
        let bend = |c: f64| (after - before) * c;
        match &self.prescribed.form {
            Form::Plain => [bend(curvature); 2],
            Form::Forbes(forbes) => [bend(curvature + forbes.vertex_curvature()); 2],
            Form::Biconic { curvature: x, .. } | Form::Toroid { curvature: x } => {
                [bend(*x), bend(curvature)]
            }
            Form::Ideal { focal_mm } => [1.0 / focal_mm; 2],
            Form::Break => [0.0; 2],
        }
    }

    /// Sag at s = r², and g with ∂z/∂x = g·x, ∂z/∂y = g·y.
    #[inline(always)]
    #[must_use]
    pub fn sag(&self, s: f64) -> (f64, f64) {
        let c = self.prescribed.curvature;
        let root = (1.0 - (1.0 + self.prescribed.conic) * c * c * s).sqrt();
        let (mut sag, mut gradient) = (c * s / (1.0 + root), c / root);
        let (mut value, mut slope) = (0.0, 0.0);
        for a in self.prescribed.even.iter().rev() {
            slope = slope * s + value;
            value = value * s + a;
        }
        // Σ aᵢsⁱ = s·value, its derivative value + s·slope; d/dr² doubles in d/dx = 2x·d/ds.
        sag += s * value;
        gradient += 2.0 * (value + s * slope);
        if !self.prescribed.odd.is_empty() {
            let (mut value, mut slope) = (0.0, 0.0);
            for b in self.prescribed.odd.iter().rev() {
                slope = slope * s + value;
                value = value * s + b;
            }
            // A term in r makes the vertex a cone's tip; the surface is taken as flat there.
            let r = s.sqrt();
            sag += r * value;
            gradient += value / r.max(1e-12) + 2.0 * r * slope;
        }
        if let Form::Forbes(forbes) = &self.prescribed.form {
            let (departure, slope) = forbes.departure(s, c, self.prescribed.conic);
            sag += departure;
            gradient += 2.0 * slope;
        }
        (sag, gradient)
    }

    /// Refracts or reflects the rays, which lie on this surface, and moves the origin to the
    /// vertex of the next surface.
    #[inline(always)]
    pub fn bend<const N: usize>(&self, rays: &mut Rays<N>) {
        match &self.prescribed.form {
            Form::Break => {}
            Form::Ideal { focal_mm } => {
                Ideal { power: 1.0 / focal_mm, vergence: self.vergence }.bend(rays);
            }
            Form::Biconic { .. } | Form::Toroid { .. } => {
                self.deflect(rays, |place| self.sag_xy(place).1);
            }
            Form::Plain | Form::Forbes(_) => self.deflect(rays, |[x, y]| {
                let (_, gradient) = self.sag(x * x + y * y);
                [gradient * x, gradient * y]
            }),
        }
        if let Some(exit) = &self.prescribed.exit {
            rays.enter(exit);
        }
        for z in &mut rays.position[2] {
            *z -= self.prescribed.thickness;
        }
    }

    /// Refracts or reflects the rays at the surface with this gradient of the sag.
    #[inline(always)]
    fn deflect<const N: usize>(
        &self,
        rays: &mut Rays<N>,
        gradient: impl Fn([f64; 2]) -> [f64; 2],
    ) {
        let ratio = self.before / self.after;
        for i in 0..N {
            let [nx, ny] =
                gradient([rays.position[0][i], rays.position[1][i]]).map(|slope| -slope);
            let scale = 1.0 / (nx * nx + ny * ny + 1.0).sqrt();
            let normal = [nx * scale, ny * scale, scale];
            let [dx, dy, dz] = [0, 1, 2].map(|axis| rays.direction[axis][i]);
            let cosine = dx * normal[0] + dy * normal[1] + dz * normal[2];
            let (keep, along) = if self.is_mirror() {
                (1.0, -2.0 * cosine)
            } else {
                let after = (1.0 - ratio * ratio * (1.0 - cosine * cosine)).sqrt();
                (ratio, after.copysign(cosine) - ratio * cosine)
            };
            rays.direction[0][i] = keep * dx + along * normal[0];
            rays.direction[1][i] = keep * dy + along * normal[1];
            rays.direction[2][i] = keep * dz + along * normal[2];
        }
    }
}

/// Traces rays through the surfaces and on to the plane z = 0 of the image.
#[inline(always)]
fn through_all<const N: usize>(surfaces: &[TrainSurface], rays: &mut Rays<N>) {
    for surface in surfaces {
        surface.meet(rays);
        surface.bend(rays);
    }
    to_image(surfaces, rays);
}

/// Carries rays that have left the last surface to the plane z = 0 of the image.
#[inline(always)]
fn to_image<const N: usize>(surfaces: &[TrainSurface], rays: &mut Rays<N>) {
    let last = surfaces.last().map_or(1.0, |s| s.after);
    for i in 0..N {
        let t = -rays.position[2][i] / rays.direction[2][i];
        for axis in 0..3 {
            rays.position[axis][i] += t * rays.direction[axis][i];
        }
        rays.path[i] += last * t;
    }
}

/// Rays traced side by side.
pub const LANES: usize = 8;

/// Traces [`LANES`] rays from the first surface to the image plane, vectorised where the processor
/// can.
#[vectorised]
pub fn trace_lanes(surfaces: &[TrainSurface], rays: &mut Rays<LANES>) {
    through_all(surfaces, rays);
}

/// Traces one ray from the first surface to the image plane.
pub fn trace_one(surfaces: &[TrainSurface], rays: &mut Rays<1>) {
    through_all(surfaces, rays);
}

/// Index of the surface at which a ray is lost, and how; `None` for a ray that arrives.
#[must_use]
pub fn lost_at(surfaces: &[TrainSurface], start: &Rays<1>) -> Option<(usize, &'static str)> {
    let mut ray = start.clone();
    for (i, surface) in surfaces.iter().enumerate() {
        surface.meet(&mut ray);
        if !ray.path[0].is_finite() {
            return Some((i, "misses it"));
        }
        surface.bend(&mut ray);
        if !ray.direction[2][0].is_finite() {
            return Some((i, "is totally reflected there"));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn surface(curvature: f64, conic: f64, before: f64, after: f64) -> TrainSurface {
        TrainSurface {
            prescribed: Surface { curvature, conic, ..Surface::plane(0.0) },
            before,
            after,
            forward: true,
            vergence: 0.0,
        }
    }

    fn ray(position: [f64; 3], direction: [f64; 3]) -> Rays<1> {
        let mut rays = Rays::nowhere();
        rays.set(0, position, direction);
        rays
    }

    /// A paraboloid mirror and an ellipsoid of k = −1/n² focus an axis-parallel beam in one point
    /// with equal paths: exact (Descartes).
    #[test]
    fn cartesian_surfaces_are_free_of_aberration() {
        let (r, n) = (10.0, 1.5);
        let focus = r * n / (n - 1.0);
        let mut lens = surface(1.0 / r, -1.0 / (n * n), 1.0, n);
        lens.prescribed.thickness = focus;
        let mut mirror = surface(-1.0 / r, -1.0, 1.0, 1.0);
        mirror.prescribed.medium = Medium::Mirror;
        mirror.prescribed.thickness = -r / 2.0;
        for (surface, path) in [(lens, n * focus + 1.0), (mirror, 1.0 + r / 2.0)] {
            for height in [0.0, 1.0, 3.0, 4.5] {
                let mut ray = ray([0.6 * height, 0.8 * height, -1.0], [0.0, 0.0, 1.0]);
                trace_one(std::slice::from_ref(&surface), &mut ray);
                let (p, _) = ray.get(0);
                assert!(p[0].abs() < 1e-13 && p[1].abs() < 1e-13, "{p:?}");
                assert!((ray.path[0] - path).abs() < 1e-13);
            }
        }
    }

    /// The same surface told as a conic and as a power series in r (even or odd storage) traces
    /// alike: a parabola is exactly c·r²/2.
    #[test]
    fn polynomials_agree_with_the_conic_they_equal() {
        let conic = surface(0.05, -1.0, 1.0, 1.6);
        let mut series = surface(0.0, 0.0, 1.0, 1.6);
        series.prescribed.even = vec![0.025];
        let mut doubled = surface(0.0, 0.0, 1.0, 1.6);
        doubled.prescribed.even = vec![0.0];
        doubled.prescribed.odd = vec![0.0, 1e-3];
        let mut negated = doubled.clone();
        negated.prescribed.odd[1] = -1e-3;
        let start = ray([1.0, 2.0, -3.0], [0.1, -0.2, (1.0f64 - 0.05).sqrt()]);
        let end = |s: &TrainSurface| {
            let mut ray = start.clone();
            trace_one(std::slice::from_ref(s), &mut ray);
            ray.get(0)
        };
        let (a, b) = (end(&conic), end(&series));
        for axis in 0..3 {
            assert!(
                (a.0[axis] - b.0[axis]).abs() < 1e-13 && (a.1[axis] - b.1[axis]).abs() < 1e-13
            );
        }
        assert!((doubled.sag(4.0).0 - 8e-3).abs() < 1e-15);
        assert!((doubled.sag(4.0).1 - 3e-3 * 2.0).abs() < 1e-15);
        assert_ne!(end(&doubled), end(&negated));
    }

    /// A biconic with the constants of an ellipsoid, and a torus: the points met lie on them
    /// exactly, and the normals are those of their equations.
    #[test]
    fn biconics_and_toroids_are_those_of_their_equations() {
        // Half axes 9, 7 and 5: Rx = 81/5, kx = 81/25 − 1.
        let (a, b, c) = (9.0, 7.0, 5.0);
        let mut ellipsoid = surface(c / (b * b), b * b / (c * c) - 1.0, 1.0, 1.5);
        ellipsoid.prescribed.form =
            Form::Biconic { curvature: c / (a * a), conic: a * a / (c * c) - 1.0 };
        // A circle of radius 4 in y, turned at the distance 20.
        let mut torus = surface(0.25, 0.0, 1.0, 1.5);
        torus.prescribed.form = Form::Toroid { curvature: 0.05 };
        let (of_ellipsoid, of_torus) = (
            |[x, y, z]: [f64; 3]| {
                let dz = z - c;
                let value = (x / a).powi(2) + (y / b).powi(2) + (dz / c).powi(2) - 1.0;
                (value, [x / (a * a), y / (b * b), dz / (c * c)])
            },
            |[x, y, z]: [f64; 3]| {
                let far = (x * x + (z - 20.0).powi(2)).sqrt();
                let value = (far - 16.0).powi(2) + y * y - 16.0;
                (value, [x * (1.0 - 16.0 / far), y, (z - 20.0) * (1.0 - 16.0 / far)])
            },
        );
        for start in [[0.5, 1.0, -3.0], [-2.0, 2.5, -1.0], [3.0, -1.5, -2.0]] {
            for (surface, equation) in [
                (&ellipsoid, &of_ellipsoid as &dyn Fn([f64; 3]) -> (f64, [f64; 3])),
                (&torus, &of_torus),
            ] {
                let mut ray = ray(start, [0.1, -0.2, 0.95_f64.sqrt()]);
                surface.meet(&mut ray);
                let (p, _) = ray.get(0);
                let (value, normal) = equation(p);
                assert!(value.abs() < 1e-12, "{value} at {p:?}");
                let (_, [zx, zy]) = surface.sag_xy([p[0], p[1]]);
                assert!((zx + normal[0] / normal[2]).abs() < 1e-12);
                assert!((zy + normal[1] / normal[2]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn lost_rays_say_where() {
        let ball = surface(0.5, 0.0, 1.0, 1.5);
        let inside = surface(-0.5, 0.0, 1.9, 1.0);
        let far = ray([0.0, 3.0, -1.0], [0.0, 0.0, 1.0]);
        let edge = ray([0.0, 1.5, -1.0], [0.0, 0.0, 1.0]);
        assert_eq!(lost_at(std::slice::from_ref(&ball), &far), Some((0, "misses it")));
        assert_eq!(lost_at(&[inside], &edge), Some((0, "is totally reflected there")));
        assert_eq!(lost_at(&[ball], &edge), None);
    }

    proptest! {
        /// Snell's law, unit directions and a point on the surface, for arbitrary aspheres; eight
        /// lanes give the bits of one when the lanes hold the same ray.
        #[test]
        fn rays_obey_snell(
            c in -0.05..0.05, k in -2.0..2.0, a4 in -1e-4..1e-4, b3 in -1e-4..1e-4,
            x in -5.0..5.0, y in -5.0..5.0, l in -0.4..0.4, m in -0.4..0.4, after in 1.0..2.0,
        ) {
            let mut s = surface(c, k, 1.0, after);
            s.prescribed.even = vec![0.0, a4];
            s.prescribed.odd = vec![0.0, b3];
            let n = f64::sqrt(1.0 - l * l - m * m);
            let mut one = ray([x, y, -2.0], [l, m, n]);
            s.meet(&mut one);
            let (p, d) = one.get(0);
            let r2 = p[0] * p[0] + p[1] * p[1];
            prop_assume!(p[2].is_finite() && r2 < 200.0);
            let (sag, g) = s.sag(r2);
            prop_assert!((p[2] - sag).abs() < 1e-12);
            s.bend(&mut one);
            let (_, e) = one.get(0);
            let norm: f64 = e.iter().map(|v| v * v).sum();
            prop_assert!((norm - 1.0).abs() < 1e-12);
            let normal = [-g * p[0], -g * p[1], 1.0];
            let cross = |a: [f64; 3]| [
                a[1] * normal[2] - a[2] * normal[1],
                a[2] * normal[0] - a[0] * normal[2],
                a[0] * normal[1] - a[1] * normal[0],
            ];
            let (before, behind) = (cross(d), cross(e));
            for axis in 0..3 {
                prop_assert!((before[axis] - after * behind[axis]).abs() < 1e-12);
            }
            let mut many = Rays::<LANES>::nowhere();
            (0..LANES).for_each(|i| many.set(i, [x, y, -2.0], [l, m, n]));
            trace_lanes(std::slice::from_ref(&s), &mut many);
            let mut single = ray([x, y, -2.0], [l, m, n]);
            trace_one(std::slice::from_ref(&s), &mut single);
            prop_assert_eq!(many.get(3), single.get(0));
        }
    }
}
