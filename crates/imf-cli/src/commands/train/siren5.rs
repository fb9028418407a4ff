//! The paper's network on samples: those of a dataset, or of a part's own, which is made first; from random weights, or from
//! those of another network.

use std::path::Path;
use std::str::FromStr as _;

use anyhow::{Result, bail};
use glam::DVec3;
use imf_core::grid::Grid;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneRecord;
use imf_core::section::Quantity;
use imf_fields::factored::file::FactoredFile;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::model::Model;
use imf_fields::recipe::{Sampling, TrainingState};
use imf_train::dataset::{Layout, Manifest};
use serde_json::json;

use crate::arguments::clearance::ContactArguments;
use crate::arguments::quantity::scene_of;
use crate::arguments::scene::SceneArguments;
use crate::arguments::settings::checkpoint_every;
use crate::arguments::train::{FinetuneArguments, Siren5Arguments, Siren5Training};
use crate::commands::calibrate::calibrate_written;
use crate::commands::dataset::DatasetWork;
use crate::commands::notes;
use crate::engine::Device;
use crate::job::{self, Data, FIELD, Footprint, LatestCheckpoint, Settings};
use crate::output::{OutputFolder, lock_folder, print_result, require_other};
use crate::session::Session;

enum Samples<'a> {
    Dataset(&'a Path),
    OfPart(&'a SceneArguments, &'a ContactArguments),
}

pub(super) fn run(session: &Session, arguments: &Siren5Arguments) -> Result<()> {
    let Siren5Arguments { explicit, scene, contact, quantity, run, start, samples } = arguments;
    let subject = Path::new(&scene.part);
    let read = |path| Ok::<_, anyhow::Error>((path, start_model(path)?));
    let from = start.from.as_deref().map(read).transpose()?;
    let shape = from.as_ref().map_or_else(|| start.shape(), |(_, model)| model.shape);
    shape.check()?;
    let training = Siren5Training::new(explicit, run, samples, &shape, from.is_some())?;
    let of = if Manifest::is_in(subject) {
        let made = "a part, and the dataset was made with its own";
        explicit.refuse_scene(&[], made)?;
        Samples::Dataset(subject)
    } else if subject.is_file() || ReferencePart::from_str(&scene.part).is_ok() {
        if samples.mpi {
            bail!(
                "--mpi applies only to a dataset, and {} is a part: make its dataset first (imf dataset)",
                scene.part
            );
        }
        if !quantity.of(scene).is_overlap() {
            bail!(
                "siren5, the paper's network, learns overlaps alone, which hardly see a small cutter beside its holder: take \
                 imf train {}, which learns depths and decides, or say --quantity overlap for the paper's measure",
                scene.part
            );
        }
        Samples::OfPart(scene, contact)
    } else {
        bail!(
            "{} is neither a part (an OBJ, STL, PLY or 3MF file, or teapot, bracket, bracket-raw or screw-gear) nor \
             the folder of a dataset (see imf dataset)",
            scene.part
        );
    };
    trained(session, &training, shape, &of, from)
}

pub(crate) fn finetune(session: &Session, arguments: &FinetuneArguments) -> Result<()> {
    let FinetuneArguments { explicit, model, dataset, run, samples } = arguments;
    job::require_togetherness(session)?;
    let start = start_model(model)?;
    let training = Siren5Training::new(explicit, run, samples, &start.shape, true)?;
    trained(session, &training, start.shape, &Samples::Dataset(dataset), Some((model, start)))
}

/// The network to start from; a field of another family is named, and how to adapt it.
fn start_model(path: &Path) -> Result<Model> {
    let shown = path.display();
    if FactoredFile::is_one(path) {
        bail!(
            "{shown} is a factored field, and models of siren5 are adapted here: imf train factored PART --from {shown} adapts it to a \
             changed part"
        );
    }
    if HarmonicFile::is_one(path) {
        bail!(
            "{shown} is a harmonic field, and models of siren5 are adapted here: make one of the changed part anew by imf train \
             harmonic"
        );
    }
    Ok(Model::read(path)?)
}

fn trained(
    session: &Session,
    training: &Siren5Training<'_>,
    shape: imf_fields::siren::SirenShape,
    samples: &Samples<'_>,
    from: Option<(&Path, Model)>,
) -> Result<()> {
    let Siren5Training { run, plan, .. } = training;
    let folder = OutputFolder::check(&run.out)?;
    if let Some((path, _)) = from.as_ref().filter(|_| !run.resume) {
        require_other(path, &folder.file(FIELD))?;
    }
    // Of several ranks the first writes.
    let _lock = session.rank().is_first().then(|| lock_folder(&folder.path)).transpose()?;
    // Before anything is made for a training that cannot go on, or need not.
    let found = job::to_resume::<Model>(&folder.path, run.resume)?;
    let settings = Settings {
        checkpoint_every: checkpoint_every(training.set.checkpoint_every)?,
        go_on: "add --resume",
        slower: " with --rate ",
        held_out: training.held_out(),
        held_out_every: training.set.held_out_every,
    };
    if let Some(found) = &found {
        if let Some((_, start)) = &from {
            found.require_origin(start)?;
        }
        found.require_options(shape, training)?;
    }
    let is_over = |same: &dyn Fn(&LatestCheckpoint) -> Result<()>| -> Result<bool> {
        let Some(found) = &found else { return Ok(false) };
        same(found)?;
        let Some(model) = found.finished(session, &folder.path, StoragePrecision::F32)? else {
            return Ok(false);
        };
        conclude(session, &folder.path, &model, !run.no_calibrate)?;
        Ok(true)
    };
    let device = Device::open(run.device.as_deref().unwrap_or("auto"), session)?;
    device.require_precision(plan.precision)?;
    let data = match samples {
        Samples::Dataset(dataset) => {
            let data = Data::open(dataset)?;
            if is_over(&|found| found.require_dataset(&data))? {
                return Ok(());
            }
            data
        }
        Samples::OfPart(scene, contact) => {
            let scene = scene_of(Quantity::Overlap, training.explicit, scene);
            // With the axes: a network that met no vertical direction errs most there.
            let set = OrientationSet::parse(OrientationSet::usual(true, false))?;
            let sampling = Sampling { seed: plan.seed, ..Sampling::default() };
            let scene = scene.scene_with(session, contact)?;
            notes::of_roll(session, &scene.record);
            if is_over(&|found| found.require_samples(&scene.record, &set, &sampling))? {
                return Ok(());
            }
            if found.is_none() {
                // Before the samples, which are most of the work for a short training.
                let (record, batch) = (&scene.record, plan.batch);
                Footprint::new(session, &device, shape, plan, record, batch, settings.held_out)?
                    .require(session)?;
            }
            folder.create()?;
            let _lock = lock_folder(&folder.path)?;
            let (dataset, layout) = (folder.file("dataset"), &Layout::default());
            DatasetWork { folder: &dataset, scene: &scene, set: &set, sampling: &sampling, layout }
                .sample(session)?;
            Data::open(&dataset)?
        }
    };
    folder.create()?;
    let model = match (found, from) {
        (Some(found), _) => job::resumed_model(session, found, &data, run.rate)?,
        (None, Some((_, start))) => {
            if start.scene.record.tool.shape != data.scene.record.tool.shape {
                session.warn(
                    "the model was made for another tool than the dataset; it will be adapted all the same",
                );
            }
            if is_of_another_box(&start.scene.record, &data.scene.record) {
                session.warn(
                    "the model was made for another box than the dataset's (another margin, or another part): what it has learnt \
                     stands at other places there, and may serve less than random weights",
                );
            }
            let weights = job::weights_crc32(&start.state.parameters);
            let state = TrainingState::from_parameters(start.state.parameters);
            let mut model = job::fresh_model(&data, shape, *plan, state, Some(start.scene.record.part));
            model.record.fine_tuned_weights = Some(weights);
            model
        }
        (None, None) => job::fresh_model(&data, shape, *plan, TrainingState::new(&shape, plan.seed), None),
    };
    let model = job::run(session, &device, &data, model, &folder.path, &settings)?;
    conclude(session, &folder.path, &model, !run.no_calibrate)
}

/// Whether positions in two grids' boxes, of which siren5 knows nothing but the fraction, are apart by more than their voxels explain.
fn is_of_another_box(one: &SceneRecord, other: &SceneRecord) -> bool {
    let scale = one.unit.in_mm() / other.unit.in_mm();
    let ends = |grid: &Grid, scale: f64| -> [DVec3; 2] {
        [grid.origin, grid.origin + grid.size()].map(|end| scale * end)
    };
    let mut apart =
        ends(&one.grid, scale).into_iter().zip(ends(&other.grid, 1.0)).map(|(one, other)| one - other);
    let voxel = (scale * one.grid.pitch).max(other.grid.pitch);
    apart.any(|apart| apart.abs().max_element() > 1.5 * voxel)
}

/// The end of a training: error rates of the model's decisions, and its closing lines.
fn conclude(session: &Session, out: &Path, model: &Model, calibrate: bool) -> Result<()> {
    if !session.rank().is_first() {
        return Ok(());
    }
    let path = out.join(FIELD);
    let quality = calibrate_written(session, &path, calibrate)?;
    let record = &model.record;
    let json = json!({
        "field": path, "steps": record.steps, "seconds": record.seconds, "loss": record.losses.last().map(|p| p.loss),
        "parameters": model.shape.parameter_count(), "engine": record.engine,
        "held_out": record.held_out.as_ref().and_then(|held| held.errors.last()), "verdict": quality.json(),
    });
    let (shown, steps) = (path.display(), record.steps);
    let text = format!("{shown}: {steps} steps; compare with: imf eval {shown}\n{}", quality.text());
    print_result(session, &json, &text)
}
