//! A problem with nothing in it that does not matter.

use super::bits::{Bits, common, count, first, has, ones};

/// A problem: rows, which are elements or several with the same sets, and sets.
#[derive(Clone)]
pub(super) struct ReducedProblem {
    /// By row, above 0; those with the fewest sets first.
    pub(super) weights: Vec<u64>,
    /// By row a price that the bound may begin with, at most its weight where some may stay uncovered; empty where none is known.
    pub(super) prices: Vec<f64>,
    /// The weight that may stay uncovered.
    pub(super) slack: u64,
    /// By set: its name.
    pub(super) names: Vec<u32>,
    /// By set its rows, and by row its sets.
    pub(super) rows_of: Bits,
    pub(super) sets_of: Bits,
    /// Steps that it took to make.
    pub(super) steps: u64,
}

impl ReducedProblem {
    /// `None` where the sets cannot cover enough. Of sets with the same rows the one that is first by name stays.
    pub(super) fn new(
        weights: Vec<u64>,
        prices: Vec<f64>,
        slack: u64,
        names: Vec<u32>,
        rows_of: Bits,
    ) -> Option<Self> {
        let mut made = Self { weights, prices, slack, names, rows_of, sets_of: Bits::default(), steps: 0 };
        loop {
            let dropped = made.drop_dominated_sets();
            made.sets_of = made.rows_of.transposed(made.names.len(), made.weights.len());
            if !made.merge_rows()? && dropped == 0 {
                return Some(made);
            }
        }
    }

    /// What is left once a set is chosen, without the sets that are ruled out; `None` where those left cannot cover enough.
    pub(super) fn after(&self, chosen: usize, available: &[u64]) -> Option<Self> {
        let open: Vec<usize> = (0..self.rows()).filter(|&row| !has(self.rows_of.row(chosen), row)).collect();
        let mut sets_of = Bits::new(0, self.names.len());
        for &row in &open {
            sets_of.push(self.sets_of.row(row).iter().zip(available).map(|(set, open)| set & open));
        }
        let all = sets_of.transposed(open.len(), self.names.len());
        let (mut names, mut rows_of) = (Vec::new(), Bits::new(0, open.len()));
        for set in ones(available) {
            names.push(self.names[set]);
            rows_of.push(all.row(set).iter().copied());
        }
        let weights = open.iter().map(|&row| self.weights[row]).collect();
        let prices = open.iter().filter_map(|&row| self.prices.get(row).copied()).collect();
        Self::new(weights, prices, self.slack, names, rows_of)
    }

    pub(super) fn sets(&self) -> usize {
        self.names.len()
    }

    pub(super) fn rows(&self) -> usize {
        self.weights.len()
    }

    /// The weight that must be covered.
    pub(super) fn needed(&self) -> u64 {
        self.weights.iter().sum::<u64>().saturating_sub(self.slack)
    }

    /// The weight that a set covers of some open rows.
    pub(super) fn gain(&self, set: usize, open: &[u64]) -> u64 {
        common(self.rows_of.row(set), open).map(|row| self.weights[row]).sum()
    }

    pub(super) fn all_sets(&self) -> Vec<u64> {
        first(self.sets())
    }

    /// Drops sets that lie within others; of equal ones the first stays. Returns how many.
    fn drop_dominated_sets(&mut self) -> usize {
        let sizes = (0..self.names.len()).map(|set| count(self.rows_of.row(set).iter().copied()));
        let mut order: Vec<(usize, usize)> = sizes.zip(0..).filter(|(size, _)| *size > 0).collect();
        order.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut kept: Vec<usize> = Vec::new();
        let mut compared = 0;
        for (_, set) in order {
            let own = self.rows_of.row(set);
            let mut inside = |other: &usize| {
                own.iter().zip(self.rows_of.row(*other)).all(|(a, b)| {
                    compared += 1;
                    a & !b == 0
                })
            };
            if !kept.iter().any(&mut inside) {
                kept.push(set);
            }
        }
        self.steps += compared + (self.names.len() * self.rows_of.words) as u64;
        let dropped = self.names.len() - kept.len();
        if dropped > 0 {
            kept.sort_unstable();
            let mut rows_of = Bits::new(0, self.weights.len());
            kept.iter().for_each(|&set| rows_of.push(self.rows_of.row(set).iter().copied()));
            self.names = kept.into_iter().map(|set| self.names[set]).collect();
            self.rows_of = rows_of;
        }
        dropped
    }

    /// Makes one of rows with the same sets; where all must be covered, drops rows that are covered with another one. Rows
    /// with few sets come first. True where there are fewer; `None` where the sets cannot cover enough.
    fn merge_rows(&mut self) -> Option<bool> {
        let mut order: Vec<(usize, usize)> =
            (0..self.weights.len()).map(|row| (count(self.sets_of.row(row).iter().copied()), row)).collect();
        order.sort_by(|a, b| a.0.cmp(&b.0).then_with(|| self.sets_of.row(a.1).cmp(self.sets_of.row(b.1))));
        let mut kept: Vec<(usize, u64, f64)> = Vec::new();
        let mut compared = 0;
        for (size, row) in order {
            let (own, weight) = (self.sets_of.row(row), self.weights[row]);
            let price = self.prices.get(row).copied().unwrap_or(0.0);
            if size == 0 {
                self.slack = self.slack.checked_sub(weight)?;
                continue;
            }
            let known = if self.slack == 0 {
                kept.iter().position(|&(other, ..)| {
                    self.sets_of.row(other).iter().zip(own).all(|(a, b)| {
                        compared += 1;
                        a & !b == 0
                    })
                })
            } else {
                kept.len().checked_sub(1).filter(|&last| self.sets_of.row(kept[last].0) == own)
            };
            match known {
                // A price is worth as much or more on a row with fewer sets.
                Some(at) => {
                    kept[at].1 += weight;
                    kept[at].2 += price;
                }
                None => kept.push((row, weight, price)),
            }
        }
        self.steps += compared + (self.weights.len() * self.sets_of.words) as u64;
        let fewer = kept.len() < self.weights.len();
        let mut sets_of = Bits::new(0, self.names.len());
        kept.iter().for_each(|&(row, ..)| sets_of.push(self.sets_of.row(row).iter().copied()));
        self.weights = kept.iter().map(|(_, weight, _)| *weight).collect();
        if !self.prices.is_empty() {
            self.prices = kept.iter().map(|(.., price)| *price).collect();
        }
        self.rows_of = sets_of.transposed(self.weights.len(), self.names.len());
        self.sets_of = sets_of;
        Some(fewer)
    }
}
