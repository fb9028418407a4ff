//! How much of a part's surface a tool reaches, sample by sample and direction by direction, at contact poses.
//!
//! A sample is reached from a direction where some contact pose is good: shank and holder, offset by their clearance,
//! hold no solid voxel centre, and the cutter none deeper below its own surface than a tolerance in length. Voxel centres
//! that the part does not hold are never solid, so that the answer converges with the pitch, from above.

mod access;
mod contact;
mod samples;
mod setups;
#[cfg(test)]
mod skyline;

pub use access::{SurfaceAccess, surface_access, surface_memory_estimate};
pub use samples::{SurfaceSample, SurfaceSamples};
pub use setups::{ChosenSetup, PartSetup, SetupPlan, fewest_setups};

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::{DQuat, DVec3};
use thiserror::Error;

use contact::{Facing, Outline, Touch};

use crate::field::solid::SolidField;
use crate::occupancy::Occupancy;
use crate::pose::Pose;
use crate::tool::{Assembly, ClearanceError, Element, ElementKind, ToolShape};
use crate::unit::LengthUnit;

/// Why a surface cannot be asked for.
#[derive(Debug, Error, PartialEq)]
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
    /// A tolerance that is no length.
    #[error("the tolerance must be a finite length above 0, not {0}")]
    NoLength(f64),
    /// The clearance cannot be kept.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
}

/// How deep a cutter may cut below the surface by default, in `unit`: 0.05 mm or a tenth of the pitch, whichever is more.
#[must_use]
pub fn default_tolerance(pitch: f64, unit: LengthUnit) -> f64 {
    (0.05 / unit.in_mm()).max(0.1 * pitch)
}

/// What becomes of one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// Reached from so many directions.
    Reached {
        /// Their number.
        directions: u32,
    },
    /// The cutter fits, but something else of the tool collides from every such direction.
    Obstructed {
        /// The direction nearest to the normal from which the cutter fits.
        direction: u32,
        /// What collides there: bit i for element i of [`SurfaceTool::obstructing`]; none of a mesh tool.
        elements: u32,
    },
    /// The cutter itself does not fit: it would cut deeper into the part than the tolerance.
    Gouged,
    /// The cutter has no point that could touch the surface from any of the directions: none faces it.
    NotFaced,
}

/// One tool around one obstacle, for contact poses.
pub struct SurfaceTool {
    name: String,
    shape: Shape,
    tolerance: f64,
    rest: Option<SolidField>,
    elements: Vec<(ElementKind, SolidField)>,
}

enum Shape {
    Revolved {
        outline: Outline,
        cutter: SolidField,
    },
    /// Vertices in the tool's frame.
    Mesh {
        vertices: Vec<DVec3>,
        whole: SolidField,
    },
}

/// How a pose, or all poses of a direction, went; the better ones first.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Outcome {
    Good,
    Obstructed(Pose),
    Gouged,
    NoContact,
}

/// Starting places around a level ring, how many of them are followed, and steps from each.
const STARTS: u32 = 8;
const TRIES: usize = 3;
const STEPS: usize = 6;

impl SurfaceTool {
    /// `cut` is what the cutter must not cut into, by the rule of voxel centres; `obstacle` what shank and holder must stay
    /// out of, which may be larger. The assembly is in the grid's unit.
    ///
    /// # Errors
    /// A tool without a cutter, or a tolerance that its cutter is not thick enough for.
    pub fn new(
        cut: &Arc<Occupancy>,
        obstacle: &Arc<Occupancy>,
        assembly: &Assembly,
        tolerance: f64,
    ) -> Result<Self, SurfaceError> {
        if !(tolerance.is_finite() && tolerance > 0.0) {
            return Err(SurfaceError::NoLength(tolerance));
        }
        let tool = assembly.tool();
        let name = tool.name.clone();
        let ToolShape::Revolved(parts) = &tool.shape else {
            let ToolShape::Mesh(mesh) = &tool.shape else { return Err(SurfaceError::NoCutter(name)) };
            let whole = SolidField::of_tool(cut.clone(), tool);
            let shape = Shape::Mesh { vertices: mesh.vertices.clone(), whole };
            return Ok(Self { name, shape, tolerance, rest: None, elements: Vec::new() });
        };
        let outline = Outline::of(tool).ok_or_else(|| SurfaceError::NoCutter(name.clone()))?;
        let cutting = parts.iter().filter(|e| e.kind == ElementKind::Cutter);
        let cutter =
            Element { kind: ElementKind::Cutter, profile: cutting.flat_map(|e| e.profile.clone()).collect() };
        let too_thick = || SurfaceError::Tolerance { name: name.clone(), tolerance };
        let eroded = cutter.eroded(tolerance, outline.has_shoulder()).ok_or_else(too_thick)?;
        let cutter = SolidField::of_elements(cut.clone(), &[eroded]).ok_or_else(too_thick)?;
        let offset = tool.inflated_elements(assembly.clearance())?;
        let others = offset.into_iter().filter(|e| e.kind != ElementKind::Cutter);
        let elements = others.filter_map(|e| {
            Some((e.kind, SolidField::of_elements(obstacle.clone(), std::slice::from_ref(&e))?))
        });
        Ok(Self {
            shape: Shape::Revolved { outline, cutter },
            tolerance,
            rest: assembly.noncutting().map(|tool| SolidField::of_tool(obstacle.clone(), tool)),
            elements: elements.collect(),
            name,
        })
    }

    /// The tool's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The elements that may obstruct, in the order of the bits of [`Reach::Obstructed`].
    pub fn obstructing(&self) -> impl Iterator<Item = ElementKind> {
        self.elements.iter().map(|(kind, _)| *kind)
    }

    /// What becomes of one sample; `free` is called with every direction from which it is reached.
    pub fn reach(
        &self,
        sample: &SurfaceSample,
        directions: &[(DVec3, DQuat)],
        mut free: impl FnMut(usize),
    ) -> Reach {
        let (mut reached, mut faced) = (0, false);
        let mut obstructed: Option<(f64, usize, Pose)> = None;
        for (index, &(axis, rotation)) in directions.iter().enumerate() {
            match self.outcome_from(sample, axis, rotation) {
                Outcome::Good => {
                    reached += 1;
                    free(index);
                }
                Outcome::Obstructed(pose) => {
                    let facing = sample.normal.dot(axis);
                    if obstructed.is_none_or(|(best, ..)| facing > best + 1e-9) {
                        obstructed = Some((facing, index, pose));
                    }
                }
                Outcome::Gouged => faced = true,
                Outcome::NoContact => {}
            }
        }
        match obstructed {
            _ if reached > 0 => Reach::Reached { directions: reached },
            Some((_, direction, pose)) => {
                Reach::Obstructed { direction: direction as u32, elements: self.colliding(&pose) }
            }
            None if faced => Reach::Gouged,
            None => Reach::NotFaced,
        }
    }

    fn outcome_from(&self, sample: &SurfaceSample, axis: DVec3, rotation: DQuat) -> Outcome {
        let mut best = Outcome::NoContact;
        let mut take = |outcome: Outcome| {
            best = better(best, outcome);
            best == Outcome::Good
        };
        match &self.shape {
            Shape::Revolved { outline, .. } => {
                let facing = Facing::new(sample.normal, axis);
                let mut done = false;
                outline.touches(facing.angle, self.tolerance, |touch| {
                    if done {
                        return;
                    }
                    done = match touch {
                        Touch::Point { height, radius } => {
                            take(self.at(&Pose::new(facing.tip(sample.point, height, radius), rotation)))
                        }
                        Touch::Ring { height, inner, outer } => {
                            let middle = sample.point - axis * height;
                            take(self.on_ring(middle, axis, rotation, inner, outer))
                        }
                    };
                });
            }
            Shape::Mesh { vertices, whole } => {
                // The vertices that lie farthest towards the surface, a tolerance outside it.
                let support = |v: &DVec3| -sample.normal.dot(rotation * *v);
                let farthest = vertices.iter().map(support).fold(f64::NEG_INFINITY, f64::max);
                let tip = sample.point + sample.normal * self.tolerance;
                let touching = vertices.iter().filter(|v| support(v) >= farthest - self.tolerance);
                for vertex in touching.take(STEPS * STARTS as usize) {
                    let pose = Pose::new(tip - rotation * *vertex, rotation);
                    let outcome =
                        if whole.collides(&pose) { Outcome::Obstructed(pose) } else { Outcome::Good };
                    if take(outcome) {
                        break;
                    }
                }
            }
        }
        best
    }

    /// The best pose at which a level ring of the cutter touches: `middle` is the tip with the ring's own middle on the sample.
    /// From a few starting places the tool steps away from what it hits, as far as the ring allows.
    fn on_ring(&self, middle: DVec3, axis: DVec3, rotation: DQuat, inner: f64, outer: f64) -> Outcome {
        let u = axis.any_orthonormal_vector();
        let v = axis.cross(u);
        let mut starts = Vec::with_capacity(1 + 2 * STARTS as usize);
        if inner == 0.0 {
            starts.push(DVec3::ZERO);
        }
        for radius in [0.5 * (inner + outer), outer] {
            starts.extend((0..STARTS).map(|start| {
                let (sine, cosine) = (f64::from(start) * TAU / f64::from(STARTS)).sin_cos();
                (u * cosine + v * sine) * radius
            }));
        }
        let mut best = Outcome::NoContact;
        let mut steps = Vec::with_capacity(starts.len());
        for &offset in &starts {
            let pose = Pose::new(middle + offset, rotation);
            best = better(best, self.at(&pose));
            if best == Outcome::Good {
                return best;
            }
            steps.extend(self.side_step(&pose).map(|step| (offset, step)));
        }
        // The places with the least in the way.
        steps.sort_by(|a, b| a.1.length_squared().total_cmp(&b.1.length_squared()));
        for &(start, step) in steps.iter().take(TRIES) {
            let (mut offset, mut step) = (start, step);
            for _ in 0..STEPS {
                let next = offset + step;
                offset = next.normalize_or(u) * next.length().clamp(inner, outer);
                let pose = Pose::new(middle + offset, rotation);
                best = better(best, self.at(&pose));
                if best == Outcome::Good {
                    return best;
                }
                let Some(next) = self.side_step(&pose) else { break };
                step = next;
            }
        }
        best
    }

    fn at(&self, pose: &Pose) -> Outcome {
        let Shape::Revolved { cutter, .. } = &self.shape else { return Outcome::NoContact };
        if cutter.collides(pose) {
            Outcome::Gouged
        } else if self.rest.as_ref().is_some_and(|rest| rest.collides(pose)) {
            Outcome::Obstructed(*pose)
        } else {
            Outcome::Good
        }
    }

    /// Of cutter and rest the longer step.
    fn side_step(&self, pose: &Pose) -> Option<DVec3> {
        let Shape::Revolved { cutter, .. } = &self.shape else { return None };
        let steps =
            [Some(cutter), self.rest.as_ref()].into_iter().flatten().filter_map(|s| s.side_step(pose));
        steps.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))
    }

    fn colliding(&self, pose: &Pose) -> u32 {
        let bits = self.elements.iter().take(32).enumerate();
        // Counted, since balls to prove by would have to be made for each element.
        bits.filter(|(_, (_, solid))| solid.count(pose).is_none_or(|count| count > 0))
            .fold(0, |bits, (i, _)| bits | 1 << i)
    }
}

fn better(a: Outcome, b: Outcome) -> Outcome {
    let rank = |outcome: &Outcome| match outcome {
        Outcome::Good => 0,
        Outcome::Obstructed(_) => 1,
        Outcome::Gouged => 2,
        Outcome::NoContact => 3,
    };
    if rank(&b) < rank(&a) { b } else { a }
}

#[cfg(test)]
mod closed_forms;
