//! The solid voxels of a dataset's scene, in one safetensors file beside the manifest.

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::error::DatasetError;
use super::manifest::read_file;
use imf_core::atomic_file::write_atomically;
use imf_core::scene::{Scene, SceneRecord};

const OBSTACLE: &str = "obstacle.safetensors";

pub(super) fn write(folder: &Path, scene: &Scene) -> Result<(), DatasetError> {
    let voxels = scene.packed_voxels();
    let path = folder.join(OBSTACLE);
    let views =
        voxels.iter().map(|(name, bits)| Ok((*name, TensorView::new(Dtype::U8, vec![bits.len()], bits)?)));
    let bytes = views
        .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()
        .and_then(|views| safetensors::serialize(views, None::<HashMap<String, String>>))
        .map_err(|e| DatasetError::Damaged { path: path.display().to_string(), what: e.to_string() })?;
    Ok(write_atomically(&path, |file| file.write_all(&bytes))?)
}

/// The scene of a record with its solid voxels.
pub(super) fn read(folder: &Path, record: &SceneRecord) -> Result<Scene, DatasetError> {
    let path = folder.join(OBSTACLE);
    let bytes = read_file(&path)?;
    let damaged = |what: String| DatasetError::Damaged { path: path.display().to_string(), what };
    let tensors = SafeTensors::deserialize(&bytes).map_err(|e| damaged(e.to_string()))?;
    let bits = |name: &str| tensors.tensor(name).ok().map(|view| view.data());
    Scene::from_packed_voxels(record.clone(), bits).map_err(|e| damaged(e.to_string()))
}
