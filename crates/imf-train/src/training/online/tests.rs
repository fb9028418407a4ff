use super::*;
use crate::engine::CpuTrainer;
use crate::fixtures::{Recorder, go_on};
use crate::training::run::Report;
use glam::DVec3;
use imf_core::occupancy::Occupancy;
use imf_core::section::At;
use imf_core::tool::Tool;
use imf_fields::recipe::Length;
use imf_fields::recipe::TrainingState;
use imf_fields::siren::SirenShape;
use std::ops::ControlFlow;
use std::sync::atomic::AtomicU64;

const SHAPE: SirenShape = SirenShape { width: 16, hidden: 3, skip_after: Some(2), omega: 10.0 };

fn sections(settings: OnlineSettings) -> OnlineSections {
    let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [9, 10, 11] };
    let solid = (0..grid.len()).map(|i| u8::from(i % 7 < 3)).collect();
    let plan = SectionPlan::new(&Occupancy { grid, solid }, Tool::paper(), At::SharpPoints).unwrap();
    OnlineSections { plan, frame: grid, sampling: Sampling { density: 0.1, ..Sampling::default() }, settings }
}

fn plan() -> TrainingPlan {
    TrainingPlan { length: Length::Steps(60), batch: 64, report_every: 5, ..TrainingPlan::default() }
}

fn engine(state: TrainingState) -> CpuTrainer {
    CpuTrainer::new(SHAPE, plan().adam, plan().loss, plan().batch, state).unwrap()
}

/// Nobody wishes to stop.
static NEVER: AtomicBool = AtomicBool::new(false);

const SETTINGS: OnlineSettings = OnlineSettings { pool: 5, every: 3, seed: 4, lead: 2 };

#[test]
fn stopped_anywhere_it_goes_on_to_the_same_bits_and_lead_changes_nothing() {
    let sections_ = sections(SETTINGS);
    let mut whole = engine(TrainingState::new(&SHAPE, 1));
    let (outcome, waits) =
        train_online(&plan(), &sections_, &mut whole, Cursor::default(), &NEVER, &mut go_on).unwrap();
    assert_eq!(outcome, Outcome::Finished);
    // Steps 0 to 59 use sections 0 to 4 + 59 / 3.
    assert_eq!(waits.sections, 5 + 19);
    let whole = whole.state().unwrap();
    for (stop, lead) in [(5, 1), (25, 7), (50, 2)] {
        let sections_ = sections(OnlineSettings { lead, ..SETTINGS });
        let mut first = engine(TrainingState::new(&SHAPE, 1));
        let mut until = |report: &Report, _: &mut dyn TrainingEngine| {
            if report.step >= stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let (outcome, _) =
            train_online(&plan(), &sections_, &mut first, Cursor::default(), &NEVER, &mut until).unwrap();
        let Outcome::Stopped(cursor) = outcome else { panic!("it did not stop") };
        let mut second = engine(first.state().unwrap());
        train_online(&plan(), &sections_, &mut second, cursor, &NEVER, &mut go_on).unwrap();
        assert!(second.state().unwrap() == whole, "stopped at {stop}");
    }
    let mut other = engine(TrainingState::new(&SHAPE, 1));
    let elsewhere = sections(OnlineSettings { seed: 5, ..SETTINGS });
    train_online(&plan(), &elsewhere, &mut other, Cursor::default(), &NEVER, &mut go_on).unwrap();
    assert!(other.state().unwrap() != whole, "the seed decides nothing");
}

#[test]
fn every_sample_is_an_exact_value_of_a_section_in_the_pool_of_its_step() {
    let sections = sections(SETTINGS);
    let mut recorder = Recorder::default();
    let mut slow = |_: &Report, _: &mut dyn TrainingEngine| {
        std::thread::sleep(Duration::from_millis(20));
        ControlFlow::Continue(())
    };
    let (_, waits) =
        train_online(&plan(), &sections, &mut recorder, Cursor::default(), &NEVER, &mut slow).unwrap();
    assert!(waits.producer > 0.0, "a slow trainer keeps the producer waiting: {waits:?}");
    let grid = *sections.plan.grid();
    let mut scratch = SectionScratch::default();
    let mut cmf = vec![0.0; grid.len()];
    for (step, (inputs, targets)) in recorder.batches.iter().enumerate().step_by(7) {
        let pool = SETTINGS.pool_at(step as u64).orientations;
        let mut matched = 0;
        for orientation in &pool {
            sections.plan.cmf(orientation, &mut scratch, &mut cmf).unwrap();
            let [theta, phi] = orientation.angles();
            for (input, &target) in inputs.chunks_exact(5).zip(targets) {
                let wanted = features([0.0; 3], theta, phi);
                if input[3..] != wanted[3..] {
                    continue;
                }
                let unit =
                    DVec3::new(f64::from(input[0]), f64::from(input[1]), f64::from(input[2])) * 0.5 + 0.5;
                let voxel = (unit * DVec3::new(9.0, 10.0, 11.0)).floor();
                let index = grid.index([voxel.x as usize, voxel.y as usize, voxel.z as usize]);
                assert_eq!(target, cmf[index], "step {step}");
                matched += 1;
            }
        }
        assert_eq!(matched, targets.len(), "step {step}: a sample of no section in the pool");
    }
}

#[test]
fn settings_that_stand_still_are_refused() {
    for settings in [
        OnlineSettings { pool: 0, ..SETTINGS },
        OnlineSettings { every: 0, ..SETTINGS },
        OnlineSettings { lead: 0, ..SETTINGS },
    ] {
        assert!(settings.check().is_err(), "{settings:?}");
    }
    assert!(serde_json::from_str::<OnlineSettings>(r#"{"pol": 3}"#).is_err());
}

#[test]
fn a_pool_that_fills_is_given_up_when_that_is_wished() {
    let cancelled = AtomicBool::new(false);
    let made = AtomicU64::new(0);
    // The wish comes while the second of five sections is made.
    let make = |number| {
        made.store(number + 1, Ordering::Relaxed);
        cancelled.fetch_or(number == 1, Ordering::Relaxed);
        Ok(number)
    };
    let stop = || cancelled.load(Ordering::Relaxed);
    let settings = OnlineSettings { lead: 1, ..SETTINGS };
    let (taken, _) = with_arrivals(settings, [0, 60], make, &stop, |arrivals| arrivals.at(0).map(<[_]>::len));
    assert!(matches!(taken, Err(SectionError::Cancelled)), "{taken:?}");
    // The two that were taken, the one that may be ahead, and the one after it, which found no taker.
    assert!(made.load(Ordering::Relaxed) <= 4, "{made:?} of {} were made", settings.pool);

    // Afterwards the observer is who stops.
    let wished = AtomicBool::new(false);
    let mut engine = engine(TrainingState::new(&SHAPE, 1));
    let mut observer = |_: &Report, _: &mut dyn TrainingEngine| {
        wished.store(true, Ordering::Relaxed);
        ControlFlow::Continue(())
    };
    let trained =
        train_online(&plan(), &sections(SETTINGS), &mut engine, Cursor::default(), &wished, &mut observer);
    assert_eq!(trained.unwrap().0, Outcome::Finished);
    wished.store(true, Ordering::Relaxed);
    let trained =
        train_online(&plan(), &sections(SETTINGS), &mut engine, Cursor::default(), &wished, &mut go_on);
    assert!(matches!(trained, Err(TrainError::Section(SectionError::Cancelled))), "{trained:?}");
}
