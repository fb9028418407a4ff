use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{AdamConfig, Loss, Precision};

use super::*;

fn recipe(name: &str) -> Recipe {
    Recipe::parse(built_in(name).unwrap().text).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// What the paper trains with in every stage but for length and rate.
fn is_the_papers(stage: &Stage, epochs: u64, rate: f32) {
    let expected = TrainingPlan {
        length: Length::Epochs(epochs),
        batch: 1024,
        schedule: Schedule::Exponential { initial: rate, factor: 0.93, warmup: 0 },
        adam: AdamConfig { beta1: 0.9, beta2: 0.999, epsilon: 1e-8, weight_decay: 1e-6 },
        loss: Loss::L1,
        precision: Precision::F32,
        seed: 0,
        report_every: 20,
    };
    assert_eq!(stage.plan(), expected, "{}", stage.name);
    assert_eq!(stage.rate_rule, RateRule::Constant);
    assert_eq!((stage.sampling.positive_share, stage.sampling.boundary_share), (0.75, 0.0));
}

fn sections(stage: &Stage) -> usize {
    OrientationSet::parse(stage.orientations.as_ref().unwrap()).unwrap().len()
}

#[test]
fn every_built_in_recipe_has_its_name_and_the_papers_network() {
    for built_in in BUILT_IN {
        let recipe = recipe(built_in.name);
        assert_eq!(recipe.name, built_in.name);
        assert_eq!(recipe.network.shape(), SirenShape::default());
        assert_eq!(recipe.network.shape().parameter_count(), 1_056_769);
        assert_eq!((recipe.scene.tool.as_str(), recipe.scene.scale), ("paper", 1.0));
        assert_eq!(recipe.evaluation, EvaluationSettings::default());
        let counts: Vec<usize> =
            recipe.evaluation.imf.iter().map(|s| OrientationSet::parse(s).unwrap().len()).collect();
        assert_eq!(counts, [225, 625]);
        assert!(!runs(&table(built_in.text).unwrap()).unwrap().is_empty());
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
        let all = runs(&table(built_in(name).unwrap().text).unwrap()).unwrap();
        all.into_iter().map(|(name, t)| (name.unwrap(), Recipe::from_table(t).unwrap())).collect()
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
fn online_sees_as_many_samples_as_single() {
    let recipe = recipe("online");
    let [stage] = recipe.stages.as_slice() else { panic!("one stage") };
    let settings = stage.online.unwrap();
    let Length::Epochs(epochs) = stage.training.length else { panic!("epochs") };
    let share = settings.pool as f64 * stage.sampling.density * epochs as f64;
    assert!((share / (225.0 * 0.35 * 50.0) - 1.0).abs() < 1e-12);
    assert_eq!((settings.pool, settings.every), (225, 1));
}

#[test]
fn values_are_set_by_path_and_checked_like_the_file() {
    let base = table(built_in("multi").unwrap().text).unwrap();
    let with = |path: &str, value: toml::Value| {
        let mut own = base.clone();
        set(&mut own, path, value)?;
        Recipe::from_table(own)
    };
    assert_eq!(with("network.width", 128.into()).unwrap().network.width, 128);
    assert_eq!(with("scene.scale", 0.5.into()).unwrap().scene.scale, 0.5);
    let all = with("stage.*.training.batch", 64.into()).unwrap();
    assert!(all.stages.iter().all(|stage| stage.training.batch == 64));
    let one = with("stage.full.training.length.epochs", 3.into()).unwrap();
    assert_eq!(one.stages[1].training.length, Length::Epochs(3));
    assert_eq!(one.stages[0].training.length, Length::Epochs(20));
    for (path, value, word) in [
        ("network.widht", toml::Value::from(3), "widht"),
        ("stage.fine.training.batch", 3.into(), "no stage 'fine'"),
        ("stage.full", 3.into(), "say what"),
        ("stage.full.training.batch", 0.into(), "batch"),
        ("stage.full.start", "later".into(), "neither"),
        ("stage.coarse.start", "full".into(), "neither"),
        ("stage.full.name", "coarse".into(), "same name"),
        ("stage.full.sampling.density", 2.0.into(), "density"),
        ("stage.full.orientations", "grid".into(), "grid"),
        ("network.width.deep", 1.into(), "plain value"),
        ("network..width", 1.into(), "names with dots"),
        ("version", 2.into(), "newer"),
        ("scene.scale", 0.0.into(), "scale"),
        ("evaluation.imf", toml::Value::Array(Vec::new()), "imf"),
    ] {
        let error = with(path, value).unwrap_err().to_string();
        assert!(error.contains(word), "{path}: {error}");
    }
    assert!(built_in("singel").unwrap_err().to_string().contains("single, multi"));
    assert!(Recipe::parse("name = 'x'").unwrap_err().to_string().contains("version = 1"));

    for (text, path, value) in [
        ("network.width=128", "network.width", toml::Value::from(128)),
        ("stage.a.start = random", "stage.a.start", "random".into()),
        ("evaluation.imf=[\"grid:3\"]", "evaluation.imf", vec!["grid:3"].into()),
        ("scene.scale=0.5", "scene.scale", 0.5.into()),
    ] {
        assert_eq!(assignment(text).unwrap(), (path.to_owned(), value), "{text}");
    }
    assert!(assignment("network.width").is_err());
}

#[test]
fn clearance_and_contact_are_set_by_path_and_written_again() {
    let mut table: toml::Table = built_in("single").unwrap().text.parse().unwrap();
    for text in ["scene.clearance.holder=2", "scene.contact=0.5"] {
        let (path, value) = assignment(text).unwrap();
        set(&mut table, &path, value).unwrap();
    }
    let recipe = Recipe::parse(&toml::to_string(&table).unwrap()).unwrap();
    assert_eq!(recipe.scene.clearance, Clearance { holder: 2.0, ..Clearance::default() });
    assert_eq!(recipe.scene.contact, Some(0.5));
    assert_eq!(Recipe::parse(&toml::to_string(&recipe).unwrap()).unwrap(), recipe);
}
