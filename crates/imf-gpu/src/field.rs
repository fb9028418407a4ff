//! Fields of any family on the GPU: poses in world coordinates to values, gradients and decisions, from slices of the host or
//! from buffers that stay on the device; and whole grids.
//!
//! The twin on the CPU is [`Field`], whose conventions hold here: an invalid pose is NaN and colliding, outside the box
//! of the voxel centres values are those of the nearest point inside. Poses pass through every field alike (`field/passes.rs`), by
//! the kernels of its family (`field/siren.rs`, `field/factored.rs`, `field/harmonic.rs`); whole grids stand in `field/grid.rs`.
//! Buffers for slices of the host are reused from call to call.

mod coefficients;
mod device_types;
mod factored;
mod grid;
mod harmonic;
mod host;
mod network;
mod passes;
mod poses;
mod siren;
mod turns;

pub use device_types::{DeviceGradient, DevicePose, decision_of};

use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread;

use glam::{DQuat, DVec3, Vec3};
use imf_core::control::Control;
use imf_core::field::{
    Best, Decision, EngineError, FieldError, Gradient, GridField, PoseField, check_lengths,
};
use imf_core::grid::Grid;
use imf_core::orientation::Orientation;
use imf_core::pose::Pose;
use imf_core::section::{Imf, Quantity};
use imf_fields::field::{Field, LoadError};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::siren::over_grid;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::device::Gpu;
use crate::over_orientations::Source;
use grid::GridCoefficients;
use passes::{Call, check_size};
use poses::PoseKernels;

/// A network of the paper's kind, or a harmonic or factored field, on one GPU. Threads take turns.
///
/// What poses need is compiled and uploaded at the first call with poses; what whole grids need, the coefficients of
/// all voxels (4 bytes each) for harmonic and factored fields, at the first call for a section or a minimum.
///
/// # Example
/// ```no_run
/// use imf_core::field::{Gradient, PoseField};
/// use imf_core::glam::DVec3;
/// use imf_core::pose::Pose;
/// use imf_gpu::{DeviceChoice, Gpu, GpuField};
///
/// let gpu = Gpu::open(&DeviceChoice::Automatic)?;
/// let field = GpuField::load(&gpu, "field.safetensors")?;
/// let poses = vec![Pose::along(DVec3::new(10.0, 20.0, 30.0), DVec3::Z); 100_000];
/// let mut gradients = vec![Gradient::NAN; poses.len()];
/// field.gradients(&poses, &mut gradients)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct GpuField {
    gpu: Gpu,
    file: FieldFile,
    field: Field,
    /// Whether the tool's roll counts.
    rolls: bool,
    /// Whether minima are not computed on the CPU: of tools with their tip alone.
    minima_on_device: bool,
    over_poses: Mutex<Option<Box<PoseKernels>>>,
    over_grid: Mutex<Option<GridCoefficients>>,
}

impl GpuField {
    /// A field that was read or made already.
    ///
    /// # Errors
    /// Weights that do not fit their network.
    pub fn new(gpu: &Gpu, file: FieldFile) -> Result<Self, LoadError> {
        let rolls = file.basis().is_some_and(|basis| basis.domain() == Domain::Rotations);
        let field = Field::new(file.clone())?.in_f32();
        let record = &field.scene().record;
        let is_tip_alone = record.tool.sharp_point_positions(record.grid.pitch) == [DVec3::ZERO];
        Ok(Self {
            gpu: gpu.clone(),
            file,
            field,
            rolls,
            minima_on_device: is_tip_alone,
            over_poses: Mutex::default(),
            over_grid: Mutex::default(),
        })
    }

    /// Reads a field from a file.
    ///
    /// # Errors
    /// As [`Self::new`]; a missing, foreign, newer, truncated or damaged file, by name.
    pub fn load(gpu: &Gpu, path: impl AsRef<Path>) -> Result<Self, LoadError> {
        Self::new(gpu, FieldFile::read(path.as_ref())?)
    }

    /// The same field on the CPU.
    #[must_use]
    pub fn twin(&self) -> &Field {
        &self.field
    }

    /// Values of `count` poses that lie on the device, into a buffer there: `poses` holds [`DevicePose`]s, `values` gets an
    /// `f32` each, not clipped, NaN for invalid poses. Both are storage buffers of the device that this was made on. Work may
    /// still be under way when this returns; what is submitted to the queue later comes after it.
    ///
    /// # Errors
    /// Buffers too small for `count`, or a device that failed.
    pub fn values_on_device(
        &self,
        poses: &wgpu::Buffer,
        values: &wgpu::Buffer,
        count: usize,
    ) -> Result<(), EngineError> {
        self.with(|kernels| kernels.submit(&Call::new(poses, values, None), count))
    }

    /// As [`Self::values_on_device`], with a [`DeviceGradient`] each as well.
    ///
    /// # Errors
    /// As there.
    pub fn gradients_on_device(
        &self,
        poses: &wgpu::Buffer,
        values: &wgpu::Buffer,
        gradients: &wgpu::Buffer,
        count: usize,
    ) -> Result<(), EngineError> {
        self.with(|kernels| kernels.submit(&Call::new(poses, values, Some(gradients)), count))
    }

    /// As [`Self::values_on_device`], with a decision each as well, a `u32` that [`decision_of`] reads. A value that
    /// is not finite is colliding.
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
        self.with(|kernels| {
            check_size("decisions", decisions, count, size_of::<u32>())?;
            let call = Call::new(poses, values, None);
            kernels.submit(&call, count)?;
            kernels.decide(&call, decisions, count)
        })
    }

    /// The orientation that a minimum is to be taken over; `None` for what is not a rotation.
    fn orientation_of(&self, rotation: DQuat) -> Option<Orientation> {
        let pose = Pose::new(DVec3::ZERO, rotation);
        match self.rolls {
            true => pose.is_valid().then(|| pose.orientation()),
            false => Orientation::from_direction(pose.axis()?),
        }
    }

    /// A panic of another thread leaves nothing half done that the next call reads.
    fn with<T>(
        &self,
        work: impl FnOnce(&mut PoseKernels) -> Result<T, EngineError>,
    ) -> Result<T, EngineError> {
        let mut guard = self.over_poses.lock().unwrap_or_else(PoisonError::into_inner);
        let made = match guard.take() {
            Some(made) => made,
            None => apart(|| PoseKernels::new(&self.gpu, &self.file, &self.field).map(Box::new))?,
        };
        work(guard.insert(made))
    }

    /// As [`Self::with`], for work that shares itself among threads.
    fn with_threads<T: Send, E: From<EngineError> + Send>(
        &self,
        work: impl FnOnce(&mut PoseKernels) -> Result<T, E> + Send,
    ) -> Result<T, E> {
        self.with(|kernels| Ok(apart(|| work(kernels))))?
    }

    /// The same for whole grids of harmonic and factored fields.
    fn with_grid<T: Send, E: From<EngineError> + Send>(
        &self,
        source: Source<'_>,
        work: impl FnOnce(&mut GridCoefficients) -> Result<T, E> + Send,
    ) -> Result<T, E> {
        let mut guard = self.over_grid.lock().unwrap_or_else(PoisonError::into_inner);
        let made = match guard.take() {
            Some(made) => made,
            None => apart(|| GridCoefficients::new(&self.gpu, source))?,
        };
        let made = guard.insert(made);
        apart(|| work(made))
    }

    /// The source of the orientations' weights; `None` for the paper's network.
    fn source(&self) -> Option<Source<'_>> {
        match &self.file {
            FieldFile::Siren(_) => None,
            FieldFile::Harmonic(file) => Some(Source::Harmonic(&file.field)),
            FieldFile::Factored(file) => Some(Source::Factored(&file.field)),
        }
    }

    /// Hands over values that are not clipped, with the places of their poses.
    fn unclipped(&self, poses: &[Pose], mut take: impl FnMut(usize, f32)) -> Result<(), FieldError> {
        for (part, poses) in poses.chunks(GATHERED).enumerate() {
            self.with(|kernels| {
                let buffers = kernels.ask(poses, false)?;
                self.gpu.read_each(&buffers.values, poses.len(), |place, value| {
                    take(part * GATHERED + place, value);
                })
            })?;
        }
        Ok(())
    }
}

/// The change for turns about the world's axes, from those of the tool's axis and about it.
fn turned(pose: &Pose, direction: Vec3, roll: f32) -> Vec3 {
    let axis = pose.axis().map_or(Vec3::NAN, DVec3::as_vec3);
    axis.cross(direction) + roll * axis
}

/// Does work that shares itself among threads, on threads that do nothing else, as many as there are here at the first call.
///
/// A thread of the caller's pool that holds a lock and shares its work waits for the others; while it waits it may be
/// given work that needs the same lock, or the others may all wait for it. No lock is taken on these threads, and the
/// caller waits for them without being given anything.
fn apart<T: Send, E: From<EngineError> + Send>(work: impl FnOnce() -> Result<T, E> + Send) -> Result<T, E> {
    static POOL: OnceLock<Result<ThreadPool, String>> = OnceLock::new();
    let made = || {
        let threads = rayon::current_num_threads();
        ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| error.to_string())
    };
    let pool = POOL.get_or_init(made).as_ref().map_err(|error| EngineError::Device(error.clone()))?;
    thread::scope(|scope| match scope.spawn(|| pool.install(work)).join() {
        Ok(found) => found,
        Err(panic) => std::panic::resume_unwind(panic),
    })
}

/// Poses of the host that go up together.
const GATHERED: usize = 1 << 18;

impl PoseField for GpuField {
    fn quantity(&self) -> Quantity {
        self.field.quantity()
    }

    fn bounds(&self) -> Option<[DVec3; 2]> {
        self.field.bounds()
    }

    fn values(&self, poses: &[Pose], values: &mut [f32]) -> Result<(), FieldError> {
        check_lengths(poses.len(), values.len())?;
        let (quantity, pitch) = (self.field.quantity(), self.field.scene().record.grid.pitch);
        self.unclipped(poses, |place, value| values[place] = quantity.clamp(value, pitch))
    }

    fn gradients(&self, poses: &[Pose], gradients: &mut [Gradient]) -> Result<(), FieldError> {
        check_lengths(poses.len(), gradients.len())?;
        for (poses, gradients) in poses.chunks(GATHERED).zip(gradients.chunks_mut(GATHERED)) {
            self.with(|kernels| {
                let buffers = kernels.ask(poses, true)?;
                let Some(found) = &buffers.gradients else { return Ok(()) };
                self.gpu.read_each(found, poses.len(), |place, found: DeviceGradient| {
                    let direction = Vec3::from_array(found.direction);
                    gradients[place] = Gradient {
                        value: found.value,
                        position: Vec3::from_array(found.position),
                        direction,
                        rotation: turned(&poses[place], direction, found.roll),
                    };
                })
            })?;
        }
        Ok(())
    }

    fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), FieldError> {
        check_lengths(poses.len(), decisions.len())?;
        self.unclipped(poses, |place, value| {
            decisions[place] = self.field.decide(poses[place].position, value);
        })
    }

    /// The minimum is taken on the device for tools whose only sharp point is the tip, on the CPU for others.
    fn best(&self, points: &[DVec3], rotations: &[DQuat], best: &mut [Best]) -> Result<(), FieldError> {
        let orientations: Option<Vec<Orientation>> =
            rotations.iter().map(|&rotation| self.orientation_of(rotation)).collect();
        let orientations = match orientations {
            Some(found) if self.minima_on_device && !found.is_empty() => found,
            // Sharp points, what is not a rotation, and what is refused.
            _ => return self.field.best(points, rotations, best),
        };
        check_lengths(points.len(), best.len())?;
        let grid = &self.field.scene().record.grid;
        let [low, high] = grid.box_of_centres();
        let held: Vec<DVec3> =
            points.iter().map(|point| if point.is_finite() { point.clamp(low, high) } else { low }).collect();
        let found = self.with_threads(|kernels| kernels.minimum(grid, &held, &orientations))?;
        let Imf { value: least, best: chosen } = found;
        let quantity = self.field.quantity();
        for (((point, best), value), orientation) in points.iter().zip(best).zip(least).zip(chosen) {
            *best = if point.is_finite() {
                let decision = self.field.decide(*point, value);
                Best { value: quantity.clamp(value, grid.pitch), orientation, decision }
            } else {
                Best::NONE
            };
        }
        Ok(())
    }
}

impl GridField for GpuField {
    fn grid(&self) -> &Grid {
        self.field.grid()
    }

    fn sections(&self, orientations: &[Orientation], values: &mut [f32]) -> Result<(), FieldError> {
        let voxels = self.grid().len();
        assert_eq!(values.len(), voxels * orientations.len(), "one section for each orientation");
        match self.source() {
            Some(source) => self.with_grid(source, |grid| grid.sections(source, orientations, values))?,
            None => self.with_threads(|kernels| {
                let Some(evaluator) = kernels.evaluator() else { return Ok(()) };
                for (orientation, section) in orientations.iter().zip(values.chunks_exact_mut(voxels.max(1)))
                {
                    over_grid::section(evaluator, self.grid(), orientation.angles(), section)?;
                }
                Ok::<_, FieldError>(())
            })?,
        }
        Ok(())
    }

    fn minimum(&self, orientations: &[Orientation], control: Control<'_>) -> Result<Imf, FieldError> {
        if orientations.is_empty() {
            return Err(FieldError::Orientations(0));
        }
        let Some(source) = self.source() else {
            let directions: Vec<[f32; 2]> = orientations.iter().map(Orientation::angles).collect();
            return self.with_threads(|kernels| match kernels.evaluator() {
                Some(evaluator) => over_grid::minimum(evaluator, self.grid(), &directions, control),
                None => Err(FieldError::Orientations(0)),
            });
        };
        self.with_grid(source, |grid| grid.minimum(source, orientations, control))
    }
}
