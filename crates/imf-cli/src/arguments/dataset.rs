//! What `imf dataset` is asked: to make a dataset, or to join or finish what was made of it.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::{ArgMatches, Args, FromArgMatches, Subcommand};
use imf_core::orientation::OrientationSet;
use imf_fields::recipe::Sampling;
use imf_train::dataset::{Layout, Share};

use super::clearance;
use super::scene::SceneArguments;

/// A dataset is made, or what was made of it is joined or finished.
pub(crate) enum DatasetArguments {
    Make(Box<DatasetMakeArguments>),
    Act(DatasetAction),
}

// By hand: an optional group of arguments that holds another group is never seen as present by the derived code.
impl FromArgMatches for DatasetArguments {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        if matches.subcommand_name().is_some() {
            return DatasetAction::from_arg_matches(matches).map(Self::Act);
        }
        DatasetMakeArguments::from_arg_matches(matches).map(|make| Self::Make(Box::new(make)))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Args for DatasetArguments {
    fn augment_args(command: clap::Command) -> clap::Command {
        DatasetAction::augment_subcommands(DatasetMakeArguments::augment_args(command))
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        Self::augment_args(command)
    }
}

#[derive(Subcommand)]
pub(crate) enum DatasetAction {
    Merge(DatasetMergeArguments),
    Finish(DatasetFinishArguments),
}

/// Join shares of a dataset that were made apart, after checking that they belong together and are whole
#[derive(Args)]
#[command(
    after_help = "Examples:\n  imf dataset merge teapot-225 share-1 share-2\n  imf dataset merge together\n\n\
                        What is missing is listed, and the exit code is 1 then."
)]
pub(crate) struct DatasetMergeArguments {
    /// Folder of the joined dataset; it may hold shares itself
    pub(crate) out: PathBuf,
    /// Folders of shares
    pub(crate) folders: Vec<PathBuf>,
}

/// Make what is missing of a dataset from what its folder says of itself; the part's mesh is not needed
#[derive(Args)]
#[command(after_help = "Example:\n  imf dataset finish teapot-225")]
pub(crate) struct DatasetFinishArguments {
    /// Folder of the dataset
    pub(crate) folder: PathBuf,
    /// Only share I of N
    #[arg(long, value_name = "I/N")]
    pub(crate) shard: Option<Share>,
}

/// Which sections to sample, how, and which of them here.
#[derive(Args)]
pub(crate) struct DatasetMakeArguments {
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    #[command(flatten)]
    pub(crate) contact: clearance::ContactArguments,
    /// grid:N, fibonacci:N, random:N:SEED, cone:X,Y,Z:HALF_ANGLE:N, pairs such as 0,0;30,40 or a CSV file
    #[arg(long, value_name = "SET", allow_hyphen_values = true)]
    pub(crate) orientations: String,
    #[command(flatten)]
    pub(crate) sampling: SamplingArguments,
    /// Seed of the sampling
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Make only share I of N, on this machine or another; `imf dataset merge` joins them
    #[arg(long, value_name = "I/N")]
    pub(crate) shard: Option<Share>,
    /// Folder of the dataset
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
}

/// How sections are sampled; shared by dataset and train.
#[derive(Args)]
pub(crate) struct SamplingArguments {
    /// Share of every section's voxels to sample
    #[arg(long, default_value_t = 0.35)]
    density: f64,
    /// Share of the samples to draw where the tool collides
    #[arg(long, default_value_t = 0.75)]
    positive_share: f64,
    /// Share of the samples to draw at the boundary between free and colliding; --positive-share divides the rest
    #[arg(long, default_value_t = 0.0)]
    boundary_share: f64,
    /// How far from the boundary still counts as at it
    #[arg(long, default_value_t = 1, value_name = "VOXELS")]
    boundary_width: usize,
    /// Samples in one file, about: it holds whole sections, and at least one; by default 4,000,000. A dataset that is there
    /// stays cut up as it is
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    shard_samples: Option<u64>,
}

impl SamplingArguments {
    /// How many voxels of a section are drawn, and where.
    pub(crate) fn sampling(&self, seed: u64) -> Result<Sampling> {
        let sampling = Sampling {
            density: self.density,
            positive_share: self.positive_share,
            boundary_share: self.boundary_share,
            boundary_width: self.boundary_width,
            seed,
        };
        sampling.check()?;
        Ok(sampling)
    }

    /// How the samples are cut up.
    pub(crate) fn layout(&self, share: Option<Share>) -> Layout {
        Layout { shard_samples: self.shard_samples, share }
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
