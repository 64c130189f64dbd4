// Field-varying blur as a direct sum. With hat the bilinear weight of a node (a tile corner) in a cell,
//
//     out(p) = sum over nodes n and cells c of  hat_n(c) in(c) K_n(s p + before - c),
//
// which is the sum of engine/varying with its terms gathered by node: within a node it is a plain convolution, so that
// all pixels of a block need the same kernel entry at the same time. A dispatch adds some kernel rows of one node of
// each block, and dispatches follow one another in a fixed order.

// Cells per pixel, cells per tile side, kernel entries per side and that of offset 0, as in `Tiling`.
override oversample: i32;
override tile: i32;
override size: i32;
override before: i32;
// Cells of the padded grid across, and nodes across.
override cells: i32;
override nodes: i32;
// Kernel columns that one segment serves.
override columns: i32;

// A block of pixels: one invocation each column, one component each row.
const LANES = 64;
const ROWS = 4;
override segment_length = (LANES - 1) * oversample + columns;

struct Job {
    // Where the chunk starts in the padded frame, pixels.
    left: i32,
    top: i32,
    // Pixels of the chunk.
    width: i32,
    height: i32,
    // Rows of cells in `light`: the first, and the one after the last.
    first_cell: i32,
    end_cell: i32,
    // First row of nodes in `kernels`.
    first_node: i32,
    // Which node to add, counted from the first that reaches a block.
    across: i32,
    down: i32,
    // Kernel rows to add: the first, and the one after the last.
    first_row: i32,
    end_row: i32,
}

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<storage, read> light: array<f32>;
@group(0) @binding(2) var<storage, read> kernels: array<f32>;
@group(0) @binding(3) var<storage, read_write> pixels: array<f32>;

// Weighted light of neighbouring cells, in the row of cells of each row of pixels.
var<workgroup> segment: array<vec4<f32>, segment_length>;

// Weight of a node in a cell whose corner lies d cells from it, in one direction: cells are weighted at their centres.
fn hat(d: i32) -> f32 {
    return max(0.0, 1.0 - f32(abs(2 * d + 1)) / f32(2 * tile));
}

// Light of a cell in a node's share.
fn share(x: i32, y: i32, node: vec2<i32>) -> f32 {
    if x < 0 || x >= cells || y < job.first_cell || y >= job.end_cell {
        return 0.0;
    }
    return hat(x - node.x) * hat(y - node.y) * light[(y - job.first_cell) * cells + x];
}

@compute @workgroup_size(LANES)
fn blur(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let lane = i32(index);
    let block = vec2<i32>(group.xy) * vec2(LANES, ROWS);
    // Entry k of a kernel reaches the block's first pixel from cell `first - k`, and its last from `last - k`.
    let first = oversample * (vec2(job.left, job.top) + block) + before;
    let last = first + oversample * vec2(LANES - 1, ROWS - 1);
    let low = max(first - (size - 1), vec2(0, job.first_cell));
    let high = min(last, vec2(cells, job.end_cell) - 1);
    let place = low / tile + vec2(job.across, job.down);
    let node = tile * place;
    // Entries through which cells about the node reach the block.
    let start = max(first - min(high, node + tile - 1), vec2(0, job.first_row));
    let end = min(last - max(low, node - tile) + 1, vec2(size, job.end_row));
    if any(place > high / tile + 1) || any(start >= end) {
        return;
    }
    let kernel = ((place.y - job.first_node) * nodes + place.x) * size * size;
    // Sums of sums: rounding grows with the length of each, not with their product.
    var sum = vec4<f32>();
    for (var ky = start.y; ky < end.y; ky++) {
        for (var kx = start.x; kx < end.x; kx += columns) {
            let stop = min(kx + columns, end.x);
            let corner = first - vec2(stop - 1, ky);
            workgroupBarrier();
            for (var n = lane; n < (LANES - 1) * oversample + stop - kx; n += LANES) {
                segment[n] = vec4(
                    share(corner.x + n, corner.y, node),
                    share(corner.x + n, corner.y + oversample, node),
                    share(corner.x + n, corner.y + 2 * oversample, node),
                    share(corner.x + n, corner.y + 3 * oversample, node),
                );
            }
            workgroupBarrier();
            var row = vec4<f32>();
            let entry = kernel + ky * size;
            let cell = oversample * lane + stop - 1;
            for (var k = kx; k < stop; k++) {
                row += kernels[entry + k] * segment[cell - k];
            }
            sum += row;
        }
    }
    let x = block.x + lane;
    for (var r = 0; r < ROWS && block.y + r < job.height && x < job.width; r++) {
        pixels[(block.y + r) * job.width + x] += sum[r];
    }
}
