//! Sets of things that are joined pair by pair (union-find with path halving).

/// Which of `0..count` belong together, and which of a set differ from its first member.
pub(crate) struct Groups {
    parents: Vec<(u32, bool)>,
}

impl Groups {
    /// Each by itself.
    ///
    /// # Panics
    /// More than a `u32` counts.
    pub(crate) fn new(count: usize) -> Self {
        let count = u32::try_from(count).expect("as few as a mesh has vertices or triangles");
        Self { parents: (0..count).map(|index| (index, false)).collect() }
    }

    /// The first member of the set of `index`.
    pub(crate) fn root(&mut self, index: usize) -> usize {
        self.root_and_parity(index).0
    }

    /// The first member of the set of `index`, and whether `index` differs from it.
    pub(crate) fn root_and_parity(&mut self, mut index: usize) -> (usize, bool) {
        let mut odd = false;
        loop {
            let (parent, step) = self.parents[index];
            if parent as usize == index {
                return (index, odd);
            }
            let (grandparent, further) = self.parents[parent as usize];
            self.parents[index] = (grandparent, step ^ further);
            odd ^= step ^ further;
            index = grandparent as usize;
        }
    }

    /// Makes the sets of both one.
    pub(crate) fn join(&mut self, a: usize, b: usize) {
        self.join_with_parity(a, b, false);
    }

    /// Makes the sets of both one, in which they differ or do not. Nothing changes where they are in one set already.
    pub(crate) fn join_with_parity(&mut self, a: usize, b: usize, differ: bool) {
        let ((a, odd_a), (b, odd_b)) = (self.root_and_parity(a), self.root_and_parity(b));
        if a != b {
            self.parents[a.max(b)] = (a.min(b) as u32, odd_a ^ odd_b ^ differ);
        }
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
