//! Rows as JSON, one a line.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use imf_core::atomic_file::write_atomically;

use super::Row;

/// A file that grows by a line a row.
pub(super) struct JsonLines {
    path: PathBuf,
    file: File,
}

impl JsonLines {
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
        if rows().next().is_some_and(|(_, row)| row.is_err()) {
            bail!("{} is no log of a training: give --log another name", path.display());
        }
        let kept: String = rows()
            .filter(|(_, row)| row.as_ref().is_ok_and(|row| row.step <= steps && steps > 0))
            .map(|(line, _)| format!("{line}\n"))
            .collect();
        if kept != text || text.is_empty() {
            write_atomically(path, |file| file.write_all(kept.as_bytes()))?;
        }
        let file = OpenOptions::new().append(true).open(path).with_context(cannot)?;
        Ok(Self { path: path.to_owned(), file })
    }

    pub(super) fn add(&mut self, row: &Row) -> Result<()> {
        let line = serde_json::to_string(row)? + "\n";
        self.file
            .write_all(line.as_bytes())
            .with_context(|| format!("cannot write the log {}", self.path.display()))
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
        let mut lines = JsonLines::open(&path, 0).unwrap();
        (1..=5).for_each(|step| lines.add(&row(step * 20)).unwrap());
        let mut text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(serde_json::from_str::<Row>(text.lines().nth(1).unwrap()).unwrap(), row(40));
        text.push_str("{\"step\":12");
        std::fs::write(&path, &text).unwrap();
        let mut lines = JsonLines::open(&path, 60).unwrap();
        lines.add(&row(80)).unwrap();
        assert_eq!(steps(&path), [20, 40, 60, 80]);
        // A training from the start begins a new log.
        JsonLines::open(&path, 0).unwrap().add(&row(20)).unwrap();
        assert_eq!(steps(&path), [20]);
    }

    #[test]
    fn other_files_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data.csv");
        std::fs::write(&path, "x,y\n1,2\n").unwrap();
        assert!(JsonLines::open(&path, 0).err().unwrap().to_string().contains("no log of a training"));
        assert_eq!(std::fs::read(&path).unwrap(), b"x,y\n1,2\n");
    }
}
