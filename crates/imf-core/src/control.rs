//! Progress reports and cancellation of long computations.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};

use thiserror::Error;

/// Progress and cancellation of a long computation, shared by its threads.
#[derive(Clone, Copy)]
pub struct Control<'a> {
    /// Called with the number of units just finished, from any thread.
    pub progress: &'a (dyn Fn(u64) + Sync),
    /// Set by the caller, for example at Ctrl-C: work stops at the next unit.
    pub cancelled: &'a AtomicBool,
}

/// The caller's [`Control`] asked to stop.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("interrupted")]
pub struct Cancelled;

impl fmt::Debug for Control<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Control").field("cancelled", self.cancelled).finish_non_exhaustive()
    }
}

static NEVER: AtomicBool = AtomicBool::new(false);

impl Control<'_> {
    /// Ignores progress and is never cancelled.
    #[must_use]
    pub fn quiet() -> Self {
        Self { progress: &|_| {}, cancelled: &NEVER }
    }

    /// True once the caller wants the work to stop.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Nothing, or [`Cancelled`] once the caller wants the work to stop.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn check(&self) -> Result<(), Cancelled> {
        if self.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    }
}
