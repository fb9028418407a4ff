//! Random prismatic parts: a block with pockets and holes in its six sides, blind or right through, none meeting another.

use glam::{DVec2, DVec3};
use imf_core::mesh::Mesh;
use imf_core::parts::shell::{Axis, Facing, Shell, circle, rounded_rectangle};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Material between two features, and between a feature and an edge, in millimetres.
const WALL: f64 = 2.0;
/// Features that are tried; those that meet another are left out.
const TRIED: usize = 60;
/// Features at most.
const MOST: usize = 16;
/// Corner segments of pockets and of holes.
const QUARTER: usize = 6;
const CIRCLE: usize = 32;

const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

/// A pocket or a hole.
struct Feature {
    /// Index of its axis, and whether it goes down from the upper side.
    axis: usize,
    from_above: bool,
    through: bool,
    outline: Vec<DVec2>,
    /// Heights along the axis.
    heights: [f64; 2],
}

impl Feature {
    /// Drawn at random; corners take a cutter of 6 mm.
    fn random(random: &mut ChaCha8Rng, size: DVec3) -> Option<Self> {
        let axis = random.random_range(0..3);
        let from_above = random.random_bool(0.5);
        let through = random.random_bool(0.15);
        let (along, plane) = (size[axis], DVec2::new(size[(axis + 1) % 3], size[(axis + 2) % 3]));
        let depth = if through { along } else { random.random_range(4.0..0.6 * along) };
        let round = random.random_bool(0.4);
        let extent = if round {
            DVec2::splat(random.random_range(7.0..14.0))
        } else {
            DVec2::new(random.random_range(9.0..0.7 * plane.x), random.random_range(9.0..0.7 * plane.y))
        };
        let room = plane - extent - 2.0 * WALL;
        if room.min_element() <= 0.0 {
            return None;
        }
        let lower = WALL + room * DVec2::new(random.random(), random.random());
        let outline = if round {
            circle(lower + 0.5 * extent, 0.5 * extent.x, CIRCLE)
        } else {
            rounded_rectangle(lower, lower + extent, random.random_range(3.2..4.4), QUARTER)
        };
        let heights = if from_above { [along - depth, along] } else { [0.0, depth] };
        Some(Self { axis, from_above, through, outline, heights })
    }

    /// Lower and upper corner.
    fn bounds(&self) -> [DVec3; 2] {
        let corners = self.outline.iter().flat_map(|&p| self.heights.map(|h| AXES[self.axis].point(p, h)));
        corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[lower, upper], p| [lower.min(p), upper.max(p)])
    }

    fn meets(&self, other: &Self) -> bool {
        let ([a, b], [c, d]) = (self.bounds(), other.bounds());
        (a - WALL).cmplt(d).all() && (c - WALL).cmplt(b).all()
    }

    /// True where it opens in the upper or the lower side of its axis.
    fn opens(&self, axis: usize, above: bool) -> bool {
        self.axis == axis && (self.through || self.from_above == above)
    }
}

/// A part in millimetres, closed, the same for the same seed.
pub(crate) fn prismatic(seed: u64) -> Mesh {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let size = DVec3::new(
        random.random_range(45.0..80.0),
        random.random_range(35.0..60.0),
        random.random_range(25.0..50.0),
    );
    let mut features: Vec<Feature> = Vec::new();
    for _ in 0..TRIED {
        let feature = Feature::random(&mut random, size);
        if let Some(feature) = feature.filter(|new| !features.iter().any(|old| old.meets(new))) {
            features.push(feature);
        }
        if features.len() == MOST {
            break;
        }
    }
    let mut shell = Shell::default();
    for (index, axis) in AXES.into_iter().enumerate() {
        let (along, x, y) = (size[index], size[(index + 1) % 3], size[(index + 2) % 3]);
        let outer = [DVec2::ZERO, DVec2::new(x, 0.0), DVec2::new(x, y), DVec2::new(0.0, y)];
        for (height, facing, above) in [(0.0, Facing::Down, false), (along, Facing::Up, true)] {
            let open = features.iter().filter(|feature| feature.opens(index, above));
            let holes: Vec<&[DVec2]> = open.map(|feature| feature.outline.as_slice()).collect();
            shell.face(axis, height, facing, &outer, &holes);
        }
        for feature in features.iter().filter(|feature| feature.axis == index) {
            shell.hole(axis, &feature.outline, feature.heights);
            if !feature.through {
                let [low, high] = feature.heights;
                let (height, facing) =
                    if feature.from_above { (low, Facing::Up) } else { (high, Facing::Down) };
                shell.face(axis, height, facing, &feature.outline, &[]);
            }
        }
    }
    shell.into_mesh()
}

#[cfg(test)]
mod tests {
    use imf_core::mesh::topology::MeshReport;

    use super::*;

    #[test]
    fn parts_are_closed_and_have_features_on_several_sides() {
        for seed in 0..20 {
            let mesh = prismatic(seed);
            let report = MeshReport::new(&mesh);
            assert!(report.closed, "{seed}: {report:?}");
            let (lower, upper) = mesh.bounds().unwrap();
            let box_volume = (upper - lower).element_product();
            let volume = mesh.signed_volume();
            assert!(
                volume < 0.97 * box_volume && volume > 0.3 * box_volume,
                "{seed}: {volume} of {box_volume}"
            );
            // Faces that look into the block from a floor of their own, by the side that they look to.
            let sides = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
            let floor = |side: &DVec3| {
                let outside = if side.element_sum() > 0.0 { upper } else { lower }.dot(*side);
                (0..mesh.triangles.len()).any(|triangle| {
                    let [a, b, c] = mesh.corners(triangle);
                    let normal = (b - a).cross(c - a).normalize_or_zero();
                    normal.dot(*side) > 0.999 && a.dot(*side) < outside - 1.0
                })
            };
            assert!(sides.filter(floor).count() >= 3, "{seed}");
        }
    }
}
