//! Noticing a training that has gone astray though its loss is still a finite number.
//!
//! Outputs lie in (0, 1), so a network that has diverged returns a constant and its loss stays bounded: it is
//! recognised by a running mean far above its best for long.

use serde::{Deserialize, Serialize};

/// Approximate number of steps in the running mean.
const WINDOW: f64 = 200.0;
/// A running mean this many times the best is suspicious: a choice, which the demo and the trainings of the paper's
/// tables that learnt anything stay below.
const FACTOR: f64 = 4.0;
/// So is it only where it is worse by this much as well: below, there is no harm done.
const FLOOR: f64 = 1e-3;
/// Steps of suspicion after which training has diverged.
const PATIENCE: u64 = 1000;

/// State of the losses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// As good as before, or nearly.
    Fine,
    /// Far above the best; it may come back.
    Suspicious,
    /// Far above the best for long.
    Diverged {
        /// Lowest running mean.
        best: f64,
        /// Step at which it was reached.
        best_step: u64,
        /// Running mean now.
        mean: f64,
    },
}

/// Watches the losses of a run. It is saved with a run's state, so that a continued run is watched as an
/// uninterrupted one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Watch {
    /// Running mean, and steps that it has seen.
    mean: f64,
    seen: u64,
    /// Lowest running mean and its step.
    best: Option<(f64, u64)>,
    /// Steps since the mean has been far above the best.
    above: u64,
    /// The last losses alone are as far above it, which the mean will follow.
    rising: bool,
}

impl Watch {
    /// Whether the loss is far above its best now: the state should not replace an older one.
    #[must_use]
    pub fn is_suspicious(&self) -> bool {
        self.above > 0 || self.rising
    }

    /// With all patience again, as for a training that goes on by another rate.
    #[must_use]
    pub fn patient(self) -> Self {
        Self { above: 0, rising: false, ..self }
    }

    /// Whether it has seen nothing.
    #[must_use]
    pub fn is_new(&self) -> bool {
        *self == Self::default()
    }

    /// Takes in the mean loss of the last `steps` steps, up to `step`.
    pub fn observe(&mut self, step: u64, steps: u64, loss: f64) -> Verdict {
        let weight = 1.0 - (-(steps as f64) / WINDOW).exp();
        self.mean = if self.seen == 0 { loss } else { self.mean + weight * (loss - self.mean) };
        self.seen += steps;
        if (self.seen as f64) < WINDOW {
            return Verdict::Fine;
        }
        let (best, best_step) = match self.best {
            Some(best) if best.0 <= self.mean => best,
            _ => *self.best.insert((self.mean, step)),
        };
        let is_far = |loss: f64| loss >= FACTOR * best && loss >= best + FLOOR;
        self.rising = is_far(loss);
        if !is_far(self.mean) {
            self.above = 0;
            return Verdict::Fine;
        }
        self.above += steps;
        if self.above < PATIENCE {
            Verdict::Suspicious
        } else {
            Verdict::Diverged { best, best_step, mean: self.mean }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verdicts on losses given every twenty steps.
    fn verdicts(losses: impl Iterator<Item = f64>) -> Vec<Verdict> {
        let mut watch = Watch::default();
        losses.enumerate().map(|(i, loss)| watch.observe((i as u64 + 1) * 20, 20, loss)).collect()
    }

    #[test]
    fn a_collapse_to_a_constant_is_noticed_and_dated() {
        let losses = (0..100).map(|i| 0.2 * 0.95f64.powi(i)).chain([0.21; 200]);
        let all = verdicts(losses);
        let at = all.iter().position(|v| matches!(v, Verdict::Diverged { .. })).unwrap();
        // The mean needs a step or two to rise, then patience: fifty observations of twenty steps.
        assert!((149..149 + 10).contains(&at), "{at}");
        let Verdict::Diverged { best, best_step, mean } = all[at] else { unreachable!() };
        assert_eq!(best_step, 2000);
        assert!(best < 0.01 && mean > 0.2, "{best} {mean}");
        let first = all.iter().position(|v| *v == Verdict::Suspicious).unwrap();
        assert!((100..104).contains(&first), "{first}");
    }

    #[test]
    fn noise_spikes_restarts_and_tiny_losses_are_no_divergence() {
        let noisy = (0..2000).map(|i| 0.02 * (1.0 + 0.9 * f64::from(i * 7919 % 1000) / 1000.0));
        let spikes = (0..2000).map(|i| if i % 100 < 3 { 0.2 } else { 0.01 });
        let restart = (0..2000).map(|i| if i < 1000 { 0.01 } else { 0.025 });
        let tiny = (0..2000).map(|i| if i < 1000 { 1e-7 } else { 1e-4 });
        for losses in [noisy.collect::<Vec<_>>(), spikes.collect(), restart.collect(), tiny.collect()] {
            let all = verdicts(losses.into_iter());
            assert!(!all.iter().any(|v| matches!(v, Verdict::Diverged { .. })));
        }
    }
}
