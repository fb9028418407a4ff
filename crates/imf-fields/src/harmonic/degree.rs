//! The degree that a memory limit allows, or that an error asks for.

use super::HarmonicError;
use super::basis::Domain;
use super::fit::{FitReport, FitSettings, MOST_DEGREE, estimate, fitted_grid};
use imf_core::control::Control;
use imf_core::section::SectionPlan;

/// Degrees that are tried for an error, each some 1.7 times as many functions as the one before.
const TRIED: [usize; 9] = [3, 5, 7, 10, 14, 18, 24, 31, MOST_DEGREE];

impl FitReport {
    /// Mean squared error to expect at orientations that were not fitted, dropped axes and all.
    #[must_use]
    pub fn expected_mse(&self) -> f64 {
        self.held_out_mse + self.dropped
    }
}

impl FitSettings {
    /// The highest degree at which making a field of what `plan`'s sections are takes at most `bytes`; `None` where degree 0
    /// takes more. All axes are kept where these settings say so; where one pass does not fit, two may.
    #[must_use]
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
#[must_use]
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
