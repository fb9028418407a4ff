//! The fewest sets that cover a stated fraction of a weighted universe, with a proof or with the gap that is left.
//!
//! Weighted partial set cover, solved exactly: elements with the same sets are merged, sets inside others dropped, a greedy
//! cover is made, and a depth-first search shows for one number of sets after the other that it is too small, or finds a
//! cover. Weights are whole numbers inside, so that bounds are exact.

mod search;

use std::collections::HashMap;

use crate::control::Control;
use search::Search;

/// Which elements each set holds, and what each element weighs.
#[derive(Clone, Debug, Default)]
pub struct CoverProblem {
    weights: Vec<f64>,
    /// By set; 64 elements a word, the lowest first.
    sets: Vec<Vec<u64>>,
}

/// How far a cover is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoverSettings {
    /// The fraction to cover of the weight that all sets together cover, above 0 and at most 1.
    pub fraction: f64,
    /// Places of the search that are looked at before it gives up the proof.
    pub places: u64,
}

impl Default for CoverSettings {
    fn default() -> Self {
        // Of 1,000 sets and 2,000 elements these take some ten seconds.
        Self { fraction: 1.0, places: 100_000 }
    }
}

/// A cover.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cover {
    /// Indices of its sets, those that add most first.
    pub sets: Vec<usize>,
    /// No cover has fewer sets than this.
    pub at_least: usize,
}

impl Cover {
    /// True where no cover with fewer sets exists.
    #[must_use]
    pub fn is_proven(&self) -> bool {
        self.at_least == self.sets.len()
    }
}

/// The weights together, as a whole number: fine enough for areas, far from overflow.
const WHOLE: f64 = (1u64 << 50) as f64;

impl CoverProblem {
    /// No set yet; weights are finite and not negative.
    #[must_use]
    pub fn new(weights: Vec<f64>) -> Self {
        Self { weights, sets: Vec::new() }
    }

    /// Adds a set, which has the next index, by its elements.
    ///
    /// # Panics
    /// If an element is not in the universe.
    pub fn add(&mut self, elements: impl IntoIterator<Item = usize>) {
        let mut set = vec![0u64; self.weights.len().div_ceil(64)];
        for element in elements {
            assert!(element < self.weights.len(), "no element {element}");
            set[element / 64] |= 1 << (element % 64);
        }
        self.sets.push(set);
    }

    /// Number of sets.
    #[must_use]
    pub fn sets(&self) -> usize {
        self.sets.len()
    }

    /// True where the set holds the element.
    ///
    /// # Panics
    /// If there is no such set.
    #[must_use]
    pub fn holds(&self, set: usize, element: usize) -> bool {
        self.sets[set].get(element / 64).is_some_and(|word| word >> (element % 64) & 1 == 1)
    }

    /// The weight that these sets cover together.
    #[must_use]
    pub fn covered(&self, sets: &[usize]) -> f64 {
        let held = |element: &usize| sets.iter().any(|&set| self.holds(set, *element));
        (0..self.weights.len()).filter(held).map(|element| self.weights[element]).sum()
    }

    /// The weight that each of these sets covers and no other of them.
    #[must_use]
    pub fn covered_alone(&self, sets: &[usize]) -> Vec<f64> {
        let mut alone = vec![0.0; sets.len()];
        for (element, weight) in self.weights.iter().enumerate() {
            let mut holders = (0..sets.len()).filter(|&at| self.holds(sets[at], element));
            if let (Some(only), None) = (holders.next(), holders.next()) {
                alone[only] += weight;
            }
        }
        alone
    }

    /// The fewest sets that cover the fraction of what all sets cover; `None` where the control asks to stop. The result
    /// depends on nothing but problem and settings.
    #[must_use]
    pub fn fewest(&self, settings: &CoverSettings, control: Control<'_>) -> Option<Cover> {
        let reduced = Reduced::new(self, settings.fraction);
        let mut search = Search::new(&reduced, settings.places, control);
        let mut best = search.greedy();
        let mut at_least = usize::from(!best.is_empty());
        while at_least < best.len() {
            match search.cover_of(at_least) {
                Some(Ok(cover)) => best = cover,
                Some(Err(search::Stop::Cancelled)) => return None,
                Some(Err(search::Stop::Places)) => break,
                None => at_least += 1,
            }
        }
        let mut sets: Vec<usize> = best.into_iter().map(|set| reduced.names[set]).collect();
        self.largest_gain_first(&mut sets);
        Some(Cover { sets, at_least })
    }

    /// Sorts sets so that each adds the most to those before it.
    fn largest_gain_first(&self, sets: &mut [usize]) {
        sets.sort_unstable();
        let mut covered = vec![0u64; self.weights.len().div_ceil(64)];
        for at in 0..sets.len() {
            let gain = |set: usize| -> f64 {
                let new = |e: &usize| self.holds(set, *e) && covered[e / 64] >> (e % 64) & 1 == 0;
                (0..self.weights.len()).filter(new).map(|e| self.weights[e]).sum()
            };
            let gains: Vec<f64> = sets[at..].iter().map(|&set| gain(set)).collect();
            let mut best = 0;
            for (index, value) in gains.iter().enumerate() {
                if *value > gains[best] {
                    best = index;
                }
            }
            sets[at..=at + best].rotate_right(1);
            covered.iter_mut().zip(&self.sets[sets[at]]).for_each(|(all, new)| *all |= new);
        }
    }
}

/// The problem with nothing in it that does not matter.
struct Reduced {
    /// By element: its weight as a whole number, above 0.
    weights: Vec<u64>,
    /// By element: the sets that hold it.
    holders: Vec<Vec<u32>>,
    /// By set: its elements.
    elements: Vec<Vec<u32>>,
    /// By set: its index in the problem.
    names: Vec<usize>,
    /// The weight that may stay uncovered.
    slack: u64,
}

impl Reduced {
    fn new(problem: &CoverProblem, fraction: f64) -> Self {
        let total: f64 = problem.weights.iter().sum();
        let scale = if total > 0.0 { WHOLE / total } else { 0.0 };
        let whole: Vec<u64> = problem.weights.iter().map(|w| (w * scale).round() as u64).collect();
        let names = undominated(&problem.sets);
        // Elements that the same sets hold are one.
        let mut by_holders: HashMap<Vec<u32>, u64> = HashMap::new();
        for (element, &weight) in whole.iter().enumerate().filter(|(_, weight)| **weight > 0) {
            let holders: Vec<u32> =
                (0..names.len()).filter(|&s| problem.holds(names[s], element)).map(|s| s as u32).collect();
            if !holders.is_empty() {
                *by_holders.entry(holders).or_default() += weight;
            }
        }
        let mut rows: Vec<(Vec<u32>, u64)> = by_holders.into_iter().collect();
        rows.sort_by(|a, b| a.0.len().cmp(&b.0.len()).then_with(|| a.0.cmp(&b.0)));
        let coverable: u64 = rows.iter().map(|(_, weight)| weight).sum();
        // The slack of rounding goes to the one who wants all: nothing may stay uncovered.
        let slack = if fraction >= 1.0 { 0 } else { ((1.0 - fraction.max(0.0)) * coverable as f64) as u64 };
        if slack == 0 {
            rows = without_implied(rows);
        }
        let mut elements = vec![Vec::new(); names.len()];
        for (element, (holders, _)) in rows.iter().enumerate() {
            holders.iter().for_each(|&set| elements[set as usize].push(element as u32));
        }
        let (holders, weights) = rows.into_iter().unzip();
        Self { weights, holders, elements, names, slack }
    }
}

/// Indices of the sets that lie within no other; of equal ones the first.
fn undominated(sets: &[Vec<u64>]) -> Vec<usize> {
    let size = |set: &[u64]| set.iter().map(|word| word.count_ones()).sum::<u32>();
    let mut order: Vec<(u32, usize)> =
        sets.iter().enumerate().map(|(index, set)| (size(set), index)).collect();
    order.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut kept: Vec<usize> = Vec::new();
    for (_, index) in order.into_iter().filter(|(size, _)| *size > 0) {
        let inside = |other: &usize| sets[index].iter().zip(&sets[*other]).all(|(a, b)| a & !b == 0);
        if !kept.iter().any(inside) {
            kept.push(index);
        }
    }
    kept
}

/// Where all must be covered, an element is covered with any whose sets are among its own; rows with few sets first.
fn without_implied(rows: Vec<(Vec<u32>, u64)>) -> Vec<(Vec<u32>, u64)> {
    let sets = rows.iter().flat_map(|(sets, _)| sets).max().map_or(0, |last| *last as usize + 1);
    let mut kept: Vec<(Vec<u32>, u64)> = Vec::new();
    let mut words: Vec<Vec<u64>> = Vec::new();
    for row in rows {
        let mut own = vec![0u64; sets.div_ceil(64)];
        row.0.iter().for_each(|&set| own[set as usize / 64] |= 1 << (set % 64));
        let implies = |one: &Vec<u64>| one.iter().zip(&own).all(|(one, own)| one & !own == 0);
        if !words.iter().any(implies) {
            words.push(own);
            kept.push(row);
        }
    }
    kept
}

#[cfg(test)]
mod tests;
