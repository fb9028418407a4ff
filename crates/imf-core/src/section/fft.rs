//! Correlation of obstacle and tool by Fourier transforms, planned once, with empty and unread lines skipped.
//!
//! What is transformed is not the voxels but the ends of their runs along z: +1 and −1. Their correlation is the overlap's second
//! difference along z, small whole numbers that f32 holds where it does not hold the overlaps themselves. Sums from a
//! place where the tool is beside the obstacle give the overlaps exactly, and must end at zero where they have come round the circle.
//!
//! The half spectrum along z is cut into blocks of [`LANES`] wave numbers, from 1 on, since run boundaries have nothing at 0. Within a
//! block everything that follows is a plane transform: along y for the tool's own rows, along x and back with the product in
//! between, back along y for the rows that are read.
//!
//! ```text
//! tool [tx][ty][z] → z → [block][tx][ty] → y → [tx][ky]
//!   → x → · obstacle [block][ky][kx] → x⁻¹ → [qx][ky] → y⁻¹ → [block][qx][qy] → z⁻¹ → sums → counts
//! ```
//! Each entry stands for the block's wave numbers, one a lane; along z each lane is two lines instead, which as real and
//! imaginary part make one complex transform.

mod butterflies;
mod joined;
mod lines;

use pulp::Arch;

use self::joined::{Both, Join, Split, Sum, WriteCounts};
use self::lines::{LANES, LineTransform, Point, Segment, Work, ZERO};
use super::size::{CircularSize, QueryBox, VoxelBox};
use crate::occupancy::Occupancy;
use crate::parallel::for_each_chunk;

/// Real lines that are transformed together along z.
const PAIRED: usize = 2 * LANES;

/// Plans and the obstacle's spectrum.
pub(super) struct Convolver {
    arch: Arch,
    size: CircularSize,
    /// Voxels of the obstacle along z.
    depth: usize,
    along: [LineTransform; 3],
    /// `[block][ky][kx]`, divided by the number of points.
    spectrum: Vec<Point>,
}

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct Scratch {
    /// A transform along x, or what is transformed along z.
    line: Vec<Point>,
    /// A transform along z.
    other: Vec<Point>,
    input: Vec<Point>,
    columns: Vec<Point>,
    rows: Vec<Point>,
    output: Vec<Point>,
    /// Counts of [`PAIRED`] lines.
    sums: Vec<Both>,
    work: Work,
}

impl Convolver {
    pub(super) fn new(arch: Arch, obstacle: &Occupancy, size: CircularSize) -> Self {
        let along = size.n.map(|length| LineTransform::new(arch, length));
        let depth = obstacle.grid.dims[2];
        let mut convolver = Self { arch, size, depth, along, spectrum: Vec::new() };
        convolver.spectrum = convolver.obstacle_spectrum(obstacle);
        convolver
    }

    fn obstacle_spectrum(&self, obstacle: &Occupancy) -> Vec<Point> {
        let [nx, ny, _] = self.size.n;
        let mut scratch = Scratch::default();
        let solid = VoxelBox::of_obstacle(obstacle);
        let points = self.size.n.iter().map(|&n| n as f64).product::<f64>();
        self.transform_z(&solid, (1.0 / points) as f32, &mut scratch);
        let mut spectrum = vec![ZERO; blocks_of(&self.size) * ny * nx];
        let memory = || (Vec::new(), Work::default());
        for_each_chunk(&mut spectrum, ny * nx, memory, |(columns, work), block, planes| {
            self.transform_y(&solid, block, &scratch.input, columns, work);
            for (ky, target) in planes.chunks_exact_mut(nx).enumerate() {
                self.transform_x(&solid, &columns[ky..], target, work);
            }
        });
        spectrum
    }

    /// Correlates the obstacle with a tool: overlaps over a query box, for which the size given to `new` holds, into
    /// `counts`. False where rounding may have made one of them wrong.
    pub(super) fn correlate(
        &self,
        tool: &VoxelBox<'_>,
        query: &QueryBox,
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) -> bool {
        let [nx, ny, _] = self.size.n;
        let [qx, qy, _] = query.dims;
        if tool.dims[0] == 0 {
            counts.fill(0);
            return true;
        }
        debug_assert!(self.size.n[2] > self.depth + tool.dims[2], "two places where the tool meets nothing");
        debug_assert!((0..3).all(|axis| query.dims[axis] <= self.size.n[axis]), "each place is read once");
        self.transform_z(tool, 1.0, scratch);
        let blocks = blocks_of(&self.size);
        scratch.output.resize(blocks * qx * qy, ZERO);
        scratch.rows.resize(qx * ny, ZERO);
        let (read_x, read_y) =
            (self.segment(0, query.lower, query.dims, ny), self.segment(1, query.lower, query.dims, 1));
        let Scratch { line, input, columns, rows, output, work, .. } = &mut *scratch;
        for block in 0..blocks {
            self.transform_y(tool, block, input, columns, work);
            for ky in 0..ny {
                self.transform_x(tool, &columns[ky..], &mut line[..nx], work);
                let obstacle = &self.spectrum[(block * ny + ky) * nx..][..nx];
                self.along[0].inverse_of_product(obstacle, &line[..nx], (&mut rows[ky..], read_x), work);
            }
            let targets = output[block * qx * qy..].chunks_exact_mut(qy);
            for (row, target) in rows.chunks_exact(ny).zip(targets) {
                self.along[1].inverse(row, (target, read_y), work);
            }
        }
        let mut exact = true;
        for x in 0..qx {
            for first in (0..qy).step_by(PAIRED) {
                exact &= self.inverse_z(tool, query, (x, first), scratch, counts);
            }
        }
        exact
    }

    /// Transforms run boundaries along z, each of this size, into `scratch.input [block][tx][ty]`.
    fn transform_z(&self, solid: &VoxelBox<'_>, size: f32, scratch: &mut Scratch) {
        let [nx, _, nz] = self.size.n;
        let [tx, ty, tz] = solid.dims;
        let blocks = blocks_of(&self.size);
        scratch.line.resize(nx.max(nz), ZERO);
        scratch.other.resize(nz, ZERO);
        scratch.input.clear();
        scratch.input.resize(blocks * tx * ty, ZERO);
        for (x, first) in (0..tx).flat_map(|x| (0..ty).step_by(PAIRED).map(move |first| (x, first))) {
            let count = PAIRED.min(ty - first);
            let line = &mut scratch.line[..nz];
            line.fill(ZERO);
            let mut any = false;
            for lane in 0..count {
                let mut before = 0;
                let solids = solid.line(x, first + lane).iter().chain(&[0]).enumerate();
                for (z, &now) in solids.take(tz + 1) {
                    if now != before {
                        let part = &mut line[wrap(solid.lower[2] + z as i64, nz)][lane / LANES];
                        part.0[lane % LANES] += size * (f32::from(now) - f32::from(before));
                        (any, before) = (true, now);
                    }
                }
            }
            if !any {
                continue;
            }
            let Scratch { line, other, input, work, .. } = &mut *scratch;
            let spectrum = &mut other[..nz];
            self.along[2].forward(&line[..nz], Segment::whole(nz), spectrum, work);
            for block in 0..blocks {
                let target = &mut input[(block * tx + x) * ty + first..][..count];
                self.arch.dispatch(Split { joint: spectrum, first: block * LANES, lines: target });
            }
        }
    }

    /// Where the voxels of a box stand along an axis of the circle, and from one to the next in memory.
    fn segment(&self, axis: usize, lower: [i64; 3], dims: [usize; 3], step: usize) -> Segment {
        Segment { begin: wrap(lower[axis], self.size.n[axis]), count: dims[axis], step }
    }

    /// Transforms one block along y into `columns [tx][ky]`.
    fn transform_y(
        &self,
        solid: &VoxelBox<'_>,
        block: usize,
        input: &[Point],
        columns: &mut Vec<Point>,
        work: &mut Work,
    ) {
        let ny = self.size.n[1];
        let [tx, ty, _] = solid.dims;
        columns.resize(tx * ny, ZERO);
        let segment = self.segment(1, solid.lower, solid.dims, 1);
        let sources = input[block * tx * ty..].chunks_exact(ty);
        for (source, target) in sources.zip(columns.chunks_exact_mut(ny)) {
            self.along[1].forward(source, segment, target, work);
        }
    }

    /// Transforms one wave number of the columns along x.
    fn transform_x(&self, solid: &VoxelBox<'_>, columns: &[Point], to: &mut [Point], work: &mut Work) {
        self.along[0].forward(columns, self.segment(0, solid.lower, solid.dims, self.size.n[1]), to, work);
    }

    /// Transforms the rows from `(x, first)` on back along z, and sums their second differences to counts. False where
    /// one may be wrong.
    fn inverse_z(
        &self,
        tool: &VoxelBox<'_>,
        query: &QueryBox,
        (x, first): (usize, usize),
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) -> bool {
        let nz = self.size.n[2];
        let [qx, qy, qz] = query.dims;
        let count = PAIRED.min(qy - first);
        let Scratch { line, other, output, sums, work, .. } = scratch;
        let (line, other) = (&mut line[..nz], &mut other[..nz]);
        line[0] = ZERO;
        for block in 0..blocks_of(&self.size) {
            let source = &output[(block * qx + x) * qy + first..][..count];
            self.arch.dispatch(Join { lines: source, joint: line, first: block * LANES });
        }
        self.along[2].inverse(line, (other, Segment::whole(nz)), work);
        // There the tool has passed the obstacle, and at the next place as well: the circle is that long.
        let start = self.depth as i64 - tool.lower[2];
        let after = wrap(start + 2 - query.lower[2], nz);
        let counts = &mut counts[(x * qy + first) * qz..][..count * qz];
        sums.resize(qz.next_multiple_of(LANES), Both::default());
        let sum = Sum { differences: other, from: wrap(start + 1, nz), after, sums: &mut sums[..qz] };
        let exact = self.arch.dispatch(sum);
        self.arch.dispatch(WriteCounts { sums, qz, counts });
        exact
    }
}

/// Bytes of an obstacle's plan, which all threads share, and of every thread's working memory.
pub(super) fn memory(
    [ox, oy, _]: [usize; 3],
    size: &CircularSize,
    query: &QueryBox,
    tool: &VoxelBox<'_>,
    threads: u64,
) -> u64 {
    let [nx, ny, blocks] = [size.n[0], size.n[1], blocks_of(size)];
    let ([tx, ty, _], [qx, qy, _]) = (tool.dims, query.dims);
    let own = blocks * (tx * ty + qx * qy) + (tx + qx) * ny;
    // The obstacle's own lines, while its spectrum is made.
    let made = (blocks * ox * oy) as u64 + threads * (ox * ny) as u64;
    size_of::<Point>() as u64 * ((blocks * nx * ny) as u64 + made.max(threads * own as u64))
}

/// Blocks of the half spectrum along z.
fn blocks_of(size: &CircularSize) -> usize {
    (size.n[2] / 2).div_ceil(LANES)
}

/// Position on a circle of `n` points.
fn wrap(index: i64, n: usize) -> usize {
    index.rem_euclid(n as i64) as usize
}
