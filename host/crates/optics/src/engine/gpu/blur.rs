//! One band on the graphics processor, a few rows of pixels at a time.

use super::super::source::Rows;
use super::super::varying::{Kernels, Tiling};
use super::Gpu;
use camrig_base::{Error, ErrorCode, Plane, Result};
use pulp::bytemuck::cast_slice;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::mpsc;
use wgpu::{BufferUsages, PollType};

/// Pixels that one workgroup blurs together, as in the shader.
const BLOCK: (usize, usize) = (64, 4);
/// Multiplications in the rows submitted at once, approximately. A dispatch has fewer: even on a
/// device that performs only 1e10 per second it ends before the few seconds after which drivers
/// stop a program.
const WORK: usize = 1 << 33;
/// Iterations of all loops of one invocation together. Mesa's software driver (llvmpipe) leaves
/// every loop silently after 65535.
const TURNS: usize = 60_000;
/// Rows of cells that one thread renders at once, whatever the number of threads.
const STRIP: usize = 32;
/// Largest buffer, bytes: every WebGPU device accepts storage buffers of this size.
const LARGEST: u64 = 128 << 20;

/// Blurs bands of one tiling.
///
/// Memory: two runs of rows are on the device or on the way, each with its light, kernels and
/// pixels, of 128 MiB each at most; some tens of MiB for frames of 16 Mpixel and kernels of 31 x
/// 31.
pub struct Blurrer {
    gpu: &'static Gpu,
    tiling: Tiling,
    pipeline: wgpu::ComputePipeline,
    /// Kernel columns whose cells fit into a workgroup's shared memory at once.
    columns: usize,
    /// Multiplications in the rows handed over at once.
    pub(super) work: usize,
}

/// Rows of the frame, and the input that they need.
struct Chunk {
    /// Rows of pixels of the frame.
    pixels: Range<usize>,
    /// Rows of cells of the padded grid.
    cells: Range<usize>,
    /// Rows of nodes.
    nodes: Range<usize>,
}

impl Chunk {
    fn new(tiling: &Tiling, pixels: Range<usize>, top: usize) -> Self {
        let reached = |row: usize| tiling.oversample * (top + row) + tiling.before;
        let end = (reached(pixels.end - 1) + 1).min(tiling.height);
        let first = (reached(pixels.start) + 1).saturating_sub(tiling.kernel).min(end);
        let nodes = first / tiling.tile..end.div_ceil(tiling.tile) + 1;
        Self { pixels, cells: first..end, nodes }
    }
}

/// A chunk on its way back.
struct Pending {
    pixels: Range<usize>,
    buffer: wgpu::Buffer,
    mapped: mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>,
    submission: wgpu::SubmissionIndex,
}

impl Blurrer {
    /// Compiles the sum for a tiling.
    ///
    /// # Errors
    /// More cells per pixel than the device has fast memory for, which none has up to 16.
    pub fn new(gpu: &'static Gpu, tiling: &Tiling) -> Result<Self> {
        let room = gpu.device.limits().max_compute_workgroup_storage_size as usize / 16;
        let columns = room.saturating_sub((BLOCK.0 - 1) * tiling.oversample).min(tiling.kernel);
        if columns == 0 {
            let what = format!("{} cells per pixel on {}", tiling.oversample, gpu.name);
            return Err(Error::limit(what)
                .help("use at most 16, or the processor")
                .with_code(ErrorCode::GraphicsProcessor));
        }
        let constants = [
            ("oversample", tiling.oversample),
            ("tile", tiling.tile),
            ("size", tiling.kernel),
            ("before", tiling.before),
            ("cells", tiling.width),
            ("nodes", tiling.across() + 1),
            ("columns", columns),
        ]
        .map(|(name, value)| (name, value as f64));
        let module = gpu.device.create_shader_module(wgpu::include_wgsl!("blur.wgsl"));
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &constants,
                ..Default::default()
            },
            cache: None,
        });
        gpu.check()?;
        Ok(Self { gpu, tiling: *tiling, pipeline, columns, work: WORK })
    }

    /// The tiling it was made for.
    pub fn tiling(&self) -> &Tiling {
        &self.tiling
    }

    /// As [`super::super::varying::Blurrer::blur`].
    ///
    /// # Errors
    /// Those of `rows`; a device that fails or has too little memory.
    pub fn blur(
        &self,
        rows: &Rows<'_>,
        kernels: &Kernels,
        corner: (usize, usize),
        (width, height): (usize, usize),
    ) -> Result<Plane<f32>> {
        let (tiling, per_node) = (&self.tiling, kernels.size * kernels.size);
        let step = self.rows_at_once(width, corner.1, height)?;
        let mut out = Plane::filled(width, height, 0.0);
        let mut light = Light { first: 0, cells: Vec::new() };
        let mut pending: Option<Pending> = None;
        for first in (0..height).step_by(step) {
            let chunk = Chunk::new(tiling, first..height.min(first + step), corner.1);
            light.advance(rows, tiling.width, &chunk.cells)?;
            let row_of_nodes = (tiling.across() + 1) * per_node;
            let nodes = chunk.nodes.start * row_of_nodes..chunk.nodes.end * row_of_nodes;
            let sent = self.send(&chunk, &light.cells, &kernels.data[nodes], corner, width)?;
            // The next chunk's light is made while the device works on this one.
            if let Some(earlier) = pending.replace(sent) {
                self.receive(earlier, &mut out)?;
            }
        }
        pending.map_or(Ok(()), |last| self.receive(last, &mut out))?;
        Ok(out)
    }

    /// Rows of pixels whose work and memory are handed over at once.
    fn rows_at_once(&self, width: usize, top: usize, height: usize) -> Result<usize> {
        let tiling = &self.tiling;
        let taps = tiling.kernel * tiling.kernel;
        let limits = self.gpu.device.limits();
        let largest =
            LARGEST.min(limits.max_storage_buffer_binding_size).min(limits.max_buffer_size);
        let fits = |rows: usize| {
            (0..height).step_by(rows).all(|first| {
                let chunk = Chunk::new(tiling, first..height.min(first + rows), top);
                let light = chunk.cells.len() * tiling.width;
                let kernels = chunk.nodes.len() * (tiling.across() + 1) * taps;
                4 * light.max(kernels).max(rows * width) as u64 <= largest
            })
        };
        // A cell is in the share of four nodes.
        let mut rows =
            (self.work / (4 * taps * width)).clamp(BLOCK.1, height.next_multiple_of(BLOCK.1));
        while !fits(rows) {
            rows /= 2;
            if rows < BLOCK.1 {
                let what =
                    format!("kernels of {0} x {0} entries on {1}", tiling.kernel, self.gpu.name);
                return Err(Error::limit(format!("{what}: they do not fit into its buffers"))
                    .help("use the processor")
                    .with_code(ErrorCode::GraphicsProcessor));
            }
        }
        Ok(rows)
    }

    /// The parts that dispatches add one after the other: [node across, node down, first kernel
    /// row, end of kernel rows].
    fn parts(&self) -> impl Iterator<Item = [usize; 4]> {
        let Tiling { oversample, tile, kernel, .. } = self.tiling;
        // Nodes that cells reach which reach the block, however it lies.
        let most = |pixels: usize| ((pixels - 1) * oversample + kernel - 1).div_ceil(tile) + 2;
        let (across, down) = (most(BLOCK.0), most(BLOCK.1));
        // Per kernel row: its entries, and segments with what fills them.
        let segments = kernel.div_ceil(self.columns);
        let turns = 1 + kernel + segments * (3 + oversample + self.columns / BLOCK.0);
        let rows = (TURNS / turns).max(1);
        (0..down * across).flat_map(move |node| {
            (0..kernel)
                .step_by(rows)
                .map(move |row| [node % across, node / across, row, kernel.min(row + rows)])
        })
    }

    /// Submits a chunk to the device.
    fn send(
        &self,
        chunk: &Chunk,
        light: &[f32],
        kernels: &[f32],
        corner: (usize, usize),
        width: usize,
    ) -> Result<Pending> {
        let gpu = self.gpu;
        let bytes = (4 * width * chunk.pixels.len()) as u64;
        let light = gpu.filled(cast_slice(light), BufferUsages::STORAGE);
        let kernels = gpu.filled(cast_slice(kernels), BufferUsages::STORAGE);
        let out = gpu.buffer(bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC);
        let back = gpu.buffer(bytes, BufferUsages::MAP_READ | BufferUsages::COPY_DST);
        for [across, down, first_row, end_row] in self.parts() {
            let job = [
                corner.0,
                corner.1 + chunk.pixels.start,
                width,
                chunk.pixels.len(),
                chunk.cells.start,
                chunk.cells.end,
                chunk.nodes.start,
                across,
                down,
                first_row,
                end_row,
                0, // to a multiple of 16 bytes
            ]
            .map(|value| value as u32);
            let job = gpu.filled(cast_slice(&job), BufferUsages::UNIFORM);
            let blocks = (width.div_ceil(BLOCK.0), chunk.pixels.len().div_ceil(BLOCK.1));
            self.add([&job, &light, &kernels, &out], blocks);
        }
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&out, 0, &back, 0, bytes);
        let submission = gpu.queue.submit([encoder.finish()]);
        gpu.check()?;
        let (tell, mapped) = mpsc::channel();
        // The receiver is gone only where an error ended the band.
        back.map_async(wgpu::MapMode::Read, .., move |result| drop(tell.send(result)));
        Ok(Pending { pixels: chunk.pixels.clone(), buffer: back, mapped, submission })
    }

    /// One dispatch, of its own for the driver's clock.
    fn add(&self, buffers: [&wgpu::Buffer; 4], blocks: (usize, usize)) {
        let Gpu { device, queue, .. } = self.gpu;
        let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
            .zip(buffers)
            .map(|(binding, b)| wgpu::BindGroupEntry { binding, resource: b.as_entire_binding() })
            .collect();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(blocks.0 as u32, blocks.1 as u32, 1);
        drop(pass);
        queue.submit([encoder.finish()]);
    }

    /// Waits for a chunk and puts it into its place.
    fn receive(&self, pending: Pending, out: &mut Plane<f32>) -> Result<()> {
        let Pending { pixels, buffer, mapped, submission } = pending;
        let wait = PollType::Wait { submission_index: Some(submission), timeout: None };
        self.gpu.device.poll(wait).map_err(|e| self.gpu.failed(e))?;
        self.gpu.check()?;
        let result = mapped.recv().map_err(|e| self.gpu.failed(e))?;
        result.map_err(|e| self.gpu.failed(e))?;
        let bytes = buffer.get_mapped_range(..).map_err(|e| self.gpu.failed(e))?;
        let place = &mut out.data[pixels.start * out.width..pixels.end * out.width];
        place.copy_from_slice(cast_slice(&bytes));
        Ok(())
    }
}

/// Rows of cells of the padded grid.
struct Light {
    first: usize,
    cells: Vec<f32>,
}

impl Light {
    /// Advances to rows `wanted`, which end no earlier than the present ones; rows in both are
    /// kept.
    fn advance(&mut self, rows: &Rows<'_>, width: usize, wanted: &Range<usize>) -> Result<()> {
        let known = (self.first + self.cells.len() / width).max(wanted.start);
        let stale = (wanted.start - self.first) * width;
        self.cells.drain(..stale.min(self.cells.len()));
        self.first = wanted.start;
        let starts: Vec<usize> = (known..wanted.end).step_by(STRIP).collect();
        let strips: Result<Vec<Plane<f32>>> = starts
            .into_par_iter()
            .map(|first| rows(first, STRIP.min(wanted.end - first)))
            .collect();
        strips?.iter().for_each(|strip| self.cells.extend_from_slice(&strip.data));
        Ok(())
    }
}
