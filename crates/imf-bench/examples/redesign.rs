//! A part that changes in steps, as in topology optimisation, and a field that keeps up: from the bracket's solid design
//! domain towards the optimised bracket ever more material goes, and at every step the factored field of the last one is
//! fine-tuned to the new part's signed depth. Beside it the same network from random weights, in as many steps, and the
//! old field as it was.
//!
//! Thirty changes at half the bracket's resolution, as many voxels at each.
//!
//! `cargo run --release -p imf-bench --example redesign [FOLDER [STEPS]]`; so many steps at each change, 60 by default

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use imf_cli::output::table;
use imf_cli::picture::{AxisScale, Chart, Series};
use imf_core::control::Control;
use imf_core::distance::DistanceField;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::{DepthPlan, DepthScratch, Quantity, SectionPlan, ToolPoints};
use imf_core::tool::Tool;
use imf_fields::factored::{DistillSettings, FactoredField, FactoredState};
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::{FitSettings, HarmonicField, fit};
use imf_fields::recipe::{TrainingLength, TrainingPlan};
use imf_train::distill::{distil, start_from};

/// How large the study is.
struct Study {
    dims: [usize; 3],
    /// Changes from the design domain to the bracket.
    changes: usize,
    degree: usize,
    components: usize,
    width: usize,
    /// Steps of training: from random weights at the first part, then at each change.
    first: u64,
    each: u64,
}

/// Orientations at which fields are compared; no fit has seen them.
const RANDOM: &str = "random:24:9";
/// What is compared, and what takes time.
const ERRORS: [&str; 3] =
    ["fine-tuned from the last step", "from random weights, as many steps", "last step's field as it was"];
const SECONDS: [&str; 2] = ["exact sections and their fit", "fine-tuning"];

/// What a step came to.
struct Step {
    /// Fraction of the design domain that is solid.
    solid: f64,
    /// Root mean squares in mm against exact depths, in the order of [`ERRORS`].
    errors: [Option<f64>; 3],
    /// In the order of [`SECONDS`].
    seconds: [f64; 2],
}

fn study(study: &Study) -> Result<Vec<Step>, Box<dyn Error>> {
    let voxelised =
        |part: ReferencePart| SceneSpec::of_reference(part, &part.mesh(), study.dims, &Tool::paper()).scene();
    let domain = voxelised(ReferencePart::BracketRaw)?.obstacle;
    let Scene { record, obstacle: goal, .. } = voxelised(ReferencePart::Bracket)?;
    let away = DistanceField::new(&goal);
    // What goes, the farthest from the bracket first.
    let mut goes: Vec<usize> =
        (0..goal.solid.len()).filter(|&index| domain.solid[index] > goal.solid[index]).collect();
    goes.sort_by_key(|&index| (std::cmp::Reverse(away.squared(index)), index));
    let random = OrientationSet::parse(RANDOM)?.orientations;
    let of_size = |defaults: DistillSettings| DistillSettings {
        width: study.width,
        plan: TrainingPlan { batch: 512, ..defaults.plan },
        ..defaults
    };
    let mut steps: Vec<Step> = Vec::new();
    let mut field: Option<FactoredField> = None;
    for change in 0..=study.changes {
        let mut part = domain.clone();
        for &index in &goes[..goes.len() * change / study.changes] {
            part.solid[index] = 0;
        }
        let plan = SectionPlan::new(&part, &record.tool, ToolPoints::SharpPoints)?;
        let begun = Instant::now();
        let settings = FitSettings {
            quantity: Quantity::Depth,
            degree: study.degree,
            components: study.components,
            sections_per_function: 2.0,
            ..FitSettings::default()
        };
        let teacher = fit(&plan, Domain::Directions, &settings, Control::quiet())?;
        let fitting = begun.elapsed().as_secs_f64();
        let exact = depths(&plan, &random)?;
        let error = |field: &FactoredField| root_mean_square(field, &random, &exact);
        let not_adapted = field.as_ref().map(error);
        let begun = Instant::now();
        let length = TrainingLength::Steps(if field.is_some() { study.each } else { study.first });
        let from_random = of_size(DistillSettings::of_length(length));
        let start = || from_random.start(teacher.component_count());
        let tuned = match &field {
            Some(old) => {
                let tuning = of_size(DistillSettings::of_another(length));
                distilled(&teacher, &tuning, start_from(old, &teacher, &part)?)?
            }
            None => distilled(&teacher, &from_random, start())?,
        };
        let tuning = begun.elapsed().as_secs_f64();
        let anew = distilled(&teacher, &from_random, start())?;
        steps.push(Step {
            solid: part.count() as f64 / domain.count() as f64,
            errors: [Some(error(&tuned)), Some(error(&anew)), not_adapted],
            seconds: [fitting, tuning],
        });
        field = Some(tuned);
    }
    Ok(steps)
}

/// The network at the end of a training from a start.
fn distilled(
    teacher: &HarmonicField,
    settings: &DistillSettings,
    mut state: FactoredState,
) -> Result<FactoredField, Box<dyn Error>> {
    distil(teacher, settings, &mut state, Control::quiet(), &mut |_| {})?;
    Ok(FactoredField::new(teacher, settings.shape(teacher.component_count()), state.training.parameters)?)
}

/// Exact depths, `[orientation][voxel]`.
fn depths(plan: &SectionPlan, set: &[Orientation]) -> Result<Vec<f32>, Box<dyn Error>> {
    let (plan, mut scratch) = (DepthPlan::of(plan)?, DepthScratch::default());
    let voxels = plan.grid().len();
    let mut all = vec![0.0; voxels * set.len()];
    for (orientation, depths) in set.iter().zip(all.chunks_exact_mut(voxels)) {
        plan.depths(orientation, &mut scratch, depths)?;
    }
    Ok(all)
}

fn root_mean_square(field: &FactoredField, set: &[Orientation], exact: &[f32]) -> f64 {
    let mut found = vec![0.0; exact.len()];
    field.evaluator().sections(&field.direction_weights(set), &mut found);
    let squares: f64 = found.iter().zip(exact).map(|(&a, &b)| f64::from(a - b).powi(2)).sum();
    (squares / exact.len() as f64).sqrt()
}

/// Error and time by step, `errors.png` and `seconds.png` in a folder.
fn draw(folder: &Path, steps: &[Step]) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(folder)?;
    let chart = |title: &str,
                 value_name: &str,
                 names: &[&str],
                 value: &dyn Fn(&Step, usize) -> Option<f64>| {
        let series = names.iter().enumerate().map(|(index, name)| Series {
            name: (*name).into(),
            points: steps.iter().filter_map(|s| Some((100.0 * (1.0 - s.solid), value(s, index)?))).collect(),
            markers: true,
        });
        Chart {
            title: title.into(),
            x_name: "material taken from the design domain, %".into(),
            x_scale: AxisScale::Linear,
            value_name: value_name.into(),
            value_scale: AxisScale::Linear,
            series: series.collect(),
        }
    };
    let error = "root mean square of the depth's error, mm";
    chart("Error as the part changes", error, &ERRORS, &|step, index| step.errors[index])
        .save(&folder.join("errors.png"))?;
    chart("Time of a step", "seconds", &SECONDS, &|step, index| Some(step.seconds[index]))
        .save(&folder.join("seconds.png"))?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "redesign".into());
    let each = std::env::args().nth(2).map_or(Ok(60), |steps| steps.parse())?;
    let whole =
        Study { dims: [25, 74, 44], changes: 30, degree: 8, components: 60, width: 128, first: 1500, each };
    let steps = study(&whole)?;
    let rows = steps.iter().map(|step| {
        let errors = step.errors.map(|error| error.map_or("–".into(), |error| format!("{error:.2} mm")));
        let seconds = step.seconds.map(|seconds| format!("{seconds:.1} s"));
        [format!("{:.0} %", 100.0 * step.solid)].into_iter().chain(errors).chain(seconds).collect()
    });
    let head: Vec<&str> = ["solid"].into_iter().chain(ERRORS).chain(SECONDS).collect();
    println!("{}", table(&head, &rows.collect::<Vec<_>>()));
    draw(Path::new(&folder), &steps)?;
    println!("wrote {folder}/errors.png and {folder}/seconds.png");
    Ok(())
}

#[test]
fn fine_tuning_keeps_up_with_the_part() {
    let small =
        Study { dims: [9, 25, 15], changes: 6, degree: 5, components: 24, width: 48, first: 400, each: 60 };
    let steps = study(&small).unwrap();
    assert!(steps.windows(2).all(|pair| pair[1].solid < pair[0].solid));
    for (place, step) in steps.iter().enumerate().skip(1) {
        let [tuned, anew, old] = step.errors.map(Option::unwrap);
        assert!(tuned < old, "step {place}: {tuned} against {old} unadapted");
        assert!(tuned < anew, "step {place}: {tuned} against {anew} anew");
    }
    let folder = tempfile::tempdir().unwrap();
    draw(folder.path(), &steps).unwrap();
    for name in ["errors.png", "seconds.png"] {
        let picture = image::open(folder.path().join(name)).unwrap().into_rgb8();
        let coloured = picture.pixels().filter(|p| p.0[0].abs_diff(p.0[2]) > 60).count();
        assert!(coloured > 1000, "{name}: {coloured} pixels of the lines");
    }
}
