//! A machine's head and table on the way along a toolpath, and its travel.
//!
//! What the head carries is tested against part, fixtures and the table's solids, the tool against the latter, and
//! part and fixtures against those of the latter that do not turn with them. Each pair is checked in the frame of the
//! body that is hit, at poses of its own, so close that no point of the one moves farther than the step in the frame
//! of the other.

mod carried;
mod on_table;
mod reach;
mod remarks;

pub(super) use carried::HeadBody;
use carried::bar_around;
use on_table::TablePairs;
pub use reach::{MachineFault, MachineReach};
pub use remarks::machine_remarks;

use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::deepest::DepthElement;
use super::elements::{Body, Group, Track, room};
use super::motions::{Motion, Step, look_at_poses, poses_needed};
use super::{CheckError, CheckSettings, Collision, HitBody, LineFault, TravelFault};
use crate::access::{Component, Components, components};
use crate::control::Control;
use crate::field::solid::SolidField;
use crate::machine::{Ball, Machine, Placement, Side, SolidShape};
use crate::occupancy::Occupancy;
use crate::pose::Pose;
use crate::scene::{LostSurface, decided};
use crate::tool::{Element, Tool, ToolShape};

/// Degrees by which an axis turns between two places at which its range is looked at, and the most such places on a line.
const TURN: f64 = 0.1;
const MOST_TURNS: u64 = 10_000;

/// A machine, and the voxels of what its table carries.
#[derive(Clone, Debug)]
pub struct MachineBodies {
    machine: Arc<Machine>,
    table: Vec<TableBody>,
}

/// A solid of the table in voxels, where it is with all axes at 0.
#[derive(Clone, Debug)]
struct TableBody {
    name: String,
    /// Rotary axes of the table that carry it.
    level: usize,
    voxels: Arc<Occupancy>,
    /// A voxel of each of its pieces.
    seeds: Arc<[usize]>,
}

impl MachineBodies {
    /// In the machine's unit, with voxels of `pitch`, or larger ones where these would be too many.
    ///
    /// # Errors
    /// A mesh that does not say what is inside, or of which walls lie between the voxels' centres; the caller's [`Control`] asked to stop.
    pub fn new(machine: Machine, pitch: f64, control: Control<'_>) -> Result<Self, CheckError> {
        let mut table = Vec::new();
        for solid in &machine.solids {
            let is_mesh = matches!(solid.shape, SolidShape::Mesh(_));
            if solid.side == Side::Table || is_mesh {
                let voxels = solid.voxels(pitch, control)?;
                let voxels = decided(&solid.name, voxels)?;
                if let SolidShape::Mesh(mesh) = &solid.shape
                    && let Some(lost) = LostSurface::of(mesh, &voxels.solid, &voxels.solid.grid)
                {
                    let (name, pitch) = (solid.name.clone(), voxels.solid.grid.pitch);
                    return Err(CheckError::LostSolid { name, area: lost.area, at: lost.at, pitch });
                }
                if solid.side == Side::Table {
                    let voxels = voxels.solid;
                    let pieces = seeds(&voxels);
                    let (name, level) = (solid.name.clone(), solid.level);
                    table.push(TableBody { name, level, voxels: Arc::new(voxels), seeds: pieces.into() });
                }
            }
        }
        Ok(Self { machine: Arc::new(machine), table })
    }

    /// The machine.
    #[must_use]
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// The largest pitch of its voxels.
    #[must_use]
    pub fn coarsest_pitch(&self) -> Option<f64> {
        self.table.iter().map(|solid| solid.voxels.grid.pitch).reduce(f64::max)
    }

    /// Bodies thinner than voxels show are refused: those of the table by their own, those of the head by the coarsest, which may
    /// also be the part's.
    pub(super) fn check(&self, pitch: f64) -> Result<(), CheckError> {
        let of_head = self.coarsest_pitch().unwrap_or(pitch).max(pitch);
        for solid in &self.machine.solids {
            let own = self.table.iter().find(|own| solid.side == Side::Table && own.name == solid.name);
            let pitch = own.map_or(of_head, |own| own.voxels.grid.pitch);
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

    fn bodies(&self) -> Vec<TableSolid> {
        let of = |solid: &TableBody| TableSolid {
            level: solid.level,
            body: Body::new(solid.voxels.clone(), HitBody::Machine(solid.name.clone())),
            seeds: solid.seeds.clone(),
        };
        self.table.iter().map(of).collect()
    }
}

/// A voxel of each piece, the nearest to the middle of its box.
fn seeds(voxels: &Occupancy) -> Vec<usize> {
    let Components { pieces, labels } = components(&voxels.grid, |index| voxels.solid[index] == 1);
    let mut nearest = vec![(usize::MAX, 0); pieces.len()];
    for (index, &label) in labels.iter().enumerate().filter(|&(_, &label)| label > 0) {
        let Component { lower, upper, .. } = pieces[label as usize - 1];
        let voxel = voxels.grid.voxel(index);
        let away = |axis: usize| (2 * voxel[axis]).abs_diff(lower[axis] + upper[axis]);
        let own = &mut nearest[label as usize - 1];
        *own = (*own).min(((0..3).map(away).max().unwrap_or(0), index));
    }
    nearest.into_iter().map(|(_, index)| index).collect()
}

/// One body of the head and one that it must not hit.
struct Pair {
    group: Group,
    frame: Pose,
    /// A round body around a mesh: where it is free the mesh is.
    around: Option<SolidField>,
}

/// Pairs that move alike: at the same poses, in the frame of the same level.
struct PairGroup {
    ball: Ball,
    level: usize,
    in_world: bool,
    /// Body by body that they must not hit.
    pairs: Vec<BodyPairs>,
}

/// What must not hit one body: where the ball around all of it is free, all of it is.
struct BodyPairs {
    body: Arc<Body>,
    pairs: Vec<Pair>,
}

/// Something that the table carries.
struct TableSolid {
    /// Rotary axes that do.
    level: usize,
    body: Arc<Body>,
    /// A voxel of each of its pieces.
    seeds: Arc<[usize]>,
}

/// All pairs of one tool.
#[derive(Clone)]
pub(super) struct MachinePairs {
    machine: Arc<Machine>,
    groups: Arc<Vec<PairGroup>>,
    on_table: TablePairs,
    /// From the world to where the machine's coordinates are with the table's axes at 0.
    to_machine: Pose,
    step: f64,
}

impl MachinePairs {
    /// `world` is where the part's frame is in the world.
    pub(super) fn new(
        machine: &MachineBodies,
        bodies: &[Arc<Body>],
        tool: &Tool,
        settings: &CheckSettings,
        world: &Pose,
    ) -> Result<Self, CheckError> {
        let table = machine.bodies();
        let machine = machine.machine.clone();
        let head_axes = machine.axes_of(Side::Head);
        let below = DVec3::new(0.0, 0.0, -tool.length());
        let room = settings.clearance;
        let most = room.holder.max(room.shank).max(room.cutter);
        let of_tool = |measured, round| HeadBody {
            measured,
            round,
            ball: Ball { centre: below, radius: tool.reach() + most, level: head_axes },
            frame: Pose::new(below, DQuat::IDENTITY),
        };
        let tool_bodies: Vec<HeadBody> = match &tool.shape {
            ToolShape::Revolved(_) => {
                let measured = |own: &Element| DepthElement::new(own.clone(), true, room.of(own.kind));
                let offset = tool.offset_elements(&room)?.into_iter();
                offset.map(|own| of_tool(measured(&own), own)).collect()
            }
            ToolShape::Mesh(_) => vec![of_tool(DepthElement::whole(tool), bar_around(tool))],
        };
        let of_head = machine.solids.iter().filter(|solid| solid.side == Side::Head);
        let head: Vec<HeadBody> =
            of_head.map(|solid| HeadBody::of_solid(solid, room.holder)).collect::<Result<_, _>>()?;
        let table_axes = machine.axes_of(Side::Table);
        let mut groups: Vec<PairGroup> = Vec::new();
        let mut add = |own: &[HeadBody], level: usize, body: &Arc<Body>, in_world: bool| {
            // Of the head, those that one ball is around move alike: the tool's elements.
            for own in own.chunk_by(|a, b| a.ball == b.ball) {
                let pairs = own.iter().map(|own| own.against(body)).collect::<Result<_, _>>()?;
                let pairs = BodyPairs { body: body.clone(), pairs };
                let ball = own[0].ball;
                let alike = |group: &&mut PairGroup| {
                    group.ball == ball && (group.level, group.in_world) == (level, in_world)
                };
                match groups.iter_mut().find(alike) {
                    Some(group) => group.pairs.push(pairs),
                    None => groups.push(PairGroup { ball, level, in_world, pairs: vec![pairs] }),
                }
            }
            Ok::<(), CheckError>(())
        };
        for solid in &table {
            add(&tool_bodies, solid.level, &solid.body, false)?;
            add(&head, solid.level, &solid.body, false)?;
        }
        for body in bodies {
            add(&head, table_axes, body, true)?;
        }
        let to_machine = HeadBody::to_machine(&machine, world);
        let on_table = TablePairs::new(bodies, &table, table_axes).at(&to_machine);
        Ok(Self { machine, groups: Arc::new(groups), on_table, to_machine, step: settings.step })
    }

    /// The same with the part's frame elsewhere in the world.
    fn at(&self, world: &Pose) -> Self {
        let to_machine = HeadBody::to_machine(&self.machine, world);
        Self { to_machine, on_table: self.on_table.at(&to_machine), ..self.clone() }
    }

    /// The first two bodies that hit one another.
    fn first_hit(&self, place: &Placement) -> Option<(&str, &HitBody)> {
        self.groups.iter().find_map(|group| {
            let moved = self.in_body(group, place);
            let near = group.pairs.iter().filter(|near| near.ball_room(&group.ball, &moved) <= 0.0);
            let pair = near.flat_map(|near| &near.pairs).find(|pair| pair.collides(&moved))?;
            Some((pair.group.elements[0].name.as_str(), &pair.group.body.against))
        })
    }

    /// What collides on a motion.
    pub(super) fn follow(&self, motion: &Motion<'_>) -> Result<Vec<Collision>, LineFault> {
        let Some(way) = motion.by_machine() else { return Ok(Vec::new()) };
        let half = way.placement(0.5);
        let mut found = Vec::new();
        for group in self.groups.iter() {
            let farthest = way.motion_bound(&group.ball, group.level);
            let count = poses_needed(farthest, self.step)?;
            let half = self.in_body(group, &half);
            for near in &group.pairs {
                if near.ball_room(&group.ball, &half) <= 0.5 * farthest {
                    let at = |fraction| self.in_body(group, &way.placement(fraction));
                    let hits = near.follow(&group.ball, count, farthest, at);
                    found.extend(
                        hits.into_iter()
                            .map(|hit| self.in_the_world(group, motion, motion.with_poses(hit, count))),
                    );
                }
            }
        }
        found.extend(self.on_table.follow(motion, way, self.step)?);
        Ok(found)
    }

    /// The axes that leave their ranges on a motion.
    pub(super) fn beyond(&self, motion: &Motion<'_>, line: usize) -> Result<Vec<TravelFault>, LineFault> {
        let Some(way) = motion.by_machine() else { return Ok(Vec::new()) };
        let farthest = way.linear_way();
        let [from, to] = [0.0, 1.0].map(|fraction| way.joints(fraction).rotary);
        let turned = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
        let turns = ((turned / TURN).ceil() as u64).min(MOST_TURNS);
        let count = poses_needed(farthest, self.step)?.max(turns);
        let mut found = Vec::new();
        let turns_within_range = way.turns_within_range();
        if turns_within_range && self.machine.room_in_travel(way.joints(0.5).linear) > 0.5 * farthest {
            return Ok(found);
        }
        look_at_poses(count, farthest, |_, fraction| {
            let joints = way.joints(fraction);
            for out in self.machine.all_out_of_travel(&joints) {
                let (axis, value) = (out.axis, out.value);
                let range = out.range.map(|end| end.is_finite().then_some(end));
                TravelFault { line, axis, value, farthest: value, range, fraction }.add_to(&mut found);
            }
            if turns_within_range { self.machine.room_in_travel(joints.linear) } else { 0.0 }
        });
        Ok(found)
    }

    /// From where the head is with all axes at 0 to the frame of what a group must not hit.
    fn in_body(&self, group: &PairGroup, place: &Placement) -> Pose {
        let in_machine = place.table[group.level].inverse().of_pose(&place.head[group.ball.level]);
        if group.in_world { self.to_machine.inverse().of_pose(&in_machine) } else { in_machine }
    }

    /// The tool at that time, and the contact point as it lies against the part then.
    fn in_the_world(&self, group: &PairGroup, motion: &Motion<'_>, mut hit: Collision) -> Collision {
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

impl BodyPairs {
    /// How far the ball may move before it meets the body; at or below 0 where that is not known.
    fn ball_room(&self, ball: &Ball, moved: &Pose) -> f64 {
        self.body.ball_room(moved.of_point(ball.centre), ball.radius, 0.0)
    }

    /// What collides on a way, on which nothing moves farther than `farthest`.
    fn follow(&self, ball: &Ball, count: u64, farthest: f64, at: impl Fn(f64) -> Pose) -> Vec<Collision> {
        let mut tracks: Vec<Vec<Track>> = self.pairs.iter().map(|pair| pair.group.tracks()).collect();
        let mut counts = Vec::new();
        look_at_poses(count, farthest, |index, fraction| {
            let moved = at(fraction);
            let room = self.ball_room(ball, &moved);
            if room > 0.0 {
                return room;
            }
            let step = Step { index, fraction, is_last: index == count, length: farthest / count as f64 };
            let look = |(pair, tracks): (&Pair, &mut Vec<Track>)| {
                pair.look(&step, &moved.of_pose(&pair.frame), tracks, &mut counts, farthest)
            };
            self.pairs.iter().zip(&mut tracks).map(look).fold(f64::INFINITY, f64::min)
        });
        tracks.into_iter().flatten().filter_map(Track::finish).collect()
    }
}

impl Pair {
    fn collides(&self, moved: &Pose) -> bool {
        let pose = moved.of_pose(&self.frame);
        self.around.as_ref().is_none_or(|around| around.collides(&pose)) && self.group.field.collides(&pose)
    }

    /// Checks a pose in the body's frame and returns the room there.
    fn look(&self, step: &Step, pose: &Pose, tracks: &mut [Track], counts: &mut Vec<u32>, most: f64) -> f64 {
        match self.around.as_ref().and_then(|around| room(around, pose, most)) {
            Some(room) if room > 0.0 => room,
            _ => self.group.follow(step, pose, tracks, counts, most),
        }
    }
}
