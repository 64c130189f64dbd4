//! Pictures as mixtures of a few components, made for the channels of a sensor.
//!
//! Two ways, by what is to be kept of the spectra:
//! - **shared** curves (`basis`): every channel sees every component, and twelve leave out less
//!   than is not known of a picture's spectra;
//! - one component **per channel** (`channel_planes`): what the channel itself sees, as if all
//!   spectra were that of white. A channel sees no other component, so that a blur costs one
//!   product per channel.
//!
//! Either way a channel sees of an even area exactly what it sees of its spectrum. What the nodes
//! of the lattice of colours mix of is found once, and serves all frames.

use super::basis::Basis;
use super::channel_planes::ChannelPlanes;
use super::lattice::NODES;
use super::smoothest::{COUNT, Curve, Domain};
use super::spectra::{Spectra, TOGETHER};
use camrig_base::{Plane, Result};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Which components.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Components {
    /// About this many, shared by all channels.
    Shared(usize),
    /// One for each channel.
    PerChannel,
}

/// Makes mixtures of picture after picture for the channels of a sensor.
pub struct Mixer {
    /// Per channel what it sees of a value of 1 in each band.
    seen: Vec<Vec<f64>>,
    components: Components,
    kept: Mutex<Option<Kept>>,
    /// For scenes given band by band: chosen for the first of them.
    pub(super) of_bands: Mutex<Option<OfBands>>,
}

/// What scenes given band by band are mixed of.
pub(super) struct OfBands {
    pub curves: Curves,
    /// The spectrum that counts as white.
    pub white: Vec<f64>,
    /// Whether the scene for which they were chosen is not black.
    pub is_lit: bool,
}

/// A picture as a mixture: for channel c its value in a band is the sum over components k of
/// `curves[c][k]` there times the component's plane.
pub struct Mixed {
    /// `[channel][component][band]`; zeros where a channel takes nothing from a component.
    pub curves: Vec<Vec<Vec<f64>>>,
    /// One per component; values may be negative.
    pub planes: Vec<Plane<f32>>,
    /// Bound on what the mixture leaves out, however a lens blurs: at an edge between two of the
    /// picture's spectra, as a part of what the channel sees of white, the largest of all channels.
    pub left_out: f64,
}

/// Given spectra as mixtures, in the way of [`Mixed`].
pub struct MixedSpectra {
    /// `[channel][component][band]`; zeros where a channel takes nothing from a component.
    pub curves: Vec<Vec<Vec<f64>>>,
    /// `[spectrum][component]`; they may be negative.
    pub weights: Vec<Vec<f64>>,
    /// Bound on what the mixtures leave out at an edge between two of the spectra.
    pub left_out: f64,
}

impl Mixer {
    /// For channels that see so much of a value of 1 in each band.
    #[must_use]
    pub fn new(seen: Vec<Vec<f64>>, components: Components) -> Self {
        Self { seen, components, kept: Mutex::new(None), of_bands: Mutex::new(None) }
    }

    /// Per channel what it sees of a value of 1 in each band.
    #[must_use]
    pub fn seen(&self) -> &[Vec<f64>] {
        &self.seen
    }

    /// The mixture of a picture in the unit that makes white `units`.
    ///
    /// # Errors
    /// None in practice: the tables are built in.
    pub fn mix(&self, spectra: &Spectra, units: &Curve) -> Result<Mixed> {
        // What a thread left behind that ended in the middle is found again.
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let is_for = |kept: &Kept| kept.domain == spectra.domain() && kept.units == *units;
        if !kept.as_ref().is_some_and(is_for) {
            *kept = None;
        }
        let of_these = match &mut *kept {
            Some(kept) => kept,
            none => none.insert(Kept::new(self, spectra.domain(), units)?),
        };
        let left_out = of_these.find(spectra);
        let count = of_these.curves.count();
        let planes = of_these.weights.iter().flat_map(|weights| spectra.mixed(weights));
        let mixed = Mixed {
            curves: of_these.curves.of_channels(self.seen.len()),
            planes: planes.take(count).collect(),
            left_out: left_out * f64::from(spectra.brightest()),
        };
        Ok(mixed)
    }
}

impl Mixer {
    /// The mixtures of given spectra, in the unit that makes white `units`.
    #[must_use]
    pub fn mix_spectra(&self, spectra: &[Vec<f64>], units: &[f64]) -> MixedSpectra {
        let curves = self.curves_for(spectra, units);
        let (weights, left_out): (Vec<_>, Vec<_>) = spectra.iter().map(|s| curves.mix(s)).unzip();
        MixedSpectra {
            curves: curves.of_channels(self.seen.len()),
            weights,
            left_out: left_out.into_iter().fold(0.0, f64::max),
        }
    }

    /// Curves for spectra like these.
    pub(super) fn curves_for(&self, spectra: &[Vec<f64>], units: &[f64]) -> Curves {
        match self.components {
            Components::Shared(count) => {
                Curves::Shared(Basis::of_samples(spectra, units, &self.seen, count))
            }
            Components::PerChannel => Curves::PerChannel(ChannelPlanes::of(units, &self.seen)),
        }
    }
}

/// The curves of components.
pub(super) enum Curves {
    Shared(Basis),
    PerChannel(ChannelPlanes),
}

impl Curves {
    fn count(&self) -> usize {
        match self {
            Self::Shared(basis) => basis.curves.len(),
            Self::PerChannel(planes) => planes.count(),
        }
    }

    /// `[channel][component][band]`.
    pub(super) fn of_channels(&self, channels: usize) -> Vec<Vec<Vec<f64>>> {
        match self {
            Self::Shared(basis) => vec![basis.curves.clone(); channels],
            Self::PerChannel(planes) => planes.curves(),
        }
    }

    /// What each component takes of each band of a spectrum.
    pub(super) fn takes(&self) -> Vec<Vec<f64>> {
        match self {
            Self::Shared(basis) => basis.curves.clone(),
            Self::PerChannel(planes) => {
                let bands = |seen: &Option<Vec<f64>>| seen.clone().unwrap_or_default();
                planes.seen.iter().map(bands).collect()
            }
        }
    }

    /// The weights of a spectrum, and the most that they leave out of it at an edge, as a part of
    /// what a channel sees of white.
    fn mix(&self, spectrum: &[f64]) -> (Vec<f64>, f64) {
        match self {
            Self::Shared(basis) => basis.mix(spectrum),
            Self::PerChannel(planes) => planes.mix(spectrum),
        }
    }
}

/// What is kept from picture to picture.
struct Kept {
    domain: Domain,
    units: Curve,
    curves: Curves,
    /// The weights of the entries of a picture, four components at a time: of the lattice's nodes,
    /// then of the picture's own.
    weights: Vec<Vec<[f32; TOGETHER]>>,
    /// What is left out of the nodes whose weights are known.
    left_out: Vec<Option<f64>>,
}

impl Kept {
    fn new(mixer: &Mixer, domain: Domain, units: &Curve) -> Result<Self> {
        let curves = match mixer.components {
            Components::Shared(count) => {
                Curves::Shared(Basis::of(domain, units, &mixer.seen, count)?)
            }
            Components::PerChannel => Curves::PerChannel(ChannelPlanes::of(units, &mixer.seen)),
        };
        let weights = vec![Vec::new(); curves.count().div_ceil(TOGETHER)];
        Ok(Self { domain, units: *units, curves, weights, left_out: vec![None; NODES] })
    }

    /// Finds the weights of a picture's entries; what is left out of them at most.
    fn find(&mut self, spectra: &Spectra) -> f64 {
        let Self { units, curves, weights, left_out, .. } = self;
        let entries = spectra.entries();
        left_out.truncate(NODES);
        left_out.resize(entries.len(), None);
        let mixed = |(entry, left): (usize, &Option<f64>)| -> Option<(usize, Vec<f64>, f64)> {
            let reached = entries[entry].as_ref().filter(|_| left.is_none())?;
            // In the precision of planes of bands, so that both ways see one spectrum.
            let value = |band: usize| f64::from(reached.values[band] as f32) * units[band];
            let (weights, left) = curves.mix(&std::array::from_fn::<f64, COUNT, _>(value));
            Some((entry, weights, left))
        };
        let found: Vec<_> = left_out.par_iter().enumerate().filter_map(mixed).collect();
        weights.iter_mut().for_each(|group| group.resize(entries.len(), [0.0; TOGETHER]));
        for (entry, of_entry, left) in found {
            left_out[entry] = Some(left);
            for (k, weight) in of_entry.into_iter().enumerate() {
                weights[k / TOGETHER][entry][k % TOGETHER] = weight as f32;
            }
        }
        let used = entries.iter().zip(&*left_out).filter(|(entry, _)| entry.is_some());
        used.filter_map(|(_, left)| *left).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three bell curves, and a channel that sees nothing.
    fn seen() -> Vec<Vec<f64>> {
        let bell = |centre: f64| (0..COUNT).map(move |b| -((b as f64 - centre) / 4.0).powi(2));
        let mut seen = [20.0, 14.0, 6.0].map(|c| bell(c).map(f64::exp).collect()).to_vec();
        seen.push(vec![0.0; COUNT]);
        seen
    }

    /// Few colours, solved each, or many close ones, between nodes.
    fn picture(many: bool, brightness: f32) -> Vec<[f32; 3]> {
        let colour = |n: usize| [n % 16, n / 16 % 16, n / 256].map(|c| 0.3 + c as f32 / 50.0);
        let colours = if many { 64 * 64 } else { 5 };
        (0..64 * 64).map(|i| colour(i % colours).map(|c| brightness * c)).collect()
    }

    /// What a channel sees of the mixture of a pixel is what it sees of the pixel's spectrum; so
    /// whatever pictures were mixed before.
    #[test]
    fn channels_see_of_mixtures_what_they_see_of_spectra() {
        let units: Curve = std::array::from_fn(|band| 1.0 + band as f64 / 30.0);
        for components in [Components::PerChannel, Components::Shared(6)] {
            for (domain, brightness) in [(Domain::Reflectance, 1.0), (Domain::Emission, 3.0)] {
                let mixer = Mixer::new(seen(), components);
                for many in [true, false, true] {
                    let pixels = picture(many, brightness);
                    let (spectra, _) = Spectra::of((64, 64), &pixels, domain).unwrap();
                    assert_eq!(spectra.interpolates(), many);
                    let mixed = mixer.mix(&spectra, &units).unwrap();
                    let planes: Vec<_> =
                        (0..COUNT).map(|band| spectra.plane(band, units[band])).collect();
                    for pixel in (0..64 * 64).step_by(97) {
                        for (seen, curves) in mixer.seen().iter().zip(&mixed.curves) {
                            let sum = |value: &dyn Fn(usize) -> f64| -> f64 {
                                (0..COUNT).map(|band| seen[band] * value(band)).sum()
                            };
                            let direct = sum(&|band| f64::from(planes[band].data[pixel]));
                            let mixture = sum(&|band| {
                                let part = |(curve, plane): (&Vec<f64>, &Plane<f32>)| {
                                    curve[band] * f64::from(plane.data[pixel])
                                };
                                curves.iter().zip(&mixed.planes).map(part).sum()
                            });
                            assert!((mixture - direct).abs() < 3e-6 * (1.0 + direct));
                        }
                    }
                    assert!(mixed.left_out > 0.0 && mixed.left_out < f64::from(brightness));
                }
            }
        }
    }

    #[test]
    fn a_channel_sees_one_component_where_each_has_its_own() {
        let mixer = Mixer::new(seen(), Components::PerChannel);
        let pixels = picture(false, 1.0);
        let (spectra, _) = Spectra::of((64, 64), &pixels, Domain::Reflectance).unwrap();
        let mixed = mixer.mix(&spectra, &[2.0; COUNT]).unwrap();
        assert_eq!((mixed.planes.len(), mixed.curves.len()), (4, 4));
        for (channel, curves) in mixed.curves.iter().enumerate() {
            for (component, curve) in curves.iter().enumerate() {
                let own = channel == component && channel < 3;
                assert!(curve.iter().all(|v| *v == if own { 2.0 } else { 0.0 }));
            }
        }
    }
}
