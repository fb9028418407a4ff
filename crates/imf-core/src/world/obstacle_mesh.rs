//! A mesh that becomes an obstacle.

use glam::{DMat4, DVec3};

use super::{HERE, WorldError};
use crate::control::Control;
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::obstacle::Obstacle;
use crate::pose::Pose;
use crate::scene::{Bodies, SceneError, SceneWarning, solid_voxels};
use crate::unit::{LengthUnit, unit_check};
use crate::voxelize::VoxelizeResult;

/// A mesh that becomes an obstacle of a [`World`](super::World), and how.
#[derive(Clone, Debug)]
pub struct ObstacleMesh {
    /// Its name.
    pub name: String,
    /// Its triangles, in its own frame.
    pub mesh: Mesh,
    /// From the mesh's lengths to the world's, about the mesh's own origin.
    pub scale: f64,
    /// From its own frame into the world. It may be moved later; its voxels move with it.
    pub at: Pose,
    /// Edge of a voxel, in the world's unit; `None` for the world's own.
    pub pitch: Option<f64>,
    /// Whether every voxel that the surface touches is solid; `None` for what the world says.
    pub conservative: Option<bool>,
    /// How deep below its surface the cutter may reach, in the world's unit: it may hold voxels whose centres lie no deeper, but for
    /// those in the middle of a wall of even thickness, and so goes up to a pitch deeper. 0 for what is not to be cut.
    pub contact: f64,
}

impl ObstacleMesh {
    /// A mesh in the world's unit and frame that nothing may touch.
    #[must_use]
    pub fn new(name: impl Into<String>, mesh: Mesh) -> Self {
        Self { name: name.into(), mesh, scale: 1.0, at: HERE, pitch: None, conservative: None, contact: 0.0 }
    }

    /// Its voxels, in its own frame, and warnings about them; `conservative` as it is decided between its own and the world's.
    pub(super) fn voxels(
        self,
        unit: LengthUnit,
        pitch: f64,
        conservative: bool,
    ) -> Result<(Obstacle, Vec<SceneWarning>), WorldError> {
        let Self { name, mesh, scale, contact, .. } = self;
        if !(scale.is_finite() && scale > 0.0) {
            return Err(WorldError::Scale { name, scale });
        }
        if !(contact.is_finite() && contact >= 0.0) {
            return Err(WorldError::Depth { name, depth: contact });
        }
        if !mesh.is_sound() {
            return Err(SceneError::Unsound(name).into());
        }
        let (mesh, repair) =
            mesh.transformed(&DMat4::from_scale(DVec3::splat(scale))).with_consistent_faces();
        let (lower, upper) = mesh.bounds().ok_or_else(|| WorldError::NoTriangles(name.clone()))?;
        if let Some(size) = unit_check(upper - lower, unit) {
            return Err(SceneError::Size { part: name, size }.into());
        }
        // A surface on a voxel's face touches both sides.
        let grid = Grid::with_pitch(lower, upper, pitch, usize::from(conservative))
            .map_err(|source| WorldError::Grid { name: name.clone(), source })?;
        let VoxelizeResult { solid, undecided } =
            solid_voxels(&name, &mesh, &grid, conservative, Control::quiet())?;
        if solid.count() == 0 {
            return Err(WorldError::NoSolid { name, pitch });
        }
        let mut warnings = SceneWarning::of_repair(&name, &repair, mesh.triangles.len());
        warnings.extend(SceneWarning::of_body(&name, &mesh, &solid, undecided));
        warnings.extend(SceneWarning::of_lost_surface(&name, &mesh, &solid, &grid, unit));
        let body =
            Bodies { part: solid.cropped(), fixtures: Vec::new(), undecided, fixtures_undecided: Vec::new() };
        let obstacle = match contact {
            0.0 => body.part.into(),
            depth => Obstacle::with_cuttable(&body.part, body.layer(depth)),
        };
        Ok((obstacle, warnings))
    }
}
