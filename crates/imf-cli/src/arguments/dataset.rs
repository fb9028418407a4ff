//! The arguments of `imf dataset`: to make a dataset, or to join or finish what was made of it.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::{Args, Subcommand};
use imf_core::orientation::OrientationSet;
use imf_fields::recipe::Sampling;
use imf_train::dataset::Partition;

use super::clearance;
use super::either::Either;
use super::scene::SceneArguments;
use crate::exit::WrongArgument;

/// A dataset is made, or what was made of it is joined or finished.
pub(crate) type DatasetArguments = Either<DatasetMakeArguments, DatasetAction>;

#[derive(Subcommand)]
pub(crate) enum DatasetAction {
    Merge(DatasetMergeArguments),
    Finish(DatasetFinishArguments),
}

/// Join partitions of a dataset that were made apart, after checking that they belong together and are whole
#[derive(Args)]
#[command(
    after_help = "Examples:\n  imf dataset merge teapot-225 partition-1 partition-2\n  imf dataset merge together\n\n\
                        What is missing is listed, and the exit code is 1 then."
)]
pub(crate) struct DatasetMergeArguments {
    /// Folder of the joined dataset; it may hold partitions itself
    pub(crate) out: PathBuf,
    /// Folders of partitions
    pub(crate) folders: Vec<PathBuf>,
}

/// Make what is missing of a dataset from what its folder says of itself; the part's mesh is not needed
#[derive(Args)]
#[command(after_help = "Example:\n  imf dataset finish teapot-225")]
pub(crate) struct DatasetFinishArguments {
    /// Folder of the dataset
    pub(crate) folder: PathBuf,
    /// Only partition I of N
    #[arg(long, value_name = "I/N")]
    pub(crate) shard: Option<Partition>,
}

/// Which sections to sample, how, and which of them here.
#[derive(Args)]
pub(crate) struct DatasetMakeArguments {
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    #[command(flatten)]
    pub(crate) contact: clearance::ContactArguments,
    /// A set of directions, see below, without those of the part (normals) and without rolls
    #[arg(long, value_name = "SET", allow_hyphen_values = true)]
    pub(crate) orientations: String,
    /// Fraction of every section's voxels to sample, three quarters of them where the tool collides
    #[arg(long, default_value_t = 0.35)]
    density: f64,
    /// Seed of the sampling
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Samples in one file, about: it holds whole sections, and at least one; by default 4,000,000. A dataset that is there
    /// stays cut up as it is
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) shard_samples: Option<u64>,
    /// Make only partition I of N, on this machine or another; `imf dataset merge` joins them
    #[arg(long, value_name = "I/N")]
    pub(crate) shard: Option<Partition>,
    /// Folder of the dataset
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
}

impl DatasetMakeArguments {
    /// How many voxels of a section are drawn.
    pub(crate) fn sampling(&self) -> Result<Sampling> {
        let sampling = Sampling { density: self.density, seed: self.seed, ..Sampling::default() };
        sampling.check().map_err(|error| WrongArgument(error.to_string()))?;
        Ok(sampling)
    }
}

/// The orientations of a dataset: directions alone.
pub(crate) fn directions(spec: &str) -> Result<OrientationSet> {
    let set = OrientationSet::parse(spec)?;
    ensure!(
        set.orientations.iter().all(|o| o.roll == 0.0),
        "'{}' rolls the tool about its own axis, which a learnt field of directions cannot express; use fibonacci:N",
        set.spec
    );
    Ok(set)
}
