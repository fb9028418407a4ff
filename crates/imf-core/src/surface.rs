//! How much of a part's surface a tool reaches, sample by sample and direction by direction, at contact poses.
//!
//! A sample is reached from a direction where some contact pose is good: shank and holder, offset by their clearance,
//! hold no solid voxel centre and no point of a surface (a shank none deeper below its own than a tolerance in length), the cutter neither
//! a centre nor a point of the part's surface deeper than that, and nothing of a fixture at all. On a facet of a curved surface a cutter that would cut deeper may turn about
//! the sample as far as the facet's neighbours do, its own surface within the tolerance of the sample: a hole of
//! facets takes the cutter of its diameter. Voxel centres that the part does not hold are never solid, so that the
//! result converges with the pitch, from above; by points of the surface, where there are
//! ([`CollisionEnvironment::with_surfaces`]), it does so quickly.

mod access;
mod candidates;
mod contact;
mod crib;
mod culprits;
mod environment;
mod level_ring;
mod obstructed;
mod part_setup;
mod patches;
mod places;
mod sample_query;
mod samples;
mod setups;
mod skyline;
mod stick_out;
mod verdict;

pub use access::{SurfaceAccess, surface_access, surface_memory_estimate};
pub use candidates::{CandidatesError, candidate_setups, ways_up, with_fixed_axes, with_ways_up};
pub use contact::contact_reach;
pub use crib::crib_access;
pub use culprits::{ElementCollision, MinimumOverlap, culprits, minimum_overlaps};
use environment::as_met;
pub use environment::{CollisionEnvironment, SolidBody};
pub use obstructed::ObstructedAreas;
pub use part_setup::PartSetup;
pub use patches::SurfacePatch;
pub use samples::{SurfaceSample, SurfaceSamples};
pub use setups::{SetupTool, fewest_setups, reached_in_setups, removed_in_setups};
pub(crate) use stick_out::StickOutSearch;
pub use stick_out::{StickOut, StickOutTool, shortest_stick_outs};
pub use verdict::{SampleReach, Verdict};

use std::sync::Arc;

use glam::DVec3;
use thiserror::Error;

use access::ToolDirection;
use contact::{Outline, touching};
use level_ring::RingPlaces;
use sample_query::{DirectionQuery, Last, Outcome, SampleQuery, TOUCH};

use crate::control::Cancelled;
use crate::field::solid::{Known, SolidField, SolidVoxels};
use crate::tool::{Assembly, ClearanceError, Element, ElementKind, Tool, ToolShape};
use crate::unit::LengthUnit;

/// Why what a tool reaches of a surface cannot be computed.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SurfaceError {
    /// The tool has nothing that cuts.
    #[error("the tool '{0}' has no cutter: nothing of it may touch a surface")]
    NoCutter(String),
    /// The cutter is not thicker than the tolerance.
    #[error(
        "the cutter of '{name}' is not thicker than twice the tolerance of {tolerance}: choose a smaller tolerance"
    )]
    Tolerance {
        /// The tool.
        name: String,
        /// The tolerance.
        tolerance: f64,
    },
    /// The tool has no holder, or one that cannot be moved.
    #[error(
        "the tool '{0}' has no holder, so that it has no stick-out: describe it with its holder, in a tool file (TOML) or a library \
         that knows holders"
    )]
    NoHolder(String),
    /// A tolerance that is not a length.
    #[error("the tolerance must be a finite length above 0, not {0}")]
    NoLength(f64),
    /// The tool cannot have the clearance.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// The caller asked to stop.
    #[error("interrupted")]
    Cancelled(#[from] Cancelled),
}

/// How deep a cutter may cut below the surface by default, in `unit`: 0.05 mm, but no less than a tenth of the pitch and no more than a
/// quarter of it, which small parts are measured by.
#[must_use]
pub fn default_tolerance(pitch: f64, unit: LengthUnit) -> f64 {
    (0.05 / unit.in_mm()).clamp(0.1 * pitch, 0.25 * pitch)
}

/// Whether the tool can be brought to a pose: of the tip, and of a unit vector along the tool's axis.
pub type PoseLimit = Arc<dyn Fn(DVec3, DVec3) -> bool + Send + Sync>;

/// One tool among part and fixtures, for contact poses. A copy shares what it is made of.
#[derive(Clone)]
pub struct SurfaceTool {
    name: String,
    shape: Arc<Shape>,
    tolerance: f64,
    /// The elements that [`SampleReach::Obstructed`] can name: as they are tried, and field against each body.
    elements: Arc<Vec<(Element, Vec<SolidField>)>>,
    /// Maximum number of bodies of one element that 64 bits can distinguish.
    bodies: usize,
    limit: Option<PoseLimit>,
}

enum Shape {
    Revolved(Box<Revolved>),
    /// The points that may touch, in the tool's frame.
    Mesh {
        touching: Vec<DVec3>,
        whole: Box<SolidField>,
    },
}

/// A tool of revolution.
struct Revolved {
    /// Its cutter without clearance.
    end: Element,
    outline: Outline,
    /// A sine of the surface's inward normal above which nothing of the cutter touches.
    highest: f64,
    /// What lies deeper in the cutter than the tolerance, against the part.
    cutter: SolidField,
    /// The same as an element.
    eroded: Element,
    /// The cutter against the fixtures, into which it may not cut at all.
    held: Option<SolidField>,
    /// Shank and holder.
    rest: Option<SolidField>,
    /// Their outline.
    above: Option<Tool>,
    /// The cutter offset by the tolerance: a sample inside it counts as touched.
    touching: SolidField,
    /// Largest radius of the cutter.
    radius: f64,
    /// Whether it cuts along its axis alone.
    plunge_only: bool,
    /// Radius in voxels of the ball around a sample whose solid centres are collected once for all directions; where
    /// it holds too many a smaller one is tried, down to the cutter's width.
    near: f64,
    near_across: f64,
}

/// Cosines of angles to a normal that differ by less are one.
const EQUALLY_NEAR: f64 = 1e-9;
/// Voxels that are searched around a sample, except for thicker cutters.
const FARTHEST: f64 = 24.0;

impl SurfaceTool {
    /// The assembly is in the grid's unit.
    ///
    /// # Errors
    /// A tool without a cutter, or a tolerance that its cutter is not thick enough for.
    pub fn new(
        environment: &CollisionEnvironment,
        assembly: &Assembly,
        tolerance: f64,
    ) -> Result<Self, SurfaceError> {
        if !(tolerance.is_finite() && tolerance > 0.0) {
            return Err(SurfaceError::NoLength(tolerance));
        }
        let tool = assembly.tool();
        let name = tool.name.clone();
        if let ToolShape::Mesh(mesh) = &tool.shape {
            let whole = Box::new(SolidField::of_tool(environment.keep_out.clone(), tool));
            let touching = touching(tool, mesh).to_vec();
            let shape = Arc::new(Shape::Mesh { touching, whole });
            return Ok(Self { name, shape, tolerance, elements: Arc::default(), bodies: 1, limit: None });
        }
        let outline = Outline::of(tool).ok_or_else(|| SurfaceError::NoCutter(name.clone()))?;
        let too_thick = || SurfaceError::Tolerance { name: name.clone(), tolerance };
        let (cutter, _) = tool.cutter().ok_or_else(|| SurfaceError::NoCutter(name.clone()))?;
        let end = cutter.top();
        let radius = cutter.max_radius();
        let eroded = cutter.eroded(tolerance, outline.shoulder).ok_or_else(too_thick)?;
        let among = |voxels: &SolidVoxels, element: &Element| {
            SolidField::of_elements(voxels.clone(), std::slice::from_ref(element)).ok_or_else(too_thick)
        };
        let offset = tool.offset_elements(assembly.clearance())?;
        let bodies = &environment.bodies;
        let mut elements = Vec::new();
        // The cutter is named for fixtures alone: cutting into the part has a verdict of its own, `Gouged`.
        let room = assembly.clearance().cutter;
        let at_contact = || cutter.eroded(TOUCH * tolerance, outline.shoulder).ok_or_else(too_thick);
        let clear = if room > 0.0 { cutter.offset(room) } else { at_contact()? };
        // Of fixtures it may hold nothing.
        let nothing = |field: SolidField| field.touching([(clear.clone(), f64::NEG_INFINITY)]);
        let held = environment.fixtures.as_ref().map(|all| among(all, &clear).map(nothing)).transpose()?;
        if held.is_some() {
            let against = bodies.iter().map(|body| among(body, &clear).map(nothing));
            let against: Result<Vec<_>, _> = against.collect();
            elements.push((clear, against?));
        }
        let pitch = environment.pitch();
        for element in offset.into_iter().filter(|e| e.kind != ElementKind::Cutter) {
            let (met, deep) = as_met(&element, assembly.clearance(), tolerance, pitch);
            let touching = |field: SolidField| field.touching([(met.clone(), deep)]);
            let against = bodies.iter().map(|body| Ok(touching(among(body, &met)?)));
            elements
                .extend(against.collect::<Result<_, SurfaceError>>().ok().map(|all| (element.clone(), all)));
        }
        let across = 2.0 * radius / pitch + 2.0;
        let revolved = Revolved {
            highest: outline.highest(tolerance),
            cutter: among(&environment.part, &eroded)?,
            touching: among(&environment.part, &cutter.offset(tolerance))?,
            eroded,
            held,
            above: assembly.noncutting().cloned(),
            rest: assembly
                .noncutting()
                .map(|tool| environment.rest_field(tool, assembly.clearance(), tolerance)),
            radius,
            plunge_only: tool.plunge_only,
            near: (end / pitch + across).min(FARTHEST.max(across)),
            near_across: across,
            end: cutter,
            outline,
        };
        let bodies = 64 / elements.len().max(1);
        let shape = Arc::new(Shape::Revolved(Box::new(revolved)));
        Ok(Self { name, shape, tolerance, elements: Arc::new(elements), bodies, limit: None })
    }

    /// The same tool where it cannot be brought to every pose, as by a machine: the others are obstructed.
    #[must_use]
    pub fn limited(self, limit: PoseLimit) -> Self {
        Self { limit: Some(limit), ..self }
    }

    /// The tool's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The hits of [`SampleReach::Obstructed`]: which element, from the tip upwards, and which body: 0 the part, then the
    /// fixtures. The cutter is named for fixtures alone; nothing is where the tool is free, and cannot be brought there.
    pub fn hits(&self, hits: u64) -> impl Iterator<Item = (ElementKind, usize)> {
        let set = (0..64).filter(move |bit| hits >> bit & 1 == 1);
        set.filter_map(|bit| Some((self.elements.get(bit / self.bodies)?.0.kind, bit % self.bodies)))
    }

    /// The verdict on one sample; `free` is called with every direction from which it is reached. Those in which the tool stands as in one
    /// before are marked in `again`.
    fn reach(
        &self,
        sample: &SurfaceSample,
        (turns, again): (&[ToolDirection], &[bool]),
        last: &mut [[Last; 2]],
        mut free: impl FnMut(usize),
    ) -> SampleReach {
        let query = SampleQuery::new(self, sample, None);
        let (mut reached, mut faced) = (0, false);
        let mut nearest = f64::NEG_INFINITY;
        let mut obstructed: Vec<(usize, DVec3)> = Vec::new();
        for (index, (turn, last)) in turns.iter().zip(last).enumerate() {
            match self.at_best(&query, turn, last) {
                Outcome::Good(_) => {
                    reached += u32::from(reached == 0 || !again[index]);
                    free(index);
                }
                Outcome::Obstructed(tip) if reached == 0 => {
                    let facing = sample.normal.dot(turn.axis);
                    if facing > nearest + EQUALLY_NEAR {
                        nearest = facing;
                        obstructed.clear();
                    }
                    if facing > nearest - EQUALLY_NEAR {
                        obstructed.push((index, tip));
                    }
                }
                Outcome::Gouged => faced = true,
                Outcome::Obstructed(_) | Outcome::NoContact => {}
            }
        }
        if reached > 0 {
            return SampleReach::Reached { directions: reached };
        }
        // Of several as near to the normal the one where least is in the way.
        let hits = obstructed
            .iter()
            .map(|&(direction, tip)| (direction, self.colliding(tip, turns[direction].axis)));
        match hits.min_by_key(|(_, hits)| hits.count_ones()) {
            Some((direction, hits)) => SampleReach::Obstructed { direction: direction as u32, hits },
            None if faced => SampleReach::Gouged,
            None => SampleReach::NotFaced,
        }
    }

    /// True where a sample is reached from any of these directions.
    fn reaches(
        &self,
        sample: &SurfaceSample,
        turns: impl Iterator<Item = usize>,
        all: &[ToolDirection],
        last: &mut [[Last; 2]],
    ) -> bool {
        let mut turns = turns.peekable();
        // The surroundings of the sample are collected once there is a direction.
        turns.peek().is_some() && {
            let query = SampleQuery::new(self, sample, None);
            turns.any(|index| self.at_best(&query, &all[index], &mut last[index]).is_good())
        }
    }

    fn at_best(
        &self,
        query: &SampleQuery<'_>,
        turn: &ToolDirection,
        [last, at_rest]: &mut [Last; 2],
    ) -> Outcome {
        let is_free = |tip| self.is_rest_free(tip, turn.axis, at_rest) && self.is_brought(tip, turn.axis);
        let rings = &mut RingPlaces::default();
        query.best_pose(DirectionQuery { turn, last, rest: self.rest(), is_free, rings })
    }

    fn revolved(&self) -> Option<&Revolved> {
        let Shape::Revolved(revolved) = &*self.shape else { return None };
        Some(revolved)
    }

    /// Shank and holder; none of a mesh tool.
    fn rest(&self) -> Option<&SolidField> {
        self.revolved()?.rest.as_ref()
    }

    fn is_rest_free(&self, tip: DVec3, axis: DVec3, last: &mut Last) -> bool {
        self.rest().is_none_or(|rest| !rest.meets(tip, axis, Known::default(), Some(last)))
    }

    /// True where it cannot be brought to every pose.
    #[must_use]
    pub fn is_limited(&self) -> bool {
        self.limit.is_some()
    }

    fn is_brought(&self, tip: DVec3, axis: DVec3) -> bool {
        self.limit.as_ref().is_none_or(|limit| limit(tip, axis))
    }

    fn colliding(&self, tip: DVec3, axis: DVec3) -> u64 {
        let mut hits = 0;
        for (index, (element, against)) in self.elements.iter().enumerate() {
            for (body, solid) in against.iter().enumerate() {
                let blamed = element.kind != ElementKind::Cutter || body > 0;
                if blamed && solid.meets(tip, axis, Known::default(), None) {
                    // The last bit stands for all bodies beyond.
                    hits |= 1 << (index * self.bodies + body.min(self.bodies - 1));
                }
            }
        }
        hits
    }
}

#[cfg(test)]
mod closed_forms;
#[cfg(test)]
mod twin;
