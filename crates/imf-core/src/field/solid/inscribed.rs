//! Lower bound of how far a colliding tool must be moved: spheres inscribed in the tool against the distance
//! transforms.
//!
//! A tool is free after a translation only if every ball inside it is. Let h(p) be the distance from a point to the
//! nearest solid centre, a function that changes no faster than p moves, and B a ball of radius r inside the tool with
//! its middle at c. Freed at q it holds no centre, so h(q) ≥ r. Hence a translation has at least the length r − h(c).
//! Where c lies in the cell of a solid voxel v (its cube), more is known: h ≤ √3/2 in every solid cell. On the way from
//! c to q the first empty cell comes no sooner than depth(v) − |c − v| − √3/2, with depth(v) the distance from v to the
//! nearest empty centre, and from the last point in a solid cell there is r − √3/2 still to go. The two add up, for
//! r > √3/2; a smaller ball may rest within a solid cell. All lengths in voxels.

use super::segment::VoxelPose;
use super::voxels::SolidVoxels;
use super::{Body, Part};
use crate::grid::HALF_DIAGONAL;
use crate::tool::Segment;

/// Spheres stand at most this far apart along the axis.
const STEP: f64 = 0.5;
/// Taken off every radius: more than all rounding.
const MARGIN: f64 = 1e-6;

/// Spheres inscribed in the tool's bodies with their middles on the axis.
pub(super) struct InscribedSpheres {
    /// Heights and radii.
    spheres: Vec<(f64, f64)>,
}

impl InscribedSpheres {
    pub(super) fn new(bodies: &[Body]) -> Self {
        let mut spheres = Vec::new();
        for body in bodies {
            let Some((from, to)) = heights(body) else { continue };
            let steps = ((to - from) / STEP).ceil().clamp(1.0, 1e6) as usize;
            for step in 0..steps {
                let height = from + (to - from) * (step as f64 + 0.5) / steps as f64;
                let radius = inscribed_radius(body, height);
                if radius > 0.0 {
                    spheres.push((height, radius));
                }
            }
        }
        Self { spheres }
    }

    /// Lower bound of the length of every translation that frees the tool, in voxels; 0 where none is proven.
    pub(super) fn bound(&self, placed: VoxelPose, voxels: &SolidVoxels) -> f64 {
        let (distances, obstacle, depths) = (voxels.distances(), voxels.occupancy(), voxels.depths());
        let grid = &obstacle.grid;
        let mut most: f64 = 0.0;
        for &(height, radius) in &self.spheres {
            let middle = placed.on_axis(height);
            let index = distances.probe(middle).index;
            let centre = |index: usize| glam::DVec3::from_array(grid.voxel(index).map(|v| v as f64));
            if let Some(witness) = distances.nearest(index) {
                most = most.max(radius - middle.distance(centre(witness)));
            }
            // The probe's voxel is the nearest one inside the grid: beyond its cell the point lies in no solid cell.
            let off = (middle - centre(index)).abs().max_element();
            if obstacle.solid[index] != 0 && off <= 0.5 && radius > HALF_DIAGONAL {
                let away = f64::from(depths[index]) - middle.distance(centre(index)) - HALF_DIAGONAL;
                most = most.max(away.max(0.0) + radius - HALF_DIAGONAL);
            }
        }
        most
    }
}

/// Radius of a sphere inscribed in a body around the point of the axis at `height`; not above 0 where there is none.
pub(super) fn inscribed_radius(body: &Body, height: f64) -> f64 {
    heights(body).map_or(0.0, |heights| inscribed(&body.parts, heights, height) - MARGIN)
}

/// The lowest and the highest point of a body.
fn heights(body: &Body) -> Option<(f64, f64)> {
    Some((body.parts.first()?.segment.range().0, body.parts.last()?.segment.range().1))
}

/// Radius of a sphere on the axis at `height` that stays inside the body: below its distance to either end and to every
/// piece of the outline (of an arc, to its whole circle).
fn inscribed(parts: &[Part], (from, to): (f64, f64), height: f64) -> f64 {
    let ends = (height - from).min(to - height);
    let distance = |part: &Part| match part.segment {
        Segment::Line { from, to, radius_from, radius_to } => {
            let (along, out) = (to - from, radius_to - radius_from);
            let foot = ((height - from) * along - radius_from * out) / (along * along + out * out);
            let foot = foot.clamp(0.0, 1.0);
            (from + foot * along - height).hypot(radius_from + foot * out)
        }
        Segment::Arc { centre_height, centre_radius, arc_radius, .. } => {
            ((height - centre_height).hypot(centre_radius) - arc_radius).abs()
        }
    };
    parts.iter().map(distance).fold(ends, f64::min)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use crate::field::ExactField;
    use crate::grid::Grid;
    use crate::occupancy::Occupancy;
    use crate::pose::Pose;
    use crate::section::test_shapes::{arc, cylinder, line, orientations, revolved};
    use crate::tool::{ElementKind, Tool};

    /// A bull nose under a cone and a wide collar.
    fn tool() -> Tool {
        revolved([
            (ElementKind::Cutter, vec![arc(0.0, 2.0, 2.0, 1.5, 2.0), line(2.0, 9.0, 3.5, 2.0)]),
            (ElementKind::Holder(0), vec![line(9.0, 19.0, 5.5, 5.5)]),
        ])
    }

    /// A slab of 16 voxels with a groove, and scattered voxels above.
    fn obstacle() -> Occupancy {
        let grid = Grid { origin: DVec3::new(1.0, -2.0, 0.5), pitch: 0.8, dims: [34, 30, 32] };
        Occupancy::of(grid, |[x, y, z]| {
            let groove = (12..20).contains(&x) && z > 7;
            let loose = z > 20 && grid.index([x, y, z]).wrapping_mul(2_654_435_761) >> 9 & 255 == 0;
            (y > 1 && z < 16 && !groove) || loose
        })
    }

    #[test]
    fn no_shorter_translation_frees_the_tool() {
        let (obstacle, tool) = (obstacle(), tool());
        let field = ExactField::new(&obstacle, &tool).unwrap();
        let ways = orientations("fibonacci:40");
        let (low, size) = (obstacle.grid.origin, obstacle.grid.size());
        let (mut proven, mut colliding) = (0, 0);
        for (i, orientation) in orientations("random:400:4").iter().enumerate() {
            let place = |prime: usize| (i * prime % 101) as f64 / 101.0 * 1.4 - 0.2;
            let position = low + size * DVec3::new(place(37), place(53), place(71));
            let pose = Pose::oriented(position, orientation);
            let bound = field.penetration_bound(&pose).unwrap();
            let signed = field.signed_clearance(&pose).unwrap();
            if field.collides(&pose) {
                colliding += 1;
                assert!(signed <= 0.0 && signed == -bound, "{pose:?}");
            } else {
                assert!(bound == 0.0 && signed >= 0.0, "{pose:?}: free, and yet {bound}");
            }
            proven += usize::from(bound > 0.0);
            for (way, length) in ways.iter().flat_map(|way| [0.3, 0.7, 0.999].map(|l| (way, l * bound))) {
                if bound > 0.0 {
                    let moved = Pose { position: pose.position + way.direction() * length, ..pose };
                    assert!(field.collides(&moved), "{pose:?} is free after {length} < {bound}");
                }
            }
        }
        // Contacts shallower than half a voxel's diagonal hold no sphere and are left at 0.
        assert!(colliding > 100 && 10 * proven > 7 * colliding, "{proven} of {colliding}");
    }

    #[test]
    fn a_cylinder_deep_in_a_block_is_as_deep_as_its_spheres_say() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [41; 3] };
        let block = Occupancy { grid, solid: vec![1; grid.len()] };
        let tool = cylinder(4.0, 12.0);
        let field = ExactField::new(&block, &tool).unwrap();
        let position = grid.centre([20, 20, 14]);
        let bound = field.penetration_bound(&Pose::along(position, DVec3::Z)).unwrap();
        // From the middle it has to go 20 sideways for its axis, and its radius, to leave the outermost centres.
        let truth = 20.0 + 4.0;
        assert!(bound <= truth && bound > truth - 2.0 * 0.867 - 0.6, "{bound}");
        // Beside the block, and between nothing.
        let beside = Pose::along(DVec3::new(-9.0, 20.0, 20.0), DVec3::Z);
        assert!(field.signed_clearance(&beside).unwrap() > 3.0);
        let none = Occupancy::empty(grid);
        let field = ExactField::new(&none, &tool).unwrap();
        assert_eq!(field.penetration_bound(&beside), Some(0.0));
        assert_eq!(field.signed_clearance(&beside), Some(f64::INFINITY));
    }
}
