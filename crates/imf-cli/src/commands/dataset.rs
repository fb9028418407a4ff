//! `imf dataset`: exact sections sampled into shards.

use std::path::Path;

use anyhow::{Result, bail};
use imf_core::dataset::{DatasetError, Sampling, generate};
use imf_core::orientation::OrientationSet;
use imf_core::section::SectionError;
use serde_json::json;

use crate::arguments::DatasetArguments;
use crate::interrupt::Interrupted;
use crate::output::{prepare_folder, print, print_json};
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &DatasetArguments) -> Result<()> {
    let set = OrientationSet::parse(&arguments.orientations)?;
    let sampling = Sampling {
        density: arguments.density,
        positive_share: arguments.positive_share,
        boundary_share: arguments.boundary_share,
        boundary_width: arguments.boundary_width,
        seed: arguments.seed,
    };
    sampling.check()?;
    let scene = arguments.scene.scene(session)?;
    if set.orientations.iter().any(|o| o.roll != 0.0) {
        bail!(
            "'{}' rolls the tool about its own axis, which a learnt field of directions cannot express; use fibonacci:N",
            set.spec
        );
    }
    prepare_folder(&arguments.out)?;
    let stage = session.stage("sampling", "sections", set.len() as u64);
    let advance = |n| stage.advance(n);
    let generated = generate(&arguments.out, &scene, &set, &sampling, session.control(&advance));
    let generated = generated.map_err(|error| interruption(error, &arguments.out))?;
    stage.finish(&format!("{} shards made, {} kept", generated.made, generated.kept));
    if session.json {
        return print_json(&json!({
            "folder": arguments.out, "sections": set.len(), "samples": generated.samples,
            "shards_made": generated.made, "shards_kept": generated.kept,
        }));
    }
    print(&format!(
        "{}: {} samples of {} sections in {} shards",
        arguments.out.display(),
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
