//! What can be said about a mesh: which triangles use its edges and which way, its boundary, its pieces, its volume, and a report for
//! the user.
//!
//! Everything here follows vertex indices, not positions: vertices that coincide must be shared
//! ([`Mesh::welded`]; the readers do so).

use std::fmt;

use glam::DVec3;
use serde::Serialize;

use super::Mesh;
use super::groups::Groups;
use crate::parallel;
use crate::unit::{DisplayLength, LengthUnit};

/// A triangle counts as degenerate if it is this thin: twice its area over its longest edge squared.
const DEGENERATE_RATIO: f64 = 1e-12;

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

/// No triangle, nor anything else that is numbered.
pub(crate) const NONE: u32 = u32::MAX;

/// By triangle, of `count`, up to three [`neighbours`], then [`NONE`].
pub(crate) fn beside(edges: &[EdgeUse], count: usize) -> Vec<[u32; 3]> {
    let mut beside = vec![[NONE; 3]; count];
    for (one, other, _) in neighbours(edges) {
        for (triangle, other) in [(one, other), (other, one)] {
            if let Some(free) = beside[triangle].iter_mut().find(|known| **known == NONE) {
                *free = other as u32;
            }
        }
    }
    beside
}

/// The boundary of a mesh as a 1-chain, `∂ Σ triangles`.
///
/// For each edge the net number of directed uses by triangles, a→b minus b→a, is counted. Edges where it is not zero
/// are listed in the direction of the surplus with its (positive) size, sorted by the directed vertex pair.
/// The list is empty exactly when the directed uses of every edge cancel, and at every vertex as much goes in as out.
/// It is defined for any triangles at all: edges shared by one, three or more, neighbours that disagree on
/// orientation, triangles that name a vertex twice. It is what a generalised winding number of an open mesh depends on.
pub(crate) fn boundary_chain(mesh: &Mesh) -> Vec<([u32; 2], i32)> {
    let edges = sorted_edges(mesh);
    let mut chain: Vec<_> = runs(&edges)
        .filter_map(|run| {
            let [low, high] = run[0].0;
            match run.iter().map(|&(.., upwards)| if upwards { 1 } else { -1 }).sum::<i32>() {
                0 => None,
                net if net > 0 => Some(([low, high], net)),
                net => Some(([high, low], -net)),
            }
        })
        .collect();
    chain.sort_unstable();
    chain
}

/// Number of pieces of a mesh: sets of triangles connected by shared vertices.
pub(crate) fn component_count(mesh: &Mesh) -> usize {
    let mut groups = Groups::new(mesh.vertices.len());
    for &[a, b, c] in &mesh.triangles {
        groups.join(a as usize, b as usize);
        groups.join(b as usize, c as usize);
    }
    let mut is_first = vec![false; mesh.vertices.len()];
    mesh.triangles.iter().for_each(|triangle| is_first[groups.root(triangle[0] as usize)] = true);
    is_first.into_iter().filter(|is_first| *is_first).count()
}

/// Facts about a mesh. Lengths and volumes are in the mesh's own unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshReport {
    /// Number of triangles.
    pub triangles: usize,
    /// Number of vertices.
    pub vertices: usize,
    /// Edge lengths of the box around the mesh along x, y and z; zero without triangles.
    pub extents: DVec3,
    /// Triangles without area: twice the area is at most 10⁻¹² of the longest edge squared.
    pub degenerate_triangles: usize,
    /// Edges whose directed uses do not cancel: borders of holes, or seams between triangles that disagree on
    /// orientation.
    pub boundary_edges: usize,
    /// Pieces connected by shared vertices.
    pub components: usize,
    /// Volume by the divergence theorem, below 0 where a closed mesh faces inwards on the whole; only of an orienting kind
    /// (about the box's centre) when the mesh is open.
    pub signed_volume: f64,
    /// There are triangles, and the mesh has no boundary.
    pub closed: bool,
}

impl MeshReport {
    /// Examines a mesh.
    ///
    /// # Panics
    /// If a triangle names a vertex that does not exist.
    #[must_use]
    pub fn new(mesh: &Mesh) -> Self {
        let boundary_edges = boundary_chain(mesh).len();
        let closed = boundary_edges == 0 && !mesh.triangles.is_empty();
        Self {
            triangles: mesh.triangles.len(),
            vertices: mesh.vertices.len(),
            extents: mesh.bounds().map_or(DVec3::ZERO, |(lower, upper)| upper - lower),
            degenerate_triangles: mesh.all_corners().filter(is_degenerate).count(),
            boundary_edges,
            components: component_count(mesh),
            signed_volume: mesh.signed_volume(),
            closed,
        }
    }

    /// The report as a few lines of text, with lengths in `unit`.
    #[must_use]
    pub fn display(&self, unit: LengthUnit) -> impl fmt::Display + '_ {
        fmt::from_fn(move |f| self.write(f, unit))
    }

    fn write(&self, f: &mut fmt::Formatter<'_>, unit: LengthUnit) -> fmt::Result {
        let count = |n: usize, noun: &str| format!("{n} {noun}{}", if n == 1 { "" } else { "s" });
        let [x, y, z] = self.extents.to_array().map(DisplayLength);
        write!(f, "extents     {x} × {y} × {z} {unit}")?;
        let vertices =
            if self.vertices == 1 { "1 vertex".into() } else { format!("{} vertices", self.vertices) };
        let components = count(self.components, "component");
        write!(f, "\ntriangles   {} on {vertices}, {components}", self.triangles)?;
        if self.degenerate_triangles > 0 {
            write!(f, ", {} without area", self.degenerate_triangles)?;
        }
        if self.closed {
            write!(f, "\nsurface     closed, volume ")?;
            match self.signed_volume.abs() {
                volume if volume.is_finite() => write!(f, "{} {unit}³", DisplayLength(volume))?,
                _ => write!(f, "too large to be computed")?,
            }
            if self.components > 1 {
                write!(f, " (of all components, added up)")?;
            }
        } else {
            let edges = count(self.boundary_edges, "boundary edge");
            write!(f, "\nsurface     open: {edges}, from holes or triangles that face the wrong way")?;
            write!(f, " (what is inside is decided by the winding number)")?;
        }
        Ok(())
    }
}

pub(super) fn is_degenerate(&[a, b, c]: &[DVec3; 3]) -> bool {
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    (b - a).cross(c - a).length() <= DEGENERATE_RATIO * longest
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::DMat4;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::mesh::tests::unit_cube;

    fn triangles_of(triangles: Vec<[u32; 3]>) -> Mesh {
        let count = triangles.iter().flatten().max().map_or(0, |&v| v as usize + 1);
        let vertices = (0..count).map(|v| DVec3::new(v as f64, (v * v) as f64, (v % 3) as f64)).collect();
        Mesh { vertices, triangles }
    }

    #[test]
    fn the_boundary_of_a_boundary_is_zero_for_any_triangles() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for round in 0..200 {
            // Few vertices, many triangles: edges of any multiplicity, repeated vertices, every orientation.
            let vertices = 1 + round % 9;
            let triangles: Vec<_> =
                (0..round).map(|_| [(); 3].map(|()| random.random_range(0..vertices))).collect();
            let mesh = triangles_of(triangles);
            let chain = boundary_chain(&mesh);
            let mut net = BTreeMap::<u32, i32>::new();
            for &([from, to], multiplicity) in &chain {
                assert!(multiplicity > 0 && from != to);
                *net.entry(from).or_default() -= multiplicity;
                *net.entry(to).or_default() += multiplicity;
            }
            assert!(net.values().all(|&surplus| surplus == 0), "{chain:?}");
            // Against the definition, edge by edge.
            let uses = |from: u32, to: u32| -> i32 {
                let pairs = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
                mesh.triangles.iter().flat_map(pairs).filter(|&pair| pair == [from, to]).count() as i32
            };
            let listed: BTreeMap<_, _> = chain.iter().copied().collect();
            assert_eq!(listed.len(), chain.len());
            for from in 0..vertices {
                for to in (0..vertices).filter(|&to| to != from) {
                    let surplus = (uses(from, to) - uses(to, from)).max(0);
                    assert_eq!(listed.get(&[from, to]).copied().unwrap_or(0), surplus);
                }
            }
        }
    }

    #[test]
    fn boundaries_of_known_shapes() {
        assert_eq!(boundary_chain(&unit_cube()), []);
        let one = triangles_of(vec![[2, 0, 1]]);
        assert_eq!(boundary_chain(&one), [([0, 1], 1), ([1, 2], 1), ([2, 0], 1)]);
        // Two neighbours that disagree: the shared edge is used twice in the same direction.
        let twisted = triangles_of(vec![[0, 1, 2], [0, 1, 3]]);
        assert!(boundary_chain(&twisted).contains(&([0, 1], 2)));
        // Three pages of a book.
        let book = triangles_of(vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
        assert!(boundary_chain(&book).contains(&([0, 1], 1)));
        // A triangle and its reverse are nothing, and so is a triangle that names a vertex twice.
        assert_eq!(boundary_chain(&triangles_of(vec![[0, 1, 2], [2, 1, 0], [3, 4, 4]])), []);
    }

    #[test]
    fn the_report_tells_closed_open_and_inverted_apart() {
        let cube = unit_cube();
        let report = MeshReport::new(&cube);
        assert!(report.closed);
        assert_eq!((report.triangles, report.vertices, report.components), (12, 8, 1));
        assert!((report.signed_volume - 1.0).abs() < 1e-15);
        assert_eq!(report.extents, DVec3::ONE);

        let mut inverted = cube.clone();
        inverted.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        let report = MeshReport::new(&inverted);
        assert!(report.closed && report.signed_volume < 0.0);
        assert!(report.display(LengthUnit::Cm).to_string().contains("closed, volume 1 cm³"));

        let huge = MeshReport::new(&cube.transformed(&DMat4::from_scale(DVec3::splat(1e300))));
        let text = huge.display(LengthUnit::Mm).to_string();
        assert!(text.contains("closed, volume too large to be computed"), "{text}");

        let mut open = cube.clone();
        open.triangles.truncate(10);
        let report = MeshReport::new(&open);
        assert!(!report.closed);
        assert_eq!(report.boundary_edges, 4);
        let text = report.display(LengthUnit::Mm).to_string();
        assert!(text.contains("1 × 1 × 1 mm") && text.contains("open: 4 boundary edges"), "{text}");

        let mut two = cube.clone();
        two.append(&cube);
        two.triangles.push([0, 0, 1]);
        let report = MeshReport::new(&two);
        assert_eq!((report.components, report.degenerate_triangles), (2, 1));
        assert_eq!(MeshReport::new(&two.welded()).components, 1);
        assert!(!MeshReport::new(&Mesh::default()).closed);
    }
}
