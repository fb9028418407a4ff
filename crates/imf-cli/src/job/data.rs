//! What a training learns from: a dataset, in memory where it fits, else read in groups while training runs.
//!
//! How many groups an epoch has decides the order of the samples. A fresh training takes as few as fit; their number
//! is recorded, and a continued training uses it on any machine.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use imf_core::scene::Scene;
use imf_fields::model::Model;
use imf_train::dataset::Shards;
use imf_train::samples::Samples;

use super::memory::Footprint;
use crate::interrupt;
use crate::session::{Session, show_bytes};

/// What a rank that has room for all samples says: one group has their order.
const WHOLE: u64 = 1;
/// What a rank says that has no room for any number of groups.
const NEVER: u64 = u64::MAX;

/// A dataset with what is known about it; its samples are not read yet.
pub struct Data {
    /// Where its samples are.
    pub shards: Shards,
    /// What it was sampled from.
    pub scene: Scene,
}

pub(super) enum Source {
    Memory(Samples),
    /// An epoch in this number of groups.
    Groups(usize),
}

impl Data {
    /// Opens a dataset's folder.
    pub fn open(folder: &Path) -> Result<Self> {
        let shards = Shards::open(folder)?;
        let scene = shards.manifest.scene(folder)?;
        // Samples are of the tip: where other sharp points lie makes no difference.
        if !scene.record.bare_tool().with_tip_only().is_axisymmetric()
            && shards.manifest.orientations.orientations.iter().any(|o| o.roll != 0.0)
        {
            bail!(
                "{}: its orientations roll the tool about its own axis, which siren5's five inputs cannot express; \
                 make a dataset with directions only",
                folder.display()
            );
        }
        Ok(Self { shards, scene })
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
        let room = session.memory_limit.saturating_sub(footprint.bytes());
        let fresh = model.record.steps == 0;
        let recorded = model.record.groups_per_epoch;
        let mut most = WHOLE;
        if fresh {
            let fits = if shards.memory_whole() <= room {
                WHOLE
            } else {
                shards.groups_within(room).map_or(NEVER, |groups| groups as u64)
            };
            // One order for all ranks: that of the one with the least memory.
            most = NEVER - session.rank().minimum(NEVER - fits)?;
            // Where nothing fits, the refusal speaks of the most groups that there can be.
            let groups = usize::try_from(most).unwrap_or(usize::MAX);
            model.record.groups_per_epoch = (most != WHOLE).then_some(groups);
        }
        let needed = footprint.bytes().saturating_add(self.memory(model.record.groups_per_epoch));
        session.require_memory(needed, || self.refusal(footprint, fresh, recorded))?;
        ensure!(most < NEVER, "another rank has too little memory for any part of the dataset");
        let Some(groups) = model.record.groups_per_epoch else {
            let samples = shards.read_all(&interrupt::INTERRUPTED).map_err(|error| {
                interrupt::explained(error, || {
                    "the training had not begun; run the same command again".into()
                })
            })?;
            return Ok(Source::Memory(samples));
        };
        session.note(&format!(
            "{} samples take {} of memory, so {} is read in {groups} groups an epoch, {} at a time",
            shards.samples(),
            show_bytes(shards.memory_whole()),
            shards.folder.display(),
            show_bytes(shards.memory_in_groups(groups)),
        ));
        Ok(Source::Groups(groups))
    }

    fn memory(&self, groups: Option<usize>) -> u64 {
        groups.map_or_else(|| self.shards.memory_whole(), |groups| self.shards.memory_in_groups(groups))
    }

    /// What takes the memory, and what can be done.
    fn refusal(&self, footprint: &Footprint, fresh: bool, recorded: Option<usize>) -> String {
        let shards = &self.shards;
        let folder = shards.folder.display();
        let samples = format!(
            "the {} samples of {folder} take {} at {} bytes each",
            shards.samples(),
            show_bytes(shards.memory_whole()),
            Samples::BYTES_PER_SAMPLE
        );
        let smaller = "make a dataset of smaller --shard-samples or lower --density";
        match recorded {
            _ if fresh => format!(
                "{footprint}; {samples}, or {} where one file is read after another and next to nothing of each is kept; {}, \
                 or {smaller}",
                show_bytes(shards.memory_in_groups(usize::MAX)),
                footprint.remedy()
            ),
            Some(groups) => format!(
                "{footprint}; the training was begun on {groups} groups an epoch of {folder}, two of which take {}, and \
                 another number would change the order of the samples; go on where that much is free",
                show_bytes(shards.memory_in_groups(groups))
            ),
            None => format!(
                "{footprint}; {samples}, and the training was begun with all of them in memory: reading them in groups \
                 would change their order; go on where that much is free"
            ),
        }
    }
}
