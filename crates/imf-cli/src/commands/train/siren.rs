//! The paper's network on samples: those of a dataset, or of a part's own, which is made first.

use anyhow::Result;
use imf_fields::recipe::TrainingState;
use imf_fields::siren::SirenShape;

use super::{concluded, is_over};
use crate::arguments::train::{Samples, TrainArguments};
use crate::commands::dataset::sampled;
use crate::engine::Device;
use crate::job::{self, Data, Footprint, Latest, Settings};
use crate::output::{OutputFolder, claim};
use crate::session::Session;

pub(super) fn run(
    session: &Session,
    arguments: &TrainArguments,
    shape: SirenShape,
    samples: &Samples<'_>,
) -> Result<()> {
    let plan = job::plan(&arguments.length, &arguments.plan, 5e-4, 50);
    plan.check()?;
    let folder = OutputFolder::check(&arguments.out)?;
    let _claim = claim(folder.path())?;
    // Before anything is made for a training that cannot go on, or need not.
    let found = job::to_resume(folder.path(), arguments.resume)?;
    let settings = Settings::new(&arguments.length, &arguments.plan);
    if let Some(found) = &found {
        found.require_options(&arguments.given, shape, &plan, &settings)?;
    }
    let device = Device::open(arguments.device_or("auto"), session)?;
    device.require_precision(plan.precision)?;
    let left_out = arguments.no_calibrate;
    let data = match samples {
        Samples::Dataset(dataset) => {
            let data = Data::open(dataset)?;
            let same = |found: &Latest| found.require_dataset(&data);
            if is_over(session, folder.path(), found.as_ref(), same, left_out)? {
                return Ok(());
            }
            data
        }
        Samples::OfPart { set, sampling, layout } => {
            let scene = arguments.scene.scene_with(session, &arguments.contact)?;
            let same = |found: &Latest| found.require_samples(&scene.record, set, sampling);
            if is_over(session, folder.path(), found.as_ref(), same, left_out)? {
                return Ok(());
            }
            if found.is_none() {
                // Before the samples, which are most of the work for a short training.
                let (record, batch) = (&scene.record, plan.batch);
                Footprint::new(session, &device, shape, &plan, record, batch, settings.held_out)?
                    .require(session, 0)?;
            }
            folder.create()?;
            let _claim = claim(folder.path())?;
            let dataset = folder.file("dataset");
            sampled(session, &dataset, &scene, set, sampling, layout)?;
            Data::open(&dataset)?
        }
    };
    folder.create()?;
    let model = match found {
        Some(found) => job::resumed_model(session, found, &data, arguments.length.rate)?,
        None => job::fresh_model(&data, shape, plan, TrainingState::new(&shape, plan.seed), None),
    };
    let model = job::run(session, &device, &data, model, folder.path(), &settings)?;
    concluded(session, folder.path(), &model, left_out)
}
