//! Corners on the edges of triangles that do not have them (T-junctions): those triangles are cut there, so that both sides share them.

use std::collections::HashMap;

use super::Mesh;
use super::topology::{EdgeUse, runs};

/// Cuts for each edge on a border, on the average, beyond which a mesh is none that was meant so.
const MOST_CUTS: usize = 8;

impl Mesh {
    /// The same surface, whose triangles are cut where a corner on a border lies within `distance` of their edge on a border, and how
    /// many are. No point moves farther. `edges` are those of the mesh.
    pub(super) fn cut_at_corners(&self, edges: &[EdgeUse], distance: f64) -> (Self, usize) {
        let cuts = self.corners_on_edges(edges, distance);
        if cuts.is_empty() {
            return (self.clone(), 0);
        }
        let mut mesh = Self { vertices: self.vertices.clone(), triangles: Vec::new() };
        let mut count = 0;
        for &triangle in &self.triangles {
            let [a, b, c] = triangle;
            let found = [[a, b, c], [b, c, a], [c, a, b]].map(|[from, to, opposite]| {
                let cuts = cuts.get(&[from.min(to), from.max(to)]).into_iter().flatten();
                let mut cuts: Vec<u32> = cuts.copied().filter(|&corner| corner != opposite).collect();
                if from > to {
                    cuts.reverse();
                }
                cuts
            });
            count += usize::from(found.iter().any(|cuts| !cuts.is_empty()));
            cut(triangle, [&found[0], &found[1], &found[2]], &mut mesh.triangles);
        }
        (mesh, count)
    }

    /// By edge on a border the corners on it, from its lower vertex on.
    fn corners_on_edges(&self, edges: &[EdgeUse], distance: f64) -> HashMap<[u32; 2], Vec<u32>> {
        let border = || runs(edges).filter(|run| run.len() % 2 == 1).map(|run| run[0].0);
        let mut corners: Vec<u32> = border().flatten().collect();
        corners.sort_unstable();
        corners.dedup();
        let place = |corner: u32| self.vertices[corner as usize];
        let along_axes = [0, 1, 2].map(|axis| {
            let mut sorted: Vec<(f64, u32)> = corners.iter().map(|&own| (place(own)[axis], own)).collect();
            sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
            sorted
        });
        let mut left = MOST_CUTS * corners.len();
        let mut cuts = HashMap::new();
        for ends in border() {
            let [from, to] = ends.map(place);
            let length = from.distance(to);
            let Some(way) = (to - from).try_normalize() else { continue };
            // Along the axis on which fewest are beside it.
            let beside = along_axes.iter().enumerate().map(|(axis, sorted)| {
                let (low, high) = (from[axis].min(to[axis]) - distance, from[axis].max(to[axis]) + distance);
                let start = sorted.partition_point(|&(at, _)| at < low);
                &sorted[start..sorted.partition_point(|&(at, _)| at <= high).max(start)]
            });
            let beside = beside.min_by_key(|sorted| sorted.len()).unwrap_or_default();
            let on_edge = beside.iter().filter_map(|&(_, corner)| {
                let (off, along) = (place(corner) - from, (place(corner) - from).dot(way));
                let is_between = along > distance && along < length - distance;
                (is_between && off.distance(along * way) <= distance).then_some((along, corner))
            });
            let mut found: Vec<(f64, u32)> = on_edge.take(left).collect();
            if !found.is_empty() {
                left -= found.len();
                found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                cuts.insert(ends, found.into_iter().map(|(_, corner)| corner).collect());
            }
        }
        cuts
    }
}

/// A triangle in pieces, cut from corners on its edges: on the first from its first vertex, and so on.
fn cut([a, b, c]: [u32; 3], [first, second, third]: [&[u32]; 3], pieces: &mut Vec<[u32; 3]>) {
    if first.is_empty() && second.is_empty() && third.is_empty() {
        pieces.push([a, b, c]);
    } else if first.is_empty() {
        cut([b, c, a], [second, third, first], pieces);
    } else {
        let (before, behind) = first.split_at(first.len() / 2);
        let middle = behind[0];
        cut([a, middle, c], [before, &[], third], pieces);
        cut([middle, b, c], [&behind[1..], second, &[]], pieces);
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::mesh::topology::{boundary_chain, sorted_edges};

    #[test]
    fn sides_that_are_cut_otherwise_come_to_share_their_corners() {
        // Each side of a box is a grid of its own.
        let mut mesh = Mesh::default();
        for side in 0..6 {
            let axis = side / 2;
            let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
            let counts = [side + 1, 2 * side + 3];
            let at = |i: usize, j: usize| {
                let mut place = DVec3::ZERO;
                place[axis] = (side % 2) as f64 * 7.0;
                place[u] = i as f64 / counts[0] as f64 * 7.0;
                place[v] = j as f64 / counts[1] as f64 * 7.0;
                // Rounded otherwise than on the other side.
                place[axis] += if i > 0 && i < counts[0] { 3e-6 } else { 0.0 };
                place
            };
            let mut shell = Mesh::default();
            for (i, j) in (0..counts[0]).flat_map(|i| (0..counts[1]).map(move |j| (i, j))) {
                let start = shell.vertices.len() as u32;
                shell.vertices.extend([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                let [a, b, c, d] = [start, start + 1, start + 2, start + 3];
                let outer = [[a, b, c], [a, c, d]];
                shell.triangles.extend(if side % 2 == 1 { outer } else { outer.map(|[a, b, c]| [a, c, b]) });
            }
            mesh.append(&shell);
        }
        let mesh = mesh.joined(1e-5);
        assert!(boundary_chain(&mesh).len() > 80);
        let (cut, count) = mesh.cut_at_corners(&sorted_edges(&mesh), 1e-5);
        assert!(boundary_chain(&cut).is_empty() && count > 20, "{count}");
        assert!((cut.signed_volume() - 343.0).abs() < 1e-3, "{}", cut.signed_volume());
        assert_eq!(cut.cut_at_corners(&sorted_edges(&cut), 1e-5), (cut.clone(), 0));
        // A corner farther away is none of theirs.
        let (few, _) = mesh.cut_at_corners(&sorted_edges(&mesh), 1e-6);
        assert!(!boundary_chain(&few).is_empty());
    }
}
