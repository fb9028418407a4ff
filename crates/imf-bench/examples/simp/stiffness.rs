//! The stiffness of a lattice of elements, applied without being assembled: of one brick times a factor for each element, or
//! of elements that differ, as they come out where eight finer ones are seen through trilinear interpolation.

use pulp::Arch;
use rayon::prelude::*;

use crate::element::{Matrix, ROWS, corners, node};
use crate::lattice::Lattice;

/// Elements' matrices.
#[derive(Debug)]
enum Elements {
    /// One matrix times each element's factor, both kept.
    Scaled(Box<Matrix>, Vec<f64>),
    /// `[i][j][row][column][k]`.
    Own(Vec<f64>),
}

/// A stiffness, symmetric and positive semi-definite.
#[derive(Debug)]
pub(crate) struct Stiffness {
    pub(crate) lattice: Lattice,
    elements: Elements,
}

impl Stiffness {
    /// Of `matrix` times each element's factor, as [`Lattice::element`] orders them.
    pub(crate) fn scaled(lattice: Lattice, matrix: Matrix, factors: Vec<f64>) -> Self {
        assert_eq!(factors.len(), lattice.elements(), "a factor for each element");
        Self { lattice, elements: Elements::Scaled(Box::new(matrix), factors) }
    }

    /// Entry of an element's matrix for all elements above (i, j): a factor and as many values, or the values alone.
    fn entries(&self, [i, j]: [usize; 2], row: usize, column: usize) -> (f64, &[f64]) {
        let [_, ny, nz] = self.lattice.n;
        let above = i * ny + j;
        match &self.elements {
            Elements::Scaled(matrix, factors) => (matrix[row][column], &factors[above * nz..][..nz]),
            Elements::Own(values) => (1.0, &values[((above * ROWS + row) * ROWS + column) * nz..][..nz]),
        }
    }

    /// `f = K u`.
    pub(crate) fn apply(&self, u: &[f64], f: &mut [f64]) {
        f.par_chunks_mut(self.lattice.plane()).enumerate().for_each(|(i, plane)| {
            Arch::new().dispatch(
                #[inline(always)]
                || self.apply_plane(i, u, plane),
            );
        });
    }

    /// The rows of the nodes of one i. Each node gathers from its elements, so that no two threads write to one row.
    #[inline(always)]
    fn apply_plane(&self, i: usize, u: &[f64], plane: &mut [f64]) {
        let (lattice, nz) = (self.lattice, self.lattice.n[2]);
        plane.fill(0.0);
        let mut sums = vec![0.0; 2 * nz];
        let (low, high) = sums.split_at_mut(nz);
        for (j, [di, dj], [ei, ej]) in columns_around(lattice, i) {
            for d in 0..3 {
                let rows = [3 * node([di, dj, 0]) + d, 3 * node([di, dj, 1]) + d];
                low.fill(0.0);
                high.fill(0.0);
                for (bi, bj, c) in (0..12).map(|n| (n / 6, n / 3 % 2, n % 3)) {
                    let columns = [3 * node([bi, bj, 0]) + c, 3 * node([bi, bj, 1]) + c];
                    let u = &u[lattice.column(ei + bi, ej + bj, c)..][..nz + 1];
                    match &self.elements {
                        Elements::Scaled(matrix, _) => {
                            let [[ll, lh], [hl, hh]] =
                                rows.map(|row| columns.map(|column| matrix[row][column]));
                            for k in 0..nz {
                                low[k] += ll * u[k] + lh * u[k + 1];
                                high[k] += hl * u[k] + hh * u[k + 1];
                            }
                        }
                        Elements::Own(_) => {
                            let entry = |row, column| self.entries([ei, ej], row, column).1;
                            let [ll, lh] = columns.map(|column| entry(rows[0], column));
                            let [hl, hh] = columns.map(|column| entry(rows[1], column));
                            for k in 0..nz {
                                low[k] += ll[k] * u[k] + lh[k] * u[k + 1];
                                high[k] += hl[k] * u[k] + hh[k] * u[k + 1];
                            }
                        }
                    }
                }
                let out = &mut plane[(3 * j + d) * (nz + 1)..][..nz + 1];
                if let Elements::Scaled(_, factors) = &self.elements {
                    let factors = &factors[(ei * lattice.n[1] + ej) * nz..][..nz];
                    for k in 0..nz {
                        low[k] *= factors[k];
                        high[k] *= factors[k];
                    }
                }
                for k in 0..nz {
                    out[k] += low[k];
                }
                for k in 0..nz {
                    out[k + 1] += high[k];
                }
            }
        }
    }

    /// The diagonal.
    pub(crate) fn diagonal(&self) -> Vec<f64> {
        let (lattice, nz) = (self.lattice, self.lattice.n[2]);
        let mut diagonal = vec![0.0; lattice.unknowns()];
        for i in 0..=lattice.n[0] {
            for (j, [di, dj], above) in columns_around(lattice, i) {
                for (d, dk) in (0..3).flat_map(|d| [(d, 0), (d, 1)]) {
                    let row = 3 * node([di, dj, dk]) + d;
                    let (factor, entries) = self.entries(above, row, row);
                    let out = &mut diagonal[lattice.column(i, j, d) + dk..][..nz];
                    out.iter_mut().zip(entries).for_each(|(out, entry)| *out += factor * entry);
                }
            }
        }
        diagonal
    }

    /// All entries, row by row and each once, that are not zero by their place.
    pub(crate) fn entries_of_all(&self, mut entry: impl FnMut(usize, usize, f64)) {
        let lattice = self.lattice;
        for (i, j) in (0..lattice.n[0]).flat_map(|i| (0..lattice.n[1]).map(move |j| (i, j))) {
            for (row, column) in (0..ROWS).flat_map(|r| (0..ROWS).map(move |c| (r, c))) {
                let (factor, values) = self.entries([i, j], row, column);
                let [first, second] = [row, column].map(|row| {
                    let [a, b, c] = [row / 12, row / 6 % 2, row / 3 % 2];
                    lattice.unknown([i + a, j + b, c], row % 3)
                });
                for (k, value) in values.iter().enumerate() {
                    entry(first + k, second + k, factor * value);
                }
            }
        }
    }

    /// Each element's `uᵀ K u` with its factor left out: what its stiffness holds of the energy, times two.
    pub(crate) fn unit_energies(lattice: Lattice, matrix: &Matrix, u: &[f64]) -> Vec<f64> {
        let [nx, ny, nz] = lattice.n;
        let mut energies = vec![0.0; lattice.elements()];
        energies.par_chunks_mut(ny * nz).enumerate().for_each(|(i, plane)| {
            debug_assert!(i < nx);
            let mut image = vec![0.0; nz];
            for j in 0..ny {
                let out = &mut plane[j * nz..][..nz];
                let rows: [&[f64]; ROWS] = std::array::from_fn(|row| {
                    let [a, b, c] = [row / 12, row / 6 % 2, row / 3 % 2];
                    &u[lattice.unknown([i + a, j + b, c], row % 3)..][..nz]
                });
                for (row, entries) in matrix.iter().enumerate() {
                    image.fill(0.0);
                    for (entry, u) in entries.iter().zip(rows) {
                        image.iter_mut().zip(u).for_each(|(image, u)| *image += entry * u);
                    }
                    for k in 0..nz {
                        out[k] += rows[row][k] * image[k];
                    }
                }
            }
        });
        energies
    }

    /// The stiffness of the halved lattice that interpolates to this one: `Pᵀ K P`, element by element.
    pub(crate) fn halved(&self) -> Option<Self> {
        let lattice = self.lattice.halved()?;
        let [_, ny, nz] = lattice.n;
        let interpolations: Vec<[[f64; 8]; 8]> = corners().map(interpolation).collect();
        let mut values = vec![0.0; lattice.n[0] * ny * ROWS * ROWS * nz];
        // Of one matrix, what each of the eight places makes of it.
        let of_one = match &self.elements {
            Elements::Scaled(matrix, _) => {
                Some(interpolations.iter().map(|p| seen_through(p, matrix)).collect::<Vec<_>>())
            }
            Elements::Own(_) => None,
        };
        values.par_chunks_mut(ROWS * ROWS * nz).enumerate().for_each(|(above, out)| {
            let [i, j] = [above / ny, above % ny];
            for (place, [a, b, c]) in corners().enumerate() {
                let fine = [2 * i + a, 2 * j + b];
                for k in 0..nz {
                    let below = 2 * k + c;
                    let mut add = |matrix: &Matrix, factor: f64| {
                        for (row, entries) in matrix.iter().enumerate() {
                            for (column, entry) in entries.iter().enumerate() {
                                out[(row * ROWS + column) * nz + k] += factor * entry;
                            }
                        }
                    };
                    match &of_one {
                        Some(matrices) => add(&matrices[place], self.entries(fine, 0, 0).1[below]),
                        None => {
                            let mut matrix = [[0.0; ROWS]; ROWS];
                            for (row, column) in (0..ROWS).flat_map(|r| (0..ROWS).map(move |c| (r, c))) {
                                matrix[row][column] = self.entries(fine, row, column).1[below];
                            }
                            add(&seen_through(&interpolations[place], &matrix), 1.0);
                        }
                    }
                }
            }
        });
        Some(Self { lattice, elements: Elements::Own(values) })
    }
}

/// Of the nodes of one i: each node column's j, its place in each element column around it, and where that stands.
fn columns_around(lattice: Lattice, i: usize) -> impl Iterator<Item = (usize, [usize; 2], [usize; 2])> {
    (0..=lattice.n[1]).flat_map(move |j| {
        [[0, 0], [0, 1], [1, 0], [1, 1]].into_iter().filter_map(move |[di, dj]| {
            let above = [i.checked_sub(di)?, j.checked_sub(dj)?];
            (above[0] < lattice.n[0] && above[1] < lattice.n[1]).then_some((j, [di, dj], above))
        })
    })
}

/// Shares of a brick's nodes (columns) in the nodes of its eighth at `place` (rows).
fn interpolation(place: [usize; 3]) -> [[f64; 8]; 8] {
    let mut shares = [[0.0; 8]; 8];
    for fine in corners() {
        for coarse in corners() {
            shares[node(fine)][node(coarse)] = (0..3)
                .map(|axis| {
                    let at = (place[axis] + fine[axis]) as f64 / 2.0;
                    if coarse[axis] == 0 { 1.0 - at } else { at }
                })
                .product();
        }
    }
    shares
}

/// `Pᵀ K P` for shares of nodes.
fn seen_through(shares: &[[f64; 8]; 8], matrix: &Matrix) -> Matrix {
    let mut half = [[0.0; ROWS]; ROWS];
    for (row, column) in (0..ROWS).flat_map(|r| (0..ROWS).map(move |c| (r, c))) {
        let sum = (0..8).map(|n| matrix[row][3 * n + column % 3] * shares[n][column / 3]);
        half[row][column] = sum.sum();
    }
    let mut whole = [[0.0; ROWS]; ROWS];
    for (row, column) in (0..ROWS).flat_map(|r| (0..ROWS).map(move |c| (r, c))) {
        whole[row][column] = (0..8).map(|n| half[3 * n + row % 3][column] * shares[n][row / 3]).sum();
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::stiffness;

    fn dense(stiffness: &Stiffness) -> Vec<Vec<f64>> {
        let n = stiffness.lattice.unknowns();
        let mut matrix = vec![vec![0.0; n]; n];
        stiffness.entries_of_all(|row, column, value| matrix[row][column] += value);
        matrix
    }

    fn some() -> Stiffness {
        let lattice = Lattice { n: [2, 4, 2] };
        let factors = (0..lattice.elements()).map(|e| 0.1 + (e * e % 11) as f64).collect();
        Stiffness::scaled(lattice, stiffness([1.0, 0.8, 1.1]), factors)
    }

    #[test]
    fn what_is_applied_is_the_sum_of_the_elements() {
        let fine = some();
        for stiffness in [fine.halved().unwrap(), fine] {
            let matrix = dense(&stiffness);
            let n = matrix.len();
            let u: Vec<f64> = (0..n).map(|i| ((i * 37 + 5) % 101) as f64 / 50.0 - 1.0).collect();
            let mut f = vec![7.0; n];
            stiffness.apply(&u, &mut f);
            let diagonal = stiffness.diagonal();
            for row in 0..n {
                let expected: f64 = matrix[row].iter().zip(&u).map(|(k, u)| k * u).sum();
                assert!((f[row] - expected).abs() < 1e-10, "row {row}: {} against {expected}", f[row]);
                assert!((diagonal[row] - matrix[row][row]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn the_halved_stiffness_is_that_of_interpolated_displacements() {
        let fine = some();
        let coarse = fine.halved().unwrap();
        let u: Vec<f64> =
            (0..coarse.lattice.unknowns()).map(|i| ((i * 29 + 3) % 83) as f64 / 40.0 - 1.0).collect();
        let mut f = vec![0.0; u.len()];
        coarse.apply(&u, &mut f);
        let mut up = vec![0.0; fine.lattice.unknowns()];
        fine.lattice.add_interpolated(&u, &mut up);
        let mut forces = vec![0.0; up.len()];
        fine.apply(&up, &mut forces);
        let mut expected = vec![0.0; u.len()];
        fine.lattice.restricted(&forces, &mut expected);
        for (found, expected) in f.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-10, "{found} against {expected}");
        }
    }

    #[test]
    fn energies_add_up_to_the_work() {
        let stiffness = some();
        let Elements::Scaled(matrix, factors) = &stiffness.elements else { unreachable!("made so") };
        let u: Vec<f64> =
            (0..stiffness.lattice.unknowns()).map(|i| ((i * 31) % 67) as f64 / 30.0 - 1.0).collect();
        let mut f = vec![0.0; u.len()];
        stiffness.apply(&u, &mut f);
        let work: f64 = f.iter().zip(&u).map(|(f, u)| f * u).sum();
        let energies = Stiffness::unit_energies(stiffness.lattice, matrix, &u);
        let sum: f64 = energies.iter().zip(factors).map(|(e, s)| e * s).sum();
        assert!((work - sum).abs() < 1e-10 * work, "{work} against {sum}");
    }
}
