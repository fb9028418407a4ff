//! The command `imf`: where, and from which directions, a tool reaches a part without collision.
//!
//! `main` parses arguments, hands them to one command, and maps its result to an exit code.

mod arguments;
mod commands;
mod engine;
mod interrupt;
mod job;
mod output;
mod picture;
mod progress;
mod report;
mod session;
mod slices;

use std::process::ExitCode;

use clap::Parser;

use arguments::{Cli, Command};
use interrupt::Interrupted;
use session::Session;

/// The work failed: bad input, a device, a disk.
const FAILED: u8 = 1;
/// Stopped by Ctrl-C; what was finished is kept.
const INTERRUPTED: u8 = 130;

fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) if error.is::<Interrupted>() => {
            eprintln!("imf: {error}");
            ExitCode::from(INTERRUPTED)
        }
        Err(error) => {
            eprintln!("imf: error: {error:#}");
            ExitCode::from(FAILED)
        }
    }
}

fn run(cli: Cli) -> anyhow::Result<()> {
    let session = Session::new(&cli.global)?;
    match cli.command {
        Command::Demo(arguments) => commands::demo::run(&session, &arguments),
        Command::Parts(arguments) => commands::parts::run(&session, &arguments),
        Command::Voxelize(arguments) => commands::voxelize::run(&session, &arguments),
        Command::Field(arguments) => commands::field::run(&session, &arguments),
        Command::Dataset(arguments) => commands::dataset::run(&session, &arguments),
        Command::Train(arguments) => commands::train::run(&session, &arguments),
        Command::Finetune(arguments) => commands::finetune::run(&session, &arguments),
        Command::Eval(arguments) => commands::eval::run(&session, &arguments),
        Command::Query(arguments) => commands::query::run(&session, &arguments),
        Command::Bench(arguments) => commands::bench::run(&session, &arguments),
        Command::Info(arguments) => commands::info::run(&session, &arguments),
        Command::Devices => commands::devices::run(&session),
    }
}

/// `imf … | head` is no error.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
    })
}
