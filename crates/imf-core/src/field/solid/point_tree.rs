//! Points of a body's surface beside its voxel centres: a tool that holds one cuts into the body, though it may hold no
//! centre.
//!
//! A tree of boxes, eight below each: those that a tool surely stays out of are left out eight at a time, in single
//! precision with a margin; points that are left are tried with the predicate that defines the tool.

use glam::DVec3;

use super::Body;
use super::segment::VoxelPose;
use crate::grid::Grid;
use crate::tool::Segment;

/// Boxes below a box, or points in it.
const WIDTH: usize = 8;
/// Nodes that wait, at most: seven on each level but the last.
const WAITING: usize = 7 * 12;
/// Boxes are wider by this many voxels, and by as much for each voxel of the grid's size: more than single precision rounds.
const MARGIN: [f32; 2] = [1e-3, 1e-6];

/// A half-space, in continuous voxel coordinates: `normal · p ≥ offset`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HalfSpace {
    pub(crate) normal: DVec3,
    pub(crate) offset: f64,
}

/// Points in continuous voxel coordinates.
#[derive(Debug)]
pub(crate) struct PointTree {
    points: Vec<DVec3>,
    nodes: Vec<Node>,
    margin: f32,
}

type Lanes = [f32; WIDTH];

/// Eight boxes, by coordinate.
#[derive(Clone, Debug)]
struct Node {
    middle: [Lanes; 3],
    half: [Lanes; 3],
    /// Of each box: its node, or of a point its place. Boxes that are not there lie nowhere near.
    below: [u32; WIDTH],
    holds_points: bool,
}

impl PointTree {
    /// Of points in the world, on a grid.
    pub(crate) fn new(points: Vec<DVec3>, grid: &Grid) -> Self {
        let points: Vec<DVec3> = points.into_iter().map(|point| grid.continuous(point)).collect();
        let farthest = points.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let margin = MARGIN[0] + MARGIN[1] * farthest as f32;
        let mut tree = Self { points, nodes: Vec::new(), margin };
        if !tree.points.is_empty() {
            let mut points = std::mem::take(&mut tree.points);
            tree.divide(&mut points, 0);
            tree.points = points;
        }
        tree
    }

    /// Adds the node of some points, the first of which is `first` of all, and what is below; sorts the points.
    fn divide(&mut self, points: &mut [DVec3], first: usize) -> u32 {
        let mut pieces = vec![(0, points.len())];
        while pieces.len() < WIDTH && points.len() > WIDTH {
            let mut halves = Vec::with_capacity(2 * pieces.len());
            for (from, to) in pieces {
                let half = (to - from).div_ceil(2);
                halve(&mut points[from..to], half);
                halves.extend([(from, from + half), (from + half, to)]);
            }
            pieces = halves;
        }
        let holds_points = points.len() <= WIDTH;
        if holds_points {
            pieces = (0..points.len()).map(|point| (point, point + 1)).collect();
        }
        let at = self.nodes.len();
        let nowhere = [[f32::INFINITY; WIDTH]; 3];
        self.nodes.push(Node { middle: nowhere, half: [[0.0; WIDTH]; 3], below: [0; WIDTH], holds_points });
        for (lane, (from, to)) in pieces.into_iter().enumerate().filter(|(_, (from, to))| from < to) {
            let own = &mut points[from..to];
            let (low, high) = bounds(own);
            let below = if holds_points { (first + from) as u32 } else { self.divide(own, first + from) };
            let node = &mut self.nodes[at];
            node.below[lane] = below;
            for axis in 0..3 {
                node.middle[axis][lane] = (0.5 * (low[axis] + high[axis])) as f32;
                node.half[axis][lane] = (0.5 * (high[axis] - low[axis])) as f32 + self.margin;
            }
        }
        at as u32
    }

    /// A point that some of the bodies hold at a pose, by the predicate that defines the tool, and for which `counts`. They must
    /// lie in `stays_in`.
    #[inline(always)]
    pub(super) fn first_in(
        &self,
        bodies: &[Body],
        placed: VoxelPose,
        stays_in: Option<&HalfSpace>,
        counts: impl Fn([f64; 3]) -> bool,
    ) -> Option<[f64; 3]> {
        let mut stack = [0; WAITING];
        let mut waiting = usize::from(!self.nodes.is_empty());
        while waiting > 0 {
            waiting -= 1;
            let node = &self.nodes[stack[waiting] as usize];
            let mut near = 0;
            for body in bodies {
                near |= node.near(body, placed);
            }
            if let Some(space) = stays_in
                && near != 0
            {
                near &= node.inside(space);
            }
            while near != 0 {
                let below = node.below[near.trailing_zeros() as usize];
                near &= near - 1;
                if !node.holds_points {
                    stack[waiting] = below;
                    waiting += 1;
                    continue;
                }
                let point = self.points[below as usize].to_array();
                for body in bodies {
                    if placed.contains(&body.profile, point) && counts(point) {
                        return Some(point);
                    }
                }
            }
        }
        None
    }
}

fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    (low, points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max))
}

/// Sorts points by the longest side of their box, as far as the first `half` come before the others.
fn halve(points: &mut [DVec3], half: usize) {
    let (low, high) = bounds(points);
    let axis = (high - low).max_position();
    if half < points.len() {
        points.select_nth_unstable_by(half, |a, b| a[axis].total_cmp(&b[axis]));
    }
}

/// A bit for each lane.
#[inline(always)]
fn bits(lanes: [bool; WIDTH]) -> u32 {
    let mut bits = 0;
    for (lane, set) in lanes.into_iter().enumerate() {
        bits |= u32::from(set) << lane;
    }
    bits
}

impl Node {
    #[inline(always)]
    fn each<T: Copy + Default>(value: impl Fn(usize) -> T) -> [T; WIDTH] {
        let mut all = [T::default(); WIDTH];
        for (lane, own) in all.iter_mut().enumerate() {
            *own = value(lane);
        }
        all
    }

    /// Which boxes may hold a point of a half-space.
    #[inline(always)]
    fn inside(&self, space: &HalfSpace) -> u32 {
        let ([x, y, z], [wx, wy, wz]) = (&self.middle, &self.half);
        let (n, offset) = (space.normal.as_vec3(), space.offset as f32);
        let size = n.abs();
        let farthest = Self::each(
            #[inline(always)]
            |i| x[i] * n.x + y[i] * n.y + z[i] * n.z + wx[i] * size.x + wy[i] * size.y + wz[i] * size.z,
        );
        bits(Self::each(
            #[inline(always)]
            |i| farthest[i] >= offset,
        ))
    }

    /// Which boxes a body may reach into: none of some directions in which a box stays out of it does.
    #[inline(always)]
    fn near(&self, body: &Body, placed: VoxelPose) -> u32 {
        let ([x, y, z], [wx, wy, wz]) = (&self.middle, &self.half);
        let (tip, a) = (placed.tip.as_vec3(), placed.direction.as_vec3());
        let along = a.abs();
        let height = Self::each(
            #[inline(always)]
            |i| (x[i] - tip.x) * a.x + (y[i] - tip.y) * a.y + (z[i] - tip.z) * a.z,
        );
        // The way out from the axis.
        let out = [
            Self::each(
                #[inline(always)]
                |i| x[i] - tip.x - height[i] * a.x,
            ),
            Self::each(
                #[inline(always)]
                |i| y[i] - tip.y - height[i] * a.y,
            ),
            Self::each(
                #[inline(always)]
                |i| z[i] - tip.z - height[i] * a.z,
            ),
        ];
        let away = Self::each(
            #[inline(always)]
            |i| (out[0][i] * out[0][i] + out[1][i] * out[1][i] + out[2][i] * out[2][i]).sqrt(),
        );
        let tall = Self::each(
            #[inline(always)]
            |i| wx[i] * along.x + wy[i] * along.y + wz[i] * along.z,
        );
        // Times the distance from the axis.
        let wide = Self::each(
            #[inline(always)]
            |i| wx[i] * out[0][i].abs() + wy[i] * out[1][i].abs() + wz[i] * out[2][i].abs(),
        );
        let mut near = 0;
        for part in &body.parts {
            let (from, to) = part.segment.range();
            let (from, to, widest) = (from as f32, to as f32, part.widest as f32);
            let reached = Self::each(
                #[inline(always)]
                |i| {
                    height[i] + tall[i] >= from
                        && height[i] - tall[i] <= to
                        && away[i] * (away[i] - widest) <= wide[i]
                },
            );
            let mut own = bits(reached);
            if own & !near == 0 {
                continue;
            }
            match part.segment {
                Segment::Line { radius_from, radius_to, .. } if radius_from == radius_to => {}
                Segment::Line { radius_from, radius_to, .. } => {
                    // Across the flank.
                    let (rise, run) = ((radius_to - radius_from) as f32, to - from);
                    let radius = radius_from as f32;
                    let steep = rise.abs();
                    own &= bits(Self::each(
                        #[inline(always)]
                        |i| {
                            let across = (away[i] - radius) * run - (height[i] - from) * rise;
                            across * away[i] <= wide[i] * run + tall[i] * steep * away[i]
                        },
                    ));
                }
                Segment::Arc { centre_height, centre_radius, arc_radius, .. } => {
                    // The arc is the end of a disc that moves out from the axis.
                    let (centre, across, radius) =
                        (centre_height as f32, centre_radius as f32, arc_radius as f32);
                    own &= bits(Self::each(
                        #[inline(always)]
                        |i| {
                            let (up, beyond) = (height[i] - centre, away[i] - across);
                            let beyond = if beyond > 0.0 { beyond } else { 0.0 };
                            let squared = up * up + beyond * beyond;
                            let distance = squared.sqrt();
                            (squared - radius * distance) * away[i]
                                <= wide[i] * beyond + tall[i] * up.abs() * away[i]
                        },
                    ));
                }
            }
            near |= own;
        }
        near
    }
}
