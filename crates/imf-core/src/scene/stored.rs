//! A scene's voxels as files keep them: packed bits by name, checked when they are read back.
//!
//! Files keep the union of part and fixtures, and beside it the layer that the cutter may enter where there is contact.

use thiserror::Error;

use super::{Scene, SceneRecord};
use crate::occupancy::{Occupancy, PackedLengthError};

const OBSTACLE: &str = "obstacle";
const LAYER: &str = "layer";

/// Why voxels read from a file are not the scene's.
#[derive(Debug, Error)]
pub enum StoredVoxelsError {
    /// A tensor that the scene needs.
    #[error("it has no voxels '{0}'")]
    Missing(&'static str),
    /// Voxels of another grid.
    #[error(transparent)]
    Length(#[from] PackedLengthError),
    /// Voxels of another scene, or damaged ones.
    #[error("the obstacle's checksum is wrong")]
    Checksum,
    /// A layer beside the part.
    #[error("its layer of contact holds voxels that the obstacle does not")]
    Layer,
}

impl Scene {
    /// Names and packed bits ([`Occupancy::packed`]) of what a file has to keep beside the record.
    #[must_use]
    pub fn packed_voxels(&self) -> Vec<(&'static str, Vec<u8>)> {
        let mut all = vec![(OBSTACLE, self.obstacle.packed())];
        all.extend(self.layer.as_ref().map(|layer| (LAYER, layer.packed())));
        all
    }

    /// The scene of a record and of packed bits, looked up by name.
    ///
    /// # Errors
    /// Bits that are missing, of another length, or not this scene's.
    pub fn from_packed_voxels<'a>(
        record: SceneRecord,
        bits: impl Fn(&str) -> Option<&'a [u8]>,
    ) -> Result<Self, StoredVoxelsError> {
        let packed = bits(OBSTACLE).ok_or(StoredVoxelsError::Missing(OBSTACLE))?;
        if crc32fast::hash(packed) != record.obstacle_crc32 {
            return Err(StoredVoxelsError::Checksum);
        }
        let obstacle = Occupancy::from_packed(record.grid, packed)?;
        let mut scene = Self::from_union(record, obstacle);
        if scene.record.contact.is_some() {
            let packed = bits(LAYER).ok_or(StoredVoxelsError::Missing(LAYER))?;
            let layer = Occupancy::from_packed(scene.record.grid, packed)?;
            if layer.solid.iter().zip(&scene.obstacle.solid).any(|(l, o)| l & (1 - o) != 0) {
                return Err(StoredVoxelsError::Layer);
            }
            scene.layer = Some(layer);
        }
        Ok(scene)
    }
}
