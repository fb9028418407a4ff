//! `cargo xtask test`: everything that must hold before a change is taken.
//!
//! Cheap checks stand first, the tests last, so that their result lines are what a reader sees above the summary. What has to be
//! installed is, while the first checks compute.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result, bail, ensure};

use crate::adapter;
use crate::browser;
use crate::programs;
use crate::stages;
use crate::web::{TARGET, Toolchain};

/// Runs all checks.
///
/// # Errors
/// The first stage that fails.
pub(crate) fn run() -> Result<()> {
    let mut needs = Command::new(std::env::current_exe().context("this program's place")?);
    let needs = needs.arg("needs").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let needs = needs.context("cannot start what installs")?;
    stages::run(vec![
        ("formatting", Box::new(formatting)),
        ("clippy", Box::new(clippy)),
        ("rustdoc", Box::new(rustdoc)),
        ("core and fields alone", Box::new(alone)),
        ("GPU driver, browser", Box::new(|| provided(needs))),
        ("tests", Box::new(tests)),
    ])
}

/// Sees to it that the tests find a GPU driver and a browser.
///
/// # Errors
/// What is not there and cannot be installed.
pub(crate) fn provide() -> Result<()> {
    adapter::ensure_driver()?;
    browser::ensure_browser()
}

/// Waits for what provides and shows what it printed.
fn provided(needs: Child) -> Result<()> {
    let output = needs.wait_with_output().context("what installs")?;
    for printed in [&output.stdout, &output.stderr] {
        std::io::stdout().write_all(printed)?;
    }
    ensure!(output.status.success(), "not everything that tests need is there ({})", output.status);
    Ok(())
}

/// Those of the workspace, of the Python package, and of the page that computes in the browser, where the compiler's target for browsers
/// is there or can be had.
fn tests() -> Result<()> {
    let mut chores: Vec<&[&str]> = Vec::new();
    match Toolchain::find() {
        Ok(_) if browser::CHROMIUM.is_left_out() => (),
        Ok(_) => chores.push(&["test", "--browser"]),
        Err(missing) => println!("the page for browsers is not tested: {missing}"),
    }
    chores.push(&["python"]);
    programs::run(&chores)
}

/// Rewrites the lists of the public surface in `docs/api`.
///
/// # Errors
/// A build that fails, or sources that cannot be read.
pub(crate) fn api() -> Result<()> {
    // Of the whole workspace, whose dependencies the other chores have compiled.
    let test = ["test", "--workspace", "--test", "architecture", "surface"];
    cargo(&test, &[("IMF_WRITE_API", "1")])
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

/// The most crates of `imf-core` without its features for browsers, itself among them.
const MOST_CRATES: usize = 22;
/// Crates that loading a field and asking it pulls, at most, `imf-fields` among them.
const MOST_CRATES_OF_FIELDS: usize = 53;

/// `imf-core` and `imf-fields` without their features, of which the second asks none of the first's: for browsers where the target is
/// there or can be had, else for this machine, which the tests build with all features; and few crates.
fn alone() -> Result<()> {
    count_crates(&["-p", "imf-core", "--no-default-features", "--target", TARGET], MOST_CRATES)?;
    count_crates(&["-p", "imf-fields", "--no-default-features"], MOST_CRATES_OF_FIELDS)?;
    let check = ["check", "-p", "imf-core", "-p", "imf-fields", "--no-default-features"];
    match Toolchain::find() {
        Ok(toolchain) => toolchain.cargo(&check),
        Err(missing) => {
            println!("{missing}\nchecked for this machine instead");
            cargo(&check, &[])
        }
    }
}

/// Counts the crates of a build and refuses more than `most`.
fn count_crates(build: &[&str], most: usize) -> Result<()> {
    let tree = [&["tree", "-e", "normal", "--prefix", "none"][..], build].concat();
    let listed = cargo_command().args(&tree).output().context("cannot start cargo")?;
    ensure!(listed.status.success(), "cargo tree: {}", String::from_utf8_lossy(&listed.stderr));
    // Two versions of a crate are two.
    let text = String::from_utf8_lossy(&listed.stdout);
    let crates = text.lines().filter_map(|line| line.split(" (").next()).collect::<BTreeSet<_>>().len();
    let found = format!("cargo {} lists {crates} crates", tree.join(" "));
    ensure!(crates <= most, "{found}, more than {most}");
    println!("{found}");
    Ok(())
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
pub(crate) fn cargo_command() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(crate::root());
    command
}

/// Whether a program succeeds; what it says is not shown.
pub(crate) fn works(program: &str, arguments: &[&str]) -> bool {
    let mut command = Command::new(program);
    command.args(arguments).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// Runs a command with its output shown as it comes.
///
/// # Errors
/// A command that cannot be started, or that fails.
pub(crate) fn run_shown(command: &mut Command) -> Result<()> {
    println!("$ {command:?}");
    let status = command.status().with_context(|| format!("cannot start {command:?}"))?;
    ensure!(status.success(), "{command:?} failed ({status})");
    Ok(())
}
