//! How a dataset is cut up, and which shards a machine makes when several make it together.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

/// How a dataset is cut up, and which part of it is made here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Layout {
    /// Maximum number of samples of a shard of a new dataset, unless one section has more; 4,000,000 by default. An
    /// existing dataset stays cut up as it is.
    pub shard_samples: Option<u64>,
    /// The partition to make; `None` makes all of it.
    pub partition: Option<Partition>,
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
