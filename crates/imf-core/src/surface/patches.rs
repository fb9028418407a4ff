//! Connected patches of a surface.

use std::collections::HashMap;

use glam::DVec3;

use super::{SurfaceSample, SurfaceSamples};
use crate::mesh::groups::Groups;

/// A corner, to compare by.
fn corner_key(corner: DVec3) -> [u64; 3] {
    // Adding zero turns minus zero into zero.
    (corner + 0.0).to_array().map(f64::to_bits)
}

/// Samples of one connected patch of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfacePatch {
    /// Their numbers, ascending.
    pub samples: Vec<usize>,
    /// Their area, in the mesh's unit squared.
    pub area: f64,
    /// The point of the samples that is nearest to their mean.
    pub middle: DVec3,
    /// Its outward unit normal.
    pub normal: DVec3,
    /// Lowest and highest coordinates of the samples.
    pub bounds: [DVec3; 2],
}

impl SurfaceSamples {
    /// Fraction of the area that lies in triangles of which a neighbour across an edge is of another class, and in all that are tried at
    /// one place with one: what is decided at that place and ends somewhere around it.
    #[must_use]
    pub fn border<C: PartialEq>(&self, class: impl Fn(usize) -> C) -> f64 {
        let mut of_edge: HashMap<[[u64; 3]; 2], usize> = HashMap::new();
        let mut at_border = vec![false; self.samples.len()];
        for sample in 0..self.samples.len() {
            let corners = self.mesh.corners(sample).map(corner_key);
            for side in 0..3 {
                let mut edge = [corners[side], corners[(side + 1) % 3]];
                edge.sort_unstable();
                let other = *of_edge.entry(edge).or_insert(sample);
                if class(other) != class(sample) {
                    (at_border[other], at_border[sample]) = (true, true);
                }
            }
        }
        let mut first = 0;
        for place in self.samples.chunk_by(SurfaceSample::is_tried_with) {
            let own = &mut at_border[first..first + place.len()];
            let any = own.iter().any(|&at_border| at_border);
            own.fill(any);
            first += place.len();
        }
        self.fraction(|sample| at_border[sample])
    }

    /// The connected patches of the samples that `class` gives a number, the largest area first. Two samples of one number are
    /// connected where their triangles share a corner.
    #[must_use]
    pub fn patches(&self, class: impl Fn(usize) -> Option<u32>) -> Vec<SurfacePatch> {
        let count = self.samples.len();
        let mut groups = Groups::new(count);
        let mut first_at: HashMap<([u64; 3], u32), usize> = HashMap::new();
        let chosen: Vec<usize> = (0..count).filter(|&sample| class(sample).is_some()).collect();
        for &sample in &chosen {
            let Some(class) = class(sample) else { continue };
            for corner in self.mesh.corners(sample) {
                let first = *first_at.entry((corner_key(corner), class)).or_insert(sample);
                groups.join(first, sample);
            }
        }
        let mut patches: Vec<SurfacePatch> = Vec::new();
        let mut patch_of: HashMap<usize, usize> = HashMap::new();
        for &sample in &chosen {
            let at = *patch_of.entry(groups.root(sample)).or_insert_with(|| {
                let bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
                let (middle, normal) = (DVec3::ZERO, DVec3::ZERO);
                patches.push(SurfacePatch { samples: Vec::new(), area: 0.0, middle, normal, bounds });
                patches.len() - 1
            });
            let (patch, own) = (&mut patches[at], &self.samples[sample]);
            patch.samples.push(sample);
            patch.area += own.area;
            patch.middle += own.area * own.point;
            patch.bounds = [patch.bounds[0].min(own.point), patch.bounds[1].max(own.point)];
        }
        for patch in &mut patches {
            let mean = patch.middle / patch.area;
            let far = |sample: &&usize| self.samples[**sample].point.distance_squared(mean);
            let nearest = patch.samples.iter().min_by(|a, b| far(a).total_cmp(&far(b)));
            let nearest = &self.samples[nearest.copied().unwrap_or_default()];
            (patch.middle, patch.normal) = (nearest.point, nearest.normal);
        }
        patches.sort_by(|a, b| b.area.total_cmp(&a.area));
        patches
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::mesh::tests::unit_cube;
    use crate::voxelize::voxelize;

    #[test]
    fn opposite_faces_of_a_cube_are_two_patches_and_adjacent_ones_one() {
        let cube = unit_cube();
        let grid = Grid { origin: DVec3::splat(-0.5), pitch: 0.1, dims: [20; 3] };
        let samples = SurfaceSamples::new(&cube, &voxelize(&cube, &grid, false), 500);
        let faces = |faces: &[DVec3]| {
            let faces = faces.to_vec();
            let normals: Vec<DVec3> = samples.samples.iter().map(|s| s.normal).collect();
            samples.patches(move |sample| faces.iter().any(|f| f.dot(normals[sample]) > 0.9).then_some(0))
        };
        let opposite = faces(&[DVec3::X, DVec3::NEG_X]);
        assert_eq!(opposite.len(), 2);
        for patch in &opposite {
            assert!((patch.area - 1.0).abs() < 1e-9 && patch.normal.x.abs() > 0.9, "{patch:?}");
            assert!((patch.middle.y - 0.5).abs() < 0.1 && (patch.middle.z - 0.5).abs() < 0.1);
            assert!(patch.bounds[0].y < 0.1 && patch.bounds[1].y > 0.9);
        }
        // Those on both sides of the edges of one face, by trying all pairs.
        let top = |sample: usize| samples.samples[sample].normal.z > 0.9;
        let has_other = |sample: usize| {
            let own = samples.mesh.corners(sample);
            let shared = |other: usize| {
                samples.mesh.corners(other).iter().filter(|corner| own.contains(corner)).count()
            };
            (0..samples.samples.len()).any(|other| top(other) != top(sample) && shared(other) == 2)
        };
        let border = samples.border(top);
        assert!(border > 0.02 && (border - samples.fraction(has_other)).abs() < 1e-9, "{border}");
        assert_eq!(samples.border(|_| true), 0.0);
        let adjacent = faces(&[DVec3::X, DVec3::Y]);
        assert_eq!(adjacent.len(), 1);
        assert!((adjacent[0].area - 2.0).abs() < 1e-9);
        // Of two numbers, two patches.
        let normals: Vec<DVec3> = samples.samples.iter().map(|s| s.normal).collect();
        let both = samples.patches(|s| match normals[s] {
            n if n.x > 0.9 => Some(1),
            n if n.y > 0.9 => Some(2),
            _ => None,
        });
        assert_eq!(both.len(), 2);
    }
}
