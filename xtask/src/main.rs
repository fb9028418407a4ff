//! The project's own chores, run as `cargo xtask <chore>`.
//!
//! `test` is the whole of what continuous integration runs: see [`checks`]. `mpi` trains in several processes: see
//! [`ranks`]. `python` tests the Python package, `wheel` as users get it: see [`python`]. `web` builds the page for
//! browsers: see [`web`]. `api` writes the lists of the public surface: see [`checks::api`].

mod adapter;
mod browser;
mod checks;
mod debian;
#[cfg(feature = "page")]
mod page;
mod programs;
mod python;
mod ranks;
mod stages;
mod web;

use std::path::PathBuf;
use std::process::ExitCode;

const USAGE: &str = "\
usage: cargo xtask <chore>

chores:
  test     formatting, clippy and rustdoc with warnings denied, imf-core without its features (for browsers), needs, all tests,
           python and test --browser
  needs    looks for the Vulkan driver and the browser that tests need, and installs them as root on Debian and Ubuntu
  python   the tests of the Python package in an environment of its own
  wheel    builds the Python package's wheel, target/wheels, and tests it in an environment of its own
  api      writes the lists of what imf-core and imf-fields make public, docs/api, anew
  web      the page that computes in the browser, target/web/imf.html, and the npm package beside it
  test --browser
           builds that page and tests it in a headless Chromium
  mpi      the build with the feature mpi, and trainings of several ranks by mpirun; needs an MPI library and libclang

environment:
  IMF_NO_GPU_TESTS=1       run without a GPU driver; tests that need one are reported as ignored
  IMF_NO_BROWSER_TESTS=1   run without Chromium; tests that need it are reported as ignored
  IMF_NO_PYTHON_TESTS=1    run without Python; the tests of its package are left out, which is said
  IMF_PYTHON=PYTHON        the interpreter of that environment instead of python3";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["test"] => ended(checks::run()),
        ["test", "--browser"] => ended(web::test()),
        ["needs"] => ended(checks::provide()),
        ["web"] => ended(web::build()),
        #[cfg(feature = "page")]
        ["page"] => ended(page::make()),
        ["mpi"] => ended(ranks::run()),
        ["python"] => ended(python::test()),
        ["wheel"] => ended(python::wheel()),
        ["api"] => ended(checks::api()),
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

/// The root of the workspace.
fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Where cargo builds.
fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from)
}

fn ended(result: anyhow::Result<()>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
