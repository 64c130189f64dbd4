//! Collapsed kernels of a lens whose blur varies over the field.

use super::Job;
use super::mapping::{Mapping, places};
use crate::engine::nodes::Place;
use crate::engine::psf::{KernelGrid, PsfField, TAIL};
use crate::engine::sampling::Layout;
use crate::engine::source::{Rows, Source};
use crate::engine::varying::{Blurrer, Kernels, Pairs, Tiling, Transformed};
use crate::engine::{Blur, Report};
use camrig_base::{Error, Plane, Result};
use rayon::prelude::*;

/// Blur of components into channels through kernels that differ from node to node.
pub struct FieldBlur {
    blurrer: Blurrer,
    channels: usize,
    kernels: Kept,
}

/// Kernels of each channel for every component.
enum Kept {
    /// Transformed, where there is room for that.
    Transformed(Transformed),
    Kernels(Vec<Vec<Kernels>>),
}

/// Kernels as the engine takes them.
fn borrowed(kernels: &[Vec<Kernels>]) -> Vec<Vec<&Kernels>> {
    kernels.iter().map(|components| components.iter().collect()).collect()
}

impl FieldBlur {
    fn new(tiling: &Tiling, kernels: Vec<Vec<Kernels>>) -> Self {
        let blurrer = Blurrer::new(tiling);
        let all = borrowed(&kernels);
        let all: Vec<&[&Kernels]> = all.iter().map(Vec::as_slice).collect();
        let transformed = blurrer.transformed(&all);
        let channels = kernels.len();
        let kernels = transformed.map_or(Kept::Kernels(kernels), Kept::Transformed);
        Self { blurrer, channels, kernels }
    }

    /// The channels of these components on the padded frame, before illumination.
    pub fn run(&mut self, layout: &Layout, sources: &[Source<'_>]) -> Result<Vec<Plane<f32>>> {
        let Self { blurrer, channels, kernels } = self;
        let rows: Vec<_> =
            sources.iter().map(|s| |first: usize, count: usize| s.rows(first, count)).collect();
        let rows: Vec<&Rows<'_>> = rows.iter().map(|r| r as &Rows<'_>).collect();
        let borrowed = match &*kernels {
            Kept::Transformed(_) => Vec::new(),
            Kept::Kernels(kernels) => borrowed(kernels),
        };
        let borrowed: Vec<&[&Kernels]> = borrowed.iter().map(Vec::as_slice).collect();
        let kernels = match &*kernels {
            Kept::Transformed(transformed) => Pairs::Transformed(transformed),
            Kept::Kernels(_) => Pairs::Kernels(&borrowed),
        };
        let channels = *channels;
        let weights: Vec<Vec<f32>> = (0..channels)
            .map(|plane| (0..channels).map(|c| if c == plane { 1.0 } else { 0.0 }).collect())
            .collect();
        let weights: Vec<&[f32]> = weights.iter().map(Vec::as_slice).collect();
        let mut planes = vec![Plane::filled(layout.width, layout.height, 0.0); channels];
        let corner = (layout.left(), layout.top());
        blurrer.add(&rows, kernels, corner, &weights, &mut planes)?;
        Ok(planes)
    }
}

/// The kernels of one band.
struct OfBand<'a> {
    psfs: &'a PsfField,
    mapping: &'a Mapping<'a>,
    grid: KernelGrid,
}

impl OfBand<'_> {
    /// The kernel for what the mapping brings to (x, y) mm from the axis. Sums to 1.
    fn at(&self, x: f64, y: f64) -> Vec<f32> {
        self.psfs.displaced((x, y), self.mapping.shift_mm((x, y)), &self.grid)
    }
}

impl Job<'_> {
    /// Collapses the kernels of all bands, for the padded frame that they need.
    pub fn field(
        &self,
        blurs: &[Blur<'_>],
        mappings: &[Mapping<'_>],
        report: &mut Report,
    ) -> Result<(Layout, FieldBlur)> {
        let fields = fields(blurs)?;
        let mtfs: Vec<_> = fields.iter().map(|(psfs, _)| psfs.axial_mtf()).collect();
        let sharpness: Vec<(f64, &dyn Fn(f64) -> f64)> = fields
            .iter()
            .zip(&mtfs)
            .map(|((_, cutoff), mtf)| (*cutoff, mtf as &dyn Fn(f64) -> f64))
            .collect();
        let s = self.cells(&sharpness, report)?;
        let (pitch, aperture) = (self.grid.pitch_um, self.grid.aperture_um());
        // Room for the shift within the frame; margins beyond it lose at most their rim.
        let places = places(self.grid, self.lens.axis_mm());
        let largest = |mapping: &Mapping<'_>| {
            let shifts = places.iter().map(|&place| mapping.shift_mm(place));
            shifts.fold(0.0f64, |most, (x, y)| most.max(libm::hypot(x, y)))
        };
        let bands: Vec<OfBand<'_>> = fields
            .iter()
            .zip(mappings)
            .map(|(&(psfs, _), mapping)| {
                let radius = psfs.radius_um(TAIL) + 1e3 * largest(mapping);
                let grid = KernelGrid::new(s, pitch, aperture, radius);
                OfBand { psfs, mapping, grid }
            })
            .collect();
        let widest = bands.iter().map(|b| b.grid).max_by_key(|g| g.size);
        let widest = widest.ok_or_else(|| Error::internal("a lens without bands"))?;
        let margin_um = (widest.before + s) as f64 * widest.cell_um;
        let layout = Layout::new(self.grid, s, margin_um);
        report.margin_pixels = report.margin_pixels.max(layout.margin);
        let axis_mm = self.lens.axis_mm();
        let place = Place { layout: &layout, pitch_mm: pitch * 1e-3, axis_mm };
        let tolerance = self.options.misplaced_light;
        let probes = [0, (bands.len() - 1) / 2, bands.len() - 1].map(|i| &bands[i]);
        let distances =
            probes.map(|b| place.node_distance(&|x: f64, y: f64| b.at(x, y), b.psfs, tolerance));
        let tile = distances.into_iter().min().unwrap_or(1) * s;
        let cells = (layout.cells_across(), layout.cells_down());
        let tiling = Tiling::new(s, cells, widest.size, widest.before, tile);
        for band in probes {
            let at = |x: f64, y: f64| band.at(x, y);
            let found = place.report(&at, band.psfs, &band.grid, &tiling, tolerance);
            match &mut report.nodes {
                None => report.nodes = Some(found),
                Some(nodes) => nodes.join(found),
            }
        }
        if let Some(nodes) = &mut report.nodes {
            nodes.kernel = nodes.kernel.max(widest.size);
        }
        let kernels = self.collapsed(&bands, &place, &tiling, &widest);
        Ok((layout, FieldBlur::new(&tiling, kernels)))
    }

    /// Per channel and component the kernels at every node.
    fn collapsed(
        &self,
        bands: &[OfBand<'_>],
        place: &Place<'_>,
        tiling: &Tiling,
        widest: &KernelGrid,
    ) -> Vec<Vec<Kernels>> {
        let channels = &self.mixture.weights;
        let across = tiling.across() + 1;
        let nodes = across * (tiling.down() + 1);
        let entries = widest.size * widest.size;
        let of_node = |node: usize| -> Vec<f32> {
            let (x, y) = place.from_axis(tiling.node(node % across, node / across));
            let pairs = channels.iter().map(Vec::len).sum::<usize>();
            let mut sums = vec![0.0f32; pairs * entries];
            for (band, &number) in bands.iter().zip(self.used) {
                let kernel = band.at(x, y);
                let gain = band.mapping.gain((x, y));
                let pairs = channels.iter().flatten().zip(sums.chunks_exact_mut(entries));
                for (weights, sum) in pairs {
                    add(sum, widest, (weights[number] * gain) as f32, &kernel, &band.grid);
                }
            }
            sums
        };
        let by_node: Vec<Vec<f32>> = (0..nodes).into_par_iter().map(of_node).collect();
        let mut pairs = (0..).map(|pair| {
            let of = |node: &Vec<f32>| node[pair * entries..(pair + 1) * entries].to_vec();
            Kernels { size: widest.size, data: by_node.iter().flat_map(of).collect() }
        });
        channels.iter().map(|components| pairs.by_ref().take(components.len()).collect()).collect()
    }
}

/// Point-spread functions and cut-off of every band.
fn fields<'b>(blurs: &'b [Blur<'_>]) -> Result<Vec<(&'b PsfField, f64)>> {
    let field = |blur: &'b Blur<'_>| match blur {
        Blur::Field { psfs, cutoff_per_mm } => Ok((psfs, *cutoff_per_mm)),
        Blur::Otf(_) => Err(Error::unsupported("a lens that blurs in two ways, collapsed")
            .help("compute it band by band")),
    };
    blurs.iter().map(field).collect()
}

/// Adds a kernel of a smaller grid to one of the widest.
fn add(sum: &mut [f32], widest: &KernelGrid, weight: f32, kernel: &[f32], grid: &KernelGrid) {
    let skipped = widest.before - grid.before;
    for (i, row) in kernel.chunks_exact(grid.size).enumerate() {
        let target = &mut sum[(i + skipped) * widest.size + skipped..][..grid.size];
        target.iter_mut().zip(row).for_each(|(s, v)| *s += weight * v);
    }
}
