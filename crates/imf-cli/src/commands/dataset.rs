//! `imf dataset`: exact sections sampled into shards, whole or in shares that are joined.

mod merge;

use std::path::Path;

use anyhow::{Result, bail};
use imf_core::dataset::{DatasetError, Layout, Manifest, Sampling, generate_share};
use imf_core::orientation::OrientationSet;
use imf_core::scene::Scene;
use imf_core::section::SectionError;
use serde_json::json;

use crate::arguments::dataset::{
    DatasetAction, DatasetArguments, DatasetFinishArguments, DatasetMakeArguments,
};
use crate::interrupt::Interrupted;
use crate::output::{prepare_folder, print, print_json};
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &DatasetArguments) -> Result<()> {
    match arguments {
        DatasetArguments::Act(DatasetAction::Merge(arguments)) => merge::run(session, arguments),
        DatasetArguments::Act(DatasetAction::Finish(arguments)) => finish(session, arguments),
        DatasetArguments::Make(arguments) => make_new(session, arguments),
    }
}

fn make_new(session: &Session, arguments: &DatasetMakeArguments) -> Result<()> {
    let set = OrientationSet::parse(&arguments.orientations)?;
    let sampling = Sampling {
        density: arguments.density,
        positive_share: arguments.positive_share,
        boundary_share: arguments.boundary_share,
        boundary_width: arguments.boundary_width,
        seed: arguments.seed,
    };
    sampling.check()?;
    let scene = arguments.scene.scene_with(session, &arguments.contact)?;
    if set.orientations.iter().any(|o| o.roll != 0.0) {
        bail!(
            "'{}' rolls the tool about its own axis, which a learnt field of directions cannot express; use fibonacci:N",
            set.spec
        );
    }
    prepare_folder(&arguments.out)?;
    let layout = Layout { shard_samples: arguments.shard_samples, share: arguments.shard };
    make(session, &arguments.out, &scene, &set, &sampling, &layout)
}

/// Makes what is missing of a dataset from its own manifest.
fn finish(session: &Session, arguments: &DatasetFinishArguments) -> Result<()> {
    let folder = &arguments.folder;
    let manifest = Manifest::read(folder)?;
    let scene = manifest.scene(folder)?;
    prepare_folder(folder)?;
    let layout = Layout { share: arguments.shard, ..Layout::default() };
    make(session, folder, &scene, &manifest.orientations, &manifest.sampling, &layout)
}

fn make(
    session: &Session,
    folder: &Path,
    scene: &Scene,
    set: &OrientationSet,
    sampling: &Sampling,
    layout: &Layout,
) -> Result<()> {
    let stage = session.stage("sampling", "sections", set.len() as u64);
    let advance = |n| stage.advance(n);
    let generated = generate_share(folder, scene, set, sampling, layout, session.control(&advance));
    let generated = generated.map_err(|error| interruption(error, folder))?;
    let others = match generated.others {
        0 => String::new(),
        others => format!(", {others} of other shares"),
    };
    stage.finish(&format!("{} shards made, {} kept{others}", generated.made, generated.kept));
    if session.json {
        return print_json(&json!({
            "folder": folder, "sections": set.len(), "samples": generated.samples,
            "shards_made": generated.made, "shards_kept": generated.kept, "shards_of_others": generated.others,
        }));
    }
    if let Some(share) = layout.share {
        return print(&format!(
            "{}: share {share}, {} samples in {} of {} shards; join the shares by: imf dataset merge",
            folder.display(),
            generated.samples,
            generated.made + generated.kept,
            generated.made + generated.kept + generated.others
        ));
    }
    print(&format!(
        "{}: {} samples of {} sections in {} shards",
        folder.display(),
        generated.samples,
        set.len(),
        generated.made + generated.kept
    ))
}

/// An interrupted dataset says what is kept; other errors stay as they are.
pub(super) fn interruption(error: DatasetError, folder: &Path) -> anyhow::Error {
    match error {
        DatasetError::Section(SectionError::Cancelled) => Interrupted(format!(
            "finished shards are kept in {}; run the same command again to go on",
            folder.display()
        ))
        .into(),
        other => other.into(),
    }
}
