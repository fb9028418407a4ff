//! Jobs that are submitted together: their blocks, and the lists that they share.

use imf_core::field::EngineError;
use imf_core::section::device::{BoundaryOffsets, ToolDifferences};
use imf_core::section::{QueryBox, overlap_fraction};

use super::bits::BitLayout;
use crate::shader::{COUNT_DIGITS, COUNT_PLACES, LINEAR_GROUP};
use crate::uniforms::{Counting, Job};

/// Most jobs of a submission: enough to fill a large GPU, whose 270,000 invocations are forty sections of the paper's
/// scene, with what is under way beside it.
pub(super) const MOST_JOBS: usize = 32;
/// Tiles × run-length differences of a submission, so that no system's time limit on dispatches is met: 30 ms on an integrated GPU
/// of a teraflop by count of operations.
const MOST_WORK: u64 = 2_000_000_000;

/// One orientation over one slab, ready for the device.
pub(super) struct SlabJob {
    tool: ToolDifferences,
    covered: Vec<u32>,
    uncovered: Vec<u32>,
}

impl SlabJob {
    /// # Errors
    /// More run-length differences than a count's digits hold.
    pub(super) fn new(tool: ToolDifferences, layout: &BitLayout) -> Result<Self, EngineError> {
        let (covered, uncovered) = (layout.distances(&tool.covered), layout.distances(&tool.uncovered));
        let (ends, most) = (covered.len() + uncovered.len(), (1 << COUNT_DIGITS) - 1);
        if ends > most {
            return Err(EngineError::Device(format!(
                "the tool has {ends} run-length differences in this grid, and the GPU's kernels add up at most {most}. Take a larger \
                 pitch, or count on the CPU"
            )));
        }
        Ok(Self { tool, covered, uncovered })
    }

    /// Places where differences are taken.
    fn steps(&self) -> usize {
        self.tool.steps.len()
    }

    fn tiles(&self) -> u64 {
        let [x, y, z] = self.tool.steps.dims.map(|n| n as u64);
        x * y * z.div_ceil(u64::from(COUNT_PLACES))
    }

    fn work(&self) -> u64 {
        self.tiles() * (self.covered.len() + self.uncovered.len()) as u64
    }

    fn groups(&self) -> u32 {
        let [x, y, z] = self.tool.steps.dims.map(|n| n as u32);
        x * (y * z.div_ceil(COUNT_PLACES)).div_ceil(LINEAR_GROUP)
    }

    fn lines(&self) -> u32 {
        (self.steps() / self.tool.steps.dims[self.tool.axis].max(1)) as u32
    }
}

/// The lists of one submission.
#[derive(Default)]
pub(super) struct Batch {
    pub(super) jobs: Vec<Job>,
    pub(super) starts: Vec<u32>,
    pub(super) ends: Vec<u32>,
    /// Values of counts, as bits of floats.
    pub(super) shares: Vec<u32>,
    /// Places where differences are taken, of all jobs.
    pub(super) differences: usize,
    work: u64,
    groups: u32,
    lines: u32,
}

impl Batch {
    /// True where the job is still to be added: it does not make the differences, nor sections of `voxels` each, more
    /// than `room`. A first job always fits.
    pub(super) fn takes(&self, job: &SlabJob, voxels: usize, room: usize) -> bool {
        let jobs = self.jobs.len() + 1;
        let full = jobs > MOST_JOBS
            || self.differences + job.steps() > room
            || jobs * voxels > room
            || self.work + job.work() > MOST_WORK;
        self.jobs.is_empty() || !full
    }

    /// Adds a job; with a count of voxels of the tool, the values of all its counts.
    pub(super) fn add(&mut self, prepared: &SlabJob, orientation: usize, values_of: Option<u32>) {
        let tool = &prepared.tool;
        let [lower_x, lower_y, lower_z] = tool.steps.lower.map(|v| v as i32);
        let [nx, ny, nz] = tool.steps.dims.map(|n| n as u32);
        let (covered_starts, uncovered_starts) =
            (self.list(&tool.covered, &prepared.covered), self.list(&tool.uncovered, &prepared.uncovered));
        self.jobs.push(Job {
            axis: tool.axis as u32,
            upwards: u32::from(tool.upwards),
            lower_x,
            lower_y,
            lower_z,
            nx,
            ny,
            nz,
            differences: self.differences as u32,
            covered_first: tool.covered.first_plane as i32,
            covered_planes: tool.covered.starts.len() as u32 - 1,
            covered_starts,
            uncovered_first: tool.uncovered.first_plane as i32,
            uncovered_planes: tool.uncovered.starts.len() as u32 - 1,
            uncovered_starts,
            shares: self.shares.len() as u32,
            orientation: orientation as u32,
        });
        if let Some(count) = values_of {
            self.shares.extend((0..=count).map(|overlap| overlap_fraction(overlap, count).to_bits()));
        }
        self.differences += prepared.steps();
        self.work += prepared.work();
        self.groups = self.groups.max(prepared.groups());
        self.lines = self.lines.max(prepared.lines());
    }

    /// Adds a list of run-length differences; returns where its starts begin.
    fn list(&mut self, ends: &BoundaryOffsets, distances: &[u32]) -> u32 {
        let (starts, first) = (self.starts.len() as u32, self.ends.len() as u32);
        self.starts.extend(ends.starts.iter().map(|start| first + start));
        self.ends.extend_from_slice(distances);
        starts
    }

    /// The uniform block for this batch over a slab.
    pub(super) fn counting(&self, layout: &BitLayout, planes: usize, slab: &QueryBox) -> Counting {
        let [lower_x, lower_y, lower_z] = slab.lower.map(|v| v as i32);
        let [nx, ny, nz] = slab.dims.map(|n| n as u32);
        Counting {
            planes: planes as u32,
            lead_bits: layout.lead,
            plane_bits: layout.plane,
            line_bits: layout.line,
            jobs: self.jobs.len() as u32,
            groups: self.groups,
            lines: self.lines,
            lower_x,
            lower_y,
            lower_z,
            nx,
            ny,
            nz,
        }
    }

    /// Invocations, in whole workgroups, that take the differences.
    pub(super) fn difference_invocations(&self) -> usize {
        self.groups as usize * self.jobs.len() * LINEAR_GROUP as usize
    }

    /// Lines to sum up.
    pub(super) fn total_lines(&self) -> usize {
        self.lines as usize * self.jobs.len()
    }
}
