//! All tests of the workspace, two programs of them at a time: most end with one long test, which leaves other cores idle. The first
//! run while the last are compiled.

use std::collections::BTreeSet;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Condvar, Mutex};
use std::thread;
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use serde_json::Value;

use crate::checks::cargo_command;
use crate::root;

const AT_A_TIME: usize = 2;

/// Builds and runs them, and when all are built the documentation's examples and `chores` of this program; what each prints is shown when
/// it ends.
///
/// # Errors
/// A build that fails; the programs whose tests fail, when all have run.
pub(crate) fn run(chores: &[&'static [&'static str]]) -> Result<()> {
    let this = std::env::current_exe().context("this program's place")?;
    let queue = Queue::default();
    let work = || -> Result<Vec<String>> {
        let mut failed = Vec::new();
        while let Some(program) = queue.next() {
            if !program.passes()? {
                failed.push(program.name);
            }
        }
        Ok(failed)
    };
    let failed = thread::scope(|scope| -> Result<Vec<_>> {
        let workers: Vec<_> = (0..AT_A_TIME).map(|_| scope.spawn(work)).collect();
        let built = build(&queue);
        if built.is_ok() {
            let chores = chores.iter().map(|chore| Program::of_chore(this.clone(), "cargo xtask", chore));
            chores.for_each(|chore| queue.add(chore));
            let cargo = cargo_command().get_program().into();
            queue.add(Program::of_chore(cargo, "cargo", &["test", "--workspace", "--doc"]));
        }
        queue.close();
        let failed: Result<Vec<_>> =
            workers.into_iter().map(|worker| worker.join().expect("no worker panics")).collect();
        built.and(Ok(failed?.concat()))
    })?;
    ensure!(failed.is_empty(), "tests of {} failed", failed.join(", "));
    Ok(())
}

/// Everything that `cargo test` runs but for the documentation's examples, as it is built. Cargo builds the commands that tests start
/// beside those tests, not before them: programs that may start one wait for all commands.
fn build(queue: &Queue) -> Result<()> {
    let mut commands = commands()?;
    let starting: BTreeSet<PathBuf> = commands.iter().map(|(folder, _)| folder.clone()).collect();
    let mut held = Vec::new();
    let arguments = ["test", "--workspace", "--no-run", "--message-format=json-render-diagnostics"];
    println!("$ cargo {}", arguments.join(" "));
    let mut command = cargo_command();
    let mut cargo = command.args(arguments).stdout(Stdio::piped()).spawn().context("cannot start cargo")?;
    let mut programs = 0;
    for message in BufReader::new(cargo.stdout.take().context("cargo's messages")?).lines() {
        match Built::of_message(&message?) {
            Some(Built::Tests(program)) => {
                programs += 1;
                let is_held = program.rank == Rank::Beside && starting.contains(&program.folder);
                if is_held { held.push(program) } else { queue.add(program) }
            }
            Some(Built::Command(command)) => _ = commands.remove(&command),
            None => (),
        }
        if commands.is_empty() {
            held.drain(..).for_each(|program| queue.add(program));
        }
    }
    ensure!(cargo.wait()?.success(), "`cargo {}` failed", arguments.join(" "));
    ensure!(programs > 0, "cargo built no tests");
    ensure!(held.is_empty(), "cargo did not build the commands {commands:?}");
    Ok(())
}

/// A command of the workspace: its package's folder, and its name.
type Binary = (PathBuf, String);

/// Those of packages with tests beside them, which cargo builds for these.
fn commands() -> Result<BTreeSet<Binary>> {
    let arguments = ["metadata", "--no-deps", "--format-version", "1"];
    let listed = cargo_command().args(arguments).output().context("cannot start cargo")?;
    let failed = || format!("cargo metadata: {}", String::from_utf8_lossy(&listed.stderr));
    let listed: Value = serde_json::from_slice(&listed.stdout).with_context(failed)?;
    commands_of(&listed).context("packages that cargo lists otherwise")
}

fn commands_of(listed: &Value) -> Option<BTreeSet<Binary>> {
    let mut commands = BTreeSet::new();
    for package in listed["packages"].as_array()? {
        let folder = Path::new(package["manifest_path"].as_str()?).parent()?;
        let targets = package["targets"].as_array()?;
        let of_kind = |kind| targets.iter().filter(move |target| target["kind"][0] == kind);
        if of_kind("test").next().is_some() {
            let names = of_kind("bin").filter_map(|target| target["name"].as_str());
            commands.extend(names.map(|name| (folder.to_owned(), name.to_owned())));
        }
    }
    Some(commands)
}

/// What cargo has built.
#[derive(Debug, PartialEq)]
enum Built {
    Tests(Program),
    Command(Binary),
}

impl Built {
    /// What a message of cargo's tells of, if it tells of one of them.
    fn of_message(message: &str) -> Option<Self> {
        let message: Value = serde_json::from_str(message).ok()?;
        let executable = message["executable"].as_str()?.into();
        let folder = Path::new(message["manifest_path"].as_str()?).parent()?;
        let kind = message["target"]["kind"][0].as_str()?;
        let name = message["target"]["name"].as_str()?;
        if !message["profile"]["test"].as_bool()? {
            return (kind == "bin").then(|| Self::Command((folder.to_owned(), name.to_owned())));
        }
        let package = folder.file_name()?.to_string_lossy();
        let name = format!("{package} ({kind} {name})");
        let rank = if kind == "test" { Rank::Beside } else { Rank::Own };
        Some(Self::Tests(Program { name, executable, arguments: &[], folder: folder.into(), rank }))
    }
}

/// Programs that wait for a worker.
#[derive(Default)]
struct Queue {
    /// And whether more cannot come.
    waiting: Mutex<(Vec<Program>, bool)>,
    changed: Condvar,
}

impl Queue {
    fn add(&self, program: Program) {
        self.waiting.lock().expect("no worker panics").0.push(program);
        self.changed.notify_one();
    }

    fn close(&self) {
        self.waiting.lock().expect("no worker panics").1 = true;
        self.changed.notify_all();
    }

    /// The one of highest rank, when there is one; `None` when none can come.
    fn next(&self) -> Option<Program> {
        let mut waiting = self.waiting.lock().expect("no worker panics");
        loop {
            let (programs, is_closed) = &mut *waiting;
            let next = (0..programs.len()).max_by_key(|&place| programs[place].rank);
            if let Some(next) = next {
                return Some(programs.swap_remove(next));
            }
            if *is_closed {
                return None;
            }
            waiting = self.changed.wait(waiting).expect("no worker panics");
        }
    }
}

/// Those that take longest come first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Rank {
    /// A crate's own tests.
    Own,
    /// The tests beside a crate, in `tests`.
    Beside,
    Chore,
}

/// A program of tests, as cargo built it, or a chore that tests.
#[derive(Debug, PartialEq)]
struct Program {
    /// Package, kind and name of the target, or the line to type.
    name: String,
    executable: PathBuf,
    arguments: &'static [&'static str],
    /// The folder of its package, in which it runs.
    folder: PathBuf,
    rank: Rank,
}

impl Program {
    fn of_chore(executable: PathBuf, name: &str, arguments: &'static [&'static str]) -> Self {
        let name = format!("{name} {}", arguments.join(" "));
        Self { name, executable, arguments, folder: root(), rank: Rank::Chore }
    }

    /// Runs it and shows what it printed.
    fn passes(&self) -> Result<bool> {
        let start = Instant::now();
        let output = Command::new(&self.executable)
            .args(self.arguments)
            .current_dir(&self.folder)
            .output()
            .with_context(|| format!("cannot start {}", self.executable.display()))?;
        // At once, so that the other program's stands before or after it.
        let mut out = std::io::stdout().lock();
        writeln!(out, "\n     Running {} ({})", self.name, self.executable.display())?;
        for printed in [&output.stdout, &output.stderr] {
            out.write_all(printed)?;
        }
        let (name, seconds) = (&self.name, start.elapsed().as_secs_f64());
        writeln!(out, "     {name} ended after {seconds:.1} s: {}", output.status)?;
        out.flush()?;
        Ok(output.status.success())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_that_waits_is_next_until_none_can_come() {
        let queue = Queue::default();
        let named = |rank| Program { rank, ..Program::of_chore(PathBuf::new(), "cargo", &[]) };
        thread::scope(|scope| {
            let ranks = scope.spawn(|| std::iter::from_fn(|| queue.next()).count());
            [Rank::Own, Rank::Chore, Rank::Beside].into_iter().for_each(|rank| queue.add(named(rank)));
            queue.close();
            assert_eq!(ranks.join().unwrap(), 3);
        });
        let queue = Queue::default();
        [Rank::Own, Rank::Chore, Rank::Beside].into_iter().for_each(|rank| queue.add(named(rank)));
        queue.close();
        let ranks: Vec<_> = std::iter::from_fn(|| queue.next()).map(|program| program.rank).collect();
        assert_eq!(ranks, [Rank::Chore, Rank::Beside, Rank::Own]);
    }

    #[test]
    fn programs_and_commands_are_known_from_what_cargo_says() {
        let message = r#"{"reason":"compiler-artifact","manifest_path":"/imf/crates/imf-gpu/Cargo.toml",
            "target":{"kind":["test"],"name":"gpu"},"profile":{"test":true},"executable":"/target/gpu-1"}"#;
        let program = Program {
            name: "imf-gpu (test gpu)".into(),
            executable: "/target/gpu-1".into(),
            arguments: &[],
            folder: "/imf/crates/imf-gpu".into(),
            rank: Rank::Beside,
        };
        assert_eq!(Built::of_message(message), Some(Built::Tests(program)));
        for (from, to) in [("true", "false"), ("\"/target/gpu-1\"", "null"), ("{", "")] {
            assert_eq!(Built::of_message(&message.replace(from, to)), None);
        }
        let command = message.replace("true", "false").replace("[\"test\"]", "[\"bin\"]");
        assert_eq!(
            Built::of_message(&command),
            Some(Built::Command(("/imf/crates/imf-gpu".into(), "gpu".into())))
        );
    }

    #[test]
    fn commands_that_tests_wait_for_are_those_that_cargo_builds_for_them() {
        let listed = commands().unwrap();
        let names: Vec<_> = listed.iter().map(|(_, name)| name.as_str()).collect();
        assert_eq!(names, ["imf-bench", "imf"]);
        assert!(listed.iter().all(|(folder, _)| folder.join("tests").is_dir()));
    }
}
