//! The learning rate as a function of where training stands; nothing else decides it, so a resumed run has the same.

use serde::{Deserialize, Serialize};

/// How the learning rate changes over a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Schedule {
    /// `initial · factor^epoch`, epochs counted from 0, after a straight rise over the first `warmup` steps.
    Exponential {
        /// Rate of the first epoch.
        initial: f32,
        /// Factor from one epoch to the next.
        factor: f32,
        /// Steps of the rise; the first of them has `1 / warmup` of its rate.
        #[serde(default, skip_serializing_if = "is_default")]
        warmup: u64,
    },
    /// Half a cosine over all steps from `initial` to `last`, after a straight rise from 0 over `warmup` steps.
    Cosine {
        /// Highest rate.
        initial: f32,
        /// Rate of the last step.
        #[serde(default)]
        last: f32,
        /// Steps of the rise; the first of them has `initial / warmup`.
        #[serde(default)]
        warmup: u64,
    },
    /// Half a cosine to 0 from a rate that follows from the run's length: `initial` of `steps` steps, of more
    /// `initial · (steps / all)^power`, of fewer `initial · (all / steps)^shorter`. It rises to it as a cosine does.
    Length {
        /// Highest rate of a run of `steps` steps.
        initial: f32,
        /// The length that has it.
        steps: u64,
        /// How fast the rate falls in longer runs.
        power: f32,
        /// How fast it falls in shorter ones; 0 where it is the same for all of them.
        #[serde(default, skip_serializing_if = "is_default")]
        shorter: f32,
        /// Steps of the rise.
        #[serde(default)]
        warmup: u64,
    },
}

impl Default for Schedule {
    /// The paper's: 5e-4 · 0.93^epoch.
    fn default() -> Self {
        Self::Exponential { initial: 5e-4, factor: 0.93, warmup: 0 }
    }
}

impl Schedule {
    /// The last rate of a cosine over its first.
    #[doc(hidden)]
    pub const COSINE_ENDS_AT: f32 = 0.01;

    /// Half a cosine from the highest rate to a hundredth of it, as siren5 is trained by default.
    #[must_use]
    pub fn cosine_from(initial: f32) -> Self {
        Self::Cosine { initial, last: initial * Self::COSINE_ENDS_AT, warmup: 200 }
    }
}

/// What stands in no file unless it was chosen.
pub(super) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Schedule {
    /// The learning rate of step `step` (from 0) of `total`, which lies in epoch `epoch` (from 0).
    #[must_use]
    pub fn rate(&self, epoch: u64, step: u64, total: u64) -> f32 {
        match *self {
            Self::Exponential { initial, factor, warmup } => {
                let full = f64::from(initial) * f64::from(factor).powf(epoch as f64);
                let risen = if step < warmup { (step + 1) as f64 / warmup as f64 } else { 1.0 };
                (full * risen) as f32
            }
            Self::Cosine { initial, warmup, .. } if step < warmup => {
                (f64::from(initial) * (step + 1) as f64 / warmup as f64) as f32
            }
            Self::Cosine { initial, last, warmup } => {
                let (initial, last) = (f64::from(initial), f64::from(last));
                let steps = total.saturating_sub(warmup + 1).max(1);
                let done = ((step - warmup) as f64 / steps as f64).min(1.0);
                (last + (initial - last) * 0.5 * (1.0 + (std::f64::consts::PI * done).cos())) as f32
            }
            Self::Length { warmup, .. } => {
                Self::Cosine { initial: self.highest(total), last: 0.0, warmup }.rate(epoch, step, total)
            }
        }
    }

    /// The highest rate of a run of `total` steps.
    #[must_use]
    pub fn highest(&self, total: u64) -> f32 {
        match *self {
            Self::Exponential { initial, .. } | Self::Cosine { initial, .. } => initial,
            Self::Length { initial, steps, power, shorter, .. } => {
                let ratio = steps as f64 / total.max(1) as f64;
                let power = if ratio < 1.0 { power } else { -shorter };
                (f64::from(initial) * ratio.powf(f64::from(power))) as f32
            }
        }
    }

    /// Checks that every rate is a finite number and none is negative.
    ///
    /// # Errors
    /// A sentence that names the value.
    pub fn check(&self) -> Result<(), String> {
        let (initial, others) = match *self {
            Self::Exponential { initial, factor, .. } => (initial, [("factor", factor); 2]),
            Self::Cosine { initial, last, .. } => (initial, [("last", last); 2]),
            Self::Length { initial, power, shorter, .. } => {
                (initial, [("power", power), ("shorter", shorter)])
            }
        };
        for (name, value) in [("initial", initial)].into_iter().chain(others) {
            if !(value.is_finite() && value >= 0.0) {
                return Err(format!(
                    "the schedule's `{name}` must be a finite number of at least 0, not {value}"
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_rate_falls_by_seven_percent_an_epoch() {
        let schedule = Schedule::default();
        assert_eq!(schedule.rate(0, 17, 100), 5e-4);
        assert!((schedule.rate(10, 0, 100) / (5e-4 * 0.93f32.powi(10)) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_cosine_rises_then_falls_to_its_last_rate() {
        let schedule = Schedule::Cosine { initial: 1.0, last: 0.1, warmup: 4 };
        let rates: Vec<f32> = (0..21).map(|step| schedule.rate(0, step, 21)).collect();
        assert_eq!(rates[..5], [0.25, 0.5, 0.75, 1.0, 1.0]);
        assert!(rates[4..].windows(2).all(|pair| pair[1] < pair[0]));
        assert!((rates[12] - 0.55).abs() < 1e-6 && (rates[20] - 0.1).abs() < 1e-6);
        assert!((schedule.rate(0, 30, 21) - 0.1).abs() < 1e-6, "past the end the rate stays");
        assert_eq!(Schedule::Cosine { initial: 1.0, last: 0.0, warmup: 0 }.rate(0, 0, 1), 1.0);
    }

    #[test]
    fn rates_may_follow_from_the_length() {
        let same = Schedule::Length { initial: 1e-3, steps: 1000, power: 0.5, shorter: 0.0, warmup: 4 };
        assert!([1, 10, 999].iter().all(|&total| same.highest(total) == same.highest(1000)));
        let written = serde_json::to_string(&same).unwrap();
        assert!(!written.contains("shorter"), "{written}");
        assert_eq!(serde_json::from_str::<Schedule>(&written).unwrap(), same);
        let schedule = Schedule::Length { initial: 1e-3, steps: 1000, power: 0.5, shorter: 1.0, warmup: 4 };
        for (total, highest) in [(10, 1e-5), (500, 5e-4), (1000, 1e-3), (4000, 5e-4), (100_000, 1e-4)] {
            assert!((schedule.highest(total) / highest - 1.0).abs() < 1e-6);
            let cosine = Schedule::Cosine { initial: schedule.highest(total), last: 0.0, warmup: 4 };
            assert_eq!(cosine.highest(total), schedule.highest(total));
            for step in [0, 3, 4, total / 2, total - 1] {
                assert_eq!(schedule.rate(0, step, total), cosine.rate(0, step, total));
            }
        }
        for (power, shorter, named) in [(f32::NAN, 0.0, "power"), (0.5, -1.0, "shorter")] {
            let bent = Schedule::Length { initial: 1e-3, steps: 1000, power, shorter, warmup: 4 };
            assert!(bent.check().unwrap_err().contains(named));
        }
        assert!(schedule.check().is_ok());
    }

    #[test]
    fn an_exponential_may_rise_first_and_meets_the_papers_rate_after() {
        let plain = Schedule::default();
        let risen = Schedule::Exponential { initial: 5e-4, factor: 0.93, warmup: 4 };
        let rates: Vec<f32> = (0..4).map(|step| risen.rate(0, step, 100)).collect();
        assert_eq!(rates, [1.25e-4, 2.5e-4, 3.75e-4, 5e-4]);
        assert_eq!(risen.rate(3, 4, 100), plain.rate(3, 4, 100));
    }

    #[test]
    fn schedules_are_written_by_name() {
        let text = serde_json::to_string(&Schedule::default()).unwrap();
        assert_eq!(serde_json::from_str::<Schedule>(&text).unwrap(), Schedule::default());
        let short: Schedule = serde_json::from_str(r#"{"kind": "cosine", "initial": 0.5}"#).unwrap();
        assert_eq!(short, Schedule::Cosine { initial: 0.5, last: 0.0, warmup: 0 });
        assert!(
            Schedule::Exponential { initial: f32::NAN, factor: 1.0, warmup: 0 }
                .check()
                .unwrap_err()
                .contains("initial")
        );
        assert!(
            Schedule::Cosine { initial: 1.0, last: -1.0, warmup: 0 }.check().unwrap_err().contains("last")
        );
    }
}
