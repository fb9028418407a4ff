//! The minimum stick-out with which a tool reaches a surface, sample by sample.
//!
//! The cutter and the part of the shank that is always outside the holder are checked at contact poses as for a fixed
//! tool. If they are free, the holder is raised along the shank until it is free (one skyline query, no search), and
//! the bared shank is checked. Each result is verified: the tool set to that length holds neither a voxel centre nor a point of a surface
//! that it must avoid. What stands above the end of the holder's outline is ignored, so a longer stick-out
//! than the minimum may collide again: a groove of the holder may be where something protrudes.

use std::sync::Arc;

use glam::DVec3;

use super::environment::as_met;
use super::level_ring::RingPlaces;
use super::places::{by_place, for_each};
use super::sample_query::{DirectionQuery, Last, Outcome, SampleQuery};
use super::skyline::{Body, CellQueue, Skyline, boundary};
use super::{CollisionEnvironment, Shape, SurfaceError, SurfaceSample, SurfaceTool, ToolDirection, Verdict};
use crate::control::Control;
use crate::field::solid::{Known, SolidField};
use crate::orientation::Orientation;
use crate::parallel;
use crate::pose::Pose;
use crate::tool::{Assembly, Clearance, Element, ElementKind, ToolShape};

/// Directions that are seen at once: their skylines are held together.
const DIRECTIONS: usize = 4;
/// Places that one thread takes at once.
const CHUNK: usize = 64;
/// The shortest piece of bared shank that is checked, in pitches: stick-outs that bare less are rounded up to it.
const PIECE: f64 = 0.125;
/// By how much the holder goes on where the exact count finds what its skyline lacks, in pitches.
const STEP: f64 = 0.25;

/// What becomes of one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StickOut {
    /// With some stick-out the tool reaches it.
    Reached {
        /// The minimum, in the grid's unit; it may exceed the tool's length.
        length: f64,
        /// The first direction that allows it.
        direction: u32,
        /// Where the tip then is.
        tip: DVec3,
    },
    /// The cutter fits, but from every such direction its shank, or the length needed to clear the holder, collides
    /// at every stick-out.
    Obstructed,
    /// The cutter itself does not fit.
    Gouged,
    /// The cutter has no point that could touch the surface from any of the directions.
    NotFaced,
}

impl StickOut {
    /// The minimum stick-out where there is one, and infinity elsewhere.
    #[must_use]
    pub fn length(&self) -> f64 {
        match self {
            Self::Reached { length, .. } => *length,
            _ => f64::INFINITY,
        }
    }

    /// In a word.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        match self {
            Self::Reached { .. } => Verdict::Reached,
            Self::Obstructed => Verdict::Obstructed,
            Self::Gouged => Verdict::Gouged,
            Self::NotFaced => Verdict::NotFaced,
        }
    }
}

/// A tool whose holder slides, among part and fixtures.
pub struct StickOutTool {
    /// Cutter, and the shank that is out at the shortest.
    tool: SurfaceTool,
    /// Shank and holder as they are set.
    as_set: SolidField,
    /// Heights from its lower face; offset by its clearance.
    holder: Body,
    at_holder: SolidField,
    /// Pieces of the shank that the holder bares, each twice as long as the one before; offset.
    bared: Vec<SolidField>,
    shortest: f64,
    longest: f64,
    given: f64,
    pitch: f64,
    /// Of what shank and holder must stay out of: centres of voxels, and points of surfaces.
    boundary: Vec<DVec3>,
}

impl StickOutTool {
    /// The assembly is in the grid's unit.
    ///
    /// # Errors
    /// As [`SurfaceTool::new`]; a tool without a holder.
    pub fn new(
        environment: &CollisionEnvironment,
        assembly: &Assembly,
        tolerance: f64,
    ) -> Result<Self, SurfaceError> {
        Self::with_contact(environment, assembly, tolerance, (assembly.clearance(), tolerance))
    }

    /// The same where points of surfaces may lie as deep in the shank as `contact`, and where it has no clearance centres of voxels too; the
    /// assembly's may be larger than that.
    pub(crate) fn with_contact(
        environment: &CollisionEnvironment,
        assembly: &Assembly,
        tolerance: f64,
        (own, contact): (&Clearance, f64),
    ) -> Result<Self, SurfaceError> {
        let (given, clearance) = (assembly.tool(), assembly.clearance());
        let no_holder = || SurfaceError::NoHolder(given.name.clone());
        let mut tool = SurfaceTool::new(environment, assembly, tolerance)?;
        // It is not shared yet.
        let Some(Shape::Revolved(revolved)) = Arc::get_mut(&mut tool.shape) else { return Err(no_holder()) };
        let shortest = given.shortest_stick_out().ok_or_else(no_holder)?;
        let fixed = given.with_stick_out(shortest).ok_or_else(no_holder)?.without_holder();
        let fixed = fixed.offset(clearance)?;
        let as_set = revolved.rest.take().ok_or_else(no_holder)?;
        revolved.rest = fixed.noncutting().map(|shank| environment.rest_field(shank, own, contact));
        let holder = given.holder().ok_or_else(no_holder)?.with_clearance(clearance)?;
        let ToolShape::Revolved(elements) = &holder.shape else { return Err(no_holder()) };
        let outline = elements.iter().flat_map(|element| element.profile.iter().copied());
        let solid = environment.keep_out.occupancy();
        let pitch = solid.grid.pitch;
        // No result is beyond what is solid, seen from a tip that touches it.
        let farthest = solid.grid.size().length() + given.reach();
        let pieces = (farthest / (PIECE * pitch)).log2().ceil().max(0.0) as i32;
        let bared = (0..=pieces).map(|piece| {
            let profile = given.extension(0.0, PIECE * pitch * f64::from(piece).exp2()).into_iter().collect();
            let piece = Element { kind: ElementKind::Shank, profile }.offset(clearance.shank);
            let (met, deep) = as_met(&piece, own, contact, pitch);
            let field = SolidField::of_elements(environment.keep_out.clone(), std::slice::from_ref(&met))?;
            Some(field.touching([(met, deep)]))
        });
        Ok(Self {
            holder: Body::new(outline).ok_or_else(no_holder)?,
            at_holder: environment.rest_field(&holder, own, contact),
            bared: bared.collect::<Option<_>>().ok_or_else(no_holder)?,
            shortest,
            longest: given.overall_length.unwrap_or(f64::INFINITY),
            given: given.stick_out().ok_or_else(no_holder)?,
            pitch,
            boundary: [boundary(solid), environment.keep_out.points()].concat(),
            tool,
            as_set,
        })
    }

    /// The tool's name.
    #[must_use]
    pub fn name(&self) -> &str {
        self.tool.name()
    }

    /// The minimum that the holder can be set to, which grips neither flutes nor necks.
    #[must_use]
    pub fn shortest(&self) -> f64 {
        self.shortest
    }

    /// The tool's overall length, infinite where it is not known.
    #[must_use]
    pub fn longest(&self) -> f64 {
        self.longest
    }

    /// What the tool is set to.
    #[must_use]
    pub fn given(&self) -> f64 {
        self.given
    }

    /// True where shank and holder are free at a pose with a stick-out from the shortest up; false of an invalid pose.
    pub(crate) fn is_free_at(&self, pose: &Pose, length: f64) -> bool {
        pose.axis().is_some_and(|axis| {
            let tip = pose.position;
            tip.is_finite()
                && self.is_bared_free(tip, axis, length)
                && !self.at_holder.meets(tip + axis * length, axis, Known::default(), None)
                && self.tool.is_rest_free(tip, axis, &mut None)
        })
    }

    /// The minimum stick-out, from one up and below `limit`, with which shank and holder are free where the shortest
    /// shank is.
    fn least(
        &self,
        (tip, axis): (DVec3, DVec3),
        skyline: &Skyline,
        from: f64,
        limit: f64,
        waiting: &mut CellQueue,
    ) -> Option<f64> {
        let mut length = from;
        loop {
            length = skyline.clearing_height(tip, &self.holder, length, limit, waiting)?;
            let piece = PIECE * self.pitch;
            if length > self.shortest && length < self.shortest + piece {
                length = self.shortest + piece;
                continue;
            }
            if !self.is_bared_free(tip, axis, length) {
                return None;
            }
            if !self.at_holder.meets(tip + axis * length, axis, Known::default(), None) {
                return Some(length);
            }
            // Between the voxels of the boundary, into the inside.
            length += STEP * self.pitch;
        }
    }

    /// True where the shank from the shortest stick-out to this one holds nothing.
    fn is_bared_free(&self, tip: DVec3, axis: DVec3, length: f64) -> bool {
        let bared = length - self.shortest;
        if bared <= 0.0 {
            return true;
        }
        // The longest piece that is no longer, at either end.
        let piece = ((bared / (PIECE * self.pitch) * (1.0 + 1e-12)).log2().floor().max(0.0) as usize)
            .min(self.bared.len() - 1);
        let long = PIECE * self.pitch * (piece as f64).exp2();
        let at = |height: f64| self.bared[piece].meets(tip + axis * height, axis, Known::default(), None);
        !at(self.shortest) && !at(self.shortest + (bared - long).max(0.0))
    }
}

/// Raises a stick-out from pose to pose; what is made for an axis serves until another one comes.
pub(crate) struct StickOutSearch<'a> {
    tool: &'a StickOutTool,
    skyline: Option<(DVec3, Skyline)>,
    waiting: CellQueue,
}

impl<'a> StickOutSearch<'a> {
    pub(crate) fn new(tool: &'a StickOutTool) -> Self {
        Self { tool, skyline: None, waiting: CellQueue::new() }
    }

    /// The minimum stick-out from `length` up with which shank and holder are free at a pose; `None` where there is
    /// none.
    pub(crate) fn from(&mut self, length: f64, pose: &Pose) -> Option<f64> {
        if self.tool.is_free_at(pose, length) {
            return Some(length);
        }
        let (tip, axis) = (pose.position, pose.axis()?);
        if !tip.is_finite() || !self.tool.tool.is_rest_free(tip, axis, &mut None) {
            return None;
        }
        let (_, skyline) = match &mut self.skyline {
            Some(known) if known.0 == axis => known,
            other => other.insert((axis, Skyline::new(&self.tool.boundary, self.tool.pitch, axis))),
        };
        self.tool.least((tip, axis), skyline, length, f64::INFINITY, &mut self.waiting)
    }
}

/// The minimum stick-out of every sample over all directions, on all threads of the current pool; the result does not
/// depend on their number. One unit of progress is one direction.
///
/// # Errors
/// [`SurfaceError::Cancelled`] when the control asks to stop.
pub fn shortest_stick_outs(
    tool: &StickOutTool,
    samples: &[SurfaceSample],
    directions: &[Orientation],
    control: Control<'_>,
) -> Result<Vec<StickOut>, SurfaceError> {
    let places = by_place(samples);
    let stances = parallel::map(places.len(), |place| SampleQuery::new(&tool.tool, &places[place][0], None));
    let turns: Vec<ToolDirection> = directions.iter().map(ToolDirection::new).collect();
    let mut found = vec![StickOut::NotFaced; places.len()];
    for (block, turns) in turns.chunks(DIRECTIONS).enumerate() {
        let skylines =
            parallel::map(turns.len(), |turn| Skyline::new(&tool.boundary, tool.pitch, turns[turn].axis));
        parallel::try_for_each_chunk(&mut found, CHUNK, |chunk, found| {
            let mut memory = [[Last::None; 2]; DIRECTIONS];
            let mut waiting = CellQueue::new();
            for (sample, best) in found.iter_mut().enumerate() {
                control.check()?;
                let query = &stances[chunk * CHUNK + sample];
                for (index, (turn, skyline)) in turns.iter().zip(&skylines).enumerate() {
                    // None is shorter.
                    if best.length() <= tool.shortest {
                        break;
                    }
                    let direction = (block * DIRECTIONS + index) as u32;
                    let [last, at_shank] = &mut memory[index];
                    let mut rings = RingPlaces::default();
                    let mut search = |rest, enough: f64, best: &mut StickOut| {
                        let is_free = |tip: DVec3| {
                            if tool.tool.is_rest_free(tip, turn.axis, at_shank) {
                                let at = (tip, turn.axis);
                                let least =
                                    tool.least(at, skyline, tool.shortest, best.length(), &mut waiting);
                                if let Some(length) = least {
                                    *best = StickOut::Reached { length, direction, tip };
                                }
                            }
                            best.length() <= enough
                        };
                        query.best_pose(DirectionQuery { turn, last, rest, is_free, rings: &mut rings })
                    };
                    let outcome = match search(tool.tool.rest(), tool.shortest, best) {
                        Outcome::Good(_) | Outcome::Obstructed(_) => StickOut::Obstructed,
                        Outcome::Gouged => StickOut::Gouged,
                        Outcome::NoContact => StickOut::NotFaced,
                    };
                    if outcome.verdict() < best.verdict() {
                        *best = outcome;
                    }
                    if best.length() > tool.given && query.has_ring(turn) {
                        // Places to which the tool at its given length would step aside.
                        search(Some(&tool.as_set), tool.given, best);
                    }
                }
            }
            Ok::<_, SurfaceError>(())
        })?;
        (control.progress)(turns.len() as u64);
    }
    Ok(for_each(&places, found))
}

#[cfg(test)]
mod tests;
