//! What a harmonic field is made by, and what making it says of its errors.

use serde::{Deserialize, Deserializer, Serialize};

use super::HarmonicError;
use super::basis::{Basis, Domain};
use super::coefficients::StoragePrecision;
use crate::metrics::Validation;
use imf_core::section::Quantity;

/// A count; `usize::MAX` means all. Files written on 64-bit machines may hold a larger number than 32-bit targets
/// (wasm) can.
fn at_most_all<'a, D: Deserializer<'a>>(deserializer: D) -> Result<usize, D::Error> {
    Ok(usize::try_from(u64::deserialize(deserializer)?).unwrap_or(usize::MAX))
}

/// What a harmonic field is made by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// What is fitted. Left out of files where it is the overlap.
    #[serde(skip_serializing_if = "Quantity::is_overlap")]
    pub quantity: Quantity,
    /// Highest degree L of the functions.
    pub degree: usize,
    /// Sections for each function, at least 1.
    pub sections_per_function: f64,
    /// Number of principal components; all functions where there are fewer.
    #[serde(deserialize_with = "at_most_all")]
    pub components: usize,
    /// How coefficients are saved.
    pub precision: StoragePrecision,
    /// Voxels of the sample that decides on the axes.
    pub sample: usize,
    /// Random orientations, other than those of the fit, at which the finished field is compared with exact sections.
    pub held_out: usize,
    /// Seed of these.
    pub seed: u64,
    /// One pass over the sections, which stay in memory; else some at a time, twice each where a sample decides on the axes:
    /// less memory, up to twice the time, the same field to the rounding of sections held in 16 bits. Not saved in files.
    #[serde(skip)]
    pub one_pass: bool,
}

impl Default for FitSettings {
    /// Those of a field of directions: see [`FitSettings::for_domain`].
    fn default() -> Self {
        Self {
            quantity: Quantity::Overlap,
            degree: DEGREE,
            sections_per_function: SECTIONS_PER_FUNCTION,
            // They hold most of a field of degree 14.
            components: 128,
            precision: StoragePrecision::default(),
            sample: 8192,
            // With 64 orientations the standard error of the reported errors is 5 to 9 % (reference parts, degree
            // 14).
            held_out: 64,
            seed: 0,
            one_pass: true,
        }
    }
}

/// Fine enough for a mean squared error of a few millionths.
const DEGREE: usize = 14;
/// 969 functions of a rotation, where degree 14 has 4,495.
const DEGREE_OF_ROTATIONS: usize = 8;
/// A degree that leaves the teapot an error of a few millionths, with all axes.
const DISTILLATION_DEGREE: usize = 16;
/// Of whole rotations: nearly as many functions, and so as much memory and time.
const DISTILLATION_DEGREE_OF_ROTATIONS: usize = 5;
/// Measured: beyond a third more sections than functions, a higher degree is the better use of sections.
const SECTIONS_PER_FUNCTION: f64 = 1.33;

impl FitSettings {
    /// Voxels of clearance of shank and holder that make depths decide: seven times a fit's error. What the error leaves open of the
    /// cutter, which must touch what it cuts, the calibrated thresholds leave to an exact check.
    pub const CLEARANCE: f64 = 2.0;

    /// The default settings over a domain.
    #[must_use]
    pub fn for_domain(domain: Domain) -> Self {
        let degree = match domain {
            Domain::Directions => DEGREE,
            Domain::Rotations => DEGREE_OF_ROTATIONS,
        };
        Self { degree, ..Self::default() }
    }

    /// The default settings of a field that a network is distilled from: all components, in full precision.
    #[must_use]
    pub fn for_distillation(domain: Domain) -> Self {
        let degree = match domain {
            Domain::Directions => DISTILLATION_DEGREE,
            Domain::Rotations => DISTILLATION_DEGREE_OF_ROTATIONS,
        };
        Self { degree, components: usize::MAX, precision: StoragePrecision::F32, ..Self::for_domain(domain) }
    }

    /// Functions, sections and axes of a field over a domain.
    pub fn sizes(&self, domain: Domain) -> Sizes {
        let functions = Basis::count(domain, self.degree);
        let sections = (functions as f64 * self.sections_per_function).ceil() as usize;
        let sections = Basis::fitted_count(domain, sections, functions);
        Sizes { functions, sections, components: self.components.clamp(1, functions) }
    }

    /// True where functions are retained as they are and fall into classes, of values that begin at 0.
    #[cfg(feature = "fit")]
    pub(super) fn in_classes(&self, domain: Domain) -> bool {
        let Sizes { functions, components, .. } = self.sizes(domain);
        domain == Domain::Directions && components == functions && self.quantity.is_overlap()
    }

    /// Checks the ranges that types do not ensure.
    ///
    /// # Errors
    /// [`HarmonicError::Settings`], naming the value.
    pub fn check(&self) -> Result<(), HarmonicError> {
        let refuse = |what: String| Err(HarmonicError::Settings(what));
        if self.degree > MOST_DEGREE {
            return refuse(format!("a degree of {} is above {MOST_DEGREE}", self.degree));
        }
        let sections = self.sections_per_function;
        if !(1.0..=100.0).contains(&sections) {
            return refuse(format!("sections_per_function must be from 1 to 100, not {sections}"));
        }
        if self.components == 0 || self.sample == 0 || self.held_out == 0 {
            return refuse("components, sample and held_out must be at least 1".into());
        }
        Ok(())
    }
}

/// Higher degrees are refused as a slip of the keyboard: 1681 functions of a direction already.
const MOST_DEGREE: usize = 40;

/// How large a field becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Functions of the orientation, K.
    pub functions: usize,
    /// Exact sections, N.
    pub sections: usize,
    /// Number of principal components.
    pub components: usize,
}

/// The errors of a fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Functions of the orientation, K.
    pub functions: usize,
    /// Exact sections, N.
    pub sections: usize,
    /// Mean squared error due to the dropped components, estimated from a sample of voxels: a part of the whole error.
    pub dropped: f64,
    /// The error at orientations that were not fitted, of the field as it is saved, over all voxels.
    pub validation: Validation,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usual_settings_have_the_degrees_of_round_tools_and_of_others() {
        let functions = |settings: fn(Domain) -> FitSettings| {
            [Domain::Directions, Domain::Rotations].map(|domain| settings(domain).sizes(domain).functions)
        };
        assert_eq!(functions(FitSettings::for_domain), [225, 969]);
        assert_eq!(functions(FitSettings::for_distillation), [289, 286]);
        let teacher = FitSettings::for_distillation(Domain::Rotations);
        assert_eq!(
            (teacher.sizes(Domain::Rotations).components, teacher.precision),
            (286, StoragePrecision::F32)
        );
    }
}
