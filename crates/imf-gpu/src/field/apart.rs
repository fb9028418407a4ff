//! Threads of their own for work that is done while a lock is held.

use std::sync::OnceLock;
use std::thread;

use imf_core::field::EngineError;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Does work that shares itself among threads, on threads that do nothing else, as many as there are here at the first call.
///
/// A thread of the caller's pool that holds a lock and shares its work waits for the others; while it waits it may be
/// given work that needs the same lock, or the others may all wait for it. No lock is taken on these threads, and the
/// caller waits for them without being given anything.
pub(super) fn apart<T: Send, E: From<EngineError> + Send>(
    work: impl FnOnce() -> Result<T, E> + Send,
) -> Result<T, E> {
    static POOL: OnceLock<Result<ThreadPool, String>> = OnceLock::new();
    let made = || {
        let threads = rayon::current_num_threads();
        ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| error.to_string())
    };
    let pool = POOL.get_or_init(made).as_ref().map_err(|error| EngineError::Device(error.clone()))?;
    thread::scope(|scope| match scope.spawn(|| pool.install(work)).join() {
        Ok(found) => found,
        Err(panic) => std::panic::resume_unwind(panic),
    })
}
