//! One obstacle and the tool that must stay out of it, on the device: overlaps counted for batches of orientations.

use imf_core::field::EngineError;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::Orientation;
use imf_core::section::{Imf, QueryBox, SectionError, SectionLayer, StepSpace, direct_count};
use imf_core::tool::{RotatedTool, Tool, ToolError};
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::GpuSectionError;
use super::batch::{Batch, MOST_JOBS, Prepared};
use super::bits::BitLayout;
use crate::device::{Gpu, Reading};
use crate::kernel::{Bound, Kernel, uniform};
use crate::memory::Room;
use crate::shader::Shader;
use crate::submit::Submissions;
use crate::uniforms::Counting;

/// Differences, in elements, of one submission where the adapter binds so much: 128 MiB, 32 sections of the paper's scene.
const DIFFERENCES: usize = 1 << 25;

/// An obstacle on one GPU, and buffers for the overlaps of its tool.
pub(super) struct Layer<'a> {
    gpu: Gpu,
    obstacle: &'a Occupancy,
    tool: &'a Tool,
    /// Whether the tool may be so thin that it holds no voxel centre in some orientations.
    may_be_thin: bool,
    query: QueryBox,
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
pub(super) struct Turned {
    pub(super) index: usize,
    /// `None` where a tool that may be thin holds no voxel centre: it overlaps nothing.
    pub(super) rotated: Option<RotatedTool>,
    /// One for each slab.
    jobs: Vec<Prepared>,
    /// Overlaps at the watched voxels, by direct sums.
    pub(super) watched: Vec<u32>,
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

impl<'a> Layer<'a> {
    /// Compiles the kernels and uploads the obstacle.
    ///
    /// # Errors
    /// [`EngineError::Device`] for a scene beyond the adapter's limits, too little memory, or a device that failed.
    pub(super) fn new(
        gpu: &Gpu,
        layer: SectionLayer<'a>,
        query: QueryBox,
        may_be_thin: bool,
    ) -> Result<Self, EngineError> {
        let SectionLayer { obstacle, tool, space } = layer;
        let layout = BitLayout::new(&space)?;
        let limits = gpu.limits();
        let room = limits.elements().min(DIFFERENCES);
        let slabs = slabs(&query, space.most_steps, room)?;
        let kernel = |shader| Kernel::new(gpu, shader);
        let mut bits = Room::new("obstacle's bits");
        let bits = bits.upload(gpu, &layout.bits(obstacle))?;
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
            obstacle,
            tool,
            may_be_thin,
            query,
            space,
            layout,
            slabs,
            room,
        })
    }

    fn grid(&self) -> &Grid {
        &self.obstacle.grid
    }

    /// Bytes on the host, about: the obstacle's bits and the tools and lists of a round of so many orientations.
    pub(super) fn host_bytes(&self, round: u64) -> u64 {
        let reach = 2.0 * self.tool.reach() / self.grid().pitch + 3.0;
        let tool = reach.powi(3).min(1e18) as u64;
        4 * self.layout.words() as u64 + (round + MOST_JOBS as u64) * tool
    }

    /// Turns and voxelises the tool and lists its run ends, for orientations from `first` on.
    pub(super) fn prepare(
        &self,
        orientations: &[Orientation],
        first: usize,
        watched: &[usize],
    ) -> Result<Vec<Turned>, GpuSectionError> {
        let turn = |place: usize| -> Result<Turned, GpuSectionError> {
            let index = first + place;
            let rotated = match RotatedTool::new(self.tool, &orientations[place], self.grid().pitch) {
                Err(ToolError::TooSmall { .. }) if self.may_be_thin => {
                    return Ok(Turned {
                        index,
                        rotated: None,
                        jobs: Vec::new(),
                        watched: vec![0; watched.len()],
                    });
                }
                other => other.map_err(SectionError::from)?,
            };
            let jobs = self.slabs.iter().map(|slab| {
                let stepped = self.space.step(&rotated, slab, self.room).ok_or_else(|| {
                    EngineError::Device("a slab does not fit the adapter: please report this".to_owned())
                })?;
                Prepared::new(stepped, &self.layout)
            });
            let jobs = jobs.collect::<Result<_, _>>()?;
            let watched = watched
                .iter()
                .map(|&voxel| direct_count(self.obstacle, &rotated, self.query.voxel(voxel)))
                .collect();
            Ok(Turned { index, rotated: Some(rotated), jobs, watched })
        };
        (0..orientations.len()).into_par_iter().map(turn).collect()
    }

    /// As many orientations as go in one submission over a slab, at least one; for sections that are read back, or
    /// for the minimum, which wants the values of all counts.
    fn batch(&self, turned: &[Turned], slab: usize, read_back: bool) -> Batch {
        let voxels = if read_back { self.slabs[slab].len() } else { 0 };
        let mut batch = Batch::default();
        for turn in turned {
            // Nothing to do for a tool that holds no voxel centre.
            let Some((job, rotated)) = turn.jobs.get(slab).zip(turn.rotated.as_ref()) else { break };
            if !batch.takes(job, voxels, self.room) {
                break;
            }
            batch.add(job, turn.index, (!read_back).then_some(rotated.count));
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

    /// Submits a round of orientations; [`Layer::finish`] reads their overlaps.
    pub(super) fn begin(&mut self, turned: &[Turned]) -> Result<Vec<Begun>, EngineError> {
        let mut begun = Vec::new();
        for (index, slab) in self.slabs.clone().iter().enumerate() {
            let from =
                (slab.lower[0] - self.query.lower[0]) as usize * self.query.dims[1] * self.query.dims[2];
            let mut first = 0;
            while first < turned.len() {
                if turned[first].rotated.is_none() {
                    first += 1;
                    continue;
                }
                let batch = self.batch(&turned[first..], index, true);
                begun.push(Begun { first, from, voxels: slab.len(), reading: self.read_back(&batch, slab)? });
                first += batch.jobs.len();
            }
        }
        Ok(begun)
    }

    /// Overlaps over the query box for the `orientations` of a round, `[orientation][voxel]`.
    pub(super) fn finish(
        &self,
        begun: Vec<Begun>,
        orientations: usize,
    ) -> Result<Vec<Vec<u32>>, EngineError> {
        let mut counts = vec![vec![0; self.query.len()]; orientations];
        for Begun { first, from, voxels, reading } in begun {
            let values = self.gpu.finish_read::<u32>(reading)?;
            for (target, values) in counts[first..].iter_mut().zip(values.chunks_exact(voxels)) {
                target[from..from + voxels].copy_from_slice(values);
            }
        }
        Ok(counts)
    }

    /// Begins a minimum: no orientation yet.
    pub(super) fn clear_minimum(&mut self) -> Result<(), EngineError> {
        for (slab, rooms) in self.slabs.iter().zip(&mut self.least) {
            let none = vec![u32::MAX; slab.len()];
            for room in rooms {
                room.upload(&self.gpu, &none)?;
            }
        }
        Ok(())
    }

    /// Submits a round of orientations whose minimum is kept on the device.
    pub(super) fn lower_to(&mut self, turned: &[Turned]) -> Result<(), EngineError> {
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

    pub(super) fn read_minimum(&mut self, whole: &mut Imf) -> Result<(), EngineError> {
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

    /// Seconds of the device for all these orientations; see [`super::GpuSections::measure`].
    pub(super) fn measure(
        &mut self,
        orientations: &[Orientation],
        times: usize,
    ) -> Result<f64, GpuSectionError> {
        let mut seconds = 0.0;
        for (part, first) in orientations.chunks(MOST_JOBS).zip((0..).step_by(MOST_JOBS)) {
            let turned = self.prepare(part, first, &[])?;
            for (index, slab) in self.slabs.clone().iter().enumerate() {
                let mut rest = &turned[..];
                while let Some(turn) = rest.first() {
                    if turn.rotated.is_none() {
                        rest = &rest[1..];
                        continue;
                    }
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
        Ok(seconds)
    }

    /// Fills what the kernels write on the device with `value`.
    pub(super) fn fill_scratch(&mut self, value: u32) {
        for room in [&self.differences, &self.sections] {
            room.fill(&self.gpu, value);
        }
    }
}

/// A batch that is being read back: orientations of the round from `first` on, voxels of the query box from `from` on.
pub(super) struct Begun {
    first: usize,
    from: usize,
    /// Voxels of each orientation.
    voxels: usize,
    reading: Reading,
}
