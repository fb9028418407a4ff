//! An adversary's queries with their true answers, and how many answers of a checker are wrong.

use super::adversary_truth::Case;
use super::*;
use crate::field::Decision;

/// Number of queries, and the wrong results.
#[derive(Default)]
pub(super) struct Tally {
    pub(super) contacts: usize,
    pub(super) colliding: usize,
    pub(super) free: usize,
    pub(super) motions: usize,
    /// Motions of which a beginning is proven free.
    pub(super) proven: usize,
    /// Distances of free tools and depths of colliding ones.
    pub(super) distances: [usize; 2],
    pub(super) wrong: Vec<String>,
}

impl Tally {
    /// Of each case the first that is wrong, and how many there are.
    pub(super) fn wrong(&self) -> String {
        let mut cases: std::collections::BTreeMap<&str, (usize, &str)> = Default::default();
        for wrong in &self.wrong {
            let (case, _) = wrong.split_once(" Pose").unwrap();
            cases.entry(case).or_insert((0, wrong)).0 += 1;
        }
        let lines = cases.values().map(|(count, first)| format!("{count} times as {first}\n"));
        format!("{} of {} poses\n{}", self.wrong.len(), self.colliding + self.free, lines.collect::<String>())
    }

    pub(super) fn and(mut self, other: Self) -> Self {
        self.contacts += other.contacts;
        self.colliding += other.colliding;
        self.free += other.free;
        self.motions += other.motions;
        self.proven += other.proven;
        (0..2).for_each(|i| self.distances[i] += other.distances[i]);
        self.wrong.extend(other.wrong);
        self
    }
}

/// Poses, and the truth of each.
#[derive(Default)]
pub(super) struct PoseCases {
    pub(super) poses: Vec<Pose>,
    pub(super) collides: Vec<bool>,
}

impl PoseCases {
    pub(super) fn push(&mut self, pose: Pose, collides: bool) {
        self.poses.push(pose);
        self.collides.push(collides);
    }

    /// One by one, and all together.
    pub(super) fn answers(&self, case: &Case, tally: &mut Tally) {
        let mut decisions = vec![Decision::Undecided; self.poses.len()];
        case.checker.classify(&self.poses, &mut decisions).unwrap();
        for ((pose, &collides), decision) in self.poses.iter().zip(&self.collides).zip(decisions) {
            let alone = Decision::of(!case.checker.is_free(pose));
            let is_true = alone == Decision::of(collides) || (!collides && case.rounds(pose));
            if alone != decision || !is_true {
                let answers = format!("one by one {alone:?}, together {decision:?}, collides {collides}");
                tally.wrong.push(format!("{} {pose:?}: {answers}", case.name));
            }
            tally.colliding += usize::from(collides);
            tally.free += usize::from(!collides);
        }
    }
}
