//! Thresholds for decisions, chosen and measured against exact results.
//!
//! Two kinds of poses are drawn. *Uniform* ones: positions uniform in the box of the voxel centres, where the field is
//! known, orientations uniform. *Boundary* ones: between a free and a colliding position of one orientation the true tool's
//! contact is sought by halving, and left again by up to a pitch in any direction. Thresholds follow from uniform poses
//! alone, so that their rates are rates of all poses; they are measured on both kinds, drawn anew.
//!
//! The threshold of "free" is the largest at which the bound of the false-free rate meets half the goal, which leaves
//! room for other poses to differ; that of "colliding" is the smallest at which the rate among clear poses meets nine
//! tenths of its goal. Where the second lies below the first every pose can be decided, and both are moved to the
//! middle between: then either rate is far below its goal.

mod draw;

use thiserror::Error;

use draw::{Kind, SampledPose, Truth};

use crate::calibration::{Calibration, DecisionRates, Goals, Rate, most_errors};
use crate::field::Field;
use crate::metrics::larger;
use imf_core::control::{Cancelled, Control};
use imf_core::field::{Decision, FieldError, PoseField as _};
use imf_core::tool::{ClearanceError, ToolError};

/// How many poses are drawn, and what the thresholds must reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationSettings {
    /// Number of uniform poses to choose by, and of those to measure by.
    pub uniform: usize,
    /// Number of boundary poses to measure by.
    pub boundary: usize,
    /// Of either kind, number of poses whose overlap is compared with the exact one; depths are compared at every pose.
    pub errors: usize,
    /// Seed of all poses.
    pub seed: u64,
    /// What the thresholds must reach.
    pub goals: Goals,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        Self { uniform: 400_000, boundary: 50_000, errors: 2_000, seed: 0, goals: Goals::default() }
    }
}

/// Why a field is not calibrated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// A goal out of range.
    #[error("{name} must lie between 0 and 1, not {value}")]
    Goal {
        /// Which.
        name: &'static str,
        /// What it is.
        value: f64,
    },
    /// Too few poses for so small a rate.
    #[error(
        "{colliding} colliding poses do not show a false-free rate of {rate:e} at this confidence even without an error: \
         draw more poses"
    )]
    TooFew {
        /// Colliding poses drawn.
        colliding: usize,
        /// The target rate.
        rate: f64,
    },
    /// The field has a value that is not a number.
    #[error("the field has values that are not finite: it decides nothing, make or train it anew")]
    NotFinite,
    /// Poses cannot be evaluated.
    #[error(transparent)]
    Planner(#[from] FieldError),
    /// The tool does not fit the grid.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// The tool cannot be offset.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// The caller's [`Control`] asked to stop.
    #[error("interrupted")]
    Cancelled(#[from] Cancelled),
}

/// Poses drawn and evaluated at a time; one unit of progress.
#[doc(hidden)]
pub const CHUNK: usize = 1024;
/// Most random poses that are drawn to choose thresholds by.
const MOST: usize = 4_000_000;

impl CalibrationSettings {
    /// Units of progress of [`calibrate`].
    pub fn units(&self) -> u64 {
        (2 * self.uniform.div_ceil(CHUNK) + self.boundary.div_ceil(CHUNK)) as u64
    }

    /// Bytes of the poses of [`calibrate`]: those that thresholds are chosen by, with their sorted values, and those
    /// that rates are measured on, each kind twice while its chunks are joined.
    pub fn memory_bytes(&self) -> u64 {
        let seen = size_of::<SampledPose>() as u64;
        // Values are sorted beside the list that they were gathered in, which may have grown to twice its length.
        let chosen = (seen + 8).saturating_mul(self.uniform as u64);
        let judged = (2 * seen).saturating_mul((self.uniform as u64).saturating_add(self.boundary as u64));
        chosen.saturating_add(judged)
    }

    /// As many poses as resolve the required rate where `colliding` of these collide, or as many as are drawn at most; nothing where
    /// that is not more.
    #[must_use]
    pub fn with_more_poses(&self, colliding: usize) -> Option<Self> {
        if self.uniform >= MOST || colliding == 0 {
            return None;
        }
        // Of zero errors the bound is below the goal from 4.6 over it on; a tenth more for chance.
        let more = 1.1 * 4.61 / self.goals.false_free / colliding as f64;
        let uniform = ((self.uniform as f64 * more.max(1.1)) as usize).min(MOST);
        Some(Self { uniform, ..*self })
    }

    fn check(&self) -> Result<(), CalibrationError> {
        let Goals { false_free, false_colliding, confidence } = self.goals;
        let all = [
            ("the false-free rate", false_free),
            ("the false-colliding rate", false_colliding),
            ("the confidence", confidence),
        ];
        match all.into_iter().find(|(_, value)| !(*value > 0.0 && *value < 1.0)) {
            Some((name, value)) => Err(CalibrationError::Goal { name, value }),
            None => Ok(()),
        }
    }
}

/// Chooses a field's thresholds and judges them, on all threads of the current pool. The same settings give the same
/// poses.
///
/// # Errors
/// Goals out of range, too few poses to show the target rate, a tool that does not fit, cancellation.
pub fn calibrate(
    field: &Field,
    settings: &CalibrationSettings,
    control: Control<'_>,
) -> Result<Calibration, CalibrationError> {
    settings.check()?;
    let goals = settings.goals;
    let truth = Truth::new(field)?;
    let seen = truth.seen(Truth::uniform, settings.uniform, 0, settings.seed, 0, control)?;
    if seen.iter().any(|seen| !seen.value.is_finite()) {
        return Err(CalibrationError::NotFinite);
    }
    let values = |kind: Kind| {
        let of_kind = seen.iter().filter(|s| s.kind == kind && s.decides);
        let mut values: Vec<f32> = of_kind.map(|s| s.value).collect();
        values.sort_by(f32::total_cmp);
        values
    };
    let (colliding, clear) = (values(Kind::Colliding), values(Kind::Clear));
    if most_errors(colliding.len() as u64, goals.false_free, goals.confidence).is_none() {
        return Err(CalibrationError::TooFew { colliding: colliding.len(), rate: goals.false_free });
    }
    // Where even half the goal cannot be shown, no error at all is the best there is.
    let most = most_errors(colliding.len() as u64, 0.5 * goals.false_free, goals.confidence).unwrap_or(0);
    // Below every value, and below all that are shown, it would call nothing free that anyone could know of.
    let [lowest, _] = field.quantity().bounds(field.scene().record.grid.pitch);
    let free_up_to = colliding.get(most as usize).map(|value| value.next_down()).filter(|&free| {
        f64::from(free) >= lowest && seen.iter().any(|seen| seen.decides && seen.value <= free)
    });
    let colliding_from = match most_errors(clear.len() as u64, 0.9 * goals.false_colliding, goals.confidence)
    {
        Some(most) => clear.iter().rev().nth(most as usize).map(|value| value.next_up()),
        None => clear.last().map(|value| value.next_up()),
    };
    let (free_up_to, colliding_from) = match (free_up_to, colliding_from) {
        // Every pose can be decided: in the middle of what the goals allow.
        (Some(free), Some(blocked)) if blocked <= free => {
            let middle = (0.5 * (free + blocked)).max(lowest as f32);
            (Some(middle), Some(middle.next_up()))
        }
        (Some(free), None) => (Some(free), Some(free.next_up())),
        (None, None) => (None, Some(f32::MIN)),
        apart => apart,
    };
    let seed = settings.seed;
    let unmeasured = Calibration { goals, seed, ..Calibration::unmeasured(free_up_to, colliding_from) };
    let [uniform, boundary] = unmeasured.measure_rates(&truth, settings, control)?;
    Ok(Calibration { uniform, boundary, ..unmeasured })
}

/// Measures a field's own calibration on fresh poses of another seed: uniform ones and boundary ones.
///
/// # Errors
/// As [`calibrate`].
pub fn measure_rates(
    field: &Field,
    calibration: &Calibration,
    settings: &CalibrationSettings,
    control: Control<'_>,
) -> Result<[DecisionRates; 2], CalibrationError> {
    settings.check()?;
    let goals = settings.goals;
    let by_goals = Calibration { goals, ..*calibration };
    let rates = by_goals.measure_rates(&Truth::new(field)?, settings, control)?;
    let colliding = rates[0].false_free.of;
    if most_errors(colliding, goals.false_free, goals.confidence).is_none() {
        return Err(CalibrationError::TooFew { colliding: colliding as usize, rate: goals.false_free });
    }
    Ok(rates)
}

impl Calibration {
    /// Measures the decisions by these thresholds, on poses that are drawn anew.
    fn measure_rates(
        &self,
        truth: &Truth<'_>,
        settings: &CalibrationSettings,
        control: Control<'_>,
    ) -> Result<[DecisionRates; 2], CalibrationError> {
        let CalibrationSettings { uniform, boundary, errors, seed, .. } = *settings;
        let uniform = truth.seen(Truth::uniform, uniform, errors, seed, 1, control)?;
        let boundary = truth.seen(Truth::boundary, boundary, errors, seed, 2, control)?;
        Ok([self.decision_rates(&uniform), self.decision_rates(&boundary)])
    }

    fn decision_rates(&self, seen: &[SampledPose]) -> DecisionRates {
        let decided = |s: &SampledPose| if s.decides { self.decide(s.value) } else { Decision::Undecided };
        let count = |kind: Option<Kind>, decision: Option<Decision>| {
            let of = |s: &&SampledPose| {
                kind.is_none_or(|k| k == s.kind) && decision.is_none_or(|d| d == decided(s))
            };
            seen.iter().filter(of).count() as u64
        };
        let rate = |kind, decision| {
            Rate::new(count(Some(kind), Some(decision)), count(Some(kind), None), self.goals.confidence)
        };
        // In the order that they were drawn in, so that pairs are independent.
        let of = |kind| seen.iter().filter(move |s| s.kind == kind).map(|s| s.value);
        let pairs = || of(Kind::Colliding).zip(of(Kind::Clear));
        let misordered = pairs().filter(|(colliding, clear)| colliding <= clear).count() as u64;
        DecisionRates {
            poses: seen.len() as u64,
            false_free: rate(Kind::Colliding, Decision::Free),
            false_colliding: rate(Kind::Clear, Decision::Colliding),
            undecided: count(None, Some(Decision::Undecided)),
            found_free: count(Some(Kind::Clear), Some(Decision::Free)),
            misordered: Rate::new(misordered, pairs().count() as u64, self.goals.confidence),
            largest_error: seen.iter().map(|s| s.error).fold(0.0, larger),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_are_drawn_as_long_as_there_may_be() {
        let usual = CalibrationSettings::default();
        let more = usual.with_more_poses(2_000).unwrap();
        assert!(more.uniform > usual.uniform && more.uniform <= MOST);
        // Enough of them collide then, and a tenth more.
        let colliding = 2_000.0 * more.uniform as f64 / usual.uniform as f64;
        assert!(more.uniform == MOST || colliding * usual.goals.false_free > 4.6);
        assert_eq!(usual.with_more_poses(0), None);
        assert_eq!(CalibrationSettings { uniform: MOST, ..usual }.with_more_poses(10), None);
    }
}
