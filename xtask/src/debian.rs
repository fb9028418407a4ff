//! Sees to what tests need: looks, installs it as root on Debian and Ubuntu, else says what to type.

use std::env;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};

use crate::checks::run_shown;

/// What some of the tests need.
pub(crate) struct Need {
    /// As a sentence: which tests need what.
    pub(crate) sentence: &'static str,
    /// Debian's packages that have it.
    pub(crate) packages: &'static [&'static str],
    /// The variable that does without, set to 1.
    pub(crate) opt_out: &'static str,
}

impl Need {
    /// True where its tests are not wanted, which is said.
    pub(crate) fn is_left_out(&self) -> bool {
        let is_set = env::var(self.opt_out).is_ok_and(|value| value == "1");
        if is_set {
            println!("{} is set: its tests are left out", self.opt_out);
        }
        is_set
    }

    /// Installs it, unless `is_there` finds it.
    ///
    /// # Errors
    /// What cannot be installed, with the line to type.
    pub(crate) fn provide(&self, is_there: impl Fn() -> bool) -> Result<()> {
        if is_there() {
            return Ok(());
        }
        let install = [&["install", "-y", "--no-install-recommends"][..], self.packages].concat();
        let remedy = format!(
            "{} (Debian, Ubuntu: sudo apt-get {}); with {}=1 they are left out",
            self.sentence,
            install.join(" "),
            self.opt_out
        );
        let is_root = Command::new("id").arg("-u").output().is_ok_and(|id| id.stdout.trim_ascii() == b"0");
        ensure!(is_root && Path::new("/etc/debian_version").exists(), "{remedy}");
        for arguments in [&["update"][..], &install[..]] {
            run_shown(Command::new("apt-get").args(arguments).env("DEBIAN_FRONTEND", "noninteractive"))
                .with_context(|| remedy.clone())?;
        }
        ensure!(is_there(), "still not there: {remedy}");
        Ok(())
    }
}
