//! What a cutter does to a part between the centres of its voxels, by the part's own faces.

use glam::{DMat4, DQuat, DVec3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::elements::{Body, Elements};
use super::motions::motions;
use super::tests::{check_text, pose_lines};
use super::*;
use crate::grid::Grid;
use crate::mesh::points_at_pitch;
use crate::section::test_shapes::{arc, holds, line, number, revolved};
use crate::tool::{ElementKind, Segment};
use crate::voxelize::voxelize;

/// A ball, a flat and a bull-nosed end, a dovetail cutter, a point of 60 degrees, a slender round one, and one with a step.
fn cutters() -> Vec<Tool> {
    let profiles = [
        vec![Segment::ball_end(3.0), line(3.0, 25.0, 3.0, 3.0)],
        vec![line(0.0, 25.0, 3.0, 3.0)],
        vec![arc(0.0, 1.2, 1.2, 2.5, 1.2), line(1.2, 25.0, 3.7, 3.7)],
        vec![line(0.0, 3.0, 5.0, 3.5), line(3.0, 25.0, 3.0, 3.0)],
        vec![line(0.0, 6.0, 0.0, 6.0 * 30f64.to_radians().tan()), line(6.0, 25.0, 4.0, 4.0)],
        vec![arc(0.0, 0.4, 0.4, 0.0, 0.4), line(0.4, 12.4, 0.4, 2.8)],
        vec![line(0.0, 5.0, 2.0, 2.0), line(5.0, 25.0, 4.0, 4.0)],
    ];
    profiles.into_iter().map(|profile| revolved([(ElementKind::Cutter, profile)])).collect()
}

/// A block that lies askew in its grid, in the world.
fn block(random: &mut ChaCha8Rng, pitch: f64) -> (Mesh, DMat4, Occupancy) {
    let turn = DQuat::from_axis_angle(
        DVec3::new(number(random) - 0.5, number(random) - 0.5, number(random) - 0.5).normalize(),
        3.0 * number(random),
    );
    let place = DMat4::from_rotation_translation(turn, DVec3::new(number(random), number(random), -5.0));
    let mesh = Mesh::cuboid(DVec3::splat(-20.0), DVec3::splat(20.0)).transformed(&place);
    let (low, high) = mesh.bounds().unwrap();
    let solid = voxelize(&mesh, &Grid::with_pitch(low, high, pitch, 2).unwrap(), false);
    (mesh, place, solid)
}

/// How far the lowest point of a cutter lies along a direction from its tip.
fn lowest(tool: &Tool, axis: DVec3, up: DVec3) -> f64 {
    let (level, across) = (axis.dot(up), axis.cross(up).length());
    let along = |segment: &Segment| {
        let (from, to) = segment.range();
        let height = move |step: u32| from + (to - from) * f64::from(step) / 2000.0;
        let segment = *segment;
        (0..=2000).map(move |step| height(step) * level - segment.radius(height(step)) * across)
    };
    tool.segments().flat_map(along).fold(f64::INFINITY, f64::min)
}

/// The block that is hit as the part or, far from the part, as a fixture.
struct Hit {
    part: Occupancy,
    fixtures: Vec<(String, Occupancy)>,
    meshes: Vec<Mesh>,
}

impl Hit {
    fn new(mesh: Mesh, solid: Occupancy, is_part: bool) -> Self {
        if is_part {
            return Self { part: solid, fixtures: Vec::new(), meshes: vec![mesh] };
        }
        let (low, high) = (DVec3::splat(500.0), DVec3::splat(510.0));
        let part = Mesh::cuboid(low, high);
        let solid_part = voxelize(&part, &Grid::with_pitch(low, high, solid.grid.pitch, 2).unwrap(), false);
        Self { part: solid_part, fixtures: vec![("block".into(), solid)], meshes: vec![part, mesh] }
    }

    fn check(&self, tool: &Tool, text: &str, settings: &CheckSettings) -> CheckReport {
        let surfaces: Vec<&Mesh> = self.meshes.iter().collect();
        let Self { part, fixtures, .. } = self;
        let bodies = CheckBodies { fixtures, surfaces: &surfaces, ..CheckBodies::of_part(part) };
        check_text(bodies, tool, text, settings).unwrap()
    }
}

#[test]
fn among_conservative_voxels_a_cutter_meets_the_part_as_among_its_centres() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let pitch = 1.0;
    let (mesh, place, solid) = block(&mut random, pitch);
    let larger = voxelize(&mesh, &solid.grid, true);
    assert!(larger.count() > solid.count());
    let settings = CheckSettings::of_pitch(pitch, LengthUnit::Mm);
    let (up, top) = (place.transform_vector3(DVec3::Z), place.transform_point3(DVec3::ZERO));
    let mut hits = [0; 2];
    for (tool, case) in cutters().iter().flat_map(|tool| (0..40).map(move |case| (tool, case))) {
        let depth = 0.03 * f64::from(case) - 0.4;
        let tip = top + up * (20.0 - depth - lowest(tool, up, up));
        let text = pose_lines(&[(tip, up)]);
        let of = |part, by_centres| {
            let bodies = CheckBodies { by_centres, surfaces: &[&mesh], ..CheckBodies::of_part(part) };
            let found = check_text(bodies, tool, &text, &settings).unwrap();
            let cutters = found.colliding.iter().flat_map(|line| line.collisions.clone());
            cutters.filter(|hit| hit.element == "cutter").map(|hit| hit.depth).collect::<Vec<_>>()
        };
        let found = of(&solid, None);
        assert_eq!(of(&larger, Some(&solid)), found, "{depth} {:?}", tool.shape);
        hits[usize::from(!found.is_empty())] += 1;
    }
    assert!(hits[0] > 40 && hits[1] > 40, "{hits:?}");
}

#[test]
fn what_enters_a_surface_is_told_from_the_depth_on_that_is_certain_and_a_cutter_not_up_to_the_contact() {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let random_unit = |random: &mut ChaCha8Rng| 2.0 * number(random) - 1.0;
    let mut shallow = 0;
    let kinds = [(2.0, true), (1.0, true), (1.0, false)];
    for (tool, (pitch, is_part)) in cutters().iter().flat_map(|tool| kinds.map(|kind| (tool, kind))) {
        let (mesh, place, solid) = block(&mut random, pitch);
        let bodies = Hit::new(mesh, solid, is_part);
        let settings = CheckSettings::of_pitch(pitch, LengthUnit::Mm);
        for case in 0..16 {
            let up = place.transform_vector3([DVec3::X, DVec3::NEG_Y, DVec3::Z][case % 3]);
            let u = up.any_orthonormal_vector();
            let beside = 4.0 * (u * random_unit(&mut random) + up.cross(u) * random_unit(&mut random));
            let touched = place.transform_point3(DVec3::ZERO) + 20.0 * up + beside;
            // Upright and level now and then, as a path lies.
            let tilt = [0.0, 1.0, number(&mut random), number(&mut random)][case % 4];
            let around = u * random_unit(&mut random) + up.cross(u) * random_unit(&mut random);
            let axis = (up * (1.0 - tilt) + around.normalize() * tilt).normalize();
            let at = |depth: f64| touched - up * (depth + lowest(tool, axis, up));
            let run = |depth: f64| {
                let text = pose_lines(&[(at(depth), axis)]);
                bodies.check(tool, &text, &settings)
            };
            // A fixture's centres are hit at any depth.
            let clear = run(if is_part { settings.contact } else { 0.0 } - 1e-3);
            assert!(clear.colliding.is_empty(), "{pitch} {case} {:?} {clear:?}", tool.shape);
            // At that pose itself: between poses the tool is half a step nearer.
            let sure = if is_part { clear.sure_gouge } else { clear.sure_overlap };
            let sure = sure.unwrap() - 0.5 * settings.step;
            assert!(sure < settings.contact + 1.7 * pitch && sure < clear.sure_depth, "{pitch} {sure}");
            let found = run(sure + 1e-3);
            let told = found.colliding.first();
            let line = told.unwrap_or_else(|| panic!("{pitch} {case} {tilt} {sure} {:?}", tool.shape));
            let hit = &line.collisions[0];
            assert!(hit.depth > settings.contact, "{hit:?}");
            if hit.voxels == 0 {
                shallow += 1;
                assert!(hit.depth < sure + 2e-3, "{hit:?}");
                let contact = DVec3::from_array(hit.contact);
                assert!(((contact - touched).dot(up)).abs() < 1e-9, "{hit:?}");
            }
        }
    }
    assert!(shallow > 20, "{shallow}");
}

#[test]
fn a_cutter_collides_where_a_centre_or_a_point_of_the_surface_is_deep_in_it() {
    let mut random = ChaCha8Rng::seed_from_u64(12);
    let (mut hits, mut by_points) = (0, 0);
    for tool in &cutters() {
        let pitch = 0.8 + number(&mut random);
        let (mesh, place, solid) = block(&mut random, pitch);
        let bodies = CheckBodies { surfaces: &[&mesh], ..CheckBodies::of_part(&solid) };
        let settings = CheckSettings { contact: 0.2, ..CheckSettings::of_pitch(pitch, LengthUnit::Mm) };
        let points = points_at_pitch(&mesh, pitch).0;
        let (cutter, exposed) = tool.cutter().unwrap();
        for case in 0..60 {
            let mut way = || 2.0 * number(&mut random) - 1.0;
            let axis = DVec3::new(way(), way(), way()).normalize();
            let face = [DVec3::X, DVec3::NEG_Y, DVec3::Z][case % 3];
            // Beyond edges too.
            let tip = DVec3::new(way(), way(), way()) * 24.0 * (1.0 - face.abs()) + face * (20.0 + way());
            let tip = place.transform_point3(tip);
            let deepest = |points: &mut dyn Iterator<Item = DVec3>| {
                let within = points.filter_map(|point| {
                    let height = (point - tip).dot(axis);
                    let away = (point - tip - axis * height).length();
                    holds(&cutter.profile, height, away).then(|| cutter.depth(height, away, exposed))
                });
                within.fold(0.0, f64::max)
            };
            let of_points = deepest(&mut points.iter().copied());
            let of_centres = deepest(&mut solid.centres());
            let depth = of_points.max(of_centres);
            // In the groove of a step what is less deep counts too.
            if (depth - settings.contact).abs() < 0.01 {
                continue;
            }
            let text = pose_lines(&[(tip, axis)]);
            let found = check_text(bodies, tool, &text, &settings).unwrap();
            assert_eq!(!found.colliding.is_empty(), depth > settings.contact, "{case} {depth} {of_points}");
            if let Some(line) = found.colliding.first() {
                hits += 1;
                by_points += usize::from(of_centres < settings.contact);
                assert!(line.collisions[0].depth > of_points - 1e-9, "{case} {of_points} {line:?}");
            }
        }
    }
    assert!(hits > 120 && by_points > 8, "{hits} {by_points}");
}

#[test]
fn shank_and_holder_collide_where_they_hold_a_centre_or_a_point_deeper_than_they_may_touch() {
    let mut random = ChaCha8Rng::seed_from_u64(14);
    let tool = revolved([
        (ElementKind::Cutter, vec![Segment::ball_end(3.0), line(3.0, 8.0, 3.0, 3.0)]),
        (ElementKind::Shank, vec![line(8.0, 14.0, 3.0, 5.0)]),
        (ElementKind::Holder(0), vec![line(14.0, 17.0, 6.0, 9.0), arc(17.0, 21.0, 17.0, 5.0, 4.0)]),
    ]);
    let (mut hits, mut by_points, mut touched) = (0, 0, 0);
    for case in 0..12 {
        let (pitch, is_part) = (0.8 + number(&mut random), case % 2 == 0);
        let (mesh, place, solid) = block(&mut random, pitch);
        let points = points_at_pitch(&mesh, pitch).0;
        let centres: Vec<DVec3> = solid.centres().collect();
        let bodies = Hit::new(mesh, solid, is_part);
        let clearance =
            [Clearance::default(), Clearance { holder: 1.5, shank: 0.4, cutter: 0.2 }][case % 3 / 2];
        let usual = CheckSettings::of_pitch(pitch, LengthUnit::Mm);
        let settings = CheckSettings { contact: 0.2, clearance, ..usual };
        let elements = tool.offset_elements(&clearance).unwrap();
        for _ in 0..40 {
            let mut way = || 2.0 * number(&mut random) - 1.0;
            let axis = place.transform_vector3(DVec3::new(way(), way(), 0.3 * way())).normalize();
            // Above the top, beyond its edges too.
            let tip = place.transform_point3(DVec3::new(24.0 * way(), 24.0 * way(), 25.5 + 3.5 * way()));
            let text = pose_lines(&[(tip, axis)]);
            let found = bodies.check(&tool, &text, &settings);
            let found: Vec<_> = found.colliding.iter().flat_map(|line| &line.collisions).collect();
            for element in elements.iter().filter(|own| !(is_part && own.kind == ElementKind::Cutter)) {
                let of = |point: &DVec3| {
                    let height = (point - tip).dot(axis);
                    (height, (point - tip - axis * height).length())
                };
                let held = |point: &&DVec3| holds(&element.profile, of(point).0, of(point).1);
                let depth = |point: &DVec3| element.depth(of(point).0, of(point).1, true);
                let deepest = |points: &[DVec3]| points.iter().filter(held).map(depth).reduce(f64::max);
                let centre = deepest(&centres).unwrap_or(-1.0);
                let deepest = deepest(&points).unwrap_or(0.0);
                if [deepest, centre].iter().any(|depth| (depth - settings.contact).abs() < 1e-6) {
                    continue;
                }
                let may_touch = element.kind != ElementKind::Cutter && clearance.of(element.kind) == 0.0;
                let by_centre = centre >= if may_touch { settings.contact } else { 0.0 };
                let by_point = deepest > settings.contact;
                touched += usize::from(may_touch && centre >= 0.0 && !by_centre);
                let name = element.kind.to_string();
                let hit = found.iter().find(|hit| hit.element == name);
                assert_eq!(hit.is_some(), by_centre || by_point, "{case} {name} {by_centre} {deepest}");
                hits += usize::from(hit.is_some());
                by_points += usize::from(by_point && !by_centre);
                if by_point {
                    assert!(hit.unwrap().depth > deepest - 1e-9, "{case} {name} {deepest} {hit:?}");
                }
            }
        }
    }
    assert!(hits > 100 && by_points > 10 && touched > 3, "{hits} {by_points} {touched}");
}

#[test]
fn no_pose_of_a_motion_is_skipped_at_which_the_cutter_holds_a_point_of_the_surface() {
    let mut random = ChaCha8Rng::seed_from_u64(13);
    let (mut colliding, mut free) = (0, 0);
    for (tool, is_part) in cutters().iter().flat_map(|tool| [true, false].map(|is_part| (tool, is_part))) {
        let (mesh, place, solid) = block(&mut random, 1.3);
        let settings = CheckSettings::of_pitch(1.3, LengthUnit::Mm);
        let bodies = Hit::new(mesh, solid, is_part);
        let mut hit = Body::all(&bodies.part, &bodies.fixtures);
        hit.iter_mut().zip(&bodies.meshes).for_each(|(body, mesh)| *body = body.with_surface_of(mesh).0);
        let elements = Elements::new(&hit, &hit[0], tool, &settings).unwrap();
        for _ in 0..40 {
            let mut way = || 2.0 * number(&mut random) - 1.0;
            let mut pose = || {
                let axis = DVec3::new(way(), way(), 1.0).normalize();
                let tip = DVec3::new(26.0 * way(), 26.0 * way(), 22.0 + 3.0 * way());
                (place.transform_point3(tip), axis)
            };
            let text = pose_lines(&[pose(), pose()]);
            let path = Toolpath::parse(&text, LengthUnit::Mm, "path").unwrap();
            for motion in motions(&path, &[(None, tool)], &settings, None).unwrap() {
                let poses = motion.poses().filter(|(_, pose)| elements.any(pose)).count() as u64;
                let found = elements.collisions(&motion).iter().map(|hit| hit.poses).sum::<u64>();
                assert_eq!(found, poses, "{text}");
                colliding += u32::from(poses > 0);
                free += u32::from(poses == 0);
            }
        }
    }
    assert!(colliding > 100 && free > 100, "{colliding} {free}");
}

#[test]
fn a_shank_as_wide_as_its_cutter_may_touch_a_wall_through_the_centres_of_voxels() {
    let grid = Grid { origin: DVec3::splat(-20.5), pitch: 1.0, dims: [41; 3] };
    let mesh = Mesh::cuboid(DVec3::new(-10.0, -10.0, -10.0), DVec3::new(3.0, 10.0, 10.0));
    // Its upper face in x runs through centres, as does the lower one, whose centres are solid.
    let solid = voxelize(&mesh, &grid, false);
    let tool = revolved([
        (ElementKind::Cutter, vec![line(0.0, 5.0, 2.0, 2.0)]),
        (ElementKind::Shank, vec![line(5.0, 30.0, 2.0, 2.0)]),
    ]);
    let settings = CheckSettings::of_pitch(1.0, LengthUnit::Mm);
    for depth in [-0.01, 0.0, 0.03, 0.07, 0.3] {
        for x in [3.0 + 2.0 - depth, -10.0 - 2.0 + depth] {
            let text = pose_lines(&[-4.0, 4.0].map(|y| (DVec3::new(x, y, 0.0), DVec3::Z)));
            for is_part in [true, false] {
                let found = Hit::new(mesh.clone(), solid.clone(), is_part).check(&tool, &text, &settings);
                let shank = found.colliding.iter().flat_map(|line| &line.collisions);
                let shank = shank.filter(|hit| hit.element == "shank").count();
                assert_eq!(shank > 0, depth > settings.contact, "{x} {depth} {is_part}");
            }
        }
    }
}
