//! What a field is good for, by the rates that its calibration measured: the one place that says so.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::Calibration;

/// Below this fraction called free, the rates of those mean nothing.
const MINIMUM_REPORTED: f64 = 0.01;
/// Where values steer, at most this fraction of the pairs of a colliding and a clear pose may be in the wrong order.
const MOST_MISORDERED: f64 = 0.1;

/// What a field may be used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Purpose {
    /// Decisions, at the stated rates.
    Decisions,
    /// Steering: its values rise towards collision, and an exact check decides.
    Steering,
    /// Nothing: its values do not separate colliding from clear poses.
    Nothing,
}

/// What a field may be used for, and why. Its text is one sentence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// For what.
    pub usable_for: Purpose,
    /// Measured fraction of the colliding poses that are called free.
    pub false_free: f64,
    /// Its upper bound, at `confidence`.
    pub false_free_bound: f64,
    /// Confidence of the bounds, from 0 to 1.
    pub confidence: f64,
    /// Fraction of the clear poses that are called free.
    pub found_free: f64,
    /// Upper bound of the fraction of pairs in the wrong order, at `confidence`.
    pub misordered_bound: f64,
    /// In words.
    pub text: String,
}

impl Calibration {
    /// What a field with this calibration may be used for. Decisions: the goals are met. Steering: at most a tenth of
    /// the pairs of a colliding and a clear pose are in the wrong order. Mean errors play no part.
    pub fn verdict(&self) -> Verdict {
        let Self { goals, uniform, boundary, .. } = self;
        let found_free = uniform.found_fraction();
        let usable_for = if self.meets_its_goals() {
            Purpose::Decisions
        } else if uniform.misordered.bound <= MOST_MISORDERED {
            Purpose::Steering
        } else {
            Purpose::Nothing
        };
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let (rate, near) = (uniform.false_free, boundary.false_free);
        let calls = match self.free_up_to {
            Some(_) if found_free < MINIMUM_REPORTED => format!(
                "it cannot decide, its values being low enough to be called free at {} of the clear poses alone",
                percent(found_free)
            ),
            Some(_) => format!(
                "of {} colliding poses {} are called free (a rate of at most {:.1e} at {} % confidence; within a pitch of contact at most \
                 {:.1e}), of the clear ones {} are found free and {} called colliding",
                rate.of,
                rate.wrong,
                rate.bound,
                100.0 * goals.confidence,
                near.bound,
                percent(found_free),
                percent(uniform.false_colliding.fraction()),
            ),
            None => "it cannot decide, no value being low enough to be called free".to_owned(),
        };
        let order = format!(
            "{} of the pairs of a colliding and a clear pose are in the wrong order",
            percent(uniform.misordered.fraction())
        );
        let text = match usable_for {
            Purpose::Decisions => format!(
                "usable for decisions: {calls}; a clear pose keeps the clearance that the field was made with, element by element"
            ),
            Purpose::Steering => format!(
                "for steering only, an exact check must decide: {calls}, where a rate of at most {:.1e} called free, {} called \
                 colliding and half of the clear ones found are asked for; {order}",
                goals.false_free,
                percent(goals.false_colliding),
            ),
            Purpose::Nothing => {
                format!("not usable, neither for decisions nor for steering: {calls}; {order}")
            }
        };
        Verdict {
            usable_for,
            false_free: rate.fraction(),
            false_free_bound: rate.bound,
            confidence: goals.confidence,
            found_free,
            misordered_bound: uniform.misordered.bound,
            text,
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

#[cfg(all(test, feature = "calibration"))]
mod tests {
    use super::*;
    use crate::calibration::{DecisionRates, Rate};

    fn of(false_free: u64, found_free: u64, false_colliding: u64, misordered: u64) -> Verdict {
        let rate = |wrong| Rate::new(wrong, 100_000, 0.99);
        let rates = DecisionRates {
            poses: 200_000,
            false_free: rate(false_free),
            false_colliding: rate(false_colliding),
            found_free,
            misordered: rate(misordered),
            ..DecisionRates::default()
        };
        Calibration { uniform: rates, boundary: rates, ..Calibration::unmeasured(Some(0.1), Some(0.2)) }
            .verdict()
    }

    #[test]
    fn the_verdict_follows_rates_and_bounds_at_their_edges() {
        assert_eq!(of(2, 99_000, 100, 50).usable_for, Purpose::Decisions);
        assert!(of(2, 99_000, 100, 50).text.starts_with("usable for decisions"));
        // The rate itself, 8e-5, meets the goal of 1e-4; its bound does not.
        assert_eq!(of(8, 99_000, 100, 50).usable_for, Purpose::Steering);
        // What calls hardly any pose free is never wrong, and decides nothing.
        assert_eq!(of(0, 49_000, 100, 50).usable_for, Purpose::Steering);
        assert_eq!(of(0, 51_000, 6_000, 50).usable_for, Purpose::Steering);
        // The rate 9.7 % stays below a tenth with its bound, 9.9 % only alone.
        assert_eq!(of(0, 10, 100, 9_700).usable_for, Purpose::Steering);
        assert_eq!(of(0, 10, 100, 9_900).usable_for, Purpose::Nothing);
        assert!(of(50_000, 99_000, 1, 50_000).text.starts_with("not usable"));
        // A field that hardly ever says free is reported as such, without rates.
        let text = of(0, 900, 0, 50).text;
        assert!(
            text.contains("cannot decide") && text.contains("0.9 %") && !text.contains("rate of at most 0"),
            "{text}"
        );
    }
}
