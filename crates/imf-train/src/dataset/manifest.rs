//! The manifest of a dataset: what it is, and which of its shards are complete.
//!
//! Each partition of a dataset has a manifest of its own name, so that several processes may work in one folder;
//! joining them makes the one `manifest.json` that training reads.

use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::error::DatasetError;
use super::partition::{Layout, Partition};
use super::{obstacle, shard};
use imf_core::atomic_file::{remove_all_leftovers, write_atomically};
use imf_core::orientation::OrientationSet;
use imf_core::scene::{Scene, SceneRecord};
use imf_fields::model::{Model, TrainingRecord};
use imf_fields::recipe::{Sampling, TrainingPlan, TrainingState};
use imf_fields::siren::SirenShape;

const FORMAT: &str = "imf-dataset";
pub(super) const VERSION: u32 = 1;
const MANIFEST: &str = "manifest.json";
/// What stands before the eight digits of a manifest's checksum: the CRC-32 of its text with zeros in their place.
const CHECKSUM: &str = "{\n  \"checksum\": \"";
/// Where the text behind it begins.
pub(super) const BEHIND_CHECKSUM: usize = CHECKSUM.len() + 8;
/// Samples that a shard holds at most by default, unless one section has more: 8 bytes each.
pub(super) const SHARD_SAMPLES: u64 = 4_000_000;

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
        if text.get(BEHIND_CHECKSUM..).is_none_or(|rest| sealed(rest) != text) {
            return Err(damaged("its checksum is wrong: it was changed after it was written".into()));
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
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| DatasetError::Damaged { path: path.display().to_string(), what: e.to_string() })?;
        let text = sealed(&format!("\",{}", text.strip_prefix('{').unwrap_or(&text)));
        Ok(write_atomically(path, |file| file.write_all(text.as_bytes()))?)
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

/// A manifest's text from what stands behind its checksum.
pub(super) fn sealed(rest: &str) -> String {
    let sum = crc32fast::hash(format!("{CHECKSUM}00000000{rest}").as_bytes());
    format!("{CHECKSUM}{sum:08x}{rest}")
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
