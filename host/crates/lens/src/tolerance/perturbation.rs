//! What differs from lens to lens: its kinds, where they apply, and a lens that has them.

use super::displaced::Displacement;
use crate::prescription::{Medium, Prescription};
use camrig_base::{Error, Result};

/// Largest departures from the prescription; 0 leaves a kind out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// Of each glass thickness and air space, mm. The sensor keeps its distance from the last
    /// surface.
    pub thickness_mm: f64,
    /// Of the index of each glass, the same at all wavelengths.
    pub index: f64,
    /// Of each radius of curvature, percent of it.
    pub radius_percent: f64,
    /// Of each element across the axis, mm.
    pub decentre_mm: f64,
    /// Of each element about the vertex of its first surface, arc minutes.
    pub tilt_arcmin: f64,
}

/// A kind of departure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// A glass thickness or an air space.
    Thickness,
    /// An index.
    Index,
    /// A radius of curvature.
    Radius,
    /// An element across the axis.
    Decentre,
    /// An element turned.
    Tilt,
}

impl Kind {
    /// Its name in files and tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Thickness => "thickness",
            Self::Index => "index",
            Self::Radius => "radius",
            Self::Decentre => "decentre",
            Self::Tilt => "tilt",
        }
    }

    /// The unit of its tolerance.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Thickness | Self::Decentre => "mm",
            Self::Index => "",
            Self::Radius => "%",
            Self::Tilt => "'",
        }
    }

    /// Whether it has a direction across the axis.
    pub(super) const fn turns(self) -> bool {
        matches!(self, Self::Decentre | Self::Tilt)
    }
}

/// A departure of one surface, space or element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Perturbation {
    /// Its kind.
    pub kind: Kind,
    /// The first surface it concerns, from 0.
    pub first: usize,
    /// The last surface it concerns.
    pub last: usize,
    /// Its largest amount, in [`Kind::unit`].
    pub tolerance: f64,
}

/// A departing lens: prescription and displaced surfaces.
#[derive(Clone, Debug)]
pub(super) struct Departing {
    pub lens: Prescription,
    pub displacements: Vec<Displacement>,
}

impl Departing {
    pub fn new(lens: &Prescription) -> Self {
        Self {
            lens: lens.clone(),
            displacements: vec![Displacement::default(); lens.surfaces.len()],
        }
    }
}

impl Tolerances {
    /// All departures of a lens.
    ///
    /// # Errors
    /// A tolerance that is negative or no number, a radius or index that it could make
    /// meaningless, no tolerance at all.
    pub(super) fn perturbations(&self, lens: &Prescription) -> Result<Vec<Perturbation>> {
        for (kind, value, most) in [
            (Kind::Thickness, self.thickness_mm, f64::MAX),
            (Kind::Index, self.index, 0.1),
            (Kind::Radius, self.radius_percent, 50.0),
            (Kind::Decentre, self.decentre_mm, f64::MAX),
            (Kind::Tilt, self.tilt_arcmin, 1800.0),
        ] {
            if !(0.0..=most).contains(&value) {
                let what = format!("a tolerance of {value}{} of {}", kind.unit(), kind.name());
                return Err(Error::input(what).help("give 0 to leave it out, or a small amount"));
            }
        }
        let mut all = Vec::new();
        let mut add = |kind: Kind, first: usize, last: usize, tolerance: f64| {
            if tolerance > 0.0 {
                all.push(Perturbation { kind, first, last, tolerance });
            }
        };
        for (i, surface) in lens.surfaces.iter().enumerate() {
            if surface.curvature != 0.0 {
                add(Kind::Radius, i, i, self.radius_percent);
            }
            if matches!(surface.medium, Medium::Glass(_)) {
                add(Kind::Index, i, i, self.index);
            }
            if surface.thickness != 0.0 && i + 1 < lens.surfaces.len() {
                add(Kind::Thickness, i, i, self.thickness_mm);
            }
        }
        for (first, last) in elements(lens) {
            add(Kind::Decentre, first, last, self.decentre_mm);
            add(Kind::Tilt, first, last, self.tilt_arcmin);
        }
        if all.is_empty() {
            return Err(Error::input("no tolerance, or nothing that it applies to")
                .help("give at least one tolerance above 0"));
        }
        Ok(all)
    }
}

/// First and last surface of each element: glasses that touch, and mirrors.
fn elements(lens: &Prescription) -> Vec<(usize, usize)> {
    let mut all = Vec::new();
    let mut start = None;
    for (i, surface) in lens.surfaces.iter().enumerate() {
        match (&surface.medium, start) {
            (Medium::Glass(_), None) => start = Some(i),
            (Medium::Air, Some(first)) => {
                all.push((first, i));
                start = None;
            }
            (Medium::Mirror, None) => all.push((i, i)),
            _ => {}
        }
    }
    all
}

impl Perturbation {
    /// Where it is, for people: surfaces are counted from 1, as in messages.
    #[must_use]
    pub fn place(&self) -> String {
        let (first, last) = (self.first + 1, self.last + 1);
        match self.kind {
            Kind::Thickness => format!("space behind surface {first}"),
            Kind::Index => format!("glass behind surface {first}"),
            _ if first == last => format!("surface {first}"),
            _ => format!("element of surfaces {first} to {last}"),
        }
    }

    /// Gives a lens this departure. `amount` is in units of the tolerance: its first value from −1
    /// to 1, or both in a unit disc for what has a direction.
    pub(super) fn apply(&self, departing: &mut Departing, amount: [f64; 2]) {
        let size = amount.map(|a| a * self.tolerance);
        let surface = &mut departing.lens.surfaces[self.first];
        match self.kind {
            Kind::Thickness => surface.thickness += size[0],
            Kind::Radius => surface.curvature /= 1.0 + 0.01 * size[0],
            Kind::Index => {
                if let Medium::Glass(glass) = &mut surface.medium {
                    *glass = glass.with_index_shifted(size[0]);
                }
            }
            Kind::Decentre => {
                for displacement in &mut departing.displacements[self.first..=self.last] {
                    displacement.shift = size;
                }
            }
            Kind::Tilt => {
                let mut arm = 0.0;
                for i in self.first..=self.last {
                    let radians = size.map(|v| (v / 60.0).to_radians());
                    let displacement = &mut departing.displacements[i];
                    (displacement.tilt, displacement.arm) = (radians, arm);
                    arm += departing.lens.surfaces[i].thickness;
                }
            }
        }
    }
}
