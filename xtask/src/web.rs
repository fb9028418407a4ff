//! For browsers: which compiler serves, and the chores that make the page and test it.
//!
//! The page itself is made by the module `page`, with the feature of that name.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};

use crate::browser;
use crate::checks::{cargo, cargo_command, run_shown, works};
use crate::{root, target};

/// The target of browsers, where there are no threads and no files.
pub(crate) const TARGET: &str = "wasm32-unknown-unknown";

/// Cargo for the target of browsers.
pub(crate) enum Toolchain {
    /// The default toolchain has the target's standard library.
    Default,
    /// The nightly toolchain has the standard library's sources, and compiles them.
    Nightly,
}

impl Toolchain {
    /// The one that is there, or can be had.
    ///
    /// # Errors
    /// None; the error says what to type.
    pub(crate) fn find() -> Result<Self> {
        if works("rustup", &["target", "add", TARGET]) {
            return Ok(Self::Default);
        }
        let sources = Command::new("rustc").args(["+nightly", "--print", "sysroot"]).output();
        let sysroot = sources.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
        let library = sysroot.map(|sysroot| Path::new(&sysroot).join("lib/rustlib/src/rust/library/std"));
        if library.is_ok_and(|library| library.is_dir()) {
            return Ok(Self::Nightly);
        }
        bail!(
            "the target {TARGET} is not there and cannot be had: rustup target add {TARGET}; where rustup has no network, a nightly \
             toolchain with the component rust-src serves as well"
        )
    }

    /// Runs cargo for the target, with the instructions that browsers have since 2023.
    ///
    /// # Errors
    /// A build that fails.
    pub(crate) fn cargo(&self, arguments: &[&str]) -> Result<()> {
        let mut command = match self {
            Self::Default => cargo_command(),
            Self::Nightly => {
                let mut command = Command::new("cargo");
                // What the running cargo sets names its own compiler.
                command.current_dir(root()).arg("+nightly").env_remove("RUSTC").env_remove("CARGO");
                command.env_remove("RUSTUP_TOOLCHAIN");
                command
            }
        };
        command.args(arguments).args(["--target", TARGET]);
        if matches!(self, Self::Nightly) {
            command.arg("-Zbuild-std=std,panic_abort");
        }
        command.arg("--target-dir").arg(folder().join("build"));
        command.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS", "-C target-feature=+simd128");
        // In a quarter less processor time, and smaller, than as the command is optimised.
        command.envs([("CARGO_PROFILE_RELEASE_LTO", "off"), ("CARGO_PROFILE_RELEASE_CODEGEN_UNITS", "1")]);
        run_shown(&mut command)
    }
}

/// Where everything for browsers is built.
pub(crate) fn folder() -> PathBuf {
    target().join("web")
}

/// Makes the page and the npm package.
///
/// # Errors
/// No compiler for the target; a build that fails; a page that is too large.
pub(crate) fn build() -> Result<()> {
    cargo(&["run", "--quiet", "--package", "xtask", "--features", "page", "--", "page"], &[])
}

/// Makes the page and tests it in a headless Chromium.
///
/// # Errors
/// As [`build`]; no browser; a test that fails.
pub(crate) fn test() -> Result<()> {
    browser::ensure_browser()?;
    let browser = browser::find().context("there is no Chromium on the PATH")?;
    build()?;
    let test = ["test", "--workspace", "--test", "browser", "--", "--ignored", "--nocapture"];
    let page = folder().join("imf.html");
    cargo(&test, &[("IMF_WEB_PAGE", &page.to_string_lossy()), ("IMF_BROWSER", &browser.to_string_lossy())])
}
