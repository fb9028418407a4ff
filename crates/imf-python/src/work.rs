//! Long calls: without the interpreter's lock, on all cores or a stated number, ended by Ctrl-C, with progress.
//!
//! The work is done by another thread. The one that called waits, and takes the interpreter's lock a few times a
//! second to handle signals and to report progress; where either raises, the work is asked to stop and the exception
//! goes on.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, LazyLock, Mutex, PoisonError, RwLock};
use std::time::Duration;

use imf_core::control::Control;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors::{Failure, value_error};

/// The pool of a stated number of threads; all cores where there is none.
static POOL: RwLock<Option<Arc<ThreadPool>>> = RwLock::new(None);
/// Threads that were asked for; 0 for all cores.
static COUNT: AtomicUsize = AtomicUsize::new(0);
/// The process that loaded the module, whose threads a fork of it has not.
static HOME: LazyLock<u32> = LazyLock::new(std::process::id);
/// The pool of a fork, with its process. A lock of its own, as another thread may have held that of [`POOL`] at the fork.
static FORKED: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

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
    COUNT.store(count, Ordering::Relaxed);
    if std::process::id() == *HOME {
        *POOL.write().unwrap_or_else(PoisonError::into_inner) = pool;
    } else if let Some((_, old)) = FORKED.lock().unwrap_or_else(PoisonError::into_inner).take() {
        std::mem::forget(old);
    }
    Ok(())
}

/// The pool to compute on; none where it is that of all cores.
///
/// # Errors
/// Threads that the system does not give to a fork.
fn current_pool() -> PyResult<Option<Arc<ThreadPool>>> {
    let own = std::process::id();
    if own == *HOME {
        return Ok(POOL.read().unwrap_or_else(PoisonError::into_inner).clone());
    }
    let mut forked = FORKED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, pool)) = forked.as_ref().filter(|(process, _)| *process == own) {
        return Ok(Some(pool.clone()));
    }
    let count = COUNT.load(Ordering::Relaxed);
    let pool = ThreadPoolBuilder::new().num_threads(count).build();
    let pool = Arc::new(pool.map_err(|error| value_error(format!("threads of a forked process: {error}")))?);
    // That of the process before has no threads here that could end.
    std::mem::forget(forked.replace((own, pool.clone())));
    Ok(Some(pool))
}

fn on<T: Send>(pool: Option<Arc<ThreadPool>>, work: impl FnOnce() -> T + Send) -> T {
    match pool {
        Some(pool) => pool.install(work),
        None => work(),
    }
}

/// Does `work`, which takes moments, without the interpreter's lock.
///
/// # Errors
/// As [`current_pool`].
pub(crate) fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let pool = current_pool()?;
    Ok(py.detach(|| on(pool, work)))
}

/// Takes note of the process that loads the module.
pub(crate) fn at_home() {
    LazyLock::force(&HOME);
}

/// Threads that compute.
pub(crate) fn threads() -> usize {
    let pool = current_pool().ok().flatten();
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
    let pool = current_pool()?;
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
                on(pool, || work(control))
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
