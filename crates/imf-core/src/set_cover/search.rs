//! The search for a cover of a number of sets, or for the proof that there is none.

use super::Stop;
use super::bits::{count, first, has, ones, remove};
use super::bound::{Verdict, by_prices};
use super::groups::Groups;
use super::local::left_open;
use super::reduced::ReducedProblem;
use crate::control::Control;

/// Steps between two polls of the control.
const CHECK_INTERVAL: u64 = 1 << 22;
/// Rows from which groups are begun.
const STARTS: usize = 8;
/// Rows of which the one with the fewest sets left is chosen.
pub(super) const ROWS: usize = 48;

/// A cover, none, or no result.
pub(super) type SearchResult = Result<Option<Vec<u32>>, Stop>;

/// Searches for covers within a number of steps (operations on words of 64 bits).
pub(super) struct Search<'a> {
    control: Control<'a>,
    /// Steps left, and when the control is polled again.
    pub(super) steps: u64,
    next_look: u64,
}

impl<'a> Search<'a> {
    pub(super) fn new(steps: u64, control: Control<'a>) -> Self {
        Self { control, steps, next_look: steps }
    }

    pub(super) fn spend(&mut self, steps: u64) -> Result<(), Stop> {
        self.steps = self.steps.saturating_sub(steps);
        if self.steps <= self.next_look {
            self.next_look = self.steps.saturating_sub(CHECK_INTERVAL);
            if self.control.is_cancelled() {
                return Err(Stop::Cancelled);
            }
        }
        if self.steps == 0 { Err(Stop::Steps) } else { Ok(()) }
    }

    /// A cover by at most `left` sets, or `None` where there is none.
    pub(super) fn cover(&mut self, mut problem: ReducedProblem, left: usize) -> SearchResult {
        if problem.needed() == 0 {
            return Ok(Some(Vec::new()));
        }
        let named = |problem: &ReducedProblem, sets: Vec<usize>| -> Vec<u32> {
            sets.into_iter().map(|set| problem.names[set]).collect()
        };
        if left <= 2 {
            let groups = self.groups(&problem)?;
            let found = self.pair(&problem, &groups, &first(problem.rows()), &problem.all_sets(), left)?;
            return Ok(found.map(|sets| named(&problem, sets)));
        }
        let mut available = problem.all_sets();
        let sets = self.branches(&mut problem, left, &mut available)?;
        let groups = if left == 3 && !sets.is_empty() { Some(self.groups(&problem)?) } else { None };
        for set in sets {
            // All covers with this set are searched in this turn: later ones leave it out.
            remove(&mut available, set);
            let found = if let Some(groups) = &groups {
                let open = left_open(&problem, &[set]);
                self.pair(&problem, groups, &open, &available, 2)?.map(|sets| named(&problem, sets))
            } else {
                let Some(rest) = problem.after(set, &available) else { continue };
                self.spend(rest.steps)?;
                self.cover(rest, left - 1)?
            };
            if let Some(mut sets) = found {
                sets.push(problem.names[set]);
                return Ok(Some(sets));
            }
        }
        Ok(None)
    }

    /// Sets of which one is in every cover; those that are in none are taken out of the available ones.
    pub(super) fn branches(
        &mut self,
        problem: &mut ReducedProblem,
        left: usize,
        available: &mut [u64],
    ) -> Result<Vec<usize>, Stop> {
        let group = self.group(problem, &first(problem.rows()), available, STARTS)?;
        let few = count(group.iter().copied());
        // Where little is left to be tried prices are dearer than trying.
        if left == 3 && few * few * 64 < 4 * problem.rows() * problem.rows_of.words {
            return Ok(ones(&group).collect());
        }
        let (verdict, steps) = by_prices(problem, left);
        self.spend(steps)?;
        let Verdict::OneOf { sets, useless } = verdict else { return Ok(Vec::new()) };
        useless.into_iter().for_each(|set| remove(available, set));
        if sets.len() <= few {
            return Ok(sets);
        }
        let size = |set: usize| count(problem.rows_of.row(set).iter().copied());
        let mut sets: Vec<usize> = ones(&group).filter(|&set| has(available, set)).collect();
        sets.sort_by_key(|&set| (usize::MAX - size(set), set));
        Ok(sets)
    }

    /// The available sets that hold any of some open rows which may not all stay uncovered, as few as are soon found: one
    /// of them is in every cover.
    pub(super) fn group(
        &mut self,
        problem: &ReducedProblem,
        open: &[u64],
        available: &[u64],
        starts: usize,
    ) -> Result<Vec<u64>, Stop> {
        // Rows come with the fewest sets first, but some sets may be ruled out.
        let rows: Vec<(Vec<u64>, u64)> = ones(open)
            .take(if problem.slack > 0 { 4 * ROWS } else { ROWS })
            .map(|row| {
                let sets =
                    problem.sets_of.row(row).iter().zip(available).map(|(set, open)| set & open).collect();
                (sets, problem.weights[row])
            })
            .collect();
        let sizes: Vec<usize> = rows.iter().map(|(sets, _)| count(sets.iter().copied())).collect();
        let mut looked = rows.len() * available.len();
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_by_key(|&row| (sizes[row], row));
        let mut best: Option<(usize, Vec<u64>)> = None;
        for &start in order.iter().take(starts) {
            let mut union = rows[start].0.clone();
            let mut together = rows[start].1;
            let mut rest: Vec<usize> = (0..rows.len()).filter(|&row| row != start).collect();
            while together <= problem.slack && !rest.is_empty() {
                looked += rest.len() * available.len();
                let new = |row: usize| count(rows[row].0.iter().zip(&union).map(|(set, union)| set & !union));
                let sizes: Vec<usize> = rest.iter().map(|&row| new(row)).collect();
                let least = *sizes.iter().min().expect("a row is left");
                if least > 0 {
                    let at = (0..rest.len())
                        .filter(|&at| sizes[at] == least)
                        .max_by_key(|&at| rows[rest[at]].1)
                        .expect("one is the least");
                    union.iter_mut().zip(&rows[rest[at]].0).for_each(|(union, set)| *union |= set);
                    together += rows[rest[at]].1;
                    rest.swap_remove(at);
                } else {
                    // What lies within costs nothing.
                    let within = (0..rest.len()).filter(|&at| sizes[at] == 0);
                    together += within.map(|at| rows[rest[at]].1).sum::<u64>();
                    rest = (0..rest.len()).filter(|&at| sizes[at] > 0).map(|at| rest[at]).collect();
                }
                if best.as_ref().is_some_and(|(size, _)| count(union.iter().copied()) >= *size) {
                    break;
                }
            }
            if together > problem.slack {
                let size = count(union.iter().copied());
                if best.as_ref().is_none_or(|(least, _)| size < *least) {
                    best = Some((size, union));
                }
            }
        }
        self.spend(looked as u64)?;
        Ok(best.map_or_else(|| available.to_vec(), |(_, union)| union))
    }

    fn groups(&mut self, problem: &ReducedProblem) -> Result<Groups, Stop> {
        let groups = Groups::new(problem);
        self.spend(groups.steps)?;
        Ok(groups)
    }
}
