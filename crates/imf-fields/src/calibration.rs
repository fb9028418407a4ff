//! Quality of a field's decisions: thresholds for "free" and "colliding", and the rates measured with them.
//!
//! Saved in a field's file. The thresholds are chosen on some poses; the rates are measured on others, drawn
//! separately. "Colliding" and "free" are about two tools: a *colliding* pose is one of the true tool's, a *clear*
//! pose is one where the tool offset by the scene's clearance is free. Poses between the two may be decided either
//! way.

mod verdict;

pub use verdict::{Purpose, Verdict};

use imf_core::field::Decision;
use serde::{Deserialize, Serialize};

/// A field that decides must call at least this fraction of the clear poses free: one that leaves most to an exact
/// check meets any false-free rate.
const MINIMUM_FOUND: f64 = 0.5;

/// Errors of one kind among poses of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rate {
    /// Poses with the error.
    pub wrong: u64,
    /// Poses that could have had it.
    pub of: u64,
    /// Upper bound of the rate at the record's confidence, by Clopper and Pearson.
    pub bound: f64,
}

impl Default for Rate {
    /// Of no poses, which bound nothing.
    fn default() -> Self {
        Self { wrong: 0, of: 0, bound: 1.0 }
    }
}

impl Rate {
    /// `wrong` errors among `of` poses, with the upper bound of their rate.
    #[cfg(feature = "calibration")]
    #[must_use]
    pub fn new(wrong: u64, of: u64, confidence: f64) -> Self {
        Self { wrong, of, bound: upper_bound(wrong, of, confidence) }
    }

    /// The rate, from 0 to 1; 0 of no poses.
    pub fn fraction(&self) -> f64 {
        self.wrong as f64 / self.of.max(1) as f64
    }
}

/// Requirements of the thresholds, beside calling half of the clear poses free.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Goals {
    /// Maximum fraction of the colliding poses that may be called free.
    pub false_free: f64,
    /// Maximum fraction of the clear poses that may be called colliding.
    pub false_colliding: f64,
    /// Confidence of both bounds, from 0 to 1.
    pub confidence: f64,
}

impl Default for Goals {
    /// One colliding pose in ten thousand, one clear pose in twenty, at 99 %.
    fn default() -> Self {
        Self { false_free: 1e-4, false_colliding: 0.05, confidence: 0.99 }
    }
}

/// Rates measured on poses of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DecisionRates {
    /// Poses in all.
    pub poses: u64,
    /// Colliding poses called free.
    pub false_free: Rate,
    /// Clear poses called colliding.
    pub false_colliding: Rate,
    /// Poses that are neither called free nor colliding.
    pub undecided: u64,
    /// Clear poses called free.
    pub found_free: u64,
    /// Pairs of a colliding and a clear pose, each pose in one of them, whose values stand in the wrong order: half of them where a
    /// value says nothing.
    pub misordered: Rate,
    /// Largest error of a value against the exact one of the offset tool. Of a field of depth: how far a value lies on the
    /// wrong side, of 0 for poses where the offset tool is free or only just not, of the clearance for colliding ones.
    pub largest_error: f64,
}

impl DecisionRates {
    /// Fraction of the poses that are left to an exact check.
    pub fn undecided_fraction(&self) -> f64 {
        self.undecided as f64 / self.poses.max(1) as f64
    }

    /// Fraction of the clear poses that are called free.
    pub fn found_fraction(&self) -> f64 {
        self.found_free as f64 / self.false_colliding.of.max(1) as f64
    }
}

/// Thresholds of a field, and the measured rates of decisions by them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Values up to this one, not clipped to [0, 1], are called free; `None` where none that is shown is safe enough.
    pub free_up_to: Option<f32>,
    /// Values from this one on are called colliding; `None` where none is.
    pub colliding_from: Option<f32>,
    /// The target rates.
    pub goals: Goals,
    /// Seed of the poses.
    pub seed: u64,
    /// Uniform positions in the query box, uniform orientations.
    pub uniform: DecisionRates,
    /// Poses within one pitch of the true tool's contact.
    pub boundary: DecisionRates,
}

impl Calibration {
    /// Thresholds whose rates have not been measured.
    #[doc(hidden)]
    #[must_use]
    pub fn unmeasured(free_up_to: Option<f32>, colliding_from: Option<f32>) -> Self {
        let (goals, rates) = (Goals::default(), DecisionRates::default());
        Self { free_up_to, colliding_from, goals, seed: 0, uniform: rates, boundary: rates }
    }

    /// True where the bounds of the uniform poses' rates meet the goals, and half of the clear poses or more are
    /// called free.
    pub fn meets_its_goals(&self) -> bool {
        let Self { goals, uniform, .. } = self;
        uniform.false_free.bound <= goals.false_free
            && uniform.false_colliding.bound <= goals.false_colliding
            && uniform.found_fraction() >= MINIMUM_FOUND
    }

    /// The decision of a value, not clipped.
    pub(crate) fn decide(&self, value: f32) -> Decision {
        if self.free_up_to.is_some_and(|free| value <= free) {
            Decision::Free
        } else if self.colliding_from.is_some_and(|colliding| value >= colliding) {
            Decision::Colliding
        } else {
            Decision::Undecided
        }
    }

    /// What is wrong with a record from a file, if anything is.
    pub fn fault(&self) -> Option<&'static str> {
        let finite = |threshold: Option<f32>| threshold.is_none_or(f32::is_finite);
        if !finite(self.free_up_to) || !finite(self.colliding_from) {
            return Some("a threshold of its calibration is not a finite number");
        }
        match (self.free_up_to, self.colliding_from) {
            (Some(free), Some(blocked)) if free >= blocked => Some("its thresholds cross"),
            _ => None,
        }
    }
}

/// The largest rate at which `wrong` or fewer errors among `of` still have the probability 1 − `confidence`; 1 where
/// nothing was tried.
///
/// Clopper and Pearson (1934): the quantile of the beta distribution Beta(wrong + 1, of − wrong).
#[cfg(feature = "calibration")]
fn upper_bound(wrong: u64, of: u64, confidence: f64) -> f64 {
    if wrong >= of || !(confidence > 0.0 && confidence < 1.0) {
        return 1.0;
    }
    let (a, b) = (wrong as f64 + 1.0, (of - wrong) as f64);
    let (mut low, mut high) = (0.0, 1.0);
    // Sixty halvings reach the last bit of any rate above 1e-3, and nine digits of one in a thousand million.
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if statrs::function::beta::beta_reg(a, b, middle) < confidence {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// Maximum number of errors among `of` poses whose bound still meets `rate`; `None` where even 0 does not.
#[cfg(feature = "calibration")]
pub(crate) fn most_errors(of: u64, rate: f64, confidence: f64) -> Option<u64> {
    if upper_bound(0, of, confidence) > rate {
        return None;
    }
    let (mut low, mut high) = (0, of);
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if upper_bound(middle, of, confidence) <= rate {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(low)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition: the probability of at most `wrong` errors at rate `p`, summed term by term.
    fn at_most(wrong: u64, of: u64, p: f64) -> f64 {
        let mut term = (of as f64 * (-p).ln_1p()).exp();
        let mut sum = term;
        for k in 0..wrong {
            term *= (of - k) as f64 / (k + 1) as f64 * p / (1.0 - p);
            sum += term;
        }
        sum
    }

    #[test]
    fn bounds_are_where_the_binomial_sum_says() {
        for (wrong, of) in [(0, 1), (0, 46_052), (3, 46_052), (1, 40), (17, 500), (40, 1_000_000)] {
            for confidence in [0.9, 0.99] {
                let bound = upper_bound(wrong, of, confidence);
                let left = at_most(wrong, of, bound);
                assert!((left - (1.0 - confidence)).abs() < 1e-7, "{wrong} of {of}: {bound}, {left}");
            }
        }
        // The known closed form: with no error the bound is 1 − (1 − c)^(1/n).
        let bound = upper_bound(0, 46_052, 0.99);
        assert!((bound - (1.0 - 0.01_f64.powf(1.0 / 46_052.0))).abs() < 1e-12 && bound <= 1e-4);
        assert!(upper_bound(0, 46_000, 0.99) > 1e-4);
        assert_eq!((upper_bound(0, 0, 0.99), upper_bound(5, 5, 0.99)), (1.0, 1.0));
    }

    #[test]
    fn as_many_errors_are_allowed_as_keep_the_rate() {
        assert_eq!(most_errors(46_000, 1e-4, 0.99), None);
        assert_eq!(most_errors(46_052, 1e-4, 0.99), Some(0));
        for of in [100_000, 500_000] {
            let most = most_errors(of, 1e-4, 0.99).unwrap();
            assert!(upper_bound(most, of, 0.99) <= 1e-4 && upper_bound(most + 1, of, 0.99) > 1e-4);
        }
    }
}
