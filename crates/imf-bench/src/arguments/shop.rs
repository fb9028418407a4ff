//! The arguments of `imf-bench shop`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use imf_core::parts::ReferencePart;

/// What a shop asks: the fewest set-ups, the least stick-outs, a crib of tools, a machine's poses, the stock along a path
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench shop --out shop\n\n\
                        Set-ups: of reference parts and random prismatic parts, every direction a set-up of a three-axis machine with a 6 mm \
                        flat end mill. Stick-out and crib, on one reference part: a 6 mm ball end mill whose 24 mm holder slides, held \
                        against exact counts, and balls, flat ends and bull noses in several holders. Machine: the bracket on a trunnion, \
                        one thread. Stock: a block of 256³ voxels, one thread. Writes shop.json and shop.md. Some minutes.")]
pub(crate) struct ShopArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// These alone; several with commas
    #[arg(long, value_enum, value_delimiter = ',', value_name = "QUESTION")]
    pub(crate) only: Vec<Question>,
    /// Random prismatic parts, beside the reference parts
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000))]
    pub(crate) parts: u32,
    /// Points on the surface of which set-ups are chosen
    #[arg(long, default_value_t = 2_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    pub(crate) points: u32,
    /// Directions, each a candidate set-up
    #[arg(long, default_value_t = 1_000, value_name = "N", value_parser = clap::value_parser!(u32).range(7..10_000))]
    pub(crate) directions: u32,
    /// Per cent to cover of what all candidates reach; several with commas
    #[arg(long, value_delimiter = ',', default_value = "100,99", value_name = "PERCENT")]
    pub(crate) cover: Vec<f64>,
    /// Reference part of stick-outs and crib, at its full resolution
    #[arg(long, default_value = "teapot", value_name = "PART")]
    pub(crate) part: ReferencePart,
    /// Points on its surface
    #[arg(long, default_value_t = 10_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    pub(crate) surface_points: u32,
    /// Stick-outs that are held against exact counts
    #[arg(long, default_value_t = 100_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) checks: u32,
    /// Tools of the crib
    #[arg(long, default_value_t = 1_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..10_000))]
    pub(crate) tools: u32,
    /// Tools of the crib whose verdicts are found one by one too
    #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) alone: u32,
    /// Lines of the machine's path
    #[arg(long, default_value_t = 500_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    pub(crate) lines: u32,
    /// Seed of the choice of points and tools
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Question {
    Setups,
    StickOut,
    Crib,
    Machine,
    Stock,
}

impl ShopArguments {
    pub(crate) fn asks(&self, question: Question) -> bool {
        self.only.is_empty() || self.only.contains(&question)
    }
}
