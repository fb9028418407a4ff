//! Greedy covers, and the search that shows that no smaller one exists.

use super::Reduced;
use crate::control::Control;

/// Why a search ended without an answer.
pub(super) enum Stop {
    Cancelled,
    Places,
}

/// Places between two looks at the control.
const BREATH: u64 = 1 << 12;

pub(super) struct Search<'a> {
    problem: &'a Reduced,
    control: Control<'a>,
    /// Places left to look at.
    places: u64,
    /// By element: how many chosen sets hold it, and whether it is given up.
    held: Vec<u32>,
    given_up: Vec<bool>,
    /// By element: its sets that are not ruled out.
    available: Vec<u32>,
    /// By set: the weight of its open elements, those neither held nor given up; and whether it is ruled out.
    gain: Vec<u64>,
    ruled_out: Vec<bool>,
    /// The weight of all open elements.
    open: u64,
    slack: u64,
    chosen: Vec<usize>,
    /// By set: the last bound in which it held one of the elements apart; and the number of that bound.
    marks: Vec<u64>,
    mark: u64,
}

impl<'a> Search<'a> {
    pub(super) fn new(problem: &'a Reduced, places: u64, control: Control<'a>) -> Self {
        let gain = problem.elements.iter().map(|all| all.iter().map(|&e| problem.weights[e as usize]).sum());
        Self {
            control,
            places,
            held: vec![0; problem.weights.len()],
            given_up: vec![false; problem.weights.len()],
            available: problem.holders.iter().map(|sets| sets.len() as u32).collect(),
            gain: gain.collect(),
            ruled_out: vec![false; problem.elements.len()],
            open: problem.weights.iter().sum(),
            slack: problem.slack,
            chosen: Vec::new(),
            marks: vec![0; problem.elements.len()],
            mark: 0,
            problem,
        }
    }

    /// The set that adds most, again and again; then without those that are not needed any more.
    pub(super) fn greedy(&mut self) -> Vec<usize> {
        while self.open > self.slack {
            let best = (0..self.gain.len()).max_by_key(|&set| (self.gain[set], usize::MAX - set));
            self.choose(best.expect("every open element has a set"));
        }
        for set in self.chosen.clone() {
            self.release(set);
            if self.open > self.slack {
                self.choose(set);
            }
        }
        let found = self.chosen.clone();
        found.iter().for_each(|&set| self.release(set));
        found
    }

    /// A cover of `count` sets, or `None` where there is none.
    pub(super) fn cover_of(&mut self, count: usize) -> Option<Result<Vec<usize>, Stop>> {
        let found = self.descend(count);
        let chosen = std::mem::take(&mut self.chosen);
        chosen.iter().for_each(|&set| self.uncount(set));
        match found {
            Ok(true) => Some(Ok(chosen)),
            Ok(false) => None,
            Err(stop) => Some(Err(stop)),
        }
    }

    /// True with the cover in `chosen`; else all is as before, unless it stopped.
    fn descend(&mut self, left: usize) -> Result<bool, Stop> {
        if self.open <= self.slack {
            return Ok(true);
        }
        if self.places == 0 {
            return Err(Stop::Places);
        }
        self.places -= 1;
        if self.places.is_multiple_of(BREATH) && self.control.is_cancelled() {
            return Err(Stop::Cancelled);
        }
        let needed = self.open - self.slack;
        let gains = self.largest_gains(left);
        // Their gains together are too little, or more elements than that need a set of their own.
        if gains.iter().sum::<u64>() < needed || self.apart(left) {
            return Ok(false);
        }
        let others: u64 = gains.iter().take(left.saturating_sub(1)).sum();
        let Some(element) = self.hardest() else { return Ok(false) };
        let weight = self.problem.weights[element];
        let mut sets: Vec<usize> = self.problem.holders[element]
            .iter()
            .map(|&s| s as usize)
            .filter(|&s| !self.ruled_out[s])
            .collect();
        sets.sort_by_key(|&set| (u64::MAX - self.gain[set], set));
        let mut tried = Vec::with_capacity(sets.len());
        let mut found = false;
        for set in sets {
            // The sets that follow gain no more.
            if self.gain[set] + others < needed {
                break;
            }
            self.choose(set);
            found = self.descend(left - 1)?;
            if found {
                break;
            }
            self.release(set);
            // Covers with this set were all looked at.
            self.rule_out(set);
            tried.push(set);
        }
        if !found && weight <= self.slack {
            self.give_up(element);
            found = self.descend(left)?;
            self.take_back(element);
        }
        tried.into_iter().for_each(|set| self.allow(set));
        Ok(found)
    }

    fn rule_out(&mut self, set: usize) {
        self.ruled_out[set] = true;
        self.problem.elements[set].iter().for_each(|&element| self.available[element as usize] -= 1);
    }

    fn allow(&mut self, set: usize) {
        self.ruled_out[set] = false;
        self.problem.elements[set].iter().for_each(|&element| self.available[element as usize] += 1);
    }

    /// The largest gains of so many sets that are not ruled out.
    fn largest_gains(&self, count: usize) -> Vec<u64> {
        let mut largest = Vec::with_capacity(count + 1);
        for (set, &gain) in self.gain.iter().enumerate() {
            if self.ruled_out[set]
                || (largest.len() == count && largest.last().is_none_or(|&least| gain <= least))
            {
                continue;
            }
            let at = largest.partition_point(|&other| other >= gain);
            largest.insert(at, gain);
            largest.truncate(count);
        }
        largest
    }

    /// True where more than `left` open elements need a set of their own.
    fn apart(&mut self, left: usize) -> bool {
        self.mark += 1;
        let mut apart = Vec::new();
        for element in 0..self.problem.weights.len() {
            if !self.is_open(element) {
                continue;
            }
            let holders = &self.problem.holders[element];
            if holders.iter().any(|&s| !self.ruled_out[s as usize] && self.marks[s as usize] == self.mark) {
                continue;
            }
            holders.iter().for_each(|&set| self.marks[set as usize] = self.mark);
            apart.push(self.problem.weights[element]);
        }
        if apart.len() <= left {
            return false;
        }
        // As many as can be of them stay uncovered.
        apart.sort_unstable();
        let mut slack = self.slack;
        let uncovered = apart.iter().take_while(|&&weight| {
            let fits = weight <= slack;
            slack = slack.saturating_sub(weight);
            fits
        });
        apart.len() - uncovered.count() > left
    }

    fn is_open(&self, element: usize) -> bool {
        self.held[element] == 0 && !self.given_up[element]
    }

    /// The open element with the fewest sets; one that must be covered before one that need not.
    fn hardest(&self) -> Option<usize> {
        let open = (0..self.problem.weights.len()).filter(|&element| self.is_open(element));
        open.min_by_key(|&element| {
            let weight = self.problem.weights[element];
            (weight <= self.slack, self.available[element], u64::MAX - weight)
        })
    }

    fn choose(&mut self, set: usize) {
        self.chosen.push(set);
        for &element in &self.problem.elements[set] {
            let element = element as usize;
            if self.is_open(element) {
                self.close(element);
            }
            self.held[element] += 1;
        }
    }

    /// Takes a chosen set out, wherever it stands.
    fn release(&mut self, set: usize) {
        self.chosen.retain(|&other| other != set);
        self.uncount(set);
    }

    fn uncount(&mut self, set: usize) {
        for &element in &self.problem.elements[set] {
            let element = element as usize;
            self.held[element] -= 1;
            if self.is_open(element) {
                self.reopen(element);
            }
        }
    }

    fn give_up(&mut self, element: usize) {
        self.close(element);
        self.slack -= self.problem.weights[element];
        self.given_up[element] = true;
    }

    fn take_back(&mut self, element: usize) {
        self.given_up[element] = false;
        self.slack += self.problem.weights[element];
        if self.is_open(element) {
            self.reopen(element);
        }
    }

    fn close(&mut self, element: usize) {
        let weight = self.problem.weights[element];
        self.open -= weight;
        for &set in &self.problem.holders[element] {
            self.gain[set as usize] -= weight;
        }
    }

    fn reopen(&mut self, element: usize) {
        let weight = self.problem.weights[element];
        self.open += weight;
        for &set in &self.problem.holders[element] {
            self.gain[set as usize] += weight;
        }
    }
}
