//! Head, tool, table and part of small machines against 4 by 4 matrices that try every centre.

use std::rc::Rc;
use std::sync::Arc;

use glam::{DMat4, DVec3};

mod on_table;
mod reach;
mod refusals;

use super::*;
use crate::grid::Grid;
use crate::machine::tests::{FREE, axis, head_to_table, machine_of};
use crate::machine::{Joints, Machine, MachineMotion, MachineSolid, Side, SolidShape};
use crate::section::test_shapes::{line, revolved};
use crate::tool::ElementKind;
use crate::toolpath::{Location, MachinePoint, MoveKind};

fn cylinder(
    name: &str,
    side: Side,
    level: usize,
    base: [f64; 3],
    top: [f64; 3],
    diameter: f64,
) -> MachineSolid {
    let shape = SolidShape::Cylinder { base: DVec3::from_array(base), top: DVec3::from_array(top), diameter };
    MachineSolid { name: name.into(), side, level, shape }
}

fn cuboid(name: &str, side: Side, level: usize, lower: [f64; 3], upper: [f64; 3]) -> MachineSolid {
    let shape = SolidShape::Box { lower: DVec3::from_array(lower), upper: DVec3::from_array(upper) };
    MachineSolid { name: name.into(), side, level, shape }
}

/// Two machines with their axes a little apart: both rotary axes in the table, and one on either side.
fn machines() -> [Machine; 2] {
    let machine = |rotary, solids| {
        let machine = Machine {
            travel: [FREE, FREE, [-60.0, 25.0]],
            offsets: [(54, DVec3::new(1.0, -2.0, -40.0))].into(),
            solids,
            ..machine_of(rotary)
        };
        assert_eq!(machine.fault(), None);
        machine
    };
    let trunnion = machine(
        vec![
            axis('A', Side::Table, [1.0, 0.0, 0.0], [0.0, 1.0, -44.0], FREE),
            axis('C', Side::Table, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], FREE),
        ],
        vec![
            cylinder("platter", Side::Table, 2, [1.0, 0.0, -44.0], [1.0, 0.0, -40.0], 14.0),
            cuboid("cradle", Side::Table, 1, [-12.0, -3.0, -49.0], [12.0, 3.0, -46.0]),
            cuboid("bed", Side::Table, 0, [-15.0, -8.0, -62.0], [15.0, 8.0, -56.0]),
            cylinder("nose", Side::Head, 0, [0.0, 0.0, 0.0], [0.0, 0.0, 9.0], 10.0),
            cuboid("ram", Side::Head, 0, [-7.0, 5.0, 2.0], [7.0, 9.0, 12.0]),
        ],
    );
    let mixed = machine(
        vec![
            axis('B', Side::Head, [0.0, 1.0, 0.0], [0.5, 0.0, 8.0], FREE),
            axis('C', Side::Table, [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], FREE),
        ],
        vec![
            cylinder("platter", Side::Table, 1, [1.0, 0.0, -44.0], [1.0, 0.0, -40.0], 14.0),
            cuboid("bed", Side::Table, 0, [-15.0, -8.0, -50.0], [15.0, 8.0, -45.0]),
            cylinder("nose", Side::Head, 1, [0.0, 0.0, 0.0], [0.0, 0.0, 9.0], 10.0),
            cuboid("column", Side::Head, 0, [-3.0, 6.0, 0.0], [3.0, 9.0, 12.0]),
        ],
    );
    [trunnion, mixed]
}

/// A flat end of 4 in a holder of 8, 20 in all.
fn tool() -> Tool {
    revolved([
        (ElementKind::Cutter, vec![line(0.0, 12.0, 2.0, 2.0)]),
        (ElementKind::Holder(0), vec![line(12.0, 20.0, 4.0, 4.0)]),
    ])
}

/// A block on the platter, in the part's frame.
fn part() -> Occupancy {
    let grid = Grid { origin: DVec3::new(-4.0, -3.0, 0.0), pitch: 1.0, dims: [8, 8, 6] };
    Occupancy::of(grid, |[x, _, z]| z < 4 || x < 3)
}

/// How deep a point lies in a body of the head, negative outside; with all axes at 0.
type Inside = Rc<dyn Fn(DVec3) -> f64>;

struct Pair {
    element: String,
    against: HitBody,
    levels: (usize, usize),
    centres: Vec<DVec3>,
    inside: Inside,
}

impl Pair {
    /// How deep each centre lies in the body of the head.
    fn depths(&self, machine: &Machine, joints: &Joints) -> impl Iterator<Item = f64> {
        let matrix = to_head(machine, joints, self.levels);
        self.centres.iter().map(move |centre| (self.inside)(matrix.transform_point3(*centre)))
    }
}

/// All pairs that a check tries, with their centres in machine coordinates with all axes at 0.
fn pairs(machine: &Machine, bodies: &MachineBodies, part: &Occupancy) -> Vec<Pair> {
    let top = (machine.axes_of(Side::Head), machine.axes_of(Side::Table));
    let mut own: Vec<(String, usize, Inside)> = Vec::new();
    for (name, from, to, radius) in [("cutter", 0.0, 12.0, 2.0_f64), ("holder 1", 12.0, 20.0, 4.0)] {
        let inside = move |point: DVec3| {
            let height: f64 = point.z + 20.0;
            (height - from).min(to - height).min(radius - point.x.hypot(point.y))
        };
        own.push((name.into(), top.0, Rc::new(inside)));
    }
    for solid in machine.solids.iter().filter(|solid| solid.side == Side::Head) {
        let inside: Inside = match solid.shape {
            SolidShape::Cylinder { base, top, diameter } => Rc::new(move |point| {
                let (along, length) = ((top - base).normalize(), base.distance(top));
                let height = along.dot(point - base);
                let radius = (point - base - along * height).length();
                height.min(length - height).min(0.5 * diameter - radius)
            }),
            SolidShape::Box { lower, upper } => {
                Rc::new(move |point| (point - lower).min(upper - point).min_element())
            }
            SolidShape::Mesh(_) => panic!("no mesh here"),
        };
        own.push((solid.name.clone(), solid.level, inside));
    }
    let centres = |voxels: &Occupancy, offset: DVec3| -> Vec<DVec3> {
        voxels.centres().map(|centre| centre + offset).collect()
    };
    let mut others = vec![(HitBody::Part, top.1, centres(part, machine.part_zero()))];
    for solid in machine.solids.iter().filter(|solid| solid.side == Side::Table) {
        let voxels = solid.voxels(1.0, Control::quiet()).unwrap().solid;
        others.push((HitBody::Machine(solid.name.clone()), solid.level, centres(&voxels, DVec3::ZERO)));
    }
    assert_eq!(bodies.coarsest_pitch(), Some(1.0));
    let mut pairs = Vec::new();
    for (element, head, inside) in &own {
        for (against, table, centres) in &others {
            let (element, against, centres) = (element.clone(), against.clone(), centres.clone());
            pairs.push(Pair { element, against, levels: (*head, *table), centres, inside: inside.clone() });
        }
    }
    pairs
}

/// From what stands on the table to what hangs on the head, both where they are with all axes at 0.
fn to_head(machine: &Machine, joints: &Joints, levels: (usize, usize)) -> DMat4 {
    head_to_table(machine, joints, levels).inverse()
}

fn random(seed: usize) -> Joints {
    let of = |step: f64, span: f64| ((seed as f64 * step).fract() - 0.5) * span;
    Joints {
        linear: DVec3::new(of(0.618_033, 26.0), of(0.754_877, 26.0), of(0.569_840, 40.0) - 22.0),
        rotary: [of(0.414_213, 200.0), of(0.302_775, 360.0)],
    }
}

fn location(machine: &Machine, line: usize, joints: Joints, kind: MoveKind, straight: bool) -> Location {
    let point = MachinePoint { joints, length: 20.0, tip_goes_straight: straight, by_spindle: false };
    let pose = machine.forward(&joints, 20.0);
    Location { line, pose, rolled: true, tool: None, kind, machine: Some(point) }
}

/// Locations to which no way leads, each with its line.
fn starts(machine: &Machine, joints: impl IntoIterator<Item = (usize, Joints)>) -> Toolpath {
    let start = |(line, joints)| location(machine, line, joints, MoveKind::Start, true);
    Toolpath { locations: joints.into_iter().map(start).collect(), ..Toolpath::default() }
}

/// From line 1 to line 2.
fn path_between(machine: &Machine, from: Joints, to: Joints, straight: bool) -> Toolpath {
    let locations = vec![
        location(machine, 1, from, MoveKind::Start, straight),
        location(machine, 2, to, MoveKind::Feed, straight),
    ];
    Toolpath { locations, ..Toolpath::default() }
}

fn strict(step: f64) -> CheckSettings {
    CheckSettings { contact: 0.0, step, ..CheckSettings::of_pitch(1.0, LengthUnit::Mm) }
}

fn check_path(
    part: &Occupancy,
    bodies: &MachineBodies,
    path: &Toolpath,
    settings: &CheckSettings,
) -> Result<CheckReport, CheckError> {
    let bodies = CheckBodies { machine: Some(bodies), ..CheckBodies::of_part(part) };
    check_toolpath(bodies, &[(None, &tool())], path, settings, Control::quiet())
}

#[test]
fn every_contact_of_any_pair_is_found_however_shallow() {
    assert!(shallow_contacts(6_000) > 2_000);
}

#[test]
#[ignore = "two minutes"]
fn a_hundred_thousand_shallow_contacts_are_all_found() {
    assert!(shallow_contacts(220_000) > 100_000);
}

/// Tries `poses` poses of each machine; returns how many contacts were less than 1 mm deep.
fn shallow_contacts(poses: usize) -> usize {
    let part = part();
    let mut shallow = 0;
    for machine in machines() {
        let bodies = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
        let pairs = pairs(&machine, &bodies, &part);
        let path = starts(&machine, (1..=poses).map(|line| (line, random(line))));
        let report = check_path(&part, &bodies, &path, &strict(0.25)).unwrap();
        let mut at = 0;
        for line in 1..=poses {
            let joints = random(line);
            let found = match report.colliding.get(at).filter(|own| own.line == line) {
                Some(own) => {
                    at += 1;
                    own.collisions.as_slice()
                }
                None => &[],
            };
            for pair in &pairs {
                let (mut voxels, mut deepest, mut near) = (0, f64::NEG_INFINITY, false);
                for depth in pair.depths(&machine, &joints) {
                    voxels += u32::from(depth > 0.0);
                    deepest = deepest.max(depth);
                    near |= depth.abs() < 1e-6;
                }
                if near {
                    continue;
                }
                let hit = found.iter().find(|c| c.element == pair.element && c.against == pair.against);
                let context =
                    || format!("{} {:?} line {line}: {voxels} {deepest}", pair.element, pair.against);
                assert_eq!(hit.map_or(0, |hit| hit.voxels), voxels, "{}", context());
                shallow += usize::from(voxels > 0 && deepest < 1.0);
                if let Some(hit) = hit {
                    assert!(
                        (hit.depth_in_tool - deepest).abs() < 1e-3 || hit.depth > deepest,
                        "{}",
                        context()
                    );
                    // The contact point, which is reported in the part's frame, is one of the centres in the element.
                    let by_part = to_head(&machine, &joints, (pair.levels.0, machine.axes_of(Side::Table)));
                    let contact =
                        by_part.transform_point3(DVec3::from_array(hit.contact) + machine.part_zero());
                    assert!((pair.inside)(contact) > -1e-6, "{} {contact}", context());
                }
            }
        }
        let beyond = report.out_of_travel.len();
        let expected =
            (1..=poses).filter(|&line| random(line).linear.z < -60.0 || random(line).linear.z > 25.0).count();
        assert_eq!(beyond, expected);
    }
    shallow
}

#[test]
fn nothing_is_passed_over_between_two_lines() {
    let part = part();
    let step = 0.5;
    let (mut seen, mut crossed) = (0, 0);
    for machine in machines() {
        let bodies = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
        let pairs = pairs(&machine, &bodies, &part);
        for seed in 0..60 {
            let straight = seed % 2 == 0;
            let (from, mut to) = (random(seed + 5), random(3 * seed + 11));
            to.rotary = [0, 1].map(|i| from.rotary[i] + 0.3 * (to.rotary[i] - from.rotary[i]));
            let path = path_between(&machine, from, to, straight);
            let report = check_path(&part, &bodies, &path, &strict(step)).unwrap();
            let way = MachineMotion::new(&machine, from, to, 20.0, straight);
            for pair in &pairs {
                let mut deepest = f64::NEG_INFINITY;
                for step in 0..=150 {
                    let joints = way.joints(f64::from(step) / 150.0);
                    deepest = pair.depths(&machine, &joints).fold(deepest, f64::max);
                }
                let of_line = |line: usize| {
                    let own = report.colliding.iter().find(|own| own.line == line);
                    own.is_some_and(|own| {
                        own.collisions.iter().any(|c| c.element == pair.element && c.against == pair.against)
                    })
                };
                let found = of_line(1) || of_line(2);
                seen += usize::from(found);
                crossed += usize::from(deepest > 0.5 * step);
                // What is deeper than half a step at any time holds its centre at a sampled pose.
                assert!(found || deepest <= 0.5 * step + 1e-9, "{} {:?} {seed}", pair.element, pair.against);
            }
        }
    }
    assert!(seen > 200 && crossed > 200, "{seen} {crossed}");
}

#[test]
fn a_head_keeps_its_clearance_and_a_mesh_or_thin_solid_says_what_it_cannot() {
    let part = part();
    let mut machine = machines()[0].clone();
    machine.solids.retain(|solid| solid.name == "nose");
    // The nose's face 1.5 above the part's top at z = −34, beside the tool.
    let joints = Joints { linear: DVec3::new(-3.0, 0.0, -32.5), rotary: [0.0; 2] };
    let path = starts(&machine, [(1, joints)]);
    let run = |machine: &Machine, holder: f64| {
        let bodies = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
        let clearance = Clearance { holder, ..Clearance::default() };
        check_path(&part, &bodies, &path, &CheckSettings { clearance, ..strict(0.25) })
    };
    let hits = |report: CheckReport| -> Vec<String> {
        report.colliding.iter().flat_map(|line| &line.collisions).map(|hit| hit.element.clone()).collect()
    };
    assert!(!hits(run(&machine, 0.0).unwrap()).contains(&"nose".to_owned()));
    assert!(hits(run(&machine, 2.5).unwrap()).contains(&"nose".to_owned()));
    machine.solids[0].shape = SolidShape::Mesh(Mesh::cuboid(DVec3::splat(-5.0), DVec3::splat(5.0)));
    assert!(hits(run(&machine, 0.0).unwrap()).contains(&"nose".to_owned()));
    assert!(run(&machine, 1.0).unwrap_err().to_string().contains("'nose' is a mesh"));
    machine.solids[0].shape = SolidShape::Box { lower: DVec3::ZERO, upper: DVec3::new(9.0, 9.0, 1.0) };
    assert!(run(&machine, 0.0).unwrap_err().to_string().contains("'nose' is 1 thick"));
    // A path that was read for no machine is not followed by one.
    let other = Toolpath::parse("x,y,z\n0,0,30\n", LengthUnit::Mm, "path").unwrap();
    let bodies = MachineBodies::new(machines()[0].clone(), 1.0, Control::quiet()).unwrap();
    assert!(matches!(
        check_path(&part, &bodies, &other, &strict(0.25)),
        Err(CheckError::Line { line: 2, fault: LineFault::Machine })
    ));
}
