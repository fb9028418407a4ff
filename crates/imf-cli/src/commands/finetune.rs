//! `imf finetune`: a trained network adapted to another dataset.

use anyhow::{Result, bail};
use imf_fields::factored::file::FactoredFile;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::model::Model;
use imf_fields::recipe::TrainingState;

use super::train::{concluded, is_over};
use crate::arguments::FinetuneArguments;
use crate::engine::Device;
use crate::job::{self, Data, Latest, Settings};
use crate::output::{claim, prepare_folder, require_other};
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &FinetuneArguments) -> Result<()> {
    let plan = job::plan(&arguments.length, &arguments.plan, 1e-4, 5);
    plan.check()?;
    job::require_togetherness(session)?;
    let (model, out) = (arguments.model.display(), &arguments.out);
    if FactoredFile::is_one(&arguments.model) {
        bail!(
            "{model} is a factored field, and imf finetune adapts models of siren5: imf compress FIELD --from {model} adapts it, FIELD \
             being a harmonic field of the changed part (imf field --method harmonic --save FIELD)"
        );
    }
    if HarmonicFile::is_one(&arguments.model) {
        bail!(
            "{model} is a harmonic field, and imf finetune adapts models of siren5: make one of the changed part anew by imf field \
             --method harmonic"
        );
    }
    if !arguments.resume {
        require_other(&arguments.model, &out.join(job::MODEL))?;
    }
    prepare_folder(out)?;
    let _claim = claim(out)?;
    let found = job::to_resume(out, arguments.resume)?;
    let start = Model::read(&arguments.model)?;
    let settings = Settings::new(&arguments.length, &arguments.plan);
    if let Some(found) = &found {
        found.require_origin(&start)?;
        found.require_options(&arguments.given, start.shape, &plan, &settings)?;
    }
    let data = Data::open(&arguments.dataset)?;
    if start.scene.record.tool.shape != data.scene.record.tool.shape {
        session.warn("the model was made for another tool than the dataset; it will be adapted all the same");
    }
    let same = |found: &Latest| found.require_dataset(&data);
    if is_over(session, out, found.as_ref(), same, arguments.no_calibrate)? {
        return Ok(());
    }
    let device = Device::open(&arguments.device.device, session)?;
    device.require_precision(plan.precision)?;
    let model = match found {
        Some(found) => job::resumed_model(session, found, &data, arguments.length.rate)?,
        None => {
            let from = start.scene.record.part.clone();
            let state = TrainingState::from_parameters(start.state.parameters);
            job::fresh_model(&data, start.shape, plan, state, Some(from))
        }
    };
    let model = job::run(session, &device, &data, model, out, &settings)?;
    concluded(session, out, &model, arguments.no_calibrate)
}
