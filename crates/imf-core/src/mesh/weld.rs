//! Sharing vertices that coincide, or all but coincide, so that indices carry the topology.

use std::collections::HashMap;

use earcut::Earcut;
use glam::{BVec3, DVec3};

use super::Mesh;
use crate::file_error::{Fault, FaultKind};

/// Maximum number of triangles of a mesh.
const MAX_TRIANGLES: usize = 1 << 31;

/// Collects triangles given by positions, sharing vertices that are exactly equal.
///
/// Vertices are numbered in the order of their first use. Zero and minus zero are equal.
#[derive(Default)]
pub(crate) struct Welder {
    mesh: Mesh,
    known: HashMap<[u64; 3], u32>,
}

impl Welder {
    /// Adds a triangle; refuses one too many, or whose vertices cannot be numbered in 32 bits any more.
    pub(crate) fn push(&mut self, corners: [DVec3; 3]) -> Result<(), Fault> {
        check_count(self.mesh.triangles.len() + 1)?;
        let mut triangle = [0; 3];
        for (slot, corner) in triangle.iter_mut().zip(corners) {
            // Adding zero turns minus zero into zero.
            let corner = corner + 0.0;
            let next = u32::try_from(self.mesh.vertices.len()).map_err(|_| too_large())?;
            *slot = *self.known.entry(corner.to_array().map(f64::to_bits)).or_insert(next);
            if *slot == next {
                self.mesh.vertices.push(corner);
            }
        }
        self.mesh.triangles.push(triangle);
        Ok(())
    }

    /// Adds a polygon: a convex one as a fan of triangles, others by their ears; fewer than three corners are nothing.
    pub(crate) fn push_polygon(&mut self, corners: &[DVec3]) -> Result<(), Fault> {
        let turns = |normal: DVec3| {
            let count = corners.len();
            (0..count).map(move |at| {
                let [a, b, c] = [at, at + 1, at + 2].map(|at| corners[at % count]);
                (b - a).cross(c - b).dot(normal)
            })
        };
        if corners.len() > 3 {
            let start = corners[0];
            let normal: DVec3 = corners.windows(2).map(|w| (w[0] - start).cross(w[1] - start)).sum();
            if turns(normal).any(|turn| turn < -1e-9 * normal.length_squared()) {
                let ears = ears(corners, normal);
                if !ears.is_empty() {
                    return ears.into_iter().try_for_each(|ear| self.push(ear));
                }
            }
        }
        corners.windows(2).skip(1).try_for_each(|pair| self.push([corners[0], pair[0], pair[1]]))
    }

    pub(crate) fn finish(self) -> Mesh {
        self.mesh
    }
}

/// The triangles of a polygon that is not convex, seen along its normal; none where it has no inside there.
fn ears(corners: &[DVec3], normal: DVec3) -> Vec<[DVec3; 3]> {
    let (u, v) = normal.normalize_or(DVec3::Z).any_orthonormal_pair();
    let plane = corners.iter().map(|corner| [corner.dot(u), corner.dot(v)]);
    let mut found = Vec::new();
    Earcut::new().earcut(plane, &[], &mut found);
    let facing = |ear: &[usize]| {
        let [a, b, c] = [ear[0], ear[1], ear[2]].map(|at| corners[at]);
        if (b - a).cross(c - a).dot(normal) < 0.0 { [a, c, b] } else { [a, b, c] }
    };
    found.chunks_exact(3).map(facing).collect()
}

fn too_large() -> Fault {
    let cause = "it has more than 2^31 triangles; reduce the mesh (MeshLab, Blender) and export it again";
    Fault::new(FaultKind::TooLarge, cause)
}

fn check_count(triangles: usize) -> Result<(), Fault> {
    if triangles > MAX_TRIANGLES { Err(too_large()) } else { Ok(()) }
}

impl Mesh {
    /// The same triangles on shared vertices: those that are exactly equal become one, those that no triangle uses
    /// are dropped, and they are numbered in the order of their first use.
    ///
    /// # Panics
    /// If a triangle names a vertex that does not exist.
    #[must_use]
    pub fn welded(&self) -> Self {
        let mut welder = Welder::default();
        for corners in self.all_corners() {
            // No more vertices come out than went in, and those are numbered in 32 bits already.
            let _ = welder.push(corners);
        }
        welder.finish()
    }

    /// The same triangles on fewer vertices: each becomes the first one, in the order of their use, that lies within `distance` of
    /// it. None moves farther, however many lie in a row.
    pub(super) fn joined(&self, distance: f64) -> Self {
        let (lower, _) = self.bounds().unwrap_or_default();
        // A vertex then has few cells within reach, mostly its own alone.
        let cell = |p: DVec3| ((p - lower) / (4.0 * distance)).floor() + 0.0;
        let mut mesh = Self::default();
        // By cell the last vertex in it; by vertex the one before it in its cell.
        let (mut last, mut before) = (HashMap::new(), Vec::new());
        let mut known = vec![None; self.vertices.len()];
        for triangle in &self.triangles {
            mesh.triangles.push(triangle.map(|vertex| {
                *known[vertex as usize].get_or_insert_with(|| {
                    let place = self.vertices[vertex as usize];
                    let key = |cell: DVec3| cell.to_array().map(f64::to_bits);
                    let (from, to) = (cell(place - distance), cell(place + distance));
                    let corners = (0..8).filter_map(|corner| {
                        let far = BVec3::new(corner & 1 > 0, corner & 2 > 0, corner & 4 > 0);
                        // A side on which both ends are one cell has no second.
                        (!(far & from.cmpeq(to)).any()).then(|| key(DVec3::select(far, to, from)))
                    });
                    let mut near: Option<u32> = None;
                    for key in corners {
                        let mut at: Option<u32> = last.get(&key).copied();
                        while let Some(other) = at {
                            if mesh.vertices[other as usize].distance(place) <= distance {
                                near = Some(near.map_or(other, |near| near.min(other)));
                            }
                            at = before[other as usize];
                        }
                    }
                    near.unwrap_or_else(|| {
                        let new = mesh.vertices.len() as u32;
                        mesh.vertices.push(place);
                        before.push(last.insert(key(cell(place)), new));
                        new
                    })
                })
            }));
        }
        mesh
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn a_polygon_that_is_not_convex_keeps_to_its_inside() {
        // A U of 60 × 40 with a notch of 20 × 20, tilted, from each of its corners and either way round.
        let u = [[0., 0.], [60., 0.], [60., 40.], [40., 40.], [40., 20.], [20., 20.], [20., 40.], [0., 40.]];
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.7, -1.2, 0.4);
        for first in 0..8 {
            for backwards in [false, true] {
                let mut corners: Vec<DVec3> = u.iter().map(|&[x, y]| turn * DVec3::new(x, y, 5.0)).collect();
                corners.rotate_left(first);
                if backwards {
                    corners.reverse();
                }
                let mut welder = Welder::default();
                welder.push_polygon(&corners).unwrap();
                let mesh = welder.finish();
                let vector = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a);
                let all: Vec<DVec3> = mesh.all_corners().map(vector).collect();
                let area: f64 = all.iter().map(|own| own.length()).sum();
                let facing =
                    all.iter().sum::<DVec3>().dot(turn * DVec3::Z) * if backwards { -1.0 } else { 1.0 };
                assert!(
                    (area - 2000.0).abs() < 1e-6 && (facing - 2000.0).abs() < 1e-6,
                    "{first}: {area} {facing}"
                );
                assert_eq!((mesh.triangles.len(), mesh.vertices.len()), (6, 8));
            }
        }
        // Convex ones stay fans.
        let mut welder = Welder::default();
        welder.push_polygon(&[DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y]).unwrap();
        assert_eq!(welder.finish().triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn equal_vertices_are_shared_and_unused_ones_dropped() {
        let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let vertices = vec![p(9.0, 9.0), p(0.0, 0.0), p(1.0, 0.0), p(0.0, 1.0), p(-0.0, 0.0), p(-1.0, 0.0)];
        let mesh = Mesh { vertices, triangles: vec![[1, 2, 3], [4, 3, 5]] };
        let welded = mesh.welded();
        assert_eq!(welded.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(welded.vertices, [p(0.0, 0.0), p(1.0, 0.0), p(0.0, 1.0), p(-1.0, 0.0)]);
        assert_eq!(welded.welded(), welded);
    }

    #[test]
    fn vertices_that_are_near_are_joined_as_by_trying_all_of_them() {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        for distance in [1e-3, 0.04, 0.3] {
            let mut coordinate = || random.random_range(0.0..1.0);
            let vertices = (0..600).map(|_| DVec3::new(coordinate(), coordinate(), coordinate())).collect();
            let triangles = (0..600).step_by(3).map(|v| [v, v + 1, v + 2]).collect();
            let mesh = Mesh { vertices, triangles };
            let joined = mesh.joined(distance);
            let mut firsts: Vec<DVec3> = Vec::new();
            for (triangle, corners) in joined.triangles.iter().enumerate() {
                for (vertex, place) in corners.iter().zip(mesh.corners(triangle)) {
                    let near = firsts.iter().position(|first| first.distance(place) <= distance);
                    assert_eq!(*vertex as usize, near.unwrap_or(firsts.len()));
                    if near.is_none() {
                        firsts.push(place);
                    }
                }
            }
            assert_eq!(joined.vertices, firsts);
        }
    }

    #[test]
    fn no_mesh_has_more_triangles_than_can_be_indexed() {
        assert_eq!(check_count(MAX_TRIANGLES + 1), Err(too_large()));
        assert_eq!(check_count(MAX_TRIANGLES), Ok(()));
    }
}
