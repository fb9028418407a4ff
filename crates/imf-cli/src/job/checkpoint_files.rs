//! The checkpoints that a training writes.
//!
//! The last one and the one before are saved. A checkpoint that cannot be written while training goes on is one warning; the
//! next is tried at its time.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use imf_core::atomic_file::{keep_previous, remove_all_leftovers};

use super::FIELD;
use super::checkpoint::{CURRENT, Checkpoint, PREVIOUS};
use crate::exit::message;
use crate::output::keep_former;
use crate::session::Session;

/// What a checkpoint is called until it is whole.
const NEXT: &str = "checkpoint.next.safetensors";

pub(super) struct CheckpointFiles {
    writing: bool,
    current: PathBuf,
    previous: PathBuf,
    next: PathBuf,
    field: PathBuf,
    seconds_between: f64,
    tried: Instant,
    /// True where the last try failed, which has been said.
    failing: bool,
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

impl CheckpointFiles {
    /// For a training that goes on after `steps` steps, those of the checkpoint that it goes on from, if it does. Without
    /// `writing` another process writes them, and nothing is done here.
    pub(super) fn new<T: Checkpoint>(
        out: &Path,
        steps: Option<u64>,
        seconds_between: f64,
        writing: bool,
    ) -> Self {
        let mut files = Self {
            writing,
            current: out.join(CURRENT),
            previous: out.join(PREVIOUS),
            next: out.join(NEXT),
            field: out.join(FIELD),
            seconds_between,
            tried: Instant::now(),
            failing: false,
            content: Content::Foreign,
            doubtful: false,
        };
        if !writing {
            return files;
        }
        remove_all_leftovers(out);
        // Of a process that was killed before it had its name.
        let _ = fs::remove_file(&files.next);
        if let Some(steps) = steps {
            let current = T::read(&files.current).map(|field| field.progress());
            match current {
                Ok(progress) if progress.steps == steps => {
                    files.content = Content::CurrentAt(steps);
                    files.doubtful = progress.start.watch.is_suspicious();
                }
                _ => files.content = Content::PreviousAt(steps),
            }
        }
        files
    }

    pub(super) fn is_due(&self) -> bool {
        self.writing && self.tried.elapsed().as_secs_f64() >= self.seconds_between
    }

    /// Writes a checkpoint.
    ///
    /// # Errors
    /// A file that cannot be written; what was there stays.
    pub(super) fn write<T: Checkpoint>(&mut self, session: &Session, field: &T) -> Result<()> {
        if !self.writing {
            return Ok(());
        }
        self.tried = Instant::now();
        let written = self.replace(session, field);
        written.with_context(|| {
            format!("the checkpoint {} could not be written, {}", self.current.display(), self.kept())
        })?;
        let progress = field.progress();
        self.content = Content::CurrentAt(progress.steps);
        self.doubtful = progress.start.watch.is_suspicious();
        Ok(())
    }

    fn replace<T: Checkpoint>(&self, session: &Session, field: &T) -> Result<()> {
        match self.content {
            // What is damaged, or may be lost, must not take the place of what is not.
            Content::CurrentAt(_) if self.doubtful && self.previous.exists() => field.write(&self.current),
            Content::PreviousAt(_) => field.write(&self.current),
            Content::CurrentAt(_) => {
                // Whole before it takes the place of the last, which takes that of the one before: at any moment both are whole.
                let written = field.write(&self.next).and_then(|()| {
                    keep_previous(&self.current, &self.previous)?;
                    Ok(fs::rename(&self.next, &self.current)?)
                });
                if written.is_err() {
                    let _ = fs::remove_file(&self.next);
                }
                written
            }
            Content::Foreign => {
                // Of another training, which is finished: nobody goes on from it, and its field is not this one's.
                let _ = fs::remove_file(&self.previous);
                field.write(&self.current)?;
                keep_former(session, &self.field)?;
                let _ = fs::remove_file(&self.field);
                Ok(())
            }
        }
    }

    /// Training has diverged: a last checkpoint of that time goes, where there is a good one before it to go on from.
    pub(super) fn drop_doubtful<T: Checkpoint>(&mut self) {
        if !(self.writing && self.doubtful) {
            return;
        }
        if let Ok(good) = T::read(&self.previous).map(|field| field.progress())
            && !good.start.watch.is_suspicious()
            && fs::remove_file(&self.current).is_ok()
        {
            (self.content, self.doubtful) = (Content::PreviousAt(good.steps), false);
        }
    }

    /// Writes a checkpoint, or warns once that this is not possible now.
    pub(super) fn write_or_warn<T: Checkpoint>(&mut self, session: &Session, field: &T) {
        match self.write(session, field) {
            Ok(()) if self.failing => {
                self.failing = false;
                session.note(&format!("checkpoints are written again, at step {}", field.progress().steps));
            }
            Ok(()) => {}
            Err(error) if !self.failing => {
                self.failing = true;
                session.warn(&format!(
                    "{}; training goes on and tries again every {} s",
                    message(&error),
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
