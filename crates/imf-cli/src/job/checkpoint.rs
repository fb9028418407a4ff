//! The files that a run continues from.
//!
//! The last checkpoint and the one before are kept, each whole and with a checksum. Where the last is damaged, the one
//! before serves, and the steps between are repeated to the same bits. A checkpoint that cannot be written while
//! training goes on is one warning; the next is tried at its time.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use imf_core::atomic_file::remove_all_leftovers;
use imf_fields::file::FieldFileError;
use imf_fields::model::{Model, steps_said};

use crate::arguments::NetworkFamily;
use crate::session::Session;

const CURRENT: &str = NetworkFamily::Siren5.checkpoint();
pub(super) const PREVIOUS: &str = "checkpoint.previous.safetensors";

/// What an output folder holds to go on from.
pub struct Latest {
    /// The network at its last step.
    pub model: Model,
    pub(crate) path: PathBuf,
    /// What is wrong with a later checkpoint, and what that costs.
    pub damage: Option<String>,
}

/// True where a folder holds a checkpoint, intact or not.
pub(super) fn is_any(out: &Path) -> bool {
    [CURRENT, PREVIOUS].iter().any(|name| out.join(name).exists())
}

/// The last intact checkpoint of a folder.
///
/// # Errors
/// No checkpoint, none that is intact, or one of a newer program.
pub fn latest(out: &Path) -> Result<Latest> {
    let (current, previous) = (out.join(CURRENT), out.join(PREVIOUS));
    let error = match Model::read(&current) {
        Ok(model) => return Ok(Latest { model, path: current, damage: None }),
        Err(error @ FieldFileError::Newer { .. }) => return Err(error.into()),
        Err(error) => error,
    };
    let model = match Model::read(&previous) {
        Ok(model) => model,
        Err(_) if !previous.exists() => return Err(error.into()),
        Err(second) => {
            return Err(error).with_context(|| format!("{second}; nor can the one after it be used"));
        }
    };
    let steps = model.record.steps;
    let repeated = match steps_said(&current) {
        Some(later) if later > steps => format!("{} steps are repeated", later - steps),
        _ => "all steps after it are repeated; how many is lost with the damaged file".to_owned(),
    };
    let damage = format!("{error}; going on from {} at step {steps}: {repeated}", previous.display());
    Ok(Latest { model, path: previous, damage: Some(damage) })
}

/// Writes checkpoints of one training.
pub(super) struct Checkpoints {
    writing: bool,
    current: PathBuf,
    previous: PathBuf,
    seconds_between: f64,
    tried: Instant,
    /// True where the last try failed, which has been said.
    failing: bool,
    /// What the files hold.
    content: Content,
    /// The last checkpoint is of a state that may be lost: the one before is the good one.
    doubtful: bool,
}

/// What stands in the folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    /// Nothing of this training.
    Foreign,
    /// Only the checkpoint before the last is this training's and intact.
    PreviousAt(u64),
    /// The last checkpoint is intact.
    CurrentAt(u64),
}

impl Checkpoints {
    /// For a training that has done `steps` steps, those of the checkpoint that it goes on from. Without `writing`
    /// another process writes them, and nothing is done here.
    pub(super) fn new(out: &Path, steps: u64, seconds_between: f64, writing: bool) -> Self {
        let (current, previous) = (out.join(CURRENT), out.join(PREVIOUS));
        let tried = Instant::now();
        if !writing {
            let (content, doubtful) = (Content::Foreign, false);
            return Self {
                writing,
                current,
                previous,
                seconds_between,
                tried,
                failing: false,
                content,
                doubtful,
            };
        }
        remove_all_leftovers(out);
        let (content, doubtful) = match Model::read(&current) {
            _ if steps == 0 => (Content::Foreign, false),
            Ok(Model { record, .. }) if record.steps == steps => {
                (Content::CurrentAt(steps), record.watch.is_suspicious())
            }
            _ => (Content::PreviousAt(steps), false),
        };
        Self { writing, current, previous, seconds_between, tried, failing: false, content, doubtful }
    }

    /// True once the next checkpoint is due.
    pub(super) fn is_due(&self) -> bool {
        self.writing && self.tried.elapsed().as_secs_f64() >= self.seconds_between
    }

    /// Writes a checkpoint.
    ///
    /// # Errors
    /// A file that cannot be written; what was there stays.
    pub(super) fn write(&mut self, model: &Model) -> Result<()> {
        if !self.writing {
            return Ok(());
        }
        self.tried = Instant::now();
        let written = match self.content {
            // What is damaged, or may be lost, must not take the place of what is not.
            Content::CurrentAt(_) if self.doubtful && self.previous.exists() => model.write(&self.current),
            Content::PreviousAt(_) => model.write(&self.current),
            Content::CurrentAt(_) => model.write_keeping_previous(&self.current, &self.previous),
            Content::Foreign => {
                // Of another training, which is finished: nobody goes on from it.
                let _ = fs::remove_file(&self.previous);
                model.write(&self.current)
            }
        };
        written.with_context(|| format!("the checkpoint could not be written, {}", self.kept()))?;
        self.content = Content::CurrentAt(model.record.steps);
        self.doubtful = model.record.watch.is_suspicious();
        Ok(())
    }

    /// Training has diverged: a last checkpoint of that time goes, where there is a good one before it to go on from.
    pub(super) fn drop_doubtful(&mut self) {
        if !(self.writing && self.doubtful) {
            return;
        }
        if let Ok(good) = Model::read(&self.previous)
            && !good.record.watch.is_suspicious()
            && fs::remove_file(&self.current).is_ok()
        {
            (self.content, self.doubtful) = (Content::PreviousAt(good.record.steps), false);
        }
    }

    /// Writes a checkpoint, or warns once that this is not possible now.
    pub(super) fn write_or_warn(&mut self, session: &Session, model: &Model) {
        match self.write(model) {
            Ok(()) if self.failing => {
                self.failing = false;
                session.note(&format!("checkpoints are written again, at step {}", model.record.steps));
            }
            Ok(()) => {}
            Err(error) if !self.failing => {
                self.failing = true;
                session.warn(&format!(
                    "{error:#}; training goes on and tries again every {} s",
                    self.seconds_between
                ));
            }
            Err(_) => {}
        }
    }

    /// The file that training can go on from, if there is one.
    pub(super) fn last(&self) -> Option<(&Path, u64)> {
        match self.content {
            Content::Foreign => None,
            Content::PreviousAt(step) => Some((&self.previous, step)),
            Content::CurrentAt(step) => Some((&self.current, step)),
        }
    }

    /// In words, what there is to go on from.
    pub(super) fn kept(&self) -> String {
        match self.last() {
            Some((path, step)) => format!("the last good one is {}, of step {step}", path.display()),
            None => "no checkpoint was written yet".to_owned(),
        }
    }
}
