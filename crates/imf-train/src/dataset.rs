//! Datasets: samples of exact sections on disk, drawn once and trained from many times.
//!
//! A dataset is a folder:
//!
//! ```text
//! manifest.json            checksum, format, version, scene, orientations, sampling, and one entry for each finished shard
//! obstacle.safetensors     the scene's solid voxels, eight a byte
//! shard-00000.safetensors  `starts` u64 [sections + 1], `voxel` u32 [n], `value` f32 [n]
//! …
//! ```
//!
//! Every file is written whole or not at all, and the manifest names a shard only once it is complete: work that was
//! interrupted goes on where it stopped. Each section's samples depend on the seed and the section alone, so parts of
//! a dataset can be made on any machines ([`Layout::partition`]) and joined ([`merge`]).

mod error;
mod manifest;
mod merge;
mod obstacle;
mod partition;
mod sampling;
mod shard;
mod shards;

pub use error::DatasetError;
pub use manifest::{Manifest, ShardRecord};
pub use merge::{MergeSummary, merge};
pub use partition::{Layout, Partition, PartitionError};
pub use sampling::draw;
pub use shards::Shards;

use std::path::Path;
use std::sync::atomic::AtomicBool;

use crate::samples::Samples;
use imf_core::control::Control;
use imf_core::orientation::OrientationSet;
use imf_core::scene::Scene;
use imf_core::section::{SectionPlan, ToolPoints, stream_sections};
use imf_fields::recipe::Sampling;

/// What [`generate`] did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GenerateSummary {
    /// Shards that were there already and were reused.
    pub kept: usize,
    /// Shards made now.
    pub made: usize,
    /// Shards that belong to other partitions.
    pub others: usize,
    /// Samples in the shards reused and made.
    pub samples: u64,
    /// Sections in a shard, where the existing dataset is cut up otherwise than requested: it stays so.
    pub otherwise_cut: Option<usize>,
}

/// Makes the dataset of a scene in `folder`, or goes on with one that was interrupted. One unit of progress is one
/// section that is made.
///
/// # Errors
/// A folder that holds another dataset or cannot be written, a failed section, or cancellation; finished shards stay.
pub fn generate(
    folder: &Path,
    scene: &Scene,
    set: &OrientationSet,
    sampling: &Sampling,
    control: Control<'_>,
) -> Result<GenerateSummary, DatasetError> {
    generate_partition(folder, scene, set, sampling, &Layout::default(), control, &|_| {})
}

/// As [`generate`], cut up as `layout` says, and only the shards of its partition. `passed_over` gets the sections of shards that are
/// there already or of other partitions.
///
/// # Errors
/// As [`generate`].
pub fn generate_partition(
    folder: &Path,
    scene: &Scene,
    set: &OrientationSet,
    sampling: &Sampling,
    layout: &Layout,
    control: Control<'_>,
    passed_over: &dyn Fn(u64),
) -> Result<GenerateSummary, DatasetError> {
    sampling.check()?;
    let (mut manifest, otherwise) = Manifest::start(folder, scene, set, sampling, layout)?;
    // A learnt field is made for the tip, and serves every sharp point k when read at x − R k.
    let plan = SectionPlan::of_scene(scene, ToolPoints::Tip)?;
    let otherwise_cut = otherwise.then_some(manifest.sections_per_shard);
    let mut done = GenerateSummary { otherwise_cut, ..GenerateSummary::default() };
    for index in 0..manifest.shard_count() {
        let sections = manifest.sections_of(index);
        if layout.partition.is_some_and(|partition| !partition.holds(index)) {
            done.others += 1;
            passed_over(sections.len() as u64);
            continue;
        }
        if manifest.is_intact(folder, index) {
            done.kept += 1;
            passed_over(sections.len() as u64);
        } else {
            let orientations: Vec<_> = sections.iter().map(|&section| set.orientations[section]).collect();
            let parts =
                stream_sections(&plan, &orientations, control, Vec::new, |list: &mut Vec<_>, local, cmf| {
                    let voxels = draw(cmf, sampling, sections[local] as u64);
                    let values: Vec<f32> = voxels.iter().map(|&v| cmf[v as usize]).collect();
                    list.push((local, voxels, values));
                })?;
            let mut drawn: Vec<_> = parts.into_iter().flatten().collect();
            drawn.sort_by_key(|&(local, ..)| local);
            let mut samples = Samples::new(scene.record.grid);
            for (local, voxels, values) in drawn {
                samples.push_section(orientations[local].angles(), &voxels, &values);
            }
            manifest.shards[index] = Some(shard::write(folder, index, &samples)?);
            manifest.write(folder)?;
            done.made += 1;
        }
        done.samples += manifest.shards[index].as_ref().map_or(0, |s| s.samples);
    }
    Ok(done)
}

/// Reads a whole dataset: its scene and all its samples, checked against the manifest.
///
/// # Errors
/// A missing, foreign, newer, damaged or unfinished dataset; the message names the file.
pub fn load(folder: &Path) -> Result<(Manifest, Scene, Samples), DatasetError> {
    let shards = Shards::open(folder)?;
    let scene = shards.manifest.scene(folder)?;
    let samples = shards.read_all(&AtomicBool::new(false))?;
    Ok((shards.manifest, scene, samples))
}

#[cfg(test)]
mod tests;
