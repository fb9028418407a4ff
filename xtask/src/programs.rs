//! All tests of the workspace, two of their programs at a time: most end with one long test, which leaves other cores idle.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use anyhow::{Context as _, Result, ensure};
use serde_json::Value;

use crate::checks::{cargo, cargo_command};

const AT_A_TIME: usize = 2;

/// Builds and runs them; what a program prints is shown when it ends.
///
/// # Errors
/// A build that fails; the programs whose tests fail, when all have run.
pub(crate) fn run() -> Result<()> {
    let programs = build()?;
    let next = AtomicUsize::new(0);
    let work = || -> Result<Vec<&str>> {
        let mut failed = Vec::new();
        while let Some(program) = programs.get(next.fetch_add(1, Ordering::Relaxed)) {
            if !program.passes()? {
                failed.push(&*program.name);
            }
        }
        Ok(failed)
    };
    let failed = thread::scope(|scope| -> Result<Vec<_>> {
        let workers: Vec<_> = (0..AT_A_TIME).map(|_| scope.spawn(work)).collect();
        let failed: Result<Vec<_>> =
            workers.into_iter().map(|worker| worker.join().expect("no worker panics")).collect();
        Ok(failed?.concat())
    })?;
    ensure!(failed.is_empty(), "tests of {} failed", failed.join(", "));
    cargo(&["test", "--workspace", "--doc"], &[])
}

/// Everything that `cargo test` runs but for the documentation's examples; the tests beside a crate first, which take longest.
fn build() -> Result<Vec<Program>> {
    let arguments = ["test", "--workspace", "--no-run", "--message-format=json-render-diagnostics"];
    println!("$ cargo {}", arguments.join(" "));
    let mut command = cargo_command();
    let mut cargo = command.args(arguments).stdout(Stdio::piped()).spawn().context("cannot start cargo")?;
    let mut programs = Vec::new();
    for message in BufReader::new(cargo.stdout.take().context("cargo's messages")?).lines() {
        programs.extend(Program::of_message(&message?));
    }
    ensure!(cargo.wait()?.success(), "`cargo {}` failed", arguments.join(" "));
    ensure!(!programs.is_empty(), "cargo built no tests");
    programs.sort_by_key(|program| !program.is_beside);
    Ok(programs)
}

/// A program of tests, as cargo built it.
#[derive(Debug, PartialEq)]
struct Program {
    /// Package, kind and name of the target.
    name: String,
    executable: PathBuf,
    /// The folder of its package, in which it runs.
    folder: PathBuf,
    /// Whether it stands beside the crate, in `tests`.
    is_beside: bool,
}

impl Program {
    /// The program that a message of cargo's tells of, if it does.
    fn of_message(message: &str) -> Option<Self> {
        let message: Value = serde_json::from_str(message).ok()?;
        message["profile"]["test"].as_bool().filter(|&is_test| is_test)?;
        let executable = message["executable"].as_str()?.into();
        let folder = Path::new(message["manifest_path"].as_str()?).parent()?;
        let kind = message["target"]["kind"][0].as_str()?;
        let package = folder.file_name()?.to_string_lossy();
        let name = format!("{package} ({kind} {})", message["target"]["name"].as_str()?);
        Some(Self { name, executable, folder: folder.into(), is_beside: kind == "test" })
    }

    /// Runs it and shows what it printed.
    fn passes(&self) -> Result<bool> {
        let output = Command::new(&self.executable)
            .current_dir(&self.folder)
            .output()
            .with_context(|| format!("cannot start {}", self.executable.display()))?;
        // At once, so that the other program's stands before or after it.
        let mut out = std::io::stdout().lock();
        writeln!(out, "\n     Running {} ({})", self.name, self.executable.display())?;
        for printed in [&output.stdout, &output.stderr] {
            out.write_all(printed)?;
        }
        if !output.status.success() {
            writeln!(out, "     {} ended with {}", self.name, output.status)?;
        }
        out.flush()?;
        Ok(output.status.success())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_are_known_from_what_cargo_says() {
        let message = r#"{"reason":"compiler-artifact","manifest_path":"/imf/crates/imf-gpu/Cargo.toml",
            "target":{"kind":["test"],"name":"gpu"},"profile":{"test":true},"executable":"/target/gpu-1"}"#;
        let program = Program {
            name: "imf-gpu (test gpu)".into(),
            executable: "/target/gpu-1".into(),
            folder: "/imf/crates/imf-gpu".into(),
            is_beside: true,
        };
        assert_eq!(Program::of_message(message), Some(program));
        for (from, to) in [("true", "false"), ("\"/target/gpu-1\"", "null"), ("{", "")] {
            assert_eq!(Program::of_message(&message.replace(from, to)), None);
        }
    }
}
