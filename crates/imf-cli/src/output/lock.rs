//! Folders that one run alone writes to.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::{Result, bail};

/// A lock on a folder: this run alone writes to it until the lock is dropped.
#[must_use = "another run may write to the folder as soon as this is dropped"]
#[derive(Debug)]
pub struct FolderLock {
    /// Nothing where this run locked the folder before, and where folders cannot be locked: on Windows, and on some network drives.
    locked: Option<(PathBuf, File)>,
}

static LOCKED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn locked_folders() -> MutexGuard<'static, Vec<PathBuf>> {
    LOCKED.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        if let Some((path, _)) = &self.locked {
            locked_folders().retain(|locked| locked != path);
        }
    }
}

/// Makes a folder this run's own, if it exists.
///
/// # Errors
/// Another run that writes to it now.
pub fn lock_folder(folder: &Path) -> Result<FolderLock> {
    let nothing = Ok(FolderLock { locked: None });
    let (Ok(path), Ok(opened)) = (folder.canonicalize(), File::open(folder)) else { return nothing };
    let mut all = locked_folders();
    if all.contains(&path) {
        return nothing;
    }
    match opened.try_lock() {
        Ok(()) => {
            all.push(path.clone());
            Ok(FolderLock { locked: Some((path, opened)) })
        }
        Err(TryLockError::WouldBlock) => bail!(
            "another run of imf is writing to {}: wait for its end, or choose another --out",
            folder.display()
        ),
        Err(TryLockError::Error(_)) => nothing,
    }
}
