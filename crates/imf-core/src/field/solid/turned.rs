//! Tools that are counted by the definition, turned and made of voxels: with the tip on a voxel centre these are all that is
//! needed, wherever it is. They are kept, as many poses share few orientations.

use std::collections::HashMap;
use std::sync::{Arc, PoisonError, RwLock};

use crate::orientation::Orientation;
use crate::tool::{RotatedTool, Tool, ToolError};

/// Memory that they may take; beyond it they are made anew each time.
const MOST_BYTES: usize = 128 << 20;

/// A tool's voxels by the orientation's bits.
#[derive(Default)]
pub(super) struct TurnedTools {
    kept: RwLock<Kept>,
}

#[derive(Default)]
struct Kept {
    tools: HashMap<[u64; 3], Arc<RotatedTool>>,
    bytes: usize,
}

impl TurnedTools {
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
        let kept = self.kept.read().unwrap_or_else(PoisonError::into_inner).tools.get(&key).cloned();
        if let Some(kept) = kept {
            return Ok(kept);
        }
        let made = Arc::new(RotatedTool::new(tool, orientation, pitch)?);
        let bytes = made.solid.len();
        let Kept { tools, bytes: taken } = &mut *self.kept.write().unwrap_or_else(PoisonError::into_inner);
        if *taken + bytes <= MOST_BYTES && tools.insert(key, made.clone()).is_none() {
            *taken += bytes;
        }
        Ok(made)
    }
}
