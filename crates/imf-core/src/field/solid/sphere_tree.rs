//! A sphere tree along the tool's axis: "free" where the obstacle stays out of bounding spheres that together cover the tool,
//! "colliding" where a voxel nearest to the axis lies in it.
//!
//! The axis is halved again and again, once for each tool. Every piece has its bounding sphere, around its middle;
//! where the distance transform shows that sphere to be free, the piece is free. Else the solid voxel nearest to the
//! middle is tried with the predicate that defines the tool: one that is inside decides the pose. Else the halves
//! are tried. Pieces that are too short to halve stay open: they must be counted.

use glam::DVec3;

use super::segment::VoxelPose;
use super::voxels::SolidVoxels;
use super::{Body, MAX_SEGMENTS};
use crate::distance::DistanceField;
use crate::tool::Segment;

/// Pieces that a pose may leave open.
pub(super) const OPEN: usize = 48;
/// Depth of the traversal's stack: one entry for each level of the tree, which has no more levels than a body has segments
/// and its length in voxels has bits.
const DEPTH: usize = MAX_SEGMENTS + 32;
/// Added to every bounding radius, in voxels: more than the slack of the tool's predicate and all rounding.
const MARGIN: f64 = 1e-4;

/// A stretch of a body's axis; lengths in voxels.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    /// Height of the bounding sphere's centre.
    middle: f64,
    /// Radius of the bounding sphere.
    radius: f64,
    squared: f64,
    /// Position of the first half, the second follows it; 0 for a piece that is not halved.
    halves: u32,
    /// Which body, and which of its segments where it is not halved.
    pub(super) body: usize,
    pub(super) segment: usize,
    /// Heights.
    pub(super) from: f64,
    pub(super) to: f64,
}

/// A ball in which the tool is known to contain no solid centre; in voxels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FreeBall {
    pub(crate) middle: DVec3,
    pub(crate) radius: f64,
}

impl FreeBall {
    /// True where another ball lies within.
    #[inline]
    fn contains(&self, middle: DVec3, radius: f64) -> bool {
        let left = self.radius - radius;
        left > 0.0 && middle.distance_squared(self.middle) <= left * left
    }
}

/// What the sphere tree decides about a pose.
pub(super) enum Verdict {
    /// No solid voxel in the tool.
    Free,
    /// At least one: this, in whole numbers.
    Colliding([f64; 3]),
    /// So many pieces must be counted; the others are free.
    Open(usize),
    /// More pieces than [`OPEN`] must be counted.
    Undecided,
}

/// The pieces of all bodies.
pub(super) struct SphereTree {
    pieces: Vec<Piece>,
    roots: usize,
}

impl SphereTree {
    pub(super) fn new(bodies: &[Body]) -> Self {
        let mut pieces: Vec<Piece> = Vec::new();
        // Bodies farther from the tip are the wider ones: they are the first to touch.
        for (index, body) in bodies.iter().enumerate().rev() {
            let (Some(first), Some(last)) = (body.parts.first(), body.parts.last()) else { continue };
            pieces.push(piece(bodies, index, first.segment.range().0, last.segment.range().1));
        }
        let roots = pieces.len();
        let mut next = 0;
        while next < pieces.len() {
            let Piece { body, from, to, radius, .. } = pieces[next];
            let parts = &bodies[body].parts;
            let inner = parts.iter().map(|p| p.segment.range().0).filter(|&h| h > from && h < to);
            let middle = 0.5 * (from + to);
            let split = inner.min_by(|a, b| (a - middle).abs().total_cmp(&(b - middle).abs()));
            let length = to - from;
            if split.is_some() || (length > SHORTEST && length * length > SLENDER * radius) {
                let split = split.unwrap_or(middle);
                pieces[next].halves = pieces.len() as u32;
                pieces.push(piece(bodies, body, from, split));
                pieces.push(piece(bodies, body, split, to));
            }
            next += 1;
        }
        Self { pieces, roots }
    }

    pub(super) fn piece(&self, index: u32) -> &Piece {
        &self.pieces[index as usize]
    }

    /// Bounding spheres that together cover the tool, heights of their middles and radii: pieces of a length l with l² at most
    /// `slender` times the radius, or that are not halved.
    pub(super) fn cover(&self, slender: f64) -> Vec<(f64, f64)> {
        let (mut spheres, mut stack) = (Vec::new(), Vec::from_iter(0..self.roots as u32));
        while let Some(index) = stack.pop() {
            let piece = self.piece(index);
            let length = piece.to - piece.from;
            if piece.halves == 0 || length * length <= slender * piece.radius {
                spheres.push((piece.middle, piece.radius));
            } else {
                stack.extend([piece.halves, piece.halves + 1]);
            }
        }
        // The widest are the first to touch.
        spheres.sort_by(|a, b| b.1.total_cmp(&a.1));
        spheres
    }

    /// Tries to decide a pose. Pieces left open are listed in `open`.
    #[inline]
    pub(super) fn decide(
        &self,
        placed: VoxelPose,
        bodies: &[Body],
        distances: &DistanceField,
        free_ball: Option<&FreeBall>,
        open: &mut [u32; OPEN],
    ) -> Verdict {
        let mut stack = [0_u32; DEPTH];
        let mut found = 0;
        let mut last_witness = usize::MAX;
        for root in 0..self.roots as u32 {
            stack[0] = root;
            let mut depth = 1;
            while depth > 0 {
                depth -= 1;
                let index = stack[depth];
                let piece = &self.pieces[index as usize];
                let middle = placed.tip + placed.direction * piece.middle;
                let probe = distances.probe(middle);
                if probe.squared > piece.squared
                    || free_ball.is_some_and(|c| c.contains(middle, piece.radius))
                {
                    continue;
                }
                let Some(witness) = distances.nearest(probe.index) else { return Verdict::Free };
                if witness != last_witness {
                    last_witness = witness;
                    let voxel = distances.voxel(witness);
                    if bodies.iter().any(|body| placed.contains(&body.profile, voxel)) {
                        return Verdict::Colliding(voxel);
                    }
                }
                if piece.halves == 0 {
                    // Counting costs more than looking at all centres around the point.
                    if distances.squared_around(middle) > piece.squared {
                        continue;
                    }
                    if found == OPEN {
                        return Verdict::Undecided;
                    }
                    open[found] = index;
                    found += 1;
                } else {
                    stack[depth] = piece.halves;
                    stack[depth + 1] = piece.halves + 1;
                    depth += 2;
                }
            }
        }
        if found == 0 { Verdict::Free } else { Verdict::Open(found) }
    }

    /// Goes down the tree, with the middle of each piece's sphere in voxels: into the halves of a piece where `enter` says so.
    #[inline(always)]
    fn walk(&self, placed: VoxelPose, mut enter: impl FnMut(&Piece, DVec3) -> bool) {
        let mut stack = [0_u32; DEPTH];
        for root in 0..self.roots as u32 {
            stack[0] = root;
            let mut depth = 1;
            while depth > 0 {
                depth -= 1;
                let piece = &self.pieces[stack[depth] as usize];
                let middle = placed.tip + placed.direction * piece.middle;
                if enter(piece, middle) && piece.halves != 0 {
                    stack[depth] = piece.halves;
                    stack[depth + 1] = piece.halves + 1;
                    depth += 2;
                }
            }
        }
    }

    /// Finds the solid centre nearest to a tool that holds none: `measure` gives the distance of a centre from the tool, in voxels, and the
    /// least of what it gave is the distance.
    pub(super) fn nearest(
        &self,
        placed: VoxelPose,
        voxels: &SolidVoxels,
        mut measure: impl FnMut([f64; 3]) -> f64,
    ) {
        let distances = voxels.distances();
        let (mut least, mut last_witness, mut leaves) = (f64::INFINITY, usize::MAX, Vec::new());
        self.walk(placed, |piece, middle| {
            let probe = distances.probe(middle);
            let bound = probe.squared.sqrt() - piece.radius;
            let Some(witness) = distances.nearest(probe.index).filter(|_| bound < least) else {
                return false;
            };
            if witness != last_witness {
                last_witness = witness;
                least = least.min(measure(distances.voxel(witness)));
            }
            if piece.halves == 0 {
                leaves.push((bound, middle, piece.radius));
            }
            true
        });
        // The nearest centre may be no voxel's nearest: what a piece can reach is tried, the most promising pieces first.
        leaves.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        for (bound, middle, radius) in leaves {
            if bound < least {
                voxels.visit_ball(middle, radius + least, |voxel| {
                    if middle.distance(DVec3::from_array(voxel)) - radius < least {
                        least = least.min(measure(voxel));
                    }
                    radius + least
                });
            }
        }
    }

    /// Finds the solid centre deepest in the tool: `measure` gives the largest depth of the centres that it was given, in voxels, below
    /// zero while the tool held none of them.
    pub(super) fn deepest(
        &self,
        placed: VoxelPose,
        voxels: &SolidVoxels,
        mut measure: impl FnMut([f64; 3]) -> f64,
    ) {
        let distances = voxels.distances();
        let mut most = f64::NEG_INFINITY;
        // The deepest centre may be no voxel's nearest: once those are tried, whatever could be deeper beside a piece is tried.
        for all in [false, true] {
            let mut last_witness = usize::MAX;
            self.walk(placed, |piece, middle| {
                let probe = distances.probe(middle);
                // No centre beside the piece is nearer to the axis than this, and none is deeper than what is left to the outline.
                let half = 0.5 * (piece.to - piece.from);
                let bound = piece.radius - (probe.squared - half * half).max(0.0).sqrt();
                if probe.squared > piece.squared || bound < most {
                    return false;
                }
                let Some(witness) = distances.nearest(probe.index) else { return false };
                if !all {
                    if witness != last_witness {
                        last_witness = witness;
                        most = most.max(measure(distances.voxel(witness)));
                    }
                } else if piece.halves == 0 {
                    let around = |most: f64| (piece.radius - most.max(0.0)).max(0.0).hypot(half + MARGIN);
                    voxels.visit_ball(middle, around(most), |voxel| {
                        let offset = DVec3::from_array(voxel) - middle;
                        let across = offset.length_squared() - offset.dot(placed.direction).powi(2);
                        if across <= (piece.radius - most.max(0.0)).max(0.0).powi(2) {
                            most = most.max(measure(voxel));
                        }
                        around(most)
                    });
                }
                true
            });
        }
    }

    /// Lower bound of the distance from the tool to any solid voxel's centre, in voxels; below zero where the tool may
    /// hold one, and then no lower than minus the depth it may have. No more than `most`.
    pub(super) fn clearance(&self, placed: VoxelPose, distances: &DistanceField, most: f64) -> f64 {
        let mut minimum = most;
        self.walk(placed, |piece, middle| {
            let bound = distances.probe(middle).squared.sqrt() - piece.radius;
            let goes_on = bound < minimum;
            if goes_on && piece.halves == 0 {
                minimum = bound;
            }
            goes_on
        });
        minimum
    }
}

/// Pieces shorter than this many voxels are not halved.
const SHORTEST: f64 = 1.0;
/// A piece of length l is halved while l² exceeds this times its radius: then its sphere sticks out by l²/8r.
const SLENDER: f64 = 1.2;

/// The stretch of a body between two heights with its bounding sphere.
fn piece(bodies: &[Body], body: usize, from: f64, to: f64) -> Piece {
    const STEPS: i32 = 8;
    let middle = 0.5 * (from + to);
    let parts = &bodies[body].parts;
    let mut radius: f64 = 0.0;
    for part in parts {
        let (low, high) = part.segment.range();
        let (low, high) = (low.max(from), high.min(to));
        for step in 0..STEPS {
            let at = |step: i32| low + (high - low) * f64::from(step) / f64::from(STEPS);
            let (low, high) = (at(step), at(step + 1));
            if low < high {
                let away = (low - middle).abs().max((high - middle).abs());
                radius = radius.max(away.hypot(widest(&part.segment, low, high)));
            }
        }
    }
    let radius = radius + MARGIN;
    let holding = |p: &super::Part| p.segment.range().0 <= middle && middle < p.segment.range().1;
    let segment = parts.iter().position(holding).unwrap_or(0);
    Piece { middle, radius, squared: radius * radius, halves: 0, body, segment, from, to }
}

/// Largest radius between two heights within the segment's range.
fn widest(segment: &Segment, from: f64, to: f64) -> f64 {
    let ends = segment.radius(from).max(segment.radius(to));
    match *segment {
        Segment::Line { .. } => ends,
        Segment::Arc { centre_height, .. } => ends.max(segment.radius(centre_height.clamp(from, to))),
    }
}
