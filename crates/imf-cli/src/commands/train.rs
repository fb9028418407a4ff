//! `imf train`: a factored field of a part, or the paper's network on samples.

pub(super) mod factored;
mod siren;

use std::path::Path;

use anyhow::Result;
use imf_fields::model::Model;
use serde_json::json;

use super::calibrate;
use crate::arguments::train::{TrainArguments, Training};
use crate::job::{self, Latest};
use crate::output::{print, print_json};
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &TrainArguments) -> Result<()> {
    let training = arguments.training()?;
    job::require_togetherness(session)?;
    match training {
        Training::Taught(teach) => factored::run(session, arguments, teach),
        Training::Learnt(shape, samples) => siren::run(session, arguments, shape, &samples),
    }
}

/// True where the training that was found is finished: what it came to is told, and no sample is made or read. Refuses one of
/// other samples than `same` allows.
pub(super) fn is_over(
    session: &Session,
    out: &Path,
    found: Option<&Latest>,
    same: impl FnOnce(&Latest) -> Result<()>,
    no_calibrate: bool,
) -> Result<bool> {
    let Some(found) = found else { return Ok(false) };
    same(found)?;
    if !found.is_finished() {
        return Ok(false);
    }
    let model = found.result(session, out)?;
    concluded(session, out, &model, no_calibrate)?;
    Ok(true)
}

/// The end of a training: its closing line, and what the model's decisions are worth, where that is short beside it and not yet
/// known.
pub(super) fn concluded(session: &Session, out: &Path, model: &Model, no_calibrate: bool) -> Result<()> {
    let path = out.join(job::MODEL);
    announce(session, &path, model)?;
    // A batch is no larger than the dataset.
    let record = &model.record;
    let samples = record.steps.saturating_mul(record.samples.min(record.plan.batch as u64));
    let known = model.calibration.is_some();
    if known || no_calibrate || !session.rank().is_first() || !calibrate::is_short_beside(samples) {
        return Ok(());
    }
    calibrate::afterwards(session, &path)
}

/// The closing line of a training.
fn announce(session: &Session, path: &Path, model: &Model) -> Result<()> {
    if !session.rank().is_first() {
        return Ok(());
    }
    let loss = model.record.losses.last().map(|p| p.loss);
    if session.json {
        return print_json(&json!({
            "model": path, "steps": model.record.steps, "seconds": model.record.seconds, "loss": loss,
            "parameters": model.shape.parameter_count(), "engine": model.record.engine,
            "held_out": model.record.held_out.as_ref().and_then(|held| held.errors.last()),
        }));
    }
    print(&format!(
        "{}: {} steps in {:.1} s; compare with: imf eval {}",
        path.display(),
        model.record.steps,
        model.record.seconds,
        path.display()
    ))
}
