//! The command `imf`: where, and from which directions, a tool reaches a part without collision.
//!
//! ```sh
//! imf access bracket --pitch 4 --orientations fibonacci:16 --out access
//! ```
//!
//! Every command, with what it prints, is in the guide (`docs/guide` in the sources). Here `main` parses arguments, hands them
//! to one command, and maps its result to an exit code. A command is a file in `commands`; its arguments, in `arguments`,
//! become validated settings in one step; what computes is in `imf-core` and `imf-gpu`.

mod arguments;
mod checkpoints;
mod commands;
mod engine;
mod interrupt;
mod job;
mod output;
mod picture;
mod progress;
mod ranks;
mod report;
mod session;
mod slices;

use std::process::ExitCode;

use clap::Parser;
use imf_fields::evaluation::EvaluationError;
use imf_core::section::SectionError;

use arguments::{Cli, Command};
use commands::check::CollisionFound;
use interrupt::Interrupted;
use ranks::{Membership, Rank};
use session::Session;

/// The work failed: bad input, a device, a disk.
const FAILED: u8 = 1;
/// `imf check` found a collision.
const COLLISION: u8 = 3;
/// Stopped by Ctrl-C; what was finished is kept.
const INTERRUPTED: u8 = 130;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let membership = match Membership::join(cli.command.joins_ranks()) {
        Ok(membership) => membership,
        Err(error) => {
            eprintln!("imf: error: {}", message(&error));
            return ExitCode::from(FAILED);
        }
    };
    let rank = membership.rank;
    let code = match run(cli, rank) {
        Ok(()) => 0,
        Err(error) if is_broken_pipe(&error) => 0,
        Err(error) if error.is::<CollisionFound>() => COLLISION,
        Err(error) if error.is::<Interrupted>() => {
            if rank.is_first() {
                eprintln!("imf: {error}");
            }
            INTERRUPTED
        }
        Err(error) if was_cancelled(&error) => {
            if rank.is_first() {
                eprintln!("imf: interrupted: nothing was finished; run the same command again to start over");
            }
            INTERRUPTED
        }
        Err(error) => {
            membership.let_the_first_speak();
            let who = if rank.of() > 1 { format!(" of rank {}", rank.number()) } else { String::new() };
            eprintln!("imf: error{who}: {}", message(&error));
            FAILED
        }
    };
    membership.leave(code);
    ExitCode::from(code)
}

fn run(cli: Cli, rank: Rank) -> anyhow::Result<()> {
    let session = Session::new(&cli.global, rank)?;
    match cli.command {
        Command::Demo(arguments) => commands::demo::run(&session, &arguments),
        Command::Parts(arguments) => commands::parts::run(&session, &arguments),
        Command::Voxelize(arguments) => commands::voxelize::run(&session, &arguments),
        Command::Field(arguments) => commands::field::run(&session, &arguments),
        Command::Access(arguments) => commands::access::run(&session, &arguments),
        Command::Dataset(arguments) => commands::dataset::run(&session, &arguments),
        Command::Train(arguments) => commands::train::run(&session, &arguments),
        Command::Finetune(arguments) => commands::finetune::run(&session, &arguments),
        Command::Compress(arguments) => commands::compress::run(&session, &arguments),
        Command::Calibrate(arguments) => commands::calibrate::run(&session, &arguments),
        Command::Regime(arguments) => commands::regime::run(&session, &arguments),
        Command::Sections(arguments) => commands::field::kept::run(&session, &arguments),
        Command::Eval(arguments) => commands::eval::run(&session, &arguments),
        Command::Export(arguments) => commands::export::run(&session, &arguments),
        Command::Query(arguments) => commands::query::run(&session, &arguments),
        Command::Check(arguments) => commands::check::run(&session, &arguments),
        Command::Bench(arguments) => commands::bench::run(&session, &arguments),
        Command::Info(arguments) => commands::info::run(&session, &arguments),
        Command::Devices => commands::devices::run(&session),
    }
}

/// The error and its causes in one line, without repeating a cause that the text above it quotes.
fn message(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// Work that stopped at the user's wish without anything to keep.
fn was_cancelled(error: &anyhow::Error) -> bool {
    let section = error.chain().any(|cause| {
        let evaluation = cause.downcast_ref::<EvaluationError>();
        matches!(cause.downcast_ref(), Some(SectionError::Cancelled))
            || matches!(evaluation, Some(EvaluationError::Section(SectionError::Cancelled)))
    });
    section && interrupt::requested()
}

/// `imf … | head` is no error.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
    })
}
