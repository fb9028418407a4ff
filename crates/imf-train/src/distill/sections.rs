//! Training by exact sections themselves, without a harmonic field: none is held in memory, whatever the grid.
//!
//! A pool holds the latest sections at random orientations without end ([`crate::training::online`]); a step takes P voxels
//! at all Q orientations of the pool. Let H be the field's functions there, `[Q][components]`, s a voxel's exact values less the
//! mean's, z what the network says now. The coefficients to expect of both are
//!
//! ```text
//! t = z + Hᵀ (H Hᵀ + λ I)⁻¹ (s − H z)
//! ```
//! (a Gaussian around z, conditioned on s: Kalman's step), and towards these the network takes a step of least squares.
//! What the pool does not see of a voxel stays as the network has it. The functions are learnt too: a sample of voxels
//! chooses the axes, and the last layer, folded at the end, what the hidden layers mean along them.

use std::ops::Range;

use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;

use super::target::steps_before;
use super::voxels::Voxels;
use crate::training::TrainingEngine;
use crate::training::online::with_arrivals;
use crate::training::run::{Observer, Outcome, Report, Start, TrainError, train_by};
use imf_core::control::Control;
use imf_core::field::EngineError;
use imf_core::grid::Grid;
use imf_core::orientation::Orientation;
use imf_core::section::{Quantity, SectionPlan};
use imf_fields::factored::targets::ComponentBasis;
use imf_fields::factored::{DistillSettings, FactoredEvaluator, FactoredField, FactoredShape, INPUTS};
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::{FitReport, FitSettings, HarmonicError, Outline, Source, SourceScratch, outline};
use imf_fields::recipe::{Cursor, OnlineSettings, RecipeError, TrainingState};
use imf_fields::siren::ShapeError;
use imf_fields::siren::matrix::{Matrix, multiply};

/// Ridge parameter relative to the mean diagonal of H Hᵀ. Near convergence the truncated basis functions contribute
/// about as much variance as remains to be learnt per component.
const RIDGE: f64 = 0.03;
/// Rows of a batch whose targets one thread makes at a time.
const ROWS: usize = 64;

/// The sections of a scene, with the functions that a field trained by them is made of.
pub struct SectionSource<'a> {
    plan: &'a SectionPlan,
    quantity: Quantity,
    outline: Outline,
}

impl<'a> SectionSource<'a> {
    /// Chooses functions, mean and scale by a sample of voxels. One unit of progress is a section.
    ///
    /// # Errors
    /// As [`imf_fields::harmonic::fit`].
    pub fn new(
        plan: &'a SectionPlan,
        domain: Domain,
        fit: &FitSettings,
        control: Control<'_>,
    ) -> Result<Self, HarmonicError> {
        Ok(Self { plan, quantity: fit.quantity, outline: outline(plan, domain, fit, control)? })
    }

    /// Axes of the field: outputs of its network.
    #[must_use]
    pub fn component_count(&self) -> usize {
        self.outline.components.len() / self.outline.mean.len()
    }

    /// What the sample says of the functions' errors.
    #[must_use]
    pub fn report(&self) -> FitReport {
        self.outline.report
    }

    /// What its functions depend on beside the point.
    #[must_use]
    pub fn domain(&self) -> Domain {
        self.outline.basis.domain()
    }

    /// Memory in bytes of a training with `components` components of `functions` basis functions on `voxels` voxels: the
    /// pool and the sections being computed (2 bytes a value), the gain matrices, and one batch.
    #[must_use]
    pub fn memory_bytes(
        functions: usize,
        components: usize,
        voxels: usize,
        settings: &DistillSettings,
    ) -> u64 {
        let OnlineSettings { pool, lead, .. } = settings.online.unwrap_or_default();
        let sections = 2 * (pool + lead + 2) * voxels + 8 * voxels;
        // The Gram matrix and its factor, H and the solution in f64, both and the functions in f32.
        let gain = pool * (16 * pool + 24 * components + 4 * functions);
        let batch = settings.plan.batch.min(voxels) * (8 * pool + 4 * components);
        (sections + gain + batch) as u64
    }

    /// The field of a network's weights.
    ///
    /// # Errors
    /// Weights that do not fit, or a shape of other axes.
    pub fn field(&self, shape: FactoredShape, parameters: Vec<f32>) -> Result<FactoredField, ShapeError> {
        let Outline { basis, components, mean, scale, .. } = &self.outline;
        let grid = self.plan.grid();
        let (components, mean) = (components.into(), mean.into());
        ComponentBasis { quantity: self.quantity, grid, basis, components, mean, scale: *scale }
            .field(shape, parameters)
    }

    fn orientation(&self, online: &OnlineSettings, number: u64) -> Orientation {
        match self.outline.basis.domain() {
            Domain::Directions => online.orientation(number),
            Domain::Rotations => online.rotation(number),
        }
    }

    /// The grid whose voxels a training sees.
    pub(super) fn grid(&self) -> &Grid {
        self.plan.grid()
    }

    /// As [`Target::train`](super::Target::train): sections come as [`DistillSettings::online`] says, or as its default.
    pub(super) fn train(
        &self,
        settings: &DistillSettings,
        engine: &mut dyn TrainingEngine,
        start: Start,
        stop: &dyn Fn() -> bool,
        observer: &mut Observer<'_>,
    ) -> Result<Outcome, TrainError> {
        if !settings.symmetry.is_none() {
            return Err(RecipeError(ShapeError::Symmetry.to_string()).into());
        }
        let online = settings.online.unwrap_or_default();
        let grid = *self.plan.grid();
        let plan = &settings.plan;
        let first = steps_before(settings, grid.len(), start.cursor);
        let last = plan.total_steps(grid.len()).saturating_sub(1);
        let source = Source::new(self.plan, self.quantity)?;
        let field = self.field(settings.shape(self.component_count()), engine.weights()?);
        let field = field.map_err(EngineError::from)?;
        // A loss in units of the field; what watches the training sees it over the scale.
        let squared = f64::from(field.scale).powi(2);
        let mut corrected = SectionEngine::new(engine, self, online, field, first);
        let mut scratch = SourceScratch::default();
        let make = |number| {
            let mut kept = vec![0; grid.len()];
            source.kept(&self.orientation(&online, number), &mut scratch, &mut kept)?;
            Ok(kept)
        };
        let (low, unit) = source.steps();
        let mut order = Voxels::new(plan, &grid, settings.symmetry, start.cursor);
        with_arrivals(online, [first, last], make, stop, |arrivals| {
            let mut feed =
                |at: Cursor, step: u64, rows: Range<usize>, inputs: &mut [f32], targets: &mut [f32]| {
                    let pool = arrivals.at(step)?;
                    order.fill(at, &rows, inputs, targets, |_, voxel, targets| {
                        for (target, section) in targets.iter_mut().zip(pool.iter().flatten()) {
                            *target = low + f32::from(section[voxel]) * unit;
                        }
                    });
                    Ok(())
                };
            let mut observe = |report: &Report, engine: &mut dyn TrainingEngine| {
                observer(&Report { mean_loss: report.mean_loss * squared, ..*report }, engine)
            };
            train_by(plan, grid.len(), &mut feed, &mut |_, _| Ok(()), &mut corrected, start, &mut observe)
        })
    }
}

/// What a pool's orientations make of a batch.
struct Gain {
    /// Number of the pool's newest section.
    newest: u64,
    /// H: `[slot][components]`.
    functions: Vec<f32>,
    /// The mean's values there, `[slot]`.
    mean: Vec<f32>,
    /// `(H Hᵀ + λ I)⁻¹ H`, `[slot][components]`.
    weights: Vec<f32>,
}

impl Gain {
    fn new(source: &SectionSource<'_>, online: &OnlineSettings, step: u64) -> Result<Self, EngineError> {
        let Outline { basis, components, mean, .. } = &source.outline;
        let set: Vec<Orientation> =
            online.slots(step).map(|number| source.orientation(online, number)).collect();
        let (count, width, pool) = (basis.len(), source.component_count(), online.pool);
        let rows = basis.values_at(&set);
        let rows = Matrix::row_major(&rows, pool, count, count);
        let (mut functions, mut at_mean) = (vec![0.0; pool * width], vec![0.0; pool]);
        multiply(&mut functions, width, rows, Matrix::row_major(components, count, width, width), false);
        multiply(&mut at_mean, 1, rows, Matrix::row_major(mean, count, 1, 1), false);
        let matrix = DMatrix::from_row_iterator(pool, width, functions.iter().map(|&v| f64::from(v)));
        let mut gram = &matrix * matrix.transpose();
        let ridge = RIDGE * gram.trace() / pool as f64;
        (0..pool).for_each(|slot| gram[(slot, slot)] += ridge);
        // With a ridge it is positive definite, unless a number is not finite.
        let solved = Cholesky::new(gram)
            .ok_or_else(|| EngineError::Shape("the functions of the sections are not finite".into()))?
            .solve(&matrix);
        let weights = solved.transpose().iter().map(|&v| v as f32).collect();
        Ok(Self { newest: online.newest(step), functions, mean: at_mean, weights })
    }
}

/// An engine whose targets are values at the pool's orientations: its own engine gets the coefficients that follow.
pub(super) struct SectionEngine<'a> {
    engine: &'a mut dyn TrainingEngine,
    source: &'a SectionSource<'a>,
    online: OnlineSettings,
    /// Of the engine's weights at the last step, laid out once.
    evaluator: FactoredEvaluator<'static>,
    /// Steps of the plan done.
    done: u64,
    gain: Option<Gain>,
    /// `[row][components]` of a batch.
    targets: Vec<f32>,
    /// Sum of the steps' mean squared errors, and how many.
    squares: f64,
    steps: u64,
}

impl<'a> SectionEngine<'a> {
    /// Goes on after `done` steps.
    pub(super) fn new(
        engine: &'a mut dyn TrainingEngine,
        source: &'a SectionSource<'a>,
        online: OnlineSettings,
        field: FactoredField,
        done: u64,
    ) -> Self {
        let (gain, targets) = (None, Vec::new());
        let evaluator = field.into_evaluator();
        Self { engine, source, online, evaluator, done, gain, targets, squares: 0.0, steps: 0 }
    }
}

impl TrainingEngine for SectionEngine<'_> {
    fn describe(&self) -> String {
        self.engine.describe()
    }

    fn inputs(&self) -> usize {
        self.engine.inputs()
    }

    fn outputs(&self) -> usize {
        self.online.pool
    }

    fn step(&mut self, inputs: &[f32], values: &[f32], learning_rate: f32) -> Result<(), EngineError> {
        let gain = match self.gain.take() {
            Some(gain) if gain.newest == self.online.newest(self.done) => gain,
            _ => Gain::new(self.source, &self.online, self.done)?,
        };
        self.evaluator.set_parameters(self.engine.weights()?);
        let (evaluator, pool) = (&self.evaluator, self.online.pool);
        let (components, scale) = (evaluator.field().shape.components, evaluator.field().scale);
        self.targets.resize(inputs.len() / INPUTS * components, 0.0);
        let parts = self.targets.par_chunks_mut(ROWS * components).zip(inputs.par_chunks(ROWS * INPUTS));
        let squares: Vec<f64> = parts
            .zip(values.par_chunks(ROWS * pool))
            .map_init(Vec::new, |rest, ((targets, inputs), values)| {
                let rows = values.len() / pool;
                evaluator.outputs(inputs, targets);
                // (s − μ − H z) over the scale.
                rest.clear();
                rest.extend(
                    values
                        .chunks_exact(pool)
                        .flat_map(|row| row.iter().zip(&gain.mean).map(|(v, m)| (m - v) / scale)),
                );
                let along = Matrix::row_major(&gain.functions, pool, components, components).transposed();
                multiply(rest, pool, Matrix::row_major(targets, rows, components, components), along, true);
                rest.iter_mut().for_each(|v| *v = -*v);
                let weights = Matrix::row_major(&gain.weights, pool, components, components);
                multiply(targets, components, Matrix::row_major(rest, rows, pool, pool), weights, true);
                rest.iter().map(|&v| f64::from(v) * f64::from(v)).sum()
            })
            .collect();
        self.engine.step(inputs, &self.targets, learning_rate)?;
        self.gain = Some(gain);
        self.squares += squares.iter().sum::<f64>() / values.len() as f64;
        (self.done, self.steps) = (self.done + 1, self.steps + 1);
        Ok(())
    }

    fn take_mean_loss(&mut self) -> Result<f64, EngineError> {
        self.engine.take_mean_loss()?;
        let mean = if self.steps == 0 { 0.0 } else { self.squares / self.steps as f64 };
        (self.squares, self.steps) = (0.0, 0);
        Ok(mean)
    }

    fn state(&mut self) -> Result<TrainingState, EngineError> {
        self.engine.state()
    }

    fn replace_parameters(&mut self, parameters: &[f32]) -> Result<(), EngineError> {
        self.engine.replace_parameters(parameters)
    }
}
