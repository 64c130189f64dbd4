//! Candidates that change the mean signal or how it is converted.

use super::{Proposal, list};
use crate::captures::Role;
use crate::diagnose::evidence::{Estimated, Evidence, pooled, slope};
use crate::diagnose::maps::{MapKind, reference_dark};
use crate::diagnose::model::current;
use crate::diagnose::statistics::{Place, What};
use sensor_core::effects::{
    Effect, black_level_offset::BlackLevelOffset, exposure_offset::ExposureOffset,
    image_lag::ImageLag, nonlinearity::Nonlinearity, optical_crosstalk::OpticalCrosstalk,
    quantum_efficiency::QuantumEfficiency, system_gain::SystemGain,
};

/// Measured over predicted signal of a channel of a flat, less 1.
fn relative(e: &Evidence<'_>, stack: usize, class: u8) -> Option<Estimated> {
    let place = Place::Stack(stack);
    let d = e.difference(place, What::Mean(class))?;
    let m = e.predicted(place, What::Mean(class))?;
    (m > 0.0).then(|| Estimated { value: d.value / m, se: d.se / m })
}

fn classes(e: &Evidence<'_>) -> u8 {
    e.camera.sensor.channel_names.len() as u8
}

/// Mean of the reference dark stack, all channels together or each its own, and its change with gain.
pub fn black_level(e: &Evidence<'_>) -> Vec<Proposal> {
    let Some(reference) = reference_dark(e.design) else { return Vec::new() };
    let present = match current(e.camera, "black-level-offset") {
        Some(Effect::BlackLevelOffset(x)) => x,
        _ => BlackLevelOffset {
            offset_dn: 0.0,
            per_gain_dn: 0.0,
            per_second_dn: 0.0,
            plane_0_dn: 0.0,
            plane_1_dn: 0.0,
            plane_2_dn: 0.0,
            plane_3_dn: 0.0,
        },
    };
    let own: Vec<Estimated> = (0..classes(e))
        .filter_map(|c| e.difference(Place::Stack(reference), What::Mean(c)))
        .collect();
    if own.is_empty() {
        return Vec::new();
    }
    let n = own.len() as f64;
    let mean = own.iter().map(|o| o.value).sum::<f64>() / n;
    // Channels share rows and columns: their errors do not average.
    let se = own.iter().map(|o| o.se).sum::<f64>() / n;
    let mut common = present;
    common.offset_dn += mean as f32;
    let all = Proposal::new("black-level-offset", common.into(), (mean / se).abs()).with(
        "offset_dn",
        f64::from(common.offset_dn),
        se,
    );
    let mut out = vec![all];
    let place = Place::Map(MapKind::Offset);
    let contrasts: Vec<Estimated> =
        (0..3).filter_map(|i| e.difference(place, What::Phase(i))).collect();
    if let [main, other, checker] = contrasts[..] {
        let mut apart = common;
        let (p, q, r) = (main.value, other.value, checker.value);
        let own = [(r + p) / 2.0, (q - r) / 2.0, -(q + r) / 2.0, (r - p) / 2.0];
        let keys = ["plane_0_dn", "plane_1_dn", "plane_2_dn", "plane_3_dn"];
        let parts = [
            &mut apart.plane_0_dn,
            &mut apart.plane_1_dn,
            &mut apart.plane_2_dn,
            &mut apart.plane_3_dn,
        ];
        let strength = contrasts.iter().map(|c| c.z() * c.z()).sum::<f64>().sqrt();
        let mut made = Vec::new();
        for ((part, o), key) in parts.into_iter().zip(own).zip(keys) {
            *part += o as f32;
            made.push((key, f64::from(*part)));
        }
        let mut p = Proposal::new("black-level-offset", apart.into(), strength).with(
            "offset_dn",
            f64::from(apart.offset_dn),
            se,
        );
        for (key, value) in made {
            p = p.with(key, value, main.se / 2.0);
        }
        out.push(p);
    }
    let c0 = &e.design.conditions[reference];
    let per_gain = slope(e.of_role(Role::Dark).filter_map(|(i, c)| {
        let short =
            c.exposure_s <= 2.0 * c0.exposure_s && (c.temperature_c - c0.temperature_c).abs() < 0.5;
        let d = e.difference(Place::Stack(i), What::Mean(0))?;
        (short && i != reference).then_some((c.analog_gain - c0.analog_gain, d))
    }));
    if let Some(g) = per_gain {
        let mut moved = present;
        moved.per_gain_dn += g.value as f32;
        let value = f64::from(moved.per_gain_dn);
        out.push(Proposal::new("black-level-offset", moved.into(), g.z().abs()).with(
            "per_gain_dn",
            value,
            g.se,
        ));
    }
    out
}

/// Common factor of all flats' means.
fn common_factor(e: &Evidence<'_>) -> Option<Estimated> {
    pooled(
        e.flats()
            .filter(|(_, c)| c.level_known)
            .flat_map(|(i, _)| (0..classes(e)).filter_map(move |k| relative(e, i, k))),
    )
}

/// Variance over mean of the flats against the model's, and the dark variance with it.
fn transfer_factor(e: &Evidence<'_>) -> Option<Estimated> {
    pooled(e.flats().filter_map(|(i, c)| {
        let (vd, vm) = e.variance(i)?;
        let se = e.variance_excess(i)?.se / vm;
        let means = if c.level_known { relative(e, i, 0)?.value } else { 0.0 };
        Some(Estimated { value: vd / vm / (1.0 + means) - 1.0, se })
    }))
}

/// Signal and noise alike larger than the model's.
pub fn system_gain(e: &Evidence<'_>) -> Vec<Proposal> {
    let present = match current(e.camera, "system-gain") {
        Some(Effect::SystemGain(x)) => f64::from(x.ratio),
        _ => 1.0,
    };
    // From the means, where the light is known, and from variance over mean.
    [common_factor(e), transfer_factor(e)]
        .into_iter()
        .flatten()
        .map(|f| {
            let ratio = present * (1.0 + f.value);
            Proposal::new("system-gain", SystemGain { ratio: ratio as f32 }.into(), f.z().abs())
                .with("ratio", ratio, present * f.se)
        })
        .collect()
}

/// Signal larger than the model's, at the same gain.
pub fn quantum_efficiency(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let f = common_factor(e)?;
        let present = match current(e.camera, "quantum-efficiency") {
            Some(Effect::QuantumEfficiency(x)) => f64::from(x.ratio),
            _ => 1.0,
        };
        let ratio = present * (1.0 + f.value);
        let effect = QuantumEfficiency { ratio: ratio as f32 };
        Some(Proposal::new("quantum-efficiency", effect.into(), f.z().abs()).with(
            "ratio",
            ratio,
            present * f.se,
        ))
    })())
}

/// Loss that grows with the level.
pub fn nonlinearity(e: &Evidence<'_>) -> Vec<Proposal> {
    let full = e.camera.sensor.full_well_e;
    let (present, held) = match current(e.camera, "nonlinearity") {
        Some(Effect::Nonlinearity(x)) => (f64::from(x.loss), Some(f64::from(x.exponent))),
        _ => (0.0, None),
    };
    let points: Vec<(f64, Estimated)> = e
        .flats()
        .filter(|(_, c)| c.level_known)
        .flat_map(|(i, c)| {
            let x = e.signal(i).unwrap_or(0.0) / e.gain(c) / full;
            (0..classes(e)).filter_map(move |k| Some((x, relative(e, i, k)?)))
        })
        .filter(|(x, _)| *x > 0.0)
        .collect();
    if points.len() < 3 {
        return Vec::new();
    }
    let exponents = match held {
        Some(n) => vec![n],
        None => vec![1.0, 1.5, 2.0, 3.0],
    };
    let mut out = Vec::new();
    for n in exponents {
        // relative = c − a xⁿ, least squares with both free; only a is used.
        let (mut s0, mut s1, mut s2, mut y0, mut y1) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (x, r) in &points {
            let (w, b) = (1.0 / (r.se * r.se), -x.powf(n));
            s0 += w;
            s1 += w * b;
            s2 += w * b * b;
            y0 += w * r.value;
            y1 += w * b * r.value;
        }
        let det = s0 * s2 - s1 * s1;
        if det <= 0.0 {
            continue;
        }
        for free in [true, false] {
            let (a, se) = if free {
                ((s0 * y1 - s1 * y0) / det, (s0 / det).sqrt())
            } else {
                (y1 / s2, s2.sqrt().recip())
            };
            let loss = present + a;
            let effect = Nonlinearity { loss: loss as f32, exponent: n as f32 };
            out.push(
                Proposal::new("nonlinearity", effect.into(), (a / se).abs())
                    .with("loss", loss, se)
                    .with("exponent", n, f64::NAN),
            );
        }
    }
    // The exponent that leaves least; the strongest is that.
    out.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    out.truncate(2);
    out
}

/// Channels lean towards each other.
pub fn optical_crosstalk(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let n = classes(e);
        if n < 2 {
            return None;
        }
        let pattern = e.camera.sensor.pattern();
        let (pw, ph) = (usize::from(pattern.width), usize::from(pattern.height));
        let present = match current(e.camera, "optical-crosstalk") {
            Some(Effect::OpticalCrosstalk(x)) => f64::from(x.side),
            _ => 0.0,
        };
        // What a pixel of a channel gets more from its four neighbours than it gives, in the mean.
        let pull = |means: &[f64], class: usize| {
            let (mut sum, mut count) = (0.0, 0.0);
            for y in 0..ph {
                for x in 0..pw {
                    if pattern.channel(x, y) == class {
                        let at = |x: usize, y: usize| means[pattern.channel(x, y)];
                        sum += at(x + 1, y) + at(x + pw - 1, y) + at(x, y + 1) + at(x, y + ph - 1)
                            - 4.0 * at(x, y);
                        count += 1.0;
                    }
                }
            }
            sum / f64::max(count, 1.0)
        };
        let found = slope(e.flats().filter(|(_, c)| c.level_known).flat_map(|(i, c)| {
            let k = e.gain(c);
            (0..n).filter_map(move |class| {
                let d = e.difference(Place::Stack(i), What::Mean(class))?;
                Some((k * pull(&c.photo_e, usize::from(class)), d))
            })
        }))?;
        let k = (present + found.value).max(0.0);
        let effect = OpticalCrosstalk { side: k as f32, vertical: k as f32, diagonal: 0.0 };
        Some(
            Proposal::new("optical-crosstalk", effect.into(), found.z().abs())
                .with("side", k, found.se)
                .with("vertical", k, found.se),
        )
    })())
}

/// Light of the frame before in a dark frame.
pub fn image_lag(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let after = pooled(e.of_role(Role::Dark).filter_map(|(i, c)| {
            let before = c.before_e.first().copied().unwrap_or(0.0) * e.gain(c);
            let d = e.difference(Place::Stack(i), What::Mean(0))?;
            (before > 0.0).then(|| Estimated { value: d.value / before, se: d.se / before })
        }))?;
        let present = match current(e.camera, "image-lag") {
            Some(Effect::ImageLag(x)) => f64::from(x.fraction),
            _ => 0.0,
        };
        let l = (present + after.value).max(0.0);
        let effect = ImageLag { fraction: l as f32 };
        Some(
            Proposal::new("image-lag", effect.into(), after.z().abs())
                .with("fraction", l, after.se),
        )
    })())
}

/// Signal over exposure against one over exposure.
pub fn exposure_offset(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let points: Vec<(f64, Estimated)> = e
            .flats()
            .filter(|(_, c)| c.level_known)
            .filter_map(|(i, c)| Some((1.0 / c.exposure_s, relative(e, i, 0)?)))
            .collect();
        let (least, most) =
            points.iter().fold((f64::MAX, 0.0f64), |(a, b), p| (a.min(p.0), b.max(p.0)));
        if most < 1.5 * least {
            return None;
        }
        let found = slope(points)?;
        let (present, step) = match current(e.camera, "exposure-offset") {
            Some(Effect::ExposureOffset(x)) => (f64::from(x.offset_us), x.step_us),
            _ => (0.0, 0.0),
        };
        let offset = present + found.value * 1e6;
        let effect = ExposureOffset { offset_us: offset as f32, step_us: step };
        Some(Proposal::new("exposure-offset", effect.into(), found.z().abs()).with(
            "offset_us",
            offset,
            found.se * 1e6,
        ))
    })())
}
