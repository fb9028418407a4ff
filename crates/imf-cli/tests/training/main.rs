//! The real binary from dataset to report, each time in a fresh folder: what it leaves behind, how it stops and goes
//! on, and what it refuses.
#![expect(clippy::unwrap_used, reason = "a test ends at the first surprise, and says where")]

mod adapters;
mod arguments;
mod binary;
mod damage;
mod demo;
mod interruption;
mod long_runs;
mod part;
mod pipeline;
mod precision;
mod saved;
mod shares;
mod streaming;
mod widths;

/// The binary that is run.
const PROGRAM: &str = env!("CARGO_BIN_EXE_imf");
