//! One shard: the samples of a run of sections in one safetensors file.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Read as _, Write};
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::error::DatasetError;
use super::manifest::{Manifest, ShardRecord};
use crate::samples::Samples;
use imf_core::atomic_file::{remove_leftovers, write_atomically};

/// What a file holds beside its tables, at most: names, types and offsets of three tensors take some 200 bytes.
const HEADER_BYTES: u64 = 4096;

pub(super) fn file_name(index: usize) -> String {
    format!("shard-{index:05}.safetensors")
}

/// Writes the samples of one shard whole or not at all.
pub(super) fn write(folder: &Path, index: usize, samples: &Samples) -> Result<ShardRecord, DatasetError> {
    let file = file_name(index);
    let path = folder.join(&file);
    let starts: Vec<u8> = samples.starts.iter().flat_map(|&s| (s as u64).to_le_bytes()).collect();
    let voxels: Vec<u8> = samples.voxels.iter().flat_map(|v| v.to_le_bytes()).collect();
    let values: Vec<u8> = samples.values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let serialized = || {
        let views = [
            ("starts", TensorView::new(Dtype::U64, vec![samples.starts.len()], &starts)?),
            ("voxel", TensorView::new(Dtype::U32, vec![samples.len()], &voxels)?),
            ("value", TensorView::new(Dtype::F32, vec![samples.len()], &values)?),
        ];
        safetensors::serialize(views, None::<HashMap<String, String>>)
    };
    let bytes = serialized()
        .map_err(|e| DatasetError::Damaged { path: path.display().to_string(), what: e.to_string() })?;
    // Of this shard alone: other processes may be writing theirs beside it.
    remove_leftovers(&path);
    write_atomically(&path, |out| out.write_all(&bytes))?;
    Ok(ShardRecord { file, samples: samples.len() as u64, crc32: crc32fast::hash(&bytes) })
}

/// Maximum size in bytes of the file of a shard with `sections` sections and `samples` samples.
pub(super) fn file_bytes(sections: u64, samples: u64) -> u64 {
    let tables = samples.saturating_mul(8).saturating_add(sections.saturating_mul(8));
    tables.saturating_add(8 + HEADER_BYTES)
}

/// Opens a shard's file if it has the size that its samples take, which is checked before it is read: no foreign
/// file, and no manifest with too large numbers, fills the memory. Returns what the manifest says, the file, and the
/// maximum number of bytes to read of it.
pub(super) fn open<'a>(
    folder: &Path,
    manifest: &'a Manifest,
    index: usize,
) -> Result<(&'a ShardRecord, File, u64), DatasetError> {
    let path = folder.join(file_name(index));
    let damaged = |what: String| DatasetError::Damaged { path: path.display().to_string(), what };
    let unreadable = |source| DatasetError::Read { path: path.display().to_string(), source };
    let record =
        manifest.shards[index].as_ref().ok_or_else(|| damaged("the manifest does not name it".into()))?;
    let file = File::open(&path).map_err(unreadable)?;
    let length = file.metadata().map_err(unreadable)?.len();
    let most = file_bytes(manifest.sections_of(index).len() as u64, record.samples);
    if length > most || length < record.samples.saturating_mul(8) {
        return Err(damaged(format!(
            "its {length} bytes are not the size of {} samples: it was cut short or changed; make it again",
            record.samples
        )));
    }
    Ok((record, file, most))
}

/// Adds the samples of a shard that `keep` wants, by number in the shard, to `into`, after checking everything that training
/// relies on, and all its sections. `file` is room for the file's content. Where it fails, `into` is as it was.
pub(super) fn read_into(
    folder: &Path,
    manifest: &Manifest,
    index: usize,
    file: &mut Vec<u8>,
    into: &mut Samples,
    keep: impl Fn(usize) -> bool,
) -> Result<(), DatasetError> {
    let path = folder.join(file_name(index));
    let damaged = |what: String| DatasetError::Damaged { path: path.display().to_string(), what };
    let (record, open, most) = open(folder, manifest, index)?;
    let sections = manifest.sections_of(index);
    file.clear();
    file.reserve_exact(most as usize);
    open.take(most)
        .read_to_end(file)
        .map_err(|source| DatasetError::Read { path: path.display().to_string(), source })?;
    if crc32fast::hash(file) != record.crc32 {
        return Err(damaged(
            "its checksum is not the manifest's: it was cut short or changed; make it again".into(),
        ));
    }
    let tensors = SafeTensors::deserialize(file).map_err(|e| damaged(e.to_string()))?;
    let tensor = |name: &str, dtype: Dtype| match tensors.tensor(name) {
        Ok(view) if view.dtype() == dtype => Ok(view.data()),
        Ok(view) => Err(damaged(format!("'{name}' is {:?}, not {dtype:?}", view.dtype()))),
        Err(error) => Err(damaged(error.to_string())),
    };
    let starts = tensor("starts", Dtype::U64)?.as_chunks::<8>().0;
    let starts: Vec<usize> =
        starts.iter().map(|&b| usize::try_from(u64::from_le_bytes(b)).unwrap_or(usize::MAX)).collect();
    let voxels = tensor("voxel", Dtype::U32)?.as_chunks::<4>().0;
    let values = tensor("value", Dtype::F32)?.as_chunks::<4>().0;
    let ordered = starts.first() == Some(&0) && starts.is_sorted() && starts.last() == Some(&voxels.len());
    if starts.len() != sections.len() + 1 || !ordered || voxels.len() != values.len() {
        return Err(damaged("its tables do not fit together".into()));
    }
    if voxels.len() as u64 != record.samples {
        return Err(damaged(format!("it holds {} samples, not {}", voxels.len(), record.samples)));
    }
    if voxels.iter().any(|&v| u32::from_le_bytes(v) as usize >= manifest.scene.grid.len()) {
        return Err(damaged("a voxel lies outside the grid".into()));
    }
    if !values.iter().all(|&v| (0.0..=1.0).contains(&f32::from_le_bytes(v))) {
        return Err(damaged("a value is not a number from 0 to 1".into()));
    }
    let orientations = &manifest.orientations.orientations;
    into.angles.extend(sections.iter().map(|&section| orientations[section].angles()));
    for section in starts.windows(2) {
        for sample in (section[0]..section[1]).filter(|&sample| keep(sample)) {
            into.voxels.push(u32::from_le_bytes(voxels[sample]));
            into.values.push(f32::from_le_bytes(values[sample]));
        }
        into.starts.push(into.voxels.len());
    }
    Ok(())
}
