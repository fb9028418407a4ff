//! A scene's voxels as files save them: packed bits by name, checked when they are read back.
//!
//! Files save the union of part and fixtures, and beside it the layer that the cutter may enter where there is contact.

use thiserror::Error;

use super::{Scene, SceneRecord};
use crate::grid::GridError;
use crate::occupancy::Occupancy;
use crate::tool::ToolError;

const OBSTACLE: &str = "obstacle";
const LAYER: &str = "layer";

/// Why voxels read from a file are not the scene's.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SavedVoxelsError {
    /// An invalid grid.
    #[error("its grid: {0}")]
    Grid(#[from] GridError),
    /// An invalid tool.
    #[error("its tool: {0}")]
    Tool(#[from] ToolError),
    /// A tensor that the scene needs.
    #[error("it has no voxels '{0}'")]
    Missing(&'static str),
    /// Voxels of another grid.
    #[error("its voxels '{0}' are not as many as its grid has")]
    Length(&'static str),
    /// Voxels of another scene, or damaged ones.
    #[error("the obstacle's checksum is wrong")]
    Checksum,
    /// A layer beside the part.
    #[error("its layer of contact holds voxels that the obstacle does not")]
    Layer,
}

/// The CRC-32 of ZIP and PNG (polynomial 0xEDB88320), bit by bit: voxels are packed, and hashed but once.
pub(super) fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32| (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
    !bytes.iter().fold(!0, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), |crc, _| step(crc)))
}

impl SceneRecord {
    /// Checks what a file says of a scene, but for its voxels.
    ///
    /// # Errors
    /// An invalid grid or tool.
    #[doc(hidden)]
    pub fn check(&self) -> Result<(), SavedVoxelsError> {
        self.grid.check()?;
        for tool in self.bare_tool.iter().chain([&self.tool]) {
            tool.check()?;
            tool.check_sharp_points(self.grid.pitch)?;
        }
        Ok(())
    }
}

impl Scene {
    /// Names and packed bits ([`Occupancy::packed`]) of what a file saves beside the record.
    #[doc(hidden)]
    #[must_use]
    pub fn packed_voxels(&self) -> Vec<(&'static str, Vec<u8>)> {
        let mut all = vec![(OBSTACLE, self.obstacle.packed())];
        all.extend(self.layer.as_ref().map(|layer| (LAYER, layer.packed())));
        all
    }

    /// The scene of a record and of packed bits, looked up by name.
    ///
    /// # Errors
    /// An invalid grid or tool; bits that are missing, of another length, or not this scene's.
    #[doc(hidden)]
    pub fn from_packed_voxels<'a>(
        record: SceneRecord,
        bits: impl Fn(&str) -> Option<&'a [u8]>,
    ) -> Result<Self, SavedVoxelsError> {
        record.check()?;
        let grid = record.grid;
        let voxels = |name| -> Result<_, SavedVoxelsError> {
            let packed = bits(name).ok_or(SavedVoxelsError::Missing(name))?;
            let unpacked = Occupancy::from_packed(grid, packed).ok_or(SavedVoxelsError::Length(name))?;
            Ok((unpacked, crc32(packed)))
        };
        let (obstacle, checksum) = voxels(OBSTACLE)?;
        if checksum != record.obstacle_crc32 {
            return Err(SavedVoxelsError::Checksum);
        }
        let mut scene = Self { record, obstacle, layer: None };
        if scene.record.contact.is_some() {
            let (layer, _) = voxels(LAYER)?;
            if layer.solid.iter().zip(&scene.obstacle.solid).any(|(l, o)| l & (1 - o) != 0) {
                return Err(SavedVoxelsError::Layer);
            }
            scene.layer = Some(layer);
        }
        Ok(scene)
    }
}

#[cfg(test)]
mod tests {
    use super::crc32;

    #[test]
    fn the_checksum_is_that_of_zip() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
        let bytes: Vec<u8> = (0..3000_u32).map(|i| (i * i % 251) as u8).collect();
        assert_eq!(crc32(&bytes), crc32fast::hash(&bytes));
    }
}
