//! The error at poses that training never sees, while it trains.
//!
//! Evaluation runs on the CPU engine whatever trains: the same weights give the same numbers, and 16,384 poses of the
//! paper's network take a tenth of a second on two cores.

use anyhow::Result;
use imf_fields::model::{HeldOutPoint, HeldOutRecord, Model};
use imf_fields::recipe::{HeldOutChoice, TrainingState};
use imf_fields::siren::evaluator::CpuEvaluator;
use imf_train::held_out::HeldOut;

use super::REPORT_EVERY;
use crate::interrupt;
use crate::session::Session;

/// Default maximum number of evaluations of a run; they then take about a hundredth of the time of training.
const EVALUATIONS: u64 = 100;
/// Default minimum number of steps between two evaluations.
const STEPS_BETWEEN: u64 = 500;

/// Steps between two evaluations: a multiple of those between two reports, so that evaluations come at the same steps however often
/// a run is interrupted.
pub(super) fn steps_between(every: u64) -> u64 {
    every.max(1).next_multiple_of(REPORT_EVERY)
}

/// What is held out of a fresh training of `total` steps.
pub(super) fn record(poses: usize, every: Option<u64>, seed: u64, total: u64) -> Option<HeldOutRecord> {
    let every = steps_between(every.unwrap_or((total / EVALUATIONS).max(STEPS_BETWEEN)));
    let choice = HeldOutChoice { poses, seed, ..HeldOutChoice::default() };
    (poses > 0).then_some(HeldOutRecord { choice, every, errors: Vec::new() })
}

pub(super) struct HeldOutWatch {
    poses: HeldOut,
    evaluator: CpuEvaluator,
    every: u64,
}

impl HeldOutWatch {
    /// Draws the poses that the model's record specifies.
    pub(super) fn new(session: &Session, model: &Model) -> Result<Option<Self>> {
        let Some(record) = &model.record.held_out else { return Ok(None) };
        let trained = &model.record.orientations.orientations;
        let poses = HeldOut::new(record.choice, &model.scene, trained, session.control(&|_| {}));
        let poses = poses.map_err(|error| {
            interrupt::explained(error, || {
                "the training had not begun; run the same command again: what was made for it is kept".into()
            })
        })?;
        let evaluator = CpuEvaluator::new(model.shape, &model.state.parameters)?;
        Ok(Some(Self { poses, evaluator, every: record.every }))
    }

    /// True where the error after `step` of `total` steps is wanted.
    pub(super) fn is_due(&self, step: u64, total: u64) -> bool {
        step.is_multiple_of(self.every) || step == total
    }

    pub(super) fn evaluate(&mut self, step: u64, state: &TrainingState) -> Result<HeldOutPoint> {
        self.evaluator.set_parameters(&state.parameters)?;
        let report = self.poses.errors(&mut self.evaluator)?;
        Ok(HeldOutPoint { step, mse: report.mse, mae: report.mae })
    }
}
