//! What `imf regime` is asked.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::DeviceArguments;

/// Train by a regime: a preset or a file that says scene, network, stages and sweep
#[derive(Args)]
pub(crate) struct RegimeArguments {
    #[command(subcommand)]
    pub(crate) command: RegimeCommand,
}

#[derive(Subcommand)]
pub(crate) enum RegimeCommand {
    /// List the presets
    #[command(after_help = "Example:\n  imf regime list")]
    List,
    Show(ShowArguments),
    Run(RunArguments),
}

/// Print a preset's file, to read or to change
#[derive(Args)]
#[command(
    after_help = "Example:\n  imf regime show single > mine.toml\n  imf regime run mine.toml --out mine"
)]
pub(crate) struct ShowArguments {
    /// Name of the preset
    pub(crate) name: String,
}

/// Run a regime: datasets, every stage, evaluation, report and loss curve in one folder; continues what was interrupted
#[derive(Args)]
#[command(after_help = "Examples:\n  imf regime run single --part teapot --out single\n  \
                        imf regime run multi --scale 0.5 --set network.width=128 --set 'stage.*.training.batch=512' \
                        --out trial\n  imf regime run mine.toml --out mine\n\n\
                        Writes regime.toml (what was run), datasets, stages, model.safetensors, regime.md, regime.json \
                        and loss.png. After Ctrl-C or a crash the same command goes on, to the same weights. A changed regime keeps the finished \
                        stages of the folder whose settings are the same; it refuses to overwrite others.")]
pub(crate) struct RunArguments {
    /// A preset (imf regime list) or a file
    pub(crate) regime: String,
    /// Part: a mesh file or a built-in part; sets scene.part
    #[arg(long, value_name = "PART")]
    pub(crate) part: Option<String>,
    /// Tool file, or paper; sets scene.tool
    #[arg(long, value_name = "TOOL")]
    pub(crate) tool: Option<String>,
    /// Voxels along each axis relative to the regime's, such as 0.5; sets scene.scale
    #[arg(long, value_name = "FACTOR")]
    pub(crate) scale: Option<f64>,
    /// Change a value, such as network.width=128 or stage.*.training.length.epochs=5; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Seconds between checkpoints
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS", value_parser = super::parse_seconds)]
    pub(crate) checkpoint_every: f64,
    /// Poses at random orientations that training never sees, to watch the error of every stage at; 0 for none
    #[arg(long, default_value_t = 16_384, value_name = "N")]
    pub(crate) held_out: usize,
    /// Also write loss, rate, held-out error and speed of every stage to log.jsonl in its folder, a JSON object a line
    #[arg(long)]
    pub(crate) log: bool,
    /// Also write event files for TensorBoard, to the folder tensorboard in every stage's folder
    #[arg(long)]
    pub(crate) tensorboard: bool,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}
