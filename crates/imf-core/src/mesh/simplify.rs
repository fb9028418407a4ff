//! Fewer triangles for the same surface: flat faces lose the vertices in their midst and along their straight edges.

use std::cmp::Reverse;

use glam::DVec3;

use super::topology::{NONE, beside, sorted_edges};
use super::{Mesh, area_vector};
use crate::parallel;

/// Cosine of the angle by which a triangle may face away from its flat face, so that none folds back: five degrees.
const FACES_ALIKE: f64 = 0.9962;
/// Cosine of the angle by which a new triangle may: two degrees.
const NEW_FACES_ALIKE: f64 = 0.9994;
/// Vertices with more neighbours stay, so that none is looked at for long.
const MOST_NEIGHBOURS: usize = 32;

impl Mesh {
    /// The same closed or open surface, welded, no point of it moved by more than four times `tolerance`, with fewer triangles where
    /// it is flat. Borders and edges of three or more triangles stay as they are.
    pub(crate) fn simplified(&self, tolerance: f64) -> Self {
        let welded = self.welded();
        let mut surface = Surface::new(&welded, tolerance);
        let mut waiting: Vec<u32> = (0..welded.vertices.len() as u32).rev().collect();
        let mut waits = vec![true; welded.vertices.len()];
        let (mut ring, mut others) = (Vec::new(), Vec::new());
        while let Some(vertex) = waiting.pop() {
            waits[vertex as usize] = false;
            if let Some(onto) = surface.neighbour_to_join(vertex, &mut ring, &mut others) {
                surface.collapse(vertex, onto);
                for &neighbour in &ring {
                    if !std::mem::replace(&mut waits[neighbour as usize], true) {
                        waiting.push(neighbour);
                    }
                }
            }
        }
        let triangles = surface.triangles.into_iter().filter(|triangle| triangle[0] != NONE).collect();
        Self { vertices: welded.vertices, triangles }.welded()
    }
}

/// A mesh whose vertices are taken away one by one.
struct Surface<'a> {
    vertices: &'a [DVec3],
    /// Those that are gone name no vertex.
    triangles: Vec<[u32; 3]>,
    /// The flat face of each triangle, and where each face looks.
    face: Vec<u32>,
    normals: Vec<DVec3>,
    /// By vertex a corner of a triangle at it, and by corner the next one at the same vertex: three times the triangle and the place in it.
    first: Vec<u32>,
    next: Vec<u32>,
}

impl<'a> Surface<'a> {
    fn new(mesh: &'a Mesh, tolerance: f64) -> Self {
        let (face, normals) = flat_faces(mesh, tolerance);
        let mut first = vec![NONE; mesh.vertices.len()];
        let mut next = vec![NONE; 3 * mesh.triangles.len()];
        for (corner, &vertex) in mesh.triangles.iter().flatten().enumerate() {
            next[corner] = std::mem::replace(&mut first[vertex as usize], corner as u32);
        }
        Self { vertices: &mesh.vertices, triangles: mesh.triangles.clone(), face, normals, first, next }
    }

    /// The triangles at a vertex, each with the two vertices that follow it there.
    fn around(&self, vertex: u32) -> impl Iterator<Item = (usize, [u32; 2])> {
        let known = |corner: u32| (corner != NONE).then_some(corner);
        let start = known(self.first[vertex as usize]);
        std::iter::successors(start, move |&corner| known(self.next[corner as usize])).filter_map(|corner| {
            let (triangle, place) = (corner as usize / 3, corner as usize % 3);
            let [a, b, c] = self.triangles[triangle];
            let after = [[b, c], [c, a], [a, b]][place];
            (a != NONE).then_some((triangle, after))
        })
    }

    /// The neighbour with which a vertex can be made one, so that the surface stays what it is; of several the one that leaves the
    /// best triangles. `ring` gets the neighbours in order, `others` is a working memory.
    fn neighbour_to_join(
        &self,
        vertex: u32,
        ring: &mut Vec<u32>,
        others: &mut Vec<(usize, [u32; 2])>,
    ) -> Option<u32> {
        others.clear();
        others.extend(self.around(vertex).take(MOST_NEIGHBOURS + 1));
        if !(3..=MOST_NEIGHBOURS).contains(&others.len()) {
            return None;
        }
        // One closed fan, and in it the faces.
        for at in 1..others.len() {
            let end = others[at - 1].1[1];
            let mut following = (at..others.len()).filter(|&next| others[next].1[0] == end);
            let (Some(next), None) = (following.next(), following.next()) else { return None };
            others.swap(at, next);
        }
        if others[others.len() - 1].1[1] != others[0].1[0] {
            return None;
        }
        ring.clear();
        ring.extend(others.iter().map(|(_, [start, _])| *start));
        let count = ring.len();
        let face = |at: usize| self.face[others[at % count].0];
        let ends: Vec<usize> = (0..count).filter(|&at| face(at) != face(at + count - 1)).collect();
        let candidates = match ends.len() {
            0 => (0..count).collect(),
            2 => ends,
            _ => return None,
        };
        let quality = |&at: &usize| {
            let onto = ring[at];
            // An edge that is there already would be there twice.
            let beside = [ring[(at + 1) % count], ring[(at + count - 1) % count]];
            let is_beyond = |other: u32| other != vertex && ring.contains(&other) && !beside.contains(&other);
            if self.around(onto).any(|(_, [a, b])| is_beyond(a) || is_beyond(b)) {
                return None;
            }
            let new = others.iter().filter(|(_, after)| !after.contains(&onto));
            new.map(|&(triangle, [a, b])| self.quality(self.face[triangle], [onto, a, b]))
                .try_fold(f64::INFINITY, |least, quality| Some(least.min(quality?)))
        };
        let found = candidates.iter().filter_map(|at| Some((quality(at)?, ring[*at])));
        // The first of equal ones.
        found.reduce(|best, next| if next.0 > best.0 { next } else { best }).map(|(_, onto)| onto)
    }

    /// How far a triangle is from a line: twice its area over its longest edge squared. `None` if it does not face as its face does.
    fn quality(&self, face: u32, corners: [u32; 3]) -> Option<f64> {
        let [a, b, c] = corners.map(|vertex| self.vertices[vertex as usize]);
        let vector = area_vector([a, b, c]);
        let length = vector.length();
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        (vector.dot(self.normals[face as usize]) > NEW_FACES_ALIKE * length).then(|| 2.0 * length / longest)
    }

    /// Makes two neighbours one vertex, `onto`.
    fn collapse(&mut self, vertex: u32, onto: u32) {
        let mut corner = self.first[vertex as usize];
        while corner != NONE {
            let (triangle, place) = (corner as usize / 3, corner as usize % 3);
            let following = self.next[corner as usize];
            if self.triangles[triangle].contains(&onto) {
                self.triangles[triangle] = [NONE; 3];
            } else if self.triangles[triangle][0] != NONE {
                self.triangles[triangle][place] = onto;
                self.next[corner as usize] = std::mem::replace(&mut self.first[onto as usize], corner);
            }
            corner = following;
        }
        self.first[vertex as usize] = NONE;
        // Corners of triangles that are gone leave its list, which is walked for every candidate beside it.
        let (mut last, mut corner) = (NONE, self.first[onto as usize]);
        while corner != NONE {
            let following = self.next[corner as usize];
            if self.triangles[corner as usize / 3][0] != NONE {
                last = corner;
            } else if last == NONE {
                self.first[onto as usize] = following;
            } else {
                self.next[last as usize] = following;
            }
            corner = following;
        }
    }
}

/// By triangle the flat face that it is part of, and by face its unit normal: connected triangles whose corners lie within
/// twice the tolerance of a plane.
fn flat_faces(mesh: &Mesh, tolerance: f64) -> (Vec<u32>, Vec<DVec3>) {
    let vectors: Vec<DVec3> = mesh.all_corners().map(area_vector).collect();
    let beside = beside(&sorted_edges(mesh), vectors.len());
    // The largest triangles know best how their face lies.
    let mut order: Vec<_> =
        vectors.iter().map(|v| Reverse(v.length_squared().to_bits())).zip(0_u32..).collect();
    parallel::sort(&mut order);
    let mut face = vec![NONE; vectors.len()];
    let mut normals = Vec::new();
    let mut members = Vec::new();
    for (_, first) in order {
        if face[first as usize] != NONE {
            continue;
        }
        let own = normals.len() as u32;
        let mut plane = Plane::default();
        plane.add(mesh.corners(first as usize), vectors[first as usize]);
        face[first as usize] = own;
        members.clear();
        members.push(first);
        let mut next = 0;
        while next < members.len() {
            for other in beside[members[next] as usize] {
                let is_free = other != NONE && face[other as usize] == NONE;
                if is_free && plane.holds(mesh.corners(other as usize), vectors[other as usize], tolerance) {
                    plane.add(mesh.corners(other as usize), vectors[other as usize]);
                    face[other as usize] = own;
                    members.push(other);
                }
            }
            next += 1;
        }
        normals.push(plane.normal());
        // The plane has turned as it grew: what it has left behind is a face by itself.
        for &member in &members[1..] {
            let (corners, vector) = (mesh.corners(member as usize), vectors[member as usize]);
            if !plane.holds(corners, vector, 2.0 * tolerance) {
                face[member as usize] = normals.len() as u32;
                normals.push(vector.normalize_or_zero());
            }
        }
    }
    (face, normals)
}

/// The mean plane of triangles.
#[derive(Default)]
struct Plane {
    vector: DVec3,
    moment: DVec3,
    area: f64,
}

impl Plane {
    fn add(&mut self, [a, b, c]: [DVec3; 3], vector: DVec3) {
        let area = vector.length();
        self.vector += vector;
        self.moment += area * ((a + b + c) / 3.0);
        self.area += area;
    }

    fn normal(&self) -> DVec3 {
        self.vector.normalize_or_zero()
    }

    fn holds(&self, corners: [DVec3; 3], vector: DVec3, tolerance: f64) -> bool {
        let (normal, middle) = (self.normal(), self.moment / self.area);
        vector.dot(normal) > FACES_ALIKE * vector.length()
            && corners.iter().all(|corner| (corner - middle).dot(normal).abs() <= tolerance)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::mesh::distance::distance_to_mesh;
    use crate::mesh::tests::unit_cube;
    use crate::mesh::topology::boundary_chain;
    use crate::parts::shell::{Axis, Shell, circle, pocketed};

    fn cut(mesh: &Mesh, longest: f64) -> Mesh {
        mesh.refined_with_origins(longest, 1_000_000).0
    }

    /// As a file in single precision holds it.
    fn rounded(mesh: &Mesh) -> Mesh {
        let vertices = mesh.vertices.iter().map(|vertex| vertex.as_vec3().as_dvec3()).collect();
        Mesh { vertices, triangles: mesh.triangles.clone() }
    }

    #[test]
    fn what_was_cut_into_many_triangles_has_as_few_as_before() {
        let block =
            pocketed(DVec3::new(40.0, 30.0, 20.0), &circle(DVec2::new(20.0, 15.0), 8.0, 24), 12.0).welded();
        for mesh in [unit_cube(), block] {
            let same = mesh.simplified(1e-6);
            assert_eq!(same.triangles.len(), mesh.triangles.len());
            let longest = mesh.bounds().map_or(0.0, |(lower, upper)| (upper - lower).max_element()) / 30.0;
            for fine in [cut(&mesh, longest), rounded(&cut(&mesh, longest))] {
                assert!(fine.triangles.len() > 5_000);
                let few = fine.simplified(1e-5);
                assert!(few.triangles.len() <= mesh.triangles.len() * 21 / 20, "{}", few.triangles.len());
                assert!(boundary_chain(&few).is_empty());
                assert!((few.signed_volume() / mesh.signed_volume() - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn a_surface_moves_by_no_more_than_its_tolerance() {
        // A ball whose facets are far finer than the tolerance, and an open tube.
        let outline: Vec<[f64; 2]> = (0..=60)
            .map(|step| f64::from(step) / 60.0 * std::f64::consts::PI)
            .map(|a| [-5.0 * a.cos(), 5.0 * a.sin()])
            .collect();
        let ball = Mesh::revolved(&outline, 60);
        let mut shell = Shell::default();
        shell.prism(Axis::Z, &circle(DVec2::ZERO, 4.0, 24), [0.0, 6.0]);
        let mut tube = cut(&shell.into_mesh(), 0.5);
        let is_wall = |t: &[u32; 3]| t.iter().any(|&v| (0.1..5.9).contains(&tube.vertices[v as usize].z));
        tube.triangles = tube.triangles.iter().copied().filter(is_wall).collect();
        let tube = tube.welded();
        for (mesh, share) in [(ball, 0.9), (tube, 0.3)] {
            let boundary = boundary_chain(&mesh).len();
            let mut least = usize::MAX;
            for tolerance in [1e-6, 1e-3, 0.01, 0.05] {
                let few = mesh.simplified(tolerance);
                least = least.min(few.triangles.len());
                assert_eq!(boundary_chain(&few).len(), boundary);
                let farthest =
                    mesh.vertices.iter().step_by(5).map(|&at| distance_to_mesh(&few, at)).fold(0.0, f64::max);
                assert!(farthest <= 4.0 * tolerance, "{farthest} {tolerance}");
                // And no face looks elsewhere.
                let area = |mesh: &Mesh| {
                    mesh.all_corners().map(|corners| area_vector(corners).length()).sum::<f64>()
                };
                assert!((area(&few) / area(&mesh) - 1.0).abs() < 0.01 + tolerance);
            }
            assert!(
                (least as f64) < share * mesh.triangles.len() as f64,
                "{least} of {}",
                mesh.triangles.len()
            );
        }
    }
}
