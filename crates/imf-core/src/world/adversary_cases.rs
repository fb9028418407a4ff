//! Tools and obstacles with which an adversary searches: ends, cones and arcs along planes of voxels, walls and sheets of one voxel, parts,
//! several obstacles that are turned, tools that are too wide or too long for short cuts.

use glam::{DQuat, DVec3};

use super::adversary_truth::Case;
use super::*;
use crate::field::solid::tests::awkward;
use crate::grid::Grid;
use crate::occupancy::Occupancy;
use crate::parts::ReferencePart;
use crate::scene::SceneSpec;
use crate::section::test_shapes::{arc, line, revolved};
use crate::tool::{ElementKind, Segment};

/// Outlines in voxels, so that their ends and radii meet planes of centres at any pitch.
fn tool(pitch: f64, elements: &[(ElementKind, &[Segment])]) -> Tool {
    let scaled = |profile: &[Segment]| profile.iter().map(|segment| segment.scaled(pitch)).collect();
    revolved(elements.iter().map(|(kind, profile)| (*kind, scaled(profile))))
}

const TOOLS: usize = 8;

fn tool_of(index: usize, pitch: f64) -> (&'static str, Tool) {
    use ElementKind::{Cutter, Holder, Shank};
    let of = |elements: &[(ElementKind, &[Segment])]| tool(pitch, elements);
    match index {
        0 => (
            "slot cutter",
            of(&[
                (Cutter, &[line(0.0, 4.0, 5.0, 5.0)]),
                (Shank, &[line(4.0, 10.0, 2.0, 2.0)]),
                (Holder(0), &[line(10.0, 18.0, 7.0, 7.0)]),
            ]),
        ),
        1 => (
            "ball",
            of(&[
                (Cutter, &[arc(0.0, 3.0, 3.0, 0.0, 3.0), line(3.0, 10.0, 3.0, 3.0)]),
                (Holder(0), &[line(10.0, 15.0, 3.0, 8.0), line(15.0, 20.0, 8.0, 8.0)]),
            ]),
        ),
        2 => (
            "drill",
            of(&[
                (Cutter, &[line(0.0, 2.0, 0.0, 2.0), line(2.0, 12.0, 2.0, 2.0)]),
                (Holder(0), &[line(12.0, 18.0, 8.0, 2.0)]),
            ]),
        ),
        3 => (
            "bull nose",
            of(&[
                (Cutter, &[arc(0.0, 2.0, 2.0, 2.0, 2.0), line(2.0, 9.0, 4.0, 7.0)]),
                (Shank, &[line(9.0, 14.0, 1.5, 1.5)]),
                (Holder(0), &[arc(14.0, 20.0, 17.0, 4.0, 5.0)]),
            ]),
        ),
        // Counted by its definition.
        4 => (
            "lens",
            of(&[(Cutter, &[arc(0.0, 4.0, 2.0, -1.0, 3.0)]), (Holder(0), &[line(4.0, 12.0, 5.0, 5.0)])]),
        ),
        5 => (
            "needle",
            of(&[(Cutter, &[line(0.0, 20.0, 0.75, 0.75)]), (Holder(0), &[line(20.0, 24.5, 6.5, 6.5)])]),
        ),
        6 => ("paper", in_voxels(Tool::paper(), pitch)),
        _ => ("awkward", in_voxels(awkward(), pitch)),
    }
}

/// A tool of which a voxel is a unit.
fn in_voxels(of: Tool, pitch: f64) -> Tool {
    let crate::tool::ToolShape::Revolved(elements) = of.shape else { unreachable!() };
    let all: Vec<_> = elements.iter().map(|element| (element.kind, element.profile.as_slice())).collect();
    tool(pitch, &all)
}

type Filled = (&'static str, [usize; 3], fn([usize; 3]) -> bool);

const OBSTACLES: [Filled; 11] = [
    ("voxel", [1, 1, 1], |_| true),
    ("scattered", [7, 8, 9], |[x, y, z]| (x * 73 + y * 179 + z * 283) % 17 == 0),
    ("wall across x", [9, 12, 11], |[x, ..]| x == 4),
    ("wall across y", [11, 9, 12], |[_, y, _]| y == 8),
    ("wall across z", [12, 11, 1], |_| true),
    ("sheet", [9, 9, 9], |[x, y, z]| x + y + z == 12),
    ("sheet along z", [12, 12, 9], |[x, y, _]| x == y),
    ("rod", [1, 1, 300], |_| true),
    ("block", [6, 7, 8], |_| true),
    ("ball", [11, 11, 11], |v| v.map(|c| c.abs_diff(5).pow(2)).iter().sum::<usize>() <= 25),
    ("comb", [12, 9, 10], |[x, y, z]| x % 3 == 0 && (y + z) % 2 == 0),
];

fn filled((_, dims, solid): Filled, origin: DVec3, pitch: f64) -> Occupancy {
    Occupancy::of(Grid { origin, pitch, dims }, solid)
}

const PITCHES: [f64; 5] = [1.0, 0.7, 0.3, 1.1, 2.54];
const ORIGINS: [DVec3; 3] =
    [DVec3::ZERO, DVec3::new(0.3, -1.0, 2.0), DVec3::new(1234.567, -9876.5, 10_000.1)];

fn alone(name: String, tool: &Tool, obstacle: impl Into<Obstacle>) -> Case {
    let mut world = World::builder().allow_coarse(true).build().unwrap();
    world.add_voxels(&name, obstacle, HERE).unwrap();
    Case::new(name, world.checker(tool, &Clearance::default()).unwrap())
}

/// Every tool around every generated obstacle.
fn generated() -> Vec<Case> {
    let mut found = Vec::new();
    for index in 0..TOOLS {
        for (place, &obstacle) in OBSTACLES.iter().enumerate() {
            let pitch = PITCHES[(index + place) % PITCHES.len()];
            let (name, tool) = tool_of(index, pitch);
            let origin = ORIGINS[(index + 2 * place) % ORIGINS.len()];
            found.push(alone(format!("{name}, {}", obstacle.0), &tool, filled(obstacle, origin, pitch)));
        }
    }
    found
}

/// Three that are turned, of three pitches, some of them far from the origin; the cutter may enter a layer of one.
fn placed() -> Vec<Case> {
    let turn = |axis: DVec3, angle: f64| DQuat::from_axis_angle(axis.normalize(), angle);
    let whole = filled(OBSTACLES[8], DVec3::ZERO, 1.0);
    let deeper = Obstacle::with_cuttable(&whole, Occupancy::of(whole.grid, |[_, _, z]| z > 4));
    let quarter = turn(DVec3::X, std::f64::consts::FRAC_PI_2);
    let case = |index: usize| {
        let mut world = World::builder().allow_coarse(true).build().unwrap();
        let (name, tool) = tool_of(index, 1.0);
        let far = DVec3::new(0.0, 1e5, -1e4) * (index % 3) as f64;
        let at = |x: f64, y: f64, z: f64, rotation| Pose::new(far + DVec3::new(x, y, z), rotation);
        let sheet = filled(OBSTACLES[5], DVec3::ONE, 0.7);
        world.add_voxels("block", deeper.clone(), at(0.0, 3.0, 1.0, quarter)).unwrap();
        world.add_voxels("sheet", sheet, at(12.0, 5.0, -2.0, turn(DVec3::ONE, 1.1))).unwrap();
        let rod = filled(OBSTACLES[7], DVec3::ZERO, 1.1);
        world.add_voxels("rod", rod, at(-5.0, -9.0, 4.0, turn(DVec3::new(0.2, 1.0, -0.4), 2.2))).unwrap();
        let room = Clearance { holder: 1.0, shank: 0.5, cutter: 0.0 };
        let room = if index.is_multiple_of(2) { Clearance::default() } else { room };
        Case::new(format!("{name}, three obstacles"), world.checker(&tool, &room).unwrap())
    };
    (0..TOOLS).map(case).collect()
}

/// The reference parts with their tool, coarser by the factor `coarser`.
fn parts(coarser: usize) -> Vec<Case> {
    let case = |part: ReferencePart| {
        let (mesh, tool) = (part.mesh(), Tool::paper());
        let dims = part.dims().map(|n| n.div_ceil(coarser));
        let scene = SceneSpec::of_reference(part, &mesh, dims, &tool).scene().unwrap();
        Case::new(part.to_string(), Checker::of_scene(&scene, &Clearance::default()).unwrap())
    };
    ReferencePart::ALL.map(case).into()
}

/// A disc wider than thousand voxels, and a tool `length` voxels long.
fn extreme(length: f64) -> Vec<Case> {
    let disc = [(ElementKind::Cutter, [line(0.0, 1.5, 1500.0, 1500.0)])];
    let disc = tool(0.1, &disc.each_ref().map(|(kind, profile)| (*kind, profile.as_slice())));
    let pitch = 0.02;
    let long = tool(
        pitch,
        &[
            (ElementKind::Cutter, &[line(0.0, 40.0, 3.0, 3.0)]),
            (ElementKind::Shank, &[line(40.0, 0.9 * length, 4.0, 4.0)]),
            (ElementKind::Holder(0), &[line(0.9 * length, length, 12.0, 9.0)]),
        ],
    );
    let mut found = vec![alone("long, scattered".into(), &long, filled(OBSTACLES[1], ORIGINS[1], pitch))];
    for obstacle in [OBSTACLES[1], OBSTACLES[2], OBSTACLES[4], OBSTACLES[7]] {
        found.push(alone(format!("disc, {}", obstacle.0), &disc, filled(obstacle, ORIGINS[1], 0.1)));
    }
    found
}

/// Everything, with parts coarser by the factor `coarser`.
pub(super) fn cases(coarser: usize) -> Vec<Case> {
    [generated(), placed(), parts(coarser), extreme(2e4)].into_iter().flatten().collect()
}

/// Everything at its own resolution; the longest tool is as long as any may be.
pub(super) fn long_cases() -> Vec<Case> {
    [generated(), placed(), parts(1), extreme(999_000.0)].into_iter().flatten().collect()
}
