//! Is there a Chromium for the tests of the page?

use std::env;
use std::path::PathBuf;

use anyhow::Result;

use crate::debian::Need;

const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];
pub(crate) const CHROMIUM: Need = Need {
    sentence: "tests in a browser need Chromium on the PATH",
    packages: &["chromium"],
    opt_out: "IMF_NO_BROWSER_TESTS",
};

/// A Chromium on the path.
pub(crate) fn find() -> Option<PathBuf> {
    let path = env::var_os("PATH").unwrap_or_default();
    env::split_paths(&path)
        .flat_map(|folder| NAMES.map(|name| folder.join(name)))
        .find(|place| place.is_file())
}

/// Sees to it that there is a Chromium.
///
/// # Errors
/// None, and none that could be installed.
pub(crate) fn ensure_browser() -> Result<()> {
    if CHROMIUM.is_left_out() { Ok(()) } else { CHROMIUM.provide(|| find().is_some()) }
}
