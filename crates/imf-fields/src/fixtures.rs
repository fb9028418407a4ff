//! What several tests begin with.

use glam::DVec3;
use imf_core::mesh::Mesh;
use imf_core::tool::{Element, ElementKind, Segment, SharpPoints, Tool, ToolShape};
use imf_core::unit::LengthUnit;

/// The cube from 0 to 1.
pub(crate) fn unit_cube() -> Mesh {
    let vertices = (0..8).map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)));
    let sides: [[u32; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    Mesh { vertices: vertices.collect(), triangles: triangles.collect() }
}

/// A cutter and a holder of a few voxels.
pub(crate) fn small_tool() -> Tool {
    let line = |from, to, r| Segment::Line { from, to, radius_from: r, radius_to: r };
    let element = |kind, segment| Element { kind, profile: vec![segment] };
    Tool {
        name: "small".into(),
        unit: LengthUnit::Mm,
        shape: ToolShape::Revolved(vec![
            element(ElementKind::Cutter, line(0.0, 5.0, 1.2)),
            element(ElementKind::Holder(0), line(5.0, 9.0, 2.7)),
        ]),
        sharp_points: SharpPoints::Tip,
        overall_length: None,
        back_cutting: false,
    }
}
