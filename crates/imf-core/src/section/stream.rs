//! Streaming over orientations: sections are computed, visited and dropped, so memory does not grow with their number.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::{DepthPlan, DepthScratch, Quantity, SectionError, SectionPlan, SectionScratch};
use crate::control::Control;
use crate::orientation::Orientation;
use crate::parallel;

/// The inaccessibility measure field: the minimum collision measure over a set of orientations.
#[derive(Clone, Debug, PartialEq)]
pub struct Imf {
    /// IMF at every voxel, C-ordered, in [0, 1].
    pub value: Vec<f32>,
    /// Index of the orientation that has it; the lowest one at a tie.
    pub best: Vec<u32>,
}

impl Imf {
    /// No orientation yet.
    #[must_use]
    pub fn new(voxels: usize) -> Self {
        Self { value: vec![f32::INFINITY; voxels], best: vec![u32::MAX; voxels] }
    }

    /// Takes a section of orientation `index` into account.
    pub fn lower_to(&mut self, index: usize, cmf: &[f32]) {
        let index = index as u32;
        for ((value, best), &candidate) in self.value.iter_mut().zip(&mut self.best).zip(cmf) {
            // Without branches, so that many voxels are compared at once.
            let better = (candidate < *value) | ((candidate == *value) & (index < *best));
            *value = if better { candidate } else { *value };
            *best = if better { index } else { *best };
        }
    }

    /// Clamps values as fields give them on a grid of this pitch ([`Quantity::clamp`]).
    pub fn clamp(&mut self, quantity: Quantity, pitch: f64) {
        self.value.iter_mut().for_each(|value| *value = quantity.clamp(*value, pitch));
    }

    /// Takes the result of other orientations of the same set into account.
    pub fn merge(&mut self, other: &Self) {
        let theirs = other.value.iter().zip(&other.best);
        for ((value, best), (&candidate, &index)) in self.value.iter_mut().zip(&mut self.best).zip(theirs) {
            if candidate < *value || (candidate == *value && index < *best) {
                *value = candidate;
                *best = index;
            }
        }
    }
}

/// The exact inaccessibility measure field over `orientations`, on all threads of the current pool. The result does
/// not depend on their number. One unit of progress is one orientation.
///
/// # Errors
/// As [`SectionPlan::cmf`]; [`SectionError::Cancelled`] when the control asks to stop.
pub fn imf(
    plan: &SectionPlan,
    orientations: &[Orientation],
    control: Control<'_>,
) -> Result<Imf, SectionError> {
    let voxels = plan.grid().len();
    let parts = stream_sections(plan, orientations, control, || Imf::new(voxels), Imf::lower_to)?;
    let mut whole = Imf::new(voxels);
    for part in &parts {
        whole.merge(part);
    }
    Ok(whole)
}

/// Computes the sections of `orientations` on all threads of the current pool and shows each to `visit` with its
/// index, in no fixed order. Every thread has its own visitor, made by `start`; all are returned.
///
/// # Errors
/// The first failure of a section; [`SectionError::Cancelled`] when the control asks to stop.
pub fn stream_sections<V: Send>(
    plan: &SectionPlan,
    orientations: &[Orientation],
    control: Control<'_>,
    start: impl Fn() -> V + Sync,
    visit: impl Fn(&mut V, usize, &[f32]) + Sync,
) -> Result<Vec<V>, SectionError> {
    if orientations.len() > 1 {
        plan.whole.prepare(&plan.query);
    }
    let scratch = || (start(), SectionScratch::default(), vec![0.0; plan.grid().len()]);
    let parts =
        stream_orientations(orientations.len(), control, scratch, |(visitor, scratch, cmf), index| {
            plan.cmf(&orientations[index], scratch, cmf)?;
            visit(visitor, index, cmf);
            Ok::<(), SectionError>(())
        })?;
    Ok(parts.into_iter().map(|(visitor, ..)| visitor).collect())
}

/// The same for depths.
///
/// # Errors
/// As [`stream_sections`].
pub fn stream_depths<V: Send>(
    plan: &DepthPlan,
    orientations: &[Orientation],
    control: Control<'_>,
    start: impl Fn() -> V + Sync,
    visit: impl Fn(&mut V, usize, &[f32]) + Sync,
) -> Result<Vec<V>, SectionError> {
    let scratch = || (start(), DepthScratch::default(), vec![0.0; plan.grid().len()]);
    let parts =
        stream_orientations(orientations.len(), control, scratch, |(visitor, scratch, depths), index| {
            plan.depths(&orientations[index], scratch, depths)?;
            visit(visitor, index, depths);
            Ok::<(), SectionError>(())
        })?;
    Ok(parts.into_iter().map(|(visitor, ..)| visitor).collect())
}

/// The sections of a set, each in its own array, on all threads of the current pool.
///
/// # Errors
/// As [`SectionPlan::cmf`]; [`SectionError::Cancelled`] when the control asks to stop.
pub fn sections(
    plan: &SectionPlan,
    orientations: &[Orientation],
    control: Control<'_>,
) -> Result<Vec<Vec<f32>>, SectionError> {
    let parts = stream_sections(plan, orientations, control, Vec::new, |list: &mut Vec<_>, index, cmf| {
        list.push((index, cmf.to_vec()));
    })?;
    let mut all: Vec<(usize, Vec<f32>)> = parts.into_iter().flatten().collect();
    all.sort_by_key(|&(index, _)| index);
    Ok(all.into_iter().map(|(_, cmf)| cmf).collect())
}

/// Shows the indices `0..count` to `visit`, each once and in no fixed order, on all threads of the current pool. Every
/// thread has its own visitor, made by `start`; all are returned. One unit of progress is one index.
///
/// # Errors
/// The first failure of a visit; [`SectionError::Cancelled`] when the control asks to stop.
pub(crate) fn stream_orientations<V: Send, E: From<SectionError> + Send>(
    count: usize,
    control: Control<'_>,
    start: impl Fn() -> V + Sync,
    visit: impl Fn(&mut V, usize) -> Result<(), E> + Sync,
) -> Result<Vec<V>, E> {
    let next = AtomicUsize::new(0);
    let finished = Mutex::new(Ok(Vec::new()));
    let work = || -> Result<V, E> {
        let mut visitor = start();
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= count {
                return Ok(visitor);
            }
            control.check().map_err(SectionError::from)?;
            visit(&mut visitor, index)?;
            (control.progress)(1);
        }
    };
    parallel::on_each_thread(count, || {
        let result = work();
        if result.is_err() {
            next.store(usize::MAX / 2, Ordering::Relaxed);
        }
        let mut all = finished.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        match (&mut *all, result) {
            (Ok(list), Ok(visitor)) => list.push(visitor),
            (state @ Ok(_), Err(error)) => *state = Err(error),
            (Err(_), _) => {}
        }
    });
    finished.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner)
}
