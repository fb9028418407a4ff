//! The orientations of least value that were seen at a voxel.

/// The least values seen, ascending.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidates<const COUNT: usize> {
    pub(super) values: [f32; COUNT],
    orientations: [u32; COUNT],
}

impl<const COUNT: usize> Default for Candidates<COUNT> {
    fn default() -> Self {
        Self { values: [f32::INFINITY; COUNT], orientations: [u32::MAX; COUNT] }
    }
}

impl<const COUNT: usize> Candidates<COUNT> {
    /// Those that there are, the lowest first.
    pub(super) fn known(&self) -> impl Iterator<Item = u32> + use<COUNT> {
        self.orientations.into_iter().filter(|&index| index != u32::MAX)
    }

    /// What a value must be below to be one of them.
    pub(super) fn last(&self) -> f32 {
        self.values[COUNT - 1]
    }

    /// The lowest of them.
    pub(super) fn first<const FEWER: usize>(&self) -> Candidates<FEWER> {
        Candidates {
            values: std::array::from_fn(|place| self.values[place]),
            orientations: std::array::from_fn(|place| self.orientations[place]),
        }
    }

    /// The same of a set in which `names` are the indices.
    pub(super) fn renamed(self, names: &[u32]) -> Self {
        let name = |index: u32| names.get(index as usize).copied().unwrap_or(u32::MAX);
        Self { orientations: self.orientations.map(name), ..self }
    }

    /// Takes a value in where it is low enough.
    pub(super) fn insert(&mut self, value: f32, orientation: u32) {
        if value >= self.last() {
            return;
        }
        let mut place = COUNT - 1;
        while place > 0 && self.values[place - 1] > value {
            self.values[place] = self.values[place - 1];
            self.orientations[place] = self.orientations[place - 1];
            place -= 1;
        }
        (self.values[place], self.orientations[place]) = (value, orientation);
    }
}
