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
use crate::field::solid::SolidField;
use crate::machine::{Ball, Machine, MachineSolid, OutOfTravel, Side, SolidShape, box_mesh};
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
    ball: Ball,
    frame: Pose,
    /// Rotary axes of the table that carry the other, and whether its coordinates are the world's.
    level: usize,
    in_world: bool,
    /// A round body around a mesh: where it is free the mesh is.
    around: Option<SolidField>,
}

/// An axis beyond its range, and how far on the way that is.
type Beyond = (OutOfTravel, f64);

/// All pairs of one tool.
pub(super) struct MachinePairs<'a> {
    machine: &'a Machine,
    pairs: Vec<Pair<'a>>,
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
        let mut pairs = Vec::new();
        for (level, body) in table {
            for own in tool_bodies.iter().chain(&head) {
                pairs.push(own.against(body, *level, false)?);
            }
        }
        for body in std::iter::once(part).chain(fixtures) {
            for own in &head {
                pairs.push(own.against(body, table_axes, true)?);
            }
        }
        let to_machine = HeadBody::to_machine(machine, world);
        Ok(Self { machine, pairs, to_machine, tolerance: settings.tolerance })
    }

    /// What collides on a motion, and the first axis that leaves its range, with how far on the way it does.
    pub(super) fn follow(
        &self,
        motion: &Motion<'_>,
        line: usize,
    ) -> Result<(Vec<Collision>, Option<Beyond>), CheckError> {
        let Some(way) = motion.by_machine() else { return Ok((Vec::new(), None)) };
        let mut found = Vec::new();
        let mut counts = Vec::new();
        for pair in &self.pairs {
            let farthest = way.motion_bound(&pair.ball, pair.level);
            let count = poses_needed(farthest, self.tolerance, line)?;
            let mut tracks = pair.group.tracks();
            for index in 1..=count {
                let fraction = index as f64 / count as f64;
                let pose = self.in_body(pair, motion, fraction);
                if pair.around.as_ref().is_some_and(|around| !around.collides(&pose)) {
                    continue;
                }
                let step = Step { index, fraction, is_last: index == count, length: farthest / count as f64 };
                pair.group.follow(&step, &pose, &mut tracks, &mut counts);
            }
            found.extend(
                tracks.into_iter().filter_map(Track::finish).map(|hit| self.in_the_world(pair, motion, hit)),
            );
        }
        let count = poses_needed(way.linear_way(), self.tolerance, line)?;
        let beyond = (1..=count).find_map(|index| {
            let fraction = index as f64 / count as f64;
            self.machine.out_of_travel(&way.joints(fraction)).map(|axis| (axis, fraction))
        });
        Ok((found, beyond))
    }

    /// A pair's body of the head in the frame of the other.
    fn in_body(&self, pair: &Pair<'_>, motion: &Motion<'_>, fraction: f64) -> Pose {
        let Some(way) = motion.by_machine() else { return pair.frame };
        let place = way.placement(fraction);
        let head = place.head[pair.ball.level].of_pose(&pair.frame);
        let in_machine = place.table[pair.level].inverse().of_pose(&head);
        if pair.in_world { self.to_machine.inverse().of_pose(&in_machine) } else { in_machine }
    }

    /// The tool at that time, and the contact point as it lies against the part then.
    fn in_the_world(&self, pair: &Pair<'_>, motion: &Motion<'_>, mut hit: Collision) -> Collision {
        if let (Some(way), false) = (motion.by_machine(), pair.in_world) {
            let place = way.placement(hit.fraction);
            let on_table = place.table[pair.level].of_point(DVec3::from_array(hit.contact));
            let top = self.machine.axes_of(Side::Table);
            let by_part = place.table[top].inverse().of_point(on_table);
            hit.contact = self.to_machine.inverse().of_point(by_part).to_array();
        }
        let pose = motion.at(hit.fraction);
        hit.position = pose.position.to_array();
        hit.axis = pose.axis().unwrap_or(DVec3::NAN).to_array();
        hit.roll = hit.roll.map(|_| pose.orientation().roll);
        hit
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
                let mesh = box_mesh(*lower - clearance, *upper + clearance);
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

    fn against<'a>(&self, body: &'a Body, level: usize, in_world: bool) -> Result<Pair<'a>, CheckError> {
        let voxels = body.voxels().clone();
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
        Ok(Pair { group, ball: self.ball, frame: self.frame, level, in_world, around })
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
