//! Candidates that change the mean signal or how it is converted.

use super::{Proposal, list, minimum};
use crate::evidence::{Estimated, Evidence, pooled, slope};
use crate::maps::{MapKind, reference_dark};
use crate::model::current;
use crate::statistics::{Place, What};
use camrig_camera::Camera;
use camrig_captures::Role;
use camrig_sensor_core::effects::{
    Effect, black_level_offset::BlackLevelOffset, exposure_offset::ExposureOffset,
    image_lag::ImageLag, nonlinearity::Nonlinearity, quantum_efficiency::QuantumEfficiency,
    system_gain::SystemGain,
};
use nalgebra::{DMatrix, DVector};

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
        [What::EveryOtherRow, What::EveryOtherColumn, What::Checkerboard]
            .into_iter()
            .filter_map(|what| e.difference(place, what))
            .collect();
    if let [rows, columns, checkerboard] = contrasts[..] {
        let mut apart = common;
        let (r, c, x) = (rows.value, columns.value, checkerboard.value);
        let own = [r + c + x, r - c - x, c - r - x, x - r - c].map(|o| o / 2.0);
        let se_own = rows.se.hypot(columns.se).hypot(checkerboard.se) / 2.0;
        let keys = ["plane_0_dn", "plane_1_dn", "plane_2_dn", "plane_3_dn"];
        let parts = [
            &mut apart.plane_0_dn,
            &mut apart.plane_1_dn,
            &mut apart.plane_2_dn,
            &mut apart.plane_3_dn,
        ];
        // Columns alone are what channels of the read-out do.
        let strength = rows.z().hypot(checkerboard.z());
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
            p = p.with(key, value, se_own);
        }
        out.push(p);
    }
    let c0 = &e.design.conditions[reference];
    let per_gain = slope(e.of_role(Role::Dark).flat_map(|(i, c)| {
        let short =
            c.exposure_s <= 2.0 * c0.exposure_s && (c.temperature_c - c0.temperature_c).abs() < 0.5;
        let wanted = (0..classes(e)).filter(move |_| short && i != reference);
        let of = move |k| e.difference(Place::Stack(i), What::Mean(k));
        wanted.filter_map(move |k| Some((c.analog_gain - c0.analog_gain, of(k)?)))
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

/// Ratios of system gain and quantum efficiency that a camera has.
fn ratios_of(camera: &Camera) -> [Option<f64>; 2] {
    let gain = match current(camera, "system-gain") {
        Some(Effect::SystemGain(x)) => Some(f64::from(x.ratio)),
        _ => None,
    };
    let efficiency = match current(camera, "quantum-efficiency") {
        Some(Effect::QuantumEfficiency(x)) => Some(f64::from(x.ratio)),
        _ => None,
    };
    [gain, efficiency]
}

/// Signal and noise alike larger than the model's: by means and by variance over mean; where the model has a quantum
/// efficiency of its own, by the latter alone, and the efficiency keeps the means.
pub fn system_gain(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let [gain, efficiency] = ratios_of(e.camera);
        let present = gain.unwrap_or(1.0);
        let (mean, transfer) = (common_factor(e), transfer_factor(e));
        let f = match efficiency {
            Some(_) => transfer?,
            None => pooled(mean.into_iter().chain(transfer))?,
        };
        let ratio = present * (1.0 + f.value);
        let effect = SystemGain { ratio: ratio as f32 };
        let mut p = Proposal::new("system-gain", effect.into(), f.z().abs());
        if let (Some(efficiency), Some(mean)) = (efficiency, mean) {
            let ratio = efficiency * (1.0 + mean.value) / (1.0 + f.value);
            p.along.0.push(QuantumEfficiency { ratio: ratio as f32 }.into());
        }
        Some(p.with("ratio", ratio, present * f.se))
    })())
}

/// Signal larger than the model's, at the same gain; where the model has a gain of its own, at the gain that variance over
/// mean gives.
pub fn quantum_efficiency(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let [gain, efficiency] = ratios_of(e.camera);
        let present = efficiency.unwrap_or(1.0);
        let mean = common_factor(e)?;
        let (f, along) = match gain {
            Some(gain) => {
                let transfer = transfer_factor(e)?;
                let value = (1.0 + mean.value) / (1.0 + transfer.value) - 1.0;
                let ratio = gain * (1.0 + transfer.value);
                let se = mean.se.hypot(transfer.se);
                (Estimated { value, se }, vec![SystemGain { ratio: ratio as f32 }.into()])
            }
            None => (mean, Vec::new()),
        };
        let ratio = present * (1.0 + f.value);
        let effect = QuantumEfficiency { ratio: ratio as f32 };
        let mut p = Proposal::new("quantum-efficiency", effect.into(), f.z().abs());
        p.along.0 = along;
        Some(p.with("ratio", ratio, present * f.se))
    })())
}

/// The quantum efficiency, where the model has one of its own, beside something that multiplies the flats' means by this.
pub fn efficiency_beside(e: &Evidence<'_>, mean: f64) -> Option<Effect> {
    let [_, efficiency] = ratios_of(e.camera);
    let ratio = efficiency? * (1.0 + common_factor(e)?.value) / mean;
    Some(QuantumEfficiency { ratio: ratio as f32 }.into())
}

/// Exponents of a loss that grows with the level.
const EXPONENTS: [f64; 2] = [1.0, 4.0];

/// Least squares of relative = c − a xⁿ − b l xⁿ ln x, the scale c free or none.
struct Bend {
    /// c, 0 where it is none.
    scale: f64,
    /// a and b.
    values: [Estimated; 2],
    /// χ² left.
    left: f64,
    /// Fall of χ² by a and b.
    fell: f64,
}

fn bend(points: &[(f64, Estimated)], free: bool, n: f64, l: f64) -> Option<Bend> {
    let weighted = |f: &dyn Fn(f64) -> f64| {
        DVector::from_iterator(points.len(), points.iter().map(|(x, r)| f(*x) / r.se))
    };
    let y = DVector::from_iterator(points.len(), points.iter().map(|(_, r)| r.value / r.se));
    let scale = weighted(&|_| f64::from(u8::from(free)));
    let unbent = match scale.norm_squared() {
        0.0 => y.clone(),
        norm => &y - &scale * (scale.dot(&y) / norm),
    };
    let columns = [scale, weighted(&|x| -x.powf(n)), weighted(&|x| -l * x.powf(n) * x.ln())];
    let a = DMatrix::from_columns(&columns);
    let svd = a.clone().svd(true, true);
    let least = 1e-9 * svd.singular_values.max();
    let solved = svd.solve(&y, least).ok()?;
    let inverse = svd.pseudo_inverse(least).ok()?;
    let value = |i: usize| Estimated { value: solved[i], se: inverse.row(i).norm() };
    let left = (&y - a * &solved).norm_squared();
    let fell = (unbent.norm_squared() - left).max(0.0);
    Some(Bend { scale: solved[0], values: [value(1), value(2)], left, fell })
}

/// Loss that grows with the level: what a xⁿ explains of the flats' means, x in full wells. Where the model has a quantum
/// efficiency of its own, that keeps the scale.
pub fn nonlinearity(e: &Evidence<'_>) -> Vec<Proposal> {
    let full = e.camera.sensor.full_well_e;
    let points: Vec<(f64, Estimated)> = e
        .flats()
        .filter(|(_, c)| c.level_known)
        .flat_map(|(i, c)| {
            let levels = e.levels(i).into_iter().map(move |level| level / e.gain(c) / full);
            (0..).zip(levels).filter_map(move |(k, x)| Some((x, relative(e, i, k)?)))
        })
        .filter(|(x, _)| *x > 0.0)
        .collect();
    if points.len() < 4 {
        return Vec::new();
    }
    let [_, efficiency] = ratios_of(e.camera);
    let scales: &[bool] = if efficiency.is_some() { &[true] } else { &[true, false] };
    let made = scales.iter().filter_map(|&free| {
        let (loss, exponent, fit) = match current(e.camera, "nonlinearity") {
            // In the model already: what is to be added to its loss and exponent.
            Some(Effect::Nonlinearity(x)) => {
                let (loss, n) = (f64::from(x.loss), f64::from(x.exponent));
                let fit = bend(&points, free, n, loss)?;
                (loss + fit.values[0].value, n + fit.values[1].value.clamp(-1.0, 1.0), fit)
            }
            _ => {
                let left = |n| bend(&points, free, n, 0.0).map_or(f64::MAX, |f| f.left);
                let n = minimum(EXPONENTS[0], EXPONENTS[1], 20, left);
                let straight = bend(&points, free, n, 0.0)?;
                let loss = straight.values[0].value;
                let values = bend(&points, free, n, loss)?.values;
                (loss, n, Bend { values, ..straight })
            }
        };
        let exponent = exponent.clamp(EXPONENTS[0], EXPONENTS[1]);
        let effect = Nonlinearity { loss: loss as f32, exponent: exponent as f32 };
        let mut p = Proposal::new("nonlinearity", effect.into(), fit.fell.sqrt())
            .with("loss", loss, fit.values[0].se)
            .with("exponent", exponent, fit.values[1].se);
        p.along.0 = efficiency
            .map(|ratio| QuantumEfficiency { ratio: (ratio * (1.0 + fit.scale)) as f32 }.into())
            .into_iter()
            .collect();
        Some(p)
    });
    let mut out: Vec<Proposal> = made.collect();
    out.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    out
}

/// Light of the frame before in a dark frame.
pub fn image_lag(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let after = slope(e.of_role(Role::Dark).flat_map(|(i, c)| {
            let k = e.gain(c);
            (0..).zip(&c.before_e).filter_map(move |(class, before)| {
                Some((before * k, e.difference(Place::Stack(i), What::Mean(class))?))
            })
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
            .flat_map(|(i, c)| {
                let of = move |k| Some((1.0 / c.exposure_s, relative(e, i, k)?));
                (0..classes(e)).filter_map(of)
            })
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
