//! What stands around a tool: several obstacles, each with its own voxels and its own place, and checkers that decide by them.
//!
//! An obstacle is voxelised once, in its own frame. It may be moved, turned and removed afterwards: its voxels move with it, and a
//! query is posed in its frame, so that nothing is voxelised anew. Voxels of it may become solid or empty ([`World::change`]). A [`Checker`] is one tool in a world, with a clearance: whether a pose
//! is free, what it hits, how far away it is, and whether a whole motion is free. It counts voxel centres; no fitted model is needed.
//! Several tools are several checkers, which share the voxels.
//!
//! A checker is a snapshot: what is moved, added or removed afterwards is seen by [`Checker::follow`], which takes over all that has
//! been made for obstacles that are still there.
//!
//! # Example
//! ```
//! use imf_core::glam::DVec3;
//! use imf_core::mesh::Mesh;
//! use imf_core::pose::Pose;
//! use imf_core::tool::{Clearance, Tool};
//! use imf_core::world::{MotionOptions, ObstacleMesh, World};
//!
//! let block = Mesh::cuboid(DVec3::ZERO, DVec3::new(60.0, 40.0, 20.0));
//! let mut world = World::builder().pitch(2.0).obstacle(ObstacleMesh::new("block", block)).build()?;
//! let clamp = Mesh::cuboid(DVec3::ZERO, DVec3::new(10.0, 10.0, 30.0));
//! let clamp = world.add(ObstacleMesh { at: Pose::along(DVec3::new(70.0, 15.0, 0.0), DVec3::Z), ..ObstacleMesh::new("clamp", clamp) })?;
//!
//! let mut checker = world.checker(&Tool::paper(), &Clearance::around_holder_and_shank(1.0))?;
//! let above = Pose::along(DVec3::new(30.0, 20.0, 22.0), DVec3::Z);
//! assert!(checker.is_free(&above));
//! let aside = Pose::along(DVec3::new(110.0, 20.0, 22.0), DVec3::Z);
//! let motion = checker.check_motion(&above, &aside, &MotionOptions::default())?;
//! assert_eq!(motion.first_colliding.map(|hit| hit.contact.obstacle), Some(clamp));
//!
//! world.place(clamp, Pose::along(DVec3::new(70.0, 150.0, 0.0), DVec3::Z))?;
//! checker.follow(&world)?;
//! assert!(checker.check_motion(&above, &aside, &MotionOptions::default())?.is_free());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod advance;
mod change;
mod checker;
mod guarantee;
mod obstacle_mesh;
mod separation;

pub use advance::{MotionCollision, MotionOptions, MotionResult};
pub use checker::{Checker, Contact, QueryError};
pub use obstacle_mesh::ObstacleMesh;
pub use separation::Distance;

use std::sync::Arc;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::field::PreparedObstacle;
use crate::grid::GridError;
use crate::obstacle::Obstacle;
use crate::pose::Pose;
use crate::scene::{CoarseTool, SceneError, SceneWarning};
use crate::tool::{Clearance, ClearanceError, Tool, ToolError};
use crate::unit::LengthUnit;

/// Which obstacle of a world; never given twice by one world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ObstacleId(pub u64);

/// Why a world or a checker cannot be made or changed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WorldError {
    /// A mesh that is not a solid at this pitch.
    #[error(transparent)]
    Mesh(#[from] SceneError),
    /// A grid without voxels, with too many, or of an invalid pitch.
    #[error("the obstacle '{name}' cannot be made of voxels: {source}")]
    Grid {
        /// The obstacle.
        name: String,
        /// Why not.
        source: GridError,
    },
    /// A mesh without a triangle.
    #[error("the obstacle '{0}' has no triangle")]
    NoTriangles(String),
    /// No pitch, neither of the obstacle nor of the world.
    #[error("the obstacle '{0}' has no pitch: give the world one, or the obstacle its own")]
    NoPitch(String),
    /// A factor that scales nothing.
    #[error("the obstacle '{name}' cannot be scaled by {scale}: give a positive finite number")]
    Scale {
        /// The obstacle.
        name: String,
        /// The factor.
        scale: f64,
    },
    /// A depth that is not a length.
    #[error(
        "the cutter cannot reach {depth} deep into the obstacle '{name}': give a finite length of at least 0"
    )]
    Depth {
        /// The obstacle.
        name: String,
        /// The depth.
        depth: f64,
    },
    /// Between the voxels' centres.
    #[error(
        "the obstacle '{name}' holds no voxel centre at pitch {pitch}, and would be overlooked: choose a smaller pitch, or let every \
         voxel that the surface touches be solid"
    )]
    NoSolid {
        /// The obstacle.
        name: String,
        /// Edge of a voxel.
        pitch: f64,
    },
    /// Invalid voxels.
    #[error(
        "the obstacle '{0}' has not a byte of 0 or 1 for each voxel of its grid, or a layer for the cutter on another grid"
    )]
    Voxels(String),
    /// A place with a number that is not finite, or a rotation of no length.
    #[error(
        "the obstacle '{0}' cannot stand there: a number of its place is not finite, or its rotation has no length"
    )]
    Place(String),
    /// A voxel that cannot become what it should.
    #[error("voxel {voxel} of the obstacle '{obstacle}' cannot be changed: {why}")]
    Voxel {
        /// The obstacle.
        obstacle: String,
        /// Its index.
        voxel: usize,
        /// Why not.
        why: &'static str,
    },
    /// An obstacle that was removed, or that this world never had; ids are the world's own, and another world may have the same.
    #[error("the world has no obstacle {}", .0.0)]
    Unknown(ObstacleId),
    /// A tool that would pass between the voxels' centres undetected.
    #[error("at the obstacle '{obstacle}' {tool}")]
    Coarse {
        /// What of it is not detected.
        tool: CoarseTool,
        /// The obstacle.
        obstacle: String,
    },
    /// A tool without volume, or too long.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// A clearance that is not a length, or around a tool that cannot be offset.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// A checker that was made in another unit.
    #[error("the checker is of a world in {checker}, this one is in {world}: make a checker of this one")]
    Unit {
        /// That of the checker.
        checker: LengthUnit,
        /// That of the world.
        world: LengthUnit,
    },
}

/// An obstacle, and where it stands.
#[derive(Clone)]
struct PlacedObstacle {
    id: ObstacleId,
    name: Arc<str>,
    /// From its own frame into the world; of length 1.
    at: Pose,
    prepared: PreparedObstacle,
    /// True where every voxel is solid that a mesh touches.
    conservative: bool,
    /// Middle and radius of a ball around its solid centres, in its own frame; `None` where nothing is solid.
    ball: Option<(DVec3, f64)>,
}

/// Obstacles with their places. Lengths are in its unit. Cloning it copies no voxel.
#[derive(Clone, Default)]
pub struct World {
    unit: LengthUnit,
    pitch: Option<f64>,
    conservative: bool,
    allow_coarse: bool,
    obstacles: Vec<PlacedObstacle>,
    warnings: Vec<SceneWarning>,
    next: u64,
}

/// Makes a [`World`]; by default in millimetres.
#[must_use]
#[derive(Default)]
pub struct WorldBuilder {
    world: World,
    meshes: Vec<ObstacleMesh>,
}

impl WorldBuilder {
    /// Unit of every length.
    pub fn unit(mut self, unit: LengthUnit) -> Self {
        self.world.unit = unit;
        self
    }

    /// Edge of a voxel of obstacles that have no pitch of their own.
    pub fn pitch(mut self, pitch: f64) -> Self {
        self.world.pitch = Some(pitch);
        self
    }

    /// Whether every voxel that an obstacle's surface touches is solid, or those alone whose centre is inside; an obstacle may say so
    /// for itself.
    pub fn conservative(mut self, conservative: bool) -> Self {
        self.world.conservative = conservative;
        self
    }

    /// Whether tools are accepted that pass between the voxels' centres. Collisions of such a tool are missed.
    pub fn allow_coarse(mut self, allow_coarse: bool) -> Self {
        self.world.allow_coarse = allow_coarse;
        self
    }

    /// An obstacle; may be called again.
    pub fn obstacle(mut self, obstacle: ObstacleMesh) -> Self {
        self.meshes.push(obstacle);
        self
    }

    /// Voxelises the obstacles, in their own frames.
    ///
    /// # Errors
    /// A pitch that is none; as [`World::add`] of the first obstacle that is refused.
    pub fn build(self) -> Result<World, WorldError> {
        let mut world = self.world;
        if let Some(pitch) = world.pitch.filter(|pitch| !(pitch.is_finite() && *pitch > 0.0)) {
            return Err(SceneError::from(GridError::Pitch(pitch)).into());
        }
        for mesh in self.meshes {
            world.add(mesh)?;
        }
        Ok(world)
    }
}

impl World {
    /// A world of meshes.
    pub fn builder() -> WorldBuilder {
        WorldBuilder::default()
    }

    /// Unit of every length.
    #[must_use]
    pub fn unit(&self) -> LengthUnit {
        self.unit
    }

    /// Warnings about the meshes that were added.
    #[must_use]
    pub fn warnings(&self) -> &[SceneWarning] {
        &self.warnings
    }

    /// Every obstacle with its name and its place.
    pub fn obstacles(&self) -> impl Iterator<Item = (ObstacleId, &str, Pose)> {
        self.obstacles.iter().map(|standing| (standing.id, &*standing.name, standing.at))
    }

    /// Makes an obstacle's triangles face consistently, and voxelises it in its own frame.
    ///
    /// # Errors
    /// A mesh without triangles, of an implausible size, that does not say what is inside, or between the voxels' centres; no
    /// pitch, or one that is not a length; a factor, a depth or a place that means nothing.
    pub fn add(&mut self, mesh: ObstacleMesh) -> Result<ObstacleId, WorldError> {
        let (name, at) = (mesh.name.clone(), placed(&mesh.name, mesh.at)?);
        let pitch = mesh.pitch.or(self.pitch).ok_or_else(|| WorldError::NoPitch(name.clone()))?;
        let conservative = mesh.conservative.unwrap_or(self.conservative);
        let (obstacle, warnings) = mesh.voxels(self.unit, pitch, conservative)?;
        self.warnings.extend(warnings);
        Ok(self.stand(&name, obstacle.into(), at, conservative))
    }

    /// Adds an obstacle of voxels, whose grid is in its own frame.
    ///
    /// # Errors
    /// A place that means nothing; a grid without voxels or of an invalid pitch; bytes that are not the voxels of one grid.
    pub fn add_voxels(
        &mut self,
        name: &str,
        obstacle: impl Into<Obstacle>,
        at: Pose,
    ) -> Result<ObstacleId, WorldError> {
        let (at, obstacle) = (placed(name, at)?, obstacle.into());
        obstacle.grid().check().map_err(|source| WorldError::Grid { name: name.to_owned(), source })?;
        if !obstacle.is_sound() {
            return Err(WorldError::Voxels(name.to_owned()));
        }
        Ok(self.stand(name, obstacle.into(), at, false))
    }

    /// Moves an obstacle: `at` is from its own frame into the world.
    ///
    /// # Errors
    /// An obstacle that is not there, or a place that means nothing.
    pub fn place(&mut self, id: ObstacleId, at: Pose) -> Result<(), WorldError> {
        let standing = self.standing_mut(id)?;
        standing.at = placed(&standing.name, at)?;
        Ok(())
    }

    /// Removes an obstacle.
    ///
    /// # Errors
    /// An obstacle that is not there.
    pub fn remove(&mut self, id: ObstacleId) -> Result<(), WorldError> {
        let place = self.obstacles.iter().position(|standing| standing.id == id);
        self.obstacles.remove(place.ok_or(WorldError::Unknown(id))?);
        Ok(())
    }

    /// A tool in this world, offset by a clearance in the world's unit.
    ///
    /// # Errors
    /// A tool without volume, or one that passes between the centres of an obstacle's voxels; a clearance that is not
    /// a length, or one around a mesh tool.
    pub fn checker(&self, tool: &Tool, clearance: &Clearance) -> Result<Checker, WorldError> {
        tool.check()?;
        Checker::new(self, tool.in_unit(self.unit).offset(clearance)?)
    }

    fn standing_mut(&mut self, id: ObstacleId) -> Result<&mut PlacedObstacle, WorldError> {
        self.obstacles.iter_mut().find(|standing| standing.id == id).ok_or(WorldError::Unknown(id))
    }

    fn stand(&mut self, name: &str, prepared: PreparedObstacle, at: Pose, conservative: bool) -> ObstacleId {
        let id = ObstacleId(self.next);
        self.next += 1;
        let obstacle = prepared.obstacle();
        let grid = *obstacle.grid();
        let extents = [Some(&obstacle.forbidden), obstacle.cuttable.as_ref()].into_iter().flatten();
        let extents = extents.filter_map(|solid| solid.extent());
        let both = extents.reduce(|(low, high), (lower, upper)| {
            ([0, 1, 2].map(|a| low[a].min(lower[a])), [0, 1, 2].map(|a| high[a].max(upper[a])))
        });
        let ball = both.map(|(low, high)| {
            let (low, high) = (grid.centre(low), grid.centre(high));
            (0.5 * (low + high), 0.5 * (high - low).length())
        });
        self.obstacles.push(PlacedObstacle { id, name: name.into(), at, prepared, conservative, ball });
        id
    }
}

/// Where an obstacle's own frame is the world's.
const HERE: Pose = Pose::new(DVec3::ZERO, DQuat::IDENTITY);

/// A place with a rotation of length 1.
fn placed(name: &str, at: Pose) -> Result<Pose, WorldError> {
    let valid = at.is_valid().then(|| Pose { rotation: at.rotation.normalize(), ..at });
    valid.ok_or_else(|| WorldError::Place(name.to_owned()))
}

#[cfg(test)]
mod advance_tests;
#[cfg(test)]
mod adversary_cases;
#[cfg(test)]
mod adversary_tests;
#[cfg(test)]
mod adversary_truth;
#[cfg(test)]
mod hostile_tests;
#[cfg(test)]
mod separation_tests;
#[cfg(test)]
mod tests;
