//! How long work reports its progress and learns that it should stop.

use std::sync::atomic::{AtomicBool, Ordering};

/// Progress and cancellation of a long computation, shared by its threads.
#[derive(Clone, Copy)]
pub struct Control<'a> {
    /// Called with the number of units just finished, from any thread.
    pub progress: &'a (dyn Fn(u64) + Sync),
    /// Set by the caller, for example at Ctrl-C: work stops at the next unit.
    pub cancelled: &'a AtomicBool,
}

static NEVER: AtomicBool = AtomicBool::new(false);

impl Control<'_> {
    /// Reports to nobody and is never cancelled.
    #[must_use]
    pub fn quiet() -> Self {
        Self { progress: &|_| {}, cancelled: &NEVER }
    }

    /// True once the caller wants the work to stop.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}
