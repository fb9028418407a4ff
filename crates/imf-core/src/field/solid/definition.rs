//! Tools that are counted by the definition: meshes, and outlines that the fast paths cannot solve. Of a mesh the voxels are saved by
//! orientation: with the tip on a voxel centre these are all that is needed, wherever it is, and many poses share few orientations.

use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock, PoisonError, RwLock};

use super::closed_mesh::ClosedMesh;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::pose::Pose;
use crate::tool::{Tool, ToolError, ToolShape, ToolVoxels, snapped};

/// Maximum memory; beyond it they are computed each time.
const MAX_BYTES: usize = 128 << 20;
/// Voxels from the grid beyond which a tip is not counted by whole voxels.
const FARTHEST: f64 = 1e12;
/// Voxels of a mesh tool's box for each of the obstacle's, from which on it counts as larger than that.
const MANY_TIMES: f64 = 8.0;

/// A tool, and its voxels by the orientation's bits.
pub(super) struct Definition {
    tool: Tool,
    /// Volume of a mesh's box.
    box_volume: f64,
    voxels: RwLock<HashMap<[u64; 3], Arc<ToolVoxels>>>,
    bytes: AtomicUsize,
    /// Made at the first decision off the grid.
    closed: OnceLock<Option<ClosedMesh>>,
}

impl Definition {
    pub(super) fn new(tool: &Tool) -> Self {
        let bounds = tool.mesh().and_then(Mesh::bounds);
        Self {
            tool: tool.clone(),
            box_volume: bounds.map_or(0.0, |(lower, upper)| (upper - lower).element_product()),
            voxels: RwLock::default(),
            bytes: AtomicUsize::default(),
            closed: OnceLock::new(),
        }
    }

    /// Solid voxels whose centres lie in the tool.
    pub(super) fn count(&self, obstacle: &Occupancy, pose: &Pose) -> u32 {
        if let ToolShape::Revolved(elements) = &self.tool.shape {
            // Along the pose's own axis: angles would turn it by a last bit.
            let mut count = 0;
            elements.iter().for_each(|element| element.visit_inside(obstacle, pose, |_, _, _| count += 1));
            return count;
        }
        let count = self.count_on_grid(obstacle, pose);
        count.unwrap_or_else(|| self.tool.count_inside(obstacle, pose.position, &pose.orientation()))
    }

    /// Whether that is not 0.
    pub(super) fn collides(&self, obstacle: &Occupancy, pose: &Pose) -> bool {
        let Some(mesh) = self.closed(obstacle.grid.pitch) else { return self.count(obstacle, pose) > 0 };
        let count = self.count_on_grid(obstacle, pose);
        count.map_or_else(|| mesh.holds_any(obstacle, pose), |count| count > 0)
    }

    /// Of a closed mesh.
    pub(super) fn closed(&self, pitch: f64) -> Option<&ClosedMesh> {
        let closed = || self.tool.mesh().and_then(|mesh| ClosedMesh::new(mesh, pitch));
        self.closed.get_or_init(closed).as_ref()
    }

    /// Of a mesh with its tip on a voxel centre; `None` elsewhere.
    fn count_on_grid(&self, obstacle: &Occupancy, pose: &Pose) -> Option<u32> {
        let grid = &obstacle.grid;
        let tip = snapped(grid, pose.position);
        // A tool larger than the obstacle is turned where it meets it alone.
        let is_larger = self.box_volume > MANY_TIMES * grid.len() as f64 * grid.pitch.powi(3);
        if tip != tip.round() || tip.abs().max_element() >= FARTHEST || is_larger {
            return None;
        }
        let rotated = self.of(&pose.orientation(), grid.pitch).ok()?;
        Some(rotated.count_in(obstacle, tip.to_array().map(|v| v as i64)))
    }

    /// Its voxels in an orientation.
    pub(super) fn of(&self, orientation: &Orientation, pitch: f64) -> Result<Arc<ToolVoxels>, ToolError> {
        let key = [orientation.theta, orientation.phi, orientation.roll].map(f64::to_bits);
        if let Some(saved) = self.voxels.read().unwrap_or_else(PoisonError::into_inner).get(&key) {
            return Ok(saved.clone());
        }
        let rotated = Arc::new(ToolVoxels::new(&self.tool, orientation, pitch)?);
        let mut voxels = self.voxels.write().unwrap_or_else(PoisonError::into_inner);
        let bytes = self.bytes.load(Ordering::Relaxed) + rotated.solid.len();
        if bytes <= MAX_BYTES && voxels.insert(key, rotated.clone()).is_none() {
            self.bytes.store(bytes, Ordering::Relaxed);
        }
        Ok(rotated)
    }
}
