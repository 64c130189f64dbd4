//! `XDE` to `CDE` and what they do to the coordinates: tilts and decentres of a surface.
//!
//! A plain decentre moves the coordinates of the surface and of all behind it. `DAR` takes them
//! back behind the surface; `BEN` tilts them a second time, so that they follow the axis off a
//! mirror; `REV` leaves the surface where it is and takes a decentre back behind it.

use super::lexer::Word;
use super::numbers;
use camrig_base::{Error, Result};
use camrig_prescription::Pose;

/// The commands of values, in the order of [`Decentre::values`].
const VALUES: [&str; 6] = ["XDE", "YDE", "ZDE", "ADE", "BDE", "CDE"];

/// What happens to the coordinates behind the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Behind {
    #[default]
    Stay,
    Return,
    Bend,
    Reverse,
}

/// Tilt and decentre of a surface.
#[derive(Default)]
pub(super) struct Decentre {
    /// x, y, z in the file's unit; α, β, γ in degrees.
    values: [f64; 6],
    behind: Behind,
}

impl Decentre {
    /// Takes a command if it is about tilts and decentres; whether it is.
    pub(super) fn takes(&mut self, keyword: &str, words: &[Word]) -> Result<bool> {
        match (VALUES.iter().position(|name| *name == keyword), keyword) {
            (Some(i), _) => match numbers(keyword, words)?[..] {
                [value] => self.values[i] = value,
                _ => {
                    return Err(Error::unsupported(format!(
                        "{keyword} with {} values",
                        words.len()
                    ))
                    .help("one value is expected"));
                }
            },
            (None, "DAR") => self.behind = Behind::Return,
            (None, "BEN") => self.behind = Behind::Bend,
            (None, "REV") => self.behind = Behind::Reverse,
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// The surface's own coordinates in those before it, and those behind it in its own; lengths
    /// in the file are `scale` mm.
    ///
    /// # Errors
    /// A bend that is no tilt about one axis, or not at a mirror.
    pub(super) fn frames(&self, scale: f64, mirror: bool) -> Result<(Option<Pose>, Option<Pose>)> {
        if self.values.iter().all(|v| *v == 0.0) {
            return Ok((None, None));
        }
        let [x, y, z, alpha, beta, gamma] = self.values;
        let decentre = [x, y, z].map(|v| v * scale);
        // α and β are left-handed.
        let frame = Pose::decentred_then_tilted(decentre, [-alpha, -beta, gamma]);
        Ok(match self.behind {
            Behind::Stay => (Some(frame), None),
            Behind::Return => (Some(frame), Some(frame.inverse())),
            Behind::Reverse => (None, Some(frame.inverse())),
            Behind::Bend if !mirror || gamma != 0.0 || (alpha != 0.0 && beta != 0.0) => {
                return Err(Error::unsupported("BEN other than a mirror's tilt about x or y")
                    .help(
                        "say it as a plain decentre of the mirror and one of the next surface",
                    ));
            }
            Behind::Bend => (Some(frame), Some(frame.turn_only())),
        })
    }
}
