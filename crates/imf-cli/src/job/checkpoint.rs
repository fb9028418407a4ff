//! Checkpoints from which a training of any family resumes: the last of a folder, or the one before.
//!
//! Both are whole and have a checksum. Where the last is damaged, the one before serves, and the steps between are repeated to the
//! same bits.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Error, Result, bail};
use imf_fields::factored::FactoredState;
use imf_fields::factored::file::FactoredFile;
use imf_fields::file::FieldFileError;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::model::{HeldOutRecord, LossPoint, Model, steps_said};
use imf_fields::recipe::TrainingState;
use imf_train::training::run::Start;

use super::FIELD;
use super::curve::loss_chart;
use super::log::seconds_until;
use crate::exit::message;
use crate::interrupt;
use crate::output::keep_former;
use crate::picture::Chart;
use crate::session::Session;

pub(super) const CURRENT: &str = "checkpoint.safetensors";
pub(super) const PREVIOUS: &str = "checkpoint.previous.safetensors";

/// How far a training is, and what its losses were.
#[derive(Clone, Debug, Default)]
pub struct Progress {
    /// Steps done.
    pub steps: u64,
    /// Where it goes on.
    pub start: Start,
    /// Seconds of all runs together.
    pub seconds: f64,
    /// Points of the loss curve.
    pub losses: Vec<LossPoint>,
    /// Sum of the losses since the last point, and of how many steps.
    pub pending_loss: (f64, u64),
    /// Errors at held-out poses, where they are watched.
    pub held_out: Option<HeldOutRecord>,
}

/// A field in training, as its checkpoints hold it.
pub trait Checkpoint: Clone {
    /// Display name of its family, and the command that resumes it.
    const FAMILY: [&str; 2];

    /// Reads and checks one.
    ///
    /// # Errors
    /// A file that is missing, damaged, newer or of another family.
    fn read(path: &Path) -> Result<Self>;
    /// Writes it whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    fn write(&self, path: &Path) -> Result<()>;
    /// True for a file of the other family of networks.
    fn is_other(path: &Path) -> bool;
    /// Steps that a damaged one says were done.
    fn steps_of_damaged(_: &Path) -> Option<u64> {
        None
    }
    /// How far it is.
    fn progress(&self) -> Progress;
    /// Takes over a state, and how far it is.
    fn update(&mut self, progress: &Progress, state: TrainingState);
    /// Notes that the plan is done.
    fn finish(&mut self) {}
    /// True where no steps are left.
    fn is_finished(&self) -> bool;
    /// The field of a finished training.
    fn result(&self, precision: StoragePrecision) -> Self;
    /// True for the same field, however calibrated.
    fn is_same(&self, other: &Self) -> bool;
    /// How training went, as a picture.
    fn chart(&self) -> Option<Chart> {
        None
    }
}

impl Checkpoint for Model {
    const FAMILY: [&'static str; 2] = ["siren5", "imf train siren5 (or imf finetune)"];

    fn read(path: &Path) -> Result<Self> {
        let mut model = Self::read(path)?;
        // Times are in the log alone.
        model.record.seconds = seconds_until(path.parent().unwrap_or(Path::new("")), model.record.steps);
        Ok(model)
    }

    fn write(&self, path: &Path) -> Result<()> {
        Ok(self.write(path)?)
    }

    fn is_other(path: &Path) -> bool {
        FactoredFile::is_one(path)
    }

    fn steps_of_damaged(path: &Path) -> Option<u64> {
        steps_said(path)
    }

    fn progress(&self) -> Progress {
        let record = &self.record;
        Progress {
            steps: record.steps,
            start: Start { cursor: record.cursor, watch: record.watch },
            seconds: record.seconds,
            losses: record.losses.clone(),
            pending_loss: record.pending_loss,
            held_out: record.held_out.clone(),
        }
    }

    fn update(&mut self, progress: &Progress, state: TrainingState) {
        let Progress { steps, start, seconds, losses, pending_loss, held_out } = progress.clone();
        let record = &mut self.record;
        (record.steps, record.cursor, record.watch) = (steps, start.cursor, start.watch);
        (record.seconds, record.losses, record.pending_loss) = (seconds, losses, pending_loss);
        record.held_out = held_out;
        self.state = state;
    }

    fn finish(&mut self) {
        self.record.finished = true;
    }

    fn is_finished(&self) -> bool {
        self.record.finished
    }

    fn result(&self, _: StoragePrecision) -> Self {
        self.clone().without_moments()
    }

    fn is_same(&self, other: &Self) -> bool {
        let key = |model: &Self| (model.record.clone(), model.shape);
        key(self) == key(other) && self.state.parameters == other.state.parameters
    }

    fn chart(&self) -> Option<Chart> {
        Some(loss_chart(&self.record))
    }
}

impl Checkpoint for FactoredFile {
    const FAMILY: [&'static str; 2] = ["a factored field", "imf train factored"];

    fn read(path: &Path) -> Result<Self> {
        Ok(Self::read(path)?)
    }

    fn write(&self, path: &Path) -> Result<()> {
        Ok(self.write(path)?)
    }

    fn is_other(path: &Path) -> bool {
        Model::read(path).is_ok()
    }

    fn progress(&self) -> Progress {
        let Some(FactoredState { training, cursor, watch }) = &self.state else { return Progress::default() };
        let start = Start { cursor: *cursor, watch: *watch };
        Progress { steps: training.step, start, ..Progress::default() }
    }

    fn update(&mut self, progress: &Progress, state: TrainingState) {
        self.field.parameters.clone_from(&state.parameters);
        let Start { cursor, watch } = progress.start;
        self.state = Some(FactoredState { training: state, cursor, watch });
    }

    fn is_finished(&self) -> bool {
        !self.is_unfinished()
    }

    fn result(&self, precision: StoragePrecision) -> Self {
        self.clone().finished(precision)
    }

    fn is_same(&self, other: &Self) -> bool {
        let uncalibrated = |file: &Self| Self { calibration: None, ..file.clone() }.as_saved();
        uncalibrated(self) == uncalibrated(other)
    }
}

/// What an output folder holds to go on from.
pub struct LatestCheckpoint<T = Model> {
    /// The field at its last step.
    pub model: T,
    pub(crate) path: PathBuf,
    /// What is wrong with a later checkpoint, and what that costs.
    pub damage: Option<String>,
}

/// The last intact checkpoint of a folder.
///
/// # Errors
/// No checkpoint, none that is intact, or one of a newer program.
pub fn latest<T: Checkpoint>(out: &Path) -> Result<LatestCheckpoint<T>> {
    let (current, previous) = (out.join(CURRENT), out.join(PREVIOUS));
    let error = match T::read(&current) {
        Ok(model) => return Ok(LatestCheckpoint { model, path: current, damage: None }),
        Err(error) if is_newer(&error) => return Err(error),
        Err(error) => error,
    };
    let model = match T::read(&previous) {
        Ok(model) => model,
        Err(_) if !previous.exists() => return Err(error),
        Err(second) => {
            return Err(error).with_context(|| format!("{second}; nor can the one after it be used"));
        }
    };
    let steps = model.progress().steps;
    let repeated = match T::steps_of_damaged(&current) {
        Some(later) if later > steps => format!("{} steps are repeated", later - steps),
        _ => "all steps after it are repeated; how many is lost with the damaged file".to_owned(),
    };
    let damage = format!("{error}; going on from {} at step {steps}: {repeated}", previous.display());
    Ok(LatestCheckpoint { model, path: previous, damage: Some(damage) })
}

fn is_newer(error: &Error) -> bool {
    matches!(error.downcast_ref(), Some(FieldFileError::Newer { .. }))
}

/// The checkpoint to resume from, where `resume` is set. Refuses to begin where a training is unfinished, and to
/// go on where there is none, or one of the other family.
pub(crate) fn to_resume<T: Checkpoint>(out: &Path, resume: bool) -> Result<Option<LatestCheckpoint<T>>> {
    let current = out.join(CURRENT);
    let [family, command] = T::FAMILY;
    if resume && ![CURRENT, PREVIOUS].iter().any(|name| out.join(name).exists()) {
        let field = out.join(FIELD);
        if field.exists() {
            bail!(
                "there is nothing to resume: {} has a field without a checkpoint, which is finished (imf info {}); begin without --resume to \
                 train another",
                out.display(),
                field.display()
            );
        }
        bail!("there is nothing to resume: {} does not exist; begin without --resume", current.display());
    }
    if T::is_other(&current) && (resume || !out.join(FIELD).exists()) {
        bail!(
            "{} is of a training of the other family, not of {family}, which {command} makes: choose another --out",
            current.display()
        );
    }
    let found = latest::<T>(out);
    if resume {
        let found = found.context("there is nothing to resume; begin without --resume")?;
        let (steps, path) = (found.model.progress().steps, found.path.display());
        interrupt::leave(
            format!("step {steps} is saved in {path}; run the same command again to go on").into(),
        );
        return Ok(Some(found));
    }
    match found {
        Ok(found) if !found.model.is_finished() || !out.join(FIELD).exists() => bail!(
            "{} holds an unfinished training ({} steps done): add --resume, choose another --out, or remove it",
            found.path.display(),
            found.model.progress().steps
        ),
        Err(error) if is_newer(&error) => Err(error),
        _ => Ok(None),
    }
}

/// True where an earlier run left a checkpoint in `out` before its end, or no field.
pub(crate) fn is_unfinished<T: Checkpoint>(out: &Path) -> bool {
    latest::<T>(out).is_ok_and(|found| !found.model.is_finished() || !out.join(FIELD).exists())
}

impl<T: Checkpoint> LatestCheckpoint<T> {
    /// The field of a finished training: as it lies in `out`, else written there from the checkpoint. Nothing where steps are
    /// left.
    pub(crate) fn finished(
        &self,
        session: &Session,
        out: &Path,
        precision: StoragePrecision,
    ) -> Result<Option<T>> {
        if !self.model.is_finished() {
            return Ok(None);
        }
        let path = out.join(FIELD);
        let result = self.model.result(precision);
        let said = format!(
            "{} is finished after {} steps: nothing is left to do (imf train --from trains a field further)",
            self.path.display(),
            self.model.progress().steps
        );
        // Of these very weights, which the field of an earlier training is not.
        if let Some(saved) = T::read(&path).ok().filter(|saved| saved.is_same(&result)) {
            session.note(&said);
            return Ok(Some(saved));
        }
        if session.rank().is_first() {
            write_result(session, out, &result)?;
        }
        session.note(&format!("{said}; wrote {}", path.display()));
        Ok(Some(result))
    }
}

/// Writes the field of a finished training. The field of an earlier one is saved beside it.
pub(super) fn write_result<T: Checkpoint>(session: &Session, out: &Path, result: &T) -> Result<()> {
    let path = out.join(FIELD);
    keep_former(session, &path)?;
    result.write(&path)?;
    // A picture that cannot be drawn takes nothing from the field.
    let drawn = result.chart().map_or(Ok(()), |chart| chart.save(&out.join("loss.png")));
    if let Err(error) = drawn {
        session.warn(&format!("{}; {} is whole", message(&error), path.display()));
    }
    Ok(())
}
