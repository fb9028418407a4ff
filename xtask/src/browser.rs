//! Is there a Chromium for the tests of the page in 3D?

use std::env;
use std::path::PathBuf;

use anyhow::{Result, bail};

use crate::debian;

const OPT_OUT: &str = "IMF_NO_BROWSER_TESTS";
const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];
const DEBIAN_INSTALL: &str = "apt-get install -y --no-install-recommends chromium";

/// True where tests in a browser are not wanted.
pub(crate) fn is_left_out() -> bool {
    env::var(OPT_OUT).is_ok_and(|value| value == "1")
}

/// A Chromium on the path.
pub(crate) fn find() -> Option<PathBuf> {
    let path = env::var_os("PATH").unwrap_or_default();
    env::split_paths(&path)
        .flat_map(|folder| NAMES.map(|name| folder.join(name)))
        .find(|place| place.is_file())
}

/// Looks for a Chromium, installs it as root on Debian, else says what to type.
///
/// # Errors
/// None, and none that could be installed.
pub(crate) fn ensure_browser() -> Result<()> {
    if is_left_out() {
        println!("{OPT_OUT} is set: tests that need a browser are reported as ignored");
        return Ok(());
    }
    if let Some(found) = find() {
        println!("Chromium: {}", found.display());
        return Ok(());
    }
    if debian::can_install() {
        return debian::install(
            DEBIAN_INSTALL,
            &format!("with {OPT_OUT}=1 tests that need a browser are left out"),
        );
    }
    bail!(
        "the test of the page in 3D needs Chromium on the PATH (Debian: sudo {DEBIAN_INSTALL}); with {OPT_OUT}=1 it is left out"
    )
}
