//! A machine's head and table on the way along a toolpath, and its travel.
//!
//! What the head carries is tried against part, fixtures and what the table carries, and the tool against the latter, each pair in the
//! frame of the body that is hit, at poses of its own: so close that nothing of the one moves farther than the tolerance as
//! seen from the other.

use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::elements::{Body, DepthElement, Group, Shape, Step, Track};
use super::motions::{Motion, poses_needed};
use super::{CheckError, CheckSettings, Collision, HitBody};
use crate::control::{Cancelled, Control};
use crate::field::solid::{SolidField, SolidVoxels};
use crate::machine::{Ball, Machine, MachineSolid, OutOfTravel, Placement, Side, SolidShape};
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::pose::Pose;
use crate::tool::{Element, ElementKind, Segment, SharpPoints, Tool, ToolShape};

/// A machine, and the voxels of what its table carries.
#[derive(Clone, Debug)]
pub struct MachineBodies {
    machine: Machine,
    /// With the rotary axes of the table that carry each; where they are with all axes at 0.
    table: Vec<(String, usize, Occupancy)>,
}

impl MachineBodies {
    /// In the machine's unit, with voxels of `pitch`, or larger ones where these would be too many.
    ///
    /// # Errors
    /// The caller's [`Control`] asked to stop.
    pub fn new(machine: Machine, pitch: f64, control: Control<'_>) -> Result<Self, Cancelled> {
        let of_table = machine.solids.iter().filter(|solid| solid.side == Side::Table);
        let voxels = |solid: &MachineSolid| -> Result<_, Cancelled> {
            Ok((solid.name.clone(), solid.level, solid.voxels(pitch, control)?))
        };
        let table = of_table.map(voxels).collect::<Result<_, _>>()?;
        Ok(Self { machine, table })
    }

    /// The machine.
    #[must_use]
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// The largest pitch of its voxels.
    #[must_use]
    pub fn coarsest_pitch(&self) -> Option<f64> {
        self.table.iter().map(|(_, _, voxels)| voxels.grid.pitch).reduce(f64::max)
    }

    /// Bodies thinner than voxels show are refused: those of the table by their own, those of the head by the coarsest, which may
    /// also be the part's.
    pub(super) fn check(&self, pitch: f64) -> Result<(), CheckError> {
        let of_head = self.coarsest_pitch().unwrap_or(pitch).max(pitch);
        for solid in &self.machine.solids {
            let own = self.table.iter().find(|(name, ..)| solid.side == Side::Table && *name == solid.name);
            let pitch = own.map_or(of_head, |(.., voxels)| voxels.grid.pitch);
            let thinnest = match &solid.shape {
                SolidShape::Cylinder { base, top, diameter } => diameter.min(base.distance(*top)),
                _ => (solid.bounds().1 - solid.bounds().0).min_element(),
            };
            if thinnest < std::f64::consts::SQRT_2 * pitch {
                return Err(CheckError::ThinSolid { name: solid.name.clone(), thickness: thinnest, pitch });
            }
        }
        Ok(())
    }

    pub(super) fn bodies(&self) -> Vec<(usize, Body)> {
        let of = |(name, level, voxels): &(String, usize, Occupancy)| {
            (*level, Body::new(Arc::new(voxels.clone()), HitBody::Machine(name.clone())))
        };
        self.table.iter().map(of).collect()
    }
}

/// Added to a ball's radius, in pitches: more than rounding.
const BALL_MARGIN: f64 = 1e-3;

/// Of two values of an axis the one that is farther beyond its range.
pub(super) fn farther(one: f64, other: f64, [low, high]: [f64; 2]) -> f64 {
    let excess = |value: f64| (low - value).max(value - high);
    if excess(other) > excess(one) { other } else { one }
}

/// Something that the head carries, as it is tried.
pub(super) struct HeadBody {
    pub(super) name: String,
    pub(super) ball: Ball,
    /// From its own frame, in which it is a tool, to the machine's with all axes at 0.
    pub(super) frame: Pose,
    pub(super) shape: HeadShape,
    pub(super) clearance: f64,
}

pub(super) enum HeadShape {
    /// By its elements.
    Round(Vec<Element>),
    Mesh(Tool),
}

/// One body of the head and one that it must not hit.
struct Pair<'a> {
    group: Group<'a>,
    frame: Pose,
    /// A round body around a mesh: where it is free the mesh is.
    around: Option<SolidField>,
}

/// An axis that leaves its range: where it first does, how far on the way that is, and where it is farthest beyond.
pub(super) struct Beyond {
    pub(super) first: OutOfTravel,
    pub(super) fraction: f64,
    pub(super) farthest: f64,
}

/// Pairs that move alike: at the same poses, in the frame of the same level.
struct Alike<'a> {
    ball: Ball,
    level: usize,
    in_world: bool,
    /// With what they must not hit, body by body: where the ball is free of it all of them are.
    pairs: Vec<(SolidVoxels, Vec<Pair<'a>>)>,
}

/// All pairs of one tool.
pub(super) struct MachinePairs<'a> {
    machine: &'a Machine,
    groups: Vec<Alike<'a>>,
    /// From the world to where the machine's coordinates are with the table's axes at 0.
    to_machine: Pose,
    tolerance: f64,
}

impl<'a> MachinePairs<'a> {
    /// `world` is where the part's frame is in the world.
    pub(super) fn new(
        machine: &'a Machine,
        table: &'a [(usize, Body)],
        part: &'a Body,
        fixtures: &'a [Body],
        tool: &Tool,
        settings: &CheckSettings,
        world: &Pose,
    ) -> Result<Self, CheckError> {
        let head_axes = machine.axes_of(Side::Head);
        let below = DVec3::new(0.0, 0.0, -tool.length());
        let room = settings.clearance;
        let most = room.holder.max(room.shank).max(room.cutter);
        let of_tool = |shape, name: &str, clearance| HeadBody {
            name: name.to_owned(),
            ball: Ball { centre: below, radius: tool.reach() + most, level: head_axes },
            frame: Pose::new(below, DQuat::IDENTITY),
            shape,
            clearance,
        };
        let tool_bodies: Vec<HeadBody> = match &tool.shape {
            ToolShape::Revolved(elements) => {
                let offset = tool.offset_elements(&room)?.into_iter().zip(elements);
                let body = |(offset, own): (Element, &Element)| {
                    of_tool(HeadShape::Round(vec![offset]), &own.kind.to_string(), room.of(own.kind))
                };
                offset.map(body).collect()
            }
            ToolShape::Mesh(_) => vec![of_tool(HeadShape::Mesh(tool.clone()), "tool", 0.0)],
        };
        let of_head = machine.solids.iter().filter(|solid| solid.side == Side::Head);
        let head: Vec<HeadBody> =
            of_head.map(|solid| HeadBody::of_solid(solid, room.holder)).collect::<Result<_, _>>()?;
        let table_axes = machine.axes_of(Side::Table);
        let mut groups: Vec<Alike<'_>> = Vec::new();
        let mut add = |own: &[HeadBody], body: &'a Body, level: usize, in_world: bool| {
            let voxels = SolidVoxels::from(body.voxels().clone());
            // Of the head, those that one ball is around move alike: the tool's elements.
            for own in own.chunk_by(|a, b| a.ball == b.ball) {
                let pairs = own.iter().map(|own| own.against(body, &voxels)).collect::<Result<_, _>>()?;
                let pairs = (voxels.clone(), pairs);
                let ball = own[0].ball;
                let alike = |group: &&mut Alike<'_>| {
                    group.ball == ball && (group.level, group.in_world) == (level, in_world)
                };
                match groups.iter_mut().find(alike) {
                    Some(group) => group.pairs.push(pairs),
                    None => groups.push(Alike { ball, level, in_world, pairs: vec![pairs] }),
                }
            }
            Ok::<(), CheckError>(())
        };
        for (level, body) in table {
            add(&tool_bodies, body, *level, false)?;
            add(&head, body, *level, false)?;
        }
        for body in std::iter::once(part).chain(fixtures) {
            add(&head, body, table_axes, true)?;
        }
        let to_machine = HeadBody::to_machine(machine, world);
        Ok(Self { machine, groups, to_machine, tolerance: settings.tolerance })
    }

    /// What collides on a motion, and the axes that leave their ranges.
    pub(super) fn follow(
        &self,
        motion: &Motion<'_>,
        line: usize,
    ) -> Result<(Vec<Collision>, Vec<Beyond>), CheckError> {
        let Some(way) = motion.by_machine() else { return Ok((Vec::new(), Vec::new())) };
        let mut found = Vec::new();
        let mut counts = Vec::new();
        for group in &self.groups {
            let farthest = way.motion_bound(&group.ball, group.level);
            let count = poses_needed(farthest, self.tolerance, line)?;
            let pairs = || group.pairs.iter().flat_map(|(_, pairs)| pairs);
            let mut tracks: Vec<Vec<Track>> = pairs().map(|pair| pair.group.tracks()).collect();
            for index in 1..=count {
                let fraction = index as f64 / count as f64;
                let step = Step { index, fraction, is_last: index == count, length: farthest / count as f64 };
                let moved = self.in_body(group, &way.placement(fraction));
                let middle = moved.of_point(group.ball.centre);
                let mut own = tracks.iter_mut();
                for (voxels, pairs) in &group.pairs {
                    let own = own.by_ref().take(pairs.len());
                    let grid = &voxels.occupancy().grid;
                    let radius = group.ball.radius / grid.pitch + BALL_MARGIN;
                    if voxels.distances().probe(grid.continuous(middle)).squared > radius * radius {
                        // The tracks that are passed over are taken from the iterator.
                        own.for_each(drop);
                        continue;
                    }
                    for (pair, tracks) in pairs.iter().zip(own) {
                        let pose = moved.of_pose(&pair.frame);
                        if pair.around.as_ref().is_none_or(|around| around.collides(&pose)) {
                            pair.group.follow(&step, &pose, tracks, &mut counts);
                        }
                    }
                }
            }
            for hit in tracks.into_iter().flatten().filter_map(Track::finish) {
                found.push(self.in_the_world(group, motion, hit));
            }
        }
        Ok((found, self.beyond(motion, line)?))
    }

    /// The axes that leave their ranges on a motion.
    fn beyond(&self, motion: &Motion<'_>, line: usize) -> Result<Vec<Beyond>, CheckError> {
        let Some(way) = motion.by_machine() else { return Ok(Vec::new()) };
        let count = poses_needed(way.linear_way(), self.tolerance, line)?;
        let mut found: Vec<Beyond> = Vec::new();
        for index in 1..=count {
            let fraction = index as f64 / count as f64;
            for out in self.machine.all_out_of_travel(&way.joints(fraction)) {
                match found.iter_mut().find(|known| known.first.axis == out.axis) {
                    Some(known) => known.farthest = farther(known.farthest, out.value, out.range),
                    None => found.push(Beyond { first: out, fraction, farthest: out.value }),
                }
            }
        }
        Ok(found)
    }

    /// From where the head is with all axes at 0 to the frame of what a group must not hit.
    fn in_body(&self, group: &Alike<'_>, place: &Placement) -> Pose {
        let in_machine = place.table[group.level].inverse().of_pose(&place.head[group.ball.level]);
        if group.in_world { self.to_machine.inverse().of_pose(&in_machine) } else { in_machine }
    }

    /// The tool at that time, and the contact point as it lies against the part then.
    fn in_the_world(&self, group: &Alike<'_>, motion: &Motion<'_>, mut hit: Collision) -> Collision {
        if let (Some(way), false) = (motion.by_machine(), group.in_world) {
            let place = way.placement(hit.fraction);
            let on_table = place.table[group.level].of_point(DVec3::from_array(hit.contact));
            let top = self.machine.axes_of(Side::Table);
            let by_part = place.table[top].inverse().of_point(on_table);
            hit.contact = self.to_machine.inverse().of_point(by_part).to_array();
        }
        motion.with_tool(hit)
    }
}

impl HeadBody {
    pub(super) fn of_solid(solid: &MachineSolid, clearance: f64) -> Result<Self, CheckError> {
        let (lower, upper) = solid.bounds();
        let ball = Ball {
            centre: 0.5 * (lower + upper),
            radius: 0.5 * (upper - lower).length() + clearance * 3f64.sqrt(),
            level: solid.level,
        };
        let (frame, shape) = match &solid.shape {
            SolidShape::Cylinder { base, top, diameter } => {
                let axis = (*top - *base).normalize_or_zero();
                let profile = vec![line(0.0, base.distance(*top), 0.5 * diameter)];
                let element = Element { kind: ElementKind::Holder(0), profile }.offset(clearance);
                let rotation = Pose::along(*base, axis).rotation;
                (Pose::new(*base, rotation), HeadShape::Round(vec![element]))
            }
            SolidShape::Box { lower, upper } => {
                // A larger box holds the offset one.
                let mesh = Mesh::cuboid(*lower - clearance, *upper + clearance);
                centred(&solid.name, &mesh)
            }
            SolidShape::Mesh(mesh) if clearance == 0.0 => centred(&solid.name, mesh),
            SolidShape::Mesh(_) => {
                return Err(CheckError::HeadMesh { name: solid.name.clone() });
            }
        };
        Ok(Self { name: solid.name.clone(), ball, frame, shape, clearance })
    }

    /// From the world to where the machine's coordinates are with the table's axes at 0; `world` is where the part's frame is in it.
    pub(super) fn to_machine(machine: &Machine, world: &Pose) -> Pose {
        let to_part = world.inverse();
        Pose { position: to_part.position + machine.part_zero(), ..to_part }
    }

    fn against<'a>(&self, body: &'a Body, voxels: &SolidVoxels) -> Result<Pair<'a>, CheckError> {
        let voxels = voxels.clone();
        let (field, shape, around) = match &self.shape {
            HeadShape::Round(elements) => {
                let field = SolidField::of_elements(voxels, elements);
                let field = field.ok_or_else(|| CheckError::Outline(self.name.clone()))?;
                (field, Shape::Revolved(elements.iter().map(|e| (e.clone(), true)).collect()), None)
            }
            HeadShape::Mesh(tool) => {
                let around = SolidField::of_elements(voxels.clone(), &[bar_around(tool)]);
                (SolidField::of_tool(voxels, tool), Shape::Mesh(tool.clone()), around)
            }
        };
        let elements = vec![DepthElement { name: self.name.clone(), clearance: self.clearance, shape }];
        let group = Group { field, elements, body };
        Ok(Pair { group, frame: self.frame, around })
    }
}

fn line(from: f64, to: f64, radius: f64) -> Segment {
    Segment::Line { from, to, radius_from: radius, radius_to: radius }
}

/// A mesh as a tool whose tip is in the middle of its box.
fn centred(name: &str, mesh: &Mesh) -> (Pose, HeadShape) {
    let (lower, upper) = mesh.bounds().unwrap_or_default();
    let middle = 0.5 * (lower + upper);
    let mesh = mesh.transformed(&glam::DMat4::from_translation(-middle));
    let unit = crate::unit::LengthUnit::default();
    let tool = Tool {
        name: name.to_owned(),
        unit,
        shape: ToolShape::Mesh(mesh),
        sharp_points: SharpPoints::Tip,
        overall_length: None,
    };
    (Pose::new(middle, DQuat::IDENTITY), HeadShape::Mesh(tool))
}

/// A round bar that holds a mesh tool, a little larger.
pub(super) fn bar_around(tool: &Tool) -> Element {
    let ToolShape::Mesh(mesh) = &tool.shape else {
        return Element { kind: ElementKind::Holder(0), profile: Vec::new() };
    };
    let (lower, upper) = mesh.bounds().unwrap_or_default();
    let room = 1e-6 * (upper - lower).length();
    let radius = tool.rolling_radius() + room;
    Element { kind: ElementKind::Holder(0), profile: vec![line(lower.z - room, upper.z + room, radius)] }
}
