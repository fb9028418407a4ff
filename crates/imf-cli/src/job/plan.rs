//! From arguments to a training plan.

use imf_fields::recipe::AdamConfig;
use imf_fields::recipe::TrainingPlan;
use imf_fields::recipe::schedule::Schedule;

use crate::arguments::{LengthArguments, PlanArguments, ScheduleKind};

/// Steps between two looks at the loss and at Ctrl-C.
pub(super) const REPORT_EVERY: u64 = 20;

/// The plan that arguments describe; `rate` and `epochs` stand where they are silent.
pub(crate) fn plan(
    length: &LengthArguments,
    arguments: &PlanArguments,
    rate: f32,
    epochs: u64,
) -> TrainingPlan {
    let initial = length.rate.unwrap_or(rate);
    let schedule = match arguments.schedule {
        ScheduleKind::Exponential => Schedule::Exponential { initial, factor: 0.93, warmup: 0 },
        ScheduleKind::Cosine => Schedule::Cosine { initial, last: initial * 0.01, warmup: 200 },
    };
    TrainingPlan {
        length: length.or_epochs(epochs),
        batch: length.batch,
        schedule: arguments.rate_rule.apply(schedule, length.batch),
        adam: AdamConfig { weight_decay: arguments.weight_decay, ..AdamConfig::default() },
        loss: arguments.loss,
        precision: arguments.precision,
        seed: length.seed,
        report_every: REPORT_EVERY,
    }
}

/// The same schedule from another rate.
pub(super) fn schedule_from(schedule: &Schedule, initial: f32) -> Schedule {
    match *schedule {
        Schedule::Exponential { factor, warmup, .. } => Schedule::Exponential { initial, factor, warmup },
        Schedule::Cosine { warmup, .. } => Schedule::Cosine { initial, last: initial * 0.01, warmup },
        Schedule::Length { steps, power, shorter, warmup, .. } => {
            Schedule::Length { initial, steps, power, shorter, warmup }
        }
    }
}

/// The paper's plan, reported often enough to notice Ctrl-C.
pub fn plan_defaults() -> TrainingPlan {
    TrainingPlan { report_every: REPORT_EVERY, ..TrainingPlan::default() }
}
