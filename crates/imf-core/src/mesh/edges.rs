//! Which triangles use an edge, and which way. It follows vertex indices, as [`super::topology`] does.

use super::Mesh;
use crate::parallel;

/// A directed use of an edge by a triangle: the lower vertex first, the triangle, whether it goes upwards.
pub(crate) type EdgeUse = ([u32; 2], u32, bool);

/// All uses of edges, those of one edge together. Triangles that name a vertex twice have none.
pub(crate) fn sorted_edges(mesh: &Mesh) -> Vec<EdgeUse> {
    let mut edges = Vec::with_capacity(3 * mesh.triangles.len());
    for (triangle, &[a, b, c]) in mesh.triangles.iter().enumerate() {
        if a != b && b != c && c != a {
            let upwards = |from: u32, to: u32| ([from.min(to), from.max(to)], triangle as u32, from < to);
            edges.extend([upwards(a, b), upwards(b, c), upwards(c, a)]);
        }
    }
    parallel::sort(&mut edges);
    edges
}

/// The uses of one edge after those of another.
pub(crate) fn runs(edges: &[EdgeUse]) -> impl Iterator<Item = &[EdgeUse]> {
    edges.chunk_by(|first, second| first.0 == second.0)
}

/// Pairs of triangles that share an edge with no third one, and whether both use it in the same direction: consistent neighbours
/// use it in opposite directions.
pub(crate) fn neighbours(edges: &[EdgeUse]) -> impl Iterator<Item = (usize, usize, bool)> {
    runs(edges).filter_map(|run| match *run {
        [(_, one, first), (_, other, second)] => Some((one as usize, other as usize, first == second)),
        _ => None,
    })
}
