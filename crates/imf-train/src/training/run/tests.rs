use super::*;
use crate::engine::CpuTrainer;
use crate::fixtures::{self, Recorder, bits, go_on, samples};
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{TrainingLength, TrainingState};
use imf_fields::siren::SirenShape;

const SHAPE: SirenShape = SirenShape { width: 24, hidden: 3, skip_after: Some(2), omega: 10.0 };

/// Two epochs.
fn plan() -> TrainingPlan {
    fixtures::plan(2)
}

fn engine(plan: &TrainingPlan, state: TrainingState) -> CpuTrainer {
    fixtures::engine(SHAPE, plan, state)
}

/// The reports of a training, and how it ends.
fn reported(
    plan: &TrainingPlan,
    engine: &mut dyn TrainingEngine,
) -> (Vec<Report>, Result<Outcome, TrainError>) {
    let mut reports = Vec::new();
    let ended = train(plan, &samples(), engine, Cursor::default(), &mut |report, _| {
        reports.push(*report);
        ControlFlow::Continue(())
    });
    (reports, ended)
}

#[test]
fn a_run_in_pieces_has_the_bits_of_one_in_one_go() {
    let samples = samples();
    for plan in [
        plan(),
        TrainingPlan {
            length: TrainingLength::Steps(40),
            schedule: Schedule::Cosine { initial: 1e-3, last: 1e-5, warmup: 5 },
            ..plan()
        },
    ] {
        let mut whole = engine(&plan, TrainingState::new(&SHAPE, 1));
        let outcome = train(&plan, &samples, &mut whole, Cursor::default(), &mut go_on).unwrap();
        assert_eq!(outcome, Outcome::Finished);
        let whole = whole.state().unwrap();
        assert_eq!(whole.step, plan.total_steps(samples.len()));

        // Every report stops the run; the engine is made anew from its state, and reports come at other steps.
        let (mut state, mut cursor, mut pieces) = (TrainingState::new(&SHAPE, 1), Cursor::default(), 0);
        loop {
            let plan = TrainingPlan { report_every: 3 + pieces % 4, ..plan };
            let mut engine = engine(&plan, state);
            let outcome =
                train(&plan, &samples, &mut engine, cursor, &mut |_, _| ControlFlow::Break(())).unwrap();
            state = engine.state().unwrap();
            pieces += 1;
            match outcome {
                Outcome::Stopped(next) => cursor = next,
                Outcome::Finished => break,
            }
        }
        assert!(pieces > 5, "{pieces} pieces");
        assert!(state == whole, "the pieces ended elsewhere");
    }
}

#[test]
fn reports_come_when_guaranteed_and_count_right() {
    let (samples, plan) = (samples(), plan());
    let mut engine = engine(&plan, TrainingState::new(&SHAPE, 1));
    let (reports, ended) = reported(&plan, &mut engine);
    assert_eq!(ended.unwrap(), Outcome::Finished);
    let per_epoch = plan.steps_per_epoch(samples.len());
    assert_eq!(per_epoch, samples.len().div_ceil(150) as u64);
    let expected: Vec<u64> = (1..=2 * per_epoch).filter(|s| s % 4 == 0 || s % per_epoch == 0).collect();
    assert_eq!(reports.iter().map(|r| r.step).collect::<Vec<_>>(), expected);
    for report in &reports {
        assert_eq!(report.epoch_end, report.step % per_epoch == 0);
        assert_eq!(report.cursor.epoch * per_epoch + report.cursor.step, report.step);
        assert_eq!(report.total_steps, 2 * per_epoch);
        assert!(report.mean_loss > 0.0 && report.samples_per_second > 0.0);
        assert!(report.remaining(&plan).is_some());
    }
    assert_eq!(reports[0].learning_rate, 5e-4);
    assert!((reports.last().unwrap().learning_rate / (5e-4 * 0.93) - 1.0).abs() < 1e-6);
}

#[test]
fn an_epoch_shows_every_sample_once() {
    let samples = samples();
    let plan = TrainingPlan { length: TrainingLength::Epochs(1), ..plan() };
    let mut recorder = Recorder::default();
    train(&plan, &samples, &mut recorder, Cursor::default(), &mut go_on).unwrap();
    let mut expected = bits(&samples);
    let batches = recorder.rows();
    let (last, others) = batches.split_last().unwrap();
    assert!(others.iter().all(|batch| batch.len() == 150) && last.len() == samples.len() % 150);
    let mut found = batches.concat();
    assert_ne!(found, expected, "the order is shuffled");
    found.sort_unstable();
    expected.sort_unstable();
    assert_eq!(found, expected);
}

#[test]
fn training_lowers_the_loss() {
    let plan = TrainingPlan {
        length: TrainingLength::Steps(600),
        schedule: Schedule::Cosine { initial: 2e-3, last: 0.0, warmup: 0 },
        ..plan()
    };
    let mut engine = engine(&plan, TrainingState::new(&SHAPE, 1));
    let (reports, ended) = reported(&plan, &mut engine);
    assert_eq!(ended.unwrap(), Outcome::Finished);
    let (first, last) = (reports[0].mean_loss, reports[reports.len() - 1].mean_loss);
    assert!(last < first / 20.0, "from {first} to {last}");
}

#[test]
fn divergence_and_what_does_not_fit_are_errors_that_say_so() {
    let (samples, plan) = (samples(), plan());
    let mut state = TrainingState::new(&SHAPE, 1);
    state.parameters[7] = f32::NAN;
    let mut broken = engine(&plan, state);
    let error = train(&plan, &samples, &mut broken, Cursor::default(), &mut go_on).unwrap_err();
    assert!(matches!(error, TrainError::NotFinite { after: 0, step: 4, .. }), "{error}");
    assert!(error.to_string().contains("lower learning rate"), "{error}");

    let mut engine = engine(&plan, TrainingState::new(&SHAPE, 1));
    let beyond = Cursor { epoch: 0, step: 1000 };
    let error = train(&plan, &samples, &mut engine, beyond, &mut go_on).unwrap_err();
    assert!(matches!(error, TrainError::Cursor { step: 1000, .. }), "{error}");
    let nothing = Samples::new(samples.grid);
    let error = train(&plan, &nothing, &mut engine, Cursor::default(), &mut go_on).unwrap_err();
    assert!(matches!(error, TrainError::NoSamples), "{error}");
    let none = TrainingPlan { batch: 0, ..plan };
    let error = train(&none, &samples, &mut engine, Cursor::default(), &mut go_on).unwrap_err();
    assert!(error.to_string().contains("`batch`"), "{error}");
    let done = Cursor { epoch: 2, step: 0 };
    assert_eq!(train(&plan, &samples, &mut engine, done, &mut go_on).unwrap(), Outcome::Finished);
}

#[test]
fn a_loss_that_rises_for_good_stops_the_run() {
    // Learns for a while, then answers a constant.
    let collapse = || Recorder { loss: |steps| if steps <= 600 { 0.01 } else { 0.2 }, ..Recorder::default() };
    let samples = samples();
    let plan = TrainingPlan { length: TrainingLength::Steps(4000), ..plan() };
    let suspicion = |report: &Report| (report.step, report.watch.is_suspicious());
    let (reports, ended) = reported(&plan, &mut collapse());
    let (suspicious, error): (Vec<_>, _) = (reports.iter().map(suspicion).collect(), ended.unwrap_err());
    let TrainError::Diverged { best_step, step, .. } = error else { panic!("{error}") };

    // Stopped and continued at every report, it ends as one that was not.
    let (mut start, mut engine) = (Start::default(), collapse());
    let mut again = Vec::new();
    let ended = loop {
        let from = start;
        let mut stop = |report: &Report, _: &mut dyn TrainingEngine| {
            again.push(suspicion(report));
            start = Start { cursor: report.cursor, watch: report.watch };
            ControlFlow::Break(())
        };
        if let Err(error) = train(&plan, &samples, &mut engine, from, &mut stop) {
            break error;
        }
    };
    assert_eq!(ended.to_string(), error.to_string());
    assert_eq!(again, suspicious);
    assert!(error.is_divergence() && best_step <= 600, "{error}");
    assert!((1600..1700).contains(&step), "{error}");
    // From the first losses on, before the mean of about 200 steps has risen to four times the best.
    assert!(suspicious.iter().all(|&(step, suspicious)| suspicious == (step > 600)), "{suspicious:?}");
}

#[test]
fn plans_are_read_with_the_papers_values_for_what_is_left_out() {
    let plan: TrainingPlan = serde_json::from_str(r#"{"batch": 512, "length": {"steps": 10}}"#).unwrap();
    let expected = TrainingPlan { batch: 512, length: TrainingLength::Steps(10), ..TrainingPlan::default() };
    assert_eq!(plan, expected);
    let text = serde_json::to_string(&plan).unwrap();
    assert_eq!(serde_json::from_str::<TrainingPlan>(&text).unwrap(), plan);
    assert!(serde_json::from_str::<TrainingPlan>(r#"{"bach": 512}"#).is_err());
}
