//! `imf finetune`: a trained network adapted to another dataset.

use anyhow::Result;
use imf_core::model::Model;
use imf_core::training::TrainingState;

use super::train::{announce, calibrated};
use crate::arguments::FinetuneArguments;
use crate::engine::Device;
use crate::job::{self, Data, Settings};
use crate::output::prepare_folder;
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &FinetuneArguments) -> Result<()> {
    let plan = job::plan(&arguments.length, &arguments.plan, 1e-4, 5);
    plan.check()?;
    job::require_togetherness(session)?;
    prepare_folder(&arguments.out)?;
    let start = Model::read(&arguments.model)?;
    let data = Data::open(&arguments.dataset)?;
    if start.scene.record.tool.shape != data.scene.record.tool.shape {
        session.warn("the model was made for another tool than the dataset; it will be adapted all the same");
    }
    let device = Device::open(&arguments.device.device, session)?;
    device.require_precision(plan.precision)?;
    let model = if arguments.resume {
        job::resumed_model(session, &arguments.out, &data, arguments.length.rate)?
    } else {
        job::refuse_unfinished(&arguments.out)?;
        let from = start.scene.record.part.clone();
        job::fresh_model(
            &data,
            start.shape,
            plan,
            TrainingState::from_parameters(start.state.parameters),
            Some(from),
        )
    };
    let settings = Settings::new(&arguments.length, &arguments.plan);
    let model = job::run(session, &device, &data, model, &arguments.out, &settings)?;
    let path = arguments.out.join("model.safetensors");
    announce(session, &path, &model)?;
    calibrated(session, &path, &model, arguments.no_calibrate)
}
