//! The paper's network on samples: those of a dataset, or of a part's own, which is made first.

use anyhow::Result;
use imf_core::siren::SirenShape;
use imf_core::training::TrainingState;

use super::{announce, calibrated};
use crate::arguments::train::{Samples, TrainArguments};
use crate::commands::dataset::sampled;
use crate::engine::Device;
use crate::job::{self, Data, Settings};
use crate::output::OutputFolder;
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
    let device = Device::open(arguments.device_or("auto"), session)?;
    device.require_precision(plan.precision)?;
    let data = match samples {
        Samples::Dataset(dataset) => Data::open(dataset)?,
        Samples::OfPart { set, sampling, layout } => {
            if !arguments.resume {
                job::refuse_unfinished(folder.path())?;
            }
            let scene = arguments.scene.scene_with(session, &arguments.contact)?;
            folder.create()?;
            let dataset = folder.file("dataset");
            sampled(session, &dataset, &scene, set, sampling, layout)?;
            Data::open(&dataset)?
        }
    };
    folder.create()?;
    let model = if arguments.resume {
        job::resumed_model(session, folder.path(), &data, arguments.length.rate)?
    } else {
        job::refuse_unfinished(folder.path())?;
        job::fresh_model(&data, shape, plan, TrainingState::new(&shape, plan.seed), None)
    };
    let settings = Settings::new(&arguments.length, &arguments.plan);
    let model = job::run(session, &device, &data, model, folder.path(), &settings)?;
    let path = folder.file("model.safetensors");
    announce(session, &path, &model)?;
    calibrated(session, &path, &model, arguments.no_calibrate)
}
