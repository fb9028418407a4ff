//! Ctrl-C: the first asks long work to stop at the next safe place, the second ends the program at once.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Work stopped because the user asked for it; the text says what is kept.
#[derive(Debug)]
pub(crate) struct Interrupted(pub(crate) String);

impl std::fmt::Display for Interrupted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "interrupted: {}", self.0)
    }
}

impl std::error::Error for Interrupted {}

/// Starts listening for Ctrl-C (and a polite kill).
pub(crate) fn listen() -> Result<()> {
    ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(crate::INTERRUPTED));
        }
        eprintln!("\nimf: stopping at the next safe place; press Ctrl-C again to stop at once");
    })
    .context("cannot listen for Ctrl-C")
}

/// Set once the user wants to stop.
pub(crate) fn flag() -> &'static AtomicBool {
    &INTERRUPTED
}

/// True once the user wants to stop.
pub(crate) fn requested() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}
