//! Candidates by which neighbours share light or charge: noise of theirs that goes together, and under a colour filter array
//! channels that lean towards each other.

use super::proposal::{LEAST_STRENGTH, Proposal, list};
use crate::data::channels::Channels;
use crate::data::design::Condition;
use crate::evidence::{Estimated, Evidence, pooled, slope};
use crate::model::effects::current;
use crate::statistics::ratios::{reference_flat, strongest};

use crate::statistics::statistic::{Place, What};
use camrig_sensor_core::effects::{
    Effect, brighter_fatter::BrighterFatter, charge_coupling::ChargeCoupling,
    optical_crosstalk::OpticalCrosstalk,
};

/// Part of an estimate that what its equation leaves out may make: estimates are repeated until they stay.
const ROUGH: f64 = 0.25;

/// How much of what a unit of a parameter makes channels lean is seen: in their means, and in their ratios, which neither the
/// lamp nor the channels' own mean gains change. `lean` tells the electrons that each channel gets for a unit, from the
/// photo-electrons of each.
fn leaning(e: &Evidence<'_>, lean: &dyn Fn(&[f64]) -> Vec<f64>) -> Option<Estimated> {
    let n = e.camera.sensor.channel_names.len();
    if n < 2 {
        return None;
    }
    let means = e.flats().filter(|(_, c)| c.level_known).flat_map(|(i, c)| {
        let (k, gets) = (e.gain(c), lean(&c.photo_e));
        (0..n).filter_map(move |class| {
            let d = e.difference(Place::Stack(i), What::Mean(class as u8))?;
            Some((k * gets[class], d))
        })
    });
    // How the ratio of ratios moves with the parameter; the own light of a channel may be nothing.
    // Without a reference there are no ratios to ask it for.
    let reference = e.design.conditions.get(reference_flat(e.design).unwrap_or(0))?;
    let relative = |c: &Condition, class: usize| lean(&c.photo_e)[class] / c.photo_e[class];
    let ratios = e.flats().flat_map(|(i, c)| {
        let g = strongest(c);
        let strong = relative(c, g) - relative(reference, g);
        let gets = lean(&c.photo_e);
        let by = move |own: usize| reference.photo_e[g] / (reference.photo_e[own] * c.photo_e[g]);
        (0..n).filter_map(move |own| {
            let (place, what) = (Place::Stack(i), What::Ratio(own as u8));
            let d = e.difference(place, what)?;
            let ratio = e.predicted(place, what)?;
            Some((by(own) * gets[own] - ratio * (relative(reference, own) + strong), d))
        })
    });
    slope(means.chain(ratios))
}

/// Channels lean towards each other.
pub fn optical_crosstalk(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let channels = Channels::new(e.camera);
        let found = leaning(e, &|photo_e| channels.lean(photo_e))?;
        let present = match current(e.camera, "optical-crosstalk") {
            Some(Effect::OpticalCrosstalk(x)) => f64::from(x.side),
            _ => 0.0,
        };
        let k = (present + found.value).max(0.0);
        let effect = OpticalCrosstalk { side: k as f32, vertical: k as f32, diagonal: 0.0 };
        Some(
            Proposal::new("optical-crosstalk", effect.into(), found.z().abs())
                .with("side", k, found.se)
                .with("vertical", k, found.se),
        )
    })())
}

/// What the means say of a parameter, where it agrees with what noise says.
fn agreeing(noise: Estimated, lean: Option<Estimated>) -> Option<Estimated> {
    lean.filter(|l| {
        let apart = (l.value - noise.value).abs();
        apart < 3.0 * l.se.hypot(noise.se) + ROUGH * noise.value.abs()
    })
}

/// Correlation of neighbours in flats over the share of shot noise: constant. Of the channels' means only the mean of both
/// directions is known.
pub fn charge_coupling(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let of = |lag: u8| {
            slope(e.flats().filter_map(|(i, c)| {
                let r = e.difference(Place::Stack(i), What::Covariance(lag))?;
                Some((2.0 * shot_share(e, i, c)?, r))
            }))
        };
        let (mut x, mut y) = (of(0)?, of(1)?);
        let present = match current(e.camera, "charge-coupling") {
            Some(Effect::ChargeCoupling(k)) => Some((f64::from(k.side), f64::from(k.vertical))),
            _ => None,
        };
        let mut strength = x.z().hypot(y.z());
        let channels = Channels::new(e.camera);
        let both = Estimated { value: (x.value + y.value) / 2.0, se: x.se.hypot(y.se) / 2.0 };
        if let Some(lean) = agreeing(both, leaning(e, &|photo_e| channels.lean(photo_e))) {
            // Least squares of x, y and their mean.
            let off = (lean.value - both.value) / (lean.se.powi(2) + both.se.powi(2));
            for one in [&mut x, &mut y] {
                let shared = one.se.powi(2) / 2.0;
                one.value += shared * off;
                let known = shared * shared / (lean.se.powi(2) + both.se.powi(2));
                one.se = (one.se.powi(2) - known).sqrt();
            }
            // Means alone are no ground for it: `optical-crosstalk` moves them alike.
            if strength > LEAST_STRENGTH || present.is_some() {
                strength = strength.hypot(lean.z());
            }
        }
        let (px, py) = present.unwrap_or((0.0, 0.0));
        let (side, vertical) = ((px + x.value).max(0.0), (py + y.value).max(0.0));
        let effect = ChargeCoupling { side: side as f32, vertical: vertical as f32, diagonal: 0.0 };
        Some(
            Proposal::new("charge-coupling", effect.into(), strength)
                .with("side", side, x.se)
                .with("vertical", vertical, y.se),
        )
    })())
}

/// Share of shot noise in a stack's variance.
fn shot_share(e: &Evidence<'_>, stack: usize, c: &Condition) -> Option<f64> {
    let (v, _) = e.variance(stack)?;
    Some((e.signal(stack)? * e.gain(c) / v).clamp(0.0, 1.0))
}

/// Correlation of neighbours in flats in proportion to the signal, and the variance that is lost to it where both agree;
/// where they do, the charge that brighter channels push into others.
pub fn brighter_fatter(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let channels = Channels::new(e.camera);
        // a times this is what each pixel's shot noise pushes to one side, over the variance: mean of µ² over v.
        let pushed = |i: usize| {
            let (v, _) = e.variance(i)?;
            let squares = e.levels(i).into_iter().zip(channels.shares()).map(|(s, n)| n * s * s);
            Some(squares.sum::<f64>() / v)
        };
        let gained = slope(e.flats().flat_map(|(i, _)| {
            let x = pushed(i).map(|x| 2.0 * x);
            [0, 1].into_iter().filter_map(move |lag| {
                Some((x?, e.difference(Place::Stack(i), What::Covariance(lag))?))
            })
        }))?;
        // (1 − 4b)² + 4b² of the shot noise is left.
        let lost = slope(e.flats().filter_map(|(i, _)| {
            let (v, excess) = (e.variance(i)?.0, e.variance_excess(i)?);
            Some((-8.0 * pushed(i)?, Estimated { value: excess.value / v, se: excess.se / v }))
        }))?;
        let apart = (gained.value - lost.value).abs() / gained.se.hypot(lost.se);
        let mut found = if apart < 3.0 { pooled([gained, lost])? } else { gained };
        let mut strength = found.z().abs();
        let present = match current(e.camera, "brighter-fatter") {
            Some(Effect::BrighterFatter(k)) => Some(f64::from(k.coefficient)),
            _ => None,
        };
        let half_squares = |photo_e: &[f64]| -> Vec<f64> {
            channels.lean(&photo_e.iter().map(|q| 0.5 * q * q).collect::<Vec<_>>())
        };
        if let Some(lean) = agreeing(found, leaning(e, &half_squares)) {
            found = pooled([found, lean])?;
            if strength > LEAST_STRENGTH || present.is_some() {
                strength = strength.hypot(lean.z());
            }
        }
        let a = (present.unwrap_or(0.0) + found.value).max(0.0);
        let effect = BrighterFatter { coefficient: a as f32 };
        let p = Proposal::new("brighter-fatter", effect.into(), strength);
        Some(p.with("coefficient", a, found.se))
    })())
}
