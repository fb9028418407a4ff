//! A part against those solids of the table that do not turn with it, by matrices that test every centre.

use super::*;

/// A solid of the table that does not move with the part, by its voxels.
pub(super) struct Still {
    name: String,
    level: usize,
    voxels: Occupancy,
}

pub(super) fn still(machine: &Machine) -> Vec<Still> {
    let top = machine.axes_of(Side::Table);
    let solids = machine.solids.iter().filter(|solid| solid.side == Side::Table && solid.level < top);
    let of = |solid: &MachineSolid| {
        let voxels = solid.voxels(1.0, Control::quiet()).unwrap().solid;
        Still { name: solid.name.clone(), level: solid.level, voxels }
    };
    solids.map(of).collect()
}

impl Still {
    fn is_solid(&self, voxel: [i64; 3]) -> bool {
        let grid = &self.voxels.grid;
        let fits = (0..3).all(|a| (0..grid.dims[a] as i64).contains(&voxel[a]));
        fits && self.voxels.solid[grid.index(voxel.map(|at| at as usize))] == 1
    }

    /// Deeper than the outermost voxels: all 18 around it that share a face or an edge are solid.
    fn is_deep(&self, voxel: [i64; 3]) -> bool {
        let mut steps = (0..27).map(|i| [i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1]);
        steps.all(|step: [i64; 3]| {
            let is_corner = step.iter().all(|&s| s != 0);
            is_corner || self.is_solid(std::array::from_fn(|a| voxel[a] + step[a]))
        })
    }

    /// Centres of the part in it, those that are deep in it, and whether one lies on the edge of a voxel.
    fn holds(&self, machine: &Machine, part: &Occupancy, joints: &Joints) -> (usize, usize, bool) {
        let top = machine.axes_of(Side::Table);
        // Head and linear axes cancel.
        let of = |level: usize| to_head(machine, joints, (0, level));
        let matrix = of(self.level).inverse() * of(top);
        let (mut inside, mut deep, mut near) = (0, 0, false);
        for centre in part.centres() {
            let at = self.voxels.grid.continuous(matrix.transform_point3(centre + machine.part_zero()));
            near |= (at - at.floor() - 0.5).abs().min_element() < 1e-6;
            let voxel = at.round().to_array().map(|at| at as i64);
            inside += usize::from(self.is_solid(voxel));
            deep += usize::from(self.is_solid(voxel) && self.is_deep(voxel));
        }
        (inside, deep, near)
    }
}

fn hit<'r>(report: &'r CheckReport, line: usize, name: &str) -> Option<&'r Collision> {
    let own = report.colliding.iter().find(|own| own.line == line)?;
    own.collisions.iter().find(|c| c.element == "part" && c.against == HitBody::Machine(name.to_owned()))
}

/// True where the part swings into any of these at these angles.
pub(super) fn swings(solids: &[Still], machine: &Machine, part: &Occupancy, rotary: [f64; 2]) -> bool {
    let joints = Joints { linear: DVec3::ZERO, rotary };
    solids.iter().any(|solid| solid.holds(machine, part, &joints).0 > 0)
}

/// A tall part, which reaches the bed as it swings.
fn tall() -> Occupancy {
    let grid = Grid { origin: DVec3::new(-4.0, -3.0, 0.0), pitch: 1.0, dims: [8, 6, 22] };
    Occupancy { grid, solid: vec![1; grid.len()] }
}

/// The trunnion with a column beside it and an arm on its cradle.
fn with_column() -> Machine {
    let mut machine = machines()[0].clone();
    machine.solids.extend([
        cuboid("column", Side::Table, 0, [-15.0, 10.0, -62.0], [15.0, 18.0, -30.0]),
        cuboid("arm", Side::Table, 1, [5.5, -4.0, -44.0], [10.0, 4.0, -22.0]),
    ]);
    machine
}

#[test]
fn a_part_in_column_or_arm_is_told_and_no_other() {
    let part = tall();
    let (mut hits, mut free) = (0, 0);
    for machine in [with_column(), machines()[1].clone()] {
        let bodies = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
        let poses = 400;
        let path = starts(&machine, (1..=poses).map(|line| (line, random(line))));
        let report = check_path(&part, &bodies, &path, &strict(0.25)).unwrap();
        for line in 1..=poses {
            for solid in still(&machine) {
                let (inside, _, near) = solid.holds(&machine, &part, &random(line));
                if near {
                    continue;
                }
                let found = hit(&report, line, &solid.name);
                assert_eq!(found.is_some(), inside > 0, "{} {} {line}: {inside}", machine.name, solid.name);
                if let Some(found) = found {
                    assert_eq!(found.voxels as usize, inside);
                    assert!(found.depth > 0.4 && found.volume == inside as f64, "{found:?}");
                    assert!(part.grid.is_between_centres(DVec3::from_array(found.contact)));
                }
                (hits, free) = (hits + usize::from(inside > 0), free + usize::from(inside == 0));
            }
        }
    }
    assert!(hits > 50 && free > 200, "{hits} {free}");
}

#[test]
fn nothing_that_the_part_passes_on_the_way_is_passed_over() {
    let part = tall();
    let machine = with_column();
    let bodies = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
    let mut seen = 0;
    for seed in 0..80 {
        let (from, mut to) = (random(seed + 5), random(3 * seed + 11));
        to.rotary = [0, 1].map(|i| from.rotary[i] + 0.4 * (to.rotary[i] - from.rotary[i]));
        let path = path_between(&machine, from, to, true);
        let report = check_path(&part, &bodies, &path, &strict(0.25)).unwrap();
        let way = MachineMotion::new(&machine, from, to, 20.0, true);
        for solid in still(&machine) {
            let at = |step: i32| way.joints(f64::from(step) / 60.0);
            // Many at once, so that a pose beside it holds one of them.
            let deep = (0..=60).any(|step| solid.holds(&machine, &part, &at(step)).0 > 6);
            let found = hit(&report, 1, &solid.name).or_else(|| hit(&report, 2, &solid.name)).is_some();
            assert!(found || !deep, "{} {seed}", solid.name);
            seen += usize::from(deep);
        }
    }
    assert!(seen > 20, "{seen}");
}

#[test]
fn what_a_part_stands_on_may_touch_it_while_it_turns() {
    let mut machine = machines()[0].clone();
    // The cradle up to the part's foot, with no platter between: the part turns on it by C.
    machine.solids = vec![cuboid("cradle", Side::Table, 1, [-12.0, -12.0, -49.0], [12.0, 12.0, -40.0])];
    let part = part();
    for (lower, expected) in [(0.0, false), (0.7, false), (2.4, true)] {
        machine.offsets.insert(54, DVec3::new(1.0, -2.0, -40.0 - lower));
        let bodies = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
        let joints = |c: f64| Joints { linear: DVec3::new(0.0, 0.0, 20.0), rotary: [0.0, c] };
        let mut path = path_between(&machine, joints(0.0), joints(77.0), true);
        path.locations.push(location(&machine, 3, joints(77.0), MoveKind::Feed, true));
        let report = check_path(&part, &bodies, &path, &strict(0.25)).unwrap();
        for line in 1..=3 {
            assert_eq!(hit(&report, line, "cradle").is_some(), expected, "{lower} {line}");
        }
        let solid = &still(&machine)[0];
        let (inside, deep, _) = solid.holds(&machine, &part, &joints(0.0));
        assert_eq!((inside > 0, deep > 0), (lower > 0.5, expected), "{lower}");
    }
}

#[test]
fn what_stands_in_its_table_and_tools_without_a_holder_are_told_of() {
    let mut machine = machines()[0].clone();
    let part = part();
    let bare = revolved([(ElementKind::Cutter, vec![line(0.0, 12.0, 2.0, 2.0)])]);
    let said = |machine: &Machine, tool: &Tool| {
        let bodies = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
        let bodies = CheckBodies { machine: Some(&bodies), ..CheckBodies::of_part(&part) };
        machine_remarks(bodies, &[(None, tool)], &DMat4::IDENTITY)
    };
    assert!(said(&machine, &tool()).is_empty());
    assert!(said(&machine, &bare)[0].contains("has no holder") && said(&machine, &bare).len() == 1);
    // Three lower, the block's foot is in the platter.
    machine.offsets.insert(54, DVec3::new(1.0, -2.0, -43.0));
    let said = said(&machine, &tool());
    assert!(
        said.len() == 1 && said[0].starts_with("the part stands ") && said[0].contains("platter"),
        "{said:?}"
    );
}

#[test]
fn a_solid_that_lies_wholly_inside_the_part_is_told_of() {
    let mut machine = machines()[0].clone();
    // The part stands on the platter at -40, and is 22 high; the post ends 4 below its top.
    machine.solids = vec![
        cuboid("post", Side::Table, 0, [0.0, -3.0, -32.0], [2.0, -1.0, -24.0]),
        cuboid("beside", Side::Table, 0, [8.0, -3.0, -32.0], [10.0, -1.0, -24.0]),
    ];
    machine.offsets.insert(54, DVec3::new(1.0, -2.0, -40.0));
    let part = tall();
    let bodies = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
    let still = Joints { linear: DVec3::new(0.0, 0.0, 40.0), rotary: [0.0, 0.0] };
    for turned in [still, Joints { rotary: [0.0, 20.0], ..still }] {
        let path = path_between(&machine, still, turned, true);
        let report = check_path(&part, &bodies, &path, &strict(0.25)).unwrap();
        for line in [1, 2] {
            let found = hit(&report, line, "post").unwrap_or_else(|| panic!("{line}"));
            assert!(found.voxels > 10 && found.depth > 2.0, "{found:?}");
            assert!(hit(&report, line, "beside").is_none());
        }
    }
}
