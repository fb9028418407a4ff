//! The documents keep their word: every command that README and guide show is run, what is shown is what it prints, and
//! every link leads somewhere.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

#[cfg(unix)]
mod commands;
mod links;
mod markdown;

use std::path::{Path, PathBuf};

/// The repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// The pages of the book in their order, as paths below `docs`.
fn chapters() -> Vec<String> {
    let summary = markdown::Page::read(&root().join("docs/SUMMARY.md"));
    summary.links.into_iter().map(|link| link.to).collect()
}

/// The pages whose commands and snippets are for readers to repeat: the guide, without the records beside it.
fn guide() -> Vec<String> {
    chapters().into_iter().filter(|page| page.starts_with("guide/")).collect()
}
