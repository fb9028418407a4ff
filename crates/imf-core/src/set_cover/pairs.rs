//! The last two sets of a cover.

use super::Stop;
use super::bits::{count, has, ones, remove};
use super::groups::Groups;
use super::reduced::ReducedProblem;
use super::search::{ROWS, Search};

/// Indices of sets, or none.
type Sets = Result<Option<Vec<usize>>, Stop>;

impl Search<'_> {
    /// At most `left`, one or two, of the available sets that cover enough of the open rows.
    pub(super) fn pair(
        &mut self,
        problem: &ReducedProblem,
        groups: &Groups,
        open: &[u64],
        available: &[u64],
        left: usize,
    ) -> Sets {
        if problem.slack > 0 {
            self.pair_of_weight(problem, groups, open, available, left)
        } else {
            self.whole_pair(problem, open, available, left)
        }
    }

    /// All open rows must be covered.
    fn whole_pair(&mut self, problem: &ReducedProblem, open: &[u64], available: &[u64], left: usize) -> Sets {
        let mut common = available.to_vec();
        if open.iter().all(|&word| word == 0) {
            return Ok(Some(Vec::new()));
        }
        if left == 1 {
            self.narrow(problem, open, &mut common)?;
            return Ok(ones(&common).next().map(|set| vec![set]));
        }
        let size = |row: usize| {
            count(problem.sets_of.row(row).iter().zip(available).map(|(sets, available)| sets & available))
        };
        self.spend((ROWS * available.len()) as u64)?;
        let rarest = ones(open).take(ROWS).min_by_key(|&row| size(row)).expect("a row is open");
        let mut others = available.to_vec();
        let mut rest = open.to_vec();
        for set in ones(problem.sets_of.row(rarest)).filter(|&set| has(available, set)) {
            remove(&mut others, set);
            without(open, problem.rows_of.row(set), &mut rest);
            if rest.iter().all(|&word| word == 0) {
                return Ok(Some(vec![set]));
            }
            common.copy_from_slice(&others);
            self.narrow(problem, &rest, &mut common)?;
            if let Some(other) = ones(&common).next() {
                return Ok(Some(vec![set, other]));
            }
        }
        Ok(None)
    }

    /// Leaves of `common` the sets that hold all open rows.
    fn narrow(&mut self, problem: &ReducedProblem, open: &[u64], common: &mut [u64]) -> Result<(), Stop> {
        let mut steps = open.len();
        for row in ones(open) {
            steps += common.len();
            if !narrow(common, problem.sets_of.row(row)) {
                break;
            }
        }
        self.spend(steps as u64)
    }

    /// A weight may stay open.
    fn pair_of_weight(
        &mut self,
        problem: &ReducedProblem,
        groups: &Groups,
        open: &[u64],
        available: &[u64],
        left: usize,
    ) -> Sets {
        let needed = ones(open).map(|row| problem.weights[row]).sum::<u64>().saturating_sub(problem.slack);
        if needed == 0 {
            return Ok(Some(Vec::new()));
        }
        let mut gains: Vec<(u64, usize)> =
            ones(available).map(|set| (problem.gain(set, open), set)).collect();
        gains.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        // A row takes as long as some words do.
        let each = 8 * open.len() as u64;
        self.spend(gains.len() as u64 * each)?;
        if let Some(&(_, set)) = gains.first().filter(|(gain, _)| *gain >= needed) {
            return Ok(Some(vec![set]));
        }
        if left == 1 {
            return Ok(None);
        }
        let group = self.group(problem, open, available, 1)?;
        let mut others = available.to_vec();
        let (mut seconds, mut rest) = (others.clone(), open.to_vec());
        for &(gain, set) in gains.iter().filter(|(_, set)| has(&group, *set)) {
            remove(&mut others, set);
            without(open, problem.rows_of.row(set), &mut rest);
            seconds.copy_from_slice(&others);
            let mut steps = groups.narrow(problem, &rest, &mut seconds);
            let fit = gains.iter().take_while(|(other, _)| gain + other >= needed);
            let second = fit.filter(|(_, other)| has(&seconds, *other)).find(|(_, other)| {
                steps += each;
                gain + problem.gain(*other, &rest) >= needed
            });
            self.spend(steps)?;
            if let Some((_, second)) = second {
                return Ok(Some(vec![set, *second]));
            }
        }
        Ok(None)
    }
}

/// The open rows that a set does not cover.
fn without(open: &[u64], held: &[u64], rest: &mut [u64]) {
    rest.iter_mut().zip(open).zip(held).for_each(|((rest, open), held)| *rest = open & !held);
}

/// Leaves of `common` what is in `own` too; false where that is nothing.
pub(super) fn narrow(common: &mut [u64], own: &[u64]) -> bool {
    let mut any = 0;
    for (common, own) in common.iter_mut().zip(own) {
        *common &= own;
        any |= *common;
    }
    any != 0
}
