//! Stale files of an earlier run in a folder: they are removed, so that none is taken for one of the new run.

use std::fs;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context as _, Result};
use serde::Deserialize;

/// The last file of every run that writes its results into a folder; it names them all.
pub(crate) const SUMMARY: &str = "summary.json";

/// What is read of a summary.
#[derive(Deserialize)]
struct StaleSummary {
    program: String,
    files: Vec<String>,
}

/// The files that a summary of this program names, the summary last. Files that no summary names are not listed, nor
/// are files outside the folder.
pub(super) fn stale_files(folder: &Path) -> Vec<PathBuf> {
    let summary = folder.join(SUMMARY);
    let Ok(text) = fs::read_to_string(&summary) else { return Vec::new() };
    let Ok(StaleSummary { program, files }) = serde_json::from_str(&text) else { return Vec::new() };
    if !program.starts_with("imf ") {
        return Vec::new();
    }
    let is_name = |file: &&String| {
        let mut parts = Path::new(file.as_str()).components();
        matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None)) && *file != SUMMARY
    };
    files.iter().filter(is_name).map(|file| folder.join(file)).chain([summary]).collect()
}

/// Removes [`stale_files`] and returns how many there were.
pub(super) fn remove_stale(folder: &Path) -> Result<usize> {
    let mut removed = 0;
    for path in stale_files(folder) {
        match fs::remove_file(&path) {
            Ok(()) => removed += 1,
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => {
                return Err(error).with_context(|| {
                    format!("cannot replace {} of an earlier run; choose another --out", path.display())
                });
            }
        }
    }
    Ok(removed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_that_the_summary_names_within_the_folder_are_removed() {
        let outside = tempfile::tempdir().unwrap();
        let folder = outside.path().join("out");
        fs::create_dir(&folder).unwrap();
        let above = outside.path().join("above.npy");
        for path in [&above, &folder.join("imf.npy"), &folder.join("mine.npy")] {
            fs::write(path, "x").unwrap();
        }
        let absolute = above.to_str().unwrap();
        let files = ["imf.npy", "gone.npy", "../above.npy", absolute, SUMMARY];
        let summary = serde_json::json!({ "program": "imf 0.1.0", "files": files });
        fs::write(folder.join(SUMMARY), summary.to_string()).unwrap();
        assert_eq!(remove_stale(&folder).unwrap(), 2, "imf.npy and the summary");
        let left: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, ["mine.npy"]);
        assert!(above.exists());
        assert_eq!(remove_stale(&folder).unwrap(), 0);
        // Somebody else's summary names nothing of ours.
        for text in ["{}", "no JSON", r#"{"program": "other 1", "files": ["mine.npy"]}"#] {
            fs::write(folder.join(SUMMARY), text).unwrap();
            assert_eq!(remove_stale(&folder).unwrap(), 0);
        }
        assert!(folder.join("mine.npy").exists());
    }
}
