//! What can be wrong with a dataset, in words.

use imf_core::atomic_file::AtomicFileError;
use imf_core::section::SectionError;
use imf_fields::recipe::SamplingError;
use thiserror::Error;

use super::manifest::VERSION;

/// Why a dataset cannot be made or read. Every message names the file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// A file or folder cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
    /// The folder cannot be made.
    #[error("cannot create the folder {path}: {source}")]
    Folder {
        /// The folder.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// No dataset, or a damaged one.
    #[error("{path} is not an intact dataset file: {what}")]
    Damaged {
        /// The file.
        path: String,
        /// What is wrong.
        what: String,
    },
    /// Made by a newer program.
    #[error("{path} has version {found}, and this program reads version {VERSION}: use a newer imf")]
    Newer {
        /// The manifest.
        path: String,
        /// Its version.
        found: u32,
    },
    /// The folder holds a dataset of another scene or sampling.
    #[error("{path} is of another dataset ({what} differs): choose another folder, or remove that one")]
    Other {
        /// The manifest.
        path: String,
        /// What differs.
        what: &'static str,
    },
    /// Some shards are not there yet.
    #[error("{path} lacks {missing} of {shards} shards: finish it as it was begun")]
    Unfinished {
        /// The folder.
        path: String,
        /// Shards that are missing.
        missing: usize,
        /// Shards in all.
        shards: usize,
    },
    /// The folder holds partitions that nobody has joined.
    #[error(
        "{path} holds {manifests} partition(s) of a dataset and no manifest.json: they must be merged first"
    )]
    Partitions {
        /// The folder.
        path: String,
        /// How many manifests of partitions there are.
        manifests: usize,
    },
    /// Nothing to join.
    #[error("there is no dataset to join")]
    NoPartitions,
    /// Two folders hold different datasets.
    #[error(
        "{path} is of another dataset than {than} ({what} differs): leave one of the two out, or make it again in a folder of its own"
    )]
    Unlike {
        /// The manifest.
        path: String,
        /// The one it was compared with.
        than: String,
        /// What differs.
        what: &'static str,
    },
    /// Two folders hold one shard with different content.
    #[error(
        "{shard} differs between {first} and {second}, though scene, orientations and sampling agree: a machine \
         computed it wrongly, or its manifest was changed; make both again and compare"
    )]
    Disagree {
        /// The shard's file name.
        shard: String,
        /// A folder that names it.
        first: String,
        /// Another one.
        second: String,
    },
    /// A fraction out of range.
    #[error(transparent)]
    Sampling(#[from] SamplingError),
    /// A section failed, or the work was interrupted.
    #[error(transparent)]
    Section(#[from] SectionError),
}
