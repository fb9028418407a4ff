//! The project's own chores, run as `cargo xtask <chore>`.
//!
//! `test` is the whole of what continuous integration runs: see [`checks`].

mod adapter;
mod checks;
mod stages;

use std::process::ExitCode;

const USAGE: &str = "\
usage: cargo xtask <chore>

chores:
  test   formatting, clippy and rustdoc with warnings denied, a look for a Vulkan driver, all tests

environment:
  IMF_NO_GPU_TESTS=1   run without a GPU driver; tests that need one are reported as ignored";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["test"] => match checks::run() {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("error: {error:#}");
                ExitCode::FAILURE
            }
        },
        ["help" | "--help" | "-h"] => {
            println!("{USAGE}");
            ExitCode::SUCCESS
        }
        _ => {
            eprintln!("{USAGE}");
            ExitCode::from(2)
        }
    }
}
