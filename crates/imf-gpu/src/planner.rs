//! What planners ask, answered on the GPU for the paper's network: poses in world coordinates to values, gradients and
//! decisions, from slices of the host or from buffers that stay on the device.
//!
//! ```text
//! poses → inputs → forward (keeps slopes) → values, y·(1 − y) → backward → gradients by position and direction
//! ```
//!
//! The twin on the CPU is [`NeuralField`], whose conventions hold here: what is no pose is NaN and blocked, outside the box
//! of the voxel centres values are those of the nearest point inside.

use std::sync::{Mutex, PoisonError};

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Quat, Vec3};
use imf_core::model::Model;
use imf_core::orientation::Orientation;
use imf_core::planner::{Best, Decision, Gradient, LoadError, NeuralField, PlannerError, Pose, PoseField};
use imf_core::stored::StoredField;
use imf_core::training::{EngineError, EvaluationEngine};

use crate::device::Gpu;
use crate::evaluator::GpuEvaluator;
use crate::forward::{Forward, Network, layout_for, rows_per_pass};
use crate::kernel::{Bound, Kernel, uniform};
use crate::memory::Plan;
use crate::shader::{Factors, Shader};
use crate::submit::Submissions;
use crate::uniforms::{Batch, Descent, Sweep, World};

/// Poses that pass through the network together, at most.
const ROWS: usize = 1 << 13;

/// A pose as the device reads it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct DevicePose {
    /// World position of the tip; the last number is idle.
    pub position: [f32; 4],
    /// Quaternion x, y, z, w from the tool's frame into the world, of any length but 0.
    pub rotation: [f32; 4],
}

impl From<Pose> for DevicePose {
    fn from(pose: Pose) -> Self {
        Self { position: pose.position.extend(0.0).to_array(), rotation: pose.rotation.to_array() }
    }
}

/// A value and its derivatives as the device writes them.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct DeviceGradient {
    /// The overlap, not clipped.
    pub value: f32,
    /// Change for a move of the tip by one unit of length.
    pub position: [f32; 3],
    /// Change for a turn of the tool's axis by a radian: tangent to the sphere at the axis.
    pub direction: [f32; 3],
    /// 0.
    pub idle: f32,
}

/// A network of the paper's kind on one GPU. Threads take turns.
pub struct GpuField {
    neural: NeuralField,
    /// Sharp points other than the tip, for which minima are asked pose by pose on the CPU.
    is_tip_alone: bool,
    work: Mutex<Work>,
}

/// What one call works with.
struct Work {
    gpu: Gpu,
    network: Network,
    rows: usize,
    inputs: Vec<Option<Bound>>,
    forward: Forward,
    backward: Vec<Bound>,
    kernels: Kernels,
    world: wgpu::Buffer,
    descent: wgpu::Buffer,
    sweep: wgpu::Buffer,
    samples: wgpu::Buffer,
    sums: wgpu::Buffer,
    deltas: Vec<wgpu::Buffer>,
    /// Where the layer behind the skip is, if there is one.
    skipped: Option<usize>,
    evaluator: GpuEvaluator,
    submissions: Submissions,
}

/// Kernels that are bound to the buffers of a call.
struct Kernels {
    inputs: Kernel,
    values: Kernel,
    gradient: Kernel,
}

/// Buffers of a call.
#[derive(Clone, Copy)]
struct Asked<'a> {
    poses: &'a wgpu::Buffer,
    values: &'a wgpu::Buffer,
    gradients: Option<&'a wgpu::Buffer>,
}

impl GpuField {
    /// Compiles the kernels, allocates the buffers and uploads the weights.
    ///
    /// # Errors
    /// Weights that do not fit their network, or an adapter that cannot hold it.
    pub fn new(gpu: &Gpu, model: Model) -> Result<Self, LoadError> {
        let work = Work::new(gpu, &model)?;
        let tool = &model.scene.record.tool;
        let is_tip_alone = tool.sharp_point_positions(model.scene.record.grid.pitch) == [DVec3::ZERO];
        let neural = NeuralField::new(StoredField::Siren(Box::new(model)))?;
        Ok(Self { neural, is_tip_alone, work: Mutex::new(work) })
    }

    /// The same field on the CPU.
    #[must_use]
    pub fn twin(&self) -> &NeuralField {
        &self.neural
    }

    /// Values of `count` poses that lie on the device, into a buffer there: `poses` holds [`DevicePose`]s, `values` gets an
    /// `f32` each, not clipped, NaN for what is no pose. Both are storage buffers of the device that this was made on. Work may
    /// still be under way when this returns; what is submitted to the queue later comes after it.
    ///
    /// # Errors
    /// Buffers too small for `count`, or a device that failed.
    pub fn query_on_device(
        &self,
        poses: &wgpu::Buffer,
        values: &wgpu::Buffer,
        count: usize,
    ) -> Result<(), EngineError> {
        self.with(|work| work.ask(Asked { poses, values, gradients: None }, count))
    }

    /// As [`Self::query_on_device`], with a [`DeviceGradient`] each into `gradients`.
    ///
    /// # Errors
    /// As [`Self::query_on_device`].
    pub fn query_with_gradient_on_device(
        &self,
        poses: &wgpu::Buffer,
        values: &wgpu::Buffer,
        gradients: &wgpu::Buffer,
        count: usize,
    ) -> Result<(), EngineError> {
        self.with(|work| work.ask(Asked { poses, values, gradients: Some(gradients) }, count))
    }

    /// A panic of another thread leaves nothing half done that the next call reads.
    fn with<T>(&self, work: impl FnOnce(&mut Work) -> T) -> T {
        work(&mut self.work.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Values that are not clipped to [0, 1].
    fn unclipped(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), PlannerError> {
        if poses.len() != values.len() {
            return Err(PlannerError::Length { asked: poses.len(), answers: values.len() });
        }
        let found: Vec<f32> = self.with(|work| {
            let mut all = Vec::with_capacity(poses.len());
            for poses in poses.chunks(GATHERED) {
                let (asked, results) = work.upload(poses, size_of::<f32>())?;
                work.ask(Asked { poses: &asked, values: &results, gradients: None }, poses.len())?;
                all.extend(work.gpu.read::<f32>(&results, poses.len())?);
            }
            Ok::<_, EngineError>(all)
        })?;
        values.copy_from_slice(&found);
        Ok(())
    }
}

/// Poses of the host that go up together.
const GATHERED: usize = 1 << 18;

impl PoseField for GpuField {
    fn query(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), PlannerError> {
        self.unclipped(poses, values)?;
        values.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        Ok(())
    }

    fn query_with_gradient(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), PlannerError> {
        if poses.len() != gradients.len() {
            return Err(PlannerError::Length { asked: poses.len(), answers: gradients.len() });
        }
        self.with(|work| {
            for (poses, gradients) in poses.chunks(GATHERED).zip(gradients.chunks_mut(GATHERED)) {
                let (asked, values) = work.upload(poses, size_of::<f32>())?;
                let results = work.buffer("gradients", poses.len() * size_of::<DeviceGradient>())?;
                let all = Asked { poses: &asked, values: &values, gradients: Some(&results) };
                work.ask(all, poses.len())?;
                let found = work.gpu.read::<DeviceGradient>(&results, poses.len())?;
                for ((pose, found), out) in poses.iter().zip(found).zip(gradients) {
                    let direction = Vec3::from_array(found.direction);
                    *out = Gradient {
                        value: found.value,
                        position: Vec3::from_array(found.position),
                        direction,
                        rotation: pose.axis().cross(direction),
                    };
                }
            }
            Ok::<_, EngineError>(())
        })?;
        Ok(())
    }

    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), PlannerError> {
        if poses.len() != decisions.len() {
            return Err(PlannerError::Length { asked: poses.len(), answers: decisions.len() });
        }
        let mut values = vec![0.0; poses.len()];
        self.unclipped(poses, &mut values)?;
        for ((pose, value), decision) in poses.iter().zip(values).zip(decisions) {
            *decision = self.neural.decide(pose.position, value);
        }
        Ok(())
    }

    /// The minimum is taken on the device for tools whose only sharp point is the tip; others are asked of the CPU.
    fn imf(&self, points: &[Vec3], orientations: &[Quat], best: &mut [Best]) -> Result<(), PlannerError> {
        let directions: Option<Vec<[f32; 2]>> = orientations
            .iter()
            .map(|&rotation| {
                let axis = Pose::new(Vec3::ZERO, rotation).axis().as_dvec3();
                let Orientation { theta, phi, .. } = Orientation::from_direction(axis)?;
                Some([theta as f32, phi as f32])
            })
            .collect();
        let directions = match directions {
            Some(directions) if self.is_tip_alone && !directions.is_empty() => directions,
            // Sharp points, what is no rotation, and what is refused.
            _ => return self.neural.imf(points, orientations, best),
        };
        if points.len() != best.len() {
            return Err(PlannerError::Length { asked: points.len(), answers: best.len() });
        }
        let grid = &self.neural.scene().record.grid;
        let (low, high) = (grid.centre([0; 3]), grid.centre(grid.dims.map(|n| n - 1)));
        let units: Vec<[f32; 3]> = points
            .iter()
            .map(|point| {
                let held = if point.is_finite() { point.as_dvec3().clamp(low, high) } else { low };
                grid.unit(held).as_vec3().to_array()
            })
            .collect();
        let (mut least, mut chosen) = (vec![0.0; points.len()], vec![0; points.len()]);
        self.with(|work| work.evaluator.minimum(&units, &directions, &mut least, &mut chosen))?;
        for (((point, best), value), orientation) in points.iter().zip(best).zip(least).zip(chosen) {
            *best = if point.is_finite() {
                Best {
                    value: value.clamp(0.0, 1.0),
                    orientation,
                    decision: self.neural.decide(*point, value),
                }
            } else {
                Best::NONE
            };
        }
        Ok(())
    }
}

impl Work {
    fn new(gpu: &Gpu, model: &Model) -> Result<Self, EngineError> {
        let stack = model.shape.stack();
        let layout = layout_for(gpu, stack)?;
        stack
            .check_parameters(&model.state.parameters)
            .map_err(|error| EngineError::Shape(error.to_string()))?;
        let rows = rows_per_pass(&layout, gpu.limits(), ROWS);
        let mut plan = Plan::default();
        let parameters = plan.add("parameters", layout.parameters);
        let samples = plan.add("samples", rows * stack.inputs);
        let sums = plan.add("results", rows * layout.layers.last().map_or(0, |layer| layer.outputs));
        let signals: Vec<usize> =
            layout.layers.iter().map(|layer| plan.add("signal", rows * layer.inputs)).collect();
        let deltas: Vec<usize> =
            layout.layers.iter().map(|layer| plan.add("delta", rows * layer.outputs)).collect();
        let buffers = plan.allocate(gpu)?;
        let at = |place: usize| buffers[place].clone();
        let all = |places: &[usize]| places.iter().map(|&place| at(place)).collect::<Vec<_>>();
        let (samples, sums, signals, deltas) = (at(samples), at(sums), all(&signals), all(&deltas));
        let network = Network::new(gpu, layout, at(parameters), &model.state.parameters)?;
        let layers = &network.layout.layers;
        let skipped = (1..layers.len()).find(|&layer| layers[layer].input_block.is_some());
        let behind = skipped.map(|layer| (layers[layer], layers[layer].input_block.unwrap_or(0)));
        let descent = Descent {
            first_weights: layers[0].weights as u32,
            first_stride: layers[0].inputs as u32,
            neurons: layers[0].outputs as u32,
            skip_weights: behind.map_or(0, |(layer, block)| layer.weights + block) as u32,
            skip_stride: behind.map_or(0, |(layer, _)| layer.inputs) as u32,
            skip_neurons: behind.map_or(0, |(layer, _)| layer.outputs) as u32,
        };
        let grid = &model.scene.record.grid;
        let four = |v: DVec3| v.as_vec3().extend(0.0).to_array();
        let world = World {
            low: four(grid.centre([0; 3])),
            high: four(grid.centre(grid.dims.map(|n| n - 1))),
            origin: four(grid.origin),
            size: four(grid.size()),
        };
        let backward = Kernel::new(gpu, Shader::Backward)?;
        let backward = (1..layers.len())
            .map(|l| {
                let buffers =
                    [&network.batch, &network.layers[l], &network.parameters, &deltas[l], &deltas[l - 1]];
                backward.bind(gpu, &buffers)
            })
            .collect();
        Ok(Self {
            inputs: network.bind_inputs(gpu, &Kernel::new(gpu, Shader::Inputs)?, &[&samples], &signals)?,
            forward: Forward::new(gpu, &network, &signals, &sums, Some(&deltas), Factors::Single)?,
            backward,
            kernels: Kernels {
                inputs: Kernel::new(gpu, Shader::PoseInputs)?,
                values: Kernel::new(gpu, Shader::PoseValues)?,
                gradient: Kernel::new(gpu, Shader::PoseGradient)?,
            },
            world: uniform(gpu, "world", &world)?,
            descent: uniform(gpu, "descent", &descent)?,
            sweep: uniform(gpu, "sweep", &Sweep::default())?,
            evaluator: GpuEvaluator::new(gpu, model.shape, &model.state.parameters)?,
            gpu: gpu.clone(),
            network,
            rows,
            samples,
            sums,
            deltas,
            skipped,
            submissions: Submissions::default(),
        })
    }

    /// A storage buffer of so many bytes.
    fn buffer(&self, name: &str, bytes: usize) -> Result<wgpu::Buffer, EngineError> {
        let mut plan = Plan::default();
        plan.add(name, bytes.div_ceil(4));
        Ok(plan.allocate(&self.gpu)?.remove(0))
    }

    /// Poses on the device, and room for `bytes` of answers to each.
    fn upload(&self, poses: &[Pose], bytes: usize) -> Result<(wgpu::Buffer, wgpu::Buffer), EngineError> {
        let all: Vec<DevicePose> = poses.iter().map(|&pose| pose.into()).collect();
        let asked = self.buffer("poses", size_of_val(&all[..]))?;
        self.gpu.queue().write_buffer(&asked, 0, bytemuck::cast_slice(&all));
        Ok((asked, self.buffer("values", poses.len() * bytes)?))
    }

    /// Submits the poses of a buffer in parts.
    fn ask(&mut self, asked: Asked<'_>, count: usize) -> Result<(), EngineError> {
        let sizes = [
            ("poses", asked.poses.size(), size_of::<DevicePose>()),
            ("values", asked.values.size(), size_of::<f32>()),
            ("gradients", asked.gradients.map_or(u64::MAX, wgpu::Buffer::size), size_of::<DeviceGradient>()),
        ];
        for (name, size, each) in sizes {
            if (size / each as u64) < count as u64 {
                return Err(EngineError::Shape(format!("a buffer of {size} bytes for {count} {name}")));
            }
        }
        let (gpu, batch, sweep) = (&self.gpu, &self.network.batch, &self.sweep);
        let Asked { poses, values, gradients } = asked;
        let last = self.network.layers.len() - 1;
        let inputs = self.kernels.inputs.bind(gpu, &[batch, &self.world, sweep, poses, &self.samples]);
        let seeds = [batch, &self.network.layers[last], sweep, poses, &self.sums, &self.deltas[last], values];
        let seeds = self.kernels.values.bind(gpu, &seeds);
        let skipped = &self.deltas[self.skipped.unwrap_or(0)];
        let gradient = gradients.map(|gradients| {
            let parameters = &self.network.parameters;
            let first = [batch, &self.world, sweep, &self.descent, parameters, &self.deltas[0], skipped];
            let buffers = [&first[..], &[poses, values, gradients]].concat();
            self.kernels.gradient.bind(gpu, &buffers)
        });
        for base in (0..count).step_by(self.rows) {
            let rows = self.rows.min(count - base);
            let padded_rows = rows.next_multiple_of(self.network.layout.padding);
            let block = Batch { rows: rows as u32, padded_rows: padded_rows as u32, ..Batch::default() };
            let part = Sweep { base: base as u32, ..Sweep::default() };
            self.gpu.queue().write_buffer(&self.network.batch, 0, bytemuck::bytes_of(&block));
            self.gpu.queue().write_buffer(&self.sweep, 0, bytemuck::bytes_of(&part));
            let workgroups = self.gpu.limits().workgroups;
            let layers = &self.network.layout.layers;
            let (forward, bound, backward) = (&self.forward, &self.inputs, &self.backward);
            self.submissions.pass(&self.gpu, |pass| {
                inputs.linear(pass, rows, workgroups);
                forward.record(pass, bound, padded_rows, workgroups);
                seeds.linear(pass, padded_rows, workgroups);
                if let Some(gradient) = &gradient {
                    for (below, backward) in backward.iter().enumerate().rev() {
                        backward.product(pass, padded_rows, layers[below].outputs, 1);
                    }
                    gradient.linear(pass, rows, workgroups);
                }
            })?;
        }
        Ok(())
    }
}
