//! What planners ask, answered on the GPU by fields of any family: poses in world coordinates to values, gradients and
//! decisions, from slices of the host or from buffers that stay on the device.
//!
//! The twin on the CPU is [`NeuralField`], whose conventions hold here: what is no pose is NaN and blocked, outside the box
//! of the voxel centres values are those of the nearest point inside. How poses pass through a family's field stands in
//! `planner/siren.rs`, `planner/factored.rs` and `planner/harmonic.rs`. Buffers for slices of the host are kept from call to call.

mod answers;
mod factored;
mod harmonic;
mod host;
mod network;
mod siren;
mod turns;

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Quat, Vec3};
use imf_core::field::EngineError;
use imf_core::orientation::Orientation;
use imf_core::planner::{Best, Decision, Gradient, PlannerError, Pose, PoseField, check_lengths};
use imf_core::section::Imf;
use imf_fields::calibration::Calibration;
use imf_fields::harmonic::basis::Domain;
use imf_fields::learnt::{LoadError, NeuralField};
use imf_fields::siren::EvaluationEngine;
use imf_fields::stored::StoredField;

use crate::device::Gpu;
use crate::kernel::{Kernel, uniform};
use crate::shader::{BLOCKED, FREE, Shader};
use crate::submit::Submissions;
use crate::uniforms::{Batch, Sweep, Thresholds};
use factored::FactoredPasses;
use harmonic::HarmonicPasses;
use host::HostBuffers;
use network::{Frame, Passes};
use siren::SirenPasses;

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
    /// Change for a turn of the tool about its axis by a radian; 0 for tools of revolution.
    pub roll: f32,
}

/// A decision as the device writes it, [`crate::shader::FREE`], [`crate::shader::BLOCKED`] or [`crate::shader::NEAR`]; any other
/// number is near.
#[must_use]
pub fn decision_of(code: u32) -> Decision {
    match code {
        FREE => Decision::Free,
        BLOCKED => Decision::Blocked,
        _ => Decision::Near,
    }
}

/// A network of the paper's kind, or a harmonic or factored field, on one GPU. Threads take turns.
///
/// # Example
/// ```no_run
/// use glam::Vec3;
/// use imf_core::planner::{Gradient, Pose, PoseField};
/// use imf_gpu::{DeviceChoice, Gpu, GpuField};
///
/// let gpu = Gpu::open(&DeviceChoice::Automatic)?;
/// let field = GpuField::load(&gpu, "field.safetensors")?;
/// let poses = vec![Pose::along(Vec3::new(10.0, 20.0, 30.0), Vec3::Z); 100_000];
/// let mut gradients = vec![Gradient::NAN; poses.len()];
/// field.query_with_gradient(&poses, &mut gradients)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct GpuField {
    neural: NeuralField,
    /// Whether the tool's roll counts.
    rolls: bool,
    /// Whether minima are not asked of the CPU: of tools with their tip alone.
    minima_on_device: bool,
    work: Mutex<Work>,
}

/// What calls work with.
struct Work {
    frame: Frame,
    family: Family,
    host: HostBuffers,
    decisions: Kernel,
    thresholds: wgpu::Buffer,
    /// The poses that are decided at once.
    decided: wgpu::Buffer,
    submissions: Submissions,
}

/// How poses pass through a field.
enum Family {
    Siren(Box<SirenPasses>),
    Factored(Box<FactoredPasses>),
    Harmonic(Box<HarmonicPasses>),
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
    /// Weights that do not fit their network, or an adapter that cannot hold them, nor a harmonic field's coefficients in f32.
    pub fn new(gpu: &Gpu, stored: StoredField) -> Result<Self, LoadError> {
        let rolls = stored.basis().is_some_and(|basis| basis.domain() == Domain::Rotations);
        let family = match &stored {
            StoredField::Siren(model) => Family::Siren(Box::new(SirenPasses::new(gpu, model)?)),
            StoredField::Factored(file) => Family::Factored(Box::new(FactoredPasses::new(gpu, &file.field)?)),
            StoredField::Harmonic(file) => Family::Harmonic(Box::new(HarmonicPasses::new(gpu, &file.field)?)),
        };
        let neural = NeuralField::new(stored)?;
        let record = &neural.scene().record;
        let is_tip_alone = record.tool.sharp_point_positions(record.grid.pitch) == [DVec3::ZERO];
        let work = Work::new(gpu, family, &neural)?;
        Ok(Self { neural, rolls, minima_on_device: is_tip_alone, work: Mutex::new(work) })
    }

    /// Reads a field from a file.
    ///
    /// # Errors
    /// As [`Self::new`]; a missing, foreign, newer, truncated or damaged file, by name.
    pub fn load(gpu: &Gpu, path: impl AsRef<Path>) -> Result<Self, LoadError> {
        Self::new(gpu, StoredField::read(path.as_ref())?)
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

    /// As [`Self::query_on_device`], with a [`DeviceGradient`] each as well.
    ///
    /// # Errors
    /// As there.
    pub fn query_with_gradient_on_device(
        &self,
        poses: &wgpu::Buffer,
        values: &wgpu::Buffer,
        gradients: &wgpu::Buffer,
        count: usize,
    ) -> Result<(), EngineError> {
        self.with(|work| work.ask(Asked { poses, values, gradients: Some(gradients) }, count))
    }

    /// As [`Self::query_on_device`], with a decision each as well, a `u32` that [`decision_of`] reads. A value that is not finite is
    /// blocked.
    ///
    /// # Errors
    /// As there.
    pub fn classify_on_device(
        &self,
        poses: &wgpu::Buffer,
        values: &wgpu::Buffer,
        decisions: &wgpu::Buffer,
        count: usize,
    ) -> Result<(), EngineError> {
        self.with(|work| {
            check_size("decisions", decisions, count, size_of::<u32>())?;
            work.ask(Asked { poses, values, gradients: None }, count)?;
            work.decide(poses, values, decisions, count)
        })
    }

    /// The orientation that a minimum is to be taken over; `None` for what is no rotation.
    fn asked_orientation(&self, rotation: Quat) -> Option<Orientation> {
        let pose = Pose::new(Vec3::ZERO, rotation);
        match self.rolls {
            true => pose.is_pose().then(|| pose.orientation()),
            false => Orientation::from_direction(pose.axis().as_dvec3()),
        }
    }

    /// A panic of another thread leaves nothing half done that the next call reads.
    fn with<T>(&self, work: impl FnOnce(&mut Work) -> T) -> T {
        work(&mut self.work.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Hands over values that are not clipped, with the places of their poses.
    fn unclipped(&self, poses: &[Pose], mut take: impl FnMut(usize, f32)) -> Result<(), PlannerError> {
        self.with(|work| {
            for (part, poses) in poses.chunks(GATHERED).enumerate() {
                let buffers = work.host.upload(&work.frame.gpu, poses, false)?;
                work.ask(buffers.asked(), poses.len())?;
                work.host.read(&work.frame.gpu, &buffers.values, poses.len(), |place, value| {
                    take(part * GATHERED + place, value);
                })?;
            }
            Ok::<_, EngineError>(())
        })?;
        Ok(())
    }
}

/// The change for turns about the world's axes, from those of the tool's axis and about it.
fn turned(pose: &Pose, direction: Vec3, roll: f32) -> Vec3 {
    let axis = pose.axis();
    axis.cross(direction) + roll * axis
}

/// Poses of the host that go up together.
const GATHERED: usize = 1 << 18;

impl PoseField for GpuField {
    fn query(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), PlannerError> {
        check_lengths(poses.len(), values.len())?;
        let quantity = self.neural.quantity();
        self.unclipped(poses, |place, value| values[place] = quantity.held(value))
    }

    fn query_with_gradient(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), PlannerError> {
        check_lengths(poses.len(), gradients.len())?;
        self.with(|work| {
            for (poses, gradients) in poses.chunks(GATHERED).zip(gradients.chunks_mut(GATHERED)) {
                let buffers = work.host.upload(&work.frame.gpu, poses, true)?;
                work.ask(buffers.asked(), poses.len())?;
                let Some(found) = &buffers.gradients else { continue };
                work.host.read(&work.frame.gpu, found, poses.len(), |place, found: DeviceGradient| {
                    let direction = Vec3::from_array(found.direction);
                    gradients[place] = Gradient {
                        value: found.value,
                        position: Vec3::from_array(found.position),
                        direction,
                        rotation: turned(&poses[place], direction, found.roll),
                    };
                })?;
            }
            Ok::<_, EngineError>(())
        })?;
        Ok(())
    }

    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), PlannerError> {
        check_lengths(poses.len(), decisions.len())?;
        self.unclipped(poses, |place, value| {
            decisions[place] = self.neural.decide(poses[place].position, value);
        })
    }

    /// The minimum is taken on the device for tools whose only sharp point is the tip; others are asked of the CPU.
    fn imf(&self, points: &[Vec3], orientations: &[Quat], best: &mut [Best]) -> Result<(), PlannerError> {
        let asked: Option<Vec<Orientation>> =
            orientations.iter().map(|&rotation| self.asked_orientation(rotation)).collect();
        let asked = match asked {
            Some(asked) if self.minima_on_device && !asked.is_empty() => asked,
            // Sharp points, what is no rotation, and what is refused.
            _ => return self.neural.imf(points, orientations, best),
        };
        check_lengths(points.len(), best.len())?;
        let grid = &self.neural.scene().record.grid;
        let [low, high] = grid.box_of_centres();
        let held: Vec<DVec3> = points
            .iter()
            .map(|point| if point.is_finite() { point.as_dvec3().clamp(low, high) } else { low })
            .collect();
        let Imf { value: least, best: chosen } = self.with(|work| {
            let Work { frame, family, host, .. } = work;
            match family {
                Family::Siren(passes) => {
                    let units: Vec<[f32; 3]> =
                        held.iter().map(|&point| grid.unit(point).as_vec3().to_array()).collect();
                    let angles: Vec<[f32; 2]> = asked.iter().map(Orientation::angles).collect();
                    let mut found = Imf::new(units.len());
                    passes.evaluator.minimum(&units, &angles, &mut found.value, &mut found.best)?;
                    Ok(found)
                }
                Family::Factored(passes) => passes.minimum.minimum_unclipped(&held, &asked),
                Family::Harmonic(passes) => passes.minimum(frame, host, &held, &asked),
            }
        })?;
        let quantity = self.neural.quantity();
        for (((point, best), value), orientation) in points.iter().zip(best).zip(least).zip(chosen) {
            *best = if point.is_finite() {
                let decision = self.neural.decide(*point, value);
                Best { value: quantity.held(value), orientation, decision }
            } else {
                Best::NONE
            };
        }
        Ok(())
    }
}

impl Work {
    fn new(gpu: &Gpu, family: Family, neural: &NeuralField) -> Result<Self, EngineError> {
        let threshold = |found: fn(&Calibration) -> Option<f32>, none: f32| {
            neural.calibration().and_then(found).unwrap_or(none)
        };
        let thresholds = Thresholds {
            free_up_to: threshold(|calibration| calibration.free_up_to, f32::MIN),
            blocked_from: threshold(|calibration| calibration.blocked_from, f32::MAX),
        };
        Ok(Self {
            frame: Frame::new(gpu, &neural.scene().record.grid)?,
            family,
            host: HostBuffers::new(),
            decisions: Kernel::new(gpu, Shader::PoseDecisions)?,
            thresholds: uniform(gpu, "thresholds", &thresholds)?,
            decided: uniform(gpu, "decided", &Batch::default())?,
            submissions: Submissions::default(),
        })
    }

    /// Submits the poses of a buffer in parts.
    fn ask(&mut self, asked: Asked<'_>, count: usize) -> Result<(), EngineError> {
        check_size("poses", asked.poses, count, size_of::<DevicePose>())?;
        check_size("values", asked.values, count, size_of::<f32>())?;
        if let Some(gradients) = asked.gradients {
            check_size("gradients", gradients, count, size_of::<DeviceGradient>())?;
        }
        let Self { frame, family, submissions, .. } = self;
        match family {
            Family::Siren(passes) => in_parts(frame, &**passes, submissions, asked, count),
            Family::Harmonic(passes) => in_parts(frame, &**passes, submissions, asked, count),
            Family::Factored(passes) => in_parts(frame, &**passes, submissions, asked, count),
        }
    }

    /// Submits what is decided of poses by values that were asked before.
    fn decide(
        &mut self,
        poses: &wgpu::Buffer,
        values: &wgpu::Buffer,
        decisions: &wgpu::Buffer,
        count: usize,
    ) -> Result<(), EngineError> {
        let gpu = &self.frame.gpu;
        let block = Batch { rows: count as u32, ..Batch::default() };
        gpu.queue().write_buffer(&self.decided, 0, bytemuck::bytes_of(&block));
        let buffers = [&self.decided, &self.frame.world, &self.thresholds, poses, values, decisions];
        let bound = self.decisions.bind(gpu, &buffers);
        let workgroups = gpu.limits().workgroups;
        self.submissions.pass(gpu, |pass| bound.linear(pass, count, workgroups))
    }
}

/// Submits `count` poses, as many at a time as there is room for.
fn in_parts<P: Passes>(
    frame: &Frame,
    passes: &P,
    submissions: &mut Submissions,
    asked: Asked<'_>,
    count: usize,
) -> Result<(), EngineError> {
    let (call, extent) = (passes.bind(frame, asked), passes.extent());
    let gpu = &frame.gpu;
    for base in (0..count).step_by(extent.rows) {
        let rows = extent.rows.min(count - base);
        let padded_rows = rows.next_multiple_of(extent.padding);
        let block = Batch { rows: rows as u32, padded_rows: padded_rows as u32, ..Batch::default() };
        let part = Sweep { base: base as u32, ..Sweep::default() };
        gpu.queue().write_buffer(extent.batch, 0, bytemuck::bytes_of(&block));
        gpu.queue().write_buffer(&frame.sweep, 0, bytemuck::bytes_of(&part));
        let limit = gpu.limits().workgroups;
        submissions.pass(gpu, |pass| passes.record(&call, pass, rows, padded_rows, limit))?;
    }
    Ok(())
}

/// Refuses a buffer that is too small for `count` elements of `each` bytes.
fn check_size(name: &str, buffer: &wgpu::Buffer, count: usize, each: usize) -> Result<(), EngineError> {
    let size = buffer.size();
    if size / (each as u64) < count as u64 {
        return Err(EngineError::Shape(format!("a buffer of {size} bytes for {count} {name}")));
    }
    Ok(())
}
