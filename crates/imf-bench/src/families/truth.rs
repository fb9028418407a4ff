//! How far a field is from the exact one at orientations that it was not made from, and how often it decides wrongly.

use anyhow::{Result, bail};
use imf_cli::interrupt;
use imf_cli::session::Session;
use imf_core::orientation::Orientation;
use imf_core::section::{SectionError, SectionPlan, sections};
use imf_fields::metrics::{ErrorReport, Errors};
use imf_train::dataset::boundary;
use serde::Serialize;

use crate::candidates::Candidate;

/// Sections at a time.
const AT_ONCE: usize = 16;
/// Fraction of the colliding poses that may be called free where thresholds are compared.
pub(super) const ALLOWED: f64 = 0.01;

/// Exact sections, and where they turn from free to colliding.
pub(super) struct Truth<'a> {
    session: &'a Session,
    orientations: &'a [Orientation],
    exact: Vec<Vec<f32>>,
    /// 1 at the boundary, `[orientation][voxel]`.
    near: Vec<Vec<bool>>,
    threshold: f64,
}

/// How far a field is from it.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Verdict {
    /// Over all positions.
    pub(super) everywhere: ErrorReport,
    /// Over positions near the boundary alone.
    pub(super) near: ErrorReport,
    /// With the highest threshold at which at most [`ALLOWED`] of the colliding poses near the boundary are called free,
    /// the fraction of the free ones there that are called colliding.
    pub(super) colliding_when_safe: f64,
}

impl<'a> Truth<'a> {
    /// Counts the sections to compare with. `width` in voxels is what counts as near.
    pub(super) fn new(
        session: &'a Session,
        plan: &SectionPlan,
        orientations: &'a [Orientation],
        width: usize,
        threshold: f64,
    ) -> Result<Self> {
        let exact = sections(plan, orientations, session.control(&|_| {}))?;
        let near = exact.iter().map(|cmf| boundary(cmf, plan.grid().dims, width)).collect();
        Ok(Self { session, orientations, exact, near, threshold })
    }

    /// Bytes that it holds, for so many orientations and voxels, with the values asked for at a time.
    pub(super) fn memory(orientations: usize, voxels: usize) -> u64 {
        ((5 * orientations + 4 * AT_ONCE) * voxels) as u64
    }

    pub(super) fn compare(&self, field: &Candidate<'_>) -> Result<Verdict> {
        let voxels = self.exact.first().map_or(0, Vec::len);
        let mut values = vec![0.0; AT_ONCE.min(self.orientations.len()) * voxels];
        let (mut everywhere, mut near) = (Errors::default(), Errors::default());
        let (mut free, mut colliding) = (Vec::new(), Vec::new());
        for (chunk, orientations) in self.orientations.chunks(AT_ONCE).enumerate() {
            if interrupt::requested() {
                bail!(SectionError::Cancelled);
            }
            let values = &mut values[..orientations.len() * voxels];
            field.sections(orientations, values)?;
            for (place, values) in values.chunks_exact(voxels).enumerate() {
                let index = chunk * AT_ONCE + place;
                let exact = &self.exact[index];
                everywhere.add(exact, values, self.threshold);
                let (mut close, mut own) = (Vec::new(), Vec::new());
                for ((&exact, &value), &at) in exact.iter().zip(values).zip(&self.near[index]) {
                    if at {
                        close.push(exact);
                        own.push(value);
                        if exact > 0.0 { colliding.push(value) } else { free.push(value) }
                    }
                }
                near.add(&close, &own, self.threshold);
            }
        }
        self.session.detail(&format!("{} poses near the boundary", free.len() + colliding.len()));
        Ok(Verdict {
            everywhere: everywhere.report(self.threshold),
            near: near.report(self.threshold),
            colliding_when_safe: colliding_when_safe(&mut colliding, &free),
        })
    }
}

/// The fraction of `free` values above the highest threshold that calls at most [`ALLOWED`] of `colliding` free.
fn colliding_when_safe(colliding: &mut [f32], free: &[f32]) -> f64 {
    colliding.sort_unstable_by(f32::total_cmp);
    let allowed = (colliding.len() as f64 * ALLOWED) as usize;
    // A threshold calls free what is at most it, so it lies just below the first value that must not pass.
    let first = colliding.get(allowed).copied().unwrap_or(f32::INFINITY);
    let alarms = free.iter().filter(|&&value| value >= first).count();
    if free.is_empty() { 0.0 } else { alarms as f64 / free.len() as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_safe_threshold_passes_one_in_a_hundred() {
        // 200 colliding values 0.001, 0.002, … : two may be called free, so the threshold lies just below 0.003.
        let mut colliding: Vec<f32> = (1..=200).rev().map(|i| i as f32 / 1000.0).collect();
        assert_eq!(colliding_when_safe(&mut colliding, &[0.0, 0.0029, 0.0031, 0.5]), 0.5);
        // A field that is zero where the tool collides must call every zero colliding.
        assert_eq!(colliding_when_safe(&mut [0.0; 50], &[0.0, 0.0]), 1.0);
        assert_eq!(colliding_when_safe(&mut [], &[0.2]), 0.0);
    }
}
