//! What a training learns from: a dataset, in memory where it fits, else read in groups of shards.
//!
//! How many shards a group has decides the order of the samples. A fresh training takes as many as fit; it is recorded,
//! and whoever goes on keeps it, on whatever machine.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use imf_core::dataset::{DatasetError, Manifest, Shards};
use imf_core::model::Model;
use imf_core::samples::Samples;
use imf_core::scene::Scene;
use imf_core::section::SectionError;

use super::memory::Footprint;
use crate::interrupt::{self, Interrupted};
use crate::session::{Session, show_bytes};

/// What a rank that has room for all shards says instead of their number.
const WHOLE: u64 = u64::MAX;

/// A dataset with what is known about it; its samples are not read yet.
pub(crate) struct Data {
    pub(crate) shards: Shards,
    pub(crate) scene: Scene,
}

/// Where the samples of a training are.
pub(super) enum Source {
    Memory(Samples),
    /// In so many shards at a time.
    Groups(usize),
}

impl Data {
    /// Opens a dataset's folder.
    pub(crate) fn open(folder: &Path) -> Result<Self> {
        let shards = Shards::open(folder)?;
        let scene = shards.manifest().scene(folder)?;
        if !scene.record.bare_tool().is_axisymmetric()
            && shards.manifest().orientations.orientations.iter().any(|o| o.roll != 0.0)
        {
            bail!(
                "{}: its orientations roll the tool about its own axis, which siren5's five inputs cannot express; \
                 make a dataset with directions only",
                folder.display()
            );
        }
        Ok(Self { shards, scene })
    }

    pub(crate) fn manifest(&self) -> &Manifest {
        self.shards.manifest()
    }

    /// Where the samples of `model`'s training are, beside all else that it takes; a fresh one's record says it from now
    /// on. Samples that fit are read.
    pub(super) fn source(
        &self,
        session: &Session,
        footprint: &Footprint,
        model: &mut Model,
    ) -> Result<Source> {
        let shards = &self.shards;
        let room = session.memory_limit().saturating_sub(footprint.bytes());
        let fresh = model.record.steps == 0;
        let recorded = model.record.shards_per_group;
        let mut least = WHOLE;
        if fresh {
            let fits = if shards.memory_whole() <= room {
                WHOLE
            } else {
                shards.group_within(room).map_or(0, |group| group as u64)
            };
            // One order for all ranks: that of the one with the least memory.
            least = session.rank().least(fits)?;
            // A group of one is what the refusal speaks of where nothing fits.
            model.record.shards_per_group = (least != WHOLE).then_some(least.max(1) as usize);
        }
        let needed = footprint.bytes().saturating_add(self.memory(model.record.shards_per_group));
        session.require_memory(needed, || self.refusal(footprint, fresh, recorded))?;
        ensure!(least > 0, "another rank has too little memory for even one shard at a time");
        let Some(group) = model.record.shards_per_group else {
            return Ok(Source::Memory(shards.read_all(interrupt::flag()).map_err(interruption)?));
        };
        session.note(&format!(
            "{} samples take {} of memory, so {} is read in groups of {group} of its {} shards, {} in all",
            shards.samples(),
            show_bytes(shards.memory_whole()),
            shards.folder().display(),
            shards.count(),
            show_bytes(shards.memory_in_groups(group)),
        ));
        Ok(Source::Groups(group))
    }

    /// Bytes of the samples, all of them or in groups.
    fn memory(&self, group: Option<usize>) -> u64 {
        group.map_or_else(|| self.shards.memory_whole(), |group| self.shards.memory_in_groups(group))
    }

    /// What takes the memory, and what can be done.
    fn refusal(&self, footprint: &Footprint, fresh: bool, recorded: Option<usize>) -> String {
        let shards = &self.shards;
        let folder = shards.folder().display();
        let samples = format!(
            "the {} samples of {folder} take {} at {} bytes each",
            shards.samples(),
            show_bytes(shards.memory_whole()),
            Samples::BYTES_PER_SAMPLE
        );
        let smaller = "make a dataset of smaller --shard-samples or lower --density";
        match recorded {
            _ if fresh => format!(
                "{footprint}; {samples}, or {} where one shard is read while another is used; use a smaller --width or \
                 --batch, or {smaller}",
                show_bytes(shards.memory_in_groups(1))
            ),
            Some(group) => format!(
                "{footprint}; the training was begun on groups of {group} of the {} shards of {folder}, two of which take \
                 {}, and another size would change the order of the samples; go on where that much is free",
                shards.count(),
                show_bytes(shards.memory_in_groups(group))
            ),
            None => format!(
                "{footprint}; {samples}, and the training was begun with all of them in memory: reading them in groups \
                 would change their order; go on where that much is free"
            ),
        }
    }
}

/// A dataset that nobody waited for until it was read.
fn interruption(error: DatasetError) -> anyhow::Error {
    match error {
        DatasetError::Section(SectionError::Cancelled) => {
            Interrupted("the training had not begun; run the same command again".into()).into()
        }
        other => other.into(),
    }
}
