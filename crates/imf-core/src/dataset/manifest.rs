//! The manifest of a dataset: what it is, and which of its shards are complete.

use std::collections::HashMap;
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::sampling::{Sampling, SamplingError};
use super::shard;
use crate::atomic_file::{AtomicFileError, write_atomically};
use crate::occupancy::Occupancy;
use crate::orientation::OrientationSet;
use crate::scene::{Scene, SceneRecord};
use crate::section::SectionError;

const FORMAT: &str = "imf-dataset";
const VERSION: u32 = 1;
const MANIFEST: &str = "manifest.json";
const OBSTACLE: &str = "obstacle.safetensors";
/// Samples that a shard holds at most, unless one section has more: 8 bytes each.
const SHARD_SAMPLES: f64 = 4e6;

/// Why a dataset cannot be made or read. Every message names the file.
#[derive(Debug, Error)]
pub enum DatasetError {
    /// A file or folder cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
    /// The folder cannot be made.
    #[error("cannot create the folder {path}: {source}")]
    Folder {
        /// The folder.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// No dataset, or a damaged one.
    #[error("{path} is no intact dataset file: {what}")]
    Damaged {
        /// The file.
        path: String,
        /// What is wrong.
        what: String,
    },
    /// Made by a newer program.
    #[error("{path} has version {found}, and this program reads up to {VERSION}: use a newer imf")]
    Newer {
        /// The manifest.
        path: String,
        /// Its version.
        found: u32,
    },
    /// The folder holds a dataset of another scene or sampling.
    #[error("{path} holds another dataset ({what} differs): choose another folder, or remove it")]
    Other {
        /// The folder.
        path: String,
        /// What differs.
        what: &'static str,
    },
    /// Some shards are not there yet.
    #[error(
        "{path} lacks {missing} of {shards} shards: run the same `imf dataset` command again to finish it"
    )]
    Unfinished {
        /// The folder.
        path: String,
        /// Shards that are missing.
        missing: usize,
        /// Shards in all.
        shards: usize,
    },
    /// A share out of range.
    #[error(transparent)]
    Sampling(#[from] SamplingError),
    /// A section failed, or the work was interrupted.
    #[error(transparent)]
    Section(#[from] SectionError),
}

/// A finished shard.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShardRecord {
    /// File name within the folder.
    pub file: String,
    /// Samples it holds.
    pub samples: u64,
    /// CRC-32 of the whole file.
    pub crc32: u32,
}

/// What a dataset is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    format: String,
    version: u32,
    /// The scene, without its voxels.
    pub scene: SceneRecord,
    /// The orientations, one section each.
    pub orientations: OrientationSet,
    /// How the sections are sampled.
    pub sampling: Sampling,
    /// Sections in every shard but the last.
    pub sections_per_shard: usize,
    /// Finished shards; `null` where one is still missing.
    pub shards: Vec<Option<ShardRecord>>,
}

/// The part of a manifest that can be read whatever its version.
#[derive(Deserialize)]
struct Header {
    format: String,
    version: u32,
}

impl Manifest {
    /// The manifest of a new dataset, or the one in the folder if it describes the same.
    pub(super) fn start(
        folder: &Path,
        scene: &Scene,
        set: &OrientationSet,
        sampling: &Sampling,
    ) -> Result<Self, DatasetError> {
        std::fs::create_dir_all(folder)
            .map_err(|source| DatasetError::Folder { path: folder.display().to_string(), source })?;
        let per_section = scene.record.grid.len() as f64 * sampling.density;
        let sections_per_shard = ((SHARD_SAMPLES / per_section) as usize).clamp(1, set.len().max(1));
        let fresh = Self {
            format: FORMAT.into(),
            version: VERSION,
            scene: scene.record.clone(),
            orientations: set.clone(),
            sampling: *sampling,
            sections_per_shard,
            shards: vec![None; set.len().div_ceil(sections_per_shard)],
        };
        if folder.join(MANIFEST).exists() {
            let found = Self::read(folder)?;
            let other = |what| DatasetError::Other { path: folder.display().to_string(), what };
            if found.scene != fresh.scene {
                return Err(other("the scene"));
            }
            if found.orientations.orientations != fresh.orientations.orientations {
                return Err(other("the orientation set"));
            }
            if found.sampling != fresh.sampling {
                return Err(other("the sampling"));
            }
            return Ok(found);
        }
        let packed = scene.obstacle.packed();
        let view = TensorView::new(Dtype::U8, vec![packed.len()], &packed);
        let path = folder.join(OBSTACLE);
        let bytes = view
            .and_then(|view| safetensors::serialize([("obstacle", view)], None::<HashMap<String, String>>))
            .map_err(|e| DatasetError::Damaged { path: path.display().to_string(), what: e.to_string() })?;
        write_atomically(&path, |file| file.write_all(&bytes))?;
        fresh.write(folder)?;
        Ok(fresh)
    }

    /// Reads and checks a folder's manifest.
    ///
    /// # Errors
    /// A missing, foreign, newer or damaged manifest.
    pub fn read(folder: &Path) -> Result<Self, DatasetError> {
        let path = folder.join(MANIFEST);
        let shown = path.display().to_string();
        let text = std::fs::read_to_string(&path)
            .map_err(|source| DatasetError::Read { path: shown.clone(), source })?;
        let damaged = |what: String| DatasetError::Damaged { path: shown.clone(), what };
        let header: Header = serde_json::from_str(&text).map_err(|e| damaged(e.to_string()))?;
        if header.format != FORMAT {
            return Err(damaged(format!("its format is '{}', not '{FORMAT}'", header.format)));
        }
        if header.version > VERSION {
            return Err(DatasetError::Newer { path: shown, found: header.version });
        }
        let manifest: Self = serde_json::from_str(&text).map_err(|e| damaged(e.to_string()))?;
        if manifest.sections_per_shard == 0
            || manifest.shards.len() != manifest.orientations.len().div_ceil(manifest.sections_per_shard)
        {
            return Err(damaged("its shards do not fit its orientations".into()));
        }
        let names = |(index, shard): (usize, &Option<ShardRecord>)| {
            shard.as_ref().is_none_or(|s| s.file == shard::file_name(index))
        };
        if !manifest.shards.iter().enumerate().all(names) {
            return Err(damaged("a shard has a foreign file name".into()));
        }
        Ok(manifest)
    }

    fn write(&self, folder: &Path) -> Result<(), DatasetError> {
        let text = serde_json::to_vec_pretty(self).map_err(|e| DatasetError::Damaged {
            path: folder.join(MANIFEST).display().to_string(),
            what: e.to_string(),
        })?;
        Ok(write_atomically(folder.join(MANIFEST), |file| file.write_all(&text))?)
    }

    /// The scene with its voxels.
    pub(super) fn scene(&self, folder: &Path) -> Result<Scene, DatasetError> {
        let path = folder.join(OBSTACLE);
        let bytes = read_file(&path)?;
        let damaged = |what: String| DatasetError::Damaged { path: path.display().to_string(), what };
        let tensors = SafeTensors::deserialize(&bytes).map_err(|e| damaged(e.to_string()))?;
        let packed = tensors.tensor("obstacle").map_err(|e| damaged(e.to_string()))?;
        if crc32fast::hash(packed.data()) != self.scene.obstacle_crc32 {
            return Err(damaged("its checksum is not the scene's".into()));
        }
        let obstacle =
            Occupancy::from_packed(self.scene.grid, packed.data()).map_err(|e| damaged(e.to_string()))?;
        Ok(Scene::from_union(self.scene.clone(), obstacle))
    }

    /// Number of shards, finished or not.
    #[must_use]
    pub fn shard_count(&self) -> usize {
        self.shards.len()
    }

    /// Sections that a shard holds.
    #[must_use]
    pub fn sections_of(&self, shard: usize) -> Range<usize> {
        let start = shard * self.sections_per_shard;
        start..(start + self.sections_per_shard).min(self.orientations.len())
    }

    /// CRC-32 over the checksums of all shards: two datasets of the same samples have the same.
    #[must_use]
    pub fn fingerprint(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        for shard in self.shards.iter().flatten() {
            hasher.update(&shard.crc32.to_le_bytes());
        }
        hasher.finalize()
    }

    /// True where the manifest names a shard and its file is there unharmed.
    pub(super) fn is_intact(&self, folder: &Path, shard: usize) -> bool {
        self.shards[shard].as_ref().is_some_and(|record| {
            std::fs::read(folder.join(&record.file))
                .is_ok_and(|bytes| crc32fast::hash(&bytes) == record.crc32)
        })
    }

    pub(super) fn finish_shard(
        &mut self,
        folder: &Path,
        shard: usize,
        record: ShardRecord,
    ) -> Result<(), DatasetError> {
        self.shards[shard] = Some(record);
        self.write(folder)
    }
}

/// Reads a file; errors name it.
pub(super) fn read_file(path: &PathBuf) -> Result<Vec<u8>, DatasetError> {
    std::fs::read(path).map_err(|source| DatasetError::Read { path: path.display().to_string(), source })
}
