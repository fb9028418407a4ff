//! A part that changes in steps, as in topology optimisation, and a field that keeps up: from the bracket's solid design
//! domain towards the optimised bracket ever more material goes, and at every step the factored field of the last one is
//! fine-tuned to the new part's signed depth. Beside it the same network from random weights, in as many steps, and the
//! old field as it was.
//!
//! `cargo run --release -p imf-bench --example redesign [FOLDER [STEPS]]`; so many steps of teaching at each change, 200 by default

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use imf_cli::picture::{AxisScale, Chart, Series};
use imf_core::control::Control;
use imf_core::distance::DistanceField;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::{At, DepthPlan, DepthScratch, Quantity, SectionPlan};
use imf_core::tool::Tool;
use imf_fields::factored::{DistillSettings, FactoredField, FactoredState};
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::{FitSettings, HarmonicField, fit};
use imf_fields::recipe::{Length, TrainingPlan};
use imf_train::distill::{distil, start_from};

/// How large the study is.
struct Study {
    dims: [usize; 3],
    degree: usize,
    axes: usize,
    width: usize,
    /// Steps of teaching: from random weights at the first part, then at each change.
    first: u64,
    each: u64,
}

/// Material is kept up to these distances from the optimised bracket, in voxels.
const KEPT: [f64; 7] = [f64::INFINITY, 5.0, 3.5, 2.3, 1.5, 1.0, 0.0];
/// Orientations at which fields are judged; no fit has seen them.
const JUDGED: &str = "random:24:9";

/// What a step came to; errors are root mean squares in mm against exact depths.
struct Step {
    /// Share of the design domain that is solid.
    solid: f64,
    fine_tuned: f64,
    from_random: f64,
    not_adapted: Option<f64>,
    /// Seconds: fitting the teacher to exact sections, fine-tuning.
    fitting: f64,
    tuning: f64,
}

fn study(study: &Study) -> Result<Vec<Step>, Box<dyn Error>> {
    let voxelised =
        |part: ReferencePart| SceneSpec::of_reference(part, &part.mesh(), study.dims, &Tool::paper()).scene();
    let domain = voxelised(ReferencePart::BracketRaw)?;
    let Scene { record, obstacle: goal, .. } = voxelised(ReferencePart::Bracket)?;
    let away = DistanceField::new(&goal);
    let judged = OrientationSet::parse(JUDGED)?.orientations;
    let mut steps: Vec<Step> = Vec::new();
    let mut field: Option<FactoredField> = None;
    for kept in KEPT {
        let near = |index: usize| away.squared(index).is_some_and(|d| (d as f64).sqrt() <= kept);
        let solid = (0..goal.solid.len())
            .map(|index| {
                u8::from(goal.solid[index] != 0 || (domain.obstacle.solid[index] != 0 && near(index)))
            })
            .collect();
        let part = Occupancy { grid: goal.grid, solid };
        let plan = SectionPlan::new(&part, &record.tool, At::SharpPoints)?;
        let begun = Instant::now();
        let settings = FitSettings {
            quantity: Quantity::Depth,
            degree: study.degree,
            axes: study.axes,
            sections_per_function: 2.0,
            ..FitSettings::default()
        };
        let teacher = fit(&plan, Domain::Directions, &settings, Control::quiet())?;
        let fitting = begun.elapsed().as_secs_f64();
        let exact = depths(&plan, &judged)?;
        let error = |field: &FactoredField| root_mean_square(field, &judged, &exact);
        let not_adapted = field.as_ref().map(error);
        let begun = Instant::now();
        let steps_of_teaching = Length::Steps(if field.is_some() { study.each } else { study.first });
        let from_random = at_size_of(study, DistillSettings::of_length(steps_of_teaching));
        let start = || from_random.start(teacher.axis_count());
        let tuned = match &field {
            Some(old) => {
                let tuning = at_size_of(study, DistillSettings::of_another(steps_of_teaching));
                taught(&teacher, &tuning, start_from(old, &teacher, &part)?)?
            }
            None => taught(&teacher, &from_random, start())?,
        };
        let tuning = begun.elapsed().as_secs_f64();
        let anew = taught(&teacher, &from_random, start())?;
        steps.push(Step {
            solid: part.count() as f64 / domain.obstacle.count() as f64,
            fine_tuned: error(&tuned),
            from_random: error(&anew),
            not_adapted,
            fitting,
            tuning,
        });
        field = Some(tuned);
    }
    Ok(steps)
}

/// The defaults for a start, at the study's size.
fn at_size_of(study: &Study, defaults: DistillSettings) -> DistillSettings {
    DistillSettings { width: study.width, plan: TrainingPlan { batch: 512, ..defaults.plan }, ..defaults }
}

/// The network at the end of a teaching from a start.
fn taught(
    teacher: &HarmonicField,
    settings: &DistillSettings,
    mut state: FactoredState,
) -> Result<FactoredField, Box<dyn Error>> {
    distil(teacher, settings, &mut state, Control::quiet(), &mut |_| {})?;
    Ok(FactoredField::new(teacher, settings.shape(teacher.axis_count()), state.training.parameters)?)
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

/// A curve by step.
type Curve<'a> = (&'a str, &'a dyn Fn(&Step) -> Option<f64>);

/// Error and time by step, `errors.png` and `seconds.png` in a folder.
fn draw(folder: &Path, steps: &[Step]) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(folder)?;
    let chart = |title: &str, value_name: &str, curves: &[Curve<'_>]| Chart {
        title: title.into(),
        x_name: "material taken from the design domain, %".into(),
        x_scale: AxisScale::Linear,
        value_name: value_name.into(),
        value_scale: AxisScale::Linear,
        series: curves
            .iter()
            .map(|(name, value)| Series {
                name: (*name).into(),
                points: steps.iter().filter_map(|s| Some((100.0 * (1.0 - s.solid), value(s)?))).collect(),
                markers: true,
            })
            .collect(),
    };
    let errors = chart(
        "Error as the part changes",
        "root mean square of the depth's error, mm",
        &[
            ("fine-tuned from the last step", &|s| Some(s.fine_tuned)),
            ("from random weights, as many steps", &|s| Some(s.from_random)),
            ("last step's field as it was", &|s| s.not_adapted),
        ],
    );
    errors.save(&folder.join("errors.png"))?;
    let seconds = chart(
        "Time of a step",
        "seconds",
        &[("exact sections and their fit", &|s| Some(s.fitting)), ("fine-tuning", &|s| Some(s.tuning))],
    );
    seconds.save(&folder.join("seconds.png"))?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "redesign".into());
    let each = std::env::args().nth(2).map_or(Ok(200), |steps| steps.parse())?;
    let whole = Study { dims: [17, 49, 29], degree: 8, axes: 60, width: 128, first: 1500, each };
    let steps = study(&whole)?;
    println!("solid   fine-tuned  from random  not adapted   fit    fine-tuning");
    for Step { solid, fine_tuned, from_random, not_adapted, fitting, tuning } in &steps {
        let not_adapted = not_adapted.map_or("          -".into(), |error| format!("{error:8.2} mm"));
        println!(
            "{:4.0} %  {fine_tuned:8.2} mm {from_random:9.2} mm  {not_adapted}  {fitting:4.1} s  {tuning:5.1} s",
            100.0 * solid
        );
    }
    draw(Path::new(&folder), &steps)?;
    println!("wrote {folder}/errors.png and {folder}/seconds.png");
    Ok(())
}

#[test]
fn fine_tuning_keeps_up_with_the_part() {
    let small = Study { dims: [9, 25, 15], degree: 5, axes: 24, width: 48, first: 400, each: 60 };
    let steps = study(&small).unwrap();
    assert!(steps.windows(2).all(|pair| pair[1].solid < pair[0].solid));
    for (place, step) in steps.iter().enumerate().skip(1) {
        let old = step.not_adapted.unwrap();
        assert!(step.fine_tuned < old, "step {place}: {} against {old} unadapted", step.fine_tuned);
        let anew = step.from_random;
        assert!(step.fine_tuned < anew, "step {place}: {} against {anew} anew", step.fine_tuned);
    }
    let folder = tempfile::tempdir().unwrap();
    draw(folder.path(), &steps).unwrap();
    for name in ["errors.png", "seconds.png"] {
        let picture = image::open(folder.path().join(name)).unwrap().into_rgb8();
        let coloured = picture.pixels().filter(|p| p.0[0].abs_diff(p.0[2]) > 60).count();
        assert!(coloured > 1000, "{name}: {coloured} pixels of the lines");
    }
}
