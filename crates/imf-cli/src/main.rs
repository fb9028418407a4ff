//! The binary `imf`: a command's result as an exit code. What it does is in the library.

use std::process::ExitCode;

use clap::Parser as _;
use imf_cli::arguments::Cli;

fn main() -> ExitCode {
    let cli = Cli::parse();
    imf_cli::exit::code_of(cli.joins_ranks(), |rank| imf_cli::commands::run(&cli, rank))
}
