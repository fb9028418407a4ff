//! One file a command.

pub(crate) mod access;
pub(crate) mod calibrate;
pub(crate) mod check;
pub mod dataset;
pub(crate) mod demo;
pub(crate) mod eval;
pub(crate) mod export;
pub(crate) mod field;
pub(crate) mod info;
mod notes;
pub(crate) mod parts;
pub(crate) mod query;
pub mod train;
pub(crate) mod voxelize;

use crate::arguments::{Cli, Command};
use crate::ranks::Rank;
use crate::session::Session;

/// Runs the command that was typed.
///
/// # Errors
/// Whatever ends the command early; [`crate::exit`] turns it into a message and an exit code.
pub fn run(cli: &Cli, rank: Rank) -> anyhow::Result<()> {
    let session = Session::new(&cli.global, rank)?;
    match &cli.command {
        Command::Demo(arguments) => demo::run(&session, arguments),
        Command::Parts(arguments) => parts::run(&session, arguments),
        Command::Voxelize(arguments) => voxelize::run(&session, arguments),
        Command::Field(arguments) => field::run(&session, arguments),
        Command::Access(arguments) => access::run(&session, arguments),
        Command::Crib(arguments) => access::crib::run(&session, arguments),
        Command::Dataset(arguments) => dataset::run(&session, arguments),
        Command::Train(arguments) => train::run(&session, arguments),
        Command::Finetune(arguments) => train::siren5::finetune(&session, arguments),
        Command::Calibrate(arguments) => calibrate::run(&session, arguments),
        Command::Eval(arguments) => eval::run(&session, arguments),
        Command::Export(arguments) => export::run(&session, arguments),
        Command::Query(arguments) => query::run(&session, arguments),
        Command::Check(arguments) => check::run(&session, arguments),
        Command::Info(arguments) => info::run(&session, arguments),
    }
}
