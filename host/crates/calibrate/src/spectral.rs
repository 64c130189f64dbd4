//! Spectral reflectance from a camera's few channels (Chen et al. 2009, section II, equations 1 to
//! 3).
//!
//! Reflectances are written S = m + B w: m the mean of a training set, B its first k principal
//! components, w weights of which the training set gives the covariance Λ. The channels of a
//! camera, each relative to its own signal on a perfect white, see r = C S with `C[c][b]` the
//! share of band b in channel c under the light. Three values do not determine six weights; the
//! estimate is the linear one of least mean square error for the prior (m, Λ) and relative noise σ
//! (Wiener):
//!
//! w = Λ Aᵀ (A Λ Aᵀ + σ² 1)⁻¹ (r − C m), A = C B.
//!
//! The plain alternative, w = A⁺ r with components about zero, is kept for comparison. Estimates
//! are clipped to 0..=1.
//!
//! C is known of a camera whose quantum efficiency is known. The paper's own route needs none: the
//! exitances S_i of the patches of a chart are measured under three lights, beside the camera's
//! signals r_i of them. With B the first k components of all S_i about zero and S_i = B w_i (eq. 1),
//! C B follows from r_i = (C B) w_i (eq. 3) by least squares, and C = (C B) Bᵀ, which has no part
//! that no measured exitance shows ([`sensitivities`]). From there both routes are one.

use camrig_base::Bands;
use camrig_base::{Error, Result};
use camrig_light::Illuminant;
use camrig_light::delta_e::{delta_e_2000, lab};
use camrig_light::photometry::observer_in_bands;
use camrig_linear::{Matrix, Singular, Vector, apply, inverse, product, symmetric_eigen};
use camrig_vector::vectorised;
use rayon::prelude::*;

/// Relative noise of a channel that the estimate is regularised with by default.
pub const NOISE: f64 = 0.01;

/// What a camera's channels see of a reflectance: C of the module's text.
#[derive(Clone, Debug)]
pub struct Channels(Matrix);

impl Channels {
    /// From sensitivities per channel and band (electrons per energy, any scale) and light per
    /// band.
    pub fn new(sensitivity: &[Vec<f64>], light: &[f64]) -> Result<Self> {
        let mut rows =
            Matrix::from_fn(sensitivity.len(), light.len(), |c, b| sensitivity[c][b] * light[b]);
        for (channel, mut row) in rows.row_iter_mut().enumerate() {
            let white = row.sum();
            if !(white > 0.0) {
                return Err(Error::input(format!("channel {channel} sees nothing of the light"))
                    .help("check the quantum efficiency and the illuminant"));
            }
            row /= white;
        }
        Ok(Self(rows))
    }

    /// Signals of a reflectance, 1 for a perfect white.
    pub fn see(&self, reflectance: &[f64]) -> Vec<f64> {
        apply(&self.0, &Vector::from_column_slice(reflectance)).data.into()
    }
}

/// Sensitivities per channel and band, on any scale, from exitances that were measured and the
/// signals of each, by their first `components` components; see the module's text.
///
/// # Errors
/// More components than spectra allow, spectra that do not tell them apart.
pub fn sensitivities(
    exitances: &[Vec<f64>],
    signals: &[Vec<f64>],
    components: usize,
) -> Result<Vec<Vec<f64>>> {
    let (_, basis, _) = principal_components(exitances, components, false)?;
    let spectra = Matrix::from_fn(basis.nrows(), exitances.len(), |b, i| exitances[i][b]);
    let seen = Matrix::from_fn(signals[0].len(), signals.len(), |c, i| signals[i][c]);
    let weights = Singular::of(&product(&basis.transpose(), &spectra));
    let inverse = weights.pseudo_inverse(1e-12).ok_or_else(|| {
        Error::input("the exitances do not determine the channels")
            .help("measure the patches under lights that differ, as daylight and tungsten do")
    })?;
    let channels = product(&product(&seen, &inverse), &basis.transpose());
    Ok(channels.row_iter().map(|row| row.iter().copied().collect()).collect())
}

/// How far signals are from those of the exitances that a chart's patches have, in the best case
/// for the camera: the residual of [`sensitivities`] from them alone, rms over patches and
/// channels, relative to the brightest patch of each channel. Infinite where a channel sees
/// nothing.
pub(crate) fn unexplained(
    exitances: &[Vec<f64>],
    signals: &[Vec<f64>],
    components: usize,
) -> Result<f64> {
    let mut square = 0.0;
    let sensitivities = sensitivities(exitances, signals, components)?;
    for (channel, sensitivity) in sensitivities.iter().enumerate() {
        let white = signals.iter().map(|s| s[channel]).fold(0.0, f64::max);
        if white == 0.0 {
            return Ok(f64::INFINITY);
        }
        for (exitance, signal) in exitances.iter().zip(signals) {
            let seen: f64 = sensitivity.iter().zip(exitance).map(|(s, e)| s * e).sum();
            square += ((signal[channel] - seen) / white).powi(2);
        }
    }
    Ok((square / (signals.len() * sensitivities.len()) as f64).sqrt())
}

/// A linear estimator: S = offset + matrix · r.
#[derive(Clone, Debug)]
pub struct Estimator {
    /// Per band a weight for each channel.
    matrix: Matrix,
    offset: Vector,
}

impl Estimator {
    /// The regularised estimate with the training set's prior, `components` components and
    /// relative noise `noise`.
    pub fn regularised(
        channels: &Channels,
        training: &[Vec<f64>],
        components: usize,
        noise: f64,
    ) -> Result<Self> {
        let (mean, basis, variances) = principal_components(training, components, true)?;
        let a = product(&channels.0, &basis);
        let prior = Matrix::from_diagonal(&variances);
        let mut seen = product(&product(&a, &prior), &a.transpose());
        for i in 0..seen.nrows() {
            seen[(i, i)] += noise * noise;
        }
        let inverse = inverse(seen).ok_or_else(no_inverse)?;
        let weighted = product(&product(&basis, &prior), &a.transpose());
        let matrix = product(&weighted, &inverse);
        let offset = &mean - apply(&matrix, &apply(&channels.0, &mean));
        Ok(Self { matrix, offset })
    }

    /// The plain pseudo-inverse: least-norm weights of components about zero.
    pub fn pseudo_inverse(
        channels: &Channels,
        training: &[Vec<f64>],
        components: usize,
    ) -> Result<Self> {
        let (_, basis, _) = principal_components(training, components, false)?;
        let seen = Singular::of(&product(&channels.0, &basis));
        let matrix = product(&basis, &seen.pseudo_inverse(1e-12).ok_or_else(no_inverse)?);
        let offset = Vector::zeros(matrix.nrows());
        Ok(Self { matrix, offset })
    }

    /// The reflectance estimated from signals.
    pub fn estimate(&self, signals: &[f64]) -> Vec<f64> {
        let estimate = &self.offset + apply(&self.matrix, &Vector::from_column_slice(signals));
        estimate.iter().map(|v| v.clamp(0.0, 1.0)).collect()
    }

    /// One band of a whole image from its channels' planes, relative to white.
    pub fn band(&self, band: usize, channels: &[&[f32]], out: &mut [f32]) {
        let offset = self.offset[band] as f32;
        let weights: Vec<f32> = self.matrix.row(band).iter().map(|&w| w as f32).collect();
        const PIECE: usize = 1 << 16;
        out.par_chunks_mut(PIECE).enumerate().for_each(|(i, out)| {
            let of_piece: Vec<(f32, &[f32])> = weights
                .iter()
                .zip(channels)
                .map(|(&weight, channel)| (weight, &channel[i * PIECE..][..out.len()]))
                .collect();
            weigh(offset, &of_piece, out);
        });
    }
}

/// The offset and the weighted channels, kept within 0..=1: every value is read once and written
/// once.
#[vectorised]
fn weigh(offset: f32, channels: &[(f32, &[f32])], out: &mut [f32]) {
    const SIDE: usize = 64;
    let (whole, rest) = out.as_chunks_mut::<SIDE>();
    for (i, out) in whole.iter_mut().enumerate() {
        let mut sum = [offset; SIDE];
        for &(weight, channel) in channels {
            let values = &channel[i * SIDE..][..SIDE];
            for (sum, v) in sum.iter_mut().zip(values) {
                *sum += weight * v;
            }
        }
        *out = sum.map(|v| v.clamp(0.0, 1.0));
    }
    let first = whole.len() * SIDE;
    for (i, out) in rest.iter_mut().enumerate() {
        let sum = channels.iter().fold(offset, |sum, (weight, v)| sum + weight * v[first + i]);
        *out = sum.clamp(0.0, 1.0);
    }
}

fn no_inverse() -> Error {
    Error::input("the channels cannot be distinguished")
        .help("check the camera's quantum efficiency")
}

/// Mean (zero unless `centred`), components as columns, and the variance of each.
fn principal_components(
    training: &[Vec<f64>],
    components: usize,
    centred: bool,
) -> Result<(Vector, Matrix, Vector)> {
    let (count, bands) = (training.len(), training.first().map_or(0, Vec::len));
    let most = bands.min(count.saturating_sub(1));
    if components == 0 || components > most {
        return Err(Error::input(format!("{components} components of {count} training spectra"))
            .help(format!("use 1 to {most}, or more spectra")));
    }
    let spectra = Matrix::from_fn(count, bands, |i, b| training[i][b]);
    let mean = if centred { spectra.row_mean().transpose() } else { Vector::zeros(bands) };
    let deviations = Matrix::from_fn(count, bands, |i, b| training[i][b] - mean[b]);
    let covariance = product(&deviations.transpose(), &deviations) / (count as f64 - 1.0);
    let (values, vectors) = symmetric_eigen(covariance);
    let basis = Matrix::from_fn(bands, components, |b, k| vectors[(b, k)]);
    let variances = Vector::from_fn(components, |k, _| values[k].max(0.0));
    Ok((mean, basis, variances))
}

/// Errors of an estimator on patches.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Report {
    /// Root mean square error of the reflectance, per patch over the bands.
    pub rmse_per_patch: Vec<f64>,
    /// The same per band over the patches.
    pub rmse_per_band: Vec<f64>,
    /// Over everything.
    pub rmse: f64,
    /// ΔE00 per light and patch.
    pub delta_e: Vec<(String, Vec<f64>)>,
}

/// Compares estimates with the true reflectances of the patches.
pub fn report(bands: &Bands, truth: &[Vec<f64>], estimates: &[Vec<f64>]) -> Result<Report> {
    let square = |p: usize, b: usize| (truth[p][b] - estimates[p][b]).powi(2);
    let (patches, count) = (truth.len(), bands.count);
    let mean_root = |sum: f64, n: usize| (sum / n as f64).sqrt();
    let of_patch = |p: usize| (0..count).map(|b| square(p, b)).sum::<f64>();
    let of_band = |b: usize| (0..patches).map(|p| square(p, b)).sum::<f64>();
    let observer = observer_in_bands(bands);
    let mut delta_e = Vec::new();
    for name in ["D65", "A", "F11"] {
        let light = Illuminant::parse(name)?.in_bands(bands);
        let xyz = |reflectance: &[f64]| {
            [0, 1, 2].map(|i| (0..count).map(|b| observer[i][b] * light[b] * reflectance[b]).sum())
        };
        let white = xyz(&vec![1.0; count]);
        let differences = truth
            .iter()
            .zip(estimates)
            .map(|(t, e)| delta_e_2000(lab(xyz(t), white), lab(xyz(e), white)));
        delta_e.push((name.to_string(), differences.collect()));
    }
    Ok(Report {
        rmse_per_patch: (0..patches).map(|p| mean_root(of_patch(p), count)).collect(),
        rmse_per_band: (0..count).map(|b| mean_root(of_band(b), patches)).collect(),
        rmse: mean_root((0..patches).map(of_patch).sum(), patches * count),
        delta_e,
    })
}

/// Which estimator a leave-one-out test is of.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// [`Estimator::regularised`] with this relative noise.
    Regularised(f64),
    /// [`Estimator::pseudo_inverse`].
    PseudoInverse,
}

/// Estimates every patch by an estimator trained without it on the others and `more` spectra, from
/// the signals that the channels see of it, or from measured ones.
pub fn leave_one_out(
    channels: &Channels,
    patches: &[Vec<f64>],
    more: &[Vec<f64>],
    components: usize,
    method: Method,
    measured: Option<&[Vec<f64>]>,
) -> Result<Vec<Vec<f64>>> {
    let estimate = |left_out: usize| {
        let others = patches.iter().enumerate().filter(|(i, _)| *i != left_out).map(|(_, p)| p);
        let training: Vec<Vec<f64>> = others.chain(more).cloned().collect();
        let estimator = match method {
            Method::Regularised(noise) => {
                Estimator::regularised(channels, &training, components, noise)?
            }
            Method::PseudoInverse => Estimator::pseudo_inverse(channels, &training, components)?,
        };
        Ok(match measured {
            Some(signals) => estimator.estimate(&signals[left_out]),
            None => estimator.estimate(&channels.see(&patches[left_out])),
        })
    };
    (0..patches.len()).map(estimate).collect()
}

/// The number of components, 3 to 12, of the least leave-one-out error.
pub fn choose_components(
    channels: &Channels,
    bands: &Bands,
    patches: &[Vec<f64>],
    more: &[Vec<f64>],
    noise: f64,
) -> Result<usize> {
    let mut best = (f64::INFINITY, 0);
    for components in 3..=12.min(patches.len() + more.len() - 2) {
        let method = Method::Regularised(noise);
        let estimates = leave_one_out(channels, patches, more, components, method, None)?;
        let rmse = report(bands, patches, &estimates)?.rmse;
        if rmse < best.0 {
            best = (rmse, components);
        }
    }
    Ok(best.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::Camera;
    use camrig_scene::chart::colorchecker;

    fn patches() -> Vec<Vec<f64>> {
        let table = colorchecker::reflectances();
        (0..24).map(|i| table.spectrum(i).unwrap().in_bands(&Bands::VISIBLE)).collect()
    }

    fn channels(light: &str) -> Channels {
        let camera = Camera::load("mt9v024").unwrap();
        let light = Illuminant::parse(light).unwrap().in_bands(&Bands::VISIBLE);
        Channels::new(&camera.sensor.response(&Bands::VISIBLE), &light).unwrap()
    }

    /// A training set with as many degrees of freedom as channels is estimated exactly.
    #[test]
    fn three_components_from_three_channels_are_exact() {
        let channels = channels("D65");
        let shapes: [fn(f64) -> f64; 3] = [|_| 1.0, |t| t, |t| t * t];
        let spectrum = |w: [f64; 3]| -> Vec<f64> {
            (0..31).map(|b| (0..3).map(|i| w[i] * shapes[i](f64::from(b) / 30.0)).sum()).collect()
        };
        let training: Vec<Vec<f64>> = (0..9)
            .map(|i| spectrum([0.3, 0.05 * f64::from(i % 3), 0.04 * f64::from(i / 3)]))
            .chain([spectrum([0.5, 0.1, 0.0])])
            .collect();
        let truth = spectrum([0.35, 0.07, 0.05]);
        let signals = channels.see(&truth);
        for estimator in [
            Estimator::regularised(&channels, &training, 3, 1e-9).unwrap(),
            Estimator::pseudo_inverse(&channels, &training, 3).unwrap(),
        ] {
            for (got, expected) in estimator.estimate(&signals).iter().zip(&truth) {
                assert!((got - expected).abs() < 1e-5, "{got} {expected}");
            }
        }
    }

    /// A camera of which nothing is known but what it saw of 24 patches under daylight, tungsten and
    /// a fluorescent lamp: its signals are reproduced, and reflectances come out nearly as well as
    /// with its known quantum efficiency, under a fourth light too.
    #[test]
    fn exitances_under_three_lights_stand_for_the_quantum_efficiency() {
        let (patches, bands) = (patches(), Bands::VISIBLE);
        let known = Camera::load("mt9v024").unwrap().sensor.response(&bands);
        let light = |name| Illuminant::parse(name).unwrap().in_bands(&bands);
        let (mut exitances, mut signals) = (Vec::new(), Vec::new());
        for name in ["D65", "A", "F11"] {
            let light = light(name);
            for patch in &patches {
                let exitance: Vec<f64> = patch.iter().zip(&light).map(|(r, l)| r * l).collect();
                let signal = |s: &Vec<f64>| s.iter().zip(&exitance).map(|(s, e)| s * e).sum();
                signals.push(known.iter().map(signal).collect::<Vec<f64>>());
                exitances.push(exitance);
            }
        }
        let found = sensitivities(&exitances, &signals, 6).unwrap();
        for (exitance, signal) in exitances.iter().zip(&signals) {
            for (channel, exact) in found.iter().zip(signal) {
                let again: f64 = channel.iter().zip(exitance).map(|(s, e)| s * e).sum();
                // Six components leave up to a tenth of a dark patch under the spikes of a
                // fluorescent lamp.
                assert!((again / exact - 1.0).abs() < 0.1, "{again} {exact}");
            }
        }
        for name in ["D65", "A", "D50"] {
            let rmse = |sensitivity: &[Vec<f64>]| {
                let seen = Channels::new(&known, &light(name)).unwrap();
                let channels = Channels::new(sensitivity, &light(name)).unwrap();
                let signals: Vec<Vec<f64>> = patches.iter().map(|p| seen.see(p)).collect();
                let method = Method::Regularised(NOISE);
                let estimates =
                    leave_one_out(&channels, &patches, &[], 6, method, Some(&signals)).unwrap();
                report(&bands, &patches, &estimates).unwrap().rmse
            };
            let (by_exitance, by_efficiency) = (rmse(&found), rmse(&known));
            println!("{name}: rmse {by_exitance:.4}, with the efficiency {by_efficiency:.4}");
            assert!(by_exitance < 1.2 * by_efficiency, "{by_exitance} {by_efficiency}");
        }
        assert!(sensitivities(&exitances[..3], &signals[..3], 6).is_err());
    }

    /// The 24 patches, each estimated from the other 23: the prior beats the plain pseudo-inverse
    /// by a wide margin, under daylight and tungsten.
    #[test]
    fn prior_beats_the_pseudo_inverse() {
        let (patches, bands) = (patches(), Bands::VISIBLE);
        for light in ["D65", "A"] {
            let channels = channels(light);
            let score = |method| {
                let estimates = leave_one_out(&channels, &patches, &[], 6, method, None).unwrap();
                report(&bands, &patches, &estimates).unwrap()
            };
            let (ours, plain) = (score(Method::Regularised(NOISE)), score(Method::PseudoInverse));
            let mean = |r: &Report| r.delta_e[0].1.iter().sum::<f64>() / 24.0;
            println!(
                "{light}: rmse {:.4} (plain {:.4}), mean dE00 D65 {:.2} ({:.2})",
                ours.rmse,
                plain.rmse,
                mean(&ours),
                mean(&plain)
            );
            assert!(ours.rmse < 0.05 && plain.rmse > 1.5 * ours.rmse);
            let k = choose_components(&channels, &bands, &patches, &[], NOISE).unwrap();
            assert!((3..=12).contains(&k));
        }
    }

    #[test]
    fn estimates_stay_within_physical_bounds() {
        let estimator = Estimator::regularised(&channels("D65"), &patches(), 6, NOISE).unwrap();
        for signals in [[5.0, 0.0, 0.0], [-1.0, 0.2, 0.1], [1.0, 1.0, 1.0]] {
            assert!(estimator.estimate(&signals).iter().all(|v| (0.0..=1.0).contains(v)));
        }
        // More pixels than go side by side.
        let plane = |first: f32| [vec![first], vec![0.9; 99]].concat();
        let planes = [plane(0.3), plane(0.2), plane(0.1)];
        let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
        for band in [0, 30] {
            let mut whole = [0.0; 100];
            estimator.band(band, &planes, &mut whole);
            let alone = estimator.estimate(&[0.9; 3])[band];
            assert!(whole[1..].iter().all(|&v| (f64::from(v) - alone).abs() < 1e-6));
        }
    }
}
