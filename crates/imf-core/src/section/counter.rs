//! The two ways to count overlaps, and which one is taken.
//!
//! `surface` sums over the tool's run ends, `convolution` multiplies spectra. Both give the same whole numbers; the
//! estimate below decides which is faster for a tool in an orientation. What a way needs is made at its first use.

use std::sync::OnceLock;

use pulp::Arch;

use super::clipped::ClippedTool;
use super::convolution::{self, Convolver};
use super::size::{CircularSize, QueryBox};
use super::surface::{self, SurfaceCounter};
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
    arch: Arch,
    query: QueryBox,
    size: CircularSize,
    obstacle_count: usize,
    run_ends: OnceLock<SurfaceCounter>,
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

impl Counter {
    pub(super) fn new(obstacle: &Occupancy, query: QueryBox, size: CircularSize) -> Self {
        Self {
            method: Method::default(),
            arch: Arch::new(),
            query,
            size,
            obstacle_count: obstacle.count(),
            run_ends: OnceLock::new(),
            single: OnceLock::new(),
            double: OnceLock::new(),
        }
    }

    /// Overlaps over the query box into `counts`. The obstacle is the one that the counter was made for.
    pub(super) fn count(
        &self,
        obstacle: &Occupancy,
        tool: &RotatedTool,
        scratch: &mut Scratch,
        counts: &mut [u32],
    ) {
        let clipped = ClippedTool::new(tool, &self.size);
        if self.method != Method::Transform {
            let counter = self
                .run_ends
                .get_or_init(|| SurfaceCounter::new(self.arch, obstacle, self.query, &self.size));
            counter.count(&clipped, &mut scratch.run_ends, counts);
            return;
        }
        // A deviation from whole numbers near ½ would be ambiguous: a quarter is already a reason for f64.
        if self.size.error_bound::<f32>(self.obstacle_count, tool.count as usize) < 0.5 {
            let convolver = self.single.get_or_init(|| Convolver::new(obstacle, self.query, self.size));
            if convolver.correlate(&clipped, &mut scratch.single, counts) < 0.25 {
                return;
            }
        }
        let convolver = self.double.get_or_init(|| Convolver::new(obstacle, self.query, self.size));
        convolver.correlate(&clipped, &mut scratch.double, counts);
    }
}
