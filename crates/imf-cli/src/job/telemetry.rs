//! The course of a training for those who watch it with other programs: JSON lines and TensorBoard's event files.
//!
//! A row is written with every point of the loss curve and with every error at held-out poses. A run that goes on from a
//! checkpoint takes back the rows of the steps that it repeats. Telemetry that cannot be written is one warning:
//! training goes on.

mod events;
mod json_lines;

use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::{Deserialize, Serialize};

use crate::session::Session;
use events::EventFile;
use json_lines::JsonLines;

/// One row: the state of a training after some steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    /// Steps done.
    pub(super) step: u64,
    /// Epoch of the next step, from 0.
    pub(super) epoch: u64,
    /// Mean loss since the point of the loss curve before; only at points of the curve.
    pub(super) loss: Option<f64>,
    /// Learning rate of the last step.
    pub(super) rate: f32,
    /// Mean squared error at held-out poses, where it was just measured.
    pub(super) held_out_mse: Option<f64>,
    /// Mean absolute error there.
    pub(super) held_out_mae: Option<f64>,
    /// Samples a second.
    pub(super) samples_per_second: f64,
    /// Seconds of training, all runs together.
    pub(super) seconds: f64,
    /// Seconds to the end at this rate.
    pub(super) seconds_left: Option<f64>,
}

/// Where rows go.
pub(super) struct Telemetry {
    lines: Option<JsonLines>,
    events: Option<EventFile>,
    failing: bool,
}

impl Telemetry {
    /// Opens what is asked for, for a training that has done `steps` steps. `tensorboard` is the folder of event files.
    ///
    /// # Errors
    /// Files that cannot be written, or a log that is none.
    pub(super) fn open(log: Option<&Path>, tensorboard: Option<PathBuf>, steps: u64) -> Result<Self> {
        Ok(Self {
            lines: log.map(|path| JsonLines::open(path, steps)).transpose()?,
            events: tensorboard.map(|folder| EventFile::create(&folder, steps)).transpose()?,
            failing: false,
        })
    }

    pub(super) fn add(&mut self, session: &Session, row: &Row) {
        let lines = self.lines.as_mut().map_or(Ok(()), |lines| lines.add(row));
        let events = self.events.as_mut().map_or(Ok(()), |events| events.add(row));
        if let (Err(error), false) = (lines.and(events), self.failing) {
            self.failing = true;
            session.warn(&format!("{error:#}; training goes on, rows may be missing"));
        }
    }
}
