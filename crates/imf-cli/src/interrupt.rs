//! Ctrl-C: the first asks long work to stop at the next safe place, the second ends the program at once. While input is still
//! read and prepared there is nothing to keep, and the first one ends the program.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use crate::output::tell;
use thiserror::Error;

/// Signals closer together than this are one.
const SAME_WISH: Duration = Duration::from_millis(500);

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Set once there is work that looks at [`INTERRUPTED`] itself.
static AT_WORK: AtomicBool = AtomicBool::new(false);

/// By this variable tests interrupt a training after so many of its reports, however fast the machine is. Release builds do not
/// read it.
const AFTER_REPORTS: &str = "IMF_INTERRUPT_AFTER_REPORTS";

/// Work stopped because the user asked for it; the text says what is kept.
#[derive(Debug, Error)]
#[error("interrupted: {0}")]
pub struct Interrupted(pub String);

/// Starts listening for Ctrl-C (and a polite kill); `aloud` where this process answers it in words.
pub(crate) fn listen(aloud: bool) -> Result<()> {
    let mut first: Option<Instant> = None;
    ctrlc::set_handler(move || {
        INTERRUPTED.store(true, Ordering::Relaxed);
        if !AT_WORK.load(Ordering::Relaxed) {
            if aloud {
                tell(format_args!("\nimf: interrupted: {NOTHING_FINISHED}"));
            }
            std::process::exit(i32::from(crate::exit::INTERRUPTED));
        }
        match first {
            // Wrappers send the signal to the program and to its group: one wish, not two.
            Some(time) if time.elapsed() < SAME_WISH => {}
            Some(_) => std::process::exit(i32::from(crate::exit::INTERRUPTED)),
            None => {
                first = Some(Instant::now());
                if aloud {
                    tell(format_args!(
                        "\nimf: stopping at the next safe place; press Ctrl-C again to stop at once"
                    ));
                }
            }
        }
    })
    .context("cannot listen for Ctrl-C")
}

/// What is said where nothing is kept.
pub(crate) const NOTHING_FINISHED: &str = "nothing was finished; run the same command again to start over";

/// From here on the work itself looks whether the user wants to stop, and keeps what is finished.
pub(crate) fn work_begins() {
    AT_WORK.store(true, Ordering::Relaxed);
}

/// Set once the user wants to stop.
pub fn flag() -> &'static AtomicBool {
    &INTERRUPTED
}

/// True once the user wants to stop.
pub fn requested() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}

/// Counts a report of a training: true once the user wants to stop, or a test does.
pub(crate) fn requested_at_report() -> bool {
    static REPORTS: AtomicU64 = AtomicU64::new(0);
    static MOST: OnceLock<u64> = OnceLock::new();
    if cfg!(debug_assertions) {
        let asked = || std::env::var(AFTER_REPORTS).ok().and_then(|text| text.parse().ok());
        let most = *MOST.get_or_init(|| asked().unwrap_or(u64::MAX));
        if REPORTS.fetch_add(1, Ordering::Relaxed) + 1 >= most {
            return true;
        }
    }
    requested()
}
