//! Output folders and files.

use std::path::Path;

use anyhow::{Context, Result};
use imf_core::atomic_file::write_atomically;
use serde::Serialize;

/// Makes the folder and proves that it can be written, before any work is done.
pub(crate) fn prepare_folder(folder: &Path) -> Result<()> {
    let advice = "choose another --out folder or change its permissions";
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot create {}; {advice}", folder.display()))?;
    let probe = folder.join(".imf-probe");
    write_text(&probe, "").with_context(|| format!("cannot write to {}; {advice}", folder.display()))?;
    std::fs::remove_file(&probe).with_context(|| format!("cannot remove {}", probe.display()))
}

/// Writes a text file whole or not at all.
pub(crate) fn write_text(path: &Path, text: &str) -> Result<()> {
    use std::io::Write;
    Ok(write_atomically(path, |file| file.write_all(text.as_bytes()))?)
}

/// Writes a value as indented JSON, whole or not at all.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value).context("cannot write JSON")?;
    text.push('\n');
    write_text(path, &text)
}

/// Prints a value as JSON on standard output.
pub(crate) fn print_json(value: &impl Serialize) -> Result<()> {
    use std::io::Write;
    let text = serde_json::to_string_pretty(value).context("cannot write JSON")?;
    writeln!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// Prints text on standard output; a closed pipe is reported as such.
pub(crate) fn print(text: &str) -> Result<()> {
    use std::io::Write;
    writeln!(std::io::stdout(), "{text}")?;
    Ok(())
}
