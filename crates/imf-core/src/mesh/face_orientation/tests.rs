use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::mesh::tests::unit_cube;
use crate::mesh::topology::boundary_chain;

/// A cube of many triangles around a centre, facing outwards or inwards.
fn cube(centre: f64, edge: f64, inwards: bool) -> Mesh {
    let cube = Mesh::cuboid(DVec3::splat(centre - edge / 2.0), DVec3::splat(centre + edge / 2.0));
    let cube = if inwards { reversed(cube) } else { cube };
    cube.refined_with_origins(edge / 3.0, 1_000_000).0
}

fn reversed(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    mesh
}

/// A repair that flipped so many triangles.
fn flips(flipped: usize) -> FaceRepair {
    FaceRepair { flipped, ..FaceRepair::default() }
}

fn joined(meshes: &[Mesh]) -> Mesh {
    let mut all = Mesh::default();
    meshes.iter().for_each(|mesh| all.append(mesh));
    all.welded()
}

/// The mesh with every triangle from a number on flipped that the dice say, and how many those are.
fn shuffled(mesh: &Mesh, first: usize, chance: f64, seed: u64) -> (Mesh, usize) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut mesh = mesh.clone();
    let mut flipped = 0;
    for triangle in &mut mesh.triangles[first..] {
        if random.random_bool(chance) {
            triangle.swap(1, 2);
            flipped += 1;
        }
    }
    (mesh, flipped)
}

/// A strip with `twists` half turns.
fn strip(twists: usize) -> Mesh {
    let corner = |step: usize, side: f64| {
        let (angle, turn) = (step as f64 / 30.0 * std::f64::consts::TAU, twists as f64 * 0.5);
        let radius = 1.0 + side * (turn * angle).cos();
        // Where the ends meet the corners are those of the beginning, to the bit.
        let rounded = |v: f64| (v * 1e9).round() / 1e9;
        DVec3::new(
            rounded(radius * angle.cos()),
            rounded(radius * angle.sin()),
            rounded(side * (turn * angle).sin()),
        )
    };
    let mut mesh = Mesh::default();
    for step in 0..30 {
        let base = mesh.vertices.len() as u32;
        mesh.vertices
            .extend([(0, -0.3), (0, 0.3), (1, -0.3), (1, 0.3)].map(|(more, side)| corner(step + more, side)));
        mesh.triangles.extend([[base, base + 2, base + 1], [base + 1, base + 2, base + 3]]);
    }
    mesh.welded()
}

#[test]
fn what_is_consistent_stays_as_it_is() {
    let cavity = [cube(0.0, 9.0, false), cube(0.0, 4.0, true)];
    let mut open = cube(0.0, 1.0, false);
    open.triangles.truncate(40);
    for (name, mesh) in [
        ("a cube", unit_cube()),
        ("a cavity", joined(&cavity)),
        ("two bodies that overlap", joined(&[cube(0.0, 2.0, false), cube(0.7, 2.0, false)])),
        ("open", open),
        ("a strip with two sides", strip(2)),
        ("nothing", Mesh::default()),
    ] {
        assert!(mesh.clone().with_consistent_faces() == (mesh, FaceRepair::default()), "{name}");
    }
    // A solid in a solid is reported and stays; a cavity in it is not reported, nor is a solid in the cavity.
    let solids = [cube(0.0, 9.0, false), cube(0.0, 7.0, false), cube(0.0, 4.0, true), cube(0.0, 2.0, false)];
    for (count, nested) in [(2, 1), (3, 1), (4, 2)] {
        let mesh = joined(&solids[..count]);
        assert!(
            mesh.clone().with_consistent_faces() == (mesh, FaceRepair { nested, ..FaceRepair::default() })
        );
    }
}

#[test]
fn what_faces_inwards_as_a_whole_is_turned_with_its_cavities() {
    let right = joined(&[cube(0.0, 9.0, false), cube(0.0, 4.0, true), cube(20.0, 3.0, false)]);
    let flipped = right.triangles.len();
    assert!(reversed(right.clone()).with_consistent_faces() == (right, flips(flipped)));
    // Of two that overlap the larger faces inwards.
    let right = joined(&[cube(0.0, 4.0, false), cube(3.0, 9.0, false)]);
    let (wrong, flipped) = shuffled(&right, cube(0.0, 4.0, false).triangles.len(), 1.0, 0);
    assert!(wrong.with_consistent_faces() == (right, flips(flipped)));
}

#[test]
fn triangles_that_face_at_random_become_the_solid_that_they_bound() {
    let nest = [cube(0.0, 9.0, false), cube(0.0, 6.0, true), cube(0.0, 3.0, false)];
    let bodies = [cube(0.0, 4.0, false), cube(0.0, 2.0, true), cube(8.0, 3.0, false)];
    // They share one edge, of which four triangles make use.
    let mut neighbours = unit_cube();
    neighbours.append(&Mesh::cuboid(DVec3::new(1.0, 1.0, 0.0), DVec3::new(2.0, 2.0, 1.0)));
    for (name, mesh, volume) in [
        ("a cube", cube(3.0, 2.0, false), 8.0),
        ("shells in shells", joined(&nest), 729.0 - 216.0 + 27.0),
        ("a cavity beside a body", joined(&bodies), 64.0 - 8.0 + 27.0),
        ("cubes on an edge", neighbours.welded().refined_with_origins(0.4, 10_000).0, 2.0),
    ] {
        for seed in 0..5 {
            let (random, _) = shuffled(&mesh, 0, 0.5, seed);
            let (repaired, repair) = random.clone().with_consistent_faces();
            assert!(repaired == mesh, "{name}, seed {seed}");
            let differ = random.triangles.iter().zip(&mesh.triangles).filter(|(a, b)| a != b).count();
            assert_eq!(repair, flips(differ), "{name}");
            assert!(boundary_chain(&repaired).is_empty() && (repaired.signed_volume() - volume).abs() < 1e-9);
        }
    }
}

#[test]
fn a_few_wrong_triangles_do_not_change_what_the_rest_says() {
    // Parity would make a cavity of the inner solid.
    let solids = joined(&[cube(0.0, 9.0, false), cube(0.0, 4.0, false)]);
    let (few, flipped) = shuffled(&solids, 0, 0.04, 7);
    assert!(flipped > 2);
    assert!(few.with_consistent_faces() == (solids, FaceRepair { nested: 1, ..flips(flipped) }));
    // An open mesh has no volume to go by.
    let mut open = reversed(cube(0.0, 2.0, false));
    open.triangles.truncate(open.triangles.len() - 4);
    let (few, flipped) = shuffled(&open, 0, 0.04, 7);
    assert!(flipped > 2);
    assert!(few.with_consistent_faces() == (open, flips(flipped)));
}

#[test]
fn bodies_beside_each_other_face_alike_and_keep_their_cavities() {
    let body = cube(0.0, 9.0, false);
    let first = body.triangles.len();
    // A hollow body far away, and one that overlaps: it would be empty where it does.
    for second in [joined(&[cube(20.0, 5.0, false), cube(20.0, 2.0, true)]), cube(4.0, 3.0, false)] {
        let right = joined(&[body.clone(), second]);
        let (wrong, flipped) = shuffled(&right, first, 1.0, 0);
        assert!(wrong.with_consistent_faces() == (right, flips(flipped)));
    }
}

#[test]
fn a_surface_with_one_side_stays_as_it_is_and_is_reported() {
    let moebius = strip(1);
    let count = moebius.triangles.len();
    assert_eq!((count, moebius.vertices.len()), (60, 60));
    let repaired = moebius.clone().with_consistent_faces();
    assert!(repaired == (moebius.clone(), FaceRepair { one_sided: count, ..FaceRepair::default() }));
    // It keeps nothing else from being repaired.
    let both = joined(&[moebius, cube(9.0, 2.0, false)]);
    let (random, _) = shuffled(&both, count, 0.5, 1);
    let (repaired, repair) = random.with_consistent_faces();
    assert!(repaired == both && repair.one_sided == count);
}

#[test]
fn a_mesh_with_every_triangle_for_either_side_is_what_it_bounds() {
    let cube = joined(&[cube(3.0, 2.0, false)]);
    for second in [reversed(cube.clone()), cube.clone()] {
        let both = joined(&[cube.clone(), second]);
        let doubled = cube.triangles.len();
        assert!(
            both.with_consistent_faces() == (cube.clone(), FaceRepair { doubled, ..FaceRepair::default() })
        );
    }
    // Where two bodies touch their faces cancel each other, and stay.
    let mut touching = unit_cube();
    touching.append(&Mesh::cuboid(DVec3::X, DVec3::new(2.0, 1.0, 1.0)));
    let touching = touching.welded();
    let (same, repair) = touching.clone().with_consistent_faces();
    assert!(boundary_chain(&same).is_empty() && (same.signed_volume() - 2.0).abs() < 1e-12, "{repair:?}");
}

#[test]
fn of_triangles_that_are_there_twice_one_is_left_out() {
    let cube = unit_cube();
    let mut some = cube.clone();
    // One as it is, one beginning at another corner.
    let ([first, [a, b, c]], count) = ([cube.triangles[0], cube.triangles[5]], cube.triangles.len());
    some.triangles.extend([first, [b, c, a]]);
    let (mended, repair) = some.with_consistent_faces();
    assert_eq!((repair.doubled, repair.flipped, mended.triangles.len()), (2, 0, count));
    // One that faces the other way opens its edges, whichever of the two is first.
    for order in [0, count] {
        let mut flap = cube.clone();
        flap.triangles.insert(order, [a, c, b]);
        let (mended, repair) = flap.with_consistent_faces();
        assert_eq!((repair.doubled, mended.triangles.len()), (1, count));
        assert!(boundary_chain(&mended).is_empty() && (mended.signed_volume() - 1.0).abs() < 1e-12);
    }
    // One without area on an edge.
    let mut needle = cube.clone();
    needle.vertices.extend([0.2, 0.7].map(|x| cube.vertices[0].lerp(cube.vertices[1], x)));
    needle.triangles.push([0, 8, 9]);
    let (mended, repair) = needle.with_consistent_faces();
    assert_eq!((repair.flat, &mended.triangles), (1, &cube.triangles));
    assert!(boundary_chain(&mended).is_empty());
}

#[test]
fn bodies_that_share_a_face_stay_as_they_are_where_one_lies_in_the_other() {
    let at = |corner: [f64; 3]| Mesh::cuboid(DVec3::ZERO, DVec3::from_array(corner));
    // On one base, one higher; beside each other on it, as the foot of a boss that goes through its plate.
    let plate = Mesh::cuboid(DVec3::new(-2.0, -2.0, 0.0), DVec3::new(4.0, 5.0, 1.0));
    for (first, second, repeated) in
        [(at([4.0, 3.0, 2.0]), at([4.0, 3.0, 5.0]), true), (plate, at([4.0, 3.0, 5.0]), false)]
    {
        let both = joined(&[first, second]);
        let twice = both
            .triangles
            .iter()
            .filter(|one| both.triangles.iter().filter(|o| turned(**o) == turned(**one)).count() > 1);
        assert_eq!(twice.count() > 0, repeated);
        assert!(both.clone().with_consistent_faces() == (both, FaceRepair::default()));
    }
    // One that faces inwards beside another, whose common face bounds nothing, is turned.
    let mut beside = unit_cube();
    beside.append(&reversed(Mesh::cuboid(DVec3::X, DVec3::new(2.0, 1.0, 1.0))));
    let (mended, repair) = beside.welded().with_consistent_faces();
    assert!(boundary_chain(&mended).is_empty() && (mended.signed_volume() - 2.0).abs() < 1e-12, "{repair:?}");
}

#[test]
fn a_cavity_in_a_shell_with_a_gap_stays_one() {
    let cavity = cube(0.0, 4.0, true);
    let mut gap = cube(0.0, 9.0, false);
    gap.triangles.pop();
    // A body floats in the cavity.
    let body = cube(0.0, 1.0, false);
    let right = joined(&[gap.clone(), cavity.clone(), body]);
    assert!(right.clone().with_consistent_faces() == (right, FaceRepair::default()));
    let right = joined(&[gap, cavity.clone()]);
    let first = right.triangles.len() - cavity.triangles.len();
    let (same, repair) = right.clone().with_consistent_faces();
    assert!((&same, repair) == (&right, FaceRepair::default()));
    // Where the file does not say which way it faces it is one too.
    let (random, flipped) = shuffled(&right, first, 0.5, 3);
    assert!(random.with_consistent_faces() == (right, flips(flipped)));
    // A corner on an edge of one of its two triangles alone is none.
    let mut junction = Mesh::cuboid(DVec3::splat(-4.5), DVec3::splat(4.5));
    let [a, b, c] = junction.triangles[0];
    let middle = junction.vertices.len() as u32;
    junction.vertices.push(junction.vertices[a as usize].lerp(junction.vertices[b as usize], 0.4));
    junction.triangles.splice(0..1, [[a, middle, c], [middle, b, c]]);
    let (mended, repair) = joined(&[junction, cavity]).with_consistent_faces();
    assert_eq!(repair, FaceRepair { cut: 1, ..FaceRepair::default() });
    assert!(boundary_chain(&mended).is_empty());
    assert!((mended.signed_volume() - (729.0 - 64.0)).abs() < 1e-9, "{}", mended.signed_volume());
    // Beside it, a body that faces inwards is turned.
    let mut gap = cube(0.0, 9.0, false);
    gap.triangles.pop();
    let right = joined(&[gap, cube(20.0, 3.0, false)]);
    let first = right.triangles.len() - cube(20.0, 3.0, false).triangles.len();
    let (wrong, flipped) = shuffled(&right, first, 1.0, 0);
    assert!(wrong.with_consistent_faces() == (right, flips(flipped)));
}

#[test]
fn a_cavity_that_is_flush_with_a_face_stays_one_at_each_face() {
    for side in 0..6 {
        let mut middle = DVec3::ZERO;
        middle[side / 2] = if side % 2 == 0 { 2.5 } else { -2.5 };
        let move_there = glam::DMat4::from_translation(middle);
        let right = joined(&[cube(0.0, 10.0, false), cube(0.0, 5.0, true).transformed(&move_there)]);
        let (same, repair) = right.clone().with_consistent_faces();
        assert!((&same, repair) == (&right, FaceRepair::default()), "{side}");
    }
}
