//! The two ways to count overlaps, and which one is taken.
//!
//! `surface` sums over the tool's run ends, `convolution` multiplies spectra. Both give the same whole numbers; the
//! estimate below decides which is faster for a tool in an orientation. What a way needs is made at its first use.

use std::ops::Range;
use std::sync::OnceLock;

use pulp::Arch;

use super::bit_adder::TILE_BITS;
use super::bit_obstacle::BitObstacle;
use super::clipped::ClippedTool;
use super::convolution::{self, Convolver};
use super::size::{CircularSize, QueryBox};
use super::surface::{self, SurfaceCounter, Walk};
use super::sweep::{Order, Sweep};
use crate::occupancy::Occupancy;
use crate::tool::RotatedTool;

/// How overlaps are counted. All ways give the same whole numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// The faster one for each orientation, by estimate.
    #[default]
    Fastest,
    /// Sums over the ends of the tool's runs of voxels.
    RunEnds,
    /// Products of spectra by real FFTs.
    Transform,
}

/// Counts overlaps of any tool with one obstacle.
pub(super) struct Counter {
    pub(super) method: Method,
    pub arch: Arch,
    size: CircularSize,
    obstacle_count: usize,
    pub(super) run_ends: OnceLock<SurfaceCounter>,
    single: OnceLock<Convolver<f32>>,
    double: OnceLock<Convolver<f64>>,
}

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct Scratch {
    run_ends: surface::Scratch,
    single: convolution::Scratch<f32>,
    double: convolution::Scratch<f64>,
}

// Measured in November 2026 on one core of an AMD Zen 5, teapot and screw gear at 58×76×121 to 256³, the paper's tool
// and a cylinder of radius 60 in 121. The estimates come within a third of the measured times.

/// Seconds for a tile-wide load of 2,048 bits with AVX-512, with AVX2 or NEON, and with neither (not measured: in
/// proportion to instructions). Between sizes of the obstacle's bits in and beyond the cache it grows by 75 %.
const LOAD_SECONDS: [f64; 3] = [3.3e-9, 1.0e-8, 4e-8];
/// Bytes of the obstacle's bits where that growth begins and ends.
const CACHE_BYTES: [f64; 2] = [2e6, 1.6e7];
/// Seconds for a voxel of the query box beside the loads.
const VOXEL_SECONDS: f64 = 2.0e-9;
/// Seconds for a point of a transform and a factor of two of their number.
const POINT_SECONDS: f64 = 2.2e-10;
/// Transforms in f64 take so many times as long; memory, not arithmetic, holds both up.
const DOUBLE_FACTOR: f64 = 1.4;
/// Bytes of shifted copies of the obstacle that addresses of 32 bits reach.
const MOST_COPY_BYTES: u64 = 1 << 31;

/// Estimated seconds of a section by either way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Estimate {
    pub(super) run_ends: f64,
    pub(super) transform: f64,
}

impl Estimate {
    pub(super) fn new(
        arch: Arch,
        obstacle: [usize; 3],
        query: &QueryBox,
        size: &CircularSize,
        tool: &ClippedTool<'_>,
        sweep: &Sweep,
        single: bool,
    ) -> Self {
        let loads = sweep.loads(tool, obstacle, size.line_bits(), query);
        let bytes = BitObstacle::memory(obstacle, size, TILE_BITS);
        let [inside, beyond] = CACHE_BYTES.map(f64::ln);
        let growth = 1.0 + 0.75 * (((bytes as f64).ln() - inside) / (beyond - inside)).clamp(0.0, 1.0);
        let mut run_ends =
            loads * LOAD_SECONDS[arch_rank(arch)] * growth + query.len() as f64 * VOXEL_SECONDS;
        if bytes > MOST_COPY_BYTES {
            run_ends = f64::INFINITY;
        }
        let points: f64 = size.n.iter().map(|&n| n as f64).product();
        let transform = points * points.log2() * POINT_SECONDS * if single { 1.0 } else { DOUBLE_FACTOR };
        Self { run_ends, transform }
    }

    pub(super) fn prefers_run_ends(&self) -> bool {
        self.run_ends <= self.transform
    }
}

fn arch_rank(arch: Arch) -> usize {
    match arch {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(_) => 0,
        Arch::Scalar => 2,
        _ => 1,
    }
}

impl Counter {
    pub(super) fn new(obstacle: &Occupancy, size: CircularSize) -> Self {
        Self {
            method: Method::default(),
            arch: Arch::new(),
            size,
            obstacle_count: obstacle.count(),
            run_ends: OnceLock::new(),
            single: OnceLock::new(),
            double: OnceLock::new(),
        }
    }

    /// True where f32 is precise enough for the transforms.
    fn fits_single(&self, tool: &RotatedTool) -> bool {
        self.size.error_bound::<f32>(self.obstacle_count, tool.count as usize) < 0.5
    }

    /// Estimated seconds for a tool in an orientation.
    pub(super) fn estimate(&self, obstacle: &Occupancy, tool: &RotatedTool, query: &QueryBox) -> Estimate {
        let clipped = ClippedTool::new(tool, &self.size);
        let sweep = Sweep::choose(&clipped, obstacle.grid.dims, self.size.line_bits(), query, Order::Any);
        self.estimate_of(obstacle, tool, query, &clipped, &sweep)
    }

    fn estimate_of(
        &self,
        obstacle: &Occupancy,
        tool: &RotatedTool,
        query: &QueryBox,
        clipped: &ClippedTool<'_>,
        sweep: &Sweep,
    ) -> Estimate {
        let (dims, single) = (obstacle.grid.dims, self.fits_single(tool));
        Estimate::new(self.arch, dims, query, &self.size, clipped, sweep, single)
    }

    /// Overlaps over a box within the one that the counter was made for into `counts`. The obstacle is the counter's.
    pub(super) fn count(
        &self,
        obstacle: &Occupancy,
        tool: &RotatedTool,
        query: &QueryBox,
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) {
        let clipped = ClippedTool::new(tool, &self.size);
        let sweep = Sweep::choose(&clipped, obstacle.grid.dims, self.size.line_bits(), query, Order::Any);
        if self.takes_run_ends(self.estimate_of(obstacle, tool, query, &clipped, &sweep)) {
            self.surface(obstacle).count(&clipped, sweep, query, &mut scratch.run_ends, counts);
            return;
        }
        // A deviation from whole numbers near ½ would be ambiguous: a quarter is already a reason for f64.
        if self.fits_single(tool) {
            let convolver = self.single.get_or_init(|| Convolver::new(obstacle, self.size));
            if convolver.correlate(&clipped, query, &mut scratch.single, counts) < 0.25 {
                return;
            }
        }
        let convolver = self.double.get_or_init(|| Convolver::new(obstacle, self.size));
        convolver.correlate(&clipped, query, &mut scratch.double, counts);
    }

    /// True where run ends are the way taken.
    pub(super) fn takes_run_ends(&self, estimate: Estimate) -> bool {
        match self.method {
            Method::Fastest => estimate.prefers_run_ends(),
            Method::RunEnds => true,
            Method::Transform => false,
        }
    }

    /// Sizes of what is counted.
    pub(super) fn size(&self) -> &CircularSize {
        &self.size
    }

    fn surface(&self, obstacle: &Occupancy) -> &SurfaceCounter {
        self.run_ends.get_or_init(|| SurfaceCounter::new(self.arch, obstacle, &self.size))
    }

    /// A tool before the first plane of a box, to be counted by run ends. The obstacle is the counter's.
    pub(super) fn begin(
        &self,
        obstacle: &Occupancy,
        tool: &RotatedTool,
        query: &QueryBox,
        scratch: &mut Scratch,
    ) -> Walk {
        let clipped = ClippedTool::new(tool, &self.size);
        let (dims, line) = (obstacle.grid.dims, self.size.line_bits());
        let sweep = Sweep::choose(&clipped, dims, line, query, Order::PlanesUpwards);
        self.surface(obstacle).begin(&clipped, sweep, &mut scratch.run_ends)
    }

    /// Overlaps over the next planes of the box into `counts`.
    pub(super) fn advance(
        &self,
        obstacle: &Occupancy,
        walk: &mut Walk,
        (query, planes): (&QueryBox, Range<i64>),
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) {
        self.surface(obstacle).advance(walk, query, planes, &mut scratch.run_ends, counts);
    }

    /// One line for people: what is taken for the tool in this orientation, and what it was weighed against.
    pub(super) fn describe(&self, estimate: Estimate) -> String {
        let [x, y, z] = self.size.n;
        let transform = format!("real FFT {x}×{y}×{z}");
        let milliseconds = |seconds: f64| format!("{:.1} ms", seconds * 1e3);
        match self.method {
            Method::RunEnds => "run ends".into(),
            Method::Transform => transform,
            Method::Fastest if estimate.prefers_run_ends() => format!(
                "run ends ({} a section and thread by estimate, {} by {transform})",
                milliseconds(estimate.run_ends),
                milliseconds(estimate.transform)
            ),
            Method::Fastest => format!(
                "{transform} ({} a section and thread by estimate, {} by run ends)",
                milliseconds(estimate.transform),
                milliseconds(estimate.run_ends)
            ),
        }
    }
}
