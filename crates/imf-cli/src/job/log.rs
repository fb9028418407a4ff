//! The log of a training: a JSON object a line, with every point of the loss curve and every error at held-out poses.
//!
//! A run that goes on from a checkpoint takes back the rows of the steps that it repeats. A row that cannot be written is one
//! warning: training goes on.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use imf_core::atomic_file::write_atomically;
use serde::{Deserialize, Serialize};

use crate::exit::message;
use crate::session::Session;

/// One row: the state of a training after some steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
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
    pub(super) samples_per_second: f64,
    /// Seconds of training, all runs together.
    pub(super) seconds: f64,
    /// Seconds to the end at this rate.
    pub(super) seconds_left: Option<f64>,
}

pub(super) const LOG: &str = "log.jsonl";

/// Seconds of training up to a step, as the log of its folder says; 0 without one.
pub fn seconds_until(folder: &Path, steps: u64) -> f64 {
    let text = std::fs::read_to_string(folder.join(LOG)).unwrap_or_default();
    let mut rows = text.lines().filter_map(|line| serde_json::from_str::<Row>(line).ok());
    rows.rfind(|row| row.step <= steps).map_or(0.0, |row| row.seconds)
}

/// A file that grows by a line a row.
pub(super) struct Log {
    path: PathBuf,
    file: File,
    /// True where a row could not be written, which has been said.
    failing: bool,
    /// The last row may have been written in part.
    cut: bool,
}

impl Log {
    /// Opens the log of a training that has done `steps` steps: rows of later steps, and a last line that was cut
    /// short, are removed.
    pub(super) fn open(path: &Path, steps: u64) -> Result<Self> {
        let cannot = || format!("cannot write the log {}", path.display());
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).with_context(cannot)?;
        }
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
            Err(error) => return Err(error).with_context(cannot),
        };
        let rows = || text.lines().map(|line| (line, serde_json::from_str::<Row>(line)));
        // The rows of a training that goes on are its own, though the first may have been cut short.
        if steps == 0 && rows().next().is_some_and(|(_, row)| row.is_err()) {
            bail!("{} is not a log of a training: move it, or choose another folder", path.display());
        }
        let kept: String = rows()
            .filter(|(_, row)| row.as_ref().is_ok_and(|row| row.step <= steps && steps > 0))
            .map(|(line, _)| format!("{line}\n"))
            .collect();
        if kept != text || text.is_empty() {
            write_atomically(path, |file| file.write_all(kept.as_bytes()))?;
        }
        let file = OpenOptions::new().append(true).open(path).with_context(cannot)?;
        Ok(Self { path: path.to_owned(), file, failing: false, cut: false })
    }

    pub(super) fn add(&mut self, session: &Session, row: &Row) {
        if let (Err(error), false) = (self.write(row), self.failing) {
            self.failing = true;
            session.warn(&format!("{}; training goes on, rows may be missing", message(&error)));
        }
    }

    fn write(&mut self, row: &Row) -> Result<()> {
        let start = if self.cut { "\n" } else { "" };
        let line = format!("{start}{}\n", serde_json::to_string(row)?);
        let written = self.file.write_all(line.as_bytes());
        self.cut = written.is_err();
        written.with_context(|| format!("cannot write the log {}", self.path.display()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(step: u64) -> Row {
        Row {
            step,
            epoch: 0,
            loss: Some(0.1 / step as f64),
            rate: 5e-4,
            held_out_mse: None,
            held_out_mae: None,
            samples_per_second: 1e5,
            seconds: 0.3,
            seconds_left: Some(4.0),
        }
    }

    fn steps(path: &Path) -> Vec<u64> {
        let text = std::fs::read_to_string(path).unwrap();
        text.lines().map(|line| serde_json::from_str::<Row>(line).unwrap().step).collect()
    }

    #[test]
    fn repeated_steps_are_taken_back_and_half_lines_go() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.jsonl");
        let mut lines = Log::open(&path, 0).unwrap();
        (1..=5).for_each(|step| lines.write(&row(step * 20)).unwrap());
        let mut text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(serde_json::from_str::<Row>(text.lines().nth(1).unwrap()).unwrap(), row(40));
        text.push_str("{\"step\":12");
        std::fs::write(&path, &text).unwrap();
        let mut lines = Log::open(&path, 60).unwrap();
        assert_eq!([0, 70].map(|steps| seconds_until(folder.path(), steps)), [0.0, row(60).seconds]);
        lines.write(&row(80)).unwrap();
        assert_eq!(steps(&path), [20, 40, 60, 80]);
        // A first line that was cut is not a reason to refuse a training that goes on.
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, format!("{{\"st\n{text}")).unwrap();
        let mut lines = Log::open(&path, 80).unwrap();
        lines.cut = true;
        lines.file.write_all(b"{\"step\":9").unwrap();
        lines.write(&row(100)).unwrap();
        assert_eq!(seconds_until(folder.path(), 100), row(100).seconds);
        drop(Log::open(&path, 100).unwrap());
        assert_eq!(steps(&path), [20, 40, 60, 80, 100]);
        // A training from the start begins a new log.
        Log::open(&path, 0).unwrap().write(&row(20)).unwrap();
        assert_eq!(steps(&path), [20]);
    }

    #[test]
    fn other_files_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data.csv");
        std::fs::write(&path, "x,y\n1,2\n").unwrap();
        assert!(Log::open(&path, 0).err().unwrap().to_string().contains("not a log of a training"));
        assert_eq!(std::fs::read(&path).unwrap(), b"x,y\n1,2\n");
    }
}
