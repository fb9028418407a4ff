//! What holds for a whole run of the command: threads, memory limit, how much to say, and interruption.

use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Result, bail};
use imf_core::control::Control;
use serde::Serialize;
use sysinfo::{MemoryRefreshKind, RefreshKind, System};

use crate::arguments::GlobalArguments;
use crate::exit::WrongArgument;
use crate::interrupt;
use crate::output::eprint_line;
use crate::progress::Stage;
use crate::ranks::Rank;

/// Warnings and choices of a run; its results in JSON include them.
#[derive(Clone, Default, Serialize)]
pub(crate) struct Remarks {
    /// What is not as expected.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
    /// What was chosen for the user, and why.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    choices: Vec<String>,
}

impl Remarks {
    pub(crate) fn is_empty(&self) -> bool {
        self.warnings.is_empty() && self.choices.is_empty()
    }
}

static REMARKS: Mutex<Remarks> = Mutex::new(Remarks { warnings: Vec::new(), choices: Vec::new() });

/// Warnings and choices up to now.
pub(crate) fn remarks() -> MutexGuard<'static, Remarks> {
    REMARKS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Settings of one run.
pub struct Session {
    rank: Rank,
    threads: usize,
    /// Bytes that may be used.
    pub(crate) memory_limit: u64,
    /// Results are JSON.
    pub json: bool,
    quiet: bool,
    verbose: bool,
}

impl Session {
    /// Starts the thread pool and listens for Ctrl-C.
    pub fn new(global: &GlobalArguments, rank: Rank) -> Result<Self> {
        let mut pool = rayon::ThreadPoolBuilder::new();
        if let Some(threads) = global.threads {
            require_threads(threads)?;
            pool = pool.num_threads(threads);
        }
        pool.build_global().context("cannot start the threads")?;
        interrupt::listen(rank.is_first())?;
        // Where the system does not say, nothing is refused. Ranks on one machine share its memory.
        let share = |free: u64| free / 5 * 4 / rank.neighbours as u64;
        let memory_limit = global.memory.unwrap_or_else(|| free_memory().map_or(u64::MAX, share));
        Ok(Self {
            rank,
            threads: rayon::current_num_threads(),
            memory_limit,
            json: global.json,
            quiet: global.quiet || !rank.is_first(),
            verbose: global.verbose,
        })
    }

    /// A session that says nothing and has no limit, for tests.
    pub fn silent() -> Self {
        Self {
            threads: 1,
            rank: Rank::alone(),
            memory_limit: u64::MAX,
            json: false,
            quiet: true,
            verbose: false,
        }
    }

    /// Threads to compute with.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// This process among those that train together.
    pub fn rank(&self) -> Rank {
        self.rank
    }

    /// Refuses work that would not fit; `what` names the work and the remedy.
    pub fn require_memory(&self, bytes: u64, what: impl FnOnce() -> String) -> Result<()> {
        if bytes > self.memory_limit {
            bail!(
                "this needs about {} of memory, and {} may be used: {}; or raise --memory",
                show_bytes(bytes),
                show_bytes(self.memory_limit),
                what()
            );
        }
        Ok(())
    }

    /// A remark on standard error.
    pub fn note(&self, text: &str) {
        if !self.quiet {
            eprint_line(format_args!("{text}"));
        }
    }

    /// A remark that only --verbose shows.
    pub fn detail(&self, text: &str) {
        if self.verbose {
            eprint_line(format_args!("{text}"));
        }
    }

    /// Something is not as expected, though the work goes on. Shown even when quiet, and once.
    pub fn warn(&self, text: &str) {
        let warnings = &mut remarks().warnings;
        if self.rank.is_first() && !warnings.iter().any(|known| known == text) {
            eprint_line(format_args!("imf: warning: {text}"));
            warnings.push(text.to_owned());
        }
    }

    /// Something was chosen for the user; the text says what and why.
    pub(crate) fn choose(&self, text: &str) {
        let choices = &mut remarks().choices;
        if !choices.iter().any(|known| known == text) {
            self.note(text);
            choices.push(text.to_owned());
        }
    }

    /// A progress line with a rate and the time left, for `total` units.
    pub fn stage(&self, name: &str, unit: &'static str, total: u64) -> Stage {
        Stage::new(name, unit, total, self.quiet)
    }

    /// Does `work` as a stage of `total` units, with progress and cancellation. Where it succeeds a line stays.
    ///
    /// # Errors
    /// Those of `work`.
    pub fn staged<T, E>(
        &self,
        name: &str,
        unit: &'static str,
        total: u64,
        work: impl FnOnce(Control<'_>) -> Result<T, E>,
    ) -> Result<T, E> {
        let stage = self.stage(name, unit, total);
        let advance = |units| stage.advance(units);
        let made = work(self.control(&advance))?;
        stage.finish("");
        Ok(made)
    }

    /// As [`Self::stage`], for work that is mostly over at once and then not shown.
    pub(crate) fn brief_stage(&self, name: &str, unit: &'static str, total: u64) -> Stage {
        let mut stage = self.stage(name, unit, total);
        stage.brief = true;
        stage
    }

    /// Progress into `report`, cancellation by Ctrl-C.
    pub fn control<'a>(&self, report: &'a (dyn Fn(u64) + Sync)) -> Control<'a> {
        Control { progress: report, cancelled: &interrupt::INTERRUPTED }
    }
}

/// Most threads on any machine, and most for each core where it has many.
const MAX_THREADS: usize = 1024;
const MAX_THREADS_A_CORE: usize = 8;

/// Refuses no threads, and more than any machine has a use for: starting them alone would take minutes.
fn require_threads(threads: usize) -> Result<()> {
    if threads == 0 {
        return Err(WrongArgument("--threads must be at least 1".into()).into());
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let most = MAX_THREADS.max(MAX_THREADS_A_CORE * cores);
    if threads > most {
        let why = format!(
            "--threads {threads} are more than this machine has a use for: it has {cores} cores, and at most {most} threads are \
             started; leave it out for one a core"
        );
        return Err(WrongArgument(why).into());
    }
    Ok(())
}

/// Bytes that can be had without swapping.
fn free_memory() -> Option<u64> {
    let what = RefreshKind::nothing().with_memory(MemoryRefreshKind::nothing().with_ram());
    let system = System::new_with_specifics(what).ok()?;
    let free = system.available_memory();
    // Inside a container its limit counts.
    Some(system.cgroup_limits().map_or(free, |limits| free.min(limits.free_memory)))
        .filter(|&bytes| bytes > 0)
}

/// A size such as 512MiB, 2GiB, 4GB or a plain number of bytes.
pub(crate) fn parse_size(text: &str) -> Result<u64, String> {
    let split = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let (number, suffix) = text.split_at(split);
    let factor = match suffix.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kb" => 1e3,
        "kib" => 1024.0,
        "m" | "mb" => 1e6,
        "mib" => 1_048_576.0,
        "g" | "gb" => 1e9,
        "gib" => 1_073_741_824.0,
        _ => return Err(format!("'{suffix}' is not a unit of memory: use MiB or GiB")),
    };
    match number.parse::<f64>() {
        Ok(value) if value > 0.0 => Ok((value * factor) as u64),
        _ => Err(format!("'{text}' is not a size: write for example 2GiB")),
    }
}

/// Bytes in words.
pub fn show_bytes(bytes: u64) -> String {
    let value = bytes as f64;
    match value {
        v if v >= 1_073_741_824.0 => format!("{:.1} GiB", v / 1_073_741_824.0),
        v if v >= 1_048_576.0 => format!("{:.0} MiB", v / 1_048_576.0),
        v => format!("{:.0} KiB", v / 1024.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read() {
        assert_eq!(parse_size("2GiB"), Ok(2 << 30));
        assert_eq!(parse_size("1.5 MB"), Ok(1_500_000));
        assert_eq!(parse_size("77"), Ok(77));
        assert!(parse_size("many").is_err() && parse_size("5 apples").is_err() && parse_size("0").is_err());
    }

    #[test]
    fn free_memory_is_known() {
        assert!(free_memory().is_some_and(|bytes| bytes > 1 << 20));
    }
}
