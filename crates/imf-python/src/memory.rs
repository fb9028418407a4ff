//! Work that would not fit into the memory that is free is refused before it starts: a notebook that the system ends loses everything.

use imf_core::glam::DVec3;
use imf_core::unit::DisplayLength;
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use sysinfo::{MemoryRefreshKind, RefreshKind, System};

/// Bytes that are free; more than there can be where the system does not say.
pub(crate) fn free() -> u64 {
    let what = RefreshKind::nothing().with_memory(MemoryRefreshKind::nothing().with_ram());
    let Ok(system) = System::new_with_specifics(what) else { return u64::MAX };
    let free = system.available_memory();
    // Inside a container its limit counts.
    let free = system.cgroup_limits().map_or(free, |limits| free.min(limits.free_memory));
    if free > 0 { free } else { u64::MAX }
}

/// Refuses what needs more bytes than are free; `what` says of what, and what takes less.
///
/// # Errors
/// `MemoryError`.
pub(crate) fn require(bytes: u64, what: impl FnOnce() -> String) -> PyResult<()> {
    let free = free();
    if bytes <= free {
        return Ok(());
    }
    let gigabytes = |bytes: u64| DisplayLength((bytes as f64 / 1e7).round() / 100.0).to_string();
    Err(PyMemoryError::new_err(format!(
        "this needs about {} GB of memory, and {} GB are free: {}",
        gigabytes(bytes),
        gigabytes(free),
        what()
    )))
}

/// Refuses a grid around boxes that needs more bytes than are free, at `each` for a voxel. With neither `dims` nor
/// `pitch` the pitch is chosen by the number of voxels, so nothing is refused.
///
/// # Errors
/// `MemoryError`.
pub(crate) fn require_for_voxels(
    dims: Option<[usize; 3]>,
    pitch: Option<f64>,
    margin: usize,
    boxes: impl Iterator<Item = (DVec3, DVec3)>,
    each: u64,
) -> PyResult<()> {
    let voxels = match (dims, pitch) {
        (Some(dims), _) => dims.iter().map(|&n| n as f64).product(),
        (None, Some(pitch)) if pitch > 0.0 => {
            let all = boxes.reduce(|(a, b), (c, d)| (a.min(c), b.max(d)));
            let size = all.map_or(DVec3::ZERO, |(lower, upper)| upper - lower);
            (size / pitch + 2.0 * margin as f64 + 1.0).element_product()
        }
        _ => 0.0,
    };
    require((voxels * each as f64) as u64, || format!("{voxels:.2e} voxels; use a larger pitch"))
}
