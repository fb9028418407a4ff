//! The arguments of `imf-bench recipe`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use imf_cli::arguments::DeviceArguments;

/// Train by a recipe: a built-in one or a file that says scene, network, stages and sweep
#[derive(Args)]
pub(crate) struct RecipeArguments {
    #[command(subcommand)]
    pub(crate) command: RecipeCommand,
}

#[derive(Subcommand)]
pub(crate) enum RecipeCommand {
    /// List the built-in recipes
    #[command(after_help = "Example:\n  imf-bench recipe list")]
    List,
    Show(ShowArguments),
    Run(RunArguments),
}

/// Print a built-in recipe's file, to read or to change
#[derive(Args)]
#[command(
    after_help = "Example:\n  imf-bench recipe show single > mine.toml\n  imf-bench recipe run mine.toml --out mine"
)]
pub(crate) struct ShowArguments {
    /// Name of the recipe
    pub(crate) name: String,
}

/// Run a recipe: datasets, every stage, evaluation, report and loss curve in one folder; continues what was interrupted
#[derive(Args)]
#[command(after_help = "Examples:\n  imf-bench recipe run single --part teapot --out single\n  \
                        imf-bench recipe run multi --scale 0.5 --set network.width=128 --set 'stage.*.training.batch=512' \
                        --out trial\n  imf-bench recipe run mine.toml --out mine\n\n\
                        Writes recipe.toml (what was run), datasets, stages, model.safetensors, recipe.md, recipe.json \
                        and loss.png. After Ctrl-C or a crash the same command goes on, to the same weights. Another recipe, or \
                        a changed one, needs another folder.")]
pub(crate) struct RunArguments {
    /// A built-in recipe (imf-bench recipe list) or a file
    pub(crate) recipe: String,
    /// Part: a mesh file or a built-in part; sets scene.part
    #[arg(long, value_name = "PART")]
    pub(crate) part: Option<String>,
    /// Tool file, or paper; sets scene.tool
    #[arg(long, value_name = "TOOL")]
    pub(crate) tool: Option<String>,
    /// Voxels along each axis relative to the recipe's, such as 0.5; sets scene.scale
    #[arg(long, value_name = "FACTOR")]
    pub(crate) scale: Option<f64>,
    /// Change a value, such as network.width=128 or stage.*.training.length.epochs=5; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Seconds between checkpoints
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS", value_parser = imf_cli::arguments::parse_seconds)]
    pub(crate) checkpoint_every: f64,
    /// Poses at random orientations that training never sees, to watch the error of every stage at; 0 for none
    #[arg(long, default_value_t = 16_384, value_name = "N")]
    pub(crate) held_out: usize,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}
