//! The arguments of `imf-bench shop`.

use std::path::PathBuf;

use clap::Args;

/// What a shop asks: the fewest set-ups of reference parts and of random prismatic parts, and the stock along a path
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench shop --out shop\n\n\
                        Every direction is a set-up of a three-axis machine with a 6 mm flat end mill. Writes shop.json and shop.md. \
                        Some minutes.")]
pub(crate) struct ShopArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Random prismatic parts, beside the reference parts
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000))]
    pub(crate) parts: u32,
    /// Points on the surface
    #[arg(long, default_value_t = 2_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    pub(crate) points: u32,
    /// Directions, each a candidate
    #[arg(long, default_value_t = 1_000, value_name = "N", value_parser = clap::value_parser!(u32).range(7..10_000))]
    pub(crate) directions: u32,
    /// Per cent to cover of what all candidates reach; several with commas
    #[arg(long, value_delimiter = ',', default_value = "100,99", value_name = "PERCENT")]
    pub(crate) cover: Vec<f64>,
}
