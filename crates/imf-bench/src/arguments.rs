//! The command line: the measurements, and the arguments of those of exact sections, training steps and GPUs; the others
//! have a file each.

pub(crate) mod access;
pub(crate) mod paper;
pub(crate) mod query;
pub(crate) mod rates;
pub(crate) mod recipe;
pub(crate) mod shop;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use imf_cli::arguments::numbers::{named, parse_count, with_negative_numbers};
use imf_cli::arguments::{DeviceArguments, GlobalArguments};
use imf_fields::recipe::Precision;

/// Measures imf beside its rivals, makes the paper's tables, and trains by recipes.
#[derive(Parser)]
#[command(name = "imf-bench", version, mut_subcommands(with_negative_numbers))]
pub(crate) struct Cli {
    #[command(flatten)]
    pub(crate) global: GlobalArguments,
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Subcommand)]
pub(crate) enum Command {
    Access(access::AccessArguments),
    Edits(EditsArguments),
    Exact(ExactArguments),
    Gpu(GpuArguments),
    Paper(paper::PaperArguments),
    Query(query::QueryArguments),
    Rates(rates::RatesArguments),
    Recipe(recipe::RecipeArguments),
    Shop(shop::ShopArguments),
    Train(TrainArguments),
}

/// What the network of a part saves where the part is changed a little
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench edits --out edits\n\n\
                        Writes edits.json and edits.md. Some minutes on 2 cores.")]
pub(crate) struct EditsArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Resolution of the bracket, over its own along each axis
    #[arg(long, default_value_t = 0.5, value_name = "SHARE")]
    pub(crate) scale: f64,
    /// Neurons of every hidden layer
    #[arg(long, default_value_t = 128, value_name = "N")]
    pub(crate) width: usize,
    /// Learning rate of the old network over that of a new one
    #[arg(long, default_value_t = 0.2, value_name = "SHARE")]
    pub(crate) rate: f32,
    /// Steps from random weights
    #[arg(long, default_value_t = 12_000, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) steps: u64,
}

/// Training steps against the matrix products' own peak and against PyTorch, by turns in one run
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench train --python venv/bin/python --out bench-train\n\n\
                        Writes train.json and train.md. About half a minute without PyTorch.")]
pub(crate) struct TrainArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Samples in a step; several with commas
    #[arg(long, value_delimiter = ',', default_value = "1024,8192", value_name = "N", value_parser = parse_count)]
    pub(crate) batch: Vec<usize>,
    /// Neurons of every hidden layer
    #[arg(long, default_value_t = 512, value_name = "N")]
    pub(crate) width: usize,
    /// What products of layers are computed in, PyTorch's too (bf16 and f16: by its autocast)
    #[arg(long, default_value = "f32", value_parser = named::<Precision>(&["f32", "bf16", "f16"]))]
    pub(crate) precision: Precision,
    /// Python with PyTorch
    #[arg(long, default_value = "python3", value_name = "COMMAND")]
    pub(crate) python: String,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}

/// What a GPU does beside the CPU of the same machine, with values compared
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench gpu --python venv/bin/python --out bench-gpu\n\n\
                        Writes a JSON and a Markdown file for each part; those of an earlier run stay until their part is measured again. \
                        Some minutes; on a software device small sizes, which show that every part works.")]
pub(crate) struct GpuArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// These alone; several with commas
    #[arg(long, value_enum, value_delimiter = ',', value_name = "PART")]
    pub(crate) only: Vec<GpuPart>,
    /// Small sizes, which show that every part works
    #[arg(long)]
    pub(crate) small: bool,
    /// Python with PyTorch
    #[arg(long, default_value = "python3", value_name = "COMMAND")]
    pub(crate) python: String,
    /// gpu, software (software Vulkan), or a number or part of a name from `imf info`
    #[arg(long, default_value = "gpu", value_name = "DEVICE")]
    pub(crate) device: String,
}

/// A measurement of a GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum GpuPart {
    /// Multiply-adds alone, in f32
    Peak,
    /// Exact sections
    Sections,
    /// Steps of the paper's network, PyTorch's beside them
    Training,
    /// A field distilled and evaluated over grids and at poses
    Field,
}

/// Exact sections against scipy, and how their cost grows
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench exact --out bench-exact\n\n\
                        Writes exact.json, exact.md and how time and memory grow as pictures. About a minute without --full.")]
pub(crate) struct ExactArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// All sizes up to 384³, all 225 sections of the rival, 10,000 orientations
    #[arg(long)]
    pub(crate) full: bool,
    /// Python with numpy and scipy
    #[arg(long, default_value = "python3", value_name = "COMMAND")]
    pub(crate) python: String,
}
