//! Scenes given band by band as mixtures of a few components.
//!
//! Curves are chosen for the spectra of the first scene that is not black, at places all over it,
//! and serve all: what they leave out of the others is found pixel by pixel, as it is for the
//! first. White is a reflectance of 1; of radiance, the mean spectrum of the scene with the light
//! of its brightest place, and a little in every band. Planes are read one after another, twice,
//! or three times for the first scene: memory is that of the components.

use super::channel_planes::over_white;
use super::mixture::{Mixed, Mixer, OfBands};
use camrig_base::{Plane, Result};
use rayon::prelude::*;
use std::sync::PoisonError;

/// Places along each side at which spectra are sampled.
const PLACES: usize = 32;
/// Light of a white of radiance in every band, as a part of its mean: a channel that sees nothing
/// of the first scene may see something of the next.
const LEAST: f64 = 1e-3;

/// Reads one band.
type Read<'a> = &'a dyn Fn(usize) -> Result<Plane<f32>>;

impl Mixer {
    /// The mixture of a scene that `read` gives band by band, of `reflectance` or of radiance.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn mix_bands(&self, reflectance: bool, read: Read<'_>) -> Result<Mixed> {
        let mut kept = self.of_bands.lock().unwrap_or_else(PoisonError::into_inner);
        let chosen = match kept.take() {
            Some(chosen) => chosen,
            None => self.chosen(reflectance, read)?,
        };
        let OfBands { curves, white, is_lit } = &chosen;
        let planes = components(&curves.takes(), read)?;
        let of_channels = curves.of_channels(self.seen().len());
        let relative: Vec<Vec<f64>> = self
            .seen()
            .iter()
            .map(|seen| over_white(seen, white).unwrap_or_else(|| vec![0.0; seen.len()]))
            .collect();
        let left_out = left_out(&of_channels, &relative, &planes, read)?;
        if *is_lit {
            *kept = Some(chosen);
        }
        Ok(Mixed { curves: of_channels, planes, left_out })
    }

    fn chosen(&self, reflectance: bool, read: Read<'_>) -> Result<OfBands> {
        let samples = samples(self.seen()[0].len(), read)?;
        let sums = samples.iter().map(|spectrum| spectrum.iter().sum::<f64>());
        let (all, brightest) = sums.fold((0.0, 0.0f64), |(a, m), sum| (a + sum, m.max(sum)));
        let bands = samples[0].len();
        let white = if reflectance || all == 0.0 {
            vec![1.0; bands]
        } else {
            let mean = |b| samples.iter().map(|spectrum| spectrum[b]).sum::<f64>() / all;
            let least = LEAST / bands as f64;
            (0..bands).map(|b| brightest * (mean(b) + least)).collect()
        };
        Ok(OfBands { curves: self.curves_for(&samples, &white), white, is_lit: all > 0.0 })
    }
}

/// Spectra at places all over a scene.
fn samples(bands: usize, read: Read<'_>) -> Result<Vec<Vec<f64>>> {
    let mut spectra: Vec<Vec<f64>> = Vec::new();
    for band in 0..bands {
        let Plane { width, height, data } = read(band)?;
        let (across, down) = (width.min(PLACES), height.min(PLACES));
        spectra.resize(across * down, Vec::new());
        for (i, spectrum) in spectra.iter_mut().enumerate() {
            let (x, y) = (i % across * width / across, i / across * height / down);
            spectrum.push(f64::from(data[y * width + x]));
        }
    }
    Ok(spectra)
}

/// Per component Σ of what it takes of a band times the band.
fn components(takes: &[Vec<f64>], read: Read<'_>) -> Result<Vec<Plane<f32>>> {
    let bands = takes.iter().map(Vec::len).max().unwrap_or_default();
    let mut planes: Vec<Plane<f32>> = Vec::new();
    for band in 0..bands {
        let plane = read(band)?;
        planes.resize_with(takes.len(), || Plane::filled(plane.width, plane.height, 0.0));
        planes.par_iter_mut().zip(takes).for_each(|(sum, takes)| {
            let part = takes.get(band).copied().unwrap_or_default() as f32;
            sum.data.iter_mut().zip(&plane.data).for_each(|(sum, v)| *sum += part * v);
        });
    }
    Ok(planes)
}

/// The most that is left out of a pixel, over the channels, `seen` being what a channel sees of a
/// band over what it sees of white.
fn left_out(
    curves: &[Vec<Vec<f64>>],
    seen: &[Vec<f64>],
    planes: &[Plane<f32>],
    read: Read<'_>,
) -> Result<f64> {
    let pixels = planes[0].data.len();
    let mut left = vec![vec![0.0f32; pixels]; seen.len()];
    for band in 0..seen[0].len() {
        let values = read(band)?.data;
        left.par_iter_mut().zip(seen).zip(curves).for_each(|((left, seen), curves)| {
            let mut rest = values.clone();
            for (curve, plane) in curves.iter().zip(planes).filter(|(curve, _)| curve[band] != 0.0)
            {
                let part = curve[band] as f32;
                rest.iter_mut().zip(&plane.data).for_each(|(rest, v)| *rest -= part * v);
            }
            let seen = seen[band] as f32;
            left.iter_mut().zip(&rest).for_each(|(left, rest)| *left += (seen * rest).abs());
        });
    }
    Ok(f64::from(left.iter().flatten().fold(0.0f32, |most, left| most.max(*left))))
}

#[cfg(test)]
mod tests {
    use super::super::mixture::Components;
    use super::*;

    const BANDS: usize = 40;

    /// Pixels that are mixtures of two spectra.
    fn band(band: usize) -> Plane<f32> {
        let spectra = [1.0 + band as f32 / 40.0, 1.0 / (1.0 + band as f32)];
        Plane::from_fn(50, 40, |x, y| x as f32 / 50.0 * spectra[0] + y as f32 / 40.0 * spectra[1])
    }

    fn seen() -> Vec<Vec<f64>> {
        let bell = |centre: f64| (0..BANDS).map(move |b| -((b as f64 - centre) / 5.0).powi(2));
        [30.0, 18.0, 8.0].map(|c| bell(c).map(f64::exp).collect()).to_vec()
    }

    #[test]
    fn channels_see_of_mixtures_what_they_see_of_bands() {
        let read = |b: usize| Ok(band(b));
        for (components, reflectance) in [
            (Components::PerChannel, true),
            (Components::PerChannel, false),
            (Components::Shared(12), false),
        ] {
            let mixer = Mixer::new(seen(), components);
            let mixed = mixer.mix_bands(reflectance, &read).unwrap();
            for pixel in [0, 77, 1234, 1999] {
                for (seen, curves) in mixer.seen().iter().zip(&mixed.curves) {
                    let sum = |value: &dyn Fn(usize) -> f64| -> f64 {
                        (0..BANDS).map(|band| seen[band] * value(band)).sum()
                    };
                    let direct = sum(&|b| f64::from(band(b).data[pixel]));
                    let mixture = sum(&|b| {
                        let part = |(curve, plane): (&Vec<f64>, &Plane<f32>)| {
                            curve[b] * f64::from(plane.data[pixel])
                        };
                        curves.iter().zip(&mixed.planes).map(part).sum()
                    });
                    assert!((mixture - direct).abs() < 1e-5 * (1.0 + direct), "{components:?}");
                }
            }
            // Two spectra and what three channels see: no more than five curves.
            match components {
                Components::PerChannel => assert!(mixed.left_out > 0.01, "{}", mixed.left_out),
                Components::Shared(_) => {
                    assert!(mixed.planes.len() <= 5, "{}", mixed.planes.len());
                    assert!(mixed.left_out < 1e-5, "{}", mixed.left_out);
                }
            }
        }
    }

    /// A channel that sees nothing of the first scenes, black or of one colour, sees the next.
    #[test]
    fn what_is_chosen_for_a_dark_scene_hides_no_later_one() {
        for components in [Components::PerChannel, Components::Shared(12)] {
            let mixer = Mixer::new(seen(), components);
            let black = |_: usize| Ok(Plane::filled(50, 40, 0.0));
            let red = |b: usize| Ok(Plane::filled(50, 40, if b > 35 { 1.0 } else { 0.0 }));
            assert_eq!(mixer.mix_bands(false, &black).unwrap().left_out, 0.0);
            mixer.mix_bands(false, &red).unwrap();
            let mixed = mixer.mix_bands(false, &|b| Ok(band(b))).unwrap();
            for (seen, curves) in mixer.seen().iter().zip(&mixed.curves) {
                let direct: f64 =
                    (0..BANDS).map(|b| seen[b] * f64::from(band(b).data[1999])).sum();
                let of_curve = |(curve, plane): (&Vec<f64>, &Plane<f32>)| {
                    let of_unit: f64 = seen.iter().zip(curve).map(|(s, c)| s * c).sum();
                    of_unit * f64::from(plane.data[1999])
                };
                let mixture: f64 = curves.iter().zip(&mixed.planes).map(of_curve).sum();
                assert!(
                    (mixture / direct - 1.0).abs() < 1e-5,
                    "{components:?}: {mixture} {direct}"
                );
            }
        }
    }
}
