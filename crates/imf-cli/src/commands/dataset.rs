//! `imf dataset`: exact sections sampled into shards, whole or in partitions that are joined.

mod merge;

use std::path::Path;

use anyhow::Result;
use imf_core::orientation::OrientationSet;
use imf_core::scene::{Scene, SceneRecord};
use imf_core::section::SectionPlan;
use imf_fields::recipe::Sampling;
use imf_train::dataset::{DatasetError, GenerateSummary, Layout, Manifest, generate_partition};
use serde_json::json;

use crate::arguments::dataset::{
    DatasetAction, DatasetArguments, DatasetFinishArguments, DatasetMakeArguments, directions,
};
use crate::arguments::either::Either;
use crate::interrupt;
use crate::output::{FolderLock, lock_folder, prepare_folder, print_result};
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &DatasetArguments) -> Result<()> {
    match arguments {
        Either::Sub(DatasetAction::Merge(arguments)) => merge::run(session, arguments),
        Either::Sub(DatasetAction::Finish(arguments)) => finish(session, arguments),
        Either::Own(arguments) => make_new(session, arguments),
    }
}

fn make_new(session: &Session, arguments: &DatasetMakeArguments) -> Result<()> {
    let set = directions(&arguments.orientations)?;
    let sampling = arguments.sampling()?;
    let scene = arguments.scene.scene_with(session, &arguments.contact)?;
    let layout = Layout { shard_samples: arguments.shard_samples, partition: arguments.shard };
    let folder = &arguments.out;
    let work = DatasetWork { folder, scene: &scene, set: &set, sampling: &sampling, layout: &layout };
    work.require_shard(session)?;
    prepare_folder(folder)?;
    let _lock = lock_if_whole(folder, &layout)?;
    work.make(session)
}

/// Makes what is missing of a dataset from its own manifest.
fn finish(session: &Session, arguments: &DatasetFinishArguments) -> Result<()> {
    let folder = &arguments.folder;
    let manifest = Manifest::read(folder)?;
    let scene = manifest.scene(folder)?;
    prepare_folder(folder)?;
    let layout = Layout { partition: arguments.shard, ..Layout::default() };
    let _lock = lock_if_whole(folder, &layout)?;
    let (set, sampling) = (&manifest.orientations, &manifest.sampling);
    DatasetWork { folder, scene: &scene, set, sampling, layout: &layout }.make(session)
}

/// A folder that is made whole is this run's own; partitions are made beside each other.
fn lock_if_whole(folder: &Path, layout: &Layout) -> Result<Option<FolderLock>> {
    layout.partition.is_none().then(|| lock_folder(folder)).transpose()
}

/// Samples of a scene from a set of directions, in a folder.
pub(super) struct DatasetWork<'a> {
    pub(super) folder: &'a Path,
    pub(super) scene: &'a Scene,
    pub(super) set: &'a OrientationSet,
    pub(super) sampling: &'a Sampling,
    pub(super) layout: &'a Layout,
}

impl DatasetWork<'_> {
    fn make(&self, session: &Session) -> Result<()> {
        let Self { folder, set, layout, .. } = *self;
        let generated = self.sample(session)?;
        let GenerateSummary { samples, made, kept, others, .. } = generated;
        let json = json!({
            "folder": folder, "sections": set.len(), "samples": samples,
            "shards_made": made, "shards_kept": kept, "shards_of_others": others,
        });
        let text = match layout.partition {
            Some(partition) => format!(
                "{}: partition {partition}, {samples} samples in {} of {} shards; join the partitions by: imf dataset merge",
                folder.display(),
                made + kept,
                made + kept + others
            ),
            None => format!(
                "{}: {samples} samples of {} sections in {} shards",
                folder.display(),
                set.len(),
                made + kept
            ),
        };
        print_result(session, &json, &text)
    }

    /// Refuses shards that do not fit the memory.
    fn require_shard(&self, session: &Session) -> Result<()> {
        let Self { folder, scene, set, sampling, layout } = *self;
        let SceneRecord { grid, tool, .. } = &scene.record;
        let shard = layout.shard_memory(folder, grid.len(), sampling, set.len());
        session.require_memory(shard + SectionPlan::memory_estimate(grid, tool, session.threads()), || {
            "a shard of samples beside the exact sections; choose fewer --shard-samples".into()
        })
    }

    /// Makes what a folder lacks of a dataset, or of a partition of it.
    pub(super) fn sample(&self, session: &Session) -> Result<GenerateSummary> {
        let Self { folder, scene, set, sampling, layout } = *self;
        self.require_shard(session)?;
        let _keeping = interrupt::stop_cleanly();
        let stage = session.stage("sampling", "sections", set.len() as u64);
        let (advance, passed_over) = (|n| stage.advance(n), |n| stage.pass_over(n));
        let control = session.control(&advance);
        let generated = generate_partition(folder, scene, set, sampling, layout, control, &passed_over);
        let generated = generated.map_err(|error| interruption(error, folder))?;
        let others = match generated.others {
            0 => String::new(),
            others => format!(", {others} of other partitions"),
        };
        stage.finish(&format!("{} shards made, {} kept{others}", generated.made, generated.kept));
        if let Some(sections) = generated.otherwise_cut {
            session.note(&format!(
            "--shard-samples is passed over: {} is cut up already, at most {sections} sections a file, and stays so; choose another \
             folder to cut it otherwise",
            folder.display()
        ));
        }
        Ok(generated)
    }
}

/// An interruption says what is saved; other errors stay as they are.
pub fn interruption(error: DatasetError, folder: &Path) -> anyhow::Error {
    interrupt::explained(error, || {
        format!("finished shards are kept in {}; run the same command again to go on", folder.display())
    })
}
