use imf_core::orientation::OrientationSet;
use imf_core::tool::Clearance;
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{AdamConfig, Loss, Precision, TrainingLength, TrainingPlan};
use imf_fields::siren::SirenShape;

use super::definition::{EvaluationSettings, RANDOM_START};
use super::source::BUILT_IN;
use super::*;

fn recipe(name: &str) -> Recipe {
    Source::open(name).unwrap().recipe().unwrap_or_else(|error| panic!("{name}: {error:#}"))
}

/// What the paper trains with in every stage but for length and rate.
fn is_the_papers(stage: &Stage, epochs: u64, rate: f32) {
    let expected = TrainingPlan {
        length: TrainingLength::Epochs(epochs),
        batch: 1024,
        schedule: Schedule::Exponential { initial: rate, factor: 0.93, warmup: 0 },
        adam: AdamConfig { beta1: 0.9, beta2: 0.999, epsilon: 1e-8, weight_decay: 1e-6 },
        loss: Loss::L1,
        precision: Precision::F32,
        seed: 0,
        report_every: 20,
    };
    assert_eq!(stage.plan(), expected, "{}", stage.name);
    assert_eq!(stage.sampling.positive_fraction, 0.75);
}

fn sections(stage: &Stage) -> usize {
    stage.directions().unwrap().len()
}

#[test]
fn every_built_in_recipe_has_its_name_and_the_papers_network() {
    for (name, text) in BUILT_IN {
        let recipe = recipe(name);
        assert_eq!(recipe.name, name);
        assert_eq!(recipe.network.shape(), SirenShape::paper());
        assert_eq!(recipe.network.shape().parameter_count(), 1_056_769);
        assert_eq!((recipe.scene.tool.as_str(), recipe.scene.scale), ("paper", 1.0));
        assert_eq!(recipe.evaluation, EvaluationSettings::default());
        let counts: Vec<usize> =
            recipe.evaluation.imf.iter().map(|s| OrientationSet::parse(s).unwrap().len()).collect();
        assert_eq!(counts, [225, 625]);
        assert!(!Source::parse(text).unwrap().variants().unwrap().is_empty());
    }
}

#[test]
fn single_is_the_papers() {
    let recipe = recipe("single");
    let [stage] = recipe.stages.as_slice() else { panic!("one stage") };
    is_the_papers(stage, 50, 5e-4);
    assert_eq!((sections(stage), stage.resolution, stage.sampling.density), (225, 1.0, 0.35));
    assert_eq!(stage.start, RANDOM_START);
}

#[test]
fn multi_is_the_papers() {
    let recipe = recipe("multi");
    let [coarse, full] = recipe.stages.as_slice() else { panic!("two stages") };
    is_the_papers(coarse, 20, 5e-4);
    is_the_papers(full, 25, 5e-4);
    assert_eq!((sections(coarse), coarse.resolution), (900, 0.65));
    assert_eq!((sections(full), full.resolution), (225, 1.0));
    assert_eq!((coarse.start.as_str(), full.start.as_str()), (RANDOM_START, "coarse"));
    assert_eq!(recipe.results().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["full"]);
}

#[test]
fn transfer_is_the_papers_with_its_control() {
    let recipe = recipe("transfer");
    let [raw, adapted, control] = recipe.stages.as_slice() else { panic!("three stages") };
    is_the_papers(raw, 30, 5e-4);
    is_the_papers(adapted, 5, 1e-4);
    is_the_papers(control, 5, 5e-4);
    assert_eq!(raw.part.as_deref(), Some("bracket-raw"));
    assert_eq!((recipe.scene.part.as_str(), &adapted.part, &control.part), ("bracket", &None, &None));
    assert_eq!((adapted.start.as_str(), control.start.as_str()), ("raw", RANDOM_START));
    for stage in &recipe.stages {
        assert_eq!((sections(stage), stage.sampling.density), (225, 0.15));
    }
    assert_eq!(recipe.results().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["adapted", "control"]);
}

#[test]
fn sweeps_are_single_with_one_thing_changed() {
    let run = |name: &str| -> Vec<(String, Recipe)> {
        let all = Source::open(name).unwrap().variants().unwrap();
        all.into_iter().map(|(name, source)| (name, source.recipe().unwrap())).collect()
    };
    let single = recipe("single");
    let densities: Vec<f64> = run("sparsity").iter().map(|(_, r)| r.stages[0].sampling.density).collect();
    assert_eq!(densities, [0.10, 0.35, 0.50]);
    for (name, recipe) in run("sparsity").iter().chain(&run("architecture")) {
        let mut stage = recipe.stages[0].clone();
        stage.sampling.density = 0.35;
        assert_eq!([stage].as_slice(), single.stages, "{name}");
    }
    let architectures = run("architecture");
    assert!(architectures.iter().all(|(_, r)| r.scene.part == "screw-gear"), "the paper's is the screw gear");
    let mut sizes: Vec<_> = architectures.iter().map(|(_, r)| (r.network.width, r.network.layers)).collect();
    sizes.sort_unstable();
    assert_eq!(sizes, [(256, 5), (512, 4), (512, 5), (512, 6), (1024, 5)]);
}

#[test]
fn values_are_set_by_path_and_checked_like_the_file() {
    let base = Source::open("multi").unwrap();
    let with = |text: &str| {
        let mut own = base.clone();
        own.assign(text)?;
        own.recipe()
    };
    assert_eq!(with("network.width=128").unwrap().network.width, 128);
    assert_eq!(with("scene.scale=0.5").unwrap().scene.scale, 0.5);
    assert_eq!(with("evaluation.imf=[\"grid:3\"]").unwrap().evaluation.imf, ["grid:3"]);
    assert_eq!(with("stage.full.start = random").unwrap().stages[1].start, RANDOM_START);
    let all = with("stage.*.training.batch=64").unwrap();
    assert!(all.stages.iter().all(|stage| stage.training.batch == 64));
    let one = with("stage.full.training.length.epochs=3").unwrap();
    assert_eq!(one.stages[1].training.length, TrainingLength::Epochs(3));
    assert_eq!(one.stages[0].training.length, TrainingLength::Epochs(20));
    for (text, word) in [
        ("network.width", "KEY=VALUE"),
        ("network.widht=3", "widht"),
        ("stage.fine.training.batch=3", "no stage 'fine'"),
        ("stage.full=3", "say what"),
        ("stage.full.training.batch=0", "batch"),
        ("stage.full.start=later", "neither"),
        ("stage.coarse.start=full", "neither"),
        ("stage.full.name=coarse", "same name"),
        ("stage.full.sampling.density=2.0", "density"),
        ("stage.full.orientations=grid", "grid"),
        ("network.width.deep=1", "plain value"),
        ("network..width=1", "names with dots"),
        ("version=2", "newer"),
        ("scene.scale=0.0", "scale"),
        ("evaluation.imf=[]", "imf"),
    ] {
        let error = format!("{:#}", with(text).unwrap_err());
        assert!(error.contains(word), "{text}: {error}");
    }
    assert!(Source::open("singel").unwrap_err().root_cause().to_string().contains("single, multi"));
    let missing = Source::parse("name = 'x'").unwrap().recipe().unwrap_err();
    assert!(missing.to_string().contains("version = 1"));
}

#[test]
fn clearance_and_contact_are_set_by_path_and_written_again() {
    let mut source = Source::open("single").unwrap();
    source.assign("scene.clearance.holder=2").unwrap();
    source.assign("scene.contact=0.5").unwrap();
    let again = Source::parse(&source.text().unwrap()).unwrap();
    assert_eq!(again, source);
    let recipe = again.recipe().unwrap();
    assert_eq!(recipe.scene.clearance, Clearance { holder: 2.0, ..Clearance::default() });
    assert_eq!(recipe.scene.contact, Some(0.5));
    let written = Source::parse(&toml::to_string(&recipe).unwrap()).unwrap();
    assert_eq!(written.recipe().unwrap(), recipe);
}
