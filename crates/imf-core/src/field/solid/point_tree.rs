//! Points of a body's surface beside its voxel centres: a tool that holds one cuts into the body, though it may hold no
//! centre.
//!
//! A tree of boxes, sixteen below each: those that a tool surely stays out of are left out sixteen at a time, in single
//! precision with a margin; points that are left are tried with the predicate that defines the tool.

use glam::DVec3;

use super::Body;
use super::segment::VoxelPose;
use crate::grid::Grid;
use crate::tool::Segment;

/// Boxes below a box, or points in it.
const WIDTH: usize = 16;
/// Nodes that wait, at most: all but one of each level.
const WAITING: usize = 15 * 9;
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

/// Boxes side by side, by coordinate.
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
        // What a box below holds at most: all but the last are full.
        let mut most = 1;
        while most * WIDTH < points.len() {
            most *= WIDTH;
        }
        let holds_points = most == 1;
        let mut pieces = vec![(0, points.len())];
        if holds_points {
            pieces = (0..points.len()).map(|point| (point, point + 1)).collect();
        }
        while let Some(piece) = pieces.iter().position(|(from, to)| to - from > most) {
            let (from, to) = pieces.swap_remove(piece);
            let half = (to - from).div_ceil(most).div_ceil(2) * most;
            halve(&mut points[from..to], half);
            pieces.extend([(from, from + half), (from + half, to)]);
        }
        let at = self.nodes.len();
        let nowhere = [[f32::INFINITY; WIDTH]; 3];
        self.nodes.push(Node { middle: nowhere, half: [[0.0; WIDTH]; 3], below: [0; WIDTH], holds_points });
        for (lane, (from, to)) in pieces.into_iter().enumerate() {
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

    /// All of them.
    pub(crate) fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// A point for which `counts`, of those that lie in `stays_in` and may be in some body at a pose. Those that are no deeper than
    /// `deeper` voxels below its surface, ends included, need not be tried, by body, and that may grow meanwhile; where it is negative,
    /// those that are not so far from the body are tried too.
    #[inline(always)]
    pub(super) fn first_near(
        &self,
        bodies: &[Body],
        placed: VoxelPose,
        stays_in: Option<&HalfSpace>,
        deeper: impl Fn(usize) -> f64,
        counts: impl Fn([f64; 3]) -> bool,
    ) -> Option<[f64; 3]> {
        let mut stack = [0; WAITING];
        let mut waiting = usize::from(!self.nodes.is_empty());
        while waiting > 0 {
            waiting -= 1;
            let node = &self.nodes[stack[waiting] as usize];
            let inside = stays_in.map_or(u32::MAX, |space| node.inside(space));
            if inside == 0 {
                continue;
            }
            let mut near = [0; WIDTH];
            for (at, body) in bodies.iter().enumerate() {
                node.near(body, placed, deeper(at) as f32, &mut near);
            }
            let mut near = bits(&near) & inside;
            while near != 0 {
                let below = node.below[near.trailing_zeros() as usize];
                near &= near - 1;
                if !node.holds_points {
                    stack[waiting] = below;
                    waiting += 1;
                    continue;
                }
                let point = self.points[below as usize].to_array();
                if counts(point) {
                    return Some(point);
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

/// A bit for each lane that is 1.
#[inline(always)]
fn bits(lanes: &[u32; WIDTH]) -> u32 {
    let mut bits = 0;
    for lane in 0..WIDTH {
        bits |= lanes[lane] << lane;
    }
    bits
}

impl Node {
    /// A bit for each box that may hold a point of a half-space.
    #[inline(always)]
    fn inside(&self, space: &HalfSpace) -> u32 {
        let ([x, y, z], [wx, wy, wz]) = (&self.middle, &self.half);
        let (n, offset) = (space.normal.as_vec3(), space.offset as f32);
        let (size, mut inside) = (n.abs(), [0; WIDTH]);
        for i in 0..WIDTH {
            let farthest = wx[i] * size.x + wy[i] * size.y + wz[i] * size.z;
            inside[i] = u32::from(x[i] * n.x + y[i] * n.y + z[i] * n.z + farthest >= offset);
        }
        bits(&inside)
    }

    /// Sets 1 where a body may reach into boxes with what lies deeper below its surface, or above it where that is negative: a box
    /// stays out of that in none of some directions.
    #[inline(always)]
    fn near(&self, body: &Body, placed: VoxelPose, deeper: f32, near: &mut [u32; WIDTH]) {
        let (deeper, above) = (deeper.max(0.0), (-deeper).max(0.0));
        let (Some(first), Some(last)) = (body.parts.first(), body.parts.last()) else { return };
        let bottom = first.segment.range().0 as f32 + deeper;
        let top = last.segment.range().1 as f32 - deeper;
        let ([x, y, z], [wx, wy, wz]) = (&self.middle, &self.half);
        let (tip, a) = (placed.tip.as_vec3(), placed.direction.as_vec3());
        let along = a.abs();
        // Of each box: the height of its middle and its distance from the axis; how far it extends along the axis, and away from it
        // times that distance.
        let (mut height, mut away) = ([0.0; WIDTH], [0.0; WIDTH]);
        let (mut tall, mut wide) = ([0.0; WIDTH], [0.0; WIDTH]);
        for i in 0..WIDTH {
            let (dx, dy, dz) = (x[i] - tip.x, y[i] - tip.y, z[i] - tip.z);
            let up = dx * a.x + dy * a.y + dz * a.z;
            let (ox, oy, oz) = (dx - up * a.x, dy - up * a.y, dz - up * a.z);
            height[i] = up;
            away[i] = (ox * ox + oy * oy + oz * oz).sqrt();
            tall[i] = wx[i] * along.x + wy[i] * along.y + wz[i] * along.z;
            wide[i] = wx[i] * ox.abs() + wy[i] * oy.abs() + wz[i] * oz.abs();
        }
        for part in &body.parts {
            let (from, to) = part.segment.range();
            let (lowest, highest) = (bottom.max(from as f32) - above, top.min(to as f32) + above);
            let (from, to, widest) = (from as f32, to as f32, part.widest as f32 - deeper + above);
            let mut own = [0; WIDTH];
            for i in 0..WIDTH {
                let level = (height[i] + tall[i] >= lowest) & (height[i] - tall[i] <= highest);
                own[i] = u32::from(level & (away[i] * (away[i] - widest) <= wide[i]));
            }
            match part.segment {
                Segment::Line { radius_from, radius_to, .. } if radius_from == radius_to => {}
                Segment::Line { radius_from, radius_to, .. } => {
                    // Across the flank.
                    let (rise, run) = ((radius_to - radius_from) as f32, to - from);
                    let radius = radius_from as f32 - deeper;
                    let (steep, slant) = (rise.abs(), rise.hypot(run) * above);
                    for i in 0..WIDTH {
                        let across = (away[i] - radius) * run - (height[i] - from) * rise;
                        let reached = across * away[i] <= wide[i] * run + (tall[i] * steep + slant) * away[i];
                        own[i] &= u32::from(reached);
                    }
                }
                Segment::Arc { centre_height, centre_radius, arc_radius, .. } => {
                    // The arc is the end of a disc that moves out from the axis; what is deeper is no farther out.
                    let (centre, across, radius) =
                        (centre_height as f32, centre_radius as f32 - deeper, arc_radius as f32 + above);
                    for i in 0..WIDTH {
                        let (up, beyond) = (height[i] - centre, (away[i] - across).max(0.0));
                        let squared = up * up + beyond * beyond;
                        let reached = (squared - radius * squared.sqrt()) * away[i]
                            <= wide[i] * beyond + tall[i] * up.abs() * away[i];
                        own[i] &= u32::from(reached);
                    }
                }
            }
            for i in 0..WIDTH {
                near[i] |= own[i];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::sync::Arc;

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::super::tests::{awkward, random_pose};
    use super::super::{SolidField, SolidVoxels};
    use super::*;
    use crate::occupancy::Occupancy;
    use crate::section::test_shapes::{arc, line, number};
    use crate::tool::{Element, ElementKind, Tool};

    #[test]
    fn the_points_in_a_tool_and_the_deepest_of_them_are_those_of_all() {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let grid = Grid { origin: DVec3::splat(-20.0), pitch: 0.8, dims: [50; 3] };
        let unit = |random: &mut ChaCha8Rng| DVec3::new(number(random), number(random), number(random));
        let points: Vec<DVec3> = (0..4000).map(|_| grid.origin + unit(&mut random) * grid.size()).collect();
        let tree = Arc::new(PointTree::new(points.clone(), &grid));
        let voxels = SolidVoxels::from(Arc::new(Occupancy::empty(grid))).with_surfaces(&[tree]);
        let stepped = [line(0.0, 4.0, 3.0, 3.0), line(4.0, 9.0, 6.0, 2.0), arc(9.0, 12.0, 9.0, 4.0, 5.0)];
        let profiles = [
            stepped.to_vec(),
            awkward().cutter().unwrap().0.profile,
            Tool::paper().cutter().unwrap().0.profile,
        ];
        let (mut held, mut deep) = (0, 0);
        for profile in profiles {
            let element = Element { kind: ElementKind::Cutter, profile };
            let field = SolidField::of_elements(voxels.clone(), std::slice::from_ref(&element)).unwrap();
            let depth = |height: f64, away: f64| element.depth(height, away, true);
            for index in 0..600 {
                let pose = random_pose(&grid, 3, index);
                let (tip, axis) = (pose.position, pose.axis().unwrap());
                let of = |point: [f64; 3]| {
                    let [height, away] = field.along_and_away(tip, axis, point);
                    depth(height, away)
                };
                let all = points.iter().map(|&point| field.voxel_of(point));
                let depths: Vec<f64> =
                    all.filter(|&point| field.contains(tip, axis, point)).map(of).collect();
                let visited = Cell::new(0);
                field.visit_surface(&pose, |_, _, _, _| visited.set(visited.get() + 1));
                assert_eq!(visited.get(), depths.len(), "{index}");
                assert_eq!(field.collides(&pose), !depths.is_empty(), "{index}");
                held += depths.len();
                let most = depths.iter().copied().max_by(f64::total_cmp);
                for enough in [f64::INFINITY, 3.0, 1.0, 0.0] {
                    let found = field.deepest_surface_point(tip, axis, depth, enough).map(of);
                    if let (Some(found), Some(most)) = (found, most)
                        && most > enough
                    {
                        assert!(found > enough, "{index}: {found} {enough}");
                        deep += 1;
                        continue;
                    }
                    assert_eq!(found, most, "{index} {enough}");
                }
            }
        }
        assert!(held > 5000 && deep > 500, "{held} {deep}");
    }
}
