//! The arguments of `imf-bench paper`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use imf_cli::arguments::DeviceArguments;
use imf_core::parts::ReferencePart;
use serde::Serialize;

/// The paper's tables and figures, its values, ours and their ratio side by side
#[derive(Args)]
#[command(after_help = "Examples:\n  imf-bench paper --scale tiny --out paper-tiny\n  \
                        imf-bench paper --scale reduced --only 3d,time --part teapot --out paper-teapot\n\n\
                        Writes report.md, report.json and report.html (one file, pictures inside). Whatever was \
                        interrupted goes on with the same command: trainings from their checkpoints, all else from the \
                        finished cells in OUT/cells, from which another machine with the same kind of device may go on.")]
pub(crate) struct PaperArguments {
    /// How much of the paper's protocol
    #[arg(long, value_enum, default_value = "tiny")]
    pub(crate) scale: PaperScale,
    /// Only these tables; several with commas
    #[arg(long, value_enum, value_delimiter = ',', value_name = "TABLE")]
    pub(crate) only: Vec<PaperTable>,
    /// Only these parts of the tables 3d and time (teapot, bracket, screw-gear); several with commas
    #[arg(long, value_delimiter = ',', value_name = "PART")]
    pub(crate) part: Vec<ReferencePart>,
    /// Only what is finished in OUT/cells: train and measure nothing, and say what is missing
    #[arg(long)]
    pub(crate) finished: bool,
    /// Folder to write to
    #[arg(long, default_value = "imf-paper", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Seconds between checkpoints
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS", value_parser = imf_cli::arguments::parse_seconds)]
    pub(crate) checkpoint_every: f64,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}

/// How much of the paper's protocol is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PaperScale {
    /// The paper's protocol itself: some 6 hours on 2 cores with AMX, 14 with AVX2
    Full,
    /// Half the resolution, narrower, fewer epochs: within 2 hours on 2 cores
    Reduced,
    /// A quarter of the resolution and a few thousand steps: within 5 minutes on 2 cores
    Tiny,
}

/// A table of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
pub(crate) enum PaperTable {
    /// One rotation in the plane: the network and interpolations
    #[value(name = "2d")]
    #[serde(rename = "2d")]
    Plane,
    /// Three parts, two recipes, and baselines
    #[value(name = "3d")]
    #[serde(rename = "3d")]
    Space,
    /// Training, evaluation, exact sections; memory
    #[serde(rename = "time")]
    Time,
    /// From a part to a changed part
    #[serde(rename = "transfer")]
    Transfer,
    /// How many samples are enough
    #[serde(rename = "sparsity")]
    Sparsity,
    /// How large a network is enough
    #[serde(rename = "architecture")]
    Architecture,
}
