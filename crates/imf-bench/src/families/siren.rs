//! The paper's kind of network for the comparison: the demo's, from a dataset of its own.

use anyhow::Result;
use imf_cli::commands::dataset::interruption;
use imf_cli::commands::demo::SHAPE;
use imf_cli::engine::Device;
use imf_cli::job::{self, Data, Settings};
use imf_cli::session::Session;
use imf_core::orientation::OrientationSet;
use imf_core::scene::Scene;
use imf_fields::model::Model;
use imf_fields::recipe::Sampling;
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{AdamConfig, TrainingState};
use imf_fields::recipe::{Length, TrainingPlan};
use imf_train::dataset::generate;

use crate::arguments::families::FamiliesArguments;
use crate::arguments::paper::PaperPart;

/// Trains it, and says in how many seconds: sections, samples and steps.
pub(super) fn train(
    session: &Session,
    device: &Device,
    scene: &Scene,
    arguments: &FamiliesArguments,
    part: PaperPart,
) -> Result<(Model, f64)> {
    let count = arguments.angles * arguments.angles;
    let [x, y, z] = scene.record.grid.dims;
    let name = format!("{}-{x}x{y}x{z}-{count}-{}", part.name(), arguments.seed);
    let out = arguments.out.join("runs").join(name);
    let folder = out.join("dataset");
    let set = OrientationSet::parse(&format!("fibonacci:{count}"))?;
    let begun = std::time::Instant::now();
    let stage = session.stage("siren5's samples", "sections", count);
    let advance = |n| stage.advance(n);
    let sampling = Sampling { seed: arguments.seed, ..Sampling::default() };
    generate(&folder, scene, &set, &sampling, session.control(&advance))
        .map_err(|error| interruption(error, &folder))?;
    stage.finish("");
    let sampled = begun.elapsed().as_secs_f64();
    let data = Data::open(&folder)?;
    let plan = TrainingPlan {
        length: Length::Steps(arguments.siren_steps),
        schedule: Schedule::Cosine { initial: 5e-4, last: 5e-6, warmup: 200 },
        adam: AdamConfig { weight_decay: 0.0, ..AdamConfig::default() },
        seed: arguments.seed,
        ..job::plan_defaults()
    };
    let fresh = job::fresh_model(&data, SHAPE, plan, TrainingState::new(&SHAPE, arguments.seed), None);
    let model = job::continued(session, &out, &data, fresh);
    let settings = Settings {
        checkpoint_every: 60.0,
        go_on: "run the same command again",
        slower: " with a rate of ",
        held_out: 0,
        held_out_every: None,
    };
    let model = job::run(session, device, &data, model, &out, &settings)?;
    let seconds = sampled + model.record.seconds;
    Ok((model, seconds))
}
