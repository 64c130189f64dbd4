//! Pixels with an outlying offset that depends on neither exposure nor light. They are not hot
//! pixels, whose excess grows with the exposure, nor telegraph noise, which makes them noisier.

use super::seen::Seen;
use super::view::{View, change_mean, channel_medians, gain};
use super::{FALSE_ALARMS, Shape, shapes};
use crate::data::channels::Channels;
use crate::data::design::Design;
use crate::finding::{Finding, number};
use crate::numerics::tails;
use crate::report::{Domain, Form};
use crate::statistics::maps::{self, MapKind};
use crate::statistics::temporal::{Temporal, mean};
use camrig_base::Value;
use camrig_base::median::robust_sd;
use camrig_base::numbers::counted;
use camrig_camera::Camera;
use camrig_camera::empirical::{Empirical, Law, Table};
use camrig_captures::Role;
use camrig_sensor_core::effects::empirical::Quantity;
use std::collections::BTreeMap;

/// Knots of each tail of the distribution.
const KNOTS: usize = 32;
/// Largest normal deviate of a pixel.
const MAX_DEVIATE: f64 = 6.0;
/// Fewest pixels that make a distribution.
const MIN_PIXELS: usize = 5;
/// Change in a longer dark up to which an offset is constant: a fraction of the offset, and
/// standard errors.
const MAX_RELATIVE_CHANGE: f64 = 0.25;
const MAX_CHANGE_Z: f64 = 4.0;
/// Variance relative to that of all pixels above which they are noisy pixels.
const MAX_VARIANCE_RATIO: f64 = 1.5;

/// Pixels with outlying offsets.
pub(crate) struct Outliers {
    /// Offset by pixel, row-major, e⁻.
    offsets: BTreeMap<usize, f64>,
    width: usize,
    fraction: Value,
    mean_e: Value,
    /// Number of those below the others.
    below: usize,
    /// Smallest significant offset, e⁻.
    least_e: f64,
    evidence: [f64; 2],
}

/// The outliers that both halves show.
pub(crate) fn find(fit: &View<'_>, held_out: &View<'_>) -> Vec<Box<dyn Shape>> {
    shapes(outliers(fit, held_out))
}

/// A stack's mean minus the median of each channel, e⁻.
fn offsets(view: &View<'_>, stack: usize) -> Vec<f32> {
    let t = &view.stacks[stack];
    let channels = Channels::new(view.camera);
    let mut values = t.mean.data.clone();
    let middles = channel_medians(&values, &channels);
    let unit = (1.0 / view.gain(stack)) as f32;
    channels.change(&mut values, &middles, |v, m| (v - m) * unit);
    values
}

fn outliers(fit: &View<'_>, held_out: &View<'_>) -> Option<Outliers> {
    fit.plane(MapKind::Offset)?;
    let own = maps::reference_dark(fit.design)?;
    let other = maps::reference_dark(held_out.design)?;
    let (a, b) = (offsets(fit, own), offsets(held_out, other));
    let (sd_a, sd_b) = (robust_sd(a.iter().copied()), robust_sd(b.iter().copied()));
    let t = &fit.stacks[own];
    let (w, h) = (t.width, t.height);
    // Two-sided, for the most of all pixels.
    let z = tails::normal_quantile(libm::log(FALSE_ALARMS / (2.0 * a.len() as f64)));
    let (least, least_again) = (z * sd_a, z / 2.0 * sd_b);
    let inner = |i: usize| (1..w - 1).contains(&(i % w)) && (1..h - 1).contains(&(i / w));
    let seen = |i: &usize| {
        let (x, y) = (f64::from(a[*i]), f64::from(b[*i]));
        inner(*i) && x.abs() > least && y * x.signum() > least_again
    };
    let longer: Vec<(Vec<f32>, f64)> = fit
        .stacks_of(Role::Dark)
        .filter(|&i| i != own)
        .map(|i| {
            let values = offsets(fit, i);
            let sd = robust_sd(values.iter().copied());
            (values, sd)
        })
        .collect();
    let stays = |i: &usize| {
        let x = f64::from(a[*i]);
        longer.iter().all(|(values, sd)| {
            (f64::from(values[*i]) - x).abs()
                < MAX_RELATIVE_CHANGE * x.abs() + MAX_CHANGE_Z * libm::hypot(*sd, sd_a)
        })
    };
    let candidates: Vec<usize> = (0..a.len()).filter(seen).collect();
    let found: Vec<usize> = candidates.iter().copied().filter(stays).collect();
    // Where most of them grow with exposure, the few that happen not to are hot pixels too.
    if longer.is_empty() || found.len() < MIN_PIXELS || 2 * found.len() < candidates.len() {
        return None;
    }
    let variance = found.iter().map(|&i| f64::from(t.pixel_variance[i])).sum::<f64>();
    if variance / found.len() as f64 > MAX_VARIANCE_RATIO * mean(&t.pixel_variance) {
        return None;
    }
    let count = found.len() as f64;
    let size = |i: usize| (f64::from(a[i]) + f64::from(b[i])) / 2.0;
    // An exponential distribution is memoryless: above the threshold it is the same again.
    let mean_e = found.iter().map(|&i| size(i).abs() - least).sum::<f64>() / count;
    let mean_e = mean_e.max(sd_a);
    let pixels = ((w - 2) * (h - 2)) as f64;
    let fraction = count / pixels * libm::exp(least / mean_e);
    let evidence =
        |v: &[f32], sd: f64| found.iter().map(|&i| (f64::from(v[i]) / sd).powi(2)).sum::<f64>();
    Some(Outliers {
        offsets: found.iter().map(|&i| (i, size(i))).collect(),
        width: w,
        fraction: Value { value: fraction, std_error: fraction / count.sqrt() },
        mean_e: Value { value: mean_e, std_error: mean_e / count.sqrt() },
        below: found.iter().filter(|&&i| a[i] < 0.0).count(),
        least_e: least,
        evidence: [evidence(&a, sd_a), evidence(&b, sd_b)],
    })
}

impl Shape for Outliers {
    fn subtract(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]) {
        for (c, t) in design.conditions.iter().zip(stacks) {
            let k = gain(camera, c);
            change_mean(camera, t, &|x, y, v| {
                v - k * self.offsets.get(&(y * self.width + x)).copied().unwrap_or(0.0)
            });
        }
    }

    fn stages(&self, _: &mut Camera, _: &Design) -> Vec<Empirical> {
        let (mean_e, share) = (self.mean_e.value, self.fraction.value.clamp(1e-9, 0.5));
        let low = share * self.below as f64 / self.offsets.len() as f64;
        // From the deviate above which pixels are outliers, the quantiles of an exponential
        // distribution.
        let tail = |share: f64| -> Vec<(f64, f64)> {
            let from = tails::normal_quantile(libm::log(share.max(1e-12)));
            let knot = |i: usize| {
                let z = from + (MAX_DEVIATE - from) * i as f64 / (KNOTS - 1) as f64;
                (z, libm::log(share) - tails::ln_upper(z))
            };
            if share > 0.0 { (0..KNOTS).map(knot).collect() } else { Vec::new() }
        };
        let below = tail(low).into_iter().rev().map(|(z, v)| (-z, -v));
        let (deviates, values) = below.chain(tail(share - low)).unzip();
        let law = Table::Distribution(Law { deviates, values });
        vec![Empirical::new(Quantity::Offset, law, mean_e)]
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        let dark = maps::reference_dark(view.design)?;
        let values = offsets(view, dark).into_iter().map(f64::from).collect();
        Some(Seen::quantiles("offset, e⁻", values))
    }

    fn findings(&self) -> Vec<Finding> {
        let below = match self.below {
            0 => String::new(),
            n => format!(", {n} of them below the others"),
        };
        vec![Finding {
            parameters: vec![
                ("fraction", self.fraction),
                ("mean_e", self.mean_e),
                ("pixels", Value::chosen(self.offsets.len() as f64)),
            ],
            description: format!(
                "outlying pixels of the offset, which grow with neither exposure nor light and are \
                 no noisier than others: a fraction {} of all pixels, {} e⁻ in the mean by an \
                 exponential law ({} beyond {:.1} e⁻{below})",
                number(self.fraction),
                number(self.mean_e),
                counted(self.offsets.len(), "pixel"),
                self.least_e,
            ),
            ..Finding::new(Domain::Offset, Form::Distribution, self.evidence)
        }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::bench::{Hidden, Shot, figure, shoot};

    #[test]
    fn outliers_of_the_offset_are_told_and_hot_pixels_are_not() {
        let size = |i: usize| if i % 101 == 50 { 20.0 + (i % 7) as f64 * 15.0 } else { 0.0 };
        let offset = |e: &mut [f64], _: &mut Shot<'_>| {
            e.iter_mut().enumerate().for_each(|(i, v)| *v += size(i));
        };
        let hot = |e: &mut [f64], shot: &mut Shot<'_>| {
            e.iter_mut().enumerate().for_each(|(i, v)| *v += size(i) * 30.0 * shot.exposure_s);
        };
        let bench = shoot(31, &Hidden { volts: Some(&offset), ..Hidden::default() });
        let found = find(&bench.view(0), &bench.view(1));
        let findings: Vec<Finding> = found.iter().flat_map(|s| s.findings()).collect();
        let [outliers] = &findings[..] else { panic!("{findings:?}") };
        // 39 or 40 pixels of the 4032 less the border's; every seventh of the sizes is 20 e⁻.
        assert!((36.0..41.0).contains(&figure(outliers, "pixels")), "{outliers:?}");
        let bench = shoot(32, &Hidden { charge: Some(&hot), ..Hidden::default() });
        assert!(find(&bench.view(0), &bench.view(1)).is_empty());
        let bench = shoot(33, &Hidden::default());
        assert!(find(&bench.view(0), &bench.view(1)).is_empty());
    }
}
