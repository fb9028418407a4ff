//! One shard: the samples of a run of sections in one safetensors file.

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::manifest::{DatasetError, Manifest, ShardRecord, read_file};
use crate::atomic_file::write_atomically;
use crate::samples::Samples;

/// Samples as they are on disk.
pub(super) struct Shard {
    pub(super) starts: Vec<usize>,
    pub(super) voxels: Vec<u32>,
    pub(super) values: Vec<f32>,
}

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
    write_atomically(&path, |out| out.write_all(&bytes))?;
    Ok(ShardRecord { file, samples: samples.len() as u64, crc32: crc32fast::hash(&bytes) })
}

/// Reads a shard and checks everything that training relies on.
pub(super) fn read(folder: &Path, manifest: &Manifest, index: usize) -> Result<Shard, DatasetError> {
    let path = folder.join(file_name(index));
    let damaged = |what: String| DatasetError::Damaged { path: path.display().to_string(), what };
    let bytes = read_file(&path)?;
    let record =
        manifest.shards[index].as_ref().ok_or_else(|| damaged("the manifest does not name it".into()))?;
    if crc32fast::hash(&bytes) != record.crc32 {
        return Err(damaged(
            "its checksum is not the manifest's: it was cut short or changed; make it again".into(),
        ));
    }
    let tensors = SafeTensors::deserialize(&bytes).map_err(|e| damaged(e.to_string()))?;
    let tensor = |name: &str, dtype: Dtype| match tensors.tensor(name) {
        Ok(view) if view.dtype() == dtype => Ok(view),
        Ok(view) => Err(damaged(format!("'{name}' is {:?}, not {dtype:?}", view.dtype()))),
        Err(error) => Err(damaged(error.to_string())),
    };
    let starts = tensor("starts", Dtype::U64)?;
    let starts: Vec<usize> = starts
        .data()
        .as_chunks::<8>()
        .0
        .iter()
        .map(|&b| usize::try_from(u64::from_le_bytes(b)).unwrap_or(usize::MAX))
        .collect();
    let voxels: Vec<u32> = tensor("voxel", Dtype::U32)?
        .data()
        .as_chunks::<4>()
        .0
        .iter()
        .map(|&b| u32::from_le_bytes(b))
        .collect();
    let values: Vec<f32> = tensor("value", Dtype::F32)?
        .data()
        .as_chunks::<4>()
        .0
        .iter()
        .map(|&b| f32::from_le_bytes(b))
        .collect();
    let sections = manifest.sections_of(index).len();
    let ordered = starts.first() == Some(&0) && starts.is_sorted() && starts.last() == Some(&voxels.len());
    if starts.len() != sections + 1 || !ordered || voxels.len() != values.len() {
        return Err(damaged("its tables do not fit together".into()));
    }
    if voxels.iter().any(|&v| v as usize >= manifest.scene.grid.len()) {
        return Err(damaged("a voxel lies outside the grid".into()));
    }
    if !values.iter().all(|v| (0.0..=1.0).contains(v)) {
        return Err(damaged("a value is not a number from 0 to 1".into()));
    }
    Ok(Shard { starts, voxels, values })
}
