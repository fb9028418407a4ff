//! The arguments of `imf-bench families`.

use std::path::PathBuf;

use clap::Args;
use imf_cli::arguments::DeviceArguments;
use imf_cli::arguments::numbers::parse_threshold;
use imf_core::parts::ReferencePart;

/// Every family of fields side by side: errors, wrong decisions, time to make and to evaluate, memory
#[derive(Args)]
#[command(after_help = "Examples:\n  imf-bench families\n  \
                        imf-bench families --part teapot,bracket,screw-gear --scale 1 --siren-steps 30000 --factored-steps \
                        2500 --out families-full\n\nAbout a minute a part at half resolution on two cores, most of it \
                        training. Writes families.md, families.json and a picture for each part. Which family when: \
                        docs/guide/families.md")]
pub(crate) struct FamiliesArguments {
    /// Parts (imf parts); several with commas
    #[arg(long, value_delimiter = ',', default_value = "teapot", value_name = "PART")]
    pub(crate) part: Vec<ReferencePart>,
    /// Resolution, as a fraction of the reference parts' own
    #[arg(long, default_value_t = 0.5, value_name = "FRACTION", value_parser = parse_scale)]
    pub(crate) scale: f64,
    /// Every family is made from N × N exact sections, but coarse tables, which take as many as serve their size best
    #[arg(long, default_value_t = 15, value_name = "N", value_parser = clap::value_parser!(u64).range(4..=64))]
    pub(crate) angles: u64,
    /// Number of random orientations to judge by, none of which any family was made from
    #[arg(long, default_value_t = 64, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) random: u64,
    /// Seed of the random orientations, and of weights and their training
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Overlap above which a field's pose is called colliding
    #[arg(long, default_value_t = 0.001, value_name = "τ", value_parser = parse_threshold)]
    pub(crate) threshold: f64,
    /// Poses at most this many voxels from where free turns to colliding count as near the boundary
    #[arg(long, default_value_t = 1, value_name = "VOXELS")]
    pub(crate) near: usize,
    /// Steps of siren5's training
    #[arg(long, default_value_t = 12_000, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) siren_steps: u64,
    /// Steps in which the factored field is distilled
    #[arg(long, default_value_t = 1500, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) factored_steps: u64,
    /// Folder to write to
    #[arg(long, default_value = "imf-families", value_name = "DIR")]
    pub(crate) out: PathBuf,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}

impl FamiliesArguments {
    /// The sections that every family is made from.
    pub(crate) fn sections(&self) -> usize {
        (self.angles * self.angles) as usize
    }
}

fn parse_scale(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(scale) if (0.05..=4.0).contains(&scale) => Ok(scale),
        _ => Err("a fraction from 0.05 to 4, such as 0.5".into()),
    }
}
