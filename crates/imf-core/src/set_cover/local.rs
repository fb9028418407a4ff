//! Covers that need not be the smallest: greedy, then sets exchanged for others.

use super::bits::{common, count, first, ones};
use super::reduced::ReducedProblem;
use crate::control::Control;

/// Exchanges that are tried for one set less: 500 find one more of 7 among 1,000 caps of a ball, 3,000 none fewer.
const EXCHANGES: usize = 1_000;
/// Exchanges for which a set that went stays away: at least `AWAY`, plus up to `AWAY_MORE`; and for which one that
/// came stays.
const AWAY: usize = 2;
const AWAY_MORE: usize = 8;
const STAYS: usize = 2;

/// Greedy cover: repeatedly adds the set with the largest gain, then drops sets that are no longer needed.
pub(super) fn greedy(problem: &ReducedProblem) -> Vec<usize> {
    let mut open = first(problem.rows());
    let mut chosen: Vec<usize> = Vec::new();
    while weight(problem, &open) > problem.slack {
        // Where all rows must be covered, each counts as one.
        let gain = |set: usize| match problem.slack {
            0 => count(open.iter().zip(problem.rows_of.row(set)).map(|(open, held)| open & held)) as u64,
            _ => problem.gain(set, &open),
        };
        let best = (0..problem.sets()).max_by_key(|&set| (gain(set), usize::MAX - set));
        let best = best.expect("every open row has a set");
        chosen.push(best);
        open.iter_mut().zip(problem.rows_of.row(best)).for_each(|(open, held)| *open &= !held);
    }
    for set in chosen.clone() {
        let others: Vec<usize> = chosen.iter().copied().filter(|&other| other != set).collect();
        if weight(problem, &left_open(problem, &others)) <= problem.slack {
            chosen = others;
        }
    }
    chosen
}

/// Smaller covers, as names of their sets, by exchanging sets while rows that stay uncovered become expensive (after
/// Cai, Su and Sattar's NuMVC); `None` where the control asks to stop.
pub(super) fn exchanged(
    problem: &ReducedProblem,
    mut best: Vec<usize>,
    steps: &mut u64,
    control: Control<'_>,
) -> Option<Vec<u32>> {
    let mut numbers = Numbers(1);
    // Where some rows may stay uncovered, it may be always the same ones: then none becomes expensive, and no row
    // attracts its sets.
    let growths: &[f64] = if problem.slack > 0 { &[0.1, 0.0] } else { &[1.0] };
    while best.len() > 1 && *steps > 0 {
        let mut tries = growths.iter();
        let Some(smaller) =
            tries.find_map(|&growth| one_less(problem, &best, growth, &mut numbers, steps, control))
        else {
            break;
        };
        best = smaller;
    }
    (!control.is_cancelled()).then(|| best.into_iter().map(|set| problem.names[set]).collect())
}

fn one_less(
    problem: &ReducedProblem,
    cover: &[usize],
    growth: f64,
    numbers: &mut Numbers,
    steps: &mut u64,
    control: Control<'_>,
) -> Option<Vec<usize>> {
    let base: Vec<f64> = if problem.slack > 0 {
        problem.weights.iter().map(|&weight| weight as f64).collect()
    } else {
        vec![1.0; problem.rows()]
    };
    let mut prices = base.clone();
    // By set: the exchange until which it stays away, and the one in which it came.
    let (mut away, mut since) = (vec![0usize; problem.sets()], vec![0usize; problem.sets()]);
    let mut chosen = cover[..cover.len() - 1].to_vec();
    for round in 1..=EXCHANGES {
        let open = left_open(problem, &chosen);
        if weight(problem, &open) <= problem.slack {
            return Some(chosen);
        }
        if control.is_cancelled() || *steps == 0 {
            return None;
        }
        let all = problem.all_sets();
        let candidates = if growth > 0.0 {
            let rows: Vec<usize> = ones(&open).collect();
            problem.sets_of.row(rows[numbers.below(rows.len())])
        } else {
            &all
        };
        // Of all exchanges that bring in one of them, the one after which the open rows cost least.
        let comes = |set: &usize| away[*set] <= round && !chosen.contains(set);
        let coming: Vec<usize> = ones(candidates).filter(comes).collect();
        let mut exchange: Option<(f64, usize, usize)> = None;
        let stays = |set: usize| since[set] > 0 && since[set] + STAYS > round && chosen.len() > STAYS;
        for at in (0..chosen.len()).filter(|&at| !stays(chosen[at])) {
            let others: Vec<usize> =
                (0..chosen.len()).filter(|&other| other != at).map(|at| chosen[at]).collect();
            let open = left_open(problem, &others);
            let all: f64 = ones(&open).map(|row| prices[row]).sum();
            for &set in &coming {
                let new: f64 = common(&open, problem.rows_of.row(set)).map(|row| prices[row]).sum();
                let left = all - new;
                let better = |&(best, _, other): &(f64, usize, usize)| {
                    left < best || (left == best && since[set] < since[other])
                };
                if exchange.as_ref().is_none_or(better) {
                    exchange = Some((left, at, set));
                }
            }
            // A row takes as long as some words do.
            *steps = steps.saturating_sub(4 * (coming.len() * open.len()) as u64);
        }
        let Some((_, at, set)) = exchange else { continue };
        let gone = std::mem::replace(&mut chosen[at], set);
        away[gone] = round + AWAY + numbers.below(AWAY_MORE);
        since[set] = round;
        ones(&left_open(problem, &chosen)).for_each(|row| prices[row] += growth * base[row]);
    }
    None
}

/// The rows that some sets leave.
pub(super) fn left_open(problem: &ReducedProblem, chosen: &[usize]) -> Vec<u64> {
    let mut open = first(problem.rows());
    for &set in chosen {
        open.iter_mut().zip(problem.rows_of.row(set)).for_each(|(open, held)| *open &= !held);
    }
    open
}

fn weight(problem: &ReducedProblem, rows: &[u64]) -> u64 {
    ones(rows).map(|row| problem.weights[row]).sum()
}

/// Numbers of a small linear congruential generator, the same everywhere.
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    pub(crate) fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % n
    }
}
