//! One obstacle and the tool that must stay out of it, on the device: overlaps counted for batches of orientations.

use imf_core::field::EngineError;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::Orientation;
use imf_core::section::device::{DifferenceLimits, SectionLayer};
use imf_core::section::{Imf, QueryBox, SectionError, direct_count};
use imf_core::tool::{Tool, ToolError, ToolVoxels};
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::GpuSectionError;
use super::batch::{Batch, MOST_JOBS, SlabJob};
use super::bits::BitLayout;
use crate::device::Gpu;
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::memory::Room;
use crate::shader::Shader;
use crate::transfer::Reading;
use crate::uniforms;

/// Differences, in elements, of one submission where the adapter can bind them: 128 MiB, 32 sections of the paper's
/// scene.
const DIFFERENCES: usize = 1 << 25;

/// An obstacle on one GPU, and buffers for the overlaps of its tool.
pub(super) struct Layer<'a> {
    gpu: Gpu,
    obstacle: &'a Occupancy,
    tool: &'a Tool,
    /// Whether the tool may be so thin that it holds no voxel centre in some orientations.
    may_be_thin: bool,
    query: QueryBox,
    space: DifferenceLimits,
    layout: BitLayout,
    slabs: Vec<QueryBox>,
    /// Differences of one submission, in elements.
    room: usize,
    differences_kernel: Kernel,
    totals_kernel: Kernel,
    sections_kernel: Kernel,
    minimum_kernel: Kernel,
    counting: wgpu::Buffer,
    bits: wgpu::Buffer,
    jobs: Room,
    starts: Room,
    ends: Room,
    shares: Room,
    differences: Room,
    sections: Room,
    /// Minima, as bits, and their orientations, for each slab.
    least: Vec<[Room; 2]>,
}

/// One orientation, prepared on the host.
pub(super) struct OrientedTool {
    pub(super) index: usize,
    /// `None` where a tool that may be thin holds no voxel centre: it overlaps nothing.
    pub(super) rotated: Option<ToolVoxels>,
    /// One for each slab.
    jobs: Vec<SlabJob>,
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
             on the CPU",
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
            minimum_kernel: kernel(Shader::CountMinimum)?,
            counting: uniform(gpu, "counting", &uniforms::Counting::default())?,
            bits,
            jobs: Room::new("jobs"),
            starts: Room::new("starts of run-length differences"),
            ends: Room::new("run-length differences"),
            shares: Room::new("values of counts"),
            differences: Room::new("differences"),
            sections: Room::new("sections"),
            least: slabs.iter().map(|_| [Room::new("minima"), Room::new("best orientations")]).collect(),
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

    /// Approximate bytes on the host: the obstacle's bits and the tools and lists of a round of `round` orientations.
    pub(super) fn host_bytes(&self, round: u64) -> u64 {
        let reach = 2.0 * self.tool.reach() / self.grid().pitch + 3.0;
        let tool = reach.powi(3).min(1e18) as u64;
        4 * self.layout.words as u64 + (round + MOST_JOBS as u64) * tool
    }

    /// Turns and voxelises the tool and lists its run-length differences, for orientations from `first` on.
    pub(super) fn prepare(
        &self,
        orientations: &[Orientation],
        first: usize,
        watched: &[usize],
    ) -> Result<Vec<OrientedTool>, GpuSectionError> {
        let turn = |place: usize| -> Result<OrientedTool, GpuSectionError> {
            let index = first + place;
            let rotated = match ToolVoxels::new(self.tool, &orientations[place], self.grid().pitch) {
                Err(ToolError::TooSmall { .. }) if self.may_be_thin => {
                    let watched = vec![0; watched.len()];
                    return Ok(OrientedTool { index, rotated: None, jobs: Vec::new(), watched });
                }
                other => other.map_err(SectionError::from)?,
            };
            let jobs = self.slabs.iter().map(|slab| {
                let stepped = self.space.step(&rotated, slab, self.room).ok_or_else(|| {
                    EngineError::Device("a slab does not fit the adapter: please report this".to_owned())
                })?;
                SlabJob::new(stepped, &self.layout)
            });
            let jobs = jobs.collect::<Result<_, _>>()?;
            let watched = watched
                .iter()
                .map(|&voxel| direct_count(self.obstacle, &rotated, self.query.voxel(voxel)))
                .collect();
            Ok(OrientedTool { index, rotated: Some(rotated), jobs, watched })
        };
        (0..orientations.len()).into_par_iter().map(turn).collect()
    }

    /// As many orientations as go in one submission over a slab, at least one, and those that are left; for sections that are read
    /// back, or for the minimum, which wants the values of all counts. None once only tools are left that hold no voxel centre.
    fn batch<'t>(
        &self,
        turned: &'t [OrientedTool],
        slab: usize,
        read_back: bool,
    ) -> Option<(Batch, &'t [OrientedTool])> {
        let first = turned.iter().position(|turn| turn.rotated.is_some())?;
        let voxels = if read_back { self.slabs[slab].len() } else { 0 };
        let mut batch = Batch::default();
        let mut rest = &turned[first..];
        while let Some((turn, others)) = rest.split_first() {
            let Some((job, rotated)) = turn.jobs.get(slab).zip(turn.rotated.as_ref()) else { break };
            if !batch.takes(job, voxels, self.room) {
                break;
            }
            batch.add(job, turn.index, (!read_back).then_some(rotated.count));
            rest = others;
        }
        Some((batch, rest))
    }

    /// Uploads a batch and binds the kernels that make overlaps of it; the list ends with `last`, which takes `elements`.
    fn bind(
        &mut self,
        batch: &Batch,
        slab: usize,
        last: Shader,
        elements: usize,
        others: &[&wgpu::Buffer],
    ) -> Result<[Dispatch; 3], EngineError> {
        let counting = batch.counting(&self.layout, self.space.obstacle[0], &self.slabs[slab]);
        let jobs = self.jobs.upload(&self.gpu, &batch.jobs)?;
        let starts = self.starts.upload(&self.gpu, &batch.starts)?;
        let ends = self.ends.upload(&self.gpu, &batch.ends)?;
        let differences = self.differences.fit(&self.gpu, batch.differences)?;
        self.gpu.write(&self.counting, &[counting]);
        let (counting, invocations) = (&self.counting, batch.difference_invocations());
        let last = if last == Shader::CountMinimum { &self.minimum_kernel } else { &self.sections_kernel };
        Ok([
            self.differences_kernel.bind(
                Extent::Elements(invocations),
                &[counting, &jobs, &self.bits, &starts, &ends, &differences],
            ),
            self.totals_kernel.bind(Extent::Elements(batch.total_lines()), &[counting, &jobs, &differences]),
            last.bind(Extent::Elements(elements), &[&[counting, &jobs, &differences], others].concat()),
        ])
    }

    /// Binds a batch whose sections are read back, with where they go and how many values they have.
    fn bind_sections(
        &mut self,
        batch: &Batch,
        slab: usize,
    ) -> Result<([Dispatch; 3], wgpu::Buffer, usize), EngineError> {
        let elements = batch.jobs.len() * self.slabs[slab].len();
        let sections = self.sections.fit(&self.gpu, elements)?;
        let bound = self.bind(batch, slab, Shader::CountSections, elements, &[&sections])?;
        Ok((bound, sections, elements))
    }

    fn submit(&self, bound: &[Dispatch; 3]) -> Result<(), EngineError> {
        self.gpu.run(bound, uniforms::Batch::default())
    }

    /// Submits a round of orientations; [`Layer::finish`] reads their overlaps.
    pub(super) fn begin(&mut self, turned: &[OrientedTool]) -> Result<Vec<BatchReading>, EngineError> {
        let (mut begun, mut from) = (Vec::new(), 0);
        for slab in 0..self.slabs.len() {
            let voxels = self.slabs[slab].len();
            let mut left = turned;
            while let Some((batch, rest)) = self.batch(left, slab, true) {
                left = rest;
                let (bound, sections, elements) = self.bind_sections(&batch, slab)?;
                self.submit(&bound)?;
                let first = turned.len() - rest.len() - batch.jobs.len();
                let reading = self.gpu.begin_read(&sections, elements)?;
                begun.push(BatchReading { first, from, voxels, reading });
            }
            from += voxels;
        }
        Ok(begun)
    }

    /// Overlaps over the query box for the `orientations` of a round, `[orientation][voxel]`.
    pub(super) fn finish(
        &self,
        begun: Vec<BatchReading>,
        orientations: usize,
    ) -> Result<Vec<Vec<u32>>, EngineError> {
        let mut counts = vec![vec![0; self.query.len()]; orientations];
        for BatchReading { first, from, voxels, reading } in begun {
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

    /// Submits a round of orientations whose minimum stays on the device.
    pub(super) fn lower_to(&mut self, turned: &[OrientedTool]) -> Result<(), EngineError> {
        for slab in 0..self.slabs.len() {
            let (voxels, mut left) = (self.slabs[slab].len(), turned);
            while let Some((batch, rest)) = self.batch(left, slab, false) {
                left = rest;
                let shares = self.shares.upload(&self.gpu, &batch.shares)?;
                let [least, best] = &mut self.least[slab];
                let (least, best) = (least.fit(&self.gpu, voxels)?, best.fit(&self.gpu, voxels)?);
                let bound =
                    self.bind(&batch, slab, Shader::CountMinimum, voxels, &[&shares, &least, &best])?;
                self.submit(&bound)?;
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
            for slab in 0..self.slabs.len() {
                let mut left = &turned[..];
                while let Some((batch, rest)) = self.batch(left, slab, true) {
                    left = rest;
                    let (bound, ..) = self.bind_sections(&batch, slab)?;
                    self.submit(&bound)?;
                    self.gpu.wait(None)?;
                    let start = std::time::Instant::now();
                    for _ in 0..times {
                        self.submit(&bound)?;
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
pub(super) struct BatchReading {
    first: usize,
    from: usize,
    /// Voxels of each orientation.
    voxels: usize,
    reading: Reading,
}
