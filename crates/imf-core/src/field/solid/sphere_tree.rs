//! A sphere tree along the tool's axis: "free" where the obstacle stays out of bounding spheres that together cover the tool,
//! "colliding" where a voxel nearest to the axis lies in it.
//!
//! The axis is halved again and again, once for each tool. Every piece has its bounding sphere, around its middle or, of a
//! piece of a ball, the ball; where the distance transform shows that sphere to be free, the piece is free. Else the solid voxel nearest to the
//! middle is tried with the predicate that defines the tool: one that is inside decides the pose. Else the halves
//! are tried. Pieces that are too short to halve, and balls, stay open: they must be counted.

use std::ops::Range;

use glam::DVec3;

use super::segment::VoxelPose;
use super::voxels::SolidVoxels;
use super::{Body, MAX_SEGMENTS, Part};
use crate::distance::DistanceField;
use crate::tool::Segment;

/// Pieces that a pose may leave open.
pub(super) const OPEN: usize = 48;
/// Depth of the traversal's stack: one entry for each level of the tree, which has no more levels than a body has segments
/// and its length in voxels has bits.
const DEPTH: usize = MAX_SEGMENTS + 32;
/// Added to every bounding radius, in voxels: more than the slack of the tool's predicate and all rounding.
const MARGIN: f64 = 1e-4;

/// A bounding sphere: height of its middle, and radius.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sphere {
    pub(super) middle: f64,
    pub(super) radius: f64,
    squared: f64,
}

impl Sphere {
    fn new(middle: f64, radius: f64) -> Self {
        let radius = radius + MARGIN;
        Self { middle, radius, squared: radius * radius }
    }
}

/// A stretch of a body's axis; lengths in voxels.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    /// The bounding sphere around its middle.
    sphere: Sphere,
    /// The ball of which it is a piece. It does not stick out beside the piece.
    ball: Option<Sphere>,
    /// The one of the two by which decisions are made.
    pub(super) bound: Sphere,
    /// Position of the first half, the second follows it; 0 for a piece that is not halved.
    halves: u32,
    /// Decisions do not visit its halves: there are none, or it is bounded by its ball.
    last: bool,
    /// Which body, and which of its segments where it is not halved.
    pub(super) body: usize,
    pub(super) segment: usize,
    /// Heights.
    pub(super) from: f64,
    pub(super) to: f64,
}

impl Piece {
    /// Its largest radius.
    pub(super) fn widest(&self, bodies: &[Body]) -> f64 {
        widest(&bodies[self.body].parts[self.segment].segment, self.from, self.to)
    }

    /// True where it is of the same segment and ends at this height.
    pub(super) fn is_below(&self, other: &Self, height: f64) -> bool {
        (self.body, self.segment) == (other.body, other.segment) && self.to == height
    }
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
    /// This number of pieces must be counted; the others are free.
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
            let Piece { body, from, to, sphere, .. } = pieces[next];
            let parts = &bodies[body].parts;
            let inner = parts.iter().map(|p| p.segment.range().0).filter(|&h| h > from && h < to);
            let middle = 0.5 * (from + to);
            let split = inner.min_by(|a, b| (a - middle).abs().total_cmp(&(b - middle).abs()));
            let length = to - from;
            if split.is_some() || (length > SHORTEST && length * length > SLENDER * sphere.radius) {
                let split = split.unwrap_or(middle);
                pieces[next].halves = pieces.len() as u32;
                pieces.push(piece(bodies, body, from, split));
                pieces.push(piece(bodies, body, split, to));
            } else {
                pieces[next].last = true;
            }
            next += 1;
        }
        Self { pieces, roots }
    }

    pub(super) fn piece(&self, index: u32) -> &Piece {
        &self.pieces[index as usize]
    }

    /// Pieces that together are some of them: of a length l with l² at most `slender` times the radius, or that decisions do not
    /// halve.
    pub(super) fn level(&self, pieces: Range<u32>, slender: f64) -> Vec<u32> {
        let (mut level, mut stack) = (Vec::new(), Vec::from_iter(pieces));
        while let Some(index) = stack.pop() {
            let piece = self.piece(index);
            let length = piece.to - piece.from;
            if piece.last || length * length <= slender * piece.sphere.radius {
                level.push(index);
            } else {
                stack.extend([piece.halves, piece.halves + 1]);
            }
        }
        level
    }

    /// The pieces that are whole bodies.
    pub(super) fn roots(&self) -> Range<u32> {
        0..self.roots as u32
    }

    /// Tries to decide a pose by these pieces; the rest of the tool must be known to be free. Pieces left open are listed in `open`.
    #[inline]
    pub(super) fn decide(
        &self,
        placed: VoxelPose,
        bodies: &[Body],
        distances: &DistanceField,
        free_ball: Option<&FreeBall>,
        pieces: impl Iterator<Item = u32>,
        open: &mut [u32; OPEN],
    ) -> Verdict {
        let mut stack = [0_u32; DEPTH];
        let mut found = 0;
        let mut last_witness = usize::MAX;
        for piece in pieces {
            stack[0] = piece;
            let mut depth = 1;
            while depth > 0 {
                depth -= 1;
                let index = stack[depth];
                let piece = &self.pieces[index as usize];
                let sphere = piece.bound;
                let middle = placed.on_axis(sphere.middle);
                let probe = distances.probe(middle);
                if probe.squared > sphere.squared
                    || free_ball.is_some_and(|c| c.contains(middle, sphere.radius))
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
                if piece.last {
                    // Counting costs more than looking at all centres around the point.
                    if distances.squared_around(middle) > sphere.squared {
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

    /// Goes down the tree: into the halves of a piece where `enter` says so.
    #[inline(always)]
    fn walk(&self, mut enter: impl FnMut(&Piece) -> bool) {
        let mut stack = [0_u32; DEPTH];
        for root in self.roots() {
            stack[0] = root;
            let mut depth = 1;
            while depth > 0 {
                depth -= 1;
                let piece = &self.pieces[stack[depth] as usize];
                if enter(piece) && piece.halves != 0 {
                    stack[depth] = piece.halves;
                    stack[depth + 1] = piece.halves + 1;
                    depth += 2;
                }
            }
        }
    }

    /// Finds the solid centre nearest to a tool that holds none: `measure` gives the distance of a centre from the
    /// tool, in voxels, and the minimum of those is the result.
    pub(super) fn nearest(
        &self,
        placed: VoxelPose,
        voxels: &SolidVoxels,
        mut measure: impl FnMut([f64; 3]) -> f64,
    ) {
        let distances = voxels.distances();
        let (mut least, mut last_witness, mut leaves) = (f64::INFINITY, usize::MAX, Vec::new());
        self.walk(|piece| {
            let Sphere { middle, radius, .. } = piece.sphere;
            let middle = placed.on_axis(middle);
            let probe = distances.probe(middle);
            let bound = probe.squared.sqrt() - radius;
            let Some(witness) = distances.nearest(probe.index).filter(|_| bound < least) else {
                return false;
            };
            if witness != last_witness {
                last_witness = witness;
                least = least.min(measure(distances.voxel(witness)));
            }
            if piece.halves == 0 {
                leaves.push((bound, middle, radius));
            }
            true
        });
        // The nearest centre may not be the nearest of any voxel: what a piece can reach is tried, the most promising
        // pieces first.
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
        // The deepest centre may not be the nearest of any voxel: once those are tried, whatever could be deeper
        // beside a piece is tried.
        for all in [false, true] {
            let mut last_witness = usize::MAX;
            self.walk(|piece| {
                let Sphere { middle, radius, squared } = piece.sphere;
                let middle = placed.on_axis(middle);
                let probe = distances.probe(middle);
                // No centre beside the piece is nearer to the axis than this, and none is deeper than what is left to the outline.
                let half = 0.5 * (piece.to - piece.from);
                let bound = radius - (probe.squared - half * half).max(0.0).sqrt();
                if probe.squared > squared || bound < most {
                    return false;
                }
                let Some(witness) = distances.nearest(probe.index) else { return false };
                if !all {
                    if witness != last_witness {
                        last_witness = witness;
                        most = most.max(measure(distances.voxel(witness)));
                    }
                } else if piece.halves == 0 {
                    let around = |most: f64| (radius - most.max(0.0)).max(0.0).hypot(half + MARGIN);
                    voxels.visit_ball(middle, around(most), |voxel| {
                        let offset = DVec3::from_array(voxel) - middle;
                        let across = offset.length_squared() - offset.dot(placed.direction).powi(2);
                        if across <= (radius - most.max(0.0)).max(0.0).powi(2) {
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
        self.walk(|piece| {
            let bound = |sphere: Sphere| {
                distances.probe(placed.on_axis(sphere.middle)).squared.sqrt() - sphere.radius
            };
            let bound = bound(piece.sphere).max(piece.ball.map_or(f64::NEG_INFINITY, bound));
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
/// A ball bounds a piece while its radius is below this times that of the piece's own sphere.
const WIDER: f64 = 1.1;

/// The stretch of a body between two heights with its bounding sphere.
fn piece(bodies: &[Body], body: usize, from: f64, to: f64) -> Piece {
    let parts = &bodies[body].parts;
    let middle = 0.5 * (from + to);
    // A piece that is not halved lies within one segment.
    let segment = parts.iter().rposition(|part| part.segment.range().0 <= middle).unwrap_or(0);
    let sphere = Sphere::new(middle, reach(parts, from, to, middle));
    let ball = parts.iter().find_map(|part| match part.segment {
        Segment::Arc { from: low, to: high, centre_height, centre_radius: 0.0, arc_radius } => {
            (low <= from && to <= high).then(|| Sphere::new(centre_height, arc_radius))
        }
        _ => None,
    });
    let close = ball.filter(|ball| ball.radius < WIDER * sphere.radius);
    let (bound, last) = (close.unwrap_or(sphere), close.is_some());
    Piece { sphere, ball, bound, halves: 0, last, body, segment, from, to }
}

/// Distance of the farthest point of a stretch from a point of the axis.
fn reach(parts: &[Part], from: f64, to: f64, middle: f64) -> f64 {
    const STEPS: i32 = 8;
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
    radius
}

/// Largest radius between two heights within the segment's range.
fn widest(segment: &Segment, from: f64, to: f64) -> f64 {
    let ends = segment.radius(from).max(segment.radius(to));
    match *segment {
        Segment::Line { .. } => ends,
        Segment::Arc { centre_height, .. } => ends.max(segment.radius(centre_height.clamp(from, to))),
    }
}
