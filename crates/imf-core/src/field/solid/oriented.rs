//! Voxels of tools that are counted by the definition, by orientation: with the tip on a voxel centre these are all that is
//! needed, wherever it is, and many poses share few orientations.

use std::collections::HashMap;
use std::sync::{Arc, PoisonError, RwLock};

use crate::orientation::Orientation;
use crate::tool::{RotatedTool, Tool, ToolError};

/// Memory that they may take; beyond it they are made anew each time.
const MOST_BYTES: usize = 128 << 20;

/// A tool's voxels by the orientation's bits, and the bytes they take.
#[derive(Default)]
pub(super) struct OrientedTools(RwLock<(HashMap<[u64; 3], Arc<RotatedTool>>, usize)>);

impl OrientedTools {
    /// The tool in an orientation.
    ///
    /// # Errors
    /// As [`RotatedTool::new`].
    pub(super) fn of(
        &self,
        tool: &Tool,
        orientation: &Orientation,
        pitch: f64,
    ) -> Result<Arc<RotatedTool>, ToolError> {
        let key = [orientation.theta, orientation.phi, orientation.roll].map(f64::to_bits);
        if let Some(saved) = self.0.read().unwrap_or_else(PoisonError::into_inner).0.get(&key) {
            return Ok(saved.clone());
        }
        let rotated = Arc::new(RotatedTool::new(tool, orientation, pitch)?);
        let (tools, taken) = &mut *self.0.write().unwrap_or_else(PoisonError::into_inner);
        let bytes = rotated.solid.len();
        if *taken + bytes <= MOST_BYTES && tools.insert(key, rotated.clone()).is_none() {
            *taken += bytes;
        }
        Ok(rotated)
    }
}
