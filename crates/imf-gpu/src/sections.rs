//! Exact sections on a GPU: the same whole numbers as on the CPU, and the same values bit for bit.
//!
//! The host voxelises the rotated tool and lists its run ends ([`imf_core::section::StepSpace`]); the device never
//! recomputes a voxel. It takes the differences of neighbouring overlaps from the obstacle's bits, sums them up along
//! the tool's axis of steps, and hands the overlaps back or keeps the least value over all orientations. Everything
//! on the device is whole numbers. Values are made by the host: from counts that are read back, or beforehand for
//! every possible count of a tool, as a table that the device looks up, so that ties between orientations fall as on the
//! CPU.
//!
//! # Why differences of bits
//!
//! A section of the paper's scene has 533,368 voxels; the tool at a slant has some 38,000 voxels, 1,900 runs along z
//! and 2,500 to 4,500 run ends along its best axis. All figures here are estimates, counted by hand. For one section:
//!
//! | method | loads of a word | logical and whole-number operations |
//! | --- | --- | --- |
//! | running sums along z, two a run and voxel | 2.0e9 | 4e9 |
//! | every voxel of the tool, 128 places at once | 8e8 | 5e9 |
//! | run ends, 128 places at once (this) | 1.0e8 | 6e8 |
//!
//! The last line: 58 planes × 76 lines × 1 tile, some 1.4 times as many for the steps beyond the box, times 3,500 run
//! ends of which two thirds lie in a plane of the obstacle; each takes 6 loads, 16 operations to shift and about 20
//! to add, of which a GPU with three-operand logic needs half. An H200 does some 1.4e13 such operations and 7e12 loads
//! from its first-level cache a second, so that by count a section takes 0.05 ms; the obstacle's bits (0.5 MB with
//! their zeros, a tenth of it read) stay in that cache. Differences and sums, three times 3 MB a section, stay in the
//! second level. **None of this has been measured on a hardware GPU yet**: `imf bench exact --device gpu` does.
//!
//! What one invocation does for one section is too little to fill a large GPU (4,408 tiles, 270,000 invocations), so
//! up to 32 orientations go in one submission of three dispatches. A grid whose differences exceed what the adapter
//! binds is counted in slabs along x.

mod batch;
mod bits;

use std::sync::{Mutex, PoisonError};

use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::{Imf, QueryBox, SectionError, SectionPlan, StepSpace, direct_count, share};
use imf_core::tool::RotatedTool;
use imf_core::training::EngineError;
use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, IntoParallelRefIterator, ParallelIterator};
use thiserror::Error;

use self::batch::{Batch, MOST_JOBS, Prepared};
use self::bits::BitLayout;
use crate::device::{Gpu, Reading};
use crate::kernel::{Bound, Kernel, uniform};
use crate::memory::Room;
use crate::shader::Shader;
use crate::submit::Submissions;
use crate::uniforms::Counting;

/// Differences, in elements, of one submission where the adapter binds so much: 128 MiB, 32 sections of the paper's scene.
const DIFFERENCES: usize = 1 << 25;
/// Bytes of counts that wait on the host for one round of orientations.
const HOST_BYTES: usize = 256 << 20;
/// Voxels whose minimum is compared with direct sums.
const WATCHED: usize = 3;

/// Why a section could not be had from a GPU.
#[derive(Debug, Error)]
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
    space: StepSpace,
    layout: BitLayout,
    slabs: Vec<QueryBox>,
    /// Differences of one submission, in elements.
    room: usize,
    differences_kernel: Kernel,
    totals_kernel: Kernel,
    sections_kernel: Kernel,
    least_kernel: Kernel,
    counting: wgpu::Buffer,
    bits: wgpu::Buffer,
    jobs: Room,
    starts: Room,
    ends: Room,
    shares: Room,
    differences: Room,
    sections: Room,
    /// Least values, as bits, and their orientations, for each slab.
    least: Vec<[Room; 2]>,
    submissions: Submissions,
}

/// One orientation, prepared on the host.
struct Turned {
    index: usize,
    rotated: RotatedTool,
    /// One for each slab.
    jobs: Vec<Prepared>,
    /// Overlaps at the watched voxels, by direct sums.
    watched: Vec<u32>,
}

/// Slabs of a query box along x, whose differences along y or z fit `room` elements.
fn slabs(query: &QueryBox, most_steps: [usize; 3], room: usize) -> Result<Vec<QueryBox>, EngineError> {
    let plane = (most_steps[1] * query.dims[2]).max(query.dims[1] * most_steps[2]).max(1);
    let planes = (room / plane).min(query.dims[0]);
    if planes == 0 {
        return Err(EngineError::Device(format!(
            "one plane of this grid has {} MiB of differences, and the adapter binds {}. Take a larger pitch, or count \
             on the CPU (--device cpu)",
            plane >> 18,
            room >> 18
        )));
    }
    let [x, y, z] = query.lower;
    let slab = |from: usize| QueryBox {
        lower: [x + from as i64, y, z],
        dims: [planes.min(query.dims[0] - from), query.dims[1], query.dims[2]],
    };
    Ok((0..query.dims[0]).step_by(planes).map(slab).collect())
}

impl<'a> GpuSections<'a> {
    /// Compiles the kernels and uploads the obstacle.
    ///
    /// # Errors
    /// [`EngineError::Device`] for a scene beyond the adapter's limits, too little memory, a device that failed, or a plan
    /// whose cutter may touch the part ([`SectionPlan::skin`]).
    pub fn new(gpu: &Gpu, plan: &'a SectionPlan) -> Result<Self, EngineError> {
        if plan.skin().is_some() {
            return Err(EngineError::Device(
                "a cutter that may touch the part is counted on the CPU alone: leave out --contact, or --device cpu"
                    .into(),
            ));
        }
        let space = plan.step_space();
        let layout = BitLayout::new(&space)?;
        let limits = gpu.limits();
        let room = (limits.storage_binding.min(limits.buffer) as usize / 4).min(DIFFERENCES);
        let slabs = slabs(&plan.query_box(), space.most_steps, room)?;
        let kernel = |shader| Kernel::new(gpu, shader);
        let mut bits = Room::new("obstacle's bits");
        let bits = bits.upload(gpu, &layout.bits(plan.obstacle()))?;
        Ok(Self {
            differences_kernel: kernel(Shader::CountDifferences)?,
            totals_kernel: kernel(Shader::CountTotals)?,
            sections_kernel: kernel(Shader::CountSections)?,
            least_kernel: kernel(Shader::CountLeast)?,
            counting: uniform(gpu, "counting", &Counting::default())?,
            bits,
            jobs: Room::new("jobs"),
            starts: Room::new("starts of run ends"),
            ends: Room::new("run ends"),
            shares: Room::new("values of counts"),
            differences: Room::new("differences"),
            sections: Room::new("sections"),
            least: slabs
                .iter()
                .map(|_| [Room::new("least values"), Room::new("best orientations")])
                .collect(),
            submissions: Submissions::default(),
            gpu: gpu.clone(),
            plan,
            space,
            layout,
            slabs,
            room,
        })
    }

    /// One line for people: how sections are computed.
    #[must_use]
    pub fn describe(&self) -> String {
        let adapter = self.gpu.adapter();
        format!("run ends on {} ({})", adapter.name, adapter.backend)
    }

    /// Bytes on the host beside the plan's own, about: tools, lists and counts of one round of orientations.
    #[must_use]
    pub fn host_bytes(&self) -> u64 {
        let reach = 2.0 * self.plan.tool().reach() / self.plan.grid().pitch + 3.0;
        let section = 4 * self.plan.query_box().len() as u64;
        let round = self.round(true) as u64;
        let tool = reach.powi(3).min(1e18) as u64;
        4 * self.layout.words() as u64 + round * (2 * section + tool) + MOST_JOBS as u64 * tool
    }

    /// Orientations of one round. Sections that are read back wait on the host for their turn.
    fn round(&self, read_back: bool) -> usize {
        let section = 4 * self.plan.query_box().len();
        if read_back { (HOST_BYTES / section.max(1)).clamp(1, MOST_JOBS) } else { MOST_JOBS }
    }

    /// Turns and voxelises the tool and lists its run ends, for orientations from `first` on.
    fn prepare(
        &self,
        orientations: &[Orientation],
        first: usize,
        watched: &[usize],
    ) -> Result<Vec<Turned>, GpuSectionError> {
        let query = self.plan.query_box();
        let turn = |place: usize| -> Result<Turned, GpuSectionError> {
            let pitch = self.plan.grid().pitch;
            let rotated = RotatedTool::new(self.plan.tool(), &orientations[place], pitch)
                .map_err(SectionError::from)?;
            let jobs = self.slabs.iter().map(|slab| {
                let stepped = self.space.step(&rotated, slab, self.room).ok_or_else(|| {
                    EngineError::Device("a slab does not fit the adapter: please report this".to_owned())
                })?;
                Prepared::new(stepped, &self.layout)
            });
            let jobs = jobs.collect::<Result<_, _>>()?;
            let watched = watched
                .iter()
                .map(|&voxel| direct_count(self.plan.obstacle(), &rotated, query.voxel(voxel)))
                .collect();
            Ok(Turned { index: first + place, rotated, jobs, watched })
        };
        (0..orientations.len()).into_par_iter().map(turn).collect()
    }

    /// As many orientations as go in one submission over a slab, at least one; for sections that are read back, or
    /// for the minimum, which wants the values of all counts.
    fn batch(&self, turned: &[Turned], slab: usize, read_back: bool) -> Batch {
        let voxels = if read_back { self.slabs[slab].len() } else { 0 };
        let mut batch = Batch::default();
        for turn in turned {
            if !batch.takes(&turn.jobs[slab], voxels, self.room) {
                break;
            }
            batch.add(&turn.jobs[slab], turn.index, (!read_back).then_some(turn.rotated.count));
        }
        batch
    }

    /// Uploads a batch and binds the kernels that make overlaps of it; the list ends with `last`.
    fn bind(
        &mut self,
        batch: &Batch,
        slab: &QueryBox,
        last: impl FnOnce(&Self, [&wgpu::Buffer; 3]) -> Bound,
    ) -> Result<[Bound; 3], EngineError> {
        let counting = batch.counting(&self.layout, self.space.obstacle[0], slab);
        let jobs = self.jobs.upload(&self.gpu, &batch.jobs)?;
        let starts = self.starts.upload(&self.gpu, &batch.starts)?;
        let ends = self.ends.upload(&self.gpu, &batch.ends)?;
        let differences = self.differences.fit(&self.gpu, batch.differences)?;
        self.gpu.queue().write_buffer(&self.counting, 0, bytemuck::bytes_of(&counting));
        let (gpu, counting) = (&self.gpu, &self.counting);
        Ok([
            self.differences_kernel.bind(gpu, &[counting, &jobs, &self.bits, &starts, &ends, &differences]),
            self.totals_kernel.bind(gpu, &[counting, &jobs, &differences]),
            last(self, [counting, &jobs, &differences]),
        ])
    }

    /// Submits a batch; the last kernel takes `elements`.
    fn submit(&mut self, batch: &Batch, bound: &[Bound; 3], elements: usize) -> Result<(), EngineError> {
        let workgroups = self.gpu.limits().workgroups;
        self.submissions.pass(&self.gpu, |pass| {
            bound[0].linear(pass, batch.difference_invocations(), workgroups);
            bound[1].linear(pass, batch.total_lines(), workgroups);
            bound[2].linear(pass, elements, workgroups);
        })
    }

    /// Submits one batch whose sections are read back.
    fn read_back(&mut self, batch: &Batch, slab: &QueryBox) -> Result<Reading, EngineError> {
        let elements = batch.jobs.len() * slab.len();
        let sections = self.sections.fit(&self.gpu, elements)?;
        let bound = self.bind(batch, slab, |own, [counting, jobs, differences]| {
            own.sections_kernel.bind(&own.gpu, &[counting, jobs, differences, &sections])
        })?;
        self.submit(batch, &bound, elements)?;
        self.gpu.begin_read(&sections, elements)
    }

    /// Overlaps over the plan's query box for a round of orientations, `[orientation][voxel]`.
    fn counts(
        &mut self,
        turned: &[Turned],
        beside: impl FnOnce(&Self) -> Result<Vec<Turned>, GpuSectionError>,
    ) -> Result<(Vec<Vec<u32>>, Vec<Turned>), GpuSectionError> {
        let query = self.plan.query_box();
        let mut readings = Vec::new();
        for (index, slab) in self.slabs.clone().iter().enumerate() {
            let from = (slab.lower[0] - query.lower[0]) as usize * query.dims[1] * query.dims[2];
            let mut first = 0;
            while first < turned.len() {
                let batch = self.batch(&turned[first..], index, true);
                readings.push((first, from, slab.len(), self.read_back(&batch, slab)?));
                first += batch.jobs.len();
            }
        }
        // While the device is at work.
        let next = beside(self)?;
        let mut counts = vec![vec![0; query.len()]; turned.len()];
        for (first, from, voxels, reading) in readings {
            let values = self.gpu.finish_read::<u32>(reading)?;
            for (target, values) in counts[first..].iter_mut().zip(values.chunks_exact(voxels)) {
                target[from..from + voxels].copy_from_slice(values);
            }
        }
        Ok((counts, next))
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
        let round = self.round(true);
        let mut rounds = orientations.chunks(round).zip((0..).step_by(round));
        let mut turned = match rounds.next() {
            Some((part, first)) => self.prepare(part, first, &[])?,
            None => return Ok(Vec::new()),
        };
        let plan = self.plan;
        let idle: Mutex<Vec<(V, Vec<f32>)>> = Mutex::new(Vec::new());
        let lock = || idle.lock().unwrap_or_else(PoisonError::into_inner);
        while !turned.is_empty() {
            let (counts, next) = self.counts(&turned, |own| match rounds.next() {
                Some((part, first)) => own.prepare(part, first, &[]),
                None => Ok(Vec::new()),
            })?;
            turned.par_iter().zip(counts).try_for_each(|(turn, counts)| {
                if control.is_cancelled() {
                    return Err(SectionError::Cancelled);
                }
                let (mut visitor, mut cmf) =
                    lock().pop().unwrap_or_else(|| (start(), vec![0.0; plan.grid().len()]));
                plan.cmf_of_counts(&orientations[turn.index], &turn.rotated, &counts, &mut cmf)?;
                visit(&mut visitor, turn.index, &cmf);
                lock().push((visitor, cmf));
                (control.progress)(1);
                Ok(())
            })?;
            turned = next;
        }
        Ok(idle.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().map(|(v, _)| v).collect())
    }

    /// Whether [`GpuSections::imf`] keeps the minimum on the device. With sharp points off the tip the sections are read
    /// back, and their trilinear means and the minimum are taken on the host, in f64 as on the CPU.
    #[must_use]
    pub fn keeps_minimum(&self) -> bool {
        self.plan.tip_alone()
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
        self.clear_minimum()?;
        let watched: Vec<usize> = (1..=WATCHED).map(|part| voxels * part / (WATCHED + 1)).collect();
        let mut expected = Imf::new(watched.len());
        for (part, first) in orientations.chunks(MOST_JOBS).zip((0..).step_by(MOST_JOBS)) {
            if control.is_cancelled() {
                return Err(SectionError::Cancelled.into());
            }
            let turned = self.prepare(part, first, &watched)?;
            for turn in &turned {
                let values: Vec<f32> =
                    turn.watched.iter().map(|&count| share(count, turn.rotated.count)).collect();
                expected.lower_to(turn.index, &values);
            }
            self.lower_to(&turned)?;
            (control.progress)(part.len() as u64);
        }
        self.read_minimum(&mut whole)?;
        for (place, &voxel) in watched.iter().enumerate() {
            let (value, best) = (whole.value[voxel], whole.best[voxel]);
            if value != expected.value[place] || best != expected.best[place] {
                return Err(GpuSectionError::Device(EngineError::Device(format!(
                    "{} found the least value {value} for orientation {best} at voxel {:?}, direct sums {} for {}: \
                     please report this, and count on the CPU (--device cpu)",
                    self.gpu.adapter().name,
                    self.plan.grid().voxel(voxel),
                    expected.value[place],
                    expected.best[place]
                ))));
            }
        }
        Ok(whole)
    }

    /// No orientation yet.
    fn clear_minimum(&mut self) -> Result<(), EngineError> {
        for (slab, rooms) in self.slabs.iter().zip(&mut self.least) {
            let none = vec![u32::MAX; slab.len()];
            for room in rooms {
                room.upload(&self.gpu, &none)?;
            }
        }
        Ok(())
    }

    /// Submits a round of orientations whose minimum is kept on the device.
    fn lower_to(&mut self, turned: &[Turned]) -> Result<(), EngineError> {
        for (index, slab) in self.slabs.clone().iter().enumerate() {
            let mut rest = turned;
            while !rest.is_empty() {
                let batch = self.batch(rest, index, false);
                rest = &rest[batch.jobs.len()..];
                let shares = self.shares.upload(&self.gpu, &batch.shares)?;
                let [least, best] = &mut self.least[index];
                let (least, best) = (least.fit(&self.gpu, slab.len())?, best.fit(&self.gpu, slab.len())?);
                let bound = self.bind(&batch, slab, |own, [counting, jobs, differences]| {
                    let buffers = [counting, jobs, differences, &shares, &least, &best];
                    own.least_kernel.bind(&own.gpu, &buffers)
                })?;
                self.submit(&batch, &bound, slab.len())?;
            }
        }
        Ok(())
    }

    fn read_minimum(&mut self, whole: &mut Imf) -> Result<(), EngineError> {
        let mut from = 0;
        for (slab, [least, best]) in self.slabs.iter().zip(&mut self.least) {
            let to = from + slab.len();
            let values = self.gpu.read::<u32>(&least.fit(&self.gpu, slab.len())?, slab.len())?;
            for (value, bits) in whole.value[from..to].iter_mut().zip(values) {
                *value = f32::from_bits(bits);
            }
            let best = self.gpu.read::<u32>(&best.fit(&self.gpu, slab.len())?, slab.len())?;
            whole.best[from..to].copy_from_slice(&best);
            from = to;
        }
        Ok(())
    }

    /// Seconds that the device takes for each of these orientations once they are prepared and uploaded, nothing read
    /// back: the same batch is submitted `times` times, after once that is not counted.
    ///
    /// # Errors
    /// As [`GpuSections::stream`].
    pub fn measure(&mut self, orientations: &[Orientation], times: usize) -> Result<f64, GpuSectionError> {
        let mut seconds = 0.0;
        for (part, first) in orientations.chunks(MOST_JOBS).zip((0..).step_by(MOST_JOBS)) {
            let turned = self.prepare(part, first, &[])?;
            for (index, slab) in self.slabs.clone().iter().enumerate() {
                let mut rest = &turned[..];
                while !rest.is_empty() {
                    let batch = self.batch(rest, index, true);
                    rest = &rest[batch.jobs.len()..];
                    let elements = batch.jobs.len() * slab.len();
                    let sections = self.sections.fit(&self.gpu, elements)?;
                    let bound = self.bind(&batch, slab, |own, [counting, jobs, differences]| {
                        own.sections_kernel.bind(&own.gpu, &[counting, jobs, differences, &sections])
                    })?;
                    self.submit(&batch, &bound, elements)?;
                    self.gpu.wait(None)?;
                    let start = std::time::Instant::now();
                    for _ in 0..times {
                        self.submit(&batch, &bound, elements)?;
                    }
                    self.gpu.wait(None)?;
                    seconds += start.elapsed().as_secs_f64() / times as f64;
                }
            }
        }
        Ok(seconds / orientations.len().max(1) as f64)
    }

    /// Fills what the kernels write on the device with `value`, on which no result may depend: for tests.
    pub fn fill_scratch(&mut self, value: u32) {
        for room in [&self.differences, &self.sections] {
            room.fill(&self.gpu, value);
        }
    }
}
