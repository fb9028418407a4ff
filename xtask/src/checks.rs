//! `cargo xtask test`: everything that must hold before a change is taken.
//!
//! Cheap checks stand first, the tests last, so that their result lines are what a reader sees above the summary.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};

use crate::adapter;
use crate::stages::{self, Stage};

/// Runs all checks.
///
/// # Errors
/// The first stage that fails.
pub(crate) fn run() -> Result<()> {
    stages::run(&[
        Stage { name: "formatting", work: formatting },
        Stage { name: "clippy", work: clippy },
        Stage { name: "rustdoc", work: rustdoc },
        Stage { name: "GPU driver", work: adapter::ensure_driver },
        Stage { name: "tests", work: tests },
    ])
}

fn formatting() -> Result<()> {
    require_component("fmt", "rustfmt")?;
    cargo(&["fmt", "--all", "--check"], &[])
}

fn clippy() -> Result<()> {
    require_component("clippy", "clippy")?;
    cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], &[])
}

fn rustdoc() -> Result<()> {
    cargo(&["doc", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")])
}

fn tests() -> Result<()> {
    cargo(&["test", "--workspace"], &[])
}

/// Builds the command `imf` for speed and says where it is.
///
/// # Errors
/// A build that fails.
pub(crate) fn build_imf() -> Result<PathBuf> {
    cargo(&["build", "--release", "-p", "imf-cli"], &[])?;
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let target =
        std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| Path::new(root).join("target"), PathBuf::from);
    Ok(target.join("release").join(if cfg!(windows) { "imf.exe" } else { "imf" }))
}

/// A minimal toolchain has neither rustfmt nor clippy: names the line that adds what is missing.
fn require_component(subcommand: &str, component: &str) -> Result<()> {
    let found = cargo_command()
        .args([subcommand, "--version"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .context("cannot start cargo")?
        .success();
    ensure!(found, "`cargo {subcommand}` is missing; add it with: rustup component add {component}");
    Ok(())
}

/// Runs cargo at the root of the workspace with its output shown as it comes.
pub(crate) fn cargo(arguments: &[&str], environment: &[(&str, &str)]) -> Result<()> {
    let variables: String = environment.iter().map(|(name, value)| format!("{name}=\"{value}\" ")).collect();
    println!("$ {variables}cargo {}", arguments.join(" "));
    let status = cargo_command()
        .args(arguments)
        .envs(environment.iter().copied())
        .status()
        .context("cannot start cargo")?;
    if !status.success() {
        bail!("`{variables}cargo {}` failed ({status})", arguments.join(" "));
    }
    Ok(())
}

/// The cargo that runs this chore, at the root of the workspace, so that the chore works from any folder.
fn cargo_command() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    command
}
