//! Fall-off of the channels of the gain map towards the corners.
//!
//! A least-squares fit of g = a (1 + k r²) over the pixels of a channel, with r the distance from
//! the centre, 1 at the corners: k is the change at the corners due to the effects
//! `relative-illumination` and `colour-shading`. Where the light itself may be uneven, only
//! differences between channels, which all see the same light, belong to the sensor.

use super::maps::Map;
use super::spatial::{CLIP, robust_sds};
use super::statistic::{Place, Scale, Statistic, What};
use crate::data::channels::Channels;

/// Sums over the pixels of a channel: of 1, t, t², g, t g and g², with t = r².
type Sums = [f64; 6];

/// A fitted k.
#[derive(Clone, Copy)]
struct FallOff {
    k: f64,
    variance: f64,
}

/// The k of each channel; where the light may be uneven, minus that of the channel with most
/// pixels.
pub fn fall_offs(map: &Map, channels: &Channels) -> Vec<Statistic> {
    let sums = sums(map, channels);
    let shares = channels.shares();
    let of = |c: usize| fit(&sums[c], map, shares[c]);
    let add = |what, fit: FallOff| {
        let (value, sd) = (fit.k, fit.variance.sqrt());
        let s = Statistic { place: Place::Map(map.kind), what, value, sd, scale: Scale::Linear };
        (value.is_finite() && sd.is_finite()).then_some(s)
    };
    if map.even {
        return (0..sums.len()).filter_map(|c| add(What::FallOff(c as u8), of(c))).collect();
    }
    let densest = channels.densest();
    let reference = of(densest);
    (0..sums.len())
        .filter(|&c| c != densest)
        .filter_map(|c| {
            let own = of(c);
            let variance = own.variance + reference.variance;
            add(What::FallOffDifference(c as u8), FallOff { k: own.k - reference.k, variance })
        })
        .collect()
}

/// Derivative of a statistic of [`fall_offs`] with respect to the k of a channel (`of` = `None`: of
/// all channels); `None` for other statistics. `densest` is the channel with most pixels.
pub fn slope(what: What, of: Option<usize>, densest: usize) -> Option<f64> {
    let own = |c: u8| of.is_none_or(|of| of == usize::from(c));
    match what {
        What::FallOff(c) => Some(f64::from(u8::from(own(c)))),
        What::FallOffDifference(_) if of.is_none() => Some(0.0),
        What::FallOffDifference(_) if of == Some(densest) => Some(-1.0),
        What::FallOffDifference(c) => Some(f64::from(u8::from(own(c)))),
        _ => None,
    }
}

fn sums(map: &Map, channels: &Channels) -> Vec<Sums> {
    let (w, h) = (map.plane.width, map.plane.height);
    let (wf, hf) = (w as f64, h as f64);
    let values = &map.plane.data;
    let sds = robust_sds(values, channels);
    let means = channels.means(values);
    // r² itself stays within 2.8 of its standard deviations and is not clipped.
    let clipped = |v: f32, c: usize| {
        let (mean, most) = (means[c], CLIP * sds[c]);
        f64::from(v).clamp(mean - most, mean + most)
    };
    let mut out = vec![Sums::default(); channels.count()];
    let mut i = 0;
    channels.visit(values, |v, c| {
        let (x, y) = ((i % w) as f64 + 0.5 - wf / 2.0, (i / w) as f64 + 0.5 - hf / 2.0);
        i += 1;
        let t = 4.0 * (x * x + y * y) / (wf * wf + hf * hf);
        let g = clipped(v, c);
        for (sum, term) in out[c].iter_mut().zip([1.0, t, t * t, g, t * g, g * g]) {
            *sum += term;
        }
    });
    out
}

/// The k of a channel. Its variance is from the noise of the channel's pixels and from the
/// patterns of rows and columns, of which a channel with a share s of the pixels has about √s.
fn fit(&[n, t, tt, g, tg, gg]: &Sums, map: &Map, share: f64) -> FallOff {
    let of_t = tt - t * t / n;
    let b = (tg - t * g / n) / of_t;
    let a = (g - b * t) / n;
    let residual = (gg - g * g / n - b * b * of_t).max(0.0) / (n - 2.0);
    let s = &map.spatial;
    let (w, h) = (s.columns.means.len() as f64, s.rows.means.len() as f64);
    let rows = (s.rows.variance - s.pixel_variance / w).max(0.0) / (h * share.sqrt());
    let columns = (s.columns.variance - s.pixel_variance / h).max(0.0) / (w * share.sqrt());
    // A share q of the variance of r² is along y.
    let q = h.powi(4) / (w.powi(4) + h.powi(4));
    let spread = of_t / n;
    let lines = (q * rows + (1.0 - q) * columns) / spread;
    FallOff { k: b / a, variance: (residual / of_t + lines) / (a * a) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maps::MapKind;
    use crate::spatial::describe;
    use camrig_base::Plane;
    use camrig_camera::Camera;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// A gain map of a Bayer sensor whose channels have these k, with pixel and row patterns and
    /// dead pixels.
    fn map(corners: &[f64], even: bool, seed: u64) -> (Map, Channels) {
        let mut camera = Camera::load("mt9v024").unwrap();
        let (w, h) = (96, 64);
        camera.sensor.width = w as u32;
        let channels = Channels::new(&camera);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut data = vec![0.0f32; w * h];
        channels.change(&mut data, corners, |_, k| k);
        for (y, row) in data.chunks_mut(w).enumerate() {
            let line = 1e-3 * normal();
            for (x, v) in row.iter_mut().enumerate() {
                let (u, w) = (x as f64 + 0.5 - 48.0, y as f64 + 0.5 - 32.0);
                let r2 = (u * u + w * w) / (48.0 * 48.0 + 32.0 * 32.0);
                *v = (1.0 + f64::from(*v) * r2 + line + 0.01 * normal()) as f32;
            }
        }
        data.iter_mut().step_by(1777).for_each(|v| *v = 0.0);
        let plane = Plane { width: w, height: h, data };
        let spatial = describe(&plane, &channels, even);
        let (kind, median, after_image) = (MapKind::Gain, 1.0, None);
        (Map { kind, spatial, even, median, after_image, plane }, channels)
    }

    #[test]
    fn fall_offs_and_their_standard_deviations_are_those_simulated() {
        let corners = [-0.05, -0.02, 0.03];
        let mut squares = 0.0;
        for seed in 0..20 {
            let (map, channels) = map(&corners, true, seed);
            let found = fall_offs(&map, &channels);
            assert_eq!(found.len(), 3);
            for (c, s) in found.iter().enumerate() {
                assert_eq!(s.what, What::FallOff(c as u8));
                squares += ((s.value - corners[c]) / s.sd).powi(2);
            }
        }
        // 60 squares of normal variates; channels share the rows' noise, so an effective 20: three
        // times √(2/20).
        assert!((squares / 60.0 - 1.0).abs() < 3.0 * 0.1f64.sqrt(), "{}", squares / 60.0);
    }

    #[test]
    fn uneven_light_leaves_only_differences() {
        let (map, channels) = map(&[-0.05, -0.02, 0.03], false, 1);
        let widest = channels.densest();
        let found = fall_offs(&map, &channels);
        assert_eq!(found.len(), 2);
        for s in found {
            let What::FallOffDifference(c) = s.what else { panic!("{:?}", s.what) };
            let corners = [-0.05, -0.02, 0.03];
            let apart = corners[usize::from(c)] - corners[widest];
            assert!((s.value - apart).abs() < 4.0 * s.sd, "{} {apart} {}", s.value, s.sd);
            assert_eq!(slope(s.what, Some(usize::from(c)), widest), Some(1.0));
            assert_eq!(slope(s.what, Some(widest), widest), Some(-1.0));
            assert_eq!(slope(s.what, None, widest), Some(0.0));
        }
    }
}
