//! The arguments of `imf-bench rates`.

use std::path::PathBuf;

use clap::Args;
use imf_cli::arguments::DeviceArguments;

/// The learning rate that the paper's network bears, over width and ω
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench rates --width 64,256 --omega 10 --out rates\n\n\
                        Writes rates.md and rates.json. Whatever was interrupted goes on with the same command. About half an \
                        hour on 2 cores.")]
pub(crate) struct RatesArguments {
    /// Neurons of every hidden layer; several with commas
    #[arg(long, value_delimiter = ',', default_value = "64,128,256,512,1024", value_name = "N")]
    pub(crate) width: Vec<usize>,
    /// Frequency factors inside every sine; several with commas
    #[arg(long, value_delimiter = ',', default_value = "1,3,10,30", value_name = "ω")]
    pub(crate) omega: Vec<f32>,
    /// Steps of each training
    #[arg(long, default_value_t = 1000, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) steps: u64,
    /// Folder to write to
    #[arg(long, default_value = "imf-rates", value_name = "DIR")]
    pub(crate) out: PathBuf,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}
