//! Datasets: what they sample, and how much of it is there.

use std::path::Path;

use anyhow::{Result, ensure};
use imf_train::dataset::{Manifest, ShardRecord};
use serde_json::json;

use super::{Description, scene_lines};
use crate::session::show_bytes;

pub(super) fn describe(folder: &Path) -> Result<Description> {
    ensure!(Manifest::is_in(folder), "{} is no dataset: a folder without manifest.json", folder.display());
    let manifest = Manifest::read(folder)?;
    let size = |shard: &ShardRecord| std::fs::metadata(folder.join(&shard.file)).ok().map(|m| m.len());
    let finished: Vec<(&ShardRecord, u64)> =
        manifest.shards.iter().flatten().filter_map(|shard| Some((shard, size(shard)?))).collect();
    let missing = manifest.shard_count() - finished.len();
    let samples: u64 = finished.iter().map(|(shard, _)| shard.samples).sum();
    let bytes: u64 = finished.iter().map(|&(_, bytes)| bytes).sum();
    let sampling = &manifest.sampling;
    let rest = if missing == 0 {
        "complete".to_owned()
    } else {
        format!("{missing} missing: the same `imf dataset` command finishes it")
    };
    let mut lines = vec![("dataset", folder.display().to_string())];
    lines.extend(scene_lines(&manifest.scene));
    lines.extend([
        ("orientations", format!("{} ({})", manifest.orientations.len(), manifest.orientations.spec)),
        (
            "sampling",
            format!(
                "{:.1} % of the voxels of every section, {:.1} % of them where the tool collides, seed {}",
                100.0 * sampling.density,
                100.0 * sampling.positive_share,
                sampling.seed
            ),
        ),
        ("shards", format!("{} of {}, {rest}", finished.len(), manifest.shard_count())),
        ("samples", format!("{samples} in {}", show_bytes(bytes))),
    ]);
    let json = json!({
        "kind": "dataset",
        "folder": folder,
        "scene": manifest.scene,
        "orientations": { "set": manifest.orientations.spec, "count": manifest.orientations.len() },
        "sampling": sampling,
        "shards": manifest.shard_count(),
        "shards_finished": finished.len(),
        "shards_missing": missing,
        "samples": samples,
        "bytes": bytes,
    });
    Ok(Description { lines, json })
}
