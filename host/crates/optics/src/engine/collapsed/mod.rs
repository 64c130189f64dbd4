//! Scenes of few components, straight into a sensor's channels.
//!
//! Where spectra are mixtures of K components, L(λ, x) = Σ_k b_k(λ)·c_k(x), channel c collects
//!
//! Σ_λ S_c(λ)·(h_λ ⊗ L(λ)) = Σ_k H_ck ⊗ c_k, H_ck = Σ_λ S_c(λ)·b_k(λ)·h_λ,
//!
//! with S_c what a channel takes of irradiance and h_λ the blur of a band. So K inputs are
//! transformed in place of all bands, and C outputs. The kernels of a lens are collapsed once and
//! serve any number of scenes.
//!
//! - **Same mapping in all bands**: exact; against [`super::irradiance`] at the same nodes and
//!   cells there is rounding of 32 bits.
//! - **Lateral colour**: every channel is distorted by the mapping of the band at its mean
//!   wavelength, and what a band lands further out is a shift of its kernels. Kernels of bands
//!   that move apart between nodes are blended, and the scene is interpolated elsewhere than band
//!   by band: an approximation whose error, in the light it misplaces, is part of the report.
//!   Components are then transformed once per channel.
//! - **Channels that share no component**: each is blurred by itself, by one product.
//! - **Illumination** that differs between bands acts at the source of the light in place of where
//!   it lands, relative to that at the mean wavelength.

mod mapping;
mod varying_field;

use super::field::FallOff;
use super::fourier::{self, Blurs, Buffers, Kernel};
use super::sampling::Layout;
use super::source::{Source, Warp};
use super::wide::{Ring, Wide};
use super::{Blur, Border, Lens, Options, Otf, Report, SensorGrid, cells_per_pixel};
use camrig_base::{Bands, Error, Plane, Result};
use camrig_scene::LitScene;
use mapping::Mapping;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use varying_field::FieldBlur;

/// How components become channels.
pub struct Mixture {
    /// The bands.
    pub bands: Bands,
    /// `[channel][component][band]`: what a channel collects of a component's unit in a band, per
    /// W m⁻² nm⁻¹ on the sensor.
    pub weights: Vec<Vec<Vec<f64>>>,
}

impl Mixture {
    /// Bands that count for any channel.
    fn used(&self) -> Vec<usize> {
        let counts = |band: &usize| {
            self.weights.iter().flatten().any(|of_component| of_component[*band] != 0.0)
        };
        (0..self.bands.count).filter(counts).collect()
    }

    /// Whether a channel takes anything of a component.
    fn takes(&self, channel: usize, component: usize) -> bool {
        self.weights[channel][component].iter().any(|weight| *weight != 0.0)
    }

    /// Whether no two channels take anything of the same component.
    fn is_apart(&self) -> bool {
        let takers = |k: usize| (0..self.weights.len()).filter(|&c| self.takes(c, k)).count();
        (0..self.weights[0].len()).all(|k| takers(k) <= 1)
    }

    /// Some channels, and the components that they take anything of; one if there are none.
    fn part(&self, channels: Range<usize>) -> (Vec<usize>, Self) {
        let mut components: Vec<usize> = (0..self.weights[0].len())
            .filter(|&k| channels.clone().any(|c| self.takes(c, k)))
            .collect();
        if components.is_empty() {
            components.push(0);
        }
        let of_channel =
            |weights: &Vec<Vec<f64>>| components.iter().map(|&k| weights[k].clone()).collect();
        let weights = self.weights[channels].iter().map(of_channel).collect();
        (components, Self { bands: self.bands, weights })
    }

    /// The band at the mean wavelength of the channels, weighted by what they take.
    fn mean_band(&self) -> usize {
        let (mut sum, mut moment) = (0.0, 0.0);
        for of_component in self.weights.iter().flatten() {
            for (band, weight) in of_component.iter().enumerate() {
                sum += weight.abs();
                moment += weight.abs() * band as f64;
            }
        }
        let mean = if sum > 0.0 { moment / sum } else { 0.0 };
        (mean.round() as usize).min(self.bands.count - 1)
    }
}

/// A lens collapsed for a mixture and a sensor.
pub struct Collapsed {
    border: Border,
    pool: rayon::ThreadPool,
    parts: Vec<Part>,
    report: Report,
    lateral_um: f64,
}

/// Channels that see the scene by one mapping.
struct Part {
    /// The components that they take anything of.
    components: Vec<usize>,
    blur: PartBlur,
    fall_off: FallOff,
}

enum PartBlur {
    Otf(Box<OtfBlur>),
    Field(Frame, Box<FieldBlur>),
}

/// Blur by transfer functions: of the core, and of the rings of the tail.
struct OtfBlur {
    core: (Frame, Blurs),
    wide: Wide,
    rings: Vec<(Option<Arc<Warp>>, Blurs)>,
    buffers: Buffers,
}

/// A padded frame, and where the lens finds the light of its cells.
struct Frame {
    grid: SensorGrid,
    layout: Layout,
    warp: Option<Arc<Warp>>,
}

impl Collapsed {
    /// Collapses `lens`. The work is that of the kernels of all bands, for once.
    ///
    /// # Errors
    /// Impossible grids, options and mixtures; a lens whose blur is the same everywhere and whose
    /// mapping or illumination is not the same in all bands.
    pub fn new(
        lens: &dyn Lens,
        grid: &SensorGrid,
        options: &Options,
        mixture: &Mixture,
    ) -> Result<Self> {
        grid.check()?;
        let used = mixture.used();
        if used.is_empty() {
            return Err(Error::input("a mixture that no channel takes anything of")
                .help("the sensor sees nothing of the scene's bands"));
        }
        let channels = mixture.weights.len();
        let seen: Vec<f64> = used.iter().map(|&band| mixture.bands.nm(band)).collect();
        let lateral_mm = mapping::lateral_mm(lens, grid, &seen);
        let together = lateral_mm == 0.0 && !mixture.is_apart();
        let groups: Vec<Range<usize>> = match together {
            true => std::iter::once(0..channels).collect(),
            false => (0..channels).map(|c| c..c + 1).collect(),
        };
        let pool = options.workers()?;
        let mut report = Report::default();
        let parts = pool.install(|| {
            groups
                .into_iter()
                .map(|channels| {
                    let (components, mixture) = &mixture.part(channels);
                    let job = Job { lens, grid, options, mixture, used: &used };
                    job.part(components, &mut report)
                })
                .collect::<Result<Vec<Part>>>()
        })?;
        let lateral_um = lateral_mm * 1e3;
        Ok(Self { border: options.border, pool, parts, report, lateral_um })
    }

    /// What the engine did; errors of nodes are those of the first, middle and last band, lateral
    /// colour included.
    #[must_use]
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Largest distance within the frame between where two bands land of those that were taken
    /// apart by a shift of their kernels, µm; 0 where all bands share one mapping, and channels
    /// are exact.
    #[must_use]
    pub fn lateral_um(&self) -> f64 {
        self.lateral_um
    }

    /// What every channel collects on each pixel of a scene whose "bands" are the components.
    ///
    /// # Errors
    /// A scene that cannot be rendered.
    pub fn channels(&mut self, components: &LitScene<'_>) -> Result<Vec<Plane<f32>>> {
        let Self { border, pool, parts, .. } = self;
        let of_part = |part: &mut Part| part.channels(components, *border);
        let all: Result<Vec<Vec<Plane<f32>>>> =
            pool.install(|| parts.par_iter_mut().map(of_part).collect());
        Ok(all?.into_iter().flatten().collect())
    }
}

impl Part {
    fn channels(&mut self, components: &LitScene<'_>, border: Border) -> Result<Vec<Plane<f32>>> {
        let used = &self.components;
        let sources = |Frame { grid, layout, warp }: &Frame| -> Vec<Source<'_>> {
            let cells = layout.cells(grid);
            let source = |&k| Source::new(components, k, warp.clone(), &cells, border);
            used.iter().map(source).collect()
        };
        let mut planes = match &mut self.blur {
            PartBlur::Otf(parts) => {
                let OtfBlur { core: (frame, blur), wide, rings, buffers } = &mut **parts;
                let sources = sources(frame);
                let rows: Vec<_> = sources
                    .iter()
                    .map(|s| |first: usize, count: usize| s.rows(first, count))
                    .collect();
                let mut planes = blur.run(&rows, buffers)?;
                let light = |&component: &usize| {
                    wide.light(|ring, cells| {
                        let warp = rings[ring].0.clone();
                        Source::new(components, component, warp, cells, border)
                    })
                };
                let light = used.iter().map(light).collect::<Result<Vec<_>>>()?;
                for (k, (ring, (_, blur))) in wide.rings.iter().zip(&*rings).enumerate() {
                    let rows: Vec<_> = light.iter().map(|rings| ring.rows(&rings[k])).collect();
                    let far = blur.run(&rows, buffers)?;
                    planes.iter_mut().zip(&far).for_each(|(sum, far)| ring.add_to(sum, far));
                }
                planes
            }
            PartBlur::Field(frame, blur) => blur.run(&frame.layout, &sources(frame))?,
        };
        planes.iter_mut().for_each(|plane| self.fall_off.apply(plane));
        Ok(planes)
    }
}

/// The collapse of some channels that share a mapping.
struct Job<'a> {
    lens: &'a dyn Lens,
    grid: &'a SensorGrid,
    options: &'a Options,
    mixture: &'a Mixture,
    used: &'a [usize],
}

impl Job<'_> {
    fn part(&self, components: &[usize], report: &mut Report) -> Result<Part> {
        let nm = self.mixture.bands.nm(self.mixture.mean_band());
        let blurs: Vec<Blur<'_>> = self.used.iter().map(|&b| self.lens.blur(self.nm(b))).collect();
        let mappings: Vec<Mapping<'_>> =
            self.used.iter().map(|&band| Mapping::new(self.lens, nm, self.nm(band))).collect();
        let otfs: Option<Vec<_>> = blurs
            .iter()
            .map(|blur| match blur {
                Blur::Otf(otf) => Some(otf),
                Blur::Field { .. } => None,
            })
            .collect();
        let frame = |grid: &SensorGrid, layout: Layout| Frame {
            grid: *grid,
            layout,
            warp: Warp::new(self.lens, nm, grid, &layout.cells(grid)),
        };
        let blur = match otfs {
            Some(otfs) => {
                let gains = self.gains(&mappings)?;
                let wide = Wide::new(self.grid, &otfs);
                report.keep_margin(wide.margin_pixels());
                let (layout, blur) = self.core(&wide, &otfs, &gains, report)?;
                let ring = |ring: &Ring| {
                    let kernels = otfs.iter().map(|otf| ring.kernel(otf.tail_um));
                    let blurs = self.blurs(&kernels.collect::<Vec<_>>(), &gains, &ring.layout);
                    (Warp::new(self.lens, nm, self.grid, &ring.cells), blurs)
                };
                PartBlur::Otf(Box::new(OtfBlur {
                    core: (frame(self.grid, layout), blur),
                    rings: wide.rings.iter().map(ring).collect(),
                    wide,
                    buffers: Buffers::default(),
                }))
            }
            None => {
                let (layout, blur) = self.field(&blurs, &mappings, report)?;
                PartBlur::Field(frame(self.grid, layout), Box::new(blur))
            }
        };
        let fall_off = FallOff::new(self.lens, nm, self.grid);
        Ok(Part { components: components.to_vec(), blur, fall_off })
    }

    fn nm(&self, band: usize) -> f64 {
        self.mixture.bands.nm(band)
    }

    /// The cells per pixel that the sharpest of some bands need.
    fn cells(&self, bands: &[(f64, &dyn Fn(f64) -> f64)], report: &mut Report) -> Result<usize> {
        let mut most = 1;
        for (cutoff_per_mm, otf) in bands {
            let (s, error) = cells_per_pixel(self.grid, self.options, *cutoff_per_mm, *otf)?;
            most = most.max(s);
            report.step_error = report.step_error.max(error);
        }
        report.oversample.push(most);
        Ok(most)
    }

    /// The light of each band over that of the mapping; the mapping is the same for all.
    fn gains(&self, mappings: &[Mapping<'_>]) -> Result<Vec<f64>> {
        let places = mapping::places(self.grid, self.lens.axis_mm());
        let varies = |m: &Mapping<'_>| !places.iter().all(|&place| m.is_same(place));
        if mappings.iter().any(varies) {
            return Err(Error::unsupported(
                "lateral colour of a lens whose blur is the same everywhere, collapsed",
            )
            .help("compute it band by band"));
        }
        Ok(mappings.iter().map(|m| m.gain((0.0, 0.0))).collect())
    }

    /// Transfer functions of every channel for every component, of the light that stays close.
    fn core(
        &self,
        wide: &Wide,
        otfs: &[&Otf<'_>],
        gains: &[f64],
        report: &mut Report,
    ) -> Result<(Layout, Blurs)> {
        let cores: Vec<Otf<'_>> = otfs.iter().map(|otf| wide.core(otf)).collect();
        let finest: Vec<(f64, &dyn Fn(f64) -> f64)> = cores
            .iter()
            .map(|core| (core.cutoff_per_mm, &*core.at as &dyn Fn(f64) -> f64))
            .collect();
        let s = self.cells(&finest, report)?;
        let layout = fourier::layout(self.grid, s, wide.reach_um);
        report.keep_margin(layout.margin);
        let geometry = self.grid.geometry(&layout);
        let kernels = cores.iter().zip(otfs);
        let kernels = kernels.map(|(core, otf)| Kernel::of_core(core, wide.far(otf), &geometry));
        let blurs = self.blurs(&kernels.collect::<Vec<_>>(), gains, &layout);
        Ok((layout, blurs))
    }

    /// Σ_λ weight · kernel for every channel and component.
    fn blurs(&self, kernels: &[Kernel], gains: &[f64], layout: &Layout) -> Blurs {
        let sum = |weights: &Vec<f64>| {
            let bands = self.used.iter().zip(gains).zip(kernels);
            let parts = bands.map(|((&band, gain), kernel)| (weights[band] * gain, kernel));
            Kernel::sum(&parts.collect::<Vec<_>>())
        };
        let of_channel = |of_channel: &Vec<Vec<f64>>| of_channel.iter().map(sum).collect();
        Blurs::new(layout, self.mixture.weights.iter().map(of_channel).collect()).kept()
    }
}

#[cfg(test)]
mod tests;
