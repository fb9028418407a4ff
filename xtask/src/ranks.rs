//! `cargo xtask mpi`: what needs an MPI library, where there is one: the build with the feature `mpi`, and its tests, which
//! start several ranks by `mpirun`. Not part of `cargo xtask test`, so that nobody else needs MPI.

use anyhow::{Result, ensure};

use crate::checks::{cargo, works};

const DEBIAN_INSTALL: &str =
    "apt-get install -y --no-install-recommends openmpi-bin libopenmpi-dev libclang-dev";

/// Checks and tests the build with MPI, and that the default one does without.
///
/// # Errors
/// No MPI, or the first thing that fails.
pub(crate) fn run() -> Result<()> {
    for program in ["mpirun", "mpicc"] {
        ensure!(
            works(program, &["--version"]),
            "{program} is not found: install MPI and libclang, on Debian and Ubuntu by\n    sudo {DEBIAN_INSTALL}"
        );
    }
    // The whole workspace, so that what the other chores have compiled serves here too: of one package alone every
    // dependency would be compiled again with the features that this package asks for.
    let workspace = ["--workspace", "--features", "imf-cli/mpi"];
    cargo(&[&["clippy"], &workspace[..], &["--all-targets", "--", "-D", "warnings"]].concat(), &[])?;
    cargo(&[&["test"], &workspace[..], &["--test", "ranks", "--", "--nocapture"]].concat(), &[])
}
