//! What `imf eval` is asked.

use std::path::PathBuf;

use clap::Args;

use super::FieldDeviceArguments;
use super::numbers::parse_threshold;

/// Compare a model, or a harmonic or factored field, with the exact field
#[derive(Args)]
#[command(after_help = "Examples:\n  imf eval model/field.safetensors\n  imf eval model/field.safetensors \
                        --random 256 --imf grid:25 --out report")]
pub(crate) struct EvalArguments {
    /// Model or field to evaluate
    pub(crate) model: PathBuf,
    /// Section that training saw, θ,φ
    #[arg(long, default_value = "0,0", value_name = "θ,φ", allow_hyphen_values = true)]
    pub(crate) in_sample: String,
    /// Section that training did not see, θ,φ
    #[arg(long, default_value = "12,6", value_name = "θ,φ", allow_hyphen_values = true)]
    pub(crate) out_of_sample: String,
    /// Number of random orientations
    #[arg(long, default_value_t = 64, value_name = "N")]
    pub(crate) random: usize,
    /// Orientation set of the IMF; a model's training set by default, 225 spread evenly for other fields
    #[arg(long, value_name = "SET", allow_hyphen_values = true)]
    pub(crate) imf: Option<String>,
    /// CMF above which a pose is called colliding
    #[arg(long, default_value_t = 0.001, value_name = "τ", value_parser = parse_threshold)]
    pub(crate) threshold: f64,
    /// Seed of the random orientations
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Also write report.json, report.md and pictures to this folder
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) device: FieldDeviceArguments,
}
