//! The scene: which part in which set-up, on which grid, against which tool. Datasets and models carry it, so that
//! one file is enough to know what a field means.

use glam::DMat4;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::grid::{Grid, GridError};
use crate::mesh::Mesh;
use crate::mesh::topology::MeshReport;
use crate::occupancy::Occupancy;
use crate::tool::Tool;
use crate::unit::LengthUnit;
use crate::voxelize::voxelize;

/// How the grid around the part is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Resolution {
    /// Edge of a voxel in the part's unit.
    Pitch(f64),
    /// Exactly this many voxels along x, y, z, at the smallest pitch at which the part fits.
    Dims([usize; 3]),
}

/// What is known of a scene without its voxels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneRecord {
    /// Name of the part: a file's name or a reference part.
    pub part: String,
    /// Unit of every length.
    pub unit: LengthUnit,
    /// Set-up: where the part's own coordinates stand in the world, column-major.
    pub transform: DMat4,
    /// The grid of the obstacle, which is also the query grid.
    pub grid: Grid,
    /// Empty voxels kept on each side of the part.
    pub margin: usize,
    /// True where every voxel that the surface touches is solid.
    pub conservative: bool,
    /// True if the part's mesh is closed.
    pub closed: bool,
    /// The tool, in `unit`.
    pub tool: Tool,
    /// CRC-32 of the obstacle's packed voxels.
    pub obstacle_crc32: u32,
}

/// A part on its grid, and the tool that is to reach it.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// What is written down.
    pub record: SceneRecord,
    /// The solid voxels.
    pub obstacle: Occupancy,
}

/// Why a scene cannot be made.
#[derive(Debug, Error)]
pub enum SceneError {
    /// The part has no triangle.
    #[error("the part '{0}' has no triangle")]
    NoTriangles(String),
    /// The grid cannot be made.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// Nothing of the part is left at this resolution.
    #[error(
        "the part '{part}' holds no voxel centre at pitch {pitch}: it is too thin for this grid; choose a smaller \
         pitch or --conservative"
    )]
    NoSolid {
        /// The part.
        part: String,
        /// The grid's pitch.
        pitch: f64,
    },
}

/// Everything that a scene is made from.
#[derive(Clone, Debug)]
pub struct SceneSpec<'a> {
    /// Name of the part.
    pub part: &'a str,
    /// The part in its own coordinates.
    pub mesh: &'a Mesh,
    /// Unit of the mesh.
    pub unit: LengthUnit,
    /// Set-up of the part.
    pub transform: DMat4,
    /// Grid.
    pub resolution: Resolution,
    /// Empty voxels on each side of the part.
    pub margin: usize,
    /// Also make every voxel solid that the surface touches.
    pub conservative: bool,
    /// The tool, in any unit.
    pub tool: &'a Tool,
}

impl SceneSpec<'_> {
    /// The grid that the scene will have.
    ///
    /// # Errors
    /// A mesh without triangles, or a grid that cannot be made.
    pub fn grid(&self) -> Result<Grid, SceneError> {
        let bounds = self.mesh.transformed(&self.transform).bounds();
        let (lower, upper) = bounds.ok_or_else(|| SceneError::NoTriangles(self.part.to_owned()))?;
        Ok(match self.resolution {
            Resolution::Pitch(pitch) => Grid::with_pitch(lower, upper, pitch, self.margin)?,
            Resolution::Dims(dims) => Grid::with_dims(lower, upper, dims, self.margin)?,
        })
    }

    /// Voxelises the part.
    ///
    /// # Errors
    /// As [`SceneSpec::grid`], or a part of which no voxel is left.
    pub fn scene(&self) -> Result<Scene, SceneError> {
        let grid = self.grid()?;
        let obstacle = voxelize(&self.mesh.transformed(&self.transform), &grid, self.conservative);
        if obstacle.count() == 0 {
            return Err(SceneError::NoSolid { part: self.part.to_owned(), pitch: grid.pitch });
        }
        let record = SceneRecord {
            part: self.part.to_owned(),
            unit: self.unit,
            transform: self.transform,
            grid,
            margin: self.margin,
            conservative: self.conservative,
            closed: MeshReport::new(self.mesh).closed,
            tool: self.tool.in_unit(self.unit),
            obstacle_crc32: crc32fast::hash(&obstacle.packed()),
        };
        Ok(Scene { record, obstacle })
    }
}
