//! Ctrl-C ends the program at once. Work that saves what is finished ([`stop_cleanly`]) stops at the next safe place instead,
//! and only the second Ctrl-C ends it. Other work of the command is never cancelled, and need not say what a
//! cancellation leaves.

use std::borrow::Cow;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use imf_core::control::Cancelled;

use crate::output::eprint_line;
use thiserror::Error;

/// Signals closer together than this are one.
const DEBOUNCE: Duration = Duration::from_millis(500);

/// Set once the user wants to stop.
pub(crate) static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Number of works in progress that poll [`INTERRUPTED`] themselves.
static CLEAN_STOPS: AtomicUsize = AtomicUsize::new(0);

/// The message where the program ends at once.
static LAST_WORDS: Mutex<Cow<'static, str>> = Mutex::new(Cow::Borrowed(NOTHING_FINISHED));

/// By this variable tests interrupt a training after a number of its reports, however fast the machine is. Release
/// builds do not read it.
const AFTER_REPORTS: &str = "IMF_INTERRUPT_AFTER_REPORTS";

/// Whether work was asked to stop, and did: every error of ours that says so has [`Cancelled`] for its cause.
#[must_use]
pub fn is_cancelled(error: &anyhow::Error) -> bool {
    error.chain().any(<dyn std::error::Error>::is::<Cancelled>)
}

/// Work that the user cancelled; the text says what is saved.
#[derive(Debug, Error)]
#[error("interrupted: {0}")]
pub struct Interruption(pub String);

/// An interruption where work was cancelled, with what is saved; other errors stay as they are.
pub(crate) fn explained(error: impl Into<anyhow::Error>, saved: impl FnOnce() -> String) -> anyhow::Error {
    let error = error.into();
    if is_cancelled(&error) { Interruption(saved()).into() } else { error }
}

/// Ignores SIGXFSZ, as the write's error says the same, and gives back what ignores SIGHUP again where nohup had it ignored.
#[cfg(unix)]
fn ignored_signals() -> impl FnOnce() {
    #[expect(unsafe_code, reason = "the standard library sets no signals")]
    // SAFETY: ignoring a signal runs no code of ours.
    let ignore = |signal| unsafe { libc::signal(signal, libc::SIG_IGN) };
    ignore(libc::SIGXFSZ);
    let was_ignored = ignore(libc::SIGHUP) == libc::SIG_IGN;
    move || {
        if was_ignored {
            ignore(libc::SIGHUP);
        }
    }
}

#[cfg(not(unix))]
fn ignored_signals() -> impl FnOnce() {
    || ()
}

/// Starts listening for Ctrl-C, SIGTERM and SIGHUP; `aloud` where this process prints a message.
pub(crate) fn listen(aloud: bool) -> Result<()> {
    let ignore_again = ignored_signals();
    let mut first: Option<Instant> = None;
    ctrlc::set_handler(move || {
        if CLEAN_STOPS.load(Ordering::Relaxed) == 0 {
            if aloud {
                eprint_line(format_args!("\nimf: interrupted: {}", last_words()));
            }
            std::process::exit(i32::from(crate::exit::INTERRUPTED));
        }
        INTERRUPTED.store(true, Ordering::Relaxed);
        match first {
            // Wrappers send the signal to the program and to its group: one request, not two.
            Some(time) if time.elapsed() < DEBOUNCE => {}
            Some(_) => std::process::exit(i32::from(crate::exit::INTERRUPTED)),
            None => {
                first = Some(Instant::now());
                if aloud {
                    eprint_line(format_args!(
                        "\nimf: stopping at the next safe place; press Ctrl-C again to stop at once"
                    ));
                }
            }
        }
    })
    .context("cannot listen for Ctrl-C")?;
    ignore_again();
    Ok(())
}

/// The message where nothing is saved.
const NOTHING_FINISHED: &str = "nothing was finished; run the same command again to start over";

/// While this lives the work itself polls for an interruption, and saves what is finished.
#[must_use = "Ctrl-C ends the program at once as soon as this is dropped"]
pub struct CleanStop(());

/// From here on the work itself polls for an interruption.
pub fn stop_cleanly() -> CleanStop {
    CLEAN_STOPS.fetch_add(1, Ordering::Relaxed);
    CleanStop(())
}

impl Drop for CleanStop {
    fn drop(&mut self) {
        CLEAN_STOPS.fetch_sub(1, Ordering::Relaxed);
        // What the work itself has said is truer.
        if last_words() == NOTHING_FINISHED {
            leave(Cow::Borrowed("what was finished is kept; run the same command again"));
        }
    }
}

/// Sets the message for when the program ends at once.
pub(crate) fn leave(words: Cow<'static, str>) {
    *LAST_WORDS.lock().unwrap_or_else(PoisonError::into_inner) = words;
}

/// What is saved, where the program ends at once or work is cancelled.
pub(crate) fn last_words() -> Cow<'static, str> {
    LAST_WORDS.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// True once the user wants to stop.
pub fn requested() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}

/// Counts a report of a training: true once the user wants to stop, or a test does.
pub(crate) fn requested_at_report() -> bool {
    static REPORTS: AtomicU64 = AtomicU64::new(0);
    static LIMIT: OnceLock<u64> = OnceLock::new();
    if cfg!(debug_assertions) {
        let asked = || std::env::var(AFTER_REPORTS).ok().and_then(|text| text.parse().ok());
        let most = *LIMIT.get_or_init(|| asked().unwrap_or(u64::MAX));
        if REPORTS.fetch_add(1, Ordering::Relaxed) + 1 >= most {
            return true;
        }
    }
    requested()
}
