//! A complete dataset whose shards are read when they are wanted: all of them, or a few at a time.
//!
//! What both cost is computed here and nowhere else. In memory a dataset takes its samples
//! ([`Samples::memory_bytes`]) and, while they are read, the largest shard's file. In groups of `g` shards it takes
//! twice the `g` largest shards, one group that is used and one that is read, and again one file.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use super::manifest::{DatasetError, Manifest};
use super::shard;
use crate::grid::Grid;
use crate::samples::Samples;
use crate::section::SectionError;

/// The shards of a complete dataset.
#[derive(Clone, Debug)]
pub struct Shards {
    folder: PathBuf,
    manifest: Manifest,
    /// The grid whose unit coordinates the network's inputs are ([`Samples::frame`]); the dataset's own at first.
    pub frame: Grid,
}

impl Shards {
    /// Reads and checks the manifest, and looks whether the shards have the size that it says; reads none yet.
    ///
    /// # Errors
    /// A missing, foreign, newer, damaged or unfinished dataset; the message names the file.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let manifest = Manifest::read(folder)?;
        let missing = manifest.shards.iter().filter(|s| s.is_none()).count();
        if missing > 0 {
            return Err(DatasetError::Unfinished {
                path: folder.display().to_string(),
                missing,
                shards: manifest.shards.len(),
            });
        }
        for index in 0..manifest.shards.len() {
            shard::open(folder, &manifest, index)?;
        }
        Ok(Self { folder: folder.to_owned(), frame: manifest.scene.grid, manifest })
    }

    /// What the dataset is.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// What the dataset is, alone.
    #[must_use]
    pub fn into_manifest(self) -> Manifest {
        self.manifest
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Number of shards.
    #[must_use]
    pub fn count(&self) -> usize {
        self.manifest.shards.len()
    }

    /// Samples of one shard.
    #[must_use]
    pub fn samples_of(&self, shard: usize) -> usize {
        self.manifest.shards[shard].as_ref().map_or(0, |record| record.samples as usize)
    }

    /// Samples of all shards.
    #[must_use]
    pub fn samples(&self) -> usize {
        (0..self.count()).map(|shard| self.samples_of(shard)).sum()
    }

    /// Most samples that `shards` shards have, whichever they are.
    #[must_use]
    pub fn most_samples(&self, shards: usize) -> usize {
        let mut samples: Vec<usize> = (0..self.count()).map(|shard| self.samples_of(shard)).collect();
        samples.sort_unstable_by(|a, b| b.cmp(a));
        samples.iter().take(shards).sum()
    }

    /// Most sections that `shards` shards have.
    #[must_use]
    pub fn most_sections(&self, shards: usize) -> usize {
        (shards.saturating_mul(self.manifest.sections_per_shard)).min(self.manifest.orientations.len())
    }

    /// Bytes that the largest file takes while it is read.
    fn largest_file(&self) -> u64 {
        shard::file_bytes(self.manifest.sections_per_shard as u64, self.most_samples(1) as u64)
    }

    /// Memory of the whole dataset, while it is read and after.
    #[must_use]
    pub fn memory_whole(&self) -> u64 {
        let sections = self.manifest.orientations.len() as u64;
        Samples::memory_bytes(sections, self.samples() as u64).saturating_add(self.largest_file())
    }

    /// Memory of a training that reads `group` shards at a time: a group that is used, one that is read, and a file.
    #[must_use]
    pub fn memory_in_groups(&self, group: usize) -> u64 {
        let (sections, samples) = (self.most_sections(group) as u64, self.most_samples(group) as u64);
        Samples::memory_bytes(sections, samples).saturating_mul(2).saturating_add(self.largest_file())
    }

    /// Shards of a group, as many as fit `bytes` ([`Self::memory_in_groups`]); fewer where as few groups can have
    /// more equal sizes. Nothing where not even one shard fits.
    #[must_use]
    pub fn group_within(&self, bytes: u64) -> Option<usize> {
        let fits = |group: &usize| self.memory_in_groups(*group) <= bytes;
        let most = (1..=self.count()).rev().find(fits)?;
        Some(self.count().div_ceil(self.count().div_ceil(most)))
    }

    /// Reads shards in the order given into `into`, whose samples go; its room is used again. `file` is room for one
    /// file's content.
    ///
    /// # Errors
    /// A damaged shard, or cancellation between two shards once `cancelled` is set.
    pub fn read_into(
        &self,
        shards: &[usize],
        file: &mut Vec<u8>,
        into: &mut Samples,
        cancelled: &AtomicBool,
    ) -> Result<(), DatasetError> {
        into.clear();
        for &shard in shards {
            if cancelled.load(Ordering::Relaxed) {
                return Err(SectionError::Cancelled.into());
            }
            shard::read_into(&self.folder, &self.manifest, shard, file, into)?;
        }
        Ok(())
    }

    /// Room for the samples of any `shards` shards.
    #[must_use]
    pub fn room_for(&self, shards: usize) -> Samples {
        let room = Samples::with_capacity(
            self.manifest.scene.grid,
            self.most_sections(shards),
            self.most_samples(shards),
        );
        Samples { frame: self.frame, ..room }
    }

    /// Reads all shards.
    ///
    /// # Errors
    /// As [`Self::read_into`].
    pub fn read_all(&self, cancelled: &AtomicBool) -> Result<Samples, DatasetError> {
        let all: Vec<usize> = (0..self.count()).collect();
        let mut samples = self.room_for(all.len());
        self.read_into(&all, &mut Vec::new(), &mut samples, cancelled)?;
        Ok(samples)
    }
}
