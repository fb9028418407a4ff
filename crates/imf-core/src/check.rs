//! A toolpath checked against what must not be hit, exactly, pose by pose and element by element.
//!
//! Between two lines of the toolpath poses are taken so close together that no point of the tool moves farther than
//! the tolerance from one to the next. Holder and shank, offset by their clearance, must hold no solid voxel's centre.
//! The cutter must touch what it cuts: its overlap with the part is accepted down to `contact` below the part's
//! surface. With fixtures nothing is accepted.
//!
//! The surface is taken to lie half-way between solid and empty centres: a solid voxel is as deep below it as its
//! centre's distance to the nearest empty centre, less half a pitch.

use std::sync::Arc;

use glam::DVec3;
use serde::Serialize;
use thiserror::Error;

use crate::control::Control;
use crate::distance::deeper_than;
use crate::field::solid::SolidField;
use crate::occupancy::Occupancy;
use crate::parallel;
use crate::pose::{Pose, StraightMotion};
use crate::tool::{Clearance, ClearanceError, Element, ElementKind, Tool, ToolError};
use crate::toolpath::{Location, Toolpath};

/// What is accepted, and how closely the path is followed. Lengths in the unit of the part's grid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CheckSettings {
    /// Room around each kind of element.
    pub clearance: Clearance,
    /// How deep below the part's surface the cutter may reach; 0 accepts nothing.
    pub contact: f64,
    /// Farthest that any point of the tool moves between two poses that are checked.
    pub tolerance: f64,
}

impl CheckSettings {
    /// No clearance, contact of one pitch, tolerance of a quarter of it.
    #[must_use]
    pub fn of_pitch(pitch: f64) -> Self {
        Self { clearance: Clearance::default(), contact: pitch, tolerance: pitch / 4.0 }
    }
}

/// Why a toolpath cannot be checked.
#[derive(Debug, Error)]
pub enum CheckError {
    /// The tool has no volume.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// The tool cannot be offset.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// Which way the tool turns is not defined.
    #[error(
        "line {line}: the tool axis turns to its opposite in one step; which way is not said, so add a line between"
    )]
    Opposite {
        /// The line the motion ends on.
        line: usize,
    },
    /// A setting is no length.
    #[error("the {name} must be {wanted}, not {value}")]
    Setting {
        /// Which.
        name: &'static str,
        /// What it should be.
        wanted: &'static str,
        /// What it is.
        value: f64,
    },
    /// A motion would need too many poses.
    #[error(
        "line {line}: {poses:.1e} poses at a tolerance of {tolerance}; use a larger one, or check the toolpath's unit"
    )]
    TooLong {
        /// The line the motion ends on.
        line: usize,
        /// Poses it would need.
        poses: f64,
        /// The tolerance.
        tolerance: f64,
    },
    /// The elements of an outline that bends inwards cannot be counted by themselves.
    #[error(
        "the tool '{0}' has an arc around a centre beyond its axis, which cannot be checked with a clearance"
    )]
    Outline(String),
    /// The caller's [`Control`] asked to stop.
    #[error("interrupted")]
    Cancelled,
}

/// What was hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Against {
    /// The part.
    Part,
    /// A fixture.
    Fixtures,
}

/// One element that collides during one motion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Collision {
    /// The element's name; `tool` for a mesh.
    pub element: String,
    /// What it hits.
    pub against: Against,
    /// Most solid voxels in the element, offset by its clearance, at any pose of the motion; what contact accepts is
    /// not counted.
    pub voxels: u32,
    /// Their volume in units cubed.
    pub volume: f64,
    /// Tip at that pose.
    pub position: [f64; 3],
    /// Axis at that pose.
    pub axis: [f64; 3],
    /// Poses of the motion at which the element collides.
    pub poses: u64,
}

/// A line of the toolpath on the way to which something collides.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LineCollisions {
    /// Line of the toolpath's file.
    pub line: usize,
    /// Poses checked on the way to it, its own included.
    pub poses: u64,
    /// What collides.
    pub collisions: Vec<Collision>,
}

/// The answer for a whole toolpath.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CheckReport {
    /// What was accepted.
    pub settings: CheckSettings,
    /// Locations of the toolpath.
    pub locations: usize,
    /// Poses checked in all.
    pub poses: u64,
    /// Lines with a collision, in order.
    pub colliding: Vec<LineCollisions>,
}

/// Some elements against one obstacle.
struct ElementGroup {
    field: SolidField,
    names: Vec<String>,
    against: Against,
}

/// More poses than this on one motion are a slip of units.
const MOST: f64 = 1e8;

/// Evenly spaced poses of one motion, its end included, its start left to the motion before.
struct Poses {
    motion: StraightMotion,
    line: usize,
    count: u64,
}

impl Poses {
    /// The way to location `index`; for the first, that location alone.
    fn to(locations: &[Location], index: usize, reach: f64, tolerance: f64) -> Result<Self, CheckError> {
        let [from, to] = [index.saturating_sub(1), index].map(|index| locations[index]);
        let motion = StraightMotion::new((from.position, from.axis), (to.position, to.axis));
        let motion = motion.ok_or(CheckError::Opposite { line: to.line })?;
        let poses = (motion.farthest(reach) / tolerance - 1e-9).ceil().max(1.0);
        if poses > MOST {
            return Err(CheckError::TooLong { line: to.line, poses, tolerance });
        }
        Ok(Self { motion, line: to.line, count: poses as u64 })
    }

    /// Tip and axis of every pose.
    fn iter(&self) -> impl Iterator<Item = (DVec3, DVec3)> {
        (1..=self.count).map(|step| self.motion.at(step as f64 / self.count as f64))
    }
}

/// Checks every motion of a toolpath on all threads of the current pool. One unit of progress is one location.
///
/// `part` and `fixtures` stand on grids of one pitch, in world coordinates; the tool's lengths are in the same unit.
/// Poses of which `is_free` knows that the whole tool, offset by the clearance, is free of part and fixtures are not counted: where
/// what it knows is proven (`is_free` of a verified field), the report is the same as with `|_| false`.
///
/// # Errors
/// Settings or a tool that make no sense, a motion whose turn is not defined or that is absurdly long, cancellation.
pub fn check_toolpath(
    part: &Occupancy,
    fixtures: Option<&Occupancy>,
    tool: &Tool,
    toolpath: &Toolpath,
    settings: &CheckSettings,
    is_free: impl Fn(&Pose) -> bool + Sync,
    control: Control<'_>,
) -> Result<CheckReport, CheckError> {
    check_settings(settings)?;
    tool.check()?;
    let elements = tool.inflated_elements(&settings.clearance)?;
    let (voxels, deep) = (Arc::new(part.clone()), Arc::new(deeper_than(part, settings.contact)));
    let fixtures = fixtures.map(|fixtures| Arc::new(fixtures.clone()));
    let groups = element_groups(&voxels, &deep, fixtures.as_ref(), tool, &elements, settings)?;
    let reach =
        tool.reach() + settings.clearance.holder.max(settings.clearance.shank).max(settings.clearance.cutter);
    // Every motion is tried before any work is done.
    let motions: Vec<Poses> = (0..toolpath.locations.len())
        .map(|index| Poses::to(&toolpath.locations, index, reach, settings.tolerance))
        .collect::<Result<_, _>>()?;
    let lines: Vec<LineCollisions> = parallel::try_map(motions.len(), |index| {
        if control.is_cancelled() {
            return Err(CheckError::Cancelled);
        }
        let line = check_motion(&groups, &motions[index], &is_free, part.grid.voxel_volume());
        (control.progress)(1);
        Ok(line)
    })?;
    Ok(CheckReport {
        settings: *settings,
        locations: toolpath.locations.len(),
        poses: lines.iter().map(|l| l.poses).sum(),
        colliding: lines.into_iter().filter(|l| !l.collisions.is_empty()).collect(),
    })
}

fn check_settings(settings: &CheckSettings) -> Result<(), CheckError> {
    let CheckSettings { contact, tolerance, .. } = *settings;
    if !(contact.is_finite() && contact >= 0.0) {
        let wanted = "a finite length of at least 0";
        return Err(CheckError::Setting { name: "contact", wanted, value: contact });
    }
    if !(tolerance.is_finite() && tolerance > 0.0) {
        let wanted = "a finite length above 0";
        return Err(CheckError::Setting { name: "tolerance", wanted, value: tolerance });
    }
    Ok(())
}

/// Which elements must stay out of which obstacle.
fn element_groups(
    part: &Arc<Occupancy>,
    deep: &Arc<Occupancy>,
    fixtures: Option<&Arc<Occupancy>>,
    tool: &Tool,
    elements: &[Element],
    settings: &CheckSettings,
) -> Result<Vec<ElementGroup>, CheckError> {
    let (cutter, rest): (Vec<Element>, Vec<Element>) =
        elements.iter().cloned().partition(|e| e.kind == ElementKind::Cutter);
    let wanted = [
        (Some(deep), &cutter[..], Against::Part),
        (Some(part), &rest[..], Against::Part),
        (fixtures, elements, Against::Fixtures),
    ];
    let mut groups = Vec::new();
    for (obstacle, elements, against) in wanted {
        let Some(obstacle) = obstacle.filter(|_| !elements.is_empty()) else { continue };
        let Some(field) = SolidField::of_elements(obstacle.clone(), elements) else {
            if settings.clearance.is_zero() {
                return Ok(whole_tool(part, fixtures, tool));
            }
            return Err(CheckError::Outline(tool.name.clone()));
        };
        let names = elements.iter().map(|e| e.kind.to_string()).collect();
        groups.push(ElementGroup { field, names, against });
    }
    // A mesh has no cutter that could be let touch.
    Ok(if elements.is_empty() { whole_tool(part, fixtures, tool) } else { groups })
}

fn whole_tool(part: &Arc<Occupancy>, fixtures: Option<&Arc<Occupancy>>, tool: &Tool) -> Vec<ElementGroup> {
    [(Some(part), Against::Part), (fixtures, Against::Fixtures)]
        .into_iter()
        .filter_map(|(obstacle, against)| Some((obstacle?, against)))
        .map(|(obstacle, against)| ElementGroup {
            field: SolidField::of_tool(obstacle.clone(), tool),
            names: vec!["tool".into()],
            against,
        })
        .collect()
}

fn check_motion(
    groups: &[ElementGroup],
    motion: &Poses,
    is_free: impl Fn(&Pose) -> bool,
    voxel_volume: f64,
) -> LineCollisions {
    let mut line = LineCollisions { line: motion.line, poses: motion.count, collisions: Vec::new() };
    let mut found: Vec<_> =
        groups.iter().map(|g| (vec![0; g.names.len()], vec![None::<Collision>; g.names.len()])).collect();
    for (position, axis) in motion.iter() {
        let pose = Pose::along(position, axis);
        if is_free(&pose) {
            continue;
        }
        for (group, (counts, worst)) in groups.iter().zip(&mut found) {
            if !group.field.collides(&pose) {
                continue;
            }
            if group.field.elements().next().is_none() {
                counts[0] = group.field.count(&pose).unwrap_or(0);
            } else {
                group.field.element_counts(&pose, counts);
            }
            for ((worst, name), &voxels) in worst.iter_mut().zip(&group.names).zip(counts.iter()) {
                if voxels > 0 {
                    let place = (group.against, position, axis);
                    note(worst, name, place, voxels, voxel_volume);
                }
            }
        }
    }
    line.collisions.extend(found.into_iter().flat_map(|(_, worst)| worst).flatten());
    line
}

/// Keeps the pose at which most voxels are hit, the first of equals.
fn note(
    worst: &mut Option<Collision>,
    element: &str,
    (against, position, axis): (Against, DVec3, DVec3),
    voxels: u32,
    voxel_volume: f64,
) {
    let poses = worst.as_ref().map_or(0, |w| w.poses) + 1;
    match worst {
        Some(known) if known.voxels >= voxels => known.poses = poses,
        _ => {
            *worst = Some(Collision {
                element: element.to_owned(),
                against,
                voxels,
                volume: f64::from(voxels) * voxel_volume,
                position: position.to_array(),
                axis: axis.to_array(),
                poses,
            });
        }
    }
}

#[cfg(test)]
mod tests;
