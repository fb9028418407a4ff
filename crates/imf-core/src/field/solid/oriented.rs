//! Voxels of tools that are counted by the definition, by orientation: with the tip on a voxel centre these are all that is
//! needed, wherever it is, and many poses share few orientations.

use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use crate::orientation::Orientation;
use crate::tool::{Tool, ToolError, ToolVoxels};

/// Maximum memory; beyond it they are computed each time.
const MAX_BYTES: usize = 128 << 20;

/// A tool's voxels by the orientation's bits.
#[derive(Default)]
pub(super) struct OrientedTools {
    tools: RwLock<HashMap<[u64; 3], Arc<ToolVoxels>>>,
    bytes: AtomicUsize,
}

impl OrientedTools {
    pub(super) fn of(
        &self,
        tool: &Tool,
        orientation: &Orientation,
        pitch: f64,
    ) -> Result<Arc<ToolVoxels>, ToolError> {
        let key = [orientation.theta, orientation.phi, orientation.roll].map(f64::to_bits);
        if let Some(saved) = self.tools.read().unwrap_or_else(PoisonError::into_inner).get(&key) {
            return Ok(saved.clone());
        }
        let rotated = Arc::new(ToolVoxels::new(tool, orientation, pitch)?);
        let mut tools = self.tools.write().unwrap_or_else(PoisonError::into_inner);
        let bytes = self.bytes.load(Ordering::Relaxed) + rotated.solid.len();
        if bytes <= MAX_BYTES && tools.insert(key, rotated.clone()).is_none() {
            self.bytes.store(bytes, Ordering::Relaxed);
        }
        Ok(rotated)
    }
}
