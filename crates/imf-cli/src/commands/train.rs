//! `imf train`: the paper's network on a dataset.

use anyhow::Result;
use imf_core::siren::SirenShape;
use imf_core::training::TrainingState;
use serde_json::json;

use super::calibrate;
use crate::arguments::TrainArguments;
use crate::engine::Device;
use crate::job::{self, Data, Settings};
use crate::output::{prepare_folder, print, print_json};
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &TrainArguments) -> Result<()> {
    let shape = SirenShape {
        width: arguments.width,
        hidden: arguments.layers,
        omega: arguments.omega,
        ..SirenShape::default()
    };
    shape.check()?;
    let plan = job::plan(&arguments.plan, 5e-4, 50);
    plan.check()?;
    job::require_togetherness(session)?;
    prepare_folder(&arguments.out)?;
    let data = Data::open(&arguments.dataset)?;
    let device = Device::open(&arguments.device.device, session)?;
    device.require_precision(plan.precision)?;
    let model = if arguments.resume {
        job::resumed_model(session, &arguments.out, &data, arguments.plan.rate)?
    } else {
        job::refuse_unfinished(&arguments.out)?;
        job::fresh_model(&data, shape, plan, TrainingState::new(&shape, plan.seed), None)
    };
    let settings = Settings::new(&arguments.plan);
    let model = job::run(session, &device, &data, model, &arguments.out, &settings)?;
    let path = arguments.out.join("model.safetensors");
    announce(session, &path, &model)?;
    calibrated(session, &path, &model, arguments.no_calibrate)
}

/// Measures what a trained model's decisions are worth, where that is short beside its training.
pub(super) fn calibrated(
    session: &Session,
    path: &std::path::Path,
    model: &imf_core::model::Model,
    left_out: bool,
) -> Result<()> {
    let samples = model.record.steps * model.record.plan.batch as u64;
    if left_out || !session.rank().is_first() || !calibrate::is_short_beside(samples) {
        return Ok(());
    }
    calibrate::afterwards(session, path)
}

/// The closing line of a training.
pub(super) fn announce(
    session: &Session,
    path: &std::path::Path,
    model: &imf_core::model::Model,
) -> Result<()> {
    if !session.rank().is_first() {
        return Ok(());
    }
    let loss = model.record.losses.last().map(|p| p.loss);
    if session.json {
        return print_json(&json!({
            "model": path, "steps": model.record.steps, "seconds": model.record.seconds, "loss": loss,
            "parameters": model.shape.parameter_count(), "engine": model.record.engine,
            "held_out": model.record.held_out.as_ref().and_then(|held| held.errors.last()),
        }));
    }
    print(&format!(
        "{}: {} steps in {:.1} s; compare with: imf eval {}",
        path.display(),
        model.record.steps,
        model.record.seconds,
        path.display()
    ))
}
