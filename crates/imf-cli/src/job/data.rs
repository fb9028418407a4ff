//! What a training learns from: a dataset in memory.

use std::path::Path;

use anyhow::{Result, bail};
use imf_core::dataset::{self, Manifest};
use imf_core::samples::Samples;
use imf_core::scene::Scene;

use crate::session::Session;

/// A dataset in memory with what is known about it.
pub(crate) struct Data {
    pub(crate) manifest: Manifest,
    pub(crate) scene: Scene,
    pub(crate) samples: Samples,
}

impl Data {
    /// Reads a dataset's folder, if it fits the memory.
    pub(crate) fn load(session: &Session, folder: &Path) -> Result<Self> {
        let expected = Manifest::read(folder)?.shards.iter().flatten().map(|s| s.samples).sum::<u64>();
        // 8 bytes a sample, and one shard twice while it is read.
        session.require_memory(expected * 8 + (64 << 20), || {
            format!("the {expected} samples of {}; make a dataset of lower --density", folder.display())
        })?;
        let (manifest, scene, samples) = dataset::load(folder)?;
        if !scene.record.tool.is_axisymmetric()
            && manifest.orientations.orientations.iter().any(|o| o.roll != 0.0)
        {
            bail!(
                "{}: its orientations roll the tool about its own axis, which siren5's five inputs cannot express; \
                 make a dataset with directions only",
                folder.display()
            );
        }
        Ok(Self { manifest, scene, samples })
    }
}
