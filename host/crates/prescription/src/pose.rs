//! Poses: coordinate systems in space by tilts and decentres.
//!
//! # Conventions
//! Tilts are right-handed, as in OpticStudio's coordinate breaks: about x, then about the new y,
//! then about the new z. CODE V counts α (`ADE`) and β (`BDE`) left-handed, γ (`CDE`) right-handed.

/// A coordinate system in another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Its origin, mm.
    pub origin: [f64; 3],
    /// Its x, y and z axis, unit vectors.
    pub axes: [[f64; 3]; 3],
}

/// The product of two rotations, each given by its axes: `inner` seen from outside `outer`.
fn product(outer: &[[f64; 3]; 3], inner: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    inner.map(|axis| combined(outer, axis))
}

/// The vector with these components along the axes.
fn combined(axes: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| axes[0][k] * v[0] + axes[1][k] * v[1] + axes[2][k] * v[2])
}

/// Axes turned about the x, y or z axis by an angle, degrees, right-handed.
fn turned(about: usize, degrees: f64) -> [[f64; 3]; 3] {
    let (sine, cosine) = sine_cosine(degrees);
    let (next, last) = ((about + 1) % 3, (about + 2) % 3);
    let mut axes = [[0.0; 3]; 3];
    axes[about][about] = 1.0;
    (axes[next][next], axes[next][last]) = (cosine, sine);
    (axes[last][next], axes[last][last]) = (-sine, cosine);
    axes
}

/// Sine and cosine of an angle in degrees, exact at whole right angles.
fn sine_cosine(degrees: f64) -> (f64, f64) {
    match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        _ => libm::sincos(degrees.to_radians()),
    }
}

impl Pose {
    /// Displaced by `decentre`, mm, then tilted about x, y and z by `tilt`, degrees.
    #[must_use]
    pub fn decentred_then_tilted(decentre: [f64; 3], tilt: [f64; 3]) -> Self {
        let [x, y, z] = [0, 1, 2].map(|about| turned(about, tilt[about]));
        Self { origin: decentre, axes: product(&product(&x, &y), &z) }
    }

    /// Tilted about z, y and x by `tilt`, degrees, then displaced by `decentre`, mm, along the new
    /// axes. With all values negated, the inverse of [`Self::decentred_then_tilted`].
    #[must_use]
    pub fn tilted_then_decentred(decentre: [f64; 3], tilt: [f64; 3]) -> Self {
        let [x, y, z] = [0, 1, 2].map(|about| turned(about, tilt[about]));
        let axes = product(&product(&z, &y), &x);
        Self { origin: combined(&axes, decentre), axes }
    }

    /// The outer system in coordinates of this one.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let axes = [0, 1, 2].map(|k| self.axes.map(|axis| axis[k]));
        Self { origin: combined(&axes, self.origin).map(|v| -v), axes }
    }

    /// Without its displacement.
    #[must_use]
    pub fn turn_only(&self) -> Self {
        Self { origin: [0.0; 3], axes: self.axes }
    }

    /// A point of the outer system in coordinates of this one.
    #[must_use]
    pub fn point(&self, p: [f64; 3]) -> [f64; 3] {
        self.direction([0, 1, 2].map(|k| p[k] - self.origin[k]))
    }

    /// A direction of the outer system in coordinates of this one.
    #[must_use]
    pub fn direction(&self, d: [f64; 3]) -> [f64; 3] {
        self.axes.map(|axis| axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: [f64; 3], b: [f64; 3]) {
        assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-14), "{a:?} instead of {b:?}");
    }

    /// A positive tilt about x takes the z axis towards −y, about y towards +x, and the x axis
    /// about z towards +y; exactly so for right angles.
    #[test]
    fn tilts_are_right_handed() {
        let half = 0.5_f64.sqrt();
        let z = |tilt| Pose::decentred_then_tilted([0.0; 3], tilt).axes[2];
        close(z([45.0, 0.0, 0.0]), [0.0, -half, half]);
        close(z([0.0, 45.0, 0.0]), [half, 0.0, half]);
        let x = Pose::decentred_then_tilted([0.0; 3], [0.0, 0.0, 30.0]).axes[0];
        close(x, [0.75_f64.sqrt(), 0.5, 0.0]);
        assert_eq!(z([90.0, 0.0, 0.0]), [0.0, -1.0, 0.0]);
        // About x, then about the new y, which is halfway between y and z.
        close(z([45.0, 90.0, 0.0]), [1.0, 0.0, 0.0]);
        close(z([90.0, 30.0, 0.0]), [0.5, -(0.75_f64.sqrt()), 0.0]);
    }

    #[test]
    fn the_other_order_with_negated_values_is_the_inverse() {
        let (decentre, tilt) = ([1.0, -2.0, 0.5], [20.0, -35.0, 70.0]);
        let pose = Pose::decentred_then_tilted(decentre, tilt);
        let back = Pose::tilted_then_decentred(decentre.map(|v| -v), tilt.map(|v| -v));
        let p = [0.3, 4.0, -7.0];
        close(back.point(pose.point(p)), p);
        close(pose.inverse().point(pose.point(p)), p);
        close(pose.inverse().origin, back.origin);
    }
}
