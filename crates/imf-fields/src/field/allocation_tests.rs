//! A planner's calls allocate nothing once the working memory has grown, but for what the matrix products of a batch take
//! and give back: counted for every family.

use allocation_counter::measure;
use glam::{DQuat, DVec3};

use crate::factored::{Axis, Symmetry};
use crate::field::scenes::{
    factored, factored_file, harmonic, harmonic_in_halves, poses, scene, siren, with_symmetry,
};
use crate::field::{Field, Planner};
use crate::file::FieldFile;
use imf_core::field::{Best, Decision, ExactField, Gradient, PoseField};
use imf_core::pose::Pose;
use imf_core::tool::Tool;
use imf_core::world::MotionOptions;

/// Blocks of 256 poses of the batches below.
const BLOCKS: u64 = 3;
/// Buffers that the products of a block take: two a product, a product a layer of the networks and one for the weights, the
/// blocks of a network being half as large.
const PRODUCTS: u64 = 2 * 2 * 5;
/// Blocks of 64 poses whose gradients are made together.
const GRADIENT_BLOCKS: u64 = 11;

/// One call of every method on `poses`.
fn ask(field: &dyn PoseField, poses: &[Pose], points: &[DVec3], rotations: &[DQuat], room: &mut Room) {
    field.values(poses, &mut room.values[..poses.len()]).unwrap();
    field.gradients(poses, &mut room.gradients[..poses.len()]).unwrap();
    field.gradients(&poses[..1], &mut room.gradients[..1]).unwrap();
    field.classify(poses, &mut room.decisions[..poses.len()]).unwrap();
    field.best(points, rotations, &mut room.best[..points.len()]).unwrap();
}

struct Room {
    values: Vec<f32>,
    gradients: Vec<Gradient>,
    decisions: Vec<Decision>,
    best: Vec<Best>,
}

#[test]
fn single_poses_gradients_and_proofs_allocate_nothing_after_the_first_call() {
    let scene = scene(&Tool::paper(), 0.0);
    let poses = poses(&scene, 700, 3);
    let points: Vec<DVec3> = poses.iter().take(300).map(|p| p.position).collect();
    let rotations: Vec<DQuat> = poses.iter().take(40).map(|p| p.rotation).collect();
    let of = |file| Field::new(file).unwrap();
    let through = scene.record.grid.origin + 0.5 * scene.record.grid.size();
    let symmetry =
        Symmetry { mirrors: [None, Some(through.y), None], axis: Some(Axis { along: 0, through }) };
    let symmetric = with_symmetry(&scene, symmetry);
    let halves = || of(FieldFile::Harmonic(harmonic_in_halves(&scene, 5).into()));
    let factored_again = of(FieldFile::Factored(Box::new(factored_file(&scene))));
    let fields: Vec<(&str, Box<dyn PoseField>)> = vec![
        ("harmonic f16", Box::new(halves())),
        ("harmonic f32", Box::new(harmonic(&scene))),
        ("factored", Box::new(factored(&scene))),
        ("factored with symmetry", Box::new(of(FieldFile::Factored(Box::new(symmetric))))),
        ("siren", Box::new(siren(&scene))),
        ("exact", Box::new(ExactField::new(&scene, &scene.record.tool).unwrap())),
        ("planner", Box::new(Planner::new(factored_again).unwrap())),
    ];
    let mut room = Room {
        values: vec![0.0; poses.len()],
        gradients: vec![Gradient::NAN; poses.len()],
        decisions: vec![Decision::Undecided; poses.len()],
        best: vec![Best::NONE; points.len()],
    };
    for (name, field) in &fields {
        let field = field.as_ref();
        ask(field, &poses, &points, &rotations, &mut room);
        let mut counted = |what: &str, allowed: u64, work: &dyn Fn(&mut Room)| {
            let counted = measure(|| work(&mut room));
            // What a product takes it gives back.
            assert_eq!(counted.bytes_current, 0, "{name}, {what}");
            assert!(counted.count_total <= allowed, "{name}, {what}: {counted:?}");
        };
        counted("single poses", 0, &|room| {
            for pose in &poses[..40] {
                let pose = std::slice::from_ref(pose);
                field.values(pose, &mut room.values[..1]).unwrap();
                field.classify(pose, &mut room.decisions[..1]).unwrap();
                field.gradients(pose, &mut room.gradients[..1]).unwrap();
            }
            field.values(&[], &mut []).unwrap();
        });
        let by_products = *name != "exact";
        counted("gradients", if by_products { PRODUCTS * GRADIENT_BLOCKS } else { 0 }, &|room| {
            field.gradients(&poses, &mut room.gradients).unwrap();
        });
        let proven = ["exact", "planner"].contains(name);
        counted("decisions", if proven { 0 } else { PRODUCTS * BLOCKS }, &|room| {
            field.classify(&poses, &mut room.decisions).unwrap();
        });
        counted("values", if *name == "exact" { 0 } else { PRODUCTS * BLOCKS }, &|room| {
            field.values(&poses, &mut room.values).unwrap();
        });
    }
    let planner = Planner::new(halves()).unwrap();
    let motion = || planner.checker.check_motion(&poses[3], &poses[4], &MotionOptions::default()).unwrap();
    motion();
    let counted = measure(|| {
        std::hint::black_box(motion());
    });
    assert_eq!(counted.count_total, 0, "{counted:?}");
    // The counter counts.
    assert!(measure(|| drop(std::hint::black_box(vec![1_u8; 100]))).count_total > 0);
}
