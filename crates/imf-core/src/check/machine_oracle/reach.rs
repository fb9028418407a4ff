//! Which poses a machine reaches, by the same matrices.

use glam::DQuat;

use super::*;
use crate::orientation::Orientation;
use crate::pose::Pose;

#[test]
fn a_pose_is_reached_where_some_angles_within_the_ranges_are_free_of_all_contacts() {
    let part = part();
    for mut machine in machines() {
        // From here on the machine is short of travel as well.
        machine.travel[0] = [-9.0, 9.0];
        let bodies = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
        let pairs = pairs(&machine, &bodies, &part);
        let still = on_table::still(&machine);
        // The tool and the part are left to the caller.
        let others = |pair: &&Pair| {
            let is_tool = matches!(pair.element.as_str(), "cutter" | "holder 1");
            !(is_tool && pair.against == HitBody::Part)
        };
        let assembly = tool().offset(&Clearance::default()).unwrap();
        let shared = Arc::new(part.clone());
        let announced = [Orientation::from_direction(DVec3::new(0.3, 0.2, 0.9)).unwrap()];
        let reach = MachineReach::new(&bodies, &shared, &[], &assembly, &announced).unwrap();
        let (mut reached, mut missed) = (0, 0);
        for seed in 0..1_500 {
            let joints = random(seed);
            let pose = machine.forward(&joints, 20.0);
            let (tip, axis) = match seed % 3 {
                0 => (pose.position, announced[0].direction()),
                1 => (pose.position, DVec3::Z),
                _ => (pose.position, pose.axis().unwrap()),
            };
            // By brute force: the angles, each eighth of a turn of one that is free, every centre by matrices.
            let found = machine.inverse(axis);
            let mut angles = found.angles.clone();
            if let Some(place) = found.free {
                for pair in found.angles {
                    angles.extend((1..8).map(|eighth| {
                        let mut other = pair;
                        other[place] = f64::from(eighth) * 45.0;
                        other
                    }));
                }
            }
            let (mut free, mut near) = (Vec::new(), false);
            for rotary in angles {
                let joints = Joints { linear: machine.linear(tip, &rotary, 20.0), rotary };
                if machine.out_of_travel(&joints).is_some() {
                    continue;
                }
                // One centre in contact is enough.
                let mut depths = pairs.iter().filter(others).flat_map(|pair| pair.depths(&machine, &joints));
                let mut deepest = f64::NEG_INFINITY;
                while deepest < 1e-6
                    && let Some(depth) = depths.next()
                {
                    deepest = deepest.max(depth);
                }
                let is_free = deepest < 0.0 && !on_table::swings(&still, &machine, &part, rotary);
                free.extend(is_free.then_some(rotary));
                near |= deepest.abs() < 1e-6;
            }
            if !near {
                assert_eq!(reach.reaches(tip, axis), !free.is_empty(), "{} {tip} {axis}", machine.name);
                assert_eq!(reach.fault(tip, axis).is_none(), !free.is_empty());
                let angles = reach.angles(tip, axis);
                let same =
                    |one: f64, other: f64| ((one - other + 180.0).rem_euclid(360.0) - 180.0).abs() < 1e-9;
                let is_free =
                    |own: [f64; 2]| free.iter().any(|pair| (0..2).all(|at| same(own[at], pair[at])));
                assert!(angles.is_none_or(is_free), "{angles:?} {free:?}");
                reached += usize::from(!free.is_empty());
                missed += usize::from(free.is_empty());
            }
        }
        assert!(reached > 100 && missed > 100, "{reached} {missed}");
        assert_eq!(
            reach.fault(DVec3::ZERO, DVec3::NEG_Z).is_some(),
            !reach.reaches(DVec3::ZERO, DVec3::NEG_Z)
        );
    }
}

#[test]
fn a_part_that_is_placed_is_the_same_as_one_that_lies_there() {
    let part = part();
    // A quarter turn about z, and whole voxels: y becomes x, and what was x from the other side y.
    let turn = DQuat::from_rotation_z(-90f64.to_radians());
    let place = Pose::new(DVec3::new(2.0, -3.0, 1.0), turn);
    let [nx, ny, nz] = part.grid.dims;
    let lower = part.grid.origin;
    let corner = DVec3::new(lower.y, -lower.x - nx as f64 * part.grid.pitch, lower.z) + place.position;
    let mut lying = Occupancy::empty(Grid { origin: corner, dims: [ny, nx, nz], ..part.grid });
    for index in part.solids() {
        let [x, y, z] = part.grid.voxel(index);
        let there = lying.grid.index([y, nx - 1 - x, z]);
        assert!(
            lying.grid.centre([y, nx - 1 - x, z]).distance(place.of_point(part.grid.centre([x, y, z])))
                < 1e-9
        );
        lying.solid[there] = 1;
    }
    let assembly = tool().offset(&Clearance::default()).unwrap();
    let announced = [Orientation::from_direction(DVec3::new(0.3, 0.2, 0.9)).unwrap()];
    let (part, lying) = (Arc::new(part), Arc::new(lying));
    for machine in machines() {
        let bodies = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
        let expected = MachineReach::new(&bodies, &lying, &[], &assembly, &[]).unwrap();
        let here = MachineReach::new(&bodies, &part, &[], &assembly, &announced).unwrap();
        let placed = here.placed(&place, &announced);
        let (mut counts, mut moved) = ([0, 0], 0);
        for seed in 0..600 {
            let pose = place.inverse().of_pose(&machine.forward(&random(seed), 20.0));
            let axis = if seed % 2 == 0 { announced[0].direction() } else { pose.axis().unwrap() };
            let reached = placed.reaches(pose.position, axis);
            assert_eq!(reached, expected.reaches(place.of_point(pose.position), place.rotation * axis));
            counts[usize::from(reached)] += 1;
            moved += usize::from(reached != here.reaches(pose.position, axis));
        }
        assert!(counts.iter().all(|&count| count > 50) && moved > 20, "{counts:?} {moved}");
    }
}
