//! Overlaps of one tool with one obstacle, by one of two methods.
//!
//! `run_length` sums over the ends of the tool's runs, `fft` multiplies spectra. Both give the same whole numbers; the
//! estimate below decides which is used for a tool in an orientation. What a method needs is made at its first use.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use pulp::Arch;

use super::SectionError;
use super::bit_obstacle::BitObstacle;
use super::direct::{Spot, spot_check, spots};
use super::fft::{self, Convolver};
use super::run_length::{self, Cursor, RunLengthCounter};
use super::size::{CircularSize, QueryBox, VoxelBox};
use super::sweep::{Order, Sweep};
use crate::grid::Grid;
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::parallel::make_once;
use crate::tool::{Assembly, Tool, ToolError, ToolVoxels};

/// How overlaps are counted. Both methods give the same whole numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// By estimate for each orientation: transforms where they are so much faster that they are worth their memory.
    #[default]
    Fastest,
    /// Differences summed over the ends of the tool's runs of voxels.
    RunLength,
    /// Products of spectra by real FFTs.
    Fft,
}

/// Counts overlaps of one tool, in any orientation, with one obstacle.
pub(super) struct OverlapCounter {
    pub(super) obstacle: Arc<Occupancy>,
    /// In the grid's unit.
    pub(super) tool: Tool,
    pub(super) method: Method,
    pub(super) arch: Arch,
    size: CircularSize,
    pub(super) run_length: OnceLock<RunLengthCounter>,
    convolver: OnceLock<Convolver>,
}

/// State of a count that advances plane by plane through a box, and voxels that are compared with direct sums.
pub(super) struct OverlapCursor {
    cursor: Cursor,
    spots: [Spot; 3],
}

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct Scratch {
    run_length: run_length::Scratch,
    cursor: Cursor,
    fft: fft::Scratch,
}

// Measured in November 2026 on one core of an AMD Zen 4, screw gear at 121³ to 384³, the paper's tool scaled with it. The
// estimates come within a third of the measured times.

/// Seconds for a tile-wide load of 2,048 bits with AVX-512, with AVX2 or NEON, and with neither. Between sizes of the obstacle's bits
/// in and beyond the cache it grows by 75 %.
const LOAD_SECONDS: [f64; 3] = [3.8e-9, 5.5e-9, 2e-8];
/// Bytes of the obstacle's bits where that growth begins and ends.
const CACHE_BYTES: [f64; 2] = [2e6, 1.6e7];
/// Seconds for a voxel of the query box beside the loads.
const VOXEL_SECONDS: f64 = 2.0e-9;
/// Seconds for a point of a transform and a factor of two of their number, by the same instructions.
const POINT_SECONDS: [f64; 3] = [1.1e-10, 1.4e-10, 5.5e-10];
/// How many times as fast transforms must be to be chosen: they take three times the memory, and gain less from a second thread.
const WORTH_ITS_MEMORY: f64 = 1.5;
/// Bytes of shifted copies of the obstacle that addresses of 32 bits reach.
const MAX_COPY_BYTES: u64 = 1 << 31;

/// Estimated seconds of a section by either method.
#[derive(Clone, Copy, Debug)]
pub(super) struct Estimate {
    pub(super) run_length: f64,
    pub(super) fft: f64,
}

impl Estimate {
    fn new(
        arch: Arch,
        obstacle: [usize; 3],
        query: &QueryBox,
        size: &CircularSize,
        tool: &VoxelBox<'_>,
        sweep: &Sweep,
    ) -> Self {
        let loads = sweep.loads(tool, obstacle, size.line_bits(), query);
        let bytes = BitObstacle::memory(obstacle, size);
        let [inside, beyond] = CACHE_BYTES.map(f64::ln);
        let growth = 1.0 + 0.75 * (((bytes as f64).ln() - inside) / (beyond - inside)).clamp(0.0, 1.0);
        let instructions = match arch {
            #[cfg(target_arch = "x86_64")]
            Arch::V4(_) => 0,
            Arch::Scalar => 2,
            _ => 1,
        };
        let mut run_length = loads * LOAD_SECONDS[instructions] * growth + query.len() as f64 * VOXEL_SECONDS;
        if bytes > MAX_COPY_BYTES {
            run_length = f64::INFINITY;
        }
        let points: f64 = size.n.iter().map(|&n| n as f64).product();
        let fft = points * points.log2() * POINT_SECONDS[instructions];
        Self { run_length, fft }
    }

    fn prefers_run_length(&self) -> bool {
        self.run_length <= WORTH_ITS_MEMORY * self.fft
    }
}

/// An orientation in general position.
const SLANT: Orientation = Orientation { theta: 25.0, phi: 55.0, roll: 0.0 };

/// The tool in an orientation in general position, or upright where it holds no voxel centre there.
fn slanted(tool: &Tool, pitch: f64, size: &CircularSize) -> Option<ToolVoxels> {
    let voxels = |o| ToolVoxels::within(tool, o, pitch, size.first, size.last).ok();
    [SLANT, Orientation::default()].iter().find_map(voxels)
}

/// Voxels of the box of those of a tool that can matter, at the most.
pub(super) fn kept_voxels(grid: &Grid, query: QueryBox, tool: &Tool) -> u64 {
    let CircularSize { first, last, .. } = CircularSize::of(grid, query, tool);
    (0..3).map(|axis| (last[axis] - first[axis] + 1).max(0) as u64).fold(1, u64::saturating_mul)
}

impl OverlapCounter {
    /// For boxes of voxels within `query`.
    pub(super) fn new(obstacle: Arc<Occupancy>, tool: Tool, query: QueryBox) -> Self {
        Self {
            method: Method::default(),
            arch: Arch::new(),
            size: CircularSize::of(&obstacle.grid, query, &tool),
            obstacle,
            tool,
            run_length: OnceLock::new(),
            convolver: OnceLock::new(),
        }
    }

    /// The tool in an orientation; `None` where it is too thin to hold a voxel centre.
    pub(super) fn rotated(&self, orientation: &Orientation) -> Result<Option<ToolVoxels>, ToolError> {
        match self.voxels(orientation) {
            Err(ToolError::TooSmall { .. }) => Ok(None),
            rotated => rotated.map(Some),
        }
    }

    /// What of the tool can matter in an orientation, with the count of all.
    pub(super) fn voxels(&self, orientation: &Orientation) -> Result<ToolVoxels, ToolError> {
        let (pitch, CircularSize { first, last, .. }) = (self.obstacle.grid.pitch, self.size);
        ToolVoxels::within(&self.tool, orientation, pitch, first, last)
    }

    fn sweep(&self, tool: &VoxelBox<'_>, query: &QueryBox, order: Order) -> Sweep {
        Sweep::choose(tool, self.obstacle.grid.dims, self.size.line_bits(), query, order)
    }

    fn estimate(&self, query: &QueryBox, clipped: &VoxelBox<'_>, sweep: &Sweep) -> Estimate {
        Estimate::new(self.arch, self.obstacle.grid.dims, query, &self.size, clipped, sweep)
    }

    /// For the tool at a slant, as most orientations have it.
    pub(super) fn usual_estimate(&self, query: &QueryBox) -> Option<Estimate> {
        let tool = slanted(&self.tool, self.obstacle.grid.pitch, &self.size)?;
        let clipped = VoxelBox::of_tool(&tool, &self.size);
        Some(self.estimate(query, &clipped, &self.sweep(&clipped, query, Order::Any)))
    }

    /// Makes what transforms need, where most orientations are counted by them: threads that first ask at once would each make it.
    pub(super) fn prepare(&self, query: &QueryBox) {
        let is_made = self.convolver.get().is_some();
        if !is_made && self.usual_estimate(query).is_some_and(|estimate| !self.uses_run_length(estimate)) {
            self.convolver();
        }
    }

    /// True where the method is run-length counting.
    pub(super) fn uses_run_length(&self, estimate: Estimate) -> bool {
        match self.method {
            Method::Fastest => estimate.prefers_run_length(),
            Method::RunLength => true,
            Method::Fft => false,
        }
    }

    /// Overlaps over a box into `counts`, a few voxels compared with direct sums.
    pub(super) fn count(
        &self,
        tool: &ToolVoxels,
        query: &QueryBox,
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) -> Result<(), SectionError> {
        let clipped = VoxelBox::of_tool(tool, &self.size);
        let sweep = self.sweep(&clipped, query, Order::Any);
        let estimate = self.estimate(query, &clipped, &sweep);
        if self.uses_run_length(estimate)
            || !self.convolver().correlate(&clipped, query, &mut scratch.fft, counts)
        {
            if estimate.run_length.is_infinite() {
                return Err(SectionError::TooManyVoxels);
            }
            let Scratch { run_length, cursor, .. } = scratch;
            let counter = self.run_length();
            counter.start(&clipped, sweep, run_length, cursor);
            counter.advance(cursor, query, query.range(0), run_length, counts);
        }
        spot_check(&self.obstacle, tool, query, counts)
    }

    fn convolver(&self) -> &Convolver {
        make_once(&self.convolver, || Convolver::new(self.arch, &self.obstacle, self.size))
    }

    /// Adds the overlaps in an orientation to the counts over a box, and returns the tool's own count; none where it is too thin.
    pub(super) fn add(
        &self,
        orientation: &Orientation,
        query: &QueryBox,
        scratch: &mut Scratch,
        (counts, more): (&mut [u32], &mut Vec<u32>),
    ) -> Result<u32, SectionError> {
        let Some(rotated) = self.rotated(orientation)? else { return Ok(0) };
        more.resize(counts.len(), 0);
        self.count(&rotated, query, scratch, more)?;
        counts.iter_mut().zip(more).for_each(|(count, more)| *count += *more);
        Ok(rotated.count)
    }

    fn run_length(&self) -> &RunLengthCounter {
        make_once(&self.run_length, || RunLengthCounter::new(self.arch, &self.obstacle, &self.size))
    }

    /// A tool before the first plane of a box, to be counted by its run boundaries.
    pub(super) fn begin(&self, tool: &ToolVoxels, query: &QueryBox, scratch: &mut Scratch) -> OverlapCursor {
        let clipped = VoxelBox::of_tool(tool, &self.size);
        let (sweep, mut cursor) = (self.sweep(&clipped, query, Order::PlanesUpwards), Cursor::default());
        self.run_length().start(&clipped, sweep, &mut scratch.run_length, &mut cursor);
        OverlapCursor { cursor, spots: spots(&self.obstacle, tool, query) }
    }

    /// Overlaps over the next planes of the box, counted from its first one, into `counts`.
    pub(super) fn advance(
        &self,
        OverlapCursor { cursor, spots }: &mut OverlapCursor,
        (query, planes): (&QueryBox, &Range<usize>),
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) -> Result<(), SectionError> {
        let QueryBox { lower: [lower, ..], dims: [_, ny, nz] } = *query;
        let range = lower + planes.start as i64..lower + planes.end as i64;
        self.run_length().advance(cursor, query, range, &mut scratch.run_length, counts);
        let first = planes.start * ny * nz;
        let mut own = spots.iter().filter(|spot| (first..first + counts.len()).contains(&spot.index));
        own.try_for_each(|spot| spot.check(counts[spot.index - first]))
    }

    /// Bytes of what [`OverlapCounter::begin`] gives, by estimate.
    pub(super) fn cursor_bytes(&self, query: &QueryBox) -> u64 {
        slanted(&self.tool, self.obstacle.grid.pitch, &self.size)
            .map_or(0, |tool| Cursor::memory(&VoxelBox::of_tool(&tool, &self.size), query))
    }

    /// Human-readable, one line: the method for the tool in this orientation, and the alternative's estimate.
    pub(super) fn describe(&self, estimate: Estimate) -> String {
        let [x, y, z] = self.size.n;
        let run_length = ("run-length counting".to_owned(), estimate.run_length);
        let fft = (format!("real FFT {x}×{y}×{z}"), estimate.fft);
        let ((name, seconds), (other, more)) =
            if self.uses_run_length(estimate) { (run_length, fft) } else { (fft, run_length) };
        if self.method != Method::Fastest {
            return name;
        }
        let milliseconds = |seconds: f64| format!("{:.1} ms", seconds * 1e3);
        format!(
            "{name} ({} a section and thread by estimate, {} by {other})",
            milliseconds(seconds),
            milliseconds(more)
        )
    }
}

/// The layer that the cutter may enter, and shank and holder, which may not: the overlap of a pose counts forbidden
/// voxels in the whole tool, and those of the layer in shank and holder alone. Both counts are correlations of whole
/// numbers, and so is their sum: contact costs one more section and nothing in exactness.
///
/// `None` where there is no such layer, or nothing that must stay out of it.
pub(crate) fn cuttable_and_noncutting<'a>(
    obstacle: &'a Obstacle,
    assembly: &'a Assembly,
) -> Option<(&'a Arc<Occupancy>, &'a Tool)> {
    obstacle.cuttable.as_ref().zip(assembly.noncutting())
}

/// Bytes that counting takes beside the counts: shared by all threads, and per thread.
pub(super) fn memory(grid: &Grid, query: &QueryBox, tool: &Tool, threads: u64) -> u64 {
    let size = CircularSize::of(grid, *query, tool);
    let Some(rotated) = slanted(tool, grid.pitch, &size) else { return 0 };
    let clipped = VoxelBox::of_tool(&rotated, &size);
    let sweep = Sweep::choose(&clipped, grid.dims, size.line_bits(), query, Order::Any);
    if Estimate::new(Arch::new(), grid.dims, query, &size, &clipped, &sweep).prefers_run_length() {
        return BitObstacle::memory(grid.dims, &size);
    }
    fft::memory(grid.dims, &size, query, &clipped, threads)
}
