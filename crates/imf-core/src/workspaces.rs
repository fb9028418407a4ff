//! A pool of scratch memory for threads.

use std::sync::{Mutex, PoisonError};

/// A pool with as many scratch memories as threads needed at once.
pub struct Workspaces<T> {
    free: Mutex<Vec<T>>,
}

impl<T> Default for Workspaces<T> {
    fn default() -> Self {
        Self { free: Mutex::new(Vec::new()) }
    }
}

impl<T: Default> Workspaces<T> {
    /// Runs `work` with a memory whose content is left over from earlier work.
    pub fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        let free = self.free.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut memory = free.unwrap_or_default();
        let result = work(&mut memory);
        self.free.lock().unwrap_or_else(PoisonError::into_inner).push(memory);
        result
    }
}
