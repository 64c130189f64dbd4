//! Rays, several side by side.

use super::prescription::Pose;

/// Where a ray starts.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    /// Position relative to the vertex of the first surface, mm.
    pub position: [f64; 3],
    /// Direction cosines.
    pub direction: [f64; 3],
    /// Its optical path up to there, mm.
    pub path: f64,
}

/// N rays: position relative to the vertex of the surface they are at, direction, optical path,
/// and whether an aperture stops them.
#[derive(Clone, Debug)]
pub struct Rays<const N: usize> {
    /// x, y, z in mm.
    pub position: [[f64; N]; 3],
    /// Direction cosines.
    pub direction: [[f64; N]; 3],
    /// Optical path up to there, mm, from where [`Start::path`] counts.
    pub path: [f64; N],
    /// Largest [`Clip::excess`](super::prescription::Clip::excess) met so far: above 0 for rays
    /// that an aperture stops.
    pub excess: [f64; N],
}

impl<const N: usize> Rays<N> {
    /// N rays without position or direction (NaN), to be set.
    #[must_use]
    pub fn nowhere() -> Self {
        Self {
            position: [[f64::NAN; N]; 3],
            direction: [[f64::NAN; N]; 3],
            path: [0.0; N],
            excess: [-1.0; N],
        }
    }

    /// Places ray `i`.
    pub fn set(&mut self, i: usize, position: [f64; 3], direction: [f64; 3]) {
        for axis in 0..3 {
            self.position[axis][i] = position[axis];
            self.direction[axis][i] = direction[axis];
        }
        self.path[i] = 0.0;
        self.excess[i] = -1.0;
    }

    /// Places ray `i` where it starts.
    pub fn launch(&mut self, i: usize, start: &Start) {
        self.set(i, start.position, start.direction);
        self.path[i] = start.path;
    }

    /// Ray `i` as (position, direction).
    #[must_use]
    pub fn get(&self, i: usize) -> ([f64; 3], [f64; 3]) {
        (self.position.map(|v| v[i]), self.direction.map(|v| v[i]))
    }

    /// Whether ray `i` went through every surface (whatever the apertures say).
    #[must_use]
    pub fn alive(&self, i: usize) -> bool {
        self.path[i].is_finite() && self.direction[2][i].is_finite()
    }

    /// Whether ray `i` went through every surface and every aperture.
    #[must_use]
    pub fn passes(&self, i: usize) -> bool {
        self.alive(i) && self.excess[i] <= 0.0
    }

    /// Expresses the rays in the coordinates of `pose`.
    #[inline(always)]
    pub(super) fn enter(&mut self, pose: &Pose) {
        for i in 0..N {
            let (position, direction) = self.get(i);
            let (position, direction) = (pose.point(position), pose.direction(direction));
            for axis in 0..3 {
                self.position[axis][i] = position[axis];
                self.direction[axis][i] = direction[axis];
            }
        }
    }
}
