//! Training by sections alone: each step's targets are those of the definition, the field comes near, and stops change no
//! bit.

use super::*;
use crate::distill::sections::SectionEngine;
use crate::fixtures::Recorder;
use crate::training::run::Report;
use imf_fields::recipe::OnlineSettings;
use imf_fields::siren::ShapeError;

const ONLINE: OnlineSettings = OnlineSettings { pool: 40, every: 1, seed: 3, lead: 4 };

#[test]
fn targets_are_the_coefficients_to_expect() {
    let plan = plan(&scene());
    let harmonic = SectionSource::new(&plan, Domain::Directions, &FIT, Control::quiet()).unwrap();
    let shape = settings(1).shape(harmonic.component_count());
    let field = harmonic.field(shape, shape.initial_parameters(5)).unwrap();
    let other = FactoredShape { components: shape.components + 1, ..shape };
    let refused = harmonic.field(other, other.initial_parameters(5)).unwrap_err();
    let needed = shape.parameter_count();
    assert!(matches!(refused, ShapeError::Parameters { expected, .. } if expected == needed));
    let state = TrainingState::from_parameters(field.parameters.clone());
    let mut recorder = Recorder { inputs: INPUTS, outputs: shape.components, state, ..Recorder::default() };
    // A step at which slots are not in the order of their numbers.
    let step = 17;
    let (count, inputs) = (5, numbers(5 * INPUTS, 8));
    let values: Vec<f32> = numbers(count * ONLINE.pool, 9).iter().map(|v| 0.5 + 0.5 * v).collect();
    let mut corrected = SectionEngine::new(&mut recorder, &harmonic, ONLINE, field.clone(), step);
    corrected.step(&inputs, &values, 1e-3).unwrap();
    let loss = corrected.take_mean_loss().unwrap();

    let oldest = ONLINE.newest(step) + 1 - ONLINE.pool as u64;
    let weights = as_f64(&field.parameters);
    let matrix = |rows: usize, columns: usize, at: &dyn Fn(usize, usize) -> f64| {
        nalgebra::DMatrix::from_fn(rows, columns, at)
    };
    let mut functions = vec![0.0; field.basis.len()];
    // `[slot]`: the functions at the orientation of the section that stands there.
    let of_slots: Vec<Vec<f64>> = (0..ONLINE.pool)
        .map(|slot| {
            let number = (0..ONLINE.pool as u64).map(|i| oldest + i).find(|n| n % 40 == slot as u64).unwrap();
            field.basis.values(&ONLINE.orientation(number), &mut functions);
            functions.clone()
        })
        .collect();
    let sum = |slot: usize, column: &dyn Fn(usize) -> f32| -> f64 {
        of_slots[slot].iter().enumerate().map(|(k, b)| b * f64::from(column(k))).sum()
    };
    let h = matrix(ONLINE.pool, shape.components, &|slot, axis| {
        sum(slot, &|k| field.components[k * shape.components + axis])
    });
    let gram = &h * h.transpose();
    let ridge = 0.03 * gram.trace() / ONLINE.pool as f64;
    let inverse =
        (gram + nalgebra::DMatrix::identity(ONLINE.pool, ONLINE.pool) * ridge).try_inverse().unwrap();
    let mut squares = 0.0;
    for (row, input) in rows::<INPUTS>(&inputs).iter().enumerate() {
        let z = reference::forward(&shape, &weights, input);
        let z = nalgebra::DVector::from_vec(z);
        let left = nalgebra::DVector::from_fn(ONLINE.pool, |slot, _| {
            let mean = sum(slot, &|k| field.mean[k]);
            (f64::from(values[row * ONLINE.pool + slot]) - mean) / f64::from(field.scale)
        }) - &h * &z;
        // The engine's own loss is over the field's scale.
        squares += left.norm_squared();
        let expected = z + h.transpose() * &inverse * left;
        let largest = expected.abs().max();
        for (axis, &expected) in expected.iter().enumerate() {
            let found = f64::from(recorder.batches[0].1[row * shape.components + axis]);
            // Sums of some hundred products in f32.
            assert!((found - expected).abs() < 1e-4 * largest, "{row}, {axis}: {found}, not {expected}");
        }
    }
    let expected = squares / (count * ONLINE.pool) as f64;
    assert!((loss - expected).abs() < 1e-4 * expected, "loss {loss}, not {expected}");
}

fn error_of(field: &FactoredField, plan: &SectionPlan) -> f64 {
    let set = OrientationSet::parse("random:40:77").unwrap().orientations;
    let exact = imf_core::section::sections(plan, &set, Control::quiet()).unwrap();
    let mut found = vec![0.0; exact.len() * field.grid.len()];
    field.evaluator().sections(&field.direction_weights(&set), &mut found);
    mean_square(&found, exact.iter().flatten())
}

#[test]
fn sections_alone_serve_as_a_harmonic_field_would() {
    let plan = plan(&scene());
    let settings = DistillSettings { online: Some(ONLINE), ..settings(400) };
    // Degree 2 leaves out a third of the field by itself.
    for (domain, degree, left) in [(Domain::Directions, 5, 0.25), (Domain::Rotations, 2, 0.5)] {
        let fit = FitSettings { degree, ..FIT };
        let harmonic = SectionSource::new(&plan, domain, &fit, Control::quiet()).unwrap();
        let mut state = settings.start(harmonic.component_count());
        let shape = settings.shape(harmonic.component_count());
        let untrained = error_of(&harmonic.field(shape, state.training.parameters.clone()).unwrap(), &plan);
        let quiet = Control::quiet();
        let outcome = distil(&harmonic, &settings, &mut state, quiet, &mut |_| {}).unwrap();
        assert!(matches!(outcome, Outcome::Finished));
        let trained = error_of(&harmonic.field(shape, state.training.parameters).unwrap(), &plan);
        assert!(trained < left * untrained, "{domain:?}: {trained:.2e} of {untrained:.2e}");
    }
}

#[test]
fn a_stop_and_the_number_of_threads_change_no_bit() {
    let plan = plan(&scene());
    let harmonic = SectionSource::new(&plan, Domain::Directions, &FIT, Control::quiet()).unwrap();
    let settings = DistillSettings { online: Some(ONLINE), ..settings(30) };
    let run = |threads: usize, stop: bool| {
        on_threads(threads, || {
            let mut state = settings.start(harmonic.component_count());
            if stop {
                let cancelled = AtomicBool::new(false);
                let control = Control { cancelled: &cancelled, ..Control::quiet() };
                let observe = &mut |_: &Report| cancelled.store(true, Ordering::Relaxed);
                let outcome = distil(&harmonic, &settings, &mut state, control, observe).unwrap();
                assert!(matches!(outcome, Outcome::Stopped(at) if at != Cursor::default()));
            }
            distil(&harmonic, &settings, &mut state, Control::quiet(), &mut |_| {}).unwrap();
            state
        })
    };
    let whole = run(1, false);
    assert_eq!(run(2, false), whole);
    assert_eq!(run(2, true), whole);
}

#[test]
fn a_pool_that_fills_is_given_up_and_training_goes_on_to_the_same_bits() {
    let plan = plan(&scene());
    let harmonic = SectionSource::new(&plan, Domain::Directions, &FIT, Control::quiet()).unwrap();
    let settings = DistillSettings { online: Some(ONLINE), ..settings(40) };
    let trained = |state: &mut FactoredState, control: Control<'_>| {
        distil(&harmonic, &settings, state, control, &mut |_| {}).unwrap()
    };
    let begun = settings.start(harmonic.component_count());
    let mut whole = begun.clone();
    assert_eq!(trained(&mut whole, Control::quiet()), Outcome::Finished);

    // The wish comes before the third of 40 sections: none is learnt from.
    let (reported, cancelled) = (AtomicU64::new(0), AtomicBool::new(false));
    let progress = |steps| {
        assert_eq!(steps, 0, "a step was taken");
        cancelled.store(reported.fetch_add(1, Ordering::Relaxed) == 2, Ordering::Relaxed);
    };
    let mut state = begun.clone();
    let outcome = trained(&mut state, Control { progress: &progress, cancelled: &cancelled });
    assert_eq!((outcome, &state), (Outcome::Stopped(begun.cursor), &begun));
    assert_eq!(trained(&mut state, Control::quiet()), Outcome::Finished);
    assert!(state == whole, "it went on to other bits");
}
