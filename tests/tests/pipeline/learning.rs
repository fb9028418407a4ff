//! Does training learn? A small network on real sections, judged at orientations that it never saw.

use std::ops::ControlFlow;

use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_fields::evaluation::{field_sections, nearest_sections};
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{AdamConfig, TrainingState};
use imf_fields::recipe::{Cursor, TrainingLength, TrainingPlan};
use imf_fields::siren::evaluator::CpuEvaluator;
use imf_fields::siren::{SirenShape, over_grid};
use imf_train::engine::CpuTrainer;
use imf_train::training::TrainingEngine;
use imf_train::training::run::{Outcome, train};

use crate::scene::{bracket, orientations, plan, samples};

#[test]
fn a_small_network_beats_the_nearest_section_and_a_tenth_of_the_variance() {
    let shape = SirenShape { width: 48, hidden: 4, skip_after: Some(2), omega: 10.0 };
    let scene = bracket();
    let (seen, unseen) = (orientations("fibonacci:64"), orientations("random:64:5").orientations);
    let (_, samples) = samples(&scene, &seen, 0.7);
    let settings = TrainingPlan {
        length: TrainingLength::Steps(3000),
        batch: 512,
        schedule: Schedule::Cosine { initial: 1e-3, last: 1e-5, warmup: 200 },
        adam: AdamConfig { weight_decay: 0.0, ..AdamConfig::default() },
        ..TrainingPlan::default()
    };
    let start = TrainingState::new(&shape, 0);
    let TrainingPlan { adam, loss, batch, .. } = settings;
    let mut engine = CpuTrainer::new(shape.stack(), adam, loss, batch, start).unwrap();
    let outcome =
        train(&settings, &samples, &mut engine, Cursor::default(), &mut |_, _| ControlFlow::Continue(()));
    assert_eq!(outcome.unwrap(), Outcome::Finished);

    let plan = plan(&scene);
    let report = |parameters: &[f32]| {
        let mut evaluator = CpuEvaluator::new(shape, parameters).unwrap();
        let section = |orientation: &Orientation, values: &mut [f32]| {
            over_grid::section(&mut evaluator, plan.grid(), orientation.angles(), values).unwrap();
        };
        field_sections(&plan, &unseen, 0.001, Control::quiet(), section).unwrap().overall
    };
    let learnt = report(&engine.state().unwrap().parameters);
    let nearest = nearest_sections(&(&plan).into(), &unseen, &seen.orientations, 0.001, Control::quiet())
        .unwrap()
        .overall;
    assert!(
        learnt.mse < 0.1 * learnt.variance,
        "{:.2e} of a variance of {:.2e}",
        learnt.mse,
        learnt.variance
    );
    assert!(learnt.mse < nearest.mse, "{:.2e}, the nearest section {:.2e}", learnt.mse, nearest.mse);

    // The bar is one that a network which has learnt nothing does not pass.
    let blank = report(&shape.initial_parameters(0));
    assert!(
        blank.mse > 0.1 * blank.variance && blank.mse > nearest.mse,
        "{:.2e} without training",
        blank.mse
    );
    println!("learnt {learnt:?}\nnearest {nearest:?}\nblank {blank:?}");
}
