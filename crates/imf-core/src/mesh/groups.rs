//! Sets of things that are joined pair by pair (union-find with path halving).

/// Which of `0..count` belong together.
pub(crate) struct Groups {
    parents: Vec<u32>,
}

impl Groups {
    /// Each by itself.
    ///
    /// # Panics
    /// More than a `u32` counts.
    pub(crate) fn new(count: usize) -> Self {
        let count = u32::try_from(count).expect("as few as a mesh has vertices or triangles");
        Self { parents: (0..count).collect() }
    }

    /// The first member of the set of `index`.
    pub(crate) fn root(&mut self, mut index: usize) -> usize {
        while self.parents[index] as usize != index {
            self.parents[index] = self.parents[self.parents[index] as usize];
            index = self.parents[index] as usize;
        }
        index
    }

    /// Makes the sets of both one.
    pub(crate) fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b)] = a.min(b) as u32;
    }

    /// The sets, in the order of their first members.
    pub(crate) fn members(&mut self) -> Vec<Vec<usize>> {
        let mut members = vec![Vec::new(); self.parents.len()];
        for index in 0..self.parents.len() {
            let root = self.root(index);
            members[root].push(index);
        }
        members.retain(|group| !group.is_empty());
        members
    }
}
