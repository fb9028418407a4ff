//! What a fit takes of memory, and the degree that a limit allows or that an error asks for.

use super::sections::{KeptSections, memory_by_parts};
use super::{VALIDATED_AT_ONCE, batch_size, estimate, fitted_grid};
use crate::harmonic::HarmonicError;
use crate::harmonic::basis::Domain;
use crate::harmonic::coefficients::Precision;
use crate::harmonic::settings::{FitReport, FitSettings, MOST_DEGREE, Sizes};
use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::section::SectionPlan;

/// Degrees that are tried for an error, each some 1.7 times as many functions as the one before.
const TRIED: [usize; 9] = [3, 5, 7, 10, 14, 18, 24, 31, MOST_DEGREE];

impl FitSettings {
    /// Bytes at the peak of making a field over `voxels` voxels, and of the field itself; where all functions of directions
    /// are kept it may be less ([`FitSettings::memory_with`]).
    pub fn memory(&self, domain: Domain, voxels: usize) -> (u64, u64) {
        let Sizes { functions, sections, axes } = self.sizes(domain);
        let field = (voxels * axes) as u64 * self.precision.bytes();
        let made = (voxels * axes * 4) as u64 + if self.precision == Precision::F32 { 0 } else { field };
        let batch = (batch_size(voxels, sections) * voxels * 4) as u64;
        let sampled = self.sample_bytes(domain, voxels);
        let peak = if self.one_pass {
            KeptSections::memory(sections, voxels) + field.max(sampled)
        } else {
            made.max(sampled) + batch
        };
        (peak + square_bytes(functions), field)
    }

    /// Bytes at the peak of making a field of what `plan`'s sections are, and of the field itself.
    pub fn memory_with(&self, plan: &SectionPlan, domain: Domain) -> (u64, u64) {
        self.memory_over(plan, &fitted_grid(plan, domain, self.quantity), domain)
    }

    /// The same where `fitted`, the whole grid or one side of it, is what is fitted.
    pub(super) fn memory_over(&self, plan: &SectionPlan, fitted: &Grid, domain: Domain) -> (u64, u64) {
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
        // What is judged on one side for the others as well.
        let sides = plan.grid().len().div_ceil(voxels);
        let judged = (self.sample.min(voxels) * self.held_out * (sides - 1) * 4) as u64;
        ((peak + judged).max(own + field).max(validated), field)
    }

    /// Bytes at the peak of deciding on a field's functions by a sample of its `voxels` voxels.
    pub fn outline_memory(&self, domain: Domain, voxels: usize) -> u64 {
        self.sample_bytes(domain, voxels) + square_bytes(self.sizes(domain).functions)
    }

    /// What the sample of voxels takes, by estimate.
    fn sample_bytes(&self, domain: Domain, voxels: usize) -> u64 {
        let Sizes { functions, sections, .. } = self.sizes(domain);
        (self.sample.min(voxels) * (sections + self.held_out + functions) * 4) as u64
    }

    /// The highest degree at which making a field of what `plan`'s sections are takes at most `bytes`; `None` where degree 0
    /// takes more. All axes are kept where these settings say so; where one pass does not fit, two may.
    pub fn degree_within(&self, plan: &SectionPlan, domain: Domain, bytes: u64) -> Option<usize> {
        let fitted = fitted_grid(plan, domain, self.quantity);
        let fits = |&degree: &usize| {
            [true, false].into_iter().any(|one_pass| {
                Self { degree, one_pass, ..*self }.memory_over(plan, &fitted, domain).0 <= bytes
            })
        };
        (0..=MOST_DEGREE).take_while(fits).last()
    }
}

/// The matrices of all functions together.
fn square_bytes(functions: usize) -> u64 {
    (functions * functions * 8 * 8) as u64
}

/// The lowest of some degrees up to `most` whose expected mean squared error is at most `target`, by fits to a sample of
/// voxels; else the best of them. Gives the settings, and what is expected. One unit of progress is one
/// section of [`sections_tried`].
///
/// # Errors
/// As [`super::fit`].
pub fn degree_for(
    plan: &SectionPlan,
    domain: Domain,
    settings: &FitSettings,
    target: f64,
    most: usize,
    control: Control<'_>,
) -> Result<(FitSettings, FitReport), HarmonicError> {
    let mut best: Option<(FitSettings, FitReport)> = None;
    for degree in degrees(most) {
        let tried = FitSettings { degree, ..*settings };
        let report = estimate(plan, domain, &tried, control)?;
        if best.as_ref().is_none_or(|(_, best)| report.expected_mse() < best.expected_mse()) {
            best = Some((tried, report));
        }
        if report.expected_mse() <= target {
            break;
        }
    }
    best.ok_or_else(|| HarmonicError::Settings("no degree to try".into()))
}

/// Sections that [`degree_for`] computes at most.
pub fn sections_tried(domain: Domain, settings: &FitSettings, most: usize) -> usize {
    let of = |degree| {
        let tried = FitSettings { degree, ..*settings };
        tried.sizes(domain).sections + tried.held_out
    };
    degrees(most).map(of).sum()
}

fn degrees(most: usize) -> impl Iterator<Item = usize> {
    TRIED.into_iter().filter(move |&degree| degree < most).chain([most])
}
