//! The arguments of `imf-bench stick-out`.

use std::path::PathBuf;

use clap::Args;
use imf_core::parts::ReferencePart;

/// The least stick-outs of a surface, each held against exact counts, and a crib of tools decided together
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench stick-out --part bracket\n\n\
                        A 6 mm ball end mill whose 24 mm holder slides, and a crib of balls, flat ends and bull noses in several holders, \
                        on a reference part at its full resolution. At every checked answer the tool set to that length must hold no \
                        voxel that it may not, and one voxel shorter it must. Writes stick-out.json and stick-out.md. A minute or two.")]
pub(crate) struct StickOutArguments {
    /// Reference part at its full resolution
    #[arg(long, default_value = "teapot", value_name = "PART")]
    pub(crate) part: ReferencePart,
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Points on the surface
    #[arg(long, default_value_t = 10_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    pub(crate) points: u32,
    /// Directions from each
    #[arg(long, default_value_t = 1_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..100_000))]
    pub(crate) directions: u32,
    /// Answers that are checked by exact counts
    #[arg(long, default_value_t = 100_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) checks: u32,
    /// Tools of the crib
    #[arg(long, default_value_t = 1_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..10_000))]
    pub(crate) tools: u32,
    /// Tools of the crib whose verdicts are found one by one too
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) alone: u32,
    /// Seed of the choice of points and tools
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}
