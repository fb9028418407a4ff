//! Triangle meshes: what they hold and how simple ones are made, what can be said about them, the rigid set-up transform, and splitting
//! long edges, so that values at vertices show what lies between the corners of large triangles.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

pub(crate) mod crossings;
pub(crate) mod distance;
mod face_orientation;
mod features;
pub(crate) mod groups;
mod junctions;
pub mod read;
mod simplify;
pub(crate) mod solid_angle;
mod stability;
mod surface_points;
pub mod topology;
pub(crate) mod weld;
#[cfg(feature = "formats")]
pub mod write;

pub use face_orientation::FaceRepair;
pub use features::MachiningDirection;
pub(crate) use features::SAME;
pub use surface_points::points_memory_estimate;
pub(crate) use surface_points::{SMOOTH, area_vector, points_at_pitch};

/// A triangle mesh in its own unit. Vertices may be shared or repeated; orientation may be any.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Mesh {
    /// Vertex positions.
    pub vertices: Vec<DVec3>,
    /// Triangles as indices into `vertices`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The box between two corners, its triangles facing outwards.
    #[must_use]
    pub fn cuboid(lower: DVec3, upper: DVec3) -> Self {
        let corner = |i: usize| {
            let pick = |bit: usize, low: f64, high: f64| if i >> bit & 1 == 0 { low } else { high };
            DVec3::new(pick(0, lower.x, upper.x), pick(1, lower.y, upper.y), pick(2, lower.z, upper.z))
        };
        let sides: [[u32; 4]; 6] =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Self {
            vertices: (0..8).map(corner).collect(),
            triangles: sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        }
    }

    /// An outline (heights and radii from below) revolved about the z axis with `sides` flat faces (at least 3),
    /// closed at both ends; its triangles face outwards. Empty without an outline.
    #[must_use]
    pub fn revolved(outline: &[[f64; 2]], sides: usize) -> Self {
        let mut mesh = Self::default();
        let (Some(&[bottom, _]), Some(&[top, _])) = (outline.first(), outline.last()) else { return mesh };
        mesh.vertices.push(DVec3::new(0.0, 0.0, bottom));
        for &[height, radius] in outline {
            mesh.vertices.extend((0..sides).map(|side| {
                let angle = TAU * side as f64 / sides as f64;
                DVec3::new(radius * angle.cos(), radius * angle.sin(), height)
            }));
        }
        let end = mesh.vertices.len() as u32;
        mesh.vertices.push(DVec3::new(0.0, 0.0, top));
        let corner = |ring: usize, side: usize| (1 + ring * sides + side % sides) as u32;
        let last = outline.len() - 1;
        for side in 0..sides {
            mesh.triangles.push([0, corner(0, side + 1), corner(0, side)]);
            mesh.triangles.push([end, corner(last, side), corner(last, side + 1)]);
            for ring in 0..last {
                let [a, b] = [corner(ring, side), corner(ring, side + 1)];
                let [c, d] = [corner(ring + 1, side), corner(ring + 1, side + 1)];
                mesh.triangles.extend([[a, b, c], [b, d, c]]);
            }
        }
        // A ring without a radius gives triangles without an area, and its vertices are one.
        let vertices = &mesh.vertices;
        mesh.triangles.retain(|t| {
            let [a, b, c] = t.map(|v| vertices[v as usize]);
            (b - a).cross(c - a).length_squared() > 0.0
        });
        mesh.welded()
    }

    /// True where every triangle's vertices are there, and finite.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let is_sound = |&vertex: &u32| self.vertices.get(vertex as usize).is_some_and(|at| at.is_finite());
        self.triangles.iter().flatten().all(is_sound)
    }

    /// The lower and upper corner of the box around the vertices that triangles use; `None` without triangles.
    #[must_use]
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let mut corners = self.triangles.iter().flatten().map(|&v| self.vertices[v as usize]);
        let first = corners.next()?;
        Some(corners.fold((first, first), |(lower, upper), p| (lower.min(p), upper.max(p))))
    }

    /// The three corners of a triangle.
    ///
    /// # Panics
    /// If the triangle or one of its vertices does not exist.
    #[must_use]
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.vertices[v as usize])
    }

    /// The three corners of every triangle.
    pub(crate) fn all_corners(&self) -> impl Iterator<Item = [DVec3; 3]> {
        (0..self.triangles.len()).map(|triangle| self.corners(triangle))
    }

    /// Signed volume by the divergence theorem: positive for a closed mesh whose triangles face outwards.
    #[must_use]
    pub fn signed_volume(&self) -> f64 {
        // Relative to the box's centre, so that an open mesh far from the origin does not drown in cancellation.
        let centre = self.bounds().map_or(DVec3::ZERO, |(lower, upper)| (lower + upper) * 0.5);
        let cones = self.all_corners().map(|corners| corners.map(|p| p - centre));
        cones.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    /// The mesh moved by an affine transform; a mirroring one turns the triangles so that they still face outwards.
    #[must_use]
    pub fn transformed(&self, transform: &DMat4) -> Self {
        let mirrored = transform.determinant() < 0.0;
        let turned = |&[a, b, c]: &[u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        Self {
            vertices: self.vertices.iter().map(|&p| transform.transform_point3(p)).collect(),
            triangles: self.triangles.iter().map(turned).collect(),
        }
    }

    /// The same surface with every edge longer than `longest` halved, again and again, and the triangle that each piece is of. Neighbours
    /// split a shared edge alike, so no gaps open. It stops early, between two rounds, once there are more than `most` triangles.
    pub(crate) fn refined_with_origins(&self, longest: f64, most: usize) -> (Self, Vec<u32>) {
        let mut mesh = self.clone();
        let mut origins: Vec<u32> = (0..self.triangles.len() as u32).collect();
        while mesh.triangles.len() <= most {
            let mut middles: HashMap<(u32, u32), Option<u32>> = HashMap::new();
            let mut triangles = Vec::with_capacity(mesh.triangles.len());
            let mut pieces = Vec::with_capacity(mesh.triangles.len());
            for t in 0..mesh.triangles.len() {
                let [a, b, c] = mesh.triangles[t];
                let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(from, to)| {
                    *middles.entry((from.min(to), from.max(to))).or_insert_with(|| {
                        let (p, q) = (mesh.vertices[from as usize], mesh.vertices[to as usize]);
                        let next = u32::try_from(mesh.vertices.len()).ok()?;
                        (p.distance(q) > longest).then(|| {
                            mesh.vertices.push((p + q) * 0.5);
                            next
                        })
                    })
                });
                split([a, b, c], [ab, bc, ca], &mut triangles);
                pieces.resize(triangles.len(), origins[t]);
            }
            let done = triangles.len() == mesh.triangles.len();
            (mesh.triangles, origins) = (triangles, pieces);
            if done {
                break;
            }
        }
        (mesh, origins)
    }

    /// Number of vertices that triangles use.
    pub(crate) fn used_vertices(&self) -> usize {
        let mut used = vec![false; self.vertices.len()];
        self.triangles.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
        used.into_iter().filter(|used| *used).count()
    }

    /// Appends another mesh.
    pub fn append(&mut self, other: &Self) {
        let base = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + base)));
    }
}

/// The pieces of a triangle whose edges ab, bc, ca have these middles, with its sense of rotation.
fn split([a, b, c]: [u32; 3], middles: [Option<u32>; 3], pieces: &mut Vec<[u32; 3]>) {
    match middles {
        [None, None, None] => pieces.push([a, b, c]),
        [Some(ab), Some(bc), Some(ca)] => {
            pieces.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        // Turned until the first edge is halved, and with two halved ones the last is whole.
        [Some(ab), None, None] => pieces.extend([[a, ab, c], [ab, b, c]]),
        [Some(ab), Some(bc), None] => pieces.extend([[ab, b, bc], [a, ab, bc], [a, bc, c]]),
        [ab, bc, ca] => split([b, c, a], [bc, ca, ab], pieces),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::topology::boundary_chain;
    use super::*;

    /// The cube [0, 1]³, triangles outwards.
    pub(crate) fn unit_cube() -> Mesh {
        Mesh::cuboid(DVec3::ZERO, DVec3::ONE)
    }

    #[test]
    fn volume_is_signed_and_survives_mirroring() {
        let cube = unit_cube();
        assert!((cube.signed_volume() - 1.0).abs() < 1e-15);
        let mirror = DMat4::from_scale(DVec3::new(-2.0, 1.0, 1.0));
        assert!((cube.transformed(&mirror).signed_volume() - 2.0).abs() < 1e-15);
    }

    #[test]
    fn edges_become_short_and_the_surface_stays_the_same() {
        let cube = unit_cube();
        for longest in [2.0, 1.2, 0.6, 0.23] {
            let fine = cube.refined_with_origins(longest, 1_000_000).0;
            assert!(boundary_chain(&fine).is_empty());
            assert!((fine.signed_volume() - 1.0).abs() < 1e-12);
            for [a, b, c] in fine.all_corners() {
                assert!([(a, b), (b, c), (c, a)].iter().all(|(p, q)| p.distance(*q) <= longest));
            }
        }
        assert_eq!(cube.refined_with_origins(2.0, 1000).0, cube);
        assert!(cube.refined_with_origins(1e-6, 1000).0.triangles.len() < 8000);
    }
}
