//! The machine that is measured, the clock, and the memory.

use std::fmt;
use std::time::Instant;

use anyhow::Result;
use serde::Serialize;
use sysinfo::{CpuRefreshKind, RefreshKind, System};

/// Works of this program are measured this often.
pub(crate) const ROUNDS: usize = 3;
/// A single measurement shorter than this is repeated, and the better one counts.
const SHORT: f64 = 1.0;

/// The machine, and how much of it was used.
#[derive(Serialize)]
pub(crate) struct Machine {
    cpu: String,
    threads: usize,
    version: &'static str,
    system: String,
    /// Mean number of threads that wanted to run over the last minute, when the measurement began and when it ended: on
    /// an idle machine near 0 and near `threads`. Nothing where the system does not say.
    load: Option<[f64; 2]>,
}

impl Machine {
    pub(crate) fn new(threads: usize) -> Self {
        let system = System::new_with_specifics(RefreshKind::nothing().with_cpu(CpuRefreshKind::nothing()));
        let cpu = system.ok().and_then(|s| s.cpus().first().map(|cpu| cpu.brand().trim().to_owned()));
        Self {
            cpu: cpu.filter(|name| !name.is_empty()).unwrap_or_else(|| "unknown CPU".into()),
            threads,
            version: env!("CARGO_PKG_VERSION"),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            load: load().map(|begin| [begin; 2]),
        }
    }

    /// What its times are of, in short.
    pub(crate) fn name(&self) -> String {
        format!("{}, {} threads", self.cpu, self.threads)
    }

    /// Notes the load at the end.
    pub(crate) fn finish(&mut self) {
        self.load = self.load.zip(load()).map(|([begin, _], end)| [begin, end]);
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}, imf {}", self.name(), self.system, self.version)?;
        match self.load {
            Some([begin, end]) => write!(f, ", load {begin:.1} at the beginning, {end:.1} at the end"),
            None => Ok(()),
        }
    }
}

/// The load of the last minute.
fn load() -> Option<f64> {
    System::load_average().ok().map(|load| load.one)
}

/// Resets the peak memory of this process. Linux only.
pub(crate) fn reset_peak_memory() {
    // Where it is not allowed, the peak stays that of the whole run.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// Peak memory in bytes of this process since then; `None` where the system does not report it.
pub(crate) fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Seconds of some work.
pub(crate) fn seconds<T>(work: impl FnOnce() -> Result<T>) -> Result<(f64, T)> {
    let begun = Instant::now();
    let found = work()?;
    Ok((begun.elapsed().as_secs_f64(), found))
}

/// Seconds of some work: of a short one the better of two.
pub(crate) fn better_seconds<T>(mut work: impl FnMut() -> Result<T>) -> Result<(f64, T)> {
    let (first, found) = seconds(&mut work)?;
    if first >= SHORT {
        return Ok((first, found));
    }
    drop(found);
    let (second, found) = seconds(work)?;
    Ok((first.min(second), found))
}

/// The minimum seconds of each work, all by turns: a busy moment then slows none of them alone.
pub(crate) fn minimum_seconds<const N: usize>(
    rounds: usize,
    mut works: [&mut dyn FnMut() -> Result<()>; N],
) -> Result<[f64; N]> {
    let mut least = [f64::INFINITY; N];
    for _ in 0..rounds {
        for (work, least) in works.iter_mut().zip(&mut least) {
            *least = least.min(seconds(work)?.0);
        }
    }
    Ok(least)
}
