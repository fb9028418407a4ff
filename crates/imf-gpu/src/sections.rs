//! Exact sections on a GPU: the same whole numbers as on the CPU, and the same values bit for bit.
//!
//! The host voxelises the rotated tool and lists its run-length differences ([`imf_core::section::device::DifferenceLimits`]); the device never
//! recomputes a voxel. It takes the differences of neighbouring overlaps from the obstacle's bits, sums them up along
//! the tool's axis of steps, and returns the overlaps or retains the minimum over all orientations. Everything
//! on the device is whole numbers. Values are made by the host: from counts that are read back, or beforehand for
//! every possible count of a tool, as a table that the device looks up, so that ties between orientations fall as on the
//! CPU.
//!
//! # Why differences of bits
//!
//! A section of the paper's scene has 533,368 voxels; the tool at a slant has some 38,000 voxels, 1,900 runs along z
//! and 2,500 to 4,500 run-length differences along its best axis. All figures here are estimates, counted by hand. For one section:
//!
//! | method | loads of a word | logical and whole-number operations |
//! | --- | --- | --- |
//! | running sums along z, two a run and voxel | 2.0e9 | 4e9 |
//! | every voxel of the tool, 128 places at once | 8e8 | 5e9 |
//! | run-length differences, 128 places at once (this) | 1.0e8 | 6e8 |
//!
//! The last line: 58 planes × 76 lines × 1 tile, some 1.4 times as many for the steps beyond the box, times 3,500 run
//! ends of which two thirds lie in a plane of the obstacle; each takes 6 loads, 16 operations to shift and about 20
//! to add, of which a GPU with three-operand logic needs half. An H200 does some 1.4e13 such operations and 7e12 loads
//! from its first-level cache a second, so that by count a section takes 0.05 ms; the obstacle's bits (0.5 MB with
//! their zeros, a tenth of it read) stay in that cache. Differences and sums, three times 3 MB a section, stay in the
//! second level. **None of this has been measured on a hardware GPU yet**: `imf-bench gpu --only sections` does.
//!
//! What one invocation does for one section is too little to fill a large GPU (4,408 tiles, 270,000 invocations), so
//! up to 32 orientations go in one submission of three dispatches. A grid whose differences exceed what the adapter
//! binds is counted in slabs along x. Where a cutter may touch the part, the layer that only shank and holder must stay
//! out of is counted by itself and added.

mod batch;
mod bits;
mod layer;

use std::sync::{Mutex, PoisonError};

use imf_core::control::Control;
use imf_core::field::EngineError;
use imf_core::orientation::Orientation;
use imf_core::section::{Imf, SectionError, SectionPlan, overlap_fraction};
use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator};
use thiserror::Error;

use self::batch::MOST_JOBS;
use self::layer::{Layer, OrientedTool};
use crate::device::Gpu;

/// Bytes of counts that wait on the host for one round of orientations.
const HOST_BYTES: usize = 256 << 20;
/// Voxels whose minimum is compared with direct sums.
const WATCHED: usize = 3;

/// Why a section could not be had from a GPU.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GpuSectionError {
    /// What would stop the CPU as well.
    #[error(transparent)]
    Section(#[from] SectionError),
    /// A scene beyond the adapter's limits, too little memory, or a device that failed.
    #[error(transparent)]
    Device(#[from] EngineError),
}

/// Sections of one plan on one GPU.
pub struct GpuSections<'a> {
    gpu: Gpu,
    plan: &'a SectionPlan,
    whole: Layer<'a>,
    /// What a part of the tool must stay out of as well.
    cuttable: Option<Layer<'a>>,
}

/// A round of orientations for both layers.
struct Round {
    whole: Vec<OrientedTool>,
    cuttable: Vec<OrientedTool>,
}

impl<'a> GpuSections<'a> {
    /// Compiles the kernels and uploads the obstacles.
    ///
    /// # Errors
    /// [`EngineError::Device`] for a scene beyond the adapter's limits, too little memory, or a device that failed.
    pub fn new(gpu: &Gpu, plan: &'a SectionPlan) -> Result<Self, EngineError> {
        let query = plan.query_box();
        let cuttable = plan.cuttable_layer().map(|layer| Layer::new(gpu, layer, query, true)).transpose()?;
        Ok(Self { gpu: gpu.clone(), plan, whole: Layer::new(gpu, plan.layer(), query, false)?, cuttable })
    }

    /// Bytes on the host beside the plan's own, about: tools, lists and counts of one round of orientations.
    #[must_use]
    pub fn host_bytes(&self) -> u64 {
        let section = 4 * self.plan.query_box().len() as u64;
        let round = self.round(true) as u64;
        self.layers().map(|layer| layer.host_bytes(round) + round * 2 * section).sum()
    }

    fn layers(&self) -> impl Iterator<Item = &Layer<'a>> {
        [&self.whole].into_iter().chain(&self.cuttable)
    }

    /// Orientations of one round. Sections that are read back wait on the host for their turn.
    fn round(&self, read_back: bool) -> usize {
        let section = 4 * self.plan.query_box().len() * self.layers().count();
        if read_back { (HOST_BYTES / section.max(1)).clamp(1, MOST_JOBS) } else { MOST_JOBS }
    }

    fn prepare(&self, orientations: &[Orientation], first: usize) -> Result<Round, GpuSectionError> {
        let of_layer = |layer: &Layer<'_>| layer.prepare(orientations, first, &[]);
        let cuttable = self.cuttable.as_ref().map(of_layer).transpose()?.unwrap_or_default();
        Ok(Round { whole: of_layer(&self.whole)?, cuttable })
    }

    /// As [`imf_core::section::stream_sections`]: computes the sections of `orientations` and shows each to `visit`
    /// with its index, in no fixed order, from all threads of the current pool. Visitors are made by `start`; all are
    /// returned. One unit of progress is one section.
    ///
    /// # Errors
    /// A tool that does not fit the grid, a failed spot check, a device that failed; [`SectionError::Cancelled`] when
    /// the control asks to stop.
    pub fn stream<V: Send>(
        &mut self,
        orientations: &[Orientation],
        control: Control<'_>,
        start: impl Fn() -> V + Sync,
        visit: impl Fn(&mut V, usize, &[f32]) + Sync,
    ) -> Result<Vec<V>, GpuSectionError> {
        let size = self.round(true);
        let mut rounds = orientations.chunks(size).zip((0..).step_by(size));
        let mut round = rounds.next().map(|(part, first)| self.prepare(part, first)).transpose()?;
        let plan = self.plan;
        let idle: Mutex<Vec<(V, Vec<f32>)>> = Mutex::new(Vec::new());
        let lock = || idle.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some(Round { whole, cuttable }) = round {
            let begun = self.whole.begin(&whole)?;
            let begun_cuttable = self.cuttable.as_mut().map(|layer| layer.begin(&cuttable)).transpose()?;
            // While the device is at work.
            round = rounds.next().map(|(part, first)| self.prepare(part, first)).transpose()?;
            let counts = self.whole.finish(begun, whole.len())?;
            let counts_cuttable = match (&self.cuttable, begun_cuttable) {
                (Some(layer), Some(begun)) => layer.finish(begun, cuttable.len())?,
                _ => Vec::new(),
            };
            (&whole, counts).into_par_iter().enumerate().try_for_each(|(place, (turn, counts))| {
                control.check()?;
                // The whole tool holds a voxel centre, or it had been refused.
                let Some(rotated) = &turn.rotated else { return Ok::<_, SectionError>(()) };
                let more = cuttable
                    .get(place)
                    .and_then(|turn| turn.rotated.as_ref())
                    .zip(counts_cuttable.get(place));
                let more = more.map(|(rotated, counts)| (rotated, counts.as_slice()));
                let (mut visitor, mut cmf) =
                    lock().pop().unwrap_or_else(|| (start(), vec![0.0; plan.grid().len()]));
                plan.cmf_of_counts(&orientations[turn.index], (rotated, counts), more, &mut cmf)?;
                visit(&mut visitor, turn.index, &cmf);
                lock().push((visitor, cmf));
                (control.progress)(1);
                Ok(())
            })?;
        }
        Ok(idle.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().map(|(v, _)| v).collect())
    }

    /// Whether [`GpuSections::imf`] computes the minimum on the device. With sharp points off the tip, or a
    /// cutter that may touch the part, the sections are read back, and the minimum is taken on the host as on the CPU.
    #[must_use]
    pub fn keeps_minimum(&self) -> bool {
        self.plan.tip_alone() && self.cuttable.is_none()
    }

    /// As [`imf_core::section::imf`], value for value and orientation for orientation. One unit of progress is one
    /// orientation.
    ///
    /// # Errors
    /// As [`GpuSections::stream`]; [`EngineError::Device`] where the minimum at a few watched voxels is not that of
    /// direct sums.
    pub fn imf(
        &mut self,
        orientations: &[Orientation],
        control: Control<'_>,
    ) -> Result<Imf, GpuSectionError> {
        let voxels = self.plan.grid().len();
        let mut whole = Imf::new(voxels);
        if orientations.is_empty() {
            return Ok(whole);
        }
        if !self.keeps_minimum() {
            let parts = self.stream(orientations, control, || Imf::new(voxels), Imf::lower_to)?;
            parts.iter().for_each(|part| whole.merge(part));
            return Ok(whole);
        }
        self.whole.clear_minimum()?;
        let watched: Vec<usize> = (1..=WATCHED).map(|part| voxels * part / (WATCHED + 1)).collect();
        let mut expected = Imf::new(watched.len());
        for (part, first) in orientations.chunks(MOST_JOBS).zip((0..).step_by(MOST_JOBS)) {
            control.check().map_err(SectionError::from)?;
            let turned = self.whole.prepare(part, first, &watched)?;
            for turn in &turned {
                let normaliser = turn.rotated.as_ref().map_or(1, |rotated| rotated.count);
                let values: Vec<f32> =
                    turn.watched.iter().map(|&count| overlap_fraction(count, normaliser)).collect();
                expected.lower_to(turn.index, &values);
            }
            self.whole.lower_to(&turned)?;
            (control.progress)(part.len() as u64);
        }
        self.whole.read_minimum(&mut whole)?;
        for (place, &voxel) in watched.iter().enumerate() {
            let (value, best) = (whole.value[voxel], whole.best[voxel]);
            if value != expected.value[place] || best != expected.best[place] {
                return Err(GpuSectionError::Device(EngineError::Device(format!(
                    "{} found the minimum {value} for orientation {best} at voxel {:?}, direct sums {} for {}: \
                     please report this, and count on the CPU",
                    self.gpu.adapter().name,
                    self.plan.grid().voxel(voxel),
                    expected.value[place],
                    expected.best[place]
                ))));
            }
        }
        Ok(whole)
    }

    /// Seconds that the device takes for each of these orientations once they are prepared and uploaded, nothing read
    /// back: the same batch is submitted `times` times, after once that is not counted.
    ///
    /// # Errors
    /// As [`GpuSections::stream`].
    pub fn measure(&mut self, orientations: &[Orientation], times: usize) -> Result<f64, GpuSectionError> {
        let mut seconds = self.whole.measure(orientations, times)?;
        if let Some(cuttable) = &mut self.cuttable {
            seconds += cuttable.measure(orientations, times)?;
        }
        Ok(seconds / orientations.len().max(1) as f64)
    }

    /// Fills what the kernels write on the device with `value`, on which no result may depend: for tests.
    pub fn fill_scratch(&mut self, value: u32) {
        self.whole.fill_scratch(value);
        self.cuttable.iter_mut().for_each(|layer| layer.fill_scratch(value));
    }
}
