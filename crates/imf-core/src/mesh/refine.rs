//! Splitting long edges, so that values at vertices show what lies between the corners of large triangles.

use std::collections::HashMap;

use super::Mesh;

impl Mesh {
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
mod tests {
    use crate::mesh::tests::unit_cube;
    use crate::mesh::topology::boundary_chain;

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
