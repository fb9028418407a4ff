//! Consistent face orientation (winding), as far as the mesh determines it.
//!
//! A *patch* is a set of triangles connected across edges that exactly two triangles share: the orientation of one
//! determines all others. Which of a patch's two sides is outside is what most of its area says, and where that is
//! not a clear majority, its signed volume and how deep it lies in others: an outermost shell faces outwards, a shell
//! within it bounds a cavity, and so on. Nested shells that face alike are solids within solids. A mesh that is
//! consistent already and faces outwards stays as it is, to the bit.
//!
//! Everything here follows vertex indices, as in [`super::topology`]. Where that leaves edges which one triangle uses, corners that
//! all but coincide are joined first: programs that write each triangle by itself round its corners by themselves.

mod nesting;

use std::collections::HashMap;

use glam::DVec3;

use super::Mesh;
use super::crossings::CrossingIndex;
use super::groups::Groups;
use super::topology::{EdgeUse, is_degenerate, neighbours, runs, sorted_edges};
use nesting::{inside_open, shells_around};

/// Where this much of a patch's area faces one way, that way is meant. Below it the file says nothing.
const CLEAR_MAJORITY: f64 = 0.9;

/// Corners that lie closer together than this fraction of the diagonal of the box around a mesh are one: so large is a unit of the
/// last digit of six, which many programs write. A hundredth of a millimetre of a part of one metre.
const ONE_CORNER: f64 = 1e-5;

/// How far before a triangle it is asked what lies there, in widths of it.
const NEAR: f64 = 1e-4;

/// What was done to make triangles face consistently, and what was found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaceRepair {
    /// Corners that were joined to others, from which they were less than 10⁻⁵ of the mesh's diagonal away.
    pub joined: usize,
    /// Triangles that were left out, since each was there more than once.
    pub doubled: usize,
    /// Triangles without area that were left out, since that leaves fewer edges open.
    pub flat: usize,
    /// Triangles that were cut where a corner of another lies on their edge, within the same distance.
    pub cut: usize,
    /// Triangles that were flipped.
    pub flipped: usize,
    /// Triangles of patches that have one side alone, as a Möbius strip has; they stay as they were.
    pub one_sided: usize,
    /// Closed shells that lie in another and face as it does: what they bound is solid within solid, not a cavity.
    pub nested: usize,
}

/// A patch, and how it faces once its minority is flipped.
#[derive(Clone, Copy)]
struct Patch {
    /// Areas of its triangles by parity.
    areas: [f64; 2],
    /// Signed volume about the mesh's centre, its triangles of parity 1 flipped.
    volume: f64,
    lower: DVec3,
    upper: DVec3,
    one_sided: bool,
    closed: bool,
    /// Whether its triangles of parity 0 are flipped (and those of parity 1 are not), or the other way round.
    flipped: bool,
}

impl Patch {
    /// True where the file says which way it faces.
    fn is_clear(&self) -> bool {
        let [a, b] = self.areas;
        self.one_sided || a.max(b) >= CLEAR_MAJORITY * (a + b)
    }

    /// Its signed volume as it is flipped now.
    fn signed_volume(&self) -> f64 {
        if self.flipped { -self.volume } else { self.volume }
    }
}

impl Mesh {
    /// The same triangles in the same order, cut where corners of others lie on their edges, and flipped where need be so that they face consistently and shells face outwards, and what
    /// was done. Of triangles that are there twice one is left out, whichever way they face where all are, else where they face alike; both,
    /// or one of two that face opposite ways, where that leaves fewer edges open. Where triangles have edges of their own, vertices closer
    /// together than 10⁻⁵ of the mesh's diagonal are joined, and triangles without area left out where that leaves fewer edges open.
    ///
    /// # Panics
    /// If a triangle names a vertex that does not exist.
    #[must_use]
    pub fn with_consistent_faces(mut self) -> (Self, FaceRepair) {
        let mut edges = sorted_edges(&self);
        let mut repair = FaceRepair::default();
        // Two-sided meshes have each triangle once for either side, which together bound nothing.
        if !edges.is_empty() && runs(&edges).all(|run| run.len() >= 4) {
            let once = self.without_repeated(corners, |_| 1);
            repair.doubled = self.triangles.len() - once.triangles.len();
            self = once;
            edges = sorted_edges(&self);
        } else if runs(&edges).any(|run| run.len() > 2) {
            // Some may be there twice, facing alike: by chance, as where faces were exported with two bodies, or as the common face of
            // two bodies of which one faces inwards, which bounds nothing. Or once more the other way round, by chance too.
            let once = self.without_repeated(corners, |_| 1);
            if once.triangles.len() < self.triangles.len() {
                let candidates =
                    [self.without_repeated(turned, |_| 1), self.without_repeated(turned, |n| n % 2), once]
                        .map(|mesh| (sorted_edges(&mesh), mesh));
                // Or as the common face of two bodies of which one lies in the other: then all is as it should be.
                let least = candidates.iter().map(|(edges, _)| unbalanced_edges(edges)).min().unwrap_or(0);
                let is_right = unbalanced_edges(&edges) < least && self.is_nowhere_inside_out(&edges);
                let fewest = candidates.into_iter().min_by_key(|(edges, _)| single_edges(edges));
                if let Some((its_edges, kept)) = fewest.filter(|_| !is_right) {
                    repair.doubled = self.triangles.len() - kept.triangles.len();
                    (self, edges) = (kept, its_edges);
                }
            }
        }
        if single_edges(&edges) > 0 {
            let (lower, upper) = self.bounds().unwrap_or_default();
            let distance = ONE_CORNER * (upper - lower).length();
            let joined = self.joined(distance);
            let count = self.used_vertices() - joined.vertices.len();
            if self.take_if_less_open(&mut edges, joined) {
                repair.joined = count;
            }
            let mut full = self.clone();
            full.triangles.retain(|corners| !is_degenerate(&corners.map(|v| self.vertices[v as usize])));
            let flat = self.triangles.len() - full.triangles.len();
            if flat > 0 && self.take_if_less_open(&mut edges, full) {
                repair.flat = flat;
            }
            let (cut, count) = self.cut_at_corners(&edges, distance);
            if count > 0 && self.take_if_less_open(&mut edges, cut) {
                repair.cut = count;
            }
        }
        let (of, parity, mut patches) = patches(&self, &edges);
        close(&edges, &of, &parity, &mut patches);
        let closed: Vec<usize> = (0..patches.len()).filter(|&p| patches[p].closed).collect();
        let inwards = closed.iter().any(|&p| patches[p].signed_volume() < 0.0);
        if closed.len() > 1 || inwards || patches.iter().any(|patch| !patch.is_clear()) {
            let triangles = triangles_of(&of, patches.len());
            let around = shells_around(&self, &triangles, &parity, &closed, &patches);
            // What is open has no inside: as seen from the mesh's centre it faces away.
            for patch in patches.iter_mut().filter(|patch| !patch.closed && !patch.is_clear()) {
                patch.flipped = patch.volume < 0.0;
            }
            let in_open = inside_open(&self, &triangles, &parity, (&closed, &around), &patches);
            choose_sides(&around, &in_open, &closed, &mut patches);
            let faces_out = |place: usize| patches[closed[place]].signed_volume() > 0.0;
            let in_solid = |place: &usize| {
                let signs = around[*place]
                    .iter()
                    .map(|&outer| if patches[outer].signed_volume() > 0.0 { 1 } else { -1 });
                signs.sum::<i32>() > 0
            };
            repair.nested = (0..closed.len()).filter(|&place| faces_out(place)).filter(in_solid).count();
        }
        for (triangle, corners) in self.triangles.iter_mut().enumerate() {
            let patch = &patches[of[triangle] as usize];
            repair.one_sided += usize::from(patch.one_sided);
            if !patch.one_sided && parity[triangle] != patch.flipped {
                corners.swap(1, 2);
                repair.flipped += 1;
            }
        }
        (self, repair)
    }

    /// Becomes another mesh, with its edges, where fewer of them have one triangle alone.
    fn take_if_less_open(&mut self, edges: &mut Vec<EdgeUse>, mended: Self) -> bool {
        let its_edges = sorted_edges(&mended);
        let is_less = single_edges(&its_edges) < single_edges(edges);
        if is_less {
            (*self, *edges) = (mended, its_edges);
        }
        is_less
    }

    /// True where no patch, as it is, has less than nothing before it: bodies that face inwards have. Where the mesh is open it is told as
    /// far as vertical lines tell it.
    fn is_nowhere_inside_out(&self, edges: &[EdgeUse]) -> bool {
        let (of, _, patches) = patches(self, edges);
        let index = CrossingIndex::new(self.all_corners());
        let area = |&triangle: &usize| {
            let [a, b, c] = self.corners(triangle);
            (b - a).cross(c - a)
        };
        triangles_of(&of, patches.len()).iter().all(|own| {
            let largest = own.iter().max_by(|a, b| area(a).length().total_cmp(&area(b).length()));
            largest.is_none_or(|triangle| {
                let ([a, b, c], normal) = (self.corners(*triangle), area(triangle));
                let before = NEAR * normal.length().sqrt() * normal.normalize_or_zero();
                index.winding_number((a + b + c) / 3.0 + before) >= 0
            })
        })
    }

    /// Of each group of triangles that have the same `key`, keeps `keep(number of them)`.
    fn without_repeated(&self, key: fn([u32; 3]) -> [u32; 3], keep: impl Fn(usize) -> usize) -> Self {
        let mut left: HashMap<[u32; 3], usize> = HashMap::new();
        for &triangle in &self.triangles {
            *left.entry(key(triangle)).or_default() += 1;
        }
        left.values_mut().for_each(|count| *count = keep(*count));
        let mut kept = self.clone();
        kept.triangles.retain(|&triangle| {
            left.get_mut(&key(triangle)).is_some_and(|left| {
                let any = *left > 0;
                *left -= usize::from(any);
                any
            })
        });
        kept
    }
}

/// A triangle's corners, the same of triangles that are equal and face alike.
fn turned([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// A triangle's corners, the same of triangles that are equal, whichever way they face.
fn corners(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

/// Edges that triangles use more often one way than the other: none of a closed surface whose triangles face alike.
fn unbalanced_edges(edges: &[EdgeUse]) -> usize {
    let net = |run: &[EdgeUse]| run.iter().map(|&(.., upwards)| if upwards { 1 } else { -1 }).sum::<i32>();
    runs(edges).filter(|run| net(run) != 0).count()
}

/// Edges that an odd number of triangles uses: none of a closed surface, however its triangles face.
fn single_edges(edges: &[EdgeUse]) -> usize {
    runs(edges).filter(|run| run.len() % 2 == 1).count()
}

/// The patch of every triangle, its parity (against the patch's root), and the patches, flipped as most of their area faces.
fn patches(mesh: &Mesh, edges: &[EdgeUse]) -> (Vec<u32>, Vec<bool>, Vec<Patch>) {
    let mut groups = Groups::new(mesh.triangles.len());
    neighbours(edges).for_each(|(a, b, differ)| groups.join_with_parity(a, b, differ));
    // By root: two ways around lead to different parities.
    let mut one_sided = vec![false; mesh.triangles.len()];
    for (a, b, differ) in neighbours(edges) {
        let ((root, odd_a), (_, odd_b)) = (groups.root_and_parity(a), groups.root_and_parity(b));
        one_sided[root] |= (odd_a ^ odd_b) != differ;
    }
    let (lower, upper) = mesh.bounds().unwrap_or_default();
    let centre = (lower + upper) * 0.5;
    let mut number = vec![u32::MAX; mesh.triangles.len()];
    let (mut of, mut parity) = (Vec::new(), Vec::new());
    let mut patches: Vec<Patch> = Vec::new();
    for triangle in 0..mesh.triangles.len() {
        let (root, odd) = groups.root_and_parity(triangle);
        if number[root] == u32::MAX {
            number[root] = patches.len() as u32;
            patches.push(Patch {
                areas: [0.0; 2],
                volume: 0.0,
                lower: DVec3::INFINITY,
                upper: DVec3::NEG_INFINITY,
                one_sided: one_sided[root],
                closed: true,
                flipped: false,
            });
        }
        let patch = &mut patches[number[root] as usize];
        // A one-sided patch stays as it is, and so has no parity.
        let odd = odd && !patch.one_sided;
        let [a, b, c] = mesh.corners(triangle);
        patch.areas[usize::from(odd)] += (b - a).cross(c - a).length() / 2.0;
        let volume = (a - centre).dot((b - centre).cross(c - centre)) / 6.0;
        patch.volume += if odd { -volume } else { volume };
        patch.lower = patch.lower.min(a).min(b).min(c);
        patch.upper = patch.upper.max(a).max(b).max(c);
        of.push(number[root]);
        parity.push(odd);
    }
    for patch in &mut patches {
        patch.flipped = patch.areas[1] > patch.areas[0];
    }
    (of, parity, patches)
}

/// Finds out which patches have no boundary of their own once they are consistent.
fn close(edges: &[EdgeUse], of: &[u32], parity: &[bool], patches: &mut [Patch]) {
    for patch in patches.iter_mut() {
        patch.closed = !patch.one_sided && patch.areas != [0.0; 2];
    }
    let mut net: Vec<(u32, i32)> = Vec::new();
    for run in runs(edges) {
        net.clear();
        for &(_, triangle, upwards) in run {
            let (patch, odd) = (of[triangle as usize], parity[triangle as usize]);
            let sign = if upwards != odd { 1 } else { -1 };
            match net.iter_mut().find(|(known, _)| *known == patch) {
                Some((_, sum)) => *sum += sign,
                None => net.push((patch, sign)),
            }
        }
        for &(patch, _) in net.iter().filter(|(_, sum)| *sum != 0) {
            patches[patch as usize].closed = false;
        }
    }
}

/// Decides which way undetermined patches face, and makes outermost shells face outwards. `around` lists for every
/// closed patch those that it lies in; `in_open` says of each patch whether it is an outermost one of these and what is open lies around it.
fn choose_sides(around: &[Vec<usize>], in_open: &[bool], closed: &[usize], patches: &mut [Patch]) {
    let before: Vec<f64> = patches.iter().map(Patch::signed_volume).collect();
    let is_clear: Vec<bool> = patches.iter().map(Patch::is_clear).collect();
    // As a cavity of what is open it stays.
    let is_turned = |outermost: usize| before[outermost] < 0.0 && !in_open[outermost];
    for (around, &shell) in around.iter().zip(closed) {
        let outermost = around.first().copied().unwrap_or(shell);
        let turn = match around.first() {
            _ if !is_clear[shell] => {
                let depth = around.len() + usize::from(in_open[outermost]);
                (before[shell] < 0.0) == depth.is_multiple_of(2)
            }
            // What lies in a shell turns with it: what was a cavity stays one.
            Some(&outer) => is_clear[outer] && is_turned(outer),
            None => is_turned(shell),
        };
        patches[shell].flipped ^= turn;
    }
}

/// The triangles of every patch.
fn triangles_of(of: &[u32], patches: usize) -> Vec<Vec<usize>> {
    let mut triangles = vec![Vec::new(); patches];
    for (triangle, &patch) in of.iter().enumerate() {
        triangles[patch as usize].push(triangle);
    }
    triangles
}

#[cfg(test)]
mod tests;
