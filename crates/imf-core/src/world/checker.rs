//! One tool among the obstacles of a world: whether it is free at a pose, and what it hits.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::DVec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{HERE, ObstacleId, PlacedObstacle, World, WorldError};
use crate::field::{BLOCK, Decision, ExactField, FieldError, check_lengths, classify_blocks};
use crate::parallel;
use crate::pose::Pose;
use crate::scene::{CoarseTool, Scene};
use crate::tool::{Assembly, Clearance, ClearanceError, ElementKind, Segment, Tool, ToolShape};
use crate::unit::LengthUnit;

/// Why a query has no result.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum QueryError {
    /// A number that is not finite, or a rotation of no length.
    #[error("the pose is invalid: a number is not finite, or the rotation has no length")]
    InvalidPose,
    /// Which way the tool turns is not said.
    #[error(
        "the tool's axes at the ends are opposite: give a pose between, so that it is clear which way the tool turns"
    )]
    Opposite,
    /// Nothing is measured or proven for mesh tools.
    #[error(
        "distances and motions are proven for tools of revolution: describe the tool by cutter, shank and holder"
    )]
    Mesh,
    /// No distances for an outline that bends inwards.
    #[error(
        "distances are not measured for a tool with an arc around a centre beyond its axis, or with an element of more than 64 pieces: \
         describe the arc by cones, or the element by fewer pieces"
    )]
    Outline,
    /// The tool cannot be offset.
    #[error("the tool cannot be offset by a small clearance")]
    Offset,
    /// A pose where double precision does not distinguish neighbouring voxels.
    #[error(
        "a pose is so far away that double precision tells no voxel from the next: give poses nearer to the obstacles"
    )]
    TooFar,
    /// A resolution that is not a length, or so fine that a motion would never end.
    #[error("motions cannot be followed in steps of {given:e}: give a finite length of at least {least:e}")]
    Resolution {
        /// The resolution.
        given: f64,
        /// The finest.
        least: f64,
    },
    /// A machine whose motion is not what its axes say.
    #[error("the machine '{name}' cannot be followed: {fault}")]
    Machine {
        /// The machine.
        name: String,
        /// What is wrong with it.
        fault: String,
    },
    /// A machine in another unit.
    #[error("the machine is in {machine}, the obstacles are in {world}: convert the machine")]
    Unit {
        /// That of the machine.
        machine: LengthUnit,
        /// That of the world.
        world: LengthUnit,
    },
}

/// Where a colliding tool meets an obstacle: of all solid voxels in it, the one deepest in its element.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// The obstacle.
    pub obstacle: ObstacleId,
    /// The tool's element; `None` of a mesh.
    pub element: Option<ElementKind>,
    /// The voxel's centre in the world; `None` of a mesh too large to be made of voxels.
    pub point: Option<DVec3>,
    /// How deep it lies below the element's own surface, of which the faces to the next elements are a part, in the world's unit; 0 for a
    /// mesh.
    pub depth: f64,
}

/// The tool, offset by its clearance.
pub(super) struct CheckedTool {
    pub(super) assembly: Assembly,
    pub(super) unit: LengthUnit,
    /// Height of the middle of a ball around the tool, on its axis, and the ball's radius.
    middle: f64,
    radius: f64,
    /// Largest distance of any of its points from its tip.
    pub(super) reach: f64,
    /// Pitches of voxels that are known to see all of it.
    pub(super) resolved: Mutex<Vec<f64>>,
}

/// The tool around one obstacle, in the obstacle's frame.
pub(super) struct ObstacleField {
    pub(super) field: ExactField,
    /// With the tool offset further; made at the first motion.
    pub(super) offset: OnceLock<Option<[ExactField; super::advance::OFFSETS.len()]>>,
}

/// The same where the obstacle stands.
#[derive(Clone)]
pub(super) struct PlacedField {
    pub(super) id: ObstacleId,
    pub(super) at: Pose,
    /// From the world into its frame; `None` where that is the world's.
    back: Option<Pose>,
    /// Middle, in the world, and radius of a ball around its solid centres.
    middle: DVec3,
    radius: f64,
    pub(super) conservative: bool,
    pub(super) around: Arc<ObstacleField>,
}

impl PlacedField {
    /// A pose in the obstacle's frame.
    #[inline]
    pub(super) fn local(&self, pose: &Pose) -> Pose {
        self.back.as_ref().map_or(*pose, |back| back.of_pose(pose))
    }

    pub(super) fn pitch(&self) -> f64 {
        self.around.field.obstacle().grid().pitch
    }

    fn collides(&self, pose: &Pose) -> bool {
        self.around.field.collides(&self.local(pose))
    }
}

/// Decides for one tool, offset by a clearance, among the obstacles of a [`World`]: exactly for voxel centres, without a model. Cloning
/// it copies nothing; threads share one. An invalid pose is never free.
#[derive(Clone)]
pub struct Checker {
    pub(super) tool: Arc<CheckedTool>,
    pub(super) placed: Arc<[PlacedField]>,
}

impl Checker {
    pub(super) fn new(world: &World, assembly: Assembly) -> Result<Self, WorldError> {
        let mut checker = Self::without_obstacles(assembly, world.unit);
        checker.follow(world)?;
        Ok(checker)
    }

    fn without_obstacles(assembly: Assembly, unit: LengthUnit) -> Self {
        let (middle, radius) = ball(assembly.whole());
        let (reach, resolved) = (radius + middle.abs(), Mutex::default());
        let tool = CheckedTool { unit, middle, radius, reach, resolved, assembly };
        Self { tool: Arc::new(tool), placed: Arc::new([]) }
    }

    /// A scene's true tool, offset by a clearance in the scene's unit, around its part and fixtures.
    ///
    /// # Errors
    /// A clearance that is not a length, or one around a mesh tool.
    pub fn of_scene(scene: &Scene, clearance: &Clearance) -> Result<Self, ClearanceError> {
        let field = ExactField::of_scene(scene, clearance)?;
        Ok(Self::of_prepared(&field, scene.record.unit, scene.record.conservative))
    }

    /// The tool and the obstacle of an exact field, whose lengths are in `unit`; what is made for one serves the other. It does not know
    /// whether the voxels are conservative, and guarantees nothing for a mesh.
    #[must_use]
    pub fn of_field(field: &ExactField, unit: LengthUnit) -> Self {
        Self::of_prepared(field, unit, false)
    }

    fn of_prepared(field: &ExactField, unit: LengthUnit, conservative: bool) -> Self {
        let mut world = World::builder().unit(unit).world;
        world.stand("obstacle", field.prepared().clone(), HERE, conservative);
        let mut checker = Self::without_obstacles(field.assembly().clone(), unit);
        checker.update(&world);
        checker
    }

    /// Updates the places of a world's obstacles, including added and removed ones. What was computed for those that
    /// remain is reused.
    ///
    /// # Errors
    /// A tool that passes between the centres of a new obstacle's voxels; a world in another unit.
    pub fn follow(&mut self, world: &World) -> Result<(), WorldError> {
        self.check_world(world)?;
        self.update(world);
        Ok(())
    }

    fn update(&mut self, world: &World) {
        let placed = world.obstacles.iter().filter_map(|standing| {
            let known = self.placed.iter().find(|placed| {
                placed.id == standing.id && placed.around.field.prepared().is_same(&standing.prepared)
            });
            placed(standing, known, &self.tool.assembly)
        });
        self.placed = placed.collect();
    }

    /// Whether it can follow a world.
    pub(super) fn check_world(&self, world: &World) -> Result<(), WorldError> {
        let tool = &self.tool;
        if world.unit != tool.unit {
            return Err(WorldError::Unit { checker: tool.unit, world: world.unit });
        }
        let mut resolved = tool.resolved.lock().unwrap_or_else(PoisonError::into_inner);
        for standing in world.obstacles.iter().filter(|_| !world.allow_coarse) {
            let pitch = standing.prepared.obstacle().grid().pitch;
            if resolved.contains(&pitch) {
                continue;
            }
            if let Some(coarse) = CoarseTool::of(tool.assembly.tool(), pitch, tool.unit) {
                return Err(WorldError::Coarse { tool: coarse, obstacle: standing.name.to_string() });
            }
            resolved.push(pitch);
        }
        Ok(())
    }

    /// Lets go of an obstacle until it follows its world again.
    pub(super) fn forget(&mut self, id: ObstacleId) {
        self.placed = self.placed.iter().filter(|placed| placed.id != id).cloned().collect();
    }

    /// The tool, offset by its clearance.
    #[must_use]
    pub fn assembly(&self) -> &Assembly {
        &self.tool.assembly
    }

    /// True where no solid voxel's centre lies in the tool; false at an invalid pose.
    #[inline]
    #[must_use]
    pub fn is_free(&self, pose: &Pose) -> bool {
        match &*self.placed {
            [] => pose.is_valid(),
            [one] if one.back.is_none() => !one.collides(pose),
            all => self.tool_middle(pose).is_some_and(|middle| {
                !all.iter().any(|one| self.gap(one, middle) <= 0.0 && one.collides(pose))
            }),
        }
    }

    /// [`Checker::is_free`] of every pose: [`Decision::Free`] or [`Decision::Colliding`], never undecided.
    ///
    /// # Errors
    /// An output slice of another length.
    pub fn classify(&self, poses: &[Pose], decisions: &mut [Decision]) -> Result<(), FieldError> {
        classify_blocks(poses, decisions, |poses, colliding| self.collide_block(poses, colliding))
    }

    fn collide_block(&self, poses: &[Pose], found: &mut [bool]) {
        match &*self.placed {
            [] => found.iter_mut().zip(poses).for_each(|(found, pose)| *found = !pose.is_valid()),
            [one] if one.back.is_none() => one.around.field.collide_all(poses, found),
            all => {
                let mut middles = [None; BLOCK];
                for ((middle, found), pose) in middles.iter_mut().zip(found.iter_mut()).zip(poses) {
                    *middle = self.tool_middle(pose);
                    *found = middle.is_none();
                }
                let mut local = [HERE; BLOCK];
                let (mut places, mut hit) = ([0; BLOCK], [false; BLOCK]);
                for one in all {
                    let mut near = 0;
                    for (index, pose) in poses.iter().enumerate() {
                        if !found[index] && middles[index].is_some_and(|middle| self.gap(one, middle) <= 0.0)
                        {
                            (local[near], places[near]) = (one.local(pose), index);
                            near += 1;
                        }
                    }
                    hit[..near].fill(false);
                    one.around.field.collide_all(&local[..near], &mut hit[..near]);
                    places.iter().zip(hit).take(near).for_each(|(&index, hit)| found[index] |= hit);
                }
            }
        }
    }

    /// [`Checker::classify`] on all threads of the current pool.
    ///
    /// # Errors
    /// An output slice of another length.
    pub fn classify_on_all_threads(
        &self,
        poses: &[Pose],
        decisions: &mut [Decision],
    ) -> Result<(), FieldError> {
        check_lengths(poses.len(), decisions.len())?;
        parallel::try_for_each_chunk(decisions, CHUNK, |index, decisions| {
            self.classify(&poses[index * CHUNK..][..decisions.len()], decisions)
        })
    }

    /// What a colliding tool hits: of all voxels in it the one deepest in its element. `None` where it is free.
    ///
    /// # Errors
    /// An invalid pose.
    pub fn contact(&self, pose: &Pose) -> Result<Option<Contact>, QueryError> {
        let middle = self.tool_middle(pose).ok_or(QueryError::InvalidPose)?;
        let (mut deepest, mut found) = (f64::NEG_INFINITY, None);
        for one in self.placed.iter().filter(|one| self.gap(one, middle) <= 0.0 && one.collides(pose)) {
            let local = one.local(pose);
            let here = Contact { obstacle: one.id, element: None, point: None, depth: 0.0 };
            found = found.or(Some(here));
            for (solid, tool) in one.around.field.solids_with_tools() {
                if let Some(inside) = solid.deepest(tool, &local).filter(|inside| inside.depth > deepest) {
                    deepest = inside.depth;
                    let element = inside.element.map(|element| element.kind);
                    let point = Some(one.at.of_point(inside.centre));
                    found = Some(Contact { element, point, depth: inside.depth, ..here });
                }
            }
        }
        Ok(found)
    }

    /// Edge of the finest voxels; `None` without an obstacle.
    pub(super) fn finest_pitch(&self) -> Option<f64> {
        self.pitches().min_by(f64::total_cmp)
    }

    pub(super) fn pitches(&self) -> impl Iterator<Item = f64> {
        self.placed.iter().map(PlacedField::pitch)
    }

    /// Farthest that a coordinate is moved by the place of an obstacle that a way of this length, from a pose on, may reach.
    pub(super) fn moved(&self, from: &Pose, length: f64) -> f64 {
        let middle = self.tool_middle(from);
        let near = |one: &&PlacedField| middle.is_none_or(|middle| self.gap(one, middle) <= length);
        let placed = self.placed.iter().filter(near);
        let places = placed.filter_map(|one| Some([one.back?.position, one.at.position]));
        places.flatten().map(|at| at.abs().max_element()).fold(0.0, f64::max)
    }

    pub(super) fn tool_middle(&self, pose: &Pose) -> Option<DVec3> {
        Some(pose.position + pose.axis()? * self.tool.middle)
    }

    /// Lower bound of the distance between the tool, whose ball has its middle here, and an obstacle.
    pub(super) fn gap(&self, one: &PlacedField, middle: DVec3) -> f64 {
        middle.distance(one.middle) - one.radius - self.tool.radius
    }
}

/// Poses that a thread decides at a time.
const CHUNK: usize = 1024;

/// An obstacle where it stands, by what was made for it before; `None` where nothing of it is solid.
fn placed(
    standing: &PlacedObstacle,
    known: Option<&PlacedField>,
    assembly: &Assembly,
) -> Option<PlacedField> {
    let (middle, radius) = standing.ball?;
    let made = || {
        let field = ExactField::around(&standing.prepared, assembly);
        Arc::new(ObstacleField { field, offset: OnceLock::new() })
    };
    Some(PlacedField {
        id: standing.id,
        at: standing.at,
        back: (standing.at != HERE).then(|| standing.at.inverse()),
        middle: standing.at.of_point(middle),
        radius: radius * (1.0 + 1e-9),
        conservative: standing.conservative,
        around: known.map_or_else(made, |known| known.around.clone()),
    })
}

/// Height of the middle, and radius, of a ball around a tool with its middle on the axis.
fn ball(tool: &Tool) -> (f64, f64) {
    let (middle, radius) = match &tool.shape {
        ToolShape::Mesh(_) => (0.0, tool.reach()),
        ToolShape::Revolved(elements) => {
            let all = || elements.iter().flat_map(|element| &element.profile);
            let low = all().map(|segment| segment.range().0).fold(f64::INFINITY, f64::min);
            let high = all().map(|segment| segment.range().1).fold(f64::NEG_INFINITY, f64::max);
            let middle = 0.5 * (low + high);
            let far = |s: &Segment| {
                (s.range().0 - middle).abs().max((s.range().1 - middle).abs()).hypot(s.max_radius())
            };
            (middle, all().map(far).fold(0.0, f64::max))
        }
    };
    // More than the slack of the tool's predicate and all rounding.
    (middle, radius * (1.0 + 1e-6))
}
