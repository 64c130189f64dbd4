//! Plane folds undone: a lens whose axis is only folded by plane mirrors traces as the straight
//! lens, mirror images aside.

use super::prescription::{Form, Medium, Object, Pose, Prescription, Surface};

/// A ray along the axis may miss vertices by this much, mm, and be inclined by as much: rounding of
/// angles and lengths that files print to some 12 digits.
const ON_AXIS: f64 = 1e-9;

/// The axis as a ray, in the coordinates of the surface it has come to.
struct Axis {
    position: [f64; 3],
    direction: [f64; 3],
    /// Distance gone since the last surface, mm.
    gone: f64,
}

impl Axis {
    fn enter(&mut self, frame: Option<&Pose>) {
        if let Some(frame) = frame {
            self.position = frame.point(self.position);
            self.direction = frame.direction(self.direction);
        }
    }

    /// Goes on to the plane z = 0; whether it meets it in the vertex.
    fn meets_vertex(&mut self) -> bool {
        let t = -self.position[2] / self.direction[2];
        self.gone += t;
        self.position = [0, 1, 2].map(|k| self.position[k] + t * self.direction[k]);
        self.position.iter().all(|v| v.abs() < ON_AXIS)
    }

    fn is_along_z(&self) -> bool {
        self.direction[0].abs() < ON_AXIS && self.direction[1].abs() < ON_AXIS
    }
}

/// The lens with its plane folds undone, where that leaves it rotationally symmetric, with a note;
/// otherwise the lens as it is.
pub(super) fn unfolded(lens: Prescription) -> Prescription {
    if lens.asymmetry().is_none() {
        return lens;
    }
    straight(&lens).unwrap_or(lens)
}

/// `None` where more than plane folds breaks the symmetry.
fn straight(lens: &Prescription) -> Option<Prescription> {
    let mut axis = Axis { position: [0.0; 3], direction: [0.0, 0.0, 1.0], gone: 0.0 };
    let mut surfaces: Vec<Surface> = Vec::with_capacity(lens.surfaces.len());
    let mut object = lens.object;
    // The sign of thicknesses in the straight lens: it changes at mirrors that stay.
    let (mut parity, mut folds) = (1.0, 0);
    let mut last: Option<usize> = None;
    for (i, surface) in lens.surfaces.iter().enumerate() {
        axis.enter(surface.entry.as_ref());
        let mut plain = Surface { entry: None, exit: None, thickness: 0.0, ..surface.clone() };
        if surface.form != Form::Break {
            if !axis.meets_vertex() || plain.asymmetry().is_some() {
                return None;
            }
            if is_plane_mirror(surface) && !axis.is_along_z() {
                if !surface.clips.is_empty() || i == lens.stop {
                    return None;
                }
                // Folds stay in the list, so that surfaces keep their numbers.
                plain = Surface { form: Form::Break, ..Surface::plane(0.0) };
                axis.direction[2] = -axis.direction[2];
                folds += 1;
            } else {
                let gone = std::mem::take(&mut axis.gone);
                match (last, &mut object) {
                    (Some(before), _) => surfaces[before].thickness = parity * gone,
                    (None, Object::Distance(d)) => *d += gone,
                    (None, Object::Infinity) => {}
                }
                if !axis.is_along_z() {
                    return None;
                }
                if axis.direction[2] * parity < 0.0 {
                    turn_round(&mut plain);
                }
                if surface.medium == Medium::Mirror {
                    axis.direction[2] = -axis.direction[2];
                    parity = -parity;
                }
                last = Some(i);
            }
        }
        axis.enter(surface.exit.as_ref());
        axis.position[2] -= surface.thickness;
        surfaces.push(plain);
    }
    if !axis.meets_vertex() || !axis.is_along_z() {
        return None;
    }
    surfaces.truncate(last? + 1);
    surfaces[last?].thickness = parity * axis.gone;
    let mut notes = lens.notes.clone();
    if folds > 0 {
        notes.push(format!(
            "the axis is folded {folds} times by plane mirrors, and the lens is traced straight: \
             an odd number of folds also mirrors the picture, which is left out"
        ));
    }
    Some(Prescription { surfaces, object, notes, ..lens.clone() })
}

fn is_plane_mirror(surface: &Surface) -> bool {
    surface.medium == Medium::Mirror
        && surface.form == Form::Plain
        && surface.curvature == 0.0
        && surface.even.iter().chain(&surface.odd).all(|v| *v == 0.0)
}

/// The surface seen from its other side.
fn turn_round(surface: &mut Surface) {
    surface.curvature = -surface.curvature;
    surface.even.iter_mut().chain(&mut surface.odd).for_each(|v| *v = -*v);
    if let Form::Forbes(forbes) = &mut surface.form {
        forbes.coefficients.iter_mut().for_each(|v| *v = -*v);
    }
}
