//! Long calls: without the interpreter's lock, on all cores or a stated number, ended by Ctrl-C, with progress.
//!
//! The work is done by another thread. The one that called waits, and takes the interpreter's lock a few times a
//! second to handle signals and to report progress; where either raises, the work is asked to stop and the exception
//! goes on.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use imf_core::control::Control;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors::{Failure, value_error};

/// The pool of a stated number of threads; all cores where there is none.
static POOL: RwLock<Option<Arc<ThreadPool>>> = RwLock::new(None);

/// A callback of a stage's name, the units that are done, and how many there are.
pub(crate) type Progress<'py> = Option<Bound<'py, PyAny>>;

/// First wait for the work, which is short for most calls, and the longest.
const WAITS: [Duration; 2] = [Duration::from_millis(5), Duration::from_millis(100)];

/// Most threads on any machine, and most for each core where it has many, as in the command: starting more takes minutes.
const MAX_THREADS: usize = 1024;
const MAX_THREADS_A_CORE: usize = 8;

/// Computes on `threads` threads from now on; all cores with 0.
///
/// # Errors
/// What is no number of threads, more than a machine has a use for, and those that the system does not give.
#[pyfunction]
pub(crate) fn set_threads(py: Python<'_>, threads: &Bound<'_, PyAny>) -> PyResult<()> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let most = MAX_THREADS.max(MAX_THREADS_A_CORE * cores);
    let count: Option<usize> = threads.extract().ok().filter(|&count| count <= most);
    let Some(count) = count else {
        return Err(value_error(format!(
            "threads must be a whole number from 0, all of the {cores} cores, to {most}, not {}",
            threads.repr()?
        )));
    };
    let pool = match count {
        0 => None,
        _ => {
            let pool = py.detach(|| ThreadPoolBuilder::new().num_threads(count).build());
            Some(Arc::new(pool.map_err(|error| value_error(format!("{count} threads: {error}")))?))
        }
    };
    *POOL.write().unwrap_or_else(PoisonError::into_inner) = pool;
    Ok(())
}

/// Threads that compute.
pub(crate) fn threads() -> usize {
    let pool = POOL.read().unwrap_or_else(PoisonError::into_inner).clone();
    pool.map_or_else(rayon::current_num_threads, |pool| pool.current_num_threads())
}

/// Does `work` without the interpreter's lock; `total` are its units of progress.
///
/// # Errors
/// What the work reports, `KeyboardInterrupt`, and what the callback raises.
pub(crate) fn run<T: Send, E: Into<Failure> + Send>(
    py: Python<'_>,
    (progress, stage, total): (&Progress<'_>, &str, u64),
    work: impl FnOnce(Control<'_>) -> Result<T, E> + Send,
) -> PyResult<T> {
    let (done, cancelled) = (AtomicU64::new(0), AtomicBool::new(false));
    let callback = progress.as_ref().map(|callback| callback.clone().unbind());
    let pool = POOL.read().unwrap_or_else(PoisonError::into_inner).clone();
    let report = |py: Python<'_>, said: u64| -> PyResult<u64> {
        let now = done.load(Ordering::Relaxed).min(total);
        if let Some(callback) = callback.as_ref().filter(|_| now != said) {
            callback.call1(py, (stage, now, total))?;
        }
        Ok(now)
    };
    // No call of the callback says this number.
    let mut said = u64::MAX;
    let (result, raised) = py.detach(|| {
        let add = |units: u64| {
            done.fetch_add(units, Ordering::Relaxed);
        };
        let control = Control { progress: &add, cancelled: &cancelled };
        std::thread::scope(|scope| {
            let (end, ended) = channel::<()>();
            let worker = scope.spawn(move || {
                let _end = end;
                match pool {
                    Some(pool) => pool.install(|| work(control)),
                    None => work(control),
                }
            });
            let (mut wait, mut raised) = (WAITS[0], None);
            while ended.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
                wait = (2 * wait).min(WAITS[1]);
                if raised.is_some() {
                    continue;
                }
                let heard = Python::attach(|py| {
                    py.check_signals()?;
                    report(py, said)
                });
                match heard {
                    Ok(now) => said = now,
                    Err(error) => {
                        raised = Some(error);
                        cancelled.store(true, Ordering::Relaxed);
                    }
                }
            }
            (worker.join(), raised)
        })
    });
    match (result, raised) {
        (Err(panic), _) => std::panic::resume_unwind(panic),
        (_, Some(error)) => Err(error),
        (Ok(Err(error)), None) => {
            let failure: Failure = error.into();
            Err(failure.into())
        }
        (Ok(Ok(value)), None) => {
            if let Some(callback) = callback.as_ref().filter(|_| said != total) {
                callback.call1(py, (stage, total, total))?;
            }
            Ok(value)
        }
    }
}
