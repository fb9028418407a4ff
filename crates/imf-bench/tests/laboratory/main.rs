//! The real binary of the laboratory, each time in a fresh folder: what the measurements find, what recipes leave behind, how they stop
//! and go on, and what they refuse.
#![expect(clippy::unwrap_used, reason = "a test ends at the first surprise, and says where")]

#[path = "../../../imf-cli/tests/commands/binary.rs"]
#[expect(dead_code, reason = "the tests of imf use more of it")]
mod binary;
mod gpu;
mod paper;
mod query;
mod recipe;
mod refusals;
#[path = "../../../imf-cli/tests/commands/shapes.rs"]
#[expect(dead_code, reason = "the tests of imf use more of it")]
mod shapes;
mod shop;

/// The binary that is run.
const PROGRAM: &str = env!("CARGO_BIN_EXE_imf-bench");
