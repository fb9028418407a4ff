//! The parts and tools of the closed forms, in millimetres.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use crate::mesh::Mesh;
use crate::parts::shell::{Axis, Facing as Side, Shell, circle, rectangle};
use crate::section::test_shapes::{line, revolved};
use crate::tool::{ElementKind, Segment, Tool, ToolShape};

/// A cutter, a shank of a radius up to 30, and a holder of diameter 24 up to 60.
pub(in crate::surface) fn tool(cutter: Vec<Segment>, shank: f64) -> Tool {
    let end = cutter.last().unwrap().range().1;
    revolved([
        (ElementKind::Cutter, cutter),
        (ElementKind::Shank, vec![Segment::cylinder(end, 30.0, shank)]),
        (ElementKind::Holder(0), vec![Segment::cylinder(30.0, 60.0, 12.0)]),
    ])
}

pub(in crate::surface) fn flat(radius: f64) -> Tool {
    tool(vec![Segment::cylinder(0.0, 20.0, radius)], radius)
}

pub(in crate::surface) fn ball(radius: f64) -> Tool {
    tool(vec![Segment::ball_end(radius), Segment::cylinder(radius, 20.0, radius)], radius)
}

/// A profile in (z, x), counter-clockwise, extruded along y.
pub(in crate::surface) fn extruded(profile: &[[f64; 2]], length: f64) -> Mesh {
    let outline: Vec<DVec2> = profile.iter().map(|&p| DVec2::from_array(p)).collect();
    let mut shell = Shell::default();
    shell.prism(Axis::Y, &outline, [0.0, length]);
    shell.into_mesh()
}

/// A block of 40 × 20 × 20 with a slot along y: a throat of a width in its top, and a head below.
pub(super) fn slotted(throat: f64, head: [f64; 2]) -> Mesh {
    let (t, bottom, top) = (throat / 2.0, head[0] / 2.0, head[1] / 2.0);
    let x = |offset: f64| 20.0 + offset;
    // (z, x): up the left side would be clockwise; from the origin along z is against it.
    let mut profile = vec![
        [0.0, 0.0],
        [20.0, 0.0],
        [20.0, x(-t)],
        [12.0, x(-t)],
        [12.0, x(-top)],
        [6.0, x(-bottom)],
        [6.0, x(bottom)],
        [12.0, x(top)],
        [12.0, x(t)],
        [20.0, x(t)],
        [20.0, 40.0],
        [0.0, 40.0],
    ];
    profile.dedup();
    let mut mesh = extruded(&profile, 20.0);
    if mesh.signed_volume() < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    mesh
}

/// A block of 30 × 30 × 20 with a spherical dimple of a radius in the middle of its top.
pub(super) fn dimpled(big: f64, depth: f64) -> Mesh {
    let centre = DVec2::splat(15.0);
    let middle = DVec3::new(15.0, 15.0, 20.0 - depth + big);
    let mut shell = Shell::default();
    let outer = rectangle([0.0, 30.0], [0.0, 30.0]);
    let rim = |i: usize| {
        let (sine, cosine) = (PI / 3.0 * i as f64 / 16.0).sin_cos();
        (circle(centre, big * sine, 64), middle.z - big * cosine)
    };
    shell.post(Axis::Z, &outer, [0.0, 20.0]);
    shell.face(Axis::Z, 0.0, Side::Down, &outer, &[]);
    shell.face(Axis::Z, 20.0, Side::Up, &outer, &[&rim(16).0]);
    for i in 1..=16 {
        let (upper, height) = rim(i);
        // The last ring lies in the top's own plane.
        let height = if i == 16 { 20.0 } else { height };
        if i == 1 {
            shell.face(Axis::Z, height, Side::Up, &upper, &[]);
        } else {
            let (lower, below) = rim(i - 1);
            shell.band(&Axis::Z.place(&upper, height), &Axis::Z.place(&lower, below));
        }
    }
    shell.into_mesh()
}

/// A cylinder along z from the origin up.
pub(super) fn cylinder(radius: f64, height: f64) -> Mesh {
    let mut shell = Shell::default();
    shell.prism(Axis::Z, &circle(DVec2::ZERO, radius, 128), [0.0, height]);
    shell.into_mesh()
}

/// A cutter that widens from a radius at the tip by a half angle, up to a height.
pub(in crate::surface) fn tapered(radius: f64, degrees: f64, height: f64) -> Tool {
    let top = radius + height * degrees.to_radians().tan();
    tool(vec![line(0.0, height, radius, top)], radius)
}

/// A tool that is a mesh.
pub(in crate::surface) fn of_mesh(mesh: Mesh) -> Tool {
    Tool { name: "mesh".into(), shape: ToolShape::Mesh(mesh), ..Tool::paper() }
}
