//! Whether a tool that is a closed mesh holds a solid voxel's centre or a point of a surface, asked in its own frame: of a pose few of them
//! have to be looked at, where the tool's voxels would all have to be made anew.

use std::ops::Range;

use glam::DVec3;
use pulp::Arch;

use super::Body;
use super::point_tree::PointTree;
use super::segment::VoxelPose;
use crate::mesh::Mesh;
use crate::mesh::crossings::CrossingIndex;
use crate::occupancy::Occupancy;
use crate::pose::Pose;
use crate::tool::{ASIDE, Element, ElementKind, Segment, snapped};
use crate::vectorised::vectorised;
use crate::voxelize::{BESIDE, openings};

/// Cylinders around a mesh, one above the other, at most.
const CYLINDERS: usize = 32;

/// A closed mesh, prepared to be asked.
pub(super) struct ClosedMesh {
    crossings: CrossingIndex,
    lower: DVec3,
    upper: DVec3,
    /// It lies in this body.
    around: Option<Body>,
}

impl ClosedMesh {
    /// Among voxels of a pitch. `None` of an open mesh, whose winding numbers are no whole numbers.
    pub(super) fn new(mesh: &Mesh, pitch: f64) -> Option<Self> {
        let (lower, upper) = mesh.bounds()?;
        openings(mesh).is_none().then(|| Self {
            crossings: CrossingIndex::new(mesh.all_corners()),
            lower,
            upper,
            around: Body::new(&Element { kind: ElementKind::Cutter, profile: cylinders(mesh) }, pitch),
        })
    }

    /// Whether the tool at a valid pose holds one of these points, which are given in voxels.
    pub(super) fn holds_point(&self, points: &PointTree, placed: VoxelPose, pose: &Pose, arch: Arch) -> bool {
        let back = pose.orientation().rotation().transpose();
        let is_held = |point: [f64; 3]| {
            let local = back * (DVec3::from_array(point) - placed.tip) * placed.pitch;
            self.crossings.winding_number(local) != 0
        };
        let around = self.around.as_slice();
        vectorised!(arch, points.first_near(around, placed, None, |_| 0.0, is_held)).is_some()
    }

    /// Whether the tool at a valid pose holds a solid voxel's centre; of those on its surface as [`crate::tool::Tool::count_inside`] says.
    pub(super) fn holds_any(&self, obstacle: &Occupancy, pose: &Pose) -> bool {
        let (grid, tip) = (&obstacle.grid, snapped(&obstacle.grid, pose.position));
        let turn = pose.orientation().rotation();
        let back = turn.transpose();
        let local = |voxel: DVec3| (back * (voxel - tip + BESIDE) + ASIDE) * grid.pitch;
        // The corners of its own box, in voxels.
        let corners = (0..8).map(|corner| {
            let pick = |axis: usize| [self.lower, self.upper][corner >> axis & 1][axis];
            tip + turn * DVec3::new(pick(0), pick(1), pick(2)) / grid.pitch
        });
        let (low, high) = corners
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
        let range = |axis: usize| {
            let clamp = |at: f64| at.clamp(0.0, grid.dims[axis] as f64) as usize;
            clamp(low[axis].floor())..clamp(high[axis].ceil() + 1.0)
        };
        let step = back * DVec3::Z * grid.pitch;
        range(0).flat_map(|x| range(1).map(move |y| (x, y))).any(|(x, y)| {
            let start = local(DVec3::new(x as f64, y as f64, 0.0));
            let within = self.within(start, step, range(2));
            let first = grid.index([x, y, 0]);
            let line = &obstacle.solid[first + within.start..first + within.end];
            let mut solid = line.iter().zip(within).filter(|(solid, _)| **solid != 0);
            solid.any(|(_, z)| {
                let point = local(DVec3::new(x as f64, y as f64, z as f64));
                self.crossings.winding_number(point) != 0
            })
        })
    }

    /// The places along a line, of those in a range, that its box may hold; one more at either end.
    fn within(&self, start: DVec3, step: DVec3, range: Range<usize>) -> Range<usize> {
        let (mut from, mut to) = (range.start as f64, range.end as f64);
        for axis in 0..3 {
            let (low, high) = (self.lower[axis] - start[axis], self.upper[axis] - start[axis]);
            if step[axis].abs() > 1e-9 {
                let (a, b) = (low / step[axis], high / step[axis]);
                (from, to) = (from.max(a.min(b) - 1.0), to.min(a.max(b) + 2.0));
            }
        }
        let from = (from.max(0.0) as usize).clamp(range.start, range.end);
        from..(to.max(0.0) as usize).clamp(from, range.end)
    }
}

/// Cylinders about the tool's axis, one above the other, that hold a closed mesh.
fn cylinders(mesh: &Mesh) -> Vec<Segment> {
    let Some((lower, upper)) = mesh.bounds() else { return Vec::new() };
    let height = (upper.z - lower.z) / CYLINDERS as f64;
    let mut radii = [0.0_f64; CYLINDERS];
    for [a, b, c] in mesh.all_corners() {
        for (low, high) in [(a, b), (b, c), (c, a)].map(|(p, q)| if p.z <= q.z { (p, q) } else { (q, p) }) {
            let place = |z: f64| (((z - lower.z) / height).max(0.0) as usize).min(CYLINDERS - 1);
            // The ends of a level edge are those of others.
            if low.z == high.z {
                continue;
            }
            // A hair beyond both ends, which may lie in the next one by rounding.
            for cylinder in place(low.z - 1e-9 * height)..=place(high.z + 1e-9 * height) {
                let between = |level: f64| {
                    let part = (lower.z + level * height - low.z) / (high.z - low.z);
                    low.lerp(high, part.clamp(0.0, 1.0))
                };
                for end in [between(cylinder as f64), between(cylinder as f64 + 1.0)] {
                    radii[cylinder] = radii[cylinder].max(end.truncate().length());
                }
            }
        }
    }
    let from = |cylinder: usize| lower.z + cylinder as f64 * height;
    (0..CYLINDERS).map(|own| Segment::cylinder(from(own), from(own + 1), radii[own])).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::field::solid::{SolidField, SolidVoxels};
    use crate::grid::Grid;
    use crate::parts::shell::{Axis, Shell};
    use crate::section::test_shapes::orientations;
    use crate::tool::{Tool, ToolShape};
    use crate::voxelize::winding_number;

    /// An L that leans over its axis.
    fn leaning() -> Mesh {
        let corners = [[-1.0, -2.0], [8.0, -2.0], [8.0, 0.5], [2.0, 0.5], [2.0, 3.0], [-1.0, 3.0]];
        let mut shell = Shell::default();
        shell.prism(Axis::Y, &corners.map(glam::DVec2::from_array), [0.0, 4.0]);
        shell.into_mesh()
    }

    #[test]
    fn points_of_surfaces_are_held_as_winding_numbers_say() {
        let (mesh, grid) = (leaning(), Grid { origin: DVec3::splat(-8.0), pitch: 0.5, dims: [32; 3] });
        let points: Vec<DVec3> = (0..200)
            .map(|i| DVec3::new(0.618, 0.755, 0.57).map(|step| (f64::from(i) * step).fract() * 16.0 - 8.0))
            .collect();
        let tool = Tool { shape: ToolShape::Mesh(mesh.clone()), ..Tool::paper() };
        let mut outcomes = [0, 0];
        for (index, orientation) in orientations("so3:300").iter().enumerate() {
            let point = points[index % points.len()];
            let tree = Arc::new(PointTree::new(vec![point], &grid));
            let voxels = SolidVoxels::from(Arc::new(Occupancy::empty(grid))).with_surfaces(&[tree]);
            let field = SolidField::of_tool(voxels, &tool);
            let tip =
                point - DVec3::new(0.31, 0.87, 0.45).map(|step| (index as f64 * step).fract() * 6.0 - 1.0);
            let turned = mesh.transformed(&glam::DMat4::from_mat3(orientation.rotation()));
            let expected = winding_number(&turned, point - tip).abs() > 0.5;
            assert_eq!(field.mesh_holds_a_point(&Pose::oriented(tip, orientation)), expected, "{index}");
            outcomes[usize::from(expected)] += 1;
        }
        assert!(outcomes.iter().all(|&count| count > 30), "{outcomes:?}");
    }

    #[test]
    fn the_cylinders_hold_the_mesh_and_little_more() {
        let mesh = Mesh::revolved(&[[-2.0, 1.0], [5.0, 1.0], [5.0, 4.0], [9.0, 2.0]], 200);
        for segment in cylinders(&mesh) {
            let (from, to) = segment.range();
            let own = |z: f64| if z < 5.0 { 1.0 } else { 4.0 - 0.5 * (z - 5.0) };
            let (low, high) = (
                own(from).max(own(to)),
                own(from).max(own(to)).max(if from <= 5.0 && to >= 5.0 { 4.0 } else { 0.0 }),
            );
            let radius = segment.max_radius();
            assert!(radius > 0.999 * low && radius < high + 1e-9, "{from} {to}: {radius}");
        }
    }
}
