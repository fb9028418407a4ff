//! Joining the partitions of a dataset that were made in several places.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::error::DatasetError;
use super::manifest::{Manifest, ShardRecord, create_folder, read_file};
use super::shard;
use crate::samples::Samples;
use imf_core::atomic_file::{remove_all_leftovers, write_atomically};
use imf_core::control::Control;
use imf_core::section::SectionError;

/// What [`merge`] found.
#[derive(Clone, Debug, PartialEq)]
pub struct MergeSummary {
    /// The manifest of the joined dataset, which names what is there.
    pub manifest: Manifest,
    /// Shards that were in the folder already.
    pub kept: usize,
    /// Shards copied into it now.
    pub copied: usize,
    /// Shards that are nowhere, or nowhere intact.
    pub missing: Vec<usize>,
    /// What is wrong with files that were left out.
    pub damaged: Vec<String>,
}

/// A manifest with its name, and the folder whose files it names.
struct Source {
    folder: PathBuf,
    name: String,
    manifest: Manifest,
}

impl Source {
    fn all(folder: &Path) -> Result<impl Iterator<Item = Self>, DatasetError> {
        let manifests = Manifest::read_all(folder)?.into_iter();
        let folder = folder.to_owned();
        Ok(manifests.map(move |(name, manifest)| Self { folder: folder.clone(), name, manifest }))
    }

    fn path(&self) -> String {
        self.folder.join(&self.name).display().to_string()
    }
}

/// Joins into `out` the shards that `folders`, and `out` itself, hold of one dataset: their checksums and scenes are
/// checked, intact shards copied, and the manifest written, after each copy too. The result is byte for byte the dataset made at
/// once; shards that are missing are listed, and `out` may be completed later. One unit of progress is one shard.
///
/// # Errors
/// A folder without a dataset, datasets that differ, or a folder that cannot be written. Nothing is lost then.
pub fn merge(out: &Path, folders: &[PathBuf], control: Control<'_>) -> Result<MergeSummary, DatasetError> {
    let mut sources = Vec::new();
    for folder in folders {
        let before = sources.len();
        sources.extend(Source::all(folder)?);
        if sources.len() == before {
            // The error of a folder without a manifest names what is missing.
            Manifest::read(folder)?;
        }
    }
    if out.is_dir() {
        sources.extend(Source::all(out)?);
    }
    let Some(first) = sources.first() else {
        Manifest::read(out)?;
        return Err(DatasetError::NoPartitions);
    };
    for source in &sources[1..] {
        if let Some(what) = source.manifest.difference(&first.manifest) {
            return Err(DatasetError::Unlike { path: source.path(), than: first.path(), what });
        }
    }
    let mut damaged = BTreeSet::new();
    let mut manifest = joined(&sources, out, &mut damaged)?;
    // What is interrupted goes on with what lies there.
    for source in sources.iter().filter(|source| source.folder == out) {
        let places = manifest.shards.iter_mut().zip(&source.manifest.shards);
        places.for_each(|(place, known)| *place = place.take().or_else(|| known.clone()));
    }
    let (mut kept, mut copied, mut missing) = (0, 0, Vec::new());
    for index in 0..manifest.shard_count() {
        control.check().map_err(SectionError::from)?;
        match take(out, &sources, index, &mut damaged)? {
            Some((record, is_copied)) => {
                manifest.shards[index] = Some(record);
                copied += usize::from(is_copied);
                kept += usize::from(!is_copied);
                if is_copied {
                    manifest.write(out)?;
                }
            }
            None => {
                manifest.shards[index] = None;
                missing.push(index);
            }
        }
        (control.progress)(1);
    }
    manifest.write(out)?;
    if missing.is_empty() {
        Manifest::remove_partitions(out);
    }
    Ok(MergeSummary { manifest, kept, copied, missing, damaged: damaged.into_iter().collect() })
}

/// An empty manifest in `out`, and the obstacle beside it.
fn joined(sources: &[Source], out: &Path, damaged: &mut BTreeSet<String>) -> Result<Manifest, DatasetError> {
    create_folder(out)?;
    remove_all_leftovers(out);
    let mut failure = DatasetError::NoPartitions;
    for source in sources {
        match source.manifest.scene(&source.folder) {
            Ok(scene) => {
                super::obstacle::write(out, &scene)?;
                return Ok(source.manifest.emptied());
            }
            Err(error) => {
                damaged.insert(error.to_string());
                failure = error;
            }
        }
    }
    Err(failure)
}

/// Sees to it that shard `index` lies in `out`, if it is anywhere; true where it was copied.
fn take(
    out: &Path,
    sources: &[Source],
    index: usize,
    damaged: &mut BTreeSet<String>,
) -> Result<Option<(ShardRecord, bool)>, DatasetError> {
    let holders = || sources.iter().filter(|source| source.manifest.shards[index].is_some());
    let crc = |source: &Source| source.manifest.shards[index].as_ref().map(|record| record.crc32);
    if let Some(first) = holders().next()
        && let Some(other) = holders().find(|other| crc(other) != crc(first))
    {
        return Err(DatasetError::Disagree {
            shard: shard::file_name(index),
            first: first.folder.display().to_string(),
            second: other.folder.display().to_string(),
        });
    }
    // What lies in `out` needs no copy.
    let (here, elsewhere): (Vec<_>, Vec<_>) = holders().partition(|source| source.folder == out);
    for source in here.into_iter().chain(elsewhere) {
        let mut samples = Samples::new(source.manifest.scene.grid);
        match shard::read_into(&source.folder, &source.manifest, index, &mut Vec::new(), &mut samples, |_| {
            true
        }) {
            Ok(()) => {
                let is_copied = source.folder != out;
                if is_copied {
                    let name = shard::file_name(index);
                    let bytes = read_file(&source.folder.join(&name))?;
                    write_atomically(out.join(name), |file| file.write_all(&bytes))?;
                }
                return Ok(source.manifest.shards[index].clone().map(|record| (record, is_copied)));
            }
            Err(error) => {
                damaged.insert(error.to_string());
            }
        }
    }
    Ok(None)
}
