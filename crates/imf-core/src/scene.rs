//! The scene: which part in which set-up, among which fixtures, on which grid, against which tool. Datasets and models
//! carry it, so that one file is enough to know what a field means.
//!
//! The obstacle is the union of part and fixtures. Where the grid is chosen around the part alone, fixtures may stick
//! out of it and still be hit. Most scenes are made by [`Scene::builder`].

mod builder;
mod differences;
mod guarantee;
mod lost_surface;
mod pitch;
mod resolution;
mod saved;
mod spec;
mod transform;
mod warning;

pub use builder::{BuiltScene, SceneBuilder};
pub use guarantee::{Guarantee, PathGuarantee};
pub(crate) use lost_surface::LostSurface;
pub use pitch::{ChosenPitch, PitchReason};
pub use resolution::CoarseTool;
use resolution::MAX_UNDECIDED;
pub(crate) use resolution::decided;
// For the stock, which is not a body of a scene.
#[doc(hidden)]
pub use resolution::solid_voxels;
pub use transform::TransformFault;
pub use warning::SceneWarning;
// What the builder is made of, for the command, which checks memory between the steps.
#[doc(hidden)]
pub use spec::SceneSpec;
// For the files of fields and datasets.
#[doc(hidden)]
pub use saved::SavedVoxelsError;

use glam::DMat4;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::control::{Cancelled, Control};
use crate::distance::deeper_than;
use crate::file_error::FileError;
use crate::grid::{Grid, GridError};
use crate::mesh::Mesh;
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::tool::{Assembly, Clearance, ClearanceError, Tool, ToolError};
use crate::unit::{ImplausibleSize, LengthUnit};
use crate::voxelize::voxelize_with;

/// How the grid around the part is chosen.
#[doc(hidden)]
#[derive(Clone, Copy, Debug)]
pub enum Resolution {
    /// Edge of a voxel in the part's unit.
    Pitch(f64),
    /// Exactly this many voxels along x, y, z, at the smallest pitch at which the part fits.
    Dims([usize; 3]),
}

/// What the grid is chosen around.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GridExtent {
    /// The part; fixtures may stick out.
    #[default]
    Part,
    /// Part and fixtures.
    All,
}

/// What holds the part: a mesh that the tool must not touch either.
#[doc(hidden)]
#[derive(Clone, Debug)]
pub struct Fixture<'a> {
    /// Name of the fixture.
    pub name: &'a str,
    /// The fixture in its own coordinates and the part's unit.
    pub mesh: &'a Mesh,
    /// Where it stands in the world.
    pub transform: DMat4,
}

/// Metadata of a scene: all but its voxels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneRecord {
    /// Name of the part: a file's name or a reference part.
    pub part: String,
    /// Unit of every length.
    pub unit: LengthUnit,
    /// Set-up: where the part's own coordinates stand in the world, column-major.
    pub transform: DMat4,
    /// The grid of the obstacle, which is also the query grid.
    pub grid: Grid,
    /// Empty voxels on each side of the part.
    pub margin: usize,
    /// True where every voxel that the surface touches is solid.
    pub conservative: bool,
    /// True if the part's mesh is closed.
    pub closed: bool,
    /// The tool whose field this is, in `unit`: offset by the clearance where there is any.
    pub tool: Tool,
    /// By how much its elements are offset, in `unit`.
    #[serde(default, skip_serializing_if = "Clearance::is_zero")]
    pub clearance: Clearance,
    /// The tool without clearance, where it was offset; see [`SceneRecord::bare_tool`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bare_tool: Option<Tool>,
    /// Names of the fixtures, whose voxels are part of the obstacle.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fixtures: Vec<String>,
    /// How deep below the part's surface the cutter may reach, in `unit`; see [`SceneBuilder::contact`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<f64>,
    /// CRC-32 of the obstacle's packed voxels.
    pub obstacle_crc32: u32,
}

/// A part on its grid, and the tool that is to reach it.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Its metadata.
    pub record: SceneRecord,
    /// The solid voxels of part and fixtures.
    pub obstacle: Occupancy,
    /// The layer of the part that only the cutter may enter, where there is contact; also part of `obstacle`.
    pub layer: Option<Occupancy>,
}

impl Scene {
    /// The scene with a cutter that may reach `depth` (in the scene's unit) below the part's surface: `bodies` are its
    /// part and fixtures, on its grid or a wider one of the same voxels.
    #[doc(hidden)]
    #[must_use]
    pub fn with_contact(mut self, bodies: &Bodies, depth: f64) -> Self {
        self.record.contact = Some(depth);
        self.layer = bodies.layer(depth).on(&self.record.grid);
        self
    }

    /// The scene with its tool offset by a clearance in the scene's unit, instead of any that it had.
    ///
    /// # Errors
    /// A clearance that is not a length, or a mesh tool, which cannot be offset.
    pub fn with_clearance(mut self, clearance: &Clearance) -> Result<Self, ClearanceError> {
        clearance.check()?;
        let bare = self.record.bare_tool().clone();
        self.record.tool = bare.with_clearance(clearance)?;
        self.record.clearance = *clearance;
        self.record.bare_tool = (!clearance.is_zero()).then_some(bare);
        Ok(self)
    }
}

impl From<&Scene> for Obstacle {
    fn from(scene: &Scene) -> Self {
        match &scene.layer {
            Some(layer) => Self::with_cuttable(&scene.obstacle, layer.clone()),
            None => (&scene.obstacle).into(),
        }
    }
}

impl SceneRecord {
    /// The tool as it is counted: offset by the clearance.
    ///
    /// # Errors
    /// A clearance that is not a length.
    pub fn assembly(&self) -> Result<Assembly, ClearanceError> {
        self.bare_tool().offset(&self.clearance)
    }

    /// The tool without any clearance.
    #[must_use]
    pub fn bare_tool(&self) -> &Tool {
        self.bare_tool.as_ref().unwrap_or(&self.tool)
    }
}

/// Part and fixtures apart, on the voxels of one grid that holds all of them that matters.
#[doc(hidden)]
#[derive(Clone, Debug, PartialEq)]
pub struct Bodies {
    /// Solid voxels of the part, on the whole grid.
    pub part: Occupancy,
    /// By name, none twice, the solid voxels of every fixture, in the order given, each on no more of the grid than it takes.
    pub fixtures: Vec<(String, Occupancy)>,
    /// Fraction of the centres in or near the part that its mesh leaves undecided (inside or outside).
    pub undecided: f64,
    /// The same of each fixture.
    pub fixtures_undecided: Vec<f64>,
}

impl Bodies {
    /// The union.
    #[must_use]
    pub fn obstacle(&self) -> Occupancy {
        self.with_fixtures(self.part.clone())
    }

    /// All fixtures on the part's grid.
    #[must_use]
    pub fn all_fixtures(&self) -> Occupancy {
        self.with_fixtures(Occupancy::empty(self.part.grid))
    }

    /// The same bodies by the rule of voxel centres, of the meshes where they are placed, the part's first: what stock is compared with,
    /// since a voxel that the part only touches may hold some.
    ///
    /// # Errors
    /// [`SceneError::Cancelled`].
    pub fn by_centres<'m>(
        &self,
        placed: impl IntoIterator<Item = &'m Mesh>,
        control: Control<'_>,
    ) -> Result<Self, SceneError> {
        let of =
            |mesh: &Mesh, grid: &Grid| Ok::<_, SceneError>(voxelize_with(mesh, grid, false, control)?.solid);
        let mut meshes = placed.into_iter();
        let part = meshes.next().map_or_else(|| Ok(self.part.clone()), |mesh| of(mesh, &self.part.grid))?;
        let fixtures = meshes.zip(&self.fixtures);
        let fixtures = fixtures.map(|(mesh, (name, own))| Ok((name.clone(), of(mesh, &own.grid)?)));
        let (undecided, fixtures_undecided) = (self.undecided, self.fixtures_undecided.clone());
        Ok(Self {
            part,
            fixtures: fixtures.collect::<Result<_, SceneError>>()?,
            undecided,
            fixtures_undecided,
        })
    }

    fn with_fixtures(&self, mut solid: Occupancy) -> Occupancy {
        self.fixtures.iter().for_each(|(_, fixture)| solid.add(fixture));
        solid
    }

    /// The part's voxels down to `depth` (in the grid's unit) below its surface, but for those in the middle of a wall of even thickness;
    /// where part and fixture share a voxel it stays forbidden.
    #[must_use]
    pub fn layer(&self, depth: f64) -> Occupancy {
        let mut layer = self.part.clone();
        let (deep, held) = (deeper_than(&self.part, depth), self.all_fixtures());
        for ((own, deep), held) in layer.solid.iter_mut().zip(&deep.solid).zip(&held.solid) {
            *own &= (1 - deep) & (1 - held);
        }
        layer
    }
}

/// Why a scene cannot be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A builder without a part.
    #[error("there is no part: give one by its mesh, by its file, or a built-in one")]
    NoPart,
    /// The part's file.
    #[error(transparent)]
    File(#[from] FileError),
    /// A part that is far too small or too large in its unit.
    #[error("{part}: {size}")]
    Size {
        /// The part.
        part: String,
        /// Its size, and what it would be in other units.
        size: ImplausibleSize,
    },
    /// A part without a tool.
    #[error(
        "there is no tool for the part '{0}': describe the one that you have, from its tip to its holder; the paper's tool is \
         for built-in parts"
    )]
    NoTool(String),
    /// A tool without volume, or whose elements do not stand on one another.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// A tool that would pass between the voxels' centres undetected.
    #[error("{0}; or allow it, knowing that collisions are missed")]
    Coarse(CoarseTool),
    /// A mesh that does not say what is inside.
    #[error(
        "{name}: solid and empty cannot be told apart: its surface has holes, or faces in no consistent way, and at {:.0} % of the voxel \
         centres in it or near it (more than {:.0} %) its winding number lies between 0.2 and 0.8; if it is a sheet, give it its \
         thickness; else close its holes and make its normals consistent (in MeshLab or Blender), or export it again as one closed solid",
        100.0 * fraction, 100.0 * MAX_UNDECIDED
    )]
    Undecided {
        /// The part or fixture.
        name: String,
        /// Fraction of the centres in or near it.
        fraction: f64,
    },
    /// A clearance that is not a length, or around a tool that cannot be offset.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// A depth of contact that is not a length.
    #[error("the cutter cannot reach {0} deep into the part: give a finite length of at least 0")]
    Contact(f64),
    /// A tool that is to touch, and does not say with what.
    #[error(
        "contact lets a cutter touch the part, and the tool '{0}' names none: describe it by cutter, shank and holder"
    )]
    NoCutter(String),
    /// An invalid mesh.
    #[error("the mesh of '{0}' has a triangle whose vertex is not there, or a coordinate that is not finite")]
    Unsound(String),
    /// A transform that does not turn, move, and scale evenly.
    #[error("the transform of '{name}': {fault}")]
    Transform {
        /// The part or fixture.
        name: String,
        /// What else it does.
        fault: TransformFault,
    },
    /// The part has no triangle.
    #[error("the part '{0}' has no triangle")]
    NoTriangles(String),
    /// The grid cannot be made.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// A fixture without a triangle.
    #[error("the fixture '{0}' has no triangle")]
    NoFixtureTriangles(String),
    /// A fixture sticks out of a grid that has to hold the whole obstacle.
    #[error(
        "the fixture '{0}' sticks out of the grid around the part, where its voxels would be lost: choose the grid around \
         part and fixtures, or a larger margin"
    )]
    FixtureOutside(String),
    /// A fixture between the voxels' centres.
    #[error(
        "the fixture '{fixture}' holds no voxel centre at pitch {pitch}, and would be overlooked: it is too thin for this \
         grid; choose a smaller pitch, or let every voxel that the surface touches be solid"
    )]
    ThinFixture {
        /// The fixture.
        fixture: String,
        /// The grid's pitch.
        pitch: f64,
    },
    /// Nothing of the part is left at this resolution.
    #[error(
        "the part '{part}' holds no voxel centre at pitch {pitch}: it is too thin for this grid; choose a smaller \
         pitch, or let every voxel that the surface touches be solid"
    )]
    NoSolid {
        /// The part.
        part: String,
        /// The grid's pitch.
        pitch: f64,
    },
    /// The caller's [`Control`] asked to stop.
    #[error("interrupted")]
    Cancelled(#[from] Cancelled),
}

#[cfg(test)]
mod tests;
