//! The search on all threads: its first branches, each of which is then searched by one thread.

use super::Stop;
use super::bits::remove;
use super::reduced::ReducedProblem;
use super::search::{Search, SearchResult};
use crate::control::Control;
use crate::parallel;

/// This number of branches keeps the threads busy; where there are fewer they are branched once more.
const BRANCHES: usize = 64;
/// Branches that are searched before the steps are counted together, each within its part of the remaining ones: a
/// fixed number, so that the result does not depend on the threads.
const AT_ONCE: usize = 16;

/// Sets that are chosen, what is left, and how many sets may follow.
struct Branch {
    chosen: Vec<u32>,
    rest: ReducedProblem,
    left: usize,
}

/// The names of a cover's sets, at most `count`, or `None` where there is no such cover; with the same result on any number of threads.
pub(super) fn cover_of(
    problem: &ReducedProblem,
    count: usize,
    steps: &mut u64,
    control: Control<'_>,
) -> SearchResult {
    let mut branches = vec![Branch { chosen: Vec::new(), rest: problem.clone(), left: count }];
    while branches.len() < BRANCHES && branches.iter().any(|branch| branch.left > 2) {
        let mut next = Vec::new();
        for branch in branches {
            if branch.rest.needed() == 0 {
                return Ok(Some(branch.chosen));
            }
            if branch.left > 2 {
                next.extend(branch.split(steps, control)?);
            } else {
                next.push(branch);
            }
        }
        branches = next;
    }
    for some in branches.chunks(AT_ONCE) {
        let share = *steps / AT_ONCE as u64;
        let found = parallel::map(some.len(), |at| {
            let mut search = Search::new(share, control);
            let found = search.cover(some[at].rest.clone(), some[at].left);
            (found, share - search.steps)
        });
        *steps = steps.saturating_sub(found.iter().map(|(_, used)| used).sum());
        for ((found, _), branch) in found.into_iter().zip(some) {
            if let Some(sets) = found? {
                return Ok(Some(branch.chosen.iter().copied().chain(sets).collect()));
            }
        }
        if *steps == 0 {
            return Err(Stop::Steps);
        }
    }
    Ok(None)
}

impl Branch {
    /// By the set that is chosen next; what cannot be covered any more is left out.
    fn split(mut self, steps: &mut u64, control: Control<'_>) -> Result<Vec<Self>, Stop> {
        let mut search = Search::new(*steps, control);
        let mut available = self.rest.all_sets();
        let sets = search.branches(&mut self.rest, self.left, &mut available)?;
        let mut starts = Vec::with_capacity(sets.len());
        for set in sets {
            starts.push((set, available.clone()));
            // Covers with this set belong to its branch.
            remove(&mut available, set);
        }
        let below = parallel::map(starts.len(), |at| {
            let (set, available) = &starts[at];
            let rest = self.rest.after(*set, available)?;
            let chosen = self.chosen.iter().copied().chain([self.rest.names[*set]]).collect();
            Some(Self { chosen, rest, left: self.left - 1 })
        });
        let below: Vec<Self> = below.into_iter().flatten().collect();
        *steps = search.steps.saturating_sub(below.iter().map(|branch| branch.rest.steps).sum());
        if *steps == 0 {
            return Err(Stop::Steps);
        }
        Ok(below)
    }
}
