//! The manifest of a dataset: what it is, and which of its shards are complete.
//!
//! Each partition of a dataset has a manifest of its own name, so that several processes may work in one folder;
//! joining them makes the one `manifest.json` that training reads.

use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::partition::{Layout, Partition};
use super::{obstacle, shard};
use imf_core::atomic_file::{AtomicFileError, remove_all_leftovers, write_atomically};
use imf_core::orientation::OrientationSet;
use imf_core::scene::{Scene, SceneRecord};
use imf_core::section::SectionError;
use imf_fields::model::{Model, TrainingRecord};
use imf_fields::recipe::{Sampling, SamplingError, TrainingPlan, TrainingState};
use imf_fields::siren::SirenShape;

const FORMAT: &str = "imf-dataset";
const VERSION: u32 = 1;
const MANIFEST: &str = "manifest.json";
/// Samples that a shard holds at most by default, unless one section has more: 8 bytes each.
pub(super) const SHARD_SAMPLES: u64 = 4_000_000;

/// Why a dataset cannot be made or read. Every message names the file.
#[derive(Debug, Error)]
#[non_exhaustive]
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
    #[error("{path} is not an intact dataset file: {what}")]
    Damaged {
        /// The file.
        path: String,
        /// What is wrong.
        what: String,
    },
    /// Made by a newer program.
    #[error("{path} has version {found}, and this program reads version {VERSION}: use a newer imf")]
    Newer {
        /// The manifest.
        path: String,
        /// Its version.
        found: u32,
    },
    /// The folder holds a dataset of another scene or sampling.
    #[error("{path} is of another dataset ({what} differs): choose another folder, or remove that one")]
    Other {
        /// The manifest.
        path: String,
        /// What differs.
        what: &'static str,
    },
    /// Some shards are not there yet.
    #[error("{path} lacks {missing} of {shards} shards: finish it as it was begun")]
    Unfinished {
        /// The folder.
        path: String,
        /// Shards that are missing.
        missing: usize,
        /// Shards in all.
        shards: usize,
    },
    /// The folder holds partitions that nobody has joined.
    #[error(
        "{path} holds {manifests} partition(s) of a dataset and no manifest.json: they must be merged first"
    )]
    Partitions {
        /// The folder.
        path: String,
        /// How many manifests of partitions there are.
        manifests: usize,
    },
    /// Nothing to join.
    #[error("there is no dataset to join")]
    NoPartitions,
    /// Two folders hold different datasets.
    #[error(
        "{path} is of another dataset than {than} ({what} differs): leave one of the two out, or make it again in a folder of its own"
    )]
    Unlike {
        /// The manifest.
        path: String,
        /// The one it was compared with.
        than: String,
        /// What differs.
        what: &'static str,
    },
    /// Two folders hold one shard with different content.
    #[error(
        "{shard} differs between {first} and {second}, though scene, orientations and sampling agree: a machine \
         computed it wrongly, or its manifest was changed; make both again and compare"
    )]
    Disagree {
        /// The shard's file name.
        shard: String,
        /// A folder that names it.
        first: String,
        /// Another one.
        second: String,
    },
    /// A fraction out of range.
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
    /// Sections in a shard, at most.
    pub sections_per_shard: usize,
    /// Finished shards; `null` where one is still missing.
    pub shards: Vec<Option<ShardRecord>>,
    /// What this is the manifest of: a partition, or the whole dataset. Given by the file's name, not its content.
    #[serde(skip)]
    partition: Option<Partition>,
}

/// The part of a manifest that can be read whatever its version.
#[derive(Deserialize)]
struct Header {
    format: String,
    version: u32,
}

impl Manifest {
    /// The manifest of a new dataset or partition, or the one in the folder if it describes the same; and whether that
    /// one is cut up otherwise than requested.
    pub(super) fn start(
        folder: &Path,
        scene: &Scene,
        set: &OrientationSet,
        sampling: &Sampling,
        layout: &Layout,
    ) -> Result<(Self, bool), DatasetError> {
        create_folder(folder)?;
        // Other processes write partitions of theirs beside one.
        if layout.partition.is_none() {
            remove_all_leftovers(folder);
        }
        let per_section = scene.record.grid.len() as f64 * sampling.density;
        let sections_per_shard = layout.sections_per_shard(per_section, set.len());
        let fresh = Self {
            format: FORMAT.into(),
            version: VERSION,
            scene: scene.record.clone(),
            orientations: set.clone(),
            sampling: *sampling,
            sections_per_shard,
            shards: vec![None; set.len().div_ceil(sections_per_shard)],
            partition: layout.partition,
        };
        // All partitions in a folder are of one dataset, whose shards have the same names.
        let all = Self::read_all(folder)?;
        let Some((_, first)) = all.first() else {
            obstacle::write(folder, scene)?;
            fresh.write(folder)?;
            return Ok((fresh, false));
        };
        // How an existing dataset is cut up stays.
        let otherwise =
            layout.shard_samples.is_some() && first.sections_per_shard != fresh.sections_per_shard;
        let fresh =
            Self { shards: first.emptied().shards, sections_per_shard: first.sections_per_shard, ..fresh };
        let differs = |(name, found): &(String, Self)| Some((folder.join(name), found.difference(&fresh)?));
        if let Some((path, what)) = all.iter().find_map(differs) {
            return Err(DatasetError::Other { path: path.display().to_string(), what });
        }
        // A partition goes on from its own manifest, else from that of the whole.
        let own = [fresh.file_name(), MANIFEST.to_owned()];
        let own = own.iter().find_map(|own| all.iter().find(|(name, _)| name == own));
        if fresh.scene(folder).is_err() {
            obstacle::write(folder, scene)?;
        }
        match own {
            Some((_, found)) => Ok((Self { shards: found.shards.clone(), ..fresh }, otherwise)),
            None => fresh.write(folder).map(|()| (fresh, otherwise)),
        }
    }

    /// What makes two manifests describe different datasets.
    pub(super) fn difference(&self, other: &Self) -> Option<&'static str> {
        if self.scene != other.scene {
            Some("the scene")
        } else if self.orientations.orientations != other.orientations.orientations {
            Some("the orientation set")
        } else if self.sampling != other.sampling {
            Some("the sampling")
        } else if self.sections_per_shard != other.sections_per_shard {
            Some("the number of samples in a shard")
        } else {
            None
        }
    }

    /// Reads and checks a folder's manifest.
    ///
    /// # Errors
    /// A missing, foreign, newer or damaged manifest, or partitions that are not joined.
    pub fn read(folder: &Path) -> Result<Self, DatasetError> {
        let partitions = partition_manifests(folder).len();
        if partitions > 0 && !folder.join(MANIFEST).exists() {
            let path = folder.display().to_string();
            return Err(DatasetError::Partitions { path, manifests: partitions });
        }
        Self::read_named(folder, MANIFEST)
    }

    /// True where a folder holds a dataset, or partitions of one, in whatever state.
    #[must_use]
    pub fn is_in(folder: &Path) -> bool {
        folder.join(MANIFEST).exists() || !partition_manifests(folder).is_empty()
    }

    /// The manifests of a folder with their names: that of a whole dataset, if there is one, and those of partitions.
    pub(super) fn read_all(folder: &Path) -> Result<Vec<(String, Self)>, DatasetError> {
        let whole = folder.join(MANIFEST).exists().then(|| MANIFEST.to_owned());
        let names = whole.into_iter().chain(partition_manifests(folder));
        names.map(|name| Self::read_named(folder, &name).map(|manifest| (name, manifest))).collect()
    }

    /// Removes the manifests of partitions, once the whole names all that they name.
    pub(super) fn remove_partitions(folder: &Path) {
        for name in partition_manifests(folder) {
            // One that stays does no harm.
            let _ = std::fs::remove_file(folder.join(name));
        }
    }

    fn read_named(folder: &Path, name: &str) -> Result<Self, DatasetError> {
        let path = folder.join(name);
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
        if header.version != VERSION {
            return Err(damaged(format!("there is no version {}", header.version)));
        }
        let manifest: Self = serde_json::from_str(&text).map_err(|e| damaged(e.to_string()))?;
        manifest.scene.check().map_err(|e| damaged(e.to_string()))?;
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

    fn file_name(&self) -> String {
        self.partition.map_or_else(|| MANIFEST.to_owned(), Partition::manifest_name)
    }

    /// The same dataset, nothing of it made.
    pub(super) fn emptied(&self) -> Self {
        Self { shards: vec![None; self.shards.len()], partition: None, ..self.clone() }
    }

    pub(super) fn write(&self, folder: &Path) -> Result<(), DatasetError> {
        let path = folder.join(self.file_name());
        let text = serde_json::to_vec_pretty(self)
            .map_err(|e| DatasetError::Damaged { path: path.display().to_string(), what: e.to_string() })?;
        Ok(write_atomically(path, |file| file.write_all(&text))?)
    }

    /// The scene with its voxels, from the folder that this manifest was read from.
    ///
    /// # Errors
    /// A missing or damaged file of voxels.
    pub fn scene(&self, folder: &Path) -> Result<Scene, DatasetError> {
        obstacle::read(folder, &self.scene)
    }

    /// Number of shards, finished or not.
    #[must_use]
    pub fn shard_count(&self) -> usize {
        self.shards.len()
    }

    /// Sections that a shard holds, ascending: every so-manieth, so that each shard has directions from everywhere.
    #[must_use]
    pub fn sections_of(&self, shard: usize) -> Vec<usize> {
        (shard..self.orientations.len()).step_by(self.shard_count()).collect()
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

    /// An untrained model of this dataset's `scene` and `samples` samples.
    #[must_use]
    pub fn fresh_model(
        &self,
        scene: Scene,
        samples: u64,
        shape: SirenShape,
        plan: TrainingPlan,
        state: TrainingState,
        fine_tuned_from: Option<String>,
    ) -> Model {
        let record = TrainingRecord {
            plan,
            sampling: self.sampling,
            samples,
            dataset_crc32: self.fingerprint(),
            fine_tuned_from,
            ..TrainingRecord::untrained(self.orientations.clone())
        };
        Model { shape, scene, record, state, calibration: None }
    }

    /// True where the manifest names a shard and its file is there unharmed.
    pub(super) fn is_intact(&self, folder: &Path, shard: usize) -> bool {
        self.shards[shard].as_ref().is_some_and(|record| {
            std::fs::read(folder.join(&record.file))
                .is_ok_and(|bytes| crc32fast::hash(&bytes) == record.crc32)
        })
    }
}

/// Names of the manifests of partitions in a folder, sorted.
fn partition_manifests(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(|name| Partition::is_manifest_name(name)).collect();
    names.sort();
    names
}

/// Makes a folder, if it is not there; errors name it.
pub(super) fn create_folder(folder: &Path) -> Result<(), DatasetError> {
    std::fs::create_dir_all(folder)
        .map_err(|source| DatasetError::Folder { path: folder.display().to_string(), source })
}

/// Reads a file; errors name it.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, DatasetError> {
    std::fs::read(path).map_err(|source| DatasetError::Read { path: path.display().to_string(), source })
}
