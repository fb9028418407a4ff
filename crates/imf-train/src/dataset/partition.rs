//! How a dataset is cut up, and which shards a machine makes when several make it together.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use imf_fields::recipe::Sampling;
use thiserror::Error;

use super::manifest::{Manifest, SHARD_SAMPLES};

/// How a dataset is cut up, and which part of it is made here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Layout {
    /// Maximum number of samples of a shard of a new dataset, unless one section has more; 4,000,000 by default. An
    /// existing dataset stays cut up as it is.
    pub shard_samples: Option<u64>,
    /// The partition to make; `None` makes all of it.
    pub partition: Option<Partition>,
}

/// Bytes that a sample takes while its shard is written: itself, in the tables of the file, and in the file.
const SAMPLE_BYTES: u64 = 24;

impl Layout {
    /// Memory of a shard of the dataset in a folder, or of a new one, of so many sections over a grid of so many voxels.
    #[must_use]
    pub fn shard_memory(&self, folder: &Path, voxels: usize, sampling: &Sampling, sections: usize) -> u64 {
        let per_section = voxels as f64 * sampling.density;
        let known = Manifest::read(folder).ok().map(|manifest| manifest.sections_per_shard);
        let sections = known.unwrap_or_else(|| self.sections_per_shard(per_section, sections));
        SAMPLE_BYTES * (per_section * sections as f64) as u64
    }

    /// Sections of a new shard.
    pub(super) fn sections_per_shard(&self, per_section: f64, sections: usize) -> usize {
        let most = self.shard_samples.unwrap_or(SHARD_SAMPLES) as f64 / per_section;
        (most as usize).clamp(1, sections.max(1))
    }
}

/// Share `index` (from 1) of `of`: every `of`-th shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Partition {
    index: usize,
    of: usize,
}

/// A text that names no partition.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("'{0}' is not a partition: write I/N with I from 1 to N, such as 3/8")]
pub struct PartitionError(String);

impl Partition {
    /// True where this partition makes that shard (counted from 0).
    #[must_use]
    pub fn holds(self, shard: usize) -> bool {
        shard % self.of == self.index - 1
    }

    /// The partition's own manifest; partitions may be made in one folder at the same time, each with its own manifest.
    pub(super) fn manifest_name(self) -> String {
        format!("manifest.{}-of-{}.json", self.index, self.of)
    }

    /// True for names that [`Self::manifest_name`] gives.
    pub(super) fn is_manifest_name(name: &str) -> bool {
        let middle = name.strip_prefix("manifest.").and_then(|rest| rest.strip_suffix(".json"));
        middle
            .and_then(|middle| middle.split_once("-of-"))
            .is_some_and(|(index, of)| format!("{index}/{of}").parse::<Self>().is_ok())
    }
}

impl FromStr for Partition {
    type Err = PartitionError;

    fn from_str(text: &str) -> Result<Self, PartitionError> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((index, of)) if (1..=of).contains(&index) => Ok(Self { index, of }),
            _ => Err(PartitionError(text.to_owned())),
        }
    }
}

impl fmt::Display for Partition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_split_the_shards() {
        for of in 1..6 {
            let partitions: Vec<Partition> = (1..=of).map(|i| format!("{i}/{of}").parse().unwrap()).collect();
            for shard in 0..20 {
                assert_eq!(partitions.iter().filter(|partition| partition.holds(shard)).count(), 1);
            }
        }
        for text in ["0/3", "4/3", "1", "a/b", "1/0", "-1/2", ""] {
            assert_eq!(text.parse::<Partition>(), Err(PartitionError(text.into())));
        }
        let partition: Partition = "3/8".parse().unwrap();
        assert_eq!(
            (partition.to_string(), partition.manifest_name()),
            ("3/8".into(), "manifest.3-of-8.json".into())
        );
        assert!(Partition::is_manifest_name("manifest.3-of-8.json"));
        for name in ["manifest.json", "manifest.9-of-8.json", "manifest.old.json", "manifest.1-of-8.json~"] {
            assert!(!Partition::is_manifest_name(name), "{name}");
        }
    }
}
