//! What a field works with for queries of poses: its passes, minima over orientations at points, decisions, and buffers for slices
//! of the host.

use std::sync::Arc;

use glam::{DQuat, DVec3};
use imf_core::field::EngineError;
use imf_core::grid::Grid;
use imf_core::orientation::Orientation;
use imf_core::pose::Pose;
use imf_core::section::Imf;
use imf_fields::calibration::Calibration;
use imf_fields::factored::Axis;
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::siren::EvaluationEngine;

use super::coefficients::PointCoefficients;
use super::host::HostBuffers;
use super::passes::{Call, Frame, Passes};
use super::{factored, harmonic, siren};
use crate::device::Gpu;
use crate::evaluator::GpuEvaluator;
use crate::kernel::{Extent, Kernel, uniform};
use crate::over_orientations::{CoefficientRows, OverOrientations, Source};
use crate::shader::Shader;
use crate::uniforms::{Batch, Sweep, Thresholds};

/// The kernels and their buffers.
pub(super) struct PoseKernels {
    frame: Frame,
    passes: Passes,
    minima: Minima,
    host: HostBuffers,
    decisions: Kernel,
    thresholds: wgpu::Buffer,
    /// The poses that are decided at once.
    decided: wgpu::Buffer,
}

/// How minima over orientations at points are taken.
enum Minima {
    /// Of a network of the paper's kind.
    Siren(GpuEvaluator),
    Factored(Box<PointCoefficients>, OverOrientations),
    /// With where the passes put the coefficients of poses.
    Harmonic(Arc<HarmonicFile>, CoefficientRows, wgpu::Buffer, OverOrientations),
}

impl PoseKernels {
    pub(super) fn new(gpu: &Gpu, file: &FieldFile, field: &Field) -> Result<Self, EngineError> {
        let frame = Frame::new(gpu, &field.scene().record.grid)?;
        let (passes, minima) = match file {
            FieldFile::Siren(model) => {
                let evaluator = GpuEvaluator::new(gpu, model.shape, &model.state.parameters)?;
                (siren::passes(&frame, model)?, Minima::Siren(evaluator))
            }
            FieldFile::Factored(file) => {
                let points = Box::new(PointCoefficients::new(gpu, &file.field.unfolded())?);
                let over = OverOrientations::new(gpu, points.rows.clone())?;
                (factored::passes(&frame, &file.field)?, Minima::Factored(points, over))
            }
            FieldFile::Harmonic(file) => {
                let (passes, rows, coefficients) = harmonic::passes(&frame, &file.field)?;
                let over = OverOrientations::new(gpu, rows.clone())?;
                (passes, Minima::Harmonic(file.clone(), rows, coefficients, over))
            }
        };
        let threshold = |found: fn(&Calibration) -> Option<f32>, none: f32| {
            field.calibration().and_then(found).unwrap_or(none)
        };
        let mut thresholds = Thresholds {
            free_up_to: threshold(|calibration| calibration.free_up_to, f32::MIN),
            colliding_from: threshold(|calibration| calibration.colliding_from, f32::MAX),
            around: -1.0,
            ..Thresholds::default()
        };
        if let Some((Axis { along, through }, around)) = field.undecided_around() {
            let crossed = [1, 2].map(|next| through[(along + next) % 3] as f32);
            thresholds.along = along as u32;
            [thresholds.first, thresholds.second] = crossed;
            thresholds.around = around as f32;
        }
        Ok(Self {
            frame,
            passes,
            minima,
            host: HostBuffers::new(),
            decisions: Kernel::new(gpu, Shader::PoseDecisions)?,
            thresholds: uniform(gpu, "thresholds", &thresholds)?,
            decided: uniform(gpu, "decided", &Batch::default())?,
        })
    }

    /// Submits the poses of a buffer in parts.
    pub(super) fn submit(&self, call: &Call, count: usize) -> Result<(), EngineError> {
        self.passes.submit(&self.frame, call, count)
    }

    /// Uploads poses and submits them; returns the buffers of their values and gradients.
    pub(super) fn ask(&mut self, poses: &[Pose], with_gradients: bool) -> Result<Call, EngineError> {
        let call = self.host.upload(&self.frame.gpu, poses, with_gradients)?;
        self.submit(&call, poses.len())?;
        Ok(call)
    }

    /// Submits what is decided of a call's poses by its values, which were computed before.
    pub(super) fn decide(
        &self,
        Call { poses, values, .. }: &Call,
        decisions: &wgpu::Buffer,
        count: usize,
    ) -> Result<(), EngineError> {
        let Frame { gpu, world, .. } = &self.frame;
        let batch = Batch::of_rows(count, 1);
        gpu.write(&self.decided, &[batch]);
        let buffers = [&self.decided, world, &self.thresholds, poses, values, decisions];
        gpu.run([&self.decisions.bind(Extent::Rows(1), &buffers)], batch)
    }

    /// The minimum over orientations at points of the box, not clipped.
    pub(super) fn minimum(
        &mut self,
        grid: &Grid,
        points: &[DVec3],
        orientations: &[Orientation],
    ) -> Result<Imf, EngineError> {
        let Self { frame, passes, host, minima, .. } = self;
        match minima {
            Minima::Factored(network, over) => {
                let field = network.field.clone();
                let source = Source::Factored(&field);
                over.minimum(points.len(), orientations, source, |part, _| network.of_points(&points[part]))
            }
            Minima::Harmonic(file, rows, coefficients, over) => {
                let gpu = &frame.gpu;
                gpu.write(&frame.sweep, &[Sweep::default()]);
                let source = Source::Harmonic(&file.field);
                over.minimum(points.len(), orientations, source, |part, _| {
                    let at = |point: &DVec3| Pose::new(*point, DQuat::IDENTITY);
                    let poses: Vec<Pose> = points[part].iter().map(at).collect();
                    let uploaded = host.upload(gpu, &poses, false)?;
                    let points = passes.points.bind(&uploaded);
                    rows.hold(gpu, poses.len());
                    gpu.run([&points], gpu.batch_of(poses.len()))?;
                    Ok(coefficients.clone())
                })
            }
            Minima::Siren(evaluator) => {
                let unit = |&point: &DVec3| grid.unit(point).as_vec3().to_array();
                let units: Vec<[f32; 3]> = points.iter().map(unit).collect();
                let angles: Vec<[f32; 2]> = orientations.iter().map(Orientation::angles).collect();
                let mut found = Imf::new(units.len());
                evaluator.minimum(&units, &angles, &mut found.value, &mut found.best)?;
                Ok(found)
            }
        }
    }

    /// The evaluator of a network of the paper's kind.
    pub(super) fn evaluator(&mut self) -> Option<&mut GpuEvaluator> {
        match &mut self.minima {
            Minima::Siren(evaluator) => Some(evaluator),
            _ => None,
        }
    }
}
