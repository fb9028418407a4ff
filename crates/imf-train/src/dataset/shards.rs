//! A complete dataset whose shards are read when they are wanted: whole, or a part of every section.
//!
//! What both cost is computed here and nowhere else. In memory a dataset takes its samples
//! ([`Samples::memory_bytes`]) and, while they are read, the largest shard's file. In `g` groups it takes twice a `g`-th of
//! all samples, one group that is used and one that is read, and again one file.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use super::error::DatasetError;
use super::manifest::Manifest;
use super::shard;
use crate::samples::Samples;
use imf_core::control::Cancelled;
use imf_core::grid::Grid;
use imf_core::section::SectionError;

/// The shards of a complete dataset.
#[derive(Clone, Debug)]
pub struct Shards {
    /// The folder.
    pub folder: PathBuf,
    /// What the dataset is.
    pub manifest: Manifest,
    /// The grid whose unit coordinates the network's inputs are ([`Samples::frame`]); the dataset's own at first.
    pub frame: Grid,
}

impl Shards {
    /// Reads and checks the manifest and the sizes of the shards; reads no shard yet.
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

    pub(crate) fn count(&self) -> usize {
        self.manifest.shards.len()
    }

    pub(crate) fn samples_of(&self, shard: usize) -> usize {
        self.manifest.shards[shard].as_ref().map_or(0, |record| record.samples as usize)
    }

    /// Samples of all shards.
    #[must_use]
    pub fn samples(&self) -> usize {
        (0..self.count()).map(|shard| self.samples_of(shard)).sum()
    }

    /// Samples of the largest shard.
    fn most_samples(&self) -> usize {
        (0..self.count()).map(|shard| self.samples_of(shard)).max().unwrap_or(0)
    }

    /// Samples that a group has at most where every shard's are dealt to `groups` groups.
    fn most_of_group(&self, groups: usize) -> usize {
        (0..self.count()).map(|shard| self.samples_of(shard).div_ceil(groups.max(1))).sum()
    }

    /// Bytes that the largest file takes while it is read.
    fn largest_file(&self) -> u64 {
        shard::file_bytes(self.manifest.sections_per_shard as u64, self.most_samples() as u64)
    }

    /// Memory of the whole dataset, while it is read and after.
    #[must_use]
    pub fn memory_whole(&self) -> u64 {
        let sections = self.manifest.orientations.len() as u64;
        Samples::memory_bytes(sections, self.samples() as u64).saturating_add(self.largest_file())
    }

    /// Memory of a training that reads the dataset in `groups` groups: one that is used, one that is read, and a file.
    #[must_use]
    pub fn memory_in_groups(&self, groups: usize) -> u64 {
        let (sections, samples) =
            (self.manifest.orientations.len() as u64, self.most_of_group(groups) as u64);
        Samples::memory_bytes(sections, samples).saturating_mul(2).saturating_add(self.largest_file())
    }

    /// The fewest groups that fit `bytes` ([`Self::memory_in_groups`]). Nothing where not even one sample of each shard
    /// at a time does.
    #[must_use]
    pub fn groups_within(&self, bytes: u64) -> Option<usize> {
        let most = self.most_samples().max(1);
        let fits = |groups: usize| self.memory_in_groups(groups) <= bytes;
        // More groups never take more memory: the first that fits lies in (low, high].
        let (mut low, mut high) = (0, most);
        if !fits(high) {
            return None;
        }
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if fits(middle) { high = middle } else { low = middle }
        }
        Some(high)
    }

    /// Reads the samples of all shards that `keep` wants, by shard and number in it, into `into`, whose samples go; its
    /// room is used again. `file` is room for one file's content.
    ///
    /// # Errors
    /// A damaged shard, or cancellation between two shards once `cancelled` is set.
    pub(crate) fn read_into(
        &self,
        file: &mut Vec<u8>,
        into: &mut Samples,
        cancelled: &AtomicBool,
        keep: &dyn Fn(usize, usize) -> bool,
    ) -> Result<(), DatasetError> {
        into.clear();
        for shard in 0..self.count() {
            if cancelled.load(Ordering::Relaxed) {
                return Err(SectionError::from(Cancelled).into());
            }
            shard::read_into(&self.folder, &self.manifest, shard, file, into, |sample| keep(shard, sample))?;
        }
        Ok(())
    }

    /// Room for the samples of any of `groups` groups.
    pub(crate) fn room_for(&self, groups: usize) -> Samples {
        let sections = self.manifest.orientations.len();
        let room = Samples::with_capacity(self.manifest.scene.grid, sections, self.most_of_group(groups));
        Samples { frame: self.frame, ..room }
    }

    /// Reads all shards.
    ///
    /// # Errors
    /// A damaged shard, or cancellation between two shards once `cancelled` is set.
    pub fn read_all(&self, cancelled: &AtomicBool) -> Result<Samples, DatasetError> {
        let mut samples = self.room_for(1);
        self.read_into(&mut Vec::new(), &mut samples, cancelled, &|_, _| true)?;
        Ok(samples)
    }
}
