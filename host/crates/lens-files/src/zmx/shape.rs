//! `TYPE` and the parameters behind it: the shape of a surface.

use super::Draft;
use crate::refuse;
use camrig_base::{Error, Result};
use camrig_prescription::Pose;
use camrig_prescription::forbes::{Forbes, Kind};
use camrig_prescription::{Form, Surface};

/// The order flag of a coordinate break (`PARM 6`) that decentres before it tilts.
const DECENTRE_FIRST: f64 = 0.0;

impl Draft {
    /// Gives `surface` the shape of the draft's type; lengths in the file are `scale` mm.
    pub(super) fn shape(&self, surface: &mut Surface, scale: f64) -> Result<()> {
        // A coefficient of r^p, in file units^(1-p).
        let in_mm = |a: f64, power: usize| a * scale / libm::pow(scale, power as f64);
        match self.kind.as_str() {
            "STANDARD" => {}
            "EVENASPH" => surface.even = self.even_terms(scale),
            "ODDASPHE" => {
                for (i, a) in self.parameters.iter().enumerate() {
                    let terms = if i % 2 == 0 { &mut surface.odd } else { &mut surface.even };
                    terms.push(in_mm(*a, i + 1));
                }
            }
            "XASPHERE" => {
                // Coefficients of (r/radius)^2i, added to an even asphere.
                let (radius, terms) = self.extra_terms(1, scale)?;
                surface.even = self.even_terms(scale);
                surface.even.resize(surface.even.len().max(terms.len()), 0.0);
                let mut power = 1.0;
                for (sum, a) in surface.even.iter_mut().zip(terms) {
                    power *= radius * radius;
                    *sum += a / power;
                }
            }
            "XOSPHERE" => {
                // Coefficients of (r/radius)^i.
                let (radius, terms) = self.extra_terms(1, scale)?;
                let mut power = 1.0;
                for (i, a) in terms.into_iter().enumerate() {
                    power *= radius;
                    let sums = if i % 2 == 0 { &mut surface.odd } else { &mut surface.even };
                    sums.push(a / power);
                }
            }
            "QED_TYPE" => {
                if self.parameters.iter().any(|v| *v != 0.0) {
                    return refuse("a Q-type asphere with parameters (PARM)");
                }
                let kind = self.forbes_kind()?;
                let (radius, terms) = self.extra_terms(2, scale)?;
                if !terms.is_empty() {
                    surface.form = Form::Forbes(Forbes::new(kind, radius, terms)?);
                }
            }
            "BICONICX" => {
                let curvature = self.curvature_of(1, scale);
                surface.form = Form::Biconic { curvature, conic: self.parameter(2) };
            }
            "TOROIDAL" => self.toroid(surface, scale)?,
            "PARAXIAL" => surface.form = Form::Ideal { focal_mm: self.parameter(1) * scale },
            "COORDBRK" => {
                surface.form = Form::Break;
                surface.entry = self.coordinate_break(scale);
            }
            kind => refuse(&format!("a surface of type {kind}"))?,
        }
        Ok(())
    }

    /// A word on parameters (`PARM`) and extra data (`XDAT`) that nothing above reads.
    pub(super) fn unread(&self) -> Option<String> {
        // A paraxial surface's second one says how path differences are computed.
        let (parameters, extra) = match self.kind.as_str() {
            "EVENASPH" | "ODDASPHE" => (usize::MAX, 0),
            "XASPHERE" => (usize::MAX, self.extra_used(1)),
            "XOSPHERE" => (0, self.extra_used(1)),
            "QED_TYPE" => (0, self.extra_used(2)),
            "BICONICX" | "PARAXIAL" => (2, 0),
            "TOROIDAL" => (8, 2),
            "COORDBRK" => (6, 0),
            _ => (0, 0),
        };
        let unread = |values: &[f64], used: usize, name: &str| {
            let slot = values.iter().skip(used).position(|v| *v != 0.0)? + used;
            Some(format!("{name} {} = {} of a {} surface", slot + 1, values[slot], self.kind))
        };
        let unread =
            [unread(&self.parameters, parameters, "PARM"), unread(&self.extra, extra, "XDAT")];
        let unread: Vec<String> = unread.into_iter().flatten().collect();
        (!unread.is_empty()).then(|| format!("{} is not used", unread.join(" and ")))
    }

    /// Coefficients of r², r⁴, ... from `PARM 1` on.
    fn even_terms(&self, scale: f64) -> Vec<f64> {
        let terms = self.parameters.iter().zip(1..);
        terms.map(|(a, i)| a * scale / libm::pow(scale, f64::from(2 * i))).collect()
    }

    /// How many of the extra data are used, where the number of terms stands at `first`.
    fn extra_used(&self, first: usize) -> usize {
        let terms = self.extra.get(first - 1).copied().unwrap_or(0.0).clamp(0.0, 1e3) as usize;
        first + 1 + terms
    }

    /// `PARM i`, 0 unless given.
    fn parameter(&self, i: usize) -> f64 {
        self.parameters.get(i - 1).copied().unwrap_or(0.0)
    }

    /// One over the radius `PARM i`, 1/mm; a radius of 0 means a plane.
    fn curvature_of(&self, i: usize, scale: f64) -> f64 {
        match self.parameter(i) {
            0.0 => 0.0,
            radius => 1.0 / (radius * scale),
        }
    }

    /// The polynomials of a Q-type asphere: `XDAT 1` is 0 for Q-bfs and 1 for Q-con, as Zemax's
    /// staff say (community.zemax.com, "Listing the Q-bfs Polynomials"). So read, Thorlabs' lens
    /// ASL5040-UV of NA 0.65 focuses to 0.5 µm, and in no other way (`a_q_type_asphere_focuses`).
    fn forbes_kind(&self) -> Result<Kind> {
        match self.extra.first().copied().unwrap_or(0.0) {
            0.0 => Ok(Kind::Bfs),
            1.0 => Ok(Kind::Con),
            other => Err(Error::unsupported(format!("a Q-type asphere of type {other} (XDAT 1)"))
                .help("known are 0 (Q-bfs) and 1 (Q-con)")),
        }
    }

    /// `XDAT` from number `first` on: number of terms, normalisation radius (mm), coefficients
    /// (mm).
    fn extra_terms(&self, first: usize, scale: f64) -> Result<(f64, Vec<f64>)> {
        let extra = self.extra.get(first - 1..).unwrap_or(&[]);
        let used = self.extra_used(first) - first - 1;
        let radius = extra.get(1).copied().unwrap_or(1.0) * scale;
        if used > 0 && radius == 0.0 {
            return Err(Error::input(format!("normalisation radius 0 (XDAT {})", first + 1))
                .help("give the radius the coefficients refer to"));
        }
        Ok((radius, extra.iter().skip(2).take(used).map(|a| a * scale).collect()))
    }

    /// `PARM 1`: radius of rotation; from `PARM 2` on: coefficients of y², y⁴, ...
    fn toroid(&self, surface: &mut Surface, scale: f64) -> Result<()> {
        const COEFFICIENTS: std::ops::RangeInclusive<usize> = 2..=8;
        let beyond = self.parameters.iter().skip(*COEFFICIENTS.end());
        // XDAT 1 is the number of Zernike terms, XDAT 2 their normalisation radius.
        if beyond.chain(self.extra.first()).any(|v| *v != 0.0) {
            return refuse("a toroid with Zernike terms (TOROIDAL)");
        }
        surface.form = Form::Toroid { curvature: self.curvature_of(1, scale) };
        surface.even = COEFFICIENTS
            .map(|i| self.parameter(i) * scale / libm::pow(scale, 2.0 * (i as f64 - 1.0)))
            .collect();
        Ok(())
    }

    /// Decentre x and y, tilts about x, y and z, order; `None` where nothing moves.
    fn coordinate_break(&self, scale: f64) -> Option<Pose> {
        let value = |i: usize| self.parameter(i);
        let decentre = [value(1) * scale, value(2) * scale, 0.0];
        let tilt = [value(3), value(4), value(5)];
        if decentre.iter().chain(&tilt).all(|v| *v == 0.0) {
            return None;
        }
        Some(match value(6) == DECENTRE_FIRST {
            true => Pose::decentred_then_tilted(decentre, tilt),
            false => Pose::tilted_then_decentred(decentre, tilt),
        })
    }
}
