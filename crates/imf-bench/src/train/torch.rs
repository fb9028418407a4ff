//! PyTorch in a process of its own, measured in alternation with the training engine.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context as _, Result, ensure};
use imf_cli::session::Session;
use serde::Deserialize;

use crate::rivals;
use crate::train::Steps;

const SCRIPT: &str = include_str!("../../python/train_torch.py");
const REQUIREMENTS: &str = "Install: python3 -m pip install -r crates/imf-bench/python/requirements-torch.txt, or name another by --python";

/// PyTorch in a process of its own, run in alternation.
pub(super) struct Torch {
    process: Child,
    requests: ChildStdin,
    answers: BufReader<ChildStdout>,
    name: String,
    /// Holds the script while it runs.
    _folder: tempfile::TempDir,
}

#[derive(Deserialize)]
struct Answer {
    version: Option<String>,
    device: Option<String>,
    samples_per_second: Option<f64>,
    failed: Option<String>,
}

impl Torch {
    /// The rival, or why there is none and what would help.
    pub(super) fn start(session: &Session, of: &Steps<'_>, device: &str) -> Result<Result<Self, String>> {
        let python = of.python;
        let check = format!("import torch; torch.zeros(1, device='{device}'); print(1)");
        if let Err(why) =
            rivals::ask::<u32>("PyTorch", Command::new(python).args(["-c", &check]), REQUIREMENTS)
        {
            return Ok(Err(why));
        }
        // In a file, which torch.compile may read again.
        let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
        let script = folder.path().join("train_torch.py");
        std::fs::write(&script, SCRIPT).with_context(|| format!("cannot write {}", script.display()))?;
        let mut command = Command::new(python);
        // Ctrl-C of a terminal is for this process, which ends that one.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut process = command
            .arg(&script)
            .args(["--threads", &session.threads().to_string(), "--width", &of.width.to_string()])
            .args(["--device", device])
            .args(["--precision", &of.precision.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .with_context(|| format!("cannot start {python}"))?;
        let requests = process.stdin.take().context("no pipe to PyTorch")?;
        let answers = BufReader::new(process.stdout.take().context("no pipe from PyTorch")?);
        let mut torch = Self { process, requests, answers, name: String::new(), _folder: folder };
        let Answer { version, device, .. } = torch.answer()?;
        torch.name = format!("PyTorch {} on {}", version.unwrap_or_default(), device.unwrap_or_default());
        Ok(Ok(torch))
    }

    /// Its version, and what it runs on.
    pub(super) fn describe(&self) -> &str {
        &self.name
    }

    /// Samples per second of a round, or why it failed.
    pub(super) fn measure(&mut self, mode: &str, batch: usize, seconds: f64) -> Result<Result<f64, String>> {
        let request = serde_json::json!({ "mode": mode, "batch": batch, "seconds": seconds });
        writeln!(self.requests, "{request}").context("PyTorch's process ended")?;
        let answer = self.answer()?;
        Ok(answer.samples_per_second.ok_or_else(|| answer.failed.unwrap_or_default()))
    }

    fn answer(&mut self) -> Result<Answer> {
        let mut line = String::new();
        let read = self.answers.read_line(&mut line).context("cannot read from PyTorch's process")?;
        ensure!(read > 0, "PyTorch's process ended without an answer");
        serde_json::from_str(&line).with_context(|| format!("PyTorch's process answered '{}'", line.trim()))
    }
}

impl Drop for Torch {
    fn drop(&mut self) {
        // It may be in the middle of a round that nobody waits for.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
