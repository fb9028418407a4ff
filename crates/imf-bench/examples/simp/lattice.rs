//! Numbers on a box of bricks: where the displacements of nodes stand, and how a lattice of half as many bricks along each
//! axis fills it.
//!
//! ```text
//! displacement d of node (i, j, k)    [i][j][d][k]    k contiguous: every loop runs along z
//! element (i, j, k)                   [i][j][k]
//! ```

use rayon::prelude::*;

/// A box of bricks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Lattice {
    /// Elements along each axis.
    pub(crate) n: [usize; 3],
}

impl Lattice {
    pub(crate) fn elements(self) -> usize {
        self.n.iter().product()
    }

    /// Displacements: three at each node.
    pub(crate) fn unknowns(self) -> usize {
        3 * self.n.iter().map(|n| n + 1).product::<usize>()
    }

    /// Nodes along z.
    pub(crate) fn height(self) -> usize {
        self.n[2] + 1
    }

    /// Displacements at the nodes of one i.
    pub(crate) fn plane(self) -> usize {
        3 * (self.n[1] + 1) * self.height()
    }

    pub(crate) fn element(self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.n[1] + j) * self.n[2] + k
    }

    /// Index of the displacement `d` of node (i, j, 0).
    pub(crate) fn column(self, i: usize, j: usize, d: usize) -> usize {
        ((i * (self.n[1] + 1) + j) * 3 + d) * self.height()
    }

    pub(crate) fn unknown(self, [i, j, k]: [usize; 3], d: usize) -> usize {
        self.column(i, j, d) + k
    }

    /// All nodes.
    pub(crate) fn nodes(self) -> impl Iterator<Item = [usize; 3]> {
        let [nx, ny, nz] = self.n;
        (0..=nx).flat_map(move |i| (0..=ny).flat_map(move |j| (0..=nz).map(move |k| [i, j, k])))
    }

    /// The lattice with half as many elements along each axis, where all are even.
    pub(crate) fn halved(self) -> Option<Self> {
        self.n.iter().all(|n| n % 2 == 0).then(|| Self { n: self.n.map(|n| n / 2) })
    }

    /// Adds to values at this lattice's nodes what trilinear interpolation makes of those of the halved one.
    pub(crate) fn add_interpolated(self, coarse: &[f64], fine: &mut [f64]) {
        let Some(half) = self.halved() else { return };
        fine.par_chunks_mut(self.plane()).enumerate().for_each(|(i, plane)| {
            for j in 0..=self.n[1] {
                for d in 0..3 {
                    let column = &mut plane[(3 * j + d) * self.height()..][..self.height()];
                    let (parents_i, parents_j) = (parents(i), parents(j));
                    for (&pi, &pj) in parents_i.iter().flat_map(|pi| parents_j.iter().map(move |pj| (pi, pj)))
                    {
                        let from = &coarse[half.column(pi, pj, d)..][..half.height()];
                        for k in 0..half.height() {
                            column[2 * k] += 0.25 * from[k];
                        }
                        for k in 0..half.n[2] {
                            column[2 * k + 1] += 0.125 * (from[k] + from[k + 1]);
                        }
                    }
                }
            }
        });
    }

    /// Values of the halved lattice's elements, each for the eight that it is cut into.
    pub(crate) fn cut(self, coarse: &[f64]) -> Vec<f64> {
        let [_, ny, nz] = self.n;
        let half = Self { n: self.n.map(|n| n / 2) };
        let whole = |e: usize| half.element([e / (ny * nz) / 2, e / nz % ny / 2, e % nz / 2]);
        (0..self.elements()).map(|e| coarse[whole(e)]).collect()
    }

    /// The transpose of [`Self::add_interpolated`]: what values at this lattice's nodes come to at the halved one's.
    pub(crate) fn restricted(self, fine: &[f64], coarse: &mut [f64]) {
        let Some(half) = self.halved() else { return };
        coarse.par_chunks_mut(half.plane()).enumerate().for_each(|(i, plane)| {
            let mut sum = vec![0.0; self.height()];
            for j in 0..=half.n[1] {
                for d in 0..3 {
                    sum.fill(0.0);
                    for (fi, wi) in children(i, self.n[0]) {
                        for (fj, wj) in children(j, self.n[1]) {
                            let from = &fine[self.column(fi, fj, d)..][..self.height()];
                            sum.iter_mut().zip(from).for_each(|(sum, v)| *sum += wi * wj * v);
                        }
                    }
                    let column = &mut plane[(3 * j + d) * half.height()..][..half.height()];
                    for (k, value) in column.iter_mut().enumerate() {
                        *value = children(k, self.n[2]).map(|(fk, w)| w * sum[fk]).sum();
                    }
                }
            }
        });
    }
}

/// The two nodes of the halved lattice that a node lies between; twice the same where it lies on one.
fn parents(i: usize) -> [usize; 2] {
    [i / 2, i.div_ceil(2)]
}

/// The nodes that take from node `i` of the halved lattice, and their shares of it.
fn children(i: usize, n: usize) -> impl Iterator<Item = (usize, f64)> {
    let around = [(2 * i).checked_sub(1), Some(2 * i), Some(2 * i + 1).filter(|&i| i <= n)];
    around.into_iter().zip([0.5, 1.0, 0.5]).filter_map(|(node, share)| Some((node?, share)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(length: usize, seed: u64) -> Vec<f64> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / f64::from(u32::MAX) - 0.25
        };
        (0..length).map(|_| next()).collect()
    }

    #[test]
    fn interpolation_is_exact_for_linear_fields_and_restriction_is_its_transpose() {
        let lattice = Lattice { n: [4, 2, 6] };
        let half = lattice.halved().unwrap();
        let field = |[i, j, k]: [usize; 3], d: usize, h: f64| {
            h * (1.5 * i as f64 - 0.5 * j as f64 + 2.0 * k as f64) + d as f64
        };
        let mut coarse = vec![0.0; half.unknowns()];
        for (node, d) in half.nodes().flat_map(|node| (0..3).map(move |d| (node, d))) {
            coarse[half.unknown(node, d)] = field(node, d, 2.0);
        }
        let mut fine = vec![0.0; lattice.unknowns()];
        lattice.add_interpolated(&coarse, &mut fine);
        for (node, d) in lattice.nodes().flat_map(|node| (0..3).map(move |d| (node, d))) {
            assert!((fine[lattice.unknown(node, d)] - field(node, d, 1.0)).abs() < 1e-12, "{node:?}");
        }
        let (u, f) = (noise(half.unknowns(), 1), noise(lattice.unknowns(), 2));
        let (mut up, mut down) = (vec![0.0; f.len()], vec![0.0; u.len()]);
        lattice.add_interpolated(&u, &mut up);
        lattice.restricted(&f, &mut down);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        assert!((dot(&up, &f) - dot(&u, &down)).abs() < 1e-12 * f.len() as f64);
    }
}
