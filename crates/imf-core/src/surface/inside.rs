//! Balls inside a mesh tool: one that holds a solid centre says at once that the tool collides.

use glam::DVec3;

use crate::field::solid::SolidVoxels;
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::mesh::distance::distance_to_mesh;
use crate::mesh::topology::boundary_chain;
use crate::pose::Pose;
use crate::voxelize::voxelize;

/// Maximum number of balls, the largest first.
const MOST: usize = 64;
/// Sampled places for one ball, and computed distances to triangles for all.
const PLACES: f64 = 8e3;
const DISTANCES: f64 = 2e7;
/// A ball this far inside another one, in fractions of that one's radius, adds little.
const APART: f64 = 0.5;
/// Taken off every radius, in voxels: more than centres are set aside where they lie on a mesh.
const MARGIN: f64 = 1e-4;

/// Middles in the tool's frame, and radii, in the grid's unit; none of an open mesh.
pub(super) struct InnerBalls(Vec<(DVec3, f64)>);

impl InnerBalls {
    pub(super) fn new(mesh: &Mesh, pitch: f64) -> Self {
        let Some((lower, upper)) = mesh.bounds().filter(|_| boundary_chain(mesh).is_empty()) else {
            return Self(Vec::new());
        };
        let places = PLACES.min(DISTANCES / mesh.triangles.len() as f64).max(64.0);
        let step = ((upper - lower).element_product() / places).cbrt();
        let Ok(grid) = Grid::with_pitch(lower, upper, step, 0) else { return Self(Vec::new()) };
        let solid = voxelize(mesh, &grid, false);
        let mut all: Vec<(DVec3, f64)> =
            solid.centres().map(|middle| (middle, distance_to_mesh(mesh, middle) - MARGIN * pitch)).collect();
        all.retain(|&(_, radius)| radius > 0.0);
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut kept: Vec<(DVec3, f64)> = Vec::new();
        for ball in all {
            if kept.len() < MOST && kept.iter().all(|(other, r)| other.distance(ball.0) > APART * r) {
                kept.push(ball);
            }
        }
        Self(kept)
    }

    /// True where one of them holds a solid centre with the tool at a pose.
    pub(super) fn hit(&self, pose: &Pose, voxels: &SolidVoxels) -> bool {
        let (distances, grid) = (voxels.distances(), &voxels.occupancy().grid);
        self.0.iter().any(|&(middle, radius)| {
            let middle = grid.continuous(pose.position + pose.rotation * middle);
            let nearest = distances.nearest(distances.probe(middle).index);
            let centre = |index: usize| DVec3::from_array(grid.voxel(index).map(|v| v as f64));
            nearest.is_some_and(|index| middle.distance(centre(index)) * grid.pitch < radius)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::solid::SolidField;
    use crate::section::test_shapes::{orientations, scattered};
    use crate::surface::closed_forms::solids::{extruded, of_mesh};
    use std::sync::Arc;

    #[test]
    fn a_ball_that_is_hit_means_a_tool_that_collides() {
        // An L of two arms.
        let outline = [[0.0, 0.0], [12.0, 0.0], [12.0, 3.0], [3.0, 3.0], [3.0, 9.0], [0.0, 9.0]];
        let mesh = extruded(&outline, 4.0);
        let mut obstacle = scattered([13, 14, 11], 1);
        // Sparse, so that poses of every kind are met.
        for (index, solid) in obstacle.solid.iter_mut().enumerate() {
            *solid &= u8::from(index % 37 == 0);
        }
        let voxels = SolidVoxels::from(Arc::new(obstacle));
        let field = SolidField::of_tool(voxels.clone(), &of_mesh(mesh.clone()));
        let balls = InnerBalls::new(&mesh, voxels.occupancy().grid.pitch);
        assert!(balls.0.len() > 8);
        let (mut hit, mut collides) = (0, 0);
        let grid = voxels.occupancy().grid;
        for (index, orientation) in orientations("so3:150").iter().enumerate() {
            let part = |step: f64| (index as f64 * step).fract() * 1.6 - 0.3;
            let tip = grid.origin + DVec3::new(part(0.618), part(0.755), part(0.57)) * grid.size();
            let pose = Pose::oriented(tip, orientation);
            let (by_balls, exactly) = (balls.hit(&pose, &voxels), field.collides(&pose));
            assert!(exactly || !by_balls, "{pose:?}");
            (hit, collides) = (hit + usize::from(by_balls), collides + usize::from(exactly));
        }
        assert!(collides < 150 && hit > collides / 3, "{hit} of {collides}");
        let open = Mesh { triangles: mesh.triangles[1..].to_vec(), ..mesh };
        assert!(InnerBalls::new(&open, 1.0).0.is_empty());
    }
}
