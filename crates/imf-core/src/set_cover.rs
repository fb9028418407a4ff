//! The fewest sets that cover a stated fraction of a weighted universe, with a proof or with the gap that is left.
//!
//! Weighted partial set cover, solved exactly: elements with the same sets are merged, sets inside others dropped, a greedy
//! cover is made smaller by exchanges, and a search shows for one number of sets after the other that it is too small, or finds
//! a cover. Weights are whole numbers inside, so that bounds are exact.

mod bits;
mod bound;
mod branches;
mod groups;
pub(crate) mod local;
mod pairs;
mod reduced;
mod search;

use crate::control::Control;
use bits::Bits;
use reduced::ReducedProblem;

/// Which elements each set holds, and what each element weighs.
#[derive(Clone, Debug, Default)]
pub struct CoverProblem {
    weights: Vec<f64>,
    /// By set; 64 elements a word, the lowest first.
    sets: Vec<Vec<u64>>,
}

/// Required coverage, and the limit of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoverSettings {
    /// The fraction to cover of the weight that all sets together cover, above 0 and at most 1.
    pub fraction: f64,
    /// Steps of the search before it gives up the proof. In one 64 elements of two sets are compared.
    pub steps: u64,
}

impl Default for CoverSettings {
    fn default() -> Self {
        // Of 1,000 sets and 2,000 elements these take some ten seconds on two cores.
        Self { fraction: 1.0, steps: 20_000_000_000 }
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

/// Why a search ended without a result.
enum Stop {
    Cancelled,
    Steps,
}

/// The weights together, as a whole number: fine enough for areas, far from overflow.
const WHOLE: f64 = (1u64 << 50) as f64;

impl CoverProblem {
    /// No set yet.
    ///
    /// # Panics
    /// If a weight is negative or not finite.
    #[must_use]
    pub fn new(weights: Vec<f64>) -> Self {
        let is_weight = |weight: &f64| weight.is_finite() && *weight >= 0.0;
        assert!(weights.iter().all(is_weight), "weights must be finite and at least 0");
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

    /// This universe and another one, with sets that hold those of the same index in both. What all sets cover of the one weighs 1, and
    /// of the other as well.
    ///
    /// # Panics
    /// If the numbers of sets differ.
    #[must_use]
    pub fn beside(&self, other: &Self) -> Self {
        assert_eq!(self.sets(), other.sets());
        let share = |one: &Self| {
            let whole = one.coverable();
            // Where no set covers anything there is nothing to choose by.
            let share = |weight: &f64| if whole > 0.0 { weight / whole } else { 0.0 };
            one.weights.iter().map(share).collect::<Vec<_>>()
        };
        let mut both = Self::new([share(self), share(other)].concat());
        let own = self.weights.len();
        for (one, two) in self.sets.iter().zip(&other.sets) {
            both.add(bits::ones(one).chain(bits::ones(two).map(|element| own + element)));
        }
        both
    }

    /// Number of sets.
    #[must_use]
    pub fn sets(&self) -> usize {
        self.sets.len()
    }

    /// Number of elements.
    #[must_use]
    pub fn elements(&self) -> usize {
        self.weights.len()
    }

    /// What all elements weigh together.
    #[must_use]
    pub fn weight(&self) -> f64 {
        self.weights.iter().sum()
    }

    /// True where the set holds the element.
    ///
    /// # Panics
    /// If there is no such set.
    #[must_use]
    pub fn contains(&self, set: usize, element: usize) -> bool {
        self.sets[set].get(element / 64).is_some_and(|word| word >> (element % 64) & 1 == 1)
    }

    /// The weight that these sets cover together.
    #[must_use]
    pub fn covered(&self, sets: &[usize]) -> f64 {
        // A sum of nothing is −0.
        bits::ones(&self.union(sets.iter().copied())).map(|element| self.weights[element]).sum::<f64>() + 0.0
    }

    /// The weight that all sets cover together.
    #[must_use]
    pub fn coverable(&self) -> f64 {
        self.covered(&(0..self.sets()).collect::<Vec<_>>())
    }

    /// The elements that these sets hold together.
    fn union(&self, sets: impl Iterator<Item = usize>) -> Vec<u64> {
        let mut union = vec![0u64; self.weights.len().div_ceil(64)];
        for set in sets {
            union.iter_mut().zip(&self.sets[set]).for_each(|(union, held)| *union |= held);
        }
        union
    }

    /// The weight that each of these sets covers and no other of them.
    #[must_use]
    pub fn covered_alone(&self, sets: &[usize]) -> Vec<f64> {
        let mut alone = vec![0.0; sets.len()];
        for (element, weight) in self.weights.iter().enumerate() {
            let mut holders = (0..sets.len()).filter(|&at| self.contains(sets[at], element));
            if let (Some(only), None) = (holders.next(), holders.next()) {
                alone[only] += weight;
            }
        }
        alone
    }

    /// The fewest sets that cover the fraction of what all sets cover; `None` where the control asks to stop. Of sets that do as
    /// well the first is taken. The result depends on nothing but problem and settings.
    #[must_use]
    pub fn fewest(&self, settings: &CoverSettings, control: Control<'_>) -> Option<Cover> {
        let Some(mut reduced) = self.reduced(self.sets(), settings.fraction) else {
            return Some(Cover { sets: Vec::new(), at_least: 0 });
        };
        let mut steps = settings.steps;
        let mut best = local::exchanged(&reduced, local::greedy(&reduced), &mut steps, control)?;
        let mut at_least = 1;
        while at_least < best.len() {
            let (verdict, taken) = bound::by_prices(&mut reduced, at_least);
            steps = steps.saturating_sub(taken);
            if matches!(verdict, bound::Verdict::None) {
                at_least += 1;
                continue;
            }
            match branches::cover_of(&reduced, at_least, &mut steps, control) {
                Ok(Some(cover)) => best = cover,
                Ok(None) => at_least += 1,
                Err(Stop::Cancelled) => return None,
                Err(Stop::Steps) => break,
            }
        }
        let mut sets: Vec<usize> = best.into_iter().map(|set| set as usize).collect();
        self.first_of_equals(&mut sets);
        self.largest_gain_first(&mut sets);
        Some(Cover { sets, at_least })
    }

    /// A cover of as many sets whose last set, in the order in which they were added, is the first possible, as far as the settings'
    /// steps go: of sets that were added by rank the cover whose worst is best. One that is not proven is returned as it is; `None`
    /// where the control asks to stop.
    #[must_use]
    pub fn among_first(&self, cover: Cover, settings: &CoverSettings, control: Control<'_>) -> Option<Cover> {
        if !cover.is_proven() {
            return Some(cover);
        }
        let Cover { mut sets, at_least } = cover;
        let mut steps = settings.steps;
        // With the first `fewest` and no more no cover is known; with the first `enough` there is one.
        let mut fewest = sets.len().saturating_sub(1);
        while let enough = sets.iter().max().map_or(0, |last| last + 1)
            && fewest + 1 < enough
        {
            let tried = (fewest + enough) / 2;
            let reduced = self.reduced(tried, settings.fraction);
            match reduced.map(|reduced| branches::cover_of(&reduced, sets.len(), &mut steps, control)) {
                Some(Ok(Some(found))) => sets = found.into_iter().map(|set| set as usize).collect(),
                None | Some(Ok(None)) => fewest = tried,
                Some(Err(Stop::Cancelled)) => return None,
                Some(Err(Stop::Steps)) => break,
            }
        }
        self.first_of_equals(&mut sets);
        self.largest_gain_first(&mut sets);
        Some(Cover { sets, at_least })
    }

    /// The problem of the first sets, to cover a fraction of what all can, in whole numbers and with nothing in it that does not matter;
    /// `None` where nothing is to be covered, or these sets do not cover enough.
    fn reduced(&self, first: usize, fraction: f64) -> Option<ReducedProblem> {
        let total: f64 = self.weights.iter().sum();
        let scale = if total > 0.0 { WHOLE / total } else { 0.0 };
        let whole: Vec<u64> = self.weights.iter().map(|w| (w * scale).round() as u64).collect();
        let held = |sets: usize| -> Vec<usize> {
            let held =
                |&element: &usize| whole[element] > 0 && (0..sets).any(|set| self.contains(set, element));
            (0..whole.len()).filter(held).collect()
        };
        let (held, by_any) = (held(first), held(self.sets()));
        let weigh = |held: &[usize]| held.iter().map(|&element| whole[element]).collect::<Vec<u64>>();
        let weights = weigh(&held);
        // What rounding takes from a fraction, a unit of each element, may stay; of all nothing may.
        let coverable: u64 = weigh(&by_any).iter().sum();
        let of = |coverable: u64| ((1.0 - fraction.max(0.0)) * coverable as f64) as u64 + by_any.len() as u64;
        let slack = if fraction < 1.0 { of(coverable) } else { 0 };
        let slack = slack.checked_sub(coverable - weights.iter().sum::<u64>())?;
        let mut rows_of = Bits::new(first, held.len());
        for set in 0..first {
            let rows = (0..held.len()).filter(|&row| self.contains(set, held[row]));
            rows.for_each(|row| rows_of.set(set, row));
        }
        if held.is_empty() {
            return None;
        }
        ReducedProblem::new(weights, Vec::new(), slack, (0..first as u32).collect(), rows_of)
    }

    /// The weight that a set adds to covered elements.
    fn gain(&self, set: usize, covered: &[u64]) -> f64 {
        let new = self.sets[set].iter().zip(covered).map(|(held, covered)| held & !covered);
        bits::places(new).map(|element| self.weights[element]).sum()
    }

    /// Exchanges each set for the first with which they cover no less.
    fn first_of_equals(&self, sets: &mut [usize]) {
        for at in 0..sets.len() {
            let others = sets.iter().enumerate().filter(|(other, _)| *other != at);
            let others = self.union(others.map(|(_, &set)| set));
            let own = self.gain(sets[at], &others);
            if let Some(first) = (0..sets[at]).find(|&candidate| self.gain(candidate, &others) >= own) {
                sets[at] = first;
            }
        }
    }

    /// Sorts sets so that each adds the most to those before it.
    pub(crate) fn largest_gain_first(&self, sets: &mut [usize]) {
        sets.sort_unstable();
        let mut covered = vec![0u64; self.weights.len().div_ceil(64)];
        for at in 0..sets.len() {
            let gains: Vec<f64> = sets[at..].iter().map(|&set| self.gain(set, &covered)).collect();
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

#[cfg(test)]
mod tests;
