//! Installing what tests need, as root on Debian and Ubuntu.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

/// True where packages can be installed.
pub(crate) fn can_install() -> bool {
    let is_root = Command::new("id").arg("-u").output().is_ok_and(|id| id.stdout.trim_ascii() == b"0");
    is_root && Path::new("/etc/debian_version").exists()
}

/// Runs the line that installs; `remedy` follows where it fails.
///
/// # Errors
/// Packages that cannot be had.
pub(crate) fn install(line: &str, remedy: &str) -> Result<()> {
    for line in ["apt-get update", line] {
        println!("$ {line}");
        let mut words = line.split_whitespace();
        let program = words.next().unwrap_or_default();
        let status = Command::new(program)
            .args(words)
            .env("DEBIAN_FRONTEND", "noninteractive")
            .status()
            .with_context(|| format!("cannot start {program}"))?;
        ensure!(status.success(), "`{line}` failed ({status}); {remedy}");
    }
    Ok(())
}
