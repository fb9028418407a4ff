//! Ranks as threads against one process.

use std::ops::ControlFlow;
use std::sync::{Arc, Barrier, Mutex};

use crate::engine::ranks::*;
use crate::fixtures::{as_f64, assert_gradient, engine, samples};
use crate::training::run::{Outcome, train};
use imf_fields::recipe::{Cursor, TrainingLength, TrainingPlan};
use imf_fields::siren::SirenShape;

const SHAPE: SirenShape = SirenShape { width: 37, hidden: 3, skip_after: Some(2), omega: 10.0 };
/// Of the largest gradient: f32 sums over a few hundred samples, grouped differently, differ by some 1e-6 of it.
const GRADIENT_TOLERANCE: f64 = 1e-5;
/// Of the loss after some dozen steps. Adam divides a gradient by its own size, so a weight whose gradient is near rounding
/// error may move either way by a whole step; the loss hardly feels it.
const LOSS_TOLERANCE: f64 = 1e-3;

/// Where threads leave what they have for each other.
struct Board {
    barrier: Barrier,
    floats: Mutex<Vec<Vec<f32>>>,
    numbers: Mutex<Vec<u64>>,
}

struct Thread {
    rank: usize,
    ranks: usize,
    board: Arc<Board>,
}

impl Thread {
    /// Leaves values, waits until all have, reads, and waits until all have read.
    fn meet(&self, values: &[f32], read: impl FnOnce(&[Vec<f32>])) {
        self.board.floats.lock().unwrap()[self.rank] = values.to_vec();
        self.board.barrier.wait();
        read(&self.board.floats.lock().unwrap());
        self.board.barrier.wait();
    }
}

impl Collectives for Thread {
    fn rank(&self) -> usize {
        self.rank
    }
    fn ranks(&self) -> usize {
        self.ranks
    }
    fn all_to_all(&mut self, values: &[f32], cuts: &[usize], parts: &mut [f32]) -> Result<(), EngineError> {
        let own = cuts[self.rank]..cuts[self.rank + 1];
        self.meet(values, |all| {
            let dealt: Vec<f32> = all.iter().flat_map(|values| &values[own.clone()]).copied().collect();
            parts.copy_from_slice(&dealt);
        });
        Ok(())
    }
    fn all_gather(&mut self, slice: &[f32], cuts: &[usize], values: &mut [f32]) -> Result<(), EngineError> {
        assert_eq!(slice.len(), cuts[self.rank + 1] - cuts[self.rank]);
        self.meet(slice, |all| values.copy_from_slice(&all.concat()));
        Ok(())
    }
    fn all_gather_number(&mut self, number: u64) -> Result<Vec<u64>, EngineError> {
        self.board.numbers.lock().unwrap()[self.rank] = number;
        self.board.barrier.wait();
        let all = self.board.numbers.lock().unwrap().clone();
        self.board.barrier.wait();
        Ok(all)
    }
}

/// Runs `work` on so many ranks; what each returns.
fn on_ranks<T: Send>(ranks: usize, work: impl Fn(Thread) -> T + Sync) -> Vec<T> {
    let board = Arc::new(Board {
        barrier: Barrier::new(ranks),
        floats: Mutex::new(vec![Vec::new(); ranks]),
        numbers: Mutex::new(vec![0; ranks]),
    });
    std::thread::scope(|scope| {
        let start = |rank| {
            let (board, work) = (Arc::clone(&board), &work);
            scope.spawn(move || work(Thread { rank, ranks, board }))
        };
        let threads: Vec<_> = (0..ranks).map(start).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    })
}

fn plan(batch: usize) -> TrainingPlan {
    TrainingPlan {
        length: TrainingLength::Steps(40),
        batch,
        report_every: 5,
        seed: 3,
        ..TrainingPlan::default()
    }
}

fn cpu(plan: &TrainingPlan, batch: usize, state: TrainingState) -> CpuTrainer {
    engine(SHAPE, &TrainingPlan { batch, ..*plan }, state)
}

/// Trains to the end or to the first report; losses of the reports, the state, and where it stands.
fn trained(
    plan: &TrainingPlan,
    engine: &mut dyn TrainingEngine,
    start: Cursor,
    stop: bool,
) -> (Vec<f64>, TrainingState, Outcome) {
    let mut losses = Vec::new();
    let outcome = train(plan, &samples(), engine, start, &mut |report, _| {
        losses.push(report.mean_loss);
        if stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    (losses, engine.state().unwrap(), outcome.unwrap())
}

fn trained_by_ranks(
    plan: &TrainingPlan,
    ranks: usize,
    state: &TrainingState,
    start: Cursor,
    stop: bool,
) -> (Vec<f64>, TrainingState, Outcome) {
    let most = most_rows(plan.batch, ranks);
    let mut all = on_ranks(ranks, |thread| {
        let mut engine = RankTrainer::new(cpu(plan, most, state.clone()), thread);
        trained(plan, &mut engine, start, stop)
    });
    let first = all.swap_remove(0);
    for other in &all {
        assert!(*other == first, "ranks differ");
    }
    first
}

#[test]
fn shares_tile_the_batch() {
    for (length, of) in [(0, 3), (1, 2), (7, 3), (1024, 5), (3, 8)] {
        let shares: Vec<_> = (0..of).map(|index| part_of(length, index, of)).collect();
        assert!(shares.iter().cloned().flatten().eq(0..length), "{shares:?}");
        let most = most_rows(length, of);
        assert!(shares.iter().all(|share| share.len() <= most), "{shares:?}");
    }
}

#[test]
fn the_sum_of_the_ranks_gradients_is_that_of_one_process() {
    let samples = samples();
    for (batch, ranks) in [(700, 2), (700, 3), (130, 5), (3, 4)] {
        let plan = plan(batch);
        let rows: Vec<_> = (0..batch).map(|row| samples.sample(row * 7 % samples.len())).collect();
        let inputs: Vec<f32> = rows.iter().flat_map(|row| row.0).collect();
        let targets: Vec<f32> = rows.iter().map(|row| row.1).collect();
        let mut one = cpu(&plan, batch, TrainingState::new(&SHAPE, 1));
        let gradient = as_f64(one.gradient(&inputs, &targets, batch).unwrap().1);
        one.step(&inputs, &targets, 1e-3).unwrap();
        let loss = one.take_mean_loss().unwrap();
        let all = on_ranks(ranks, |thread| {
            let most = most_rows(batch, ranks);
            let mut engine = RankTrainer::new(cpu(&plan, most, TrainingState::new(&SHAPE, 1)), thread);
            let rows = engine.rows_of_batch(batch);
            engine.cpu.gradient.fill(f32::NAN);
            engine.step(&inputs[rows.start * 5..rows.end * 5], &targets[rows], 1e-3).unwrap();
            (engine.cpu.gradient.clone(), engine.take_mean_loss().unwrap(), engine.state().unwrap())
        });
        assert!(all.iter().all(|other| *other == all[0]), "ranks differ");
        assert_gradient(&all[0].0, &gradient, GRADIENT_TOLERANCE, &format!("{ranks} ranks"));
        assert!((all[0].1 / loss - 1.0).abs() < 1e-6, "{} and {loss}", all[0].1);
    }
}

#[test]
fn ranks_train_as_one_process_does_and_one_rank_to_its_very_bits() {
    // The last batch of an epoch has 1980 mod 150 = 30 samples.
    let plan = plan(150);
    let start = TrainingState::new(&SHAPE, 1);
    let one = trained(&plan, &mut cpu(&plan, plan.batch, start.clone()), Cursor::default(), false);
    assert!(trained_by_ranks(&plan, 1, &start, Cursor::default(), false) == one, "one rank");
    for ranks in [2, 3] {
        let found = trained_by_ranks(&plan, ranks, &start, Cursor::default(), false);
        assert_eq!((found.2, found.1.step), (Outcome::Finished, one.1.step));
        for (found, expected) in found.0.iter().zip(&one.0) {
            let error = (found / expected - 1.0).abs();
            assert!(error < LOSS_TOLERANCE, "{ranks} ranks: {found}, not {expected}");
        }
        assert!(found == trained_by_ranks(&plan, ranks, &start, Cursor::default(), false), "again");
    }
}

#[test]
fn a_training_goes_on_with_another_number_of_ranks() {
    let plan = plan(150);
    let start = TrainingState::new(&SHAPE, 1);
    let one = trained(&plan, &mut cpu(&plan, plan.batch, start.clone()), Cursor::default(), false);
    let (mut state, mut cursor, mut losses) = (start, Cursor::default(), Vec::new());
    for ranks in [2, 1, 3, 2, 5, 1, 2, 2, 2, 2, 2, 2] {
        let (found, next, outcome) = trained_by_ranks(&plan, ranks, &state, cursor, true);
        losses.extend(found);
        state = next;
        match outcome {
            Outcome::Stopped(next) => cursor = next,
            Outcome::Finished => break,
        }
    }
    assert_eq!((losses.len(), state.step), (one.0.len(), one.1.step));
    for (found, expected) in losses.iter().zip(&one.0) {
        assert!((found / expected - 1.0).abs() < LOSS_TOLERANCE, "{found}, not {expected}");
    }
}

#[test]
fn ranks_that_drift_apart_and_rows_of_others_are_noticed() {
    let plan = plan(64);
    let errors = on_ranks(2, |thread| {
        let mut state = TrainingState::new(&SHAPE, 1);
        state.parameters[5] += if thread.rank == 1 { 1e-3 } else { 0.0 };
        RankTrainer::new(cpu(&plan, 32, state), thread).take_mean_loss().unwrap_err().to_string()
    });
    assert!(errors.iter().all(|error| error.contains("ranks 0 and 1")), "{errors:?}");
    let refused = on_ranks(2, |thread| {
        let mut engine = RankTrainer::new(cpu(&plan, 64, TrainingState::new(&SHAPE, 1)), thread);
        engine.rows_of_batch(64);
        engine.step(&[0.0; 64 * 5], &[0.0; 64], 1e-3).unwrap_err().to_string()
    });
    assert!(refused.iter().all(|error| error.contains("share are 32")), "{refused:?}");
}
