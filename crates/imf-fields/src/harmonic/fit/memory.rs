//! What a fit takes of memory.

use super::sections::{CachedSections, memory_by_parts};
use super::{VALIDATED_AT_ONCE, batch_size, fitted_grid, rough_count};
use crate::harmonic::basis::Domain;
use crate::harmonic::coefficients::StoragePrecision;
use crate::harmonic::settings::{FitSettings, Sizes};
use imf_core::section::SectionPlan;

impl FitSettings {
    /// Bytes at the peak of making a field over `voxels` voxels, and of the field itself; where all functions of
    /// directions are retained it may be less ([`FitSettings::memory_with`]).
    pub fn memory(&self, domain: Domain, voxels: usize) -> (u64, u64) {
        let Sizes { functions, sections, components } = self.sizes(domain);
        let field = (voxels * components) as u64 * self.precision.bytes();
        let made = (voxels * components * 4) as u64
            + if self.precision == StoragePrecision::F32 { 0 } else { field };
        let batch = (batch_size(voxels, sections) * voxels * 4) as u64;
        let sampled = self.sample_bytes(domain, voxels);
        let peak = if self.one_pass {
            CachedSections::memory(sections, voxels) + field.max(sampled)
        } else {
            made.max(sampled) + batch
        };
        (peak + square_bytes(functions), field)
    }

    /// Bytes at the peak of making a field of what `plan`'s sections are, and of the field itself.
    pub fn memory_with(&self, plan: &SectionPlan, domain: Domain) -> (u64, u64) {
        let fitted = fitted_grid(plan, domain, self.quantity);
        let (voxels, whole) = (fitted.len(), plan.grid().len() as u64);
        let (mut peak, own) = self.memory(domain, voxels);
        // The finished field beside exact sections and its own.
        let validated = own / voxels as u64 * whole + 8 * whole * VALIDATED_AT_ONCE.min(self.held_out) as u64;
        let Sizes { functions, sections, .. } = self.sizes(domain);
        if self.one_pass
            && self.in_classes(domain)
            && let Some(parts) = memory_by_parts(plan, fitted.dims, sections)
        {
            peak = parts + own + self.sample_bytes(domain, voxels) + square_bytes(functions);
        }
        if voxels == plan.grid().len() {
            return (peak.max(validated), own);
        }
        let field = own / voxels as u64 * plan.grid().len() as u64;
        // Values of the mirror images, which count for the means together with one side's.
        let sides = plan.grid().len().div_ceil(voxels);
        let rough = (self.sample.min(voxels) * rough_count(domain, self) * (sides - 1) * 4) as u64;
        ((peak + rough).max(own + field).max(validated), field)
    }

    /// What the sample of voxels takes, by estimate.
    fn sample_bytes(&self, domain: Domain, voxels: usize) -> u64 {
        let Sizes { functions, sections, .. } = self.sizes(domain);
        (self.sample.min(voxels) * (sections + rough_count(domain, self) + functions) * 4) as u64
    }
}

/// The matrices of all functions together.
fn square_bytes(functions: usize) -> u64 {
    (functions * functions * 8 * 8) as u64
}
