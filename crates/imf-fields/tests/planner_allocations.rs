//! A planner's calls allocate nothing once the working memory has grown, but for what the matrix products of a batch take
//! and give back: counted for every family.

#![expect(clippy::unwrap_used, reason = "a failed helper is a failed test")]

use std::sync::Arc;

use allocation_counter::measure;
use glam::{DQuat, DVec3};
use imf_core::control::Control;
use imf_core::field::{Best, Decision, ExactField, Gradient, PoseField};
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::{At, SectionPlan};
use imf_core::tool::Tool;
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{Axis, DistillSettings, FactoredField, FactoredShape, Symmetry};
use imf_fields::field::{Field, VerifiedField};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitSettings, fit};
use imf_fields::model::Model;
use imf_fields::recipe::Sampling;
use imf_fields::recipe::TrainingState;
use imf_fields::recipe::{Cursor, TrainingPlan};
use imf_fields::siren::SirenShape;

fn scene() -> Scene {
    let mesh = ReferencePart::Bracket.mesh();
    let tool = Tool::paper();
    let spec = SceneSpec::of_reference(ReferencePart::Bracket, &mesh, [8, 24, 15], &tool);
    spec.scene().unwrap()
}

fn harmonic(scene: &Scene, precision: Precision) -> HarmonicFile {
    let settings = FitSettings {
        degree: 5,
        sections_per_function: 1.5,
        axes: 20,
        sample: 500,
        held_out: 2,
        precision,
        ..FitSettings::default()
    };
    let plan = SectionPlan::of_scene(scene, At::Tip).unwrap();
    let field = fit(&plan, Domain::Directions, &settings, Control::quiet()).unwrap();
    HarmonicFile { field, scene: scene.clone(), settings, calibration: None }
}

fn factored(scene: &Scene) -> FactoredFile {
    let HarmonicFile { field: teacher, settings: fit, .. } = harmonic(scene, Precision::F32);
    let settings = DistillSettings { width: 40, hidden: 3, omega: 6.0, ..DistillSettings::default() };
    let axes = teacher.axis_count();
    let shape = FactoredShape {
        width: 40,
        hidden: 3,
        omega: 6.0,
        axes,
        folded: false,
        symmetry: Symmetry::default(),
    };
    FactoredFile {
        field: FactoredField::new(&teacher, shape, shape.initial_parameters(4)).unwrap(),
        scene: scene.clone(),
        fit,
        report: teacher.report,
        settings,
        precision: Precision::F32,
        state: None,
        calibration: None,
    }
}

/// The same, told of a mirror and an axis.
fn symmetric(scene: &Scene) -> FactoredFile {
    let mut file = factored(scene);
    let through = file.field.grid.origin + 0.5 * file.field.grid.size();
    let symmetry =
        Symmetry { mirrors: [None, Some(through.y), None], axis: Some(Axis { along: 0, through }) };
    let shape = FactoredShape { symmetry, ..file.field.shape };
    file.field = FactoredField { shape, parameters: shape.initial_parameters(4), ..file.field };
    file
}

/// Starting weights of a narrow network.
fn siren(scene: &Scene) -> Model {
    let shape = SirenShape { width: 33, hidden: 3, ..SirenShape::default() };
    let record = serde_json::json!({
        "program": "0", "plan": TrainingPlan::default(), "cursor": Cursor { epoch: 0, step: 0 }, "finished": true,
        "steps": 0, "seconds": 0.0, "engine": "test", "orientations": OrientationSet::parse("fibonacci:3").unwrap(),
        "sampling": Sampling::default(), "samples": 0, "dataset_crc32": 0, "losses": []
    });
    let record = serde_json::from_value(record).unwrap();
    Model { shape, scene: scene.clone(), record, state: TrainingState::new(&shape, 3), calibration: None }
}

/// Blocks of 256 poses of the batches below.
const BLOCKS: u64 = 3;
/// Buffers that the products of a block take: two a product, a product a layer of the networks and one for the heads, the
/// blocks of a network being half as large.
const PRODUCTS: u64 = 2 * 2 * 5;

/// One call of every method on `poses`.
fn ask(field: &dyn PoseField, poses: &[Pose], points: &[DVec3], rotations: &[DQuat], room: &mut Room) {
    field.values(poses, &mut room.values[..poses.len()]).unwrap();
    field.gradients(poses, &mut room.gradients[..poses.len()]).unwrap();
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
    let scene = scene();
    let grid = scene.record.grid;
    let poses: Vec<Pose> = (0..700_u32)
        .map(|i| {
            let share = |prime: u32| f64::from(i * prime % 701) / 701.0;
            let unit = DVec3::new(share(37), share(53), share(71));
            let axis = DVec3::new(share(11) - 0.5, share(13) - 0.5, share(17) - 0.4);
            Pose::along(grid.origin + unit * grid.size(), axis)
        })
        .collect();
    let points: Vec<DVec3> = poses.iter().take(300).map(|p| p.position).collect();
    let rotations: Vec<DQuat> = poses.iter().take(40).map(|p| p.rotation).collect();
    let of = |stored| Field::new(stored).unwrap();
    let fields: Vec<(&str, Box<dyn PoseField>)> = vec![
        ("harmonic f16", Box::new(of(FieldFile::Harmonic(Arc::new(harmonic(&scene, Precision::F16)))))),
        ("harmonic f32", Box::new(of(FieldFile::Harmonic(Arc::new(harmonic(&scene, Precision::F32)))))),
        ("factored", Box::new(of(FieldFile::Factored(Box::new(factored(&scene)))))),
        ("factored with symmetry", Box::new(of(FieldFile::Factored(Box::new(symmetric(&scene)))))),
        ("siren", Box::new(of(FieldFile::Siren(Box::new(siren(&scene)))))),
        ("exact", Box::new(ExactField::new(&scene, &scene.record.tool))),
        (
            "verified",
            Box::new(VerifiedField::new(of(FieldFile::Factored(Box::new(factored(&scene))))).unwrap()),
        ),
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
            }
            field.values(&[], &mut []).unwrap();
        });
        counted("gradients", 0, &|room| field.gradients(&poses, &mut room.gradients).unwrap());
        let proven = ["exact", "verified"].contains(name);
        counted("decisions", if proven { 0 } else { PRODUCTS * BLOCKS }, &|room| {
            field.classify(&poses, &mut room.decisions).unwrap();
        });
        counted("values", if *name == "exact" { 0 } else { PRODUCTS * BLOCKS }, &|room| {
            field.values(&poses, &mut room.values).unwrap();
        });
    }
    let verified =
        VerifiedField::new(of(FieldFile::Harmonic(Arc::new(harmonic(&scene, Precision::F16))))).unwrap();
    let motion = || verified.check_motion(&poses[3], &poses[4]).unwrap();
    motion();
    let counted = measure(|| {
        std::hint::black_box(motion());
    });
    assert_eq!(counted.count_total, 0, "{counted:?}");
    // The counter counts.
    assert!(measure(|| drop(std::hint::black_box(vec![1_u8; 100]))).count_total > 0);
}
