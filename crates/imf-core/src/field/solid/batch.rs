//! Many poses at once: spheres against a distance field of one byte a voxel, sixteen poses at a time.
//!
//! A piece of the tool is free where its bounding sphere is, by a lower bound of the distance at its middle. The tool
//! collides where an inscribed sphere holds a solid centre, by an upper bound, or where the solid voxel nearest to a middle
//! lies in it. Pieces that stay open are tried again in short ones, and these once more by small balls beside the axis. What is left,
//! within half a voxel or so of contact, is counted pose by pose. Bytes of a part fit the inner caches; lists of what is open are made without
//! branches that depend on it, since no processor foresees them.

mod beside;
mod lookup;
mod nearest;

use glam::DVec3;

use self::beside::{BallsBeside, find_lines};
use self::lookup::{LEAVES, Leaves, Lookup, Sphere};
use self::nearest::Outline;
use super::inscribed::inscribed_radius;
use super::runs::Lines;
use super::sphere_tree::SphereTree;
use super::{Body, SolidField};
use crate::field::BLOCK;
use crate::parallel::make_once;
use crate::pose::Pose;
use crate::vectorised::vectorised;

/// Poses or pieces that are tried together.
const LANES: usize = 16;
/// Farther from the grid's corner than this, in voxels, single precision is too coarse.
const FARTHEST: f64 = 2000.0;
/// More than all rounding in single precision up to there, in voxels, and than the slack of the tool's predicate.
const SLACK: f32 = 4e-3;
/// Largest length² over radius of the pieces that are tried first: few spheres do best.
const SLENDER: f64 = 40.0;

/// A piece that is tried first, and the short ones that it consists of.
struct Piece {
    sphere: Sphere,
    leaves: Vec<Leaves>,
}

/// A short piece.
struct Leaf {
    /// Its place in the tree.
    piece: u32,
    sphere: Sphere,
    balls: BallsBeside,
}

/// What batches need of one tool.
pub(super) struct BatchSpheres {
    pieces: Vec<Piece>,
    leaves: Vec<Leaf>,
    outline: Outline,
    /// Bytes count distances in units of 1/`parts` voxel.
    parts: u32,
}

impl BatchSpheres {
    pub(super) fn new(bodies: &[Body], tree: &SphereTree) -> Self {
        let sphere = |index: u32| {
            let piece = tree.piece(index);
            let inside = inscribed_radius(&bodies[piece.body], piece.bound.middle);
            let [height, around, inside] =
                [piece.bound.middle, piece.bound.radius, inside].map(|value| value as f32);
            Sphere { height, around, inside }
        };
        let mut level = tree.level(tree.roots(), SLENDER);
        // The widest are the first to touch.
        let radius = |index: u32| tree.piece(index).bound.radius;
        level.sort_by(|&a, &b| radius(b).total_cmp(&radius(a)));
        let (mut pieces, mut leaves) = (Vec::new(), Vec::new());
        for index in level {
            let mut eights = Vec::new();
            for eight in tree.level(index..index + 1, 0.0).chunks(LEAVES) {
                let spheres: Vec<Sphere> = eight.iter().map(|&leaf| sphere(leaf)).collect();
                eights.push(Leaves::new(leaves.len() as u32, &spheres));
                leaves.extend(eight.iter().zip(spheres).map(|(&leaf, sphere)| {
                    let piece = tree.piece(leaf);
                    let balls = BallsBeside::new(piece.from, piece.to, piece.widest(bodies));
                    Leaf { piece: leaf, sphere, balls }
                }));
            }
            pieces.push(Piece { sphere: sphere(index), leaves: eights });
        }
        let widest = pieces.iter().map(|piece| piece.sphere.around).fold(0.0, f32::max);
        let parts = [8, 4, 2, 1].into_iter().find(|&parts| widest + 1.5 < 255.0 / parts as f32).unwrap_or(1);
        Self { pieces, leaves, outline: Outline::new(bodies), parts }
    }
}

/// The bit of a piece; all from the last bit's on share it.
fn bit(piece: usize) -> u32 {
    1 << piece.min(31)
}

/// A position in [`Places`], without a check of its range.
fn at(place: u16) -> usize {
    usize::from(place) & (BLOCK - 1)
}

/// Places of up to [`BLOCK`] poses in voxels, each coordinate by itself.
struct Places {
    tip: [[f32; BLOCK]; 3],
    axis: [[f32; BLOCK]; 3],
    /// Which pose each is.
    pose: [u16; BLOCK],
    /// Which pieces are open, by bits.
    open: [u32; BLOCK],
    /// Known to collide.
    collides: [bool; BLOCK],
    count: usize,
}

impl Places {
    const EMPTY: Self = Self {
        tip: [[0.0; BLOCK]; 3],
        axis: [[0.0; BLOCK]; 3],
        pose: [0; BLOCK],
        open: [0; BLOCK],
        collides: [false; BLOCK],
        count: 0,
    };
}

/// Pieces at places that may hold a solid centre.
#[derive(Default)]
struct Items {
    /// Which place, and which of [`BatchSpheres::pieces`] or of [`BatchSpheres::leaves`].
    listed: Vec<(u16, u32)>,
    /// The solid voxel nearest to the middle of each.
    nearest: Vec<u32>,
    /// What a pass notes of each.
    bits: Vec<u32>,
    /// The lines on which each may hold one.
    lines: Vec<Lines>,
}

/// Working memory of a thread.
#[derive(Default)]
pub(super) struct Scratch {
    pieces: Items,
    leaves: Items,
}

impl SolidField {
    /// [`SolidField::collides`] of every pose; those for which `colliding` is true already are skipped.
    pub(crate) fn collide_all(&self, poses: &[Pose], colliding: &mut [bool]) {
        let bodies = self.bodies();
        let small = self.reach < 0.5 * FARTHEST * self.voxels.occupancy().grid.pitch;
        if bodies.is_empty() || poses.len() < LANES || !small {
            for (pose, colliding) in poses.iter().zip(colliding).filter(|(_, colliding)| !**colliding) {
                *colliding = self.collides(pose);
            }
            return;
        }
        self.workspaces.with(|scratch| self.collide_blocks(bodies, poses, colliding, scratch));
    }

    fn collide_blocks(&self, bodies: &[Body], poses: &[Pose], colliding: &mut [bool], scratch: &mut Scratch) {
        let Scratch { pieces, leaves } = scratch;
        let tree = self.spheres(bodies);
        let spheres = make_once(&self.batch, || BatchSpheres::new(bodies, tree));
        let lookup = Lookup::new(&self.voxels, spheres.parts);
        let mut places = Places::EMPTY;
        for (poses, colliding) in poses.chunks(BLOCK).zip(colliding.chunks_mut(BLOCK)) {
            self.place(poses, colliding, &mut places);
            vectorised!(self.arch, {
                lookup.try_pieces(&spheres.pieces, &mut places);
                pieces.list(&places, spheres.pieces.len());
                lookup.find_nearest(pieces, |piece| spheres.pieces[piece].sphere.height, &places);
                spheres.outline.try_nearest(&lookup, pieces, &mut places);
                lookup.try_leaves(&spheres.pieces, pieces, &mut places, leaves);
                lookup.find_nearest(leaves, |leaf| spheres.leaves[leaf].sphere.height, &places);
                spheres.outline.try_nearest(&lookup, leaves, &mut places);
                lookup.keep_near(leaves, |leaf| spheres.leaves[leaf].sphere, &places);
                find_lines(&lookup, |leaf| &spheres.leaves[leaf].balls, leaves, &places);
            });
            for place in 0..places.count {
                colliding[usize::from(places.pose[place])] = places.collides[place];
            }
            let mut left = leaves.lines.as_slice();
            for open in leaves.listed.chunk_by(|a, b| a.0 == b.0) {
                let (lines, rest) = left.split_at(open.len());
                left = rest;
                let index = usize::from(places.pose[at(open[0].0)]);
                if colliding[index] {
                    continue;
                }
                // By the same steps as a single pose, from here on.
                let piece = |&(_, leaf): &(u16, u32)| spheres.leaves[leaf as usize].piece;
                let pieces = open.iter().map(piece);
                let lines = |asked: u32| {
                    let of = pieces.clone().position(|piece| piece == asked);
                    of.map_or(Lines::ALL, |of| lines[of])
                };
                colliding[index] = self.placed(&poses[index]).is_none_or(|placed| {
                    self.bodies_collide(bodies, placed, None, pieces.clone(), lines, None)
                });
            }
        }
    }

    /// Puts the poses of a block where single precision suffices; the others are decided.
    fn place(&self, poses: &[Pose], colliding: &mut [bool], places: &mut Places) {
        places.count = 0;
        let grid = &self.voxels.occupancy().grid;
        let (origin, per_pitch) = (grid.origin + 0.5 * grid.pitch, 1.0 / grid.pitch);
        for (index, pose) in poses.iter().enumerate() {
            if colliding[index] {
                continue;
            }
            let tip = (pose.position - origin) * per_pitch;
            let q = pose.rotation;
            let squared = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
            let near = tip.abs().cmplt(DVec3::splat(FARTHEST)).all();
            // Far ones, invalid ones, and those with a rotation that is not nearly of length 1, one by one.
            if !(near && (squared - 1.0).abs() < 1e-6) {
                colliding[index] = self.collides(pose);
                continue;
            }
            let axis = DVec3::new(
                2.0 * (q.x * q.z + q.w * q.y),
                2.0 * (q.y * q.z - q.w * q.x),
                q.w * q.w + q.z * q.z - q.x * q.x - q.y * q.y,
            );
            let place = places.count;
            for a in 0..3 {
                places.tip[a][place] = tip[a] as f32;
                places.axis[a][place] = axis[a] as f32;
            }
            places.pose[place] = index as u16;
            places.count += 1;
        }
    }
}

/// Keeps the items, given with their position, for which `keep` is true.
#[inline(always)]
fn keep_items(listed: &mut Vec<(u16, u32)>, keep: impl Fn(usize, u16) -> bool) {
    let mut kept = 0;
    for index in 0..listed.len() {
        let item = listed[index];
        listed[kept] = item;
        kept += usize::from(keep(index, item.0));
    }
    listed.truncate(kept);
}

impl Items {
    /// Lists what is open at places that are not known to collide, piece by piece.
    #[inline(always)]
    fn list(&mut self, places: &Places, pieces: usize) {
        let (mut open, mut count) = ([0_u16; BLOCK], 0);
        for place in 0..places.count {
            open[count & (BLOCK - 1)] = place as u16;
            count += usize::from(!places.collides[place] & (places.open[place] != 0));
        }
        self.listed.clear();
        self.listed.resize(pieces * count + 1, (0, 0));
        let mut listed = 0;
        for piece in 0..pieces {
            for &place in &open[..count] {
                self.listed[listed] = (place, piece as u32);
                listed += usize::from(places.open[at(place)] & bit(piece) != 0);
            }
        }
        self.listed.truncate(listed);
    }
}
