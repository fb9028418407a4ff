//! Part and fixtures against the machine's own solids that do not move with them, as a bed or a column: a part that swings into one.
//!
//! Part and fixtures are seen by the centres of their surface voxels: a pair collides where one lies in a voxel of the solid. Where
//! the two touch with all axes at 0, since the part stands on that solid, a centre must lie deeper than its outermost voxels. A solid, or a
//! piece of one, that lies wholly inside the part is known by a voxel of its own.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;

use super::TableSolid;
use crate::check::elements::Body;
use crate::check::motions::{Motion, look_at_poses, poses_needed};
use crate::check::{Collision, HitBody, LineFault};
use crate::machine::{MachineMotion, Placement};
use crate::pose::Pose;

/// Voxels along the edge of a block.
const BLOCK: usize = 8;
/// From a voxel's centre to its farthest corner, in its edges.
const CORNER: f64 = 0.867;

/// A body that stands on the table. Places are in the world.
pub(super) struct OnTable {
    body: Arc<Body>,
    /// A ball around the centres of all of its voxels.
    middle: DVec3,
    radius: f64,
    /// Centres of its surface voxels, block by block.
    points: Vec<DVec3>,
    blocks: Vec<Block>,
}

/// A block of voxels: its first voxel, a bounding sphere of its solid centres, and the range of its surface centres
/// in `points`.
struct Block {
    first: [usize; 3],
    middle: DVec3,
    radius: f64,
    points: Range<usize>,
}

/// Such a body and a solid of the table.
pub(super) struct TablePair {
    body: Arc<OnTable>,
    /// Axes of the table that carry the solid.
    level: usize,
    solid: Arc<Body>,
    /// A voxel of each piece of the solid.
    seeds: Arc<[usize]>,
}

/// A surface centre of the one in the other: how deep, and where in the world.
type Deepest = (f64, DVec3);

impl OnTable {
    /// `None` of a body without a voxel.
    pub(super) fn new(body: &Arc<Body>) -> Option<Self> {
        let voxels = body.voxels.occupancy();
        let grid = voxels.grid;
        let mut of_block: BTreeMap<[usize; 3], (Vec<DVec3>, Vec<DVec3>)> = BTreeMap::new();
        for index in voxels.solids() {
            let voxel = grid.voxel(index);
            let (all, surface) = of_block.entry(voxel.map(|at| at / BLOCK * BLOCK)).or_default();
            all.push(grid.centre(voxel));
            surface.extend(voxels.is_exposed(index).then(|| grid.centre(voxel)));
        }
        let (mut points, mut blocks) = (Vec::new(), Vec::new());
        for (first, (all, surface)) in of_block {
            let (middle, radius) = ball(&all);
            blocks.push(Block { first, middle, radius, points: points.len()..points.len() + surface.len() });
            points.extend(surface);
        }
        let (middle, radius) = ball(&points);
        (!points.is_empty()).then(|| Self { body: body.clone(), middle, radius, points, blocks })
    }
}

impl OnTable {
    fn centre(&self, index: usize) -> DVec3 {
        let grid = self.body.grid();
        grid.centre(grid.voxel(index))
    }
}

impl TablePair {
    pub(super) fn new(body: &Arc<OnTable>, solid: &TableSolid) -> Self {
        let TableSolid { level, body: own, seeds } = solid;
        Self { body: body.clone(), level: *level, solid: own.clone(), seeds: seeds.clone() }
    }

    /// The body, and the solid.
    pub(super) fn bodies(&self) -> [&HitBody; 2] {
        [&self.body.body.against, &self.solid.against]
    }

    /// How far a ball in the solid's frame may move before a point of it is in a voxel of the solid; at or below 0 where that is not known.
    fn room_of(&self, middle: DVec3, radius: f64) -> f64 {
        self.solid.ball_room(middle, radius, CORNER)
    }

    /// The same of the whole body, by the ball around it; `moved` leads from the world to the solid's frame.
    fn ball_room(&self, moved: &Pose) -> f64 {
        self.room_of(moved.of_point(self.body.middle), self.body.radius)
    }

    /// The solid's voxel that holds a point of its frame.
    fn solid_voxel(&self, point: DVec3) -> Option<usize> {
        let voxels = self.solid.voxels.occupancy();
        let index = voxels.grid.index_at(voxels.grid.continuous(point))?;
        (voxels.solid[index] == 1).then_some(index)
    }

    /// How deep a point of the solid's frame lies in it, by less than the truth, and whether that is deeper than its outermost voxels.
    fn depth(&self, point: DVec3) -> Option<(f64, bool)> {
        let index = self.solid_voxel(point)?;
        let (depth, grid) = (self.solid.depth(index), self.solid.grid());
        let off = point.distance(grid.centre(grid.voxel(index)));
        Some(((depth - off).max(0.0), depth > grid.pitch))
    }

    /// Blocks that may hold a point in a voxel of the solid.
    fn near_blocks(&self, moved: &Pose) -> impl Iterator<Item = &Block> {
        let blocks = self.body.blocks.iter();
        blocks.filter(|block| self.room_of(moved.of_point(block.middle), block.radius) <= 0.0)
    }

    /// True where they overlap; of a pair that touches, by more than the solid's outermost voxels.
    fn collides(&self, moved: &Pose, touches: bool) -> bool {
        if self.ball_room(moved) > 0.0 {
            return false;
        }
        let mut points = self.near_blocks(moved).flat_map(|block| &self.body.points[block.points.clone()]);
        points.any(|&point| self.depth(moved.of_point(point)).is_some_and(|(_, deep)| deep || !touches))
            || self.held_pieces(moved, touches).next().is_some()
    }

    /// The voxels of pieces of the solid whose centres the body holds, with the body's own that does; of a pair that touches, those deeper in
    /// it than its outermost voxels.
    fn held_pieces(&self, moved: &Pose, touches: bool) -> impl Iterator<Item = (usize, usize)> {
        let (back, solid) = (moved.inverse(), self.solid.grid());
        let own = self.body.body.voxels.occupancy();
        self.seeds.iter().filter_map(move |&seed| {
            let point = back.of_point(solid.centre(solid.voxel(seed)));
            let index = own.grid.index_at(own.grid.continuous(point))?;
            let deep = || self.body.body.depth(index) > own.grid.pitch;
            (own.solid[index] == 1 && (!touches || deep())).then_some((seed, index))
        })
    }

    /// How far everything may move before any surface centre is in the solid, 0 where that is not known, and the deepest that is.
    fn look(&self, moved: &Pose, touches: bool) -> (f64, Option<Deepest>) {
        let (mut room, mut deepest): (f64, Option<Deepest>) = (f64::INFINITY, None);
        for block in &self.body.blocks {
            let of_block = self.room_of(moved.of_point(block.middle), block.radius);
            if of_block > 0.0 {
                room = room.min(of_block);
                continue;
            }
            for &point in &self.body.points[block.points.clone()] {
                let there = moved.of_point(point);
                room = room.min(self.room_of(there, 0.0));
                if let Some((depth, deep)) = self.depth(there)
                    && (deep || !touches)
                    && deepest.is_none_or(|(known, _)| depth > known)
                {
                    deepest = Some((depth, point));
                }
            }
        }
        if deepest.is_none() {
            let depth = |(seed, index)| self.solid.depth(seed) + self.body.body.depth(index);
            let of = |(seed, index)| (depth((seed, index)), self.body.centre(index));
            deepest = self.held_pieces(moved, touches).map(of).max_by(|a, b| a.0.total_cmp(&b.0));
            room = if deepest.is_some() { 0.0 } else { room };
        }
        (room.max(0.0), deepest)
    }

    /// The collision on a way on which nothing moves farther than `farthest`; `at` leads from the world to the
    /// solid's frame.
    fn follow(
        &self,
        touches: bool,
        count: u64,
        farthest: f64,
        at: impl Fn(f64) -> Pose,
    ) -> Option<Collision> {
        let (mut poses, mut worst): (u64, Option<(Deepest, f64)>) = (0, None);
        look_at_poses(count, farthest, |_, fraction| {
            let moved = at(fraction);
            let room = self.ball_room(&moved);
            if room > 0.0 {
                return room;
            }
            let (room, deepest) = self.look(&moved, touches);
            poses += u64::from(deepest.is_some());
            worst = match (worst, deepest) {
                (Some(known), Some(found)) if found.0 <= known.0.0 => Some(known),
                (known, found) => found.map(|found| (found, fraction)).or(known),
            };
            room
        });
        let (deepest, fraction) = worst?;
        Some(self.collision(deepest, fraction, poses, &at(fraction)))
    }

    /// The collision that is reported, except for the tool.
    fn collision(&self, (depth, point): Deepest, fraction: f64, poses: u64, moved: &Pose) -> Collision {
        let [element, against] = self.bodies();
        let own = self.body.body.voxels.occupancy();
        let voxels = self.near_blocks(moved).flat_map(|block| {
            (0..BLOCK.pow(3)).filter_map(|step| {
                let steps = [step / BLOCK / BLOCK, step / BLOCK % BLOCK, step % BLOCK];
                let voxel: [usize; 3] = std::array::from_fn(|axis| block.first[axis] + steps[axis]);
                let within = (0..3).all(|axis| voxel[axis] < own.grid.dims[axis]);
                (within && own.solid[own.grid.index(voxel)] == 1).then(|| own.grid.centre(voxel))
            })
        });
        let voxels =
            voxels.filter(|&centre| self.solid_voxel(moved.of_point(centre)).is_some()).count() as u32;
        // A surface voxel's centre is half a pitch below the surface.
        let below = 0.5 * own.grid.pitch;
        Collision {
            element: element.to_string(),
            against: against.clone(),
            clearance: 0.0,
            depth: depth + below,
            depth_in_tool: below,
            contact: point.to_array(),
            position: [f64::NAN; 3],
            axis: [f64::NAN; 3],
            roll: None,
            joints: None,
            fraction,
            voxels,
            volume: f64::from(voxels) * own.grid.voxel_volume(),
            poses,
        }
    }

    /// How deep the body stands in the solid, if deeper than its outermost voxels.
    pub(super) fn depth_at(&self, moved: &Pose) -> Option<f64> {
        if self.ball_room(moved) > 0.0 {
            return None;
        }
        let (depth, _) = self.look(moved, true).1?;
        Some(depth + 0.5 * self.body.body.grid().pitch)
    }
}

/// Part and fixtures with every solid that does not turn with them.
#[derive(Clone)]
pub(super) struct TablePairs {
    pairs: Arc<Vec<TablePair>>,
    /// From the world to where the machine's coordinates are with the table's axes at 0.
    to_machine: Pose,
    /// By pair, whether they touch then.
    touches: Vec<bool>,
    /// By pair and bits of the rotary axes' angles: what is hit while they stand there.
    standing: Arc<Mutex<HashMap<Angles, Option<Collision>>>>,
}

/// A pair by its index, and bits of angles.
type Angles = (usize, [u64; 2]);

impl TablePairs {
    /// `table` has each solid with the axes that carry it, of `axes` in all.
    pub(super) fn new(bodies: &[Arc<Body>], table: &[TableSolid], axes: usize) -> Self {
        let still: Vec<_> = table.iter().filter(|solid| solid.level < axes).collect();
        let bodies = bodies.iter().filter(|_| !still.is_empty());
        let bodies: Vec<_> = bodies.filter_map(|body| OnTable::new(body).map(Arc::new)).collect();
        let pairs = bodies.iter().flat_map(|own| still.iter().map(|solid| TablePair::new(own, solid)));
        let to_machine = Pose::new(DVec3::ZERO, glam::DQuat::IDENTITY);
        Self { pairs: Arc::new(pairs.collect()), to_machine, touches: Vec::new(), standing: Arc::default() }
    }

    /// The same with the world elsewhere on the machine.
    pub(super) fn at(&self, to_machine: &Pose) -> Self {
        // With all axes at 0 all solids stand alike.
        let touches = self.pairs.iter().map(|pair| pair.collides(to_machine, false)).collect();
        Self { pairs: self.pairs.clone(), to_machine: *to_machine, touches, standing: Arc::default() }
    }

    /// Part or fixture and the solid that it hits.
    pub(super) fn first_hit(&self, place: &Placement) -> Option<[&HitBody; 2]> {
        let mut pairs = self.pairs.iter().zip(&self.touches);
        let hit = pairs.find(|(pair, touches)| pair.collides(&self.in_solid(pair, place), **touches));
        Some(hit?.0.bodies())
    }

    /// The collision on a motion.
    pub(super) fn follow(
        &self,
        motion: &Motion<'_>,
        way: &MachineMotion<'_>,
        step: f64,
    ) -> Result<Vec<Collision>, LineFault> {
        let mut found = Vec::new();
        for (index, (pair, &touches)) in self.pairs.iter().zip(&self.touches).enumerate() {
            let middle = self.to_machine.of_point(pair.body.middle);
            let farthest = way.carried_bound(middle, pair.body.radius, pair.level);
            let at = |fraction| self.in_solid(pair, &way.placement(fraction));
            let (hit, count) = if farthest <= 0.0 {
                // As on all motions on which the rotary axes stand so.
                let angles = (index, way.joints(1.0).rotary.map(f64::to_bits));
                (self.while_standing(angles, || pair.follow(touches, 1, 0.0, at)), 1)
            } else if pair.ball_room(&at(0.5)) <= 0.5 * farthest {
                let count = poses_needed(farthest, step)?;
                (pair.follow(touches, count, farthest, at), count)
            } else {
                continue;
            };
            found.extend(hit.map(|hit| motion.with_tool(motion.with_poses(hit, count))));
        }
        Ok(found)
    }

    /// What a pair hits at some angles, checked once.
    fn while_standing(&self, angles: Angles, look: impl FnOnce() -> Option<Collision>) -> Option<Collision> {
        let known = || self.standing.lock().unwrap_or_else(PoisonError::into_inner);
        let found = known().get(&angles).cloned();
        found.unwrap_or_else(|| {
            let hit = look();
            known().insert(angles, hit.clone());
            hit
        })
    }

    /// From the world to the frame of the solid of a pair.
    fn in_solid(&self, pair: &TablePair, place: &Placement) -> Pose {
        place.table[pair.level].inverse().of_pose(&place.table[2]).of_pose(&self.to_machine)
    }
}

/// Around points: the middle of their box, and the farthest of them.
fn ball(points: &[DVec3]) -> (DVec3, f64) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (lower, upper) = points.iter().fold(none, |(low, high), &p| (low.min(p), high.max(p)));
    let middle = 0.5 * (lower + upper);
    (middle, points.iter().map(|point| point.distance(middle)).fold(0.0, f64::max))
}
