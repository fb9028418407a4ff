//! `imf demo`: mesh, voxels, sections, dataset, training, evaluation and pictures in one go, nothing to configure.

use std::time::Instant;

use anyhow::Result;
use imf_core::dataset::{Sampling, generate};
use imf_core::field::LearntField;
use imf_core::held_out::HeldOutChoice;
use imf_core::mesh::topology::MeshReport;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::siren::SirenShape;
use imf_core::tool::Tool;
use imf_core::training::run::{Length, TrainingPlan};
use imf_core::training::schedule::Schedule;
use imf_core::training::{AdamConfig, TrainingState};

use super::dataset::interruption;
use crate::arguments::DemoArguments;
use crate::engine::Device;
use crate::job::{self, Data, Settings};
use crate::output::{prepare_folder, print, print_json};
use crate::progress::show_seconds;
use crate::report::{Questions, Subject, evaluate};
use crate::session::Session;

/// Training steps: a minute on two fast cores.
pub(crate) const STEPS: u64 = 30_000;
/// Half the paper's resolution of the teapot; the paper's tool then spans half as many voxels.
const DIMS: [usize; 3] = [29, 38, 61];
/// As many sections as the paper trains from, spread evenly over the sphere.
const SECTIONS: usize = 225;
/// A narrow network and a lower frequency than the paper's 30: trained on 225 sections for a minute, ω = 10 reaches an
/// MSE of 2e-6 at unseen orientations, ω = 30 2e-5.
pub(crate) const SHAPE: SirenShape = SirenShape { width: 128, hidden: 5, skip_after: Some(2), omega: 10.0 };

pub(crate) fn run(session: &Session, arguments: &DemoArguments) -> Result<()> {
    let begun = Instant::now();
    prepare_folder(&arguments.out)?;
    let device = Device::open(&arguments.device.device, session)?;

    let part = ReferencePart::Teapot;
    let mesh = part.mesh();
    let tool = Tool::paper();
    let spec = SceneSpec::of_reference(part, &mesh, DIMS, &tool);
    let scene = spec.scene()?;
    let [x, y, z] = DIMS;
    session.note(&format!(
        "teapot: {} triangles, {x}×{y}×{z} voxels of {:.1} mm, {} solid; tool: {}",
        MeshReport::new(&mesh).triangles,
        scene.record.grid.pitch,
        scene.obstacle.count(),
        tool.name
    ));

    let set = OrientationSet::parse(&format!("fibonacci:{SECTIONS}"))?;
    let folder = arguments.out.join("dataset");
    let stage = session.stage("exact sections", "sections", SECTIONS as u64);
    let advance = |n| stage.advance(n);
    let sampling = Sampling { seed: arguments.seed, ..Sampling::default() };
    let made = generate(&folder, &scene, &set, &sampling, session.control(&advance))
        .map_err(|error| interruption(error, &folder))?;
    stage.finish(&format!("{} samples", made.samples));

    let data = Data::open(&folder)?;
    let plan = TrainingPlan {
        length: Length::Steps(arguments.steps),
        schedule: Schedule::Cosine { initial: 5e-4, last: 5e-6, warmup: 200 },
        adam: AdamConfig { weight_decay: 0.0, ..AdamConfig::default() },
        seed: arguments.seed,
        ..job::plan_defaults()
    };
    let state = TrainingState::new(&SHAPE, arguments.seed);
    let fresh = job::fresh_model(&data, SHAPE, plan, state, None);
    let model = job::continued(session, &arguments.out, &data, fresh);
    let settings = Settings {
        checkpoint_every: 30.0,
        go_on: "run the same command again",
        held_out: HeldOutChoice::default().poses,
        held_out_every: None,
        log: None,
        tensorboard: false,
    };
    let model = job::run(session, &device, &data, model, &arguments.out, &settings)?;

    let mut engine = device.evaluator(model.shape, &model.state.parameters)?;
    let questions = Questions {
        in_sample: set.orientations.first().copied(),
        out_of_sample: Some(Orientation::new(12.0, 6.0)),
        random: OrientationSet::parse(&format!("random:64:{}", arguments.seed.wrapping_add(1)))?,
        imf: set,
        threshold: 0.001,
    };
    let (subject, evaluated_by) = (Subject::of_model(&model), engine.describe());
    let mut field = LearntField::new(model.scene.record.grid, engine.as_mut());
    let evaluation = evaluate(session, &subject, &mut field, evaluated_by, &questions)?;
    evaluation.write(&arguments.out, &subject, &mut field)?;
    if session.json {
        return print_json(&evaluation.report);
    }
    print(&format!(
        "\n{}\n\n{} holds model.safetensors, report.md, report.json and pictures; {} in all.",
        evaluation.report.table(),
        arguments.out.display(),
        show_seconds(begun.elapsed().as_secs_f64())
    ))
}
