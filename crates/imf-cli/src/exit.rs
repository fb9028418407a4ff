//! The outcome of a command: its exit code, and one message with the reason.

use std::process::ExitCode;

use imf_core::check::{CheckError, LineFault};
use imf_core::grid::GridError;
use imf_core::orientation::OrientationSetError;
use imf_core::scene::SceneError;
use imf_core::surface::SurfaceError;
use imf_core::toolpath::ToolpathError;
use imf_fields::field::calibrate::CalibrationError;
use imf_fields::onnx::OnnxError;
use imf_train::dataset::DatasetError;
use thiserror::Error;

use crate::commands::check::CollisionFound;
use crate::interrupt::{self, Interruption};
use crate::output::eprint_line;
use crate::ranks::{Membership, Rank};

/// The work failed: bad input, a device, a disk.
const FAILED: u8 = 1;
/// Invalid arguments or input.
const REFUSED: u8 = 2;
/// `imf check` found a collision.
const COLLISION: u8 = 3;
/// Stopped by Ctrl-C; what was finished is saved.
pub(crate) const INTERRUPTED: u8 = 130;

/// Runs a command, prints on standard error why it failed, and returns its exit code. `joins_ranks`: it
/// trains together with other processes.
pub fn code_of(joins_ranks: bool, work: impl FnOnce(Rank) -> anyhow::Result<()>) -> ExitCode {
    let membership = match Membership::join(joins_ranks) {
        Ok(membership) => membership,
        Err(error) => {
            eprint_line(format_args!("imf: error: {}", message(&error)));
            return ExitCode::from(FAILED);
        }
    };
    let rank = membership.rank;
    let code = match work(rank) {
        Ok(()) => 0,
        Err(error) if error.is::<CollisionFound>() => COLLISION,
        Err(error) if error.is::<Interruption>() => {
            if rank.is_first() {
                eprint_line(format_args!("imf: {error}"));
            }
            INTERRUPTED
        }
        // Work that the user cancelled, which has nothing more to save.
        Err(error) if interrupt::is_cancelled(&error) && interrupt::requested() => {
            if rank.is_first() {
                eprint_line(format_args!("imf: interrupted: {}", interrupt::last_words()));
            }
            INTERRUPTED
        }
        Err(error) => {
            membership.let_the_first_speak();
            let who = if rank.size > 1 { format!(" of rank {}", rank.number) } else { String::new() };
            eprint_line(format_args!("imf: error{who}: {}", message(&error)));
            if is_bad_input(&error) { REFUSED } else { FAILED }
        }
    };
    membership.leave(code);
    ExitCode::from(code)
}

/// A value that an option cannot have, where only the command's other inputs tell.
#[derive(Debug, Error)]
#[error("{0}")]
pub(crate) struct WrongArgument(pub(crate) String);

/// A wrong argument; a toolpath, or a tool for it, that cannot be checked as it is; a part without a tool.
fn is_bad_input(error: &anyhow::Error) -> bool {
    let path = |error: &ToolpathError| !matches!(error, ToolpathError::Read { .. });
    let set = |error: &OrientationSetError| !matches!(error, OrientationSetError::Read { .. });
    error.chain().any(|cause| {
        cause.is::<WrongArgument>()
            || cause.downcast_ref().is_some_and(set)
            || cause.downcast_ref().is_some_and(path)
            || matches!(
                cause.downcast_ref(),
                Some(
                    SceneError::NoTool(_)
                        | SceneError::Clearance(_)
                        | SceneError::Grid(GridError::Dims(_) | GridError::Margin { .. })
                )
            )
            || matches!(cause.downcast_ref(), Some(CalibrationError::Goal { .. }))
            || matches!(
                cause.downcast_ref(),
                Some(SurfaceError::NoLength(_) | SurfaceError::Tolerance { .. })
            )
            || cause
                .downcast_ref::<CheckError>()
                .is_some_and(|error| !matches!(error, CheckError::Cancelled(_)))
    })
}

/// The error and its causes in one line, without repeating a cause that the text above it quotes.
pub(crate) fn message(error: &anyhow::Error) -> String {
    let mut text = String::new();
    // Texts of the TOML reader end in a line of their own.
    for cause in error.chain().map(|cause| cause.to_string().trim_end().to_owned()) {
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    match error.chain().find_map(remedy) {
        Some(options) => format!("{text} ({options})"),
        None => text,
    }
}

/// The options and commands that a library's remedy means here.
fn remedy(cause: &(dyn std::error::Error + 'static)) -> Option<&'static str> {
    match cause.downcast_ref() {
        Some(SceneError::FixtureOutside(_)) => return Some("--around all, or --margin"),
        Some(SceneError::ThinFixture { .. } | SceneError::NoSolid { .. }) => {
            return Some("--pitch, --conservative");
        }
        Some(SceneError::Coarse(_)) => return Some("--pitch, or --allow-coarse"),
        Some(SceneError::NoTool(_)) => return Some(TOOL_FILE),
        _ => {}
    }
    match cause.downcast_ref() {
        Some(
            CheckError::Tools(_)
            | CheckError::Line { fault: LineFault::ToolChange { .. } | LineFault::NoTool { .. }, .. },
        ) => {
            return Some("--tool NUMBER=FILE");
        }
        Some(CheckError::Contact { .. }) => return Some("--contact, --pitch"),
        Some(CheckError::ThinSolid { .. } | CheckError::LostSolid { .. }) => {
            return Some("--pitch, or the machine's file");
        }
        _ => {}
    }
    if let Some(OnnxError::Rotations(_)) = cause.downcast_ref() {
        return Some("query it with imf query");
    }
    match cause.downcast_ref() {
        Some(DatasetError::Partitions { .. }) => Some("imf dataset merge"),
        Some(DatasetError::Unfinished { .. }) => Some("the same imf dataset command again"),
        Some(DatasetError::Damaged { path, .. }) if path.ends_with(".json") => {
            Some("remove it: the same imf dataset command makes all its shards again")
        }
        Some(DatasetError::Damaged { path, .. }) if path.ends_with(".safetensors") => Some(REMADE),
        Some(DatasetError::Read { path, source })
            if path.ends_with(".safetensors") && source.kind() == std::io::ErrorKind::NotFound =>
        {
            Some(REMADE)
        }
        _ => None,
    }
}

/// How a file of a dataset comes back.
const REMADE: &str = "the same imf dataset command makes it again";

/// How a tool is given.
const TOOL_FILE: &str = "--tool mill.toml; for a 6 mm ball end mill in a 24 mm holder that file reads: unit = \"mm\", stick_out = 30.0, \
     then [cutter] with shape = \"ball\", diameter = 6.0, length = 20.0, then [shank] with diameter = 6.0, then [[holder]] with \
     diameter = 24.0, length = 40.0, each on its own line; or --tool paper";
