//! Groups of rows that weigh more than may stay uncovered: every cover has a set of each.

use super::bits::{Bits, common, count, has};
use super::pairs::narrow;
use super::reduced::ReducedProblem;

/// Weight of a group in slacks: enough is left of it where others hold some of its rows.
const WEIGHT: f64 = 2.5;

/// Groups that share no row.
pub(super) struct Groups {
    /// By group its rows, and the sets that hold any of them.
    rows: Vec<Vec<u64>>,
    sets: Bits,
    /// Steps that it took to make.
    pub(super) steps: u64,
}

impl Groups {
    /// Of rows that are held by nearly the same sets; none where all rows must be covered.
    pub(super) fn new(problem: &ReducedProblem) -> Self {
        let mut made = Self { rows: Vec::new(), sets: Bits::new(0, problem.sets()), steps: 0 };
        let enough = WEIGHT * problem.slack as f64;
        let mut left: Vec<usize> = if problem.slack > 0 { (0..problem.rows()).collect() } else { Vec::new() };
        while !left.is_empty() {
            // The rarest row that is left, and those that add the fewest sets to it.
            let first = problem.sets_of.row(left[0]);
            let new = |row: usize| {
                count(problem.sets_of.row(row).iter().zip(first).map(|(set, first)| set & !first))
            };
            made.steps += (left.len() * first.len()) as u64;
            let mut near: Vec<(usize, usize)> = left.iter().map(|&row| (new(row), row)).collect();
            near.sort_unstable();
            let (mut rows, mut sets) = (vec![0u64; problem.rows_of.words], vec![0u64; first.len()]);
            let mut weight = 0;
            for (_, row) in near {
                rows[row / 64] |= 1 << (row % 64);
                sets.iter_mut().zip(problem.sets_of.row(row)).for_each(|(sets, own)| *sets |= own);
                weight += problem.weights[row];
                if weight as f64 > enough {
                    break;
                }
            }
            left.retain(|&row| !has(&rows, row));
            if weight > problem.slack {
                made.sets.push(sets.into_iter());
                made.rows.push(rows);
            }
        }
        made
    }

    /// Leaves of some sets those that may cover the open rows alone; returns steps that it took.
    pub(super) fn narrow(&self, problem: &ReducedProblem, open: &[u64], sets: &mut [u64]) -> u64 {
        let mut steps = 0;
        for (group, rows) in self.rows.iter().enumerate() {
            let mut weight = 0;
            let heavy = common(rows, open).any(|row| {
                weight += problem.weights[row];
                weight > problem.slack
            });
            // A row takes as long as some words do.
            steps += 4 * rows.len() as u64;
            if heavy && !narrow(sets, self.sets.row(group)) {
                break;
            }
        }
        steps
    }
}
